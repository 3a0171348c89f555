"""The program on the node under test: the kernel, and how a real ECU runs it otherwise.

Neutral changes leave the plain kernel. The same object runs in a node, tick by tick, and over the
recorded inputs of a run.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from firmware_model import (
    FRESH,
    FirmwareChanges,
    FirmwareError,
    FloatTwin,
    Kernel,
    KernelConfig,
)
from firmware_model.config import require_c
from firmware_model.kernel import Implementation
from firmware_model.oracle import Integers, integer_type
from hil_harness.errors import HarnessError
from hil_harness.kernel_inputs import KernelInputs
from hil_harness.robot import Robot
from hil_harness.signal_map import SignalMap
from sim_plant import stream_generator

FirmwareSchedule: TypeAlias = tuple[tuple[float, FirmwareChanges], ...]
"""(from_s, changes) in ascending order; the first holds from power-on."""

AS_DESCRIBED: Final[FirmwareSchedule] = ((-math.inf, FirmwareChanges()),)

_STREAM: Final = 0x6669726D
_BLOCK: Final = 1024


class FirmwareProgram:
    """The kernel as the ECU runs it.

    Args:
        robot, signal_map, tick_period_us: what it is built for.
        schedule: how the program differs from the described one, over time.
        seed: of ticks that are not executed.
        implementation: of the kernel; None: compiled, or python for what C cannot hold.
        allow_overflow: run formats whose words overflow in normal use, and the kernel counts, and
            formats that C cannot hold.

    Attributes:
        described: the configuration without changes.
        held: what runs at some time, but for words that an effect narrows in order to overflow.
        integers: what holds its words: int64, or objects where C cannot hold one of them.
        kernel: what runs.
        is_constant: it is stepped in every tick, under one configuration.

    Raises HarnessError where the formats do not fit, with the file and the line of the field.
    """

    def __init__(
        self,
        robot: Robot,
        signal_map: SignalMap,
        tick_period_us: int,
        *,
        schedule: FirmwareSchedule = AS_DESCRIBED,
        seed: int = 0,
        implementation: Implementation | None = None,
        allow_overflow: bool = False,
    ) -> None:
        """Start at power-on."""
        gyro = KernelInputs(signal_map, robot.plant).gyro
        tick_s = tick_period_us / 1e6
        self.described: KernelConfig
        pieces: list[tuple[int, KernelConfig, FirmwareChanges]] = []
        try:
            constants = robot.firmware_constants(tick_period_us, gyro)
            self.described = FirmwareChanges().config(
                robot.firmware, constants, allow_overflow=allow_overflow
            )
            for start_s, changes in schedule:
                config = self.described
                if changes != FirmwareChanges():
                    config = changes.config(
                        robot.firmware, constants, allow_overflow=allow_overflow
                    )
                first = math.ceil(start_s / tick_s) if math.isfinite(start_s) else 0
                pieces.append((first, config, changes))
            self.integers = integer_type([self.described, *(config for _, config, _ in pieces)])
            if implementation is None:
                implementation = "python" if self.integers is object else "compiled"
            if implementation != "python":
                for _, config, _ in pieces:
                    require_c(config)
        except FirmwareError as error:
            raise HarnessError(f"{robot.where(str(error))}: {error}") from error
        self.held = tuple(config for _, config, changes in pieces if changes.overflow_bits == 0)
        first_changes = pieces[0][2]
        self.is_constant = (
            len(pieces) == 1
            and first_changes.missed_deadline == 0.0
            and not first_changes.calibrates_in_motion
        )
        self.kernel = Kernel(pieces[0][1], implementation)
        self._next = deque(pieces[1:])
        self._changes = pieces[0][2]
        self._tick_s = tick_s
        self._tick = 0
        self._generator = stream_generator(seed, _STREAM)
        self._draws: list[float] = []
        self._kept: tuple[int, int, int, int, int] | None = None
        self._code_sum = 0
        self._code_count = 0

    @property
    def pose_q(self) -> tuple[int, int, int]:
        """x, y and heading in the fraction bits of the *described* formats."""
        pose_q, now, then = self.kernel.pose_q, self.kernel.config, self.described
        if now is then:
            return pose_q
        position = then.position_frac_bits - now.position_frac_bits
        heading = then.heading_frac_bits - now.heading_frac_bits
        x_m_q, y_m_q, heading_turn_q = pose_q
        return x_m_q << position, y_m_q << position, heading_turn_q << heading

    def step(
        self,
        left_count: int,
        right_count: int,
        encoder_validity: int,
        gyro_code: int,
        gyro_validity: int,
    ) -> bool:
        """Take one tick's inputs as the kernel does; return False if the tick is not executed.

        The readings of such a tick wait in their mailboxes: the newest fresh ones serve the next.
        """
        given = (left_count, right_count, encoder_validity, gyro_code, gyro_validity)
        if self.is_constant:
            self.kernel.step(*given)
            return True
        while self._next and self._tick >= self._next[0][0]:
            _, config, self._changes = self._next.popleft()
            self.kernel.reconfigure(config)
        self._calibrate(gyro_code, gyro_validity)
        self._tick += 1
        if self._kept is not None:
            given = _newest(self._kept, given)
            self._kept = None
        if not self._draws:
            self._draws = self._generator.random(_BLOCK).tolist()[::-1]
        if self._draws.pop() < self._changes.missed_deadline:
            self._kept = given
            return False
        self.kernel.step(*given)
        return True

    def _calibrate(self, gyro_code: int, gyro_validity: int) -> None:
        """Average the gyro's codes in the window, and keep the mean from its end on."""
        changes, time_s = self._changes, self._tick * self._tick_s
        if not changes.calibrates_in_motion:
            return
        if changes.calibration_start_s <= time_s < changes.calibration_stop_s:
            if gyro_validity == FRESH:
                low, high = self.described.gyro_min_code, self.described.gyro_max_code
                self._code_sum += min(max(gyro_code, low), high)
                self._code_count += 1
        elif self._code_count:
            self.kernel.set_gyro_offset(self._code_sum / self._code_count)
            self._code_count = 0


