"""The firmware as a node: it checks frames, hands the kernel counts, and sends odometry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import can
import numpy as np
from numpy.typing import NDArray

from can_bus import COUNTER_MODULO, Database, FrameChecker, MessageSpec, Raw, make_message, protect
from firmware_model import (
    FRESH,
    INVALID,
    STALE,
    Kernel,
    KernelConfig,
)
from firmware_model.kernel import Implementation
from hil_harness.firmware_program import FirmwareProgram
from hil_harness.kernel_inputs import KERNEL_ROLES, KernelInputs
from hil_harness.nodes.reports import firmware_messages, report_values
from hil_harness.nodes.schedule import cycle_of
from hil_harness.odometry_frames import ODOMETRY_ROLES, odometry_converters
from hil_harness.robot import Robot
from hil_harness.signal_map import SignalMap

MAX_AGE_TICKS: Final = 2
"""A frame that waited longer than this in the receive queue is too old to be a sensor's state."""


@dataclass(frozen=True)
class Inputs:
    """What the kernel was handed, tick by tick: each int64[n]. Enough to run it again."""

    left_count: NDArray[np.int64]
    right_count: NDArray[np.int64]
    encoder_validity: NDArray[np.int64]
    gyro_code: NDArray[np.int64]
    gyro_validity: NDArray[np.int64]


class FirmwareNode:
    """The ECU: steps its kernel once per call, on whatever valid frames have arrived.

    Frames are checked for identifier, length, CRC, counter, range and age; rejected ones are
    counted in `checker.rejected` and touch nothing. One that passes while its stream's E2E state is
    INVALID is handed on as invalid, so it is not used either. Of several valid frames of one
    message the newest counts, as in a receive mailbox. Its own frames carry the tick counter of the
    encoder frame that came last, or its own running one while there is none. `trigger_ids` are the
    frames that make a tick's input complete (real time only). `program` is what it runs instead of
    the described one; a tick that it does not execute sends nothing.

    Raises HarnessError where robot, map and formats do not fit together.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        database: Database,
        signal_map: SignalMap,
        tick_period_us: int,
        implementation: Implementation | None = None,
        keep_inputs: bool = True,
        program: FirmwareProgram | None = None,
    ) -> None:
        """Build the kernel from the robot's description and bind it to the signals."""
        robot.require_tick(tick_period_us, database.path.name)
        self._inputs = KernelInputs(signal_map, robot.plant)
        if program is None:
            program = FirmwareProgram(
                robot, signal_map, tick_period_us, implementation=implementation
            )
        self.program = program
        self.config = program.described
        self.kernel = program.kernel
        messages = self._inputs.messages
        self.checker = FrameChecker(
            database, [spec.name for spec in messages], max_age_us=MAX_AGE_TICKS * tick_period_us
        )
        self.trigger_ids = frozenset(
            (spec.frame_id, spec.is_extended)
            for spec in messages
            if (spec.cycle_time_us or tick_period_us) == tick_period_us
        )
        convert = (self._inputs.left_count, self._inputs.right_count, self._inputs.gyro_code)
        self._readers: dict[str, list[tuple[int, str, Callable[[Raw], int]]]] = {
            spec.name: [] for spec in messages
        }
        for index, role in enumerate(KERNEL_ROLES):
            mapped = signal_map.get(role)
            if mapped is not None:
                reader = (index, mapped.signal.name, convert[index])
                self._readers[mapped.message.name].append(reader)
        wheels = signal_map["left_count"].message
        self._counter_source = wheels.name if wheels.is_protected else None
        self._senders = _senders(database, signal_map, self.config, self.kernel, tick_period_us)
        self._steps = 0
        self._keep_inputs = keep_inputs
        self._counter = -1
        self._history: list[tuple[int, int, int, int, int]] = []

    @property
    def ticks(self) -> int:
        """How many steps have been taken."""
        return self._steps

    @property
    def inputs(self) -> Inputs:
        """What the kernel has been handed so far; nothing if `keep_inputs` is off."""
        columns = np.array(self._history, dtype=np.int64).reshape(-1, 5).T
        return Inputs(*np.ascontiguousarray(columns))

    def step(self, now_us: int, frames: Sequence[can.Message], /) -> list[can.Message]:
        """Check the frames, step the kernel once, and return the frames that are due."""
        values: list[int | None] = [None, None, None]
        invalid = [False, False, False]
        counter = (self._counter + 1) % COUNTER_MODULO
        check = self.checker.check
        for frame in frames:
            accepted = check(frame, now_us)
            if accepted is None:
                continue
            message = accepted.spec.name
            for index, name, convert in self._readers[message]:
                if name in accepted.invalid or not accepted.is_trusted:
                    invalid[index] = True
                else:
                    invalid[index] = False
                    values[index] = convert(accepted.raw[name])
            if message == self._counter_source and accepted.counter is not None:
                counter = accepted.counter
        self._counter = counter
        left, right, gyro = values
        if invalid[0] or invalid[1]:
            encoder_validity = INVALID
        else:
            encoder_validity = STALE if left is None or right is None else FRESH
        gyro_validity = INVALID if invalid[2] else STALE if gyro is None else FRESH
        given = (left or 0, right or 0, encoder_validity, gyro or 0, gyro_validity)
        if self._keep_inputs:
            self._history.append(given)
        steps = self._steps
        self._steps = steps + 1
        if not self.program.step(*given):
            return []
        pose_q = self.program.pose_q
        sent: list[can.Message] = []
        for spec, every, phase, values_of in self._senders:
            if steps % every == phase:
                raw = [value(pose_q) for value in values_of]
                sent.append(make_message(spec, _encode(spec, raw, counter), now_us))
        return sent


