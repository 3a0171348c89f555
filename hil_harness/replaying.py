"""Replay: the firmware model over a recorded log, held bit for bit against the log's odometry.

The log holds what the firmware received and sent, in its order. Each block of frames that the
firmware sent is one step: the frames before it are the step's input, and its stamp is the step's
time, so that every decision (age, loss, order) falls as it did on the day. Where the odometry is
slower than the tick, the stamps of a lockstep run tell the steps apart. Messages that the log has
not at all are not compared.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import can

from can_bus import MessageSpec, Raw, read_log, timestamp_us
from hil_harness.assembly import Wire
from hil_harness.errors import HarnessError
from hil_harness.firmware_program import FirmwareProgram
from hil_harness.nodes import FirmwareNode
from hil_harness.nodes.reports import firmware_messages
from hil_harness.odometry_frames import ODOMETRY_ROLES
from hil_harness.robot import Robot

_Key = tuple[int, bool]

_LONGEST_SILENCE_US: Final = 3_600_000_000
"""No stamp of a lockstep run lies so far behind the one before; one by wall clock is behind 0."""


@dataclass(frozen=True)
class Difference:
    """The first raw value that differs: logged against computed (None: no such frame)."""

    tick: int
    field: str
    logged_raw: Raw | None
    computed_raw: Raw | None


@dataclass(frozen=True)
class ReplayResult:
    """What a replay found.

    Attributes:
        ticks, fields: how many steps were run, and how many raw values compared.
        missing: the messages of the firmware that the log has not at all: nothing to compare.
        rejected: received frames that the firmware did not take, by reason.
        state: the kernel's at the end.
    """

    log: Path
    ticks: int
    fields: int
    first_difference: Difference | None
    missing: tuple[str, ...]
    rejected: Mapping[str, int]
    state: Mapping[str, int]

    @property
    def is_equal(self) -> bool:
        """Tell whether every compared value is equal."""
        return self.first_difference is None


def replay(log: str | Path, robot: Robot, wire: Wire, *, force: bool = False) -> ReplayResult:
    """Run the firmware model over a log and compare it with the log's odometry frames.

    Stops comparing at the first difference. A log that ends inside a tick is compared as far as it
    goes. `force` takes formats that overflow in normal use; the state counts how often. Raises
    CanBusError for a log that cannot be read, HarnessError for one without any frame of the
    firmware, or whose steps cannot be told apart, or for formats that overflow.
    """
    path = Path(log)
    node = FirmwareNode(
        robot,
        database=wire.database,
        signal_map=wire.signal_map,
        tick_period_us=wire.tick_period_us,
        keep_inputs=False,
        program=FirmwareProgram(robot, wire.signal_map, wire.tick_period_us, allow_overflow=force),
    )
    wire.signal_map.require(ODOMETRY_ROLES[:1], "a replay")
    sent = _by_key(firmware_messages(wire.database, wire.signal_map))
    ours = _in_the_log(path, sent)
    if not ours:
        names = ", ".join(spec.name for spec in sent.values())
        raise HarnessError(
            f"{path}: no odometry frames: expected {names} in the log, to compare the replay with"
        )
    fields = 0
    difference: Difference | None = None
    for step in _with_last(_steps(path, ours, wire)):
        computed = node.step(step.now_us, step.received)
        if difference is None:
            compared, difference = _compare(path, node.ticks - 1, step, computed, ours)
            fields += compared
    missing = tuple(spec.name for key, spec in sent.items() if key not in ours)
    rejected = {str(why): count for why, count in node.checker.rejected.items()}
    state = node.kernel.state()
    return ReplayResult(path, node.ticks, fields, difference, missing, rejected, state)


def logged_steps(path: Path, wire: Wire) -> Iterator[LoggedStep]:
    """Yield the steps of a log's firmware: what it had received, and what it sent.

    Raises as `replay` does.
    """
    return _steps(path, _by_key(firmware_messages(wire.database, wire.signal_map)), wire)


def _by_key(messages: Iterable[MessageSpec]) -> dict[_Key, MessageSpec]:
    return {(spec.frame_id, spec.is_extended): spec for spec in messages}


def _in_the_log(path: Path, sent: Mapping[_Key, MessageSpec]) -> dict[_Key, MessageSpec]:
    """Return which of these messages a log has; it is read no farther than until all were seen."""
    seen: set[_Key] = set()
    for message in read_log(path):
        if not message.is_error_frame:
            seen.add((message.arbitration_id, message.is_extended_id))
        if sent.keys() <= seen:
            break
    return {key: spec for key, spec in sent.items() if key in seen}


@dataclass
class LoggedStep:
    """One step of the firmware as the log has it."""

    now_us: int
    received: list[can.Message]
    sent: list[can.Message]
    is_last: bool = False


def _with_last(steps: Iterator[LoggedStep]) -> Iterator[LoggedStep]:
    """Mark the last step: the log may have ended inside it."""
    before: LoggedStep | None = None
    for step in steps:
        if before is not None:
            yield before
        before = step
    if before is not None:
        before.is_last = True
        yield before


def _steps(path: Path, ours: Mapping[_Key, MessageSpec], wire: Wire) -> Iterator[LoggedStep]:
    """Return the steps of a log: by what was sent, or, if not every step sends, by the stamps."""
    period_us = wire.tick_period_us
    if any((spec.cycle_time_us or period_us) == period_us for spec in ours.values()):
        return _steps_by_answers(read_log(path), ours)
    return _steps_by_stamps(path, ours, period_us)


def _steps_by_answers(
    messages: Iterator[can.Message], ours: Mapping[_Key, MessageSpec]
) -> Iterator[LoggedStep]:
    """Each block of the firmware's frames ends a step; what was received before is its input."""
    received: list[can.Message] = []
    sent: dict[_Key, can.Message] = {}
    for message in messages:
        key = (message.arbitration_id, message.is_extended_id)
        is_ours = key in ours and not message.is_error_frame
        if sent and (not is_ours or key in sent):
            yield _step(received, sent)
            received, sent = [], {}
        if is_ours:
            sent[key] = message
        else:
            received.append(message)
    if sent:
        yield _step(received, sent)