def run_program(
    program: FirmwareProgram, inputs: NDArray[np.int64]
) -> tuple[Integers, NDArray[np.float64], NDArray[np.bool_], NDArray[np.int64]]:
    """Run a program from power-on over all ticks.

    Args:
        inputs: int64[ticks, 5], the kernel's inputs in its order.

    Returns:
        pose_q [ticks, 3] (described fraction bits) in `program.integers`, the float twin's pose
        float64[ticks, 3], whether each tick was executed, and the status word of each tick.
    """
    ticks = len(inputs)
    pose_q = np.empty((ticks, 3), dtype=program.integers)
    twin_pose = np.empty((ticks, 3))
    executed = np.empty(ticks, dtype=np.bool_)
    status = np.empty(ticks, dtype=np.int64)
    twin = FloatTwin(program.kernel.config)
    for tick, given in enumerate(inputs.tolist()):
        executed[tick] = program.step(*given)
        if executed[tick]:
            twin.follow(program.kernel)
        pose_q[tick] = program.pose_q
        twin_pose[tick] = twin.pose
        status[tick] = program.kernel.status_word
    return pose_q, twin_pose, executed, status


def _newest(
    kept: tuple[int, int, int, int, int], given: tuple[int, int, int, int, int]
) -> tuple[int, int, int, int, int]:
    """Return inputs in which what is not fresh is taken from the tick before."""
    left, right, encoder, code, gyro = given
    if encoder != FRESH and kept[2] == FRESH:
        left, right, encoder = kept[:3]
    if gyro != FRESH and kept[4] == FRESH:
        code, gyro = kept[3:]
    return left, right, encoder, code, gyro
