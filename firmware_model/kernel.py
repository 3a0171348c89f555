"""One firmware instance: the kernel with its state, as plain Python or as machine code."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Final, Literal, get_args

import numpy as np
import numpy.typing as npt

from firmware_model.c99_kernel import C99Kernel
from firmware_model.compiled import compiled_step, run_compiled
from firmware_model.config import CONFIG_DTYPE, CONFIG_FIELDS, KernelConfig, require_c
from firmware_model.errors import FirmwareError
from firmware_model.state import STATE_DTYPE, STATE_FIELDS, HeadingSource, State, StatusBit
from firmware_model.step import step_kernel
from firmware_model.twin import Twin, TwinConfig, build_twin_config, step_twin
from firmware_model.velocity import speed_m_s, turn_rate_rad_s

Implementation = Literal["compiled", "python", "c99"]
IMPLEMENTATIONS: Final[tuple[Implementation, ...]] = get_args(Implementation)

_OFFSET_LOG2 = 14
_POSE_FIELDS = ("x_m_q", "y_m_q", "heading_turn_q")
assert STATE_FIELDS[: len(_POSE_FIELDS)] == _POSE_FIELDS, "the pose leads the record"


def initial_state(config: KernelConfig) -> State:
    """Return the state at power-on: all zero, gyro offset at its nominal code."""
    return State(gyro_offset_q=config.zero_rate_code_q)


def config_record(config: KernelConfig, *, table_start: int = 0) -> npt.NDArray[np.void]:
    """Return *config* as an array of one record, its table starting at *table_start*.

    Raises:
        FirmwareError: a configuration beyond C.
    """
    require_c(config)
    record = np.zeros(1, CONFIG_DTYPE)
    for name in CONFIG_FIELDS:
        record[name] = getattr(config, name)
    record["table_start"] = table_start
    return record


class Kernel:
    """The firmware's odometry of one robot.

    Args:
        config: from `build_config`.
        implementation: ``"compiled"`` (about a microsecond a step), ``"python"`` (the readable
            oracle, some tens) or ``"c99"`` (what a microcontroller runs, built here by the C
            compiler); all give the same integers. None: compiled, or python for what C, and
            machine code, cannot hold.

    Raises:
        FirmwareError: an implementation of another name, c99 without a C compiler, or one that
            cannot hold the configuration.
    """

    def __init__(self, config: KernelConfig, implementation: Implementation | None = None) -> None:
        if implementation is None:
            implementation = "python" if config.beyond_c else "compiled"
        self.config = config
        self.implementation: Implementation = implementation
        if implementation == "python":
            self._state = initial_state(config)
        elif implementation == "compiled":
            self._states = np.zeros(1, STATE_DTYPE)
            self._record = self._states[0]
            self._pose = self._states.view(np.int64)[: len(_POSE_FIELDS)]
            self._configs = config_record(config)
            self._table = np.array(config.table, dtype=np.int64)
            self._step = compiled_step()
            self.load_state(_state_dict(initial_state(config)))
        elif implementation == "c99":
            self._c99 = C99Kernel(config)
            self._record = self._c99.record
        else:
            raise FirmwareError(
                f"implementation = {implementation!r}: expected one of {', '.join(IMPLEMENTATIONS)}"
            )

    def step(
        self,
        left_count: int,
        right_count: int,
        encoder_validity: int,
        gyro_code: int,
        gyro_validity: int,
    ) -> None:
        """Take one tick's inputs, each an int64.

        Args:
            left_count: left encoder counter [ticks], read modulo its width.
            right_count: right encoder counter [ticks].
            encoder_validity: FRESH, STALE or INVALID (as is any other number); only a fresh
                sample is looked at.
            gyro_code: gyro ADC code [LSB] of the tick that ends now.
            gyro_validity: as encoder_validity, for the gyro.

        Raises:
            OverflowError: an input outside int64; the state stays as it was.
        """
        if self.implementation == "compiled":
            self._step(
                self._states,
                self._configs,
                self._table,
                left_count,
                right_count,
                encoder_validity,
                gyro_code,
                gyro_validity,
            )
            return
        given = (left_count, right_count, encoder_validity, gyro_code, gyro_validity)
        if not _fits_int64(min(given)) or not _fits_int64(max(given)):
            raise OverflowError(f"inputs {given}: expected integers of 64 bits")
        if self.implementation == "python":
            step_kernel(self._state, self.config, self.config.table, *given)
        else:
            self._c99.step(*given)

    def run(self, inputs: npt.NDArray[np.int64]) -> None:
        """Take many ticks' inputs, int64[n, 5] in the order of `step`, as fast as a batch does."""
        if self.implementation == "c99":
            self._c99.run(inputs)
            return
        if self.implementation == "compiled":
            run_compiled(self._states, self._configs, self._table, inputs)
            return
        for given in inputs.tolist():
            self.step(*given)

    def reconfigure(self, config: KernelConfig) -> None:
        """Go on under another configuration from the present state, as after a reflash.

        Pose and gyro offset are brought to the new fraction bits (floor); remainders are dropped.
        """
        state = self.state()
        position = config.position_frac_bits - self.config.position_frac_bits
        heading = config.heading_frac_bits - self.config.heading_frac_bits
        offset = config.offset_frac_bits - self.config.offset_frac_bits
        for name, bits in (
            ("x_m_q", position),
            ("y_m_q", position),
            ("heading_turn_q", heading),
            ("gyro_offset_q", offset),
        ):
            state[name] = state[name] << bits if bits >= 0 else state[name] >> -bits
        for name in state:
            if name.endswith("_remainder_q") or name in ("v_filter_q", "w_filter_q", "gap_turn_q"):
                state[name] = 0
        if state["offset_is_valid"] == 0:
            state["gyro_offset_q"] = config.zero_rate_code_q
        self.config = config
        if self.implementation == "compiled":
            self._configs = config_record(config)
            self._table = np.array(config.table, dtype=np.int64)
        elif self.implementation == "c99":
            self._c99.configure(config)
        self.load_state(state)

    def set_gyro_offset(self, code: float) -> None:
        """Use a zero-rate code found elsewhere, to the nearest 2^-14 LSB.

        Raises:
            FirmwareError: no code of this gyro.
        """
        low, high = self.config.gyro_min_code, self.config.gyro_max_code
        if not low <= code <= high:
            raise FirmwareError(f"gyro offset = {code}: expected a code from {low} to {high}")
        state = self.state()
        state["offset_is_valid"] = 1
        state["offset_samples_log2"] = _OFFSET_LOG2
        state["offset_sum"] = round(code * (1 << _OFFSET_LOG2))
        state["gyro_offset_q"] = round(code * (1 << self.config.offset_frac_bits))
        self.load_state(state)

    def _get(self, name: str) -> int:
        if self.implementation == "python":
            value: int = getattr(self._state, name)
            return value
        return int(self._record[name])

    @property
    def pose_q(self) -> tuple[int, int, int]:
        """x_m_q, y_m_q and heading_turn_q, read at once."""
        if self.implementation == "python":
            state = self._state
            return state.x_m_q, state.y_m_q, state.heading_turn_q
        if self.implementation == "c99":
            return self._get("x_m_q"), self._get("y_m_q"), self._get("heading_turn_q")
        x_m_q, y_m_q, heading_turn_q = self._pose.tolist()
        return x_m_q, y_m_q, heading_turn_q

    @property
    def x_m_q(self) -> int:
        """Position x, in 2^−position.frac_bits m."""
        return self._get("x_m_q")

    @property
    def y_m_q(self) -> int:
        """Position y, in 2^−position.frac_bits m."""
        return self._get("y_m_q")

    @property
    def heading_turn_q(self) -> int:
        """Heading in [−½, ½) turn, in 2^−heading.frac_bits turn."""
        return self._get("heading_turn_q")

    @property
    def heading_turn_q32(self) -> int:
        """Heading in [−½, ½) turn, in 2^−32 turn, whatever the heading's format."""
        return self._get("heading_turn_q") * (1 << (32 - self.config.heading_frac_bits))

    @property
    def v_m_s_q(self) -> int:
        """Low-passed forward speed, in 2^−velocity.frac_bits m/s; the last one while invalid."""
        if self.implementation == "c99":
            return self._c99.v_m_s_q
        return speed_m_s(self._plain_state(), self.config)

    @property
    def w_rad_s_q(self) -> int:
        """Low-passed turn rate, in 2^−velocity.frac_bits rad/s; the last one while invalid."""
        if self.implementation == "c99":
            return self._c99.w_rad_s_q
        return turn_rate_rad_s(self._plain_state(), self.config)

    @property
    def v_is_valid(self) -> bool:
        """Whether this tick gave a forward speed."""
        return self._get("v_is_valid") == 1

    @property
    def w_is_valid(self) -> bool:
        """Whether this tick gave a turn rate."""
        return self._get("w_is_valid") == 1

    @property
    def status(self) -> StatusBit:
        """The status word."""
        return StatusBit(self.status_word)

    @property
    def status_word(self) -> int:
        """The status word as a plain integer, for those who read it bit by bit."""
        return self._get("status")

    @property
    def heading_source(self) -> HeadingSource:
        """What moved the heading in this tick."""
        return HeadingSource(self._get("heading_source"))

    @property
    def gyro_offset_q(self) -> int:
        """Zero-rate code in use, in 2^−gyro.offset_frac_bits LSB."""
        return self._get("gyro_offset_q")

    @property
    def overflow_count(self) -> int:
        """How often a step, a turn, x or y has left its word since power-on.

        A velocity that saturates is not counted: it is made when it is read, of no state.
        """
        return self._get("overflow_count")

    def _plain_state(self) -> State:
        return self._state if self.implementation == "python" else State(**self.state())

    def state(self) -> dict[str, int]:
        """Return the full state, for `state.json` and for comparison."""
        if self.implementation == "python":
            return _state_dict(self._state)
        if self.implementation == "c99":
            return self._c99.state()
        return dict(zip(STATE_FIELDS, self._record.item(), strict=True))

    def load_state(self, state: Mapping[str, int]) -> None:
        """Continue from a state that `state` returned.

        Raises:
            FirmwareError: a field is missing, unknown, or not a 64-bit integer (for c99: an
                integer that its C field holds; of any width for what C cannot hold).
        """
        if set(state) != set(STATE_FIELDS):
            wrong = sorted(set(state) ^ set(STATE_FIELDS))
            raise FirmwareError(
                f"state: field {wrong[0]} is {'unknown' if wrong[0] in state else 'missing'}: "
                f"expected exactly the {len(STATE_FIELDS)} fields of firmware_model.State"
            )
        for name, value in state.items():
            if type(value) is not int or not (_fits_int64(value) or self.config.beyond_c):
                raise FirmwareError(f"state.{name} = {value!r}: expected an integer of 64 bits")
        if self.implementation == "python":
            self._state = State(**state)
        elif self.implementation == "c99":
            self._c99.load_state(state)
        else:
            for name, value in state.items():
                self._record[name] = value


class FloatTwin:
    """The float64 twin of one kernel, stepped after it.

    Attributes:
        twin: its state: x_m, y_m, heading_rad (unwrapped).
    """

    def __init__(self, config: KernelConfig) -> None:
        self.twin = Twin()
        self._kernel_config = config
        self._config: TwinConfig = build_twin_config(config)

    def step(self, kernel: Kernel) -> None:
        """Follow the tick that *kernel* has just taken."""
        step_twin(self.twin, self._config, kernel._plain_state())

    def follow(self, kernel: Kernel) -> None:
        """As `step`, with the constants that the kernel has now."""
        if kernel.config is not self._kernel_config:
            self._kernel_config = kernel.config
            self._config = build_twin_config(kernel.config)
        self.step(kernel)

    @property
    def pose(self) -> tuple[float, float, float]:
        """Return (x_m, y_m, heading_rad), heading unwrapped."""
        return self.twin.x_m, self.twin.y_m, self.twin.heading_rad


def _fits_int64(value: int) -> bool:
    return -(1 << 63) <= value < 1 << 63


def _state_dict(state: State) -> dict[str, int]:
    return {one.name: getattr(state, one.name) for one in fields(state)}