def firmware_config(
    robot: Robot, signal_map: SignalMap, tick_period_us: int, *, allow_overflow: bool = False
) -> KernelConfig:
    """Return the kernel's integers for a robot whose sensors speak through this map.

    Raises HarnessError where the formats do not fit, with the file and the line of the field, and
    for a map without wheels.
    """
    program = FirmwareProgram(robot, signal_map, tick_period_us, allow_overflow=allow_overflow)
    return program.described


def _encode(spec: MessageSpec, values: list[Raw], counter: int) -> bytearray:
    """Return a frame of payload values in order, protected where the DBC says so."""
    if spec.is_plain:  # it has no float signal
        whole: list[int] = values  # type: ignore[assignment]
        return spec.pack(whole, counter if spec.is_protected else None)
    names = (signal.name for signal in spec.payload)
    data = spec.encode_raw(dict(zip(names, values, strict=True)))
    if spec.is_protected:
        protect(spec, data, counter)
    return data


Pose = tuple[int, int, int]
_Source = Callable[[Pose], Raw]


def _senders(
    database: Database,
    signal_map: SignalMap,
    config: KernelConfig,
    kernel: Kernel,
    tick_period_us: int,
) -> list[tuple[MessageSpec, int, int, list[_Source]]]:
    """Return each message the firmware sends: cycle, phase, and a source per payload signal."""
    sources: dict[str, _Source] = {}
    converters = odometry_converters(
        signal_map,
        position_frac_bits=config.position_frac_bits,
        heading_frac_bits=config.heading_frac_bits,
    )
    for role, convert in converters.items():
        sources[signal_map[role].path] = _pose_source(convert, ODOMETRY_ROLES.index(role))
    odometry = signal_map.messages(ODOMETRY_ROLES)
    messages = firmware_messages(database, signal_map)
    for spec in messages:
        if spec not in odometry:
            for signal, value in report_values(spec, kernel).items():
                sources[f"{spec.name}.{signal}"] = _report_source(value)
    senders = []
    for spec in sorted(messages, key=lambda spec: spec.frame_id):
        every, phase = cycle_of(spec, tick_period_us)
        values_of = [
            sources.get(signal.path) or _constant(signal.initial_raw) for signal in spec.payload
        ]
        senders.append((spec, every, phase, values_of))
    return senders


def _pose_source(convert: Callable[[int], Raw], index: int) -> _Source:
    return lambda pose_q: convert(pose_q[index])


def _report_source(value: Callable[[], Raw]) -> _Source:
    return lambda pose_q: value()


def _constant(raw: Raw) -> _Source:
    return lambda pose_q: raw