def _step(received: list[can.Message], sent: Mapping[_Key, can.Message]) -> LoggedStep:
    frames = list(sent.values())
    return LoggedStep(timestamp_us(frames[0]), received, frames)


def _steps_by_stamps(
    path: Path, ours: Mapping[_Key, MessageSpec], period_us: int
) -> Iterator[LoggedStep]:
    """In a log of a lockstep run each tick has its own stamp; ticks without a frame are steps too.

    Raises HarnessError for a log of a real-time run: there the steps without an answer left no
    trace.
    """
    step = LoggedStep(0, [], [])
    for message in read_log(path):
        stamp_us = timestamp_us(message)
        late_us = stamp_us - step.now_us
        if stamp_us % period_us or not 0 <= late_us <= _LONGEST_SILENCE_US:
            slow = next(iter(ours.values()))
            raise HarnessError(
                f"{path}: {slow.name} comes every {slow.cycle_time_us} µs, a tick lasts "
                f"{period_us} µs, and the stamps are not those of whole ticks from 0 on: expected "
                "the log of a lockstep run, or odometry at every tick"
            )
        while stamp_us > step.now_us:
            yield step
            step = LoggedStep(step.now_us + period_us, [], [])
        is_ours = (message.arbitration_id, message.is_extended_id) in ours
        (step.sent if is_ours and not message.is_error_frame else step.received).append(message)
    yield step


def _compare(
    path: Path,
    tick: int,
    step: LoggedStep,
    computed: list[can.Message],
    ours: Mapping[_Key, MessageSpec],
) -> tuple[int, Difference | None]:
    """Return how many fields were compared, and the first that differs."""
    fields = 0
    expected = {(m.arbitration_id, m.is_extended_id): m for m in computed}
    found = {(m.arbitration_id, m.is_extended_id): m for m in step.sent}
    for key, spec in ours.items():
        there, here = found.get(key), expected.get(key)
        if there is None and (here is None or step.is_last):
            continue
        if there is None or here is None:
            return fields, _missing(tick, spec, there, here)
        if len(there.data) != spec.length_bytes:
            raise HarnessError(
                f"{path}: {spec.name} at tick {tick}: {len(there.data)} bytes: "
                f"expected {spec.length_bytes}"
            )
        logged_raw, computed_raw = spec.decode_raw(there.data), spec.decode_raw(here.data)
        for name in _payload_first(spec, logged_raw):
            fields += 1
            value = logged_raw[name]
            if value != computed_raw[name]:
                return fields, Difference(tick, f"{spec.name}.{name}", value, computed_raw[name])
    return fields, None


def _payload_first(spec: MessageSpec, names: Iterable[str]) -> list[str]:
    """Name what a frame says before its counter and CRC, which differ whenever it does."""
    payload = {signal.name for signal in spec.payload}
    return sorted(names, key=lambda name: name not in payload)


def _missing(
    tick: int, spec: MessageSpec, there: can.Message | None, here: can.Message | None
) -> Difference:
    first = spec.payload[0].name

    def raw(message: can.Message | None) -> Raw | None:
        return None if message is None else spec.decode_raw(message.data)[first]

    return Difference(tick, f"{spec.name}.{first}", raw(there), raw(here))
