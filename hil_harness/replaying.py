"""Replay: the firmware model over a recorded log, held bit for bit against the log's odometry.

The log holds what the firmware received and sent, in its order. Each block of frames that the
firmware sent is one step: the frames before it are the step's input, and its stamp is the step's
time, so that every decision (age, loss, order) falls as it did on the day.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import can

from can_bus import MessageSpec, Raw, read_log, timestamp_us
from hil_harness.assembly import Wire
from hil_harness.errors import HarnessError
from hil_harness.nodes import FirmwareNode
from hil_harness.odometry_frames import ODOMETRY_ROLES
from hil_harness.robot import Robot


@dataclass(frozen=True)
class Difference:
    """The first raw value that differs: logged against computed (None: no such frame)."""

    tick: int
    field: str
    logged_raw: Raw | None
    computed_raw: Raw | None


@dataclass(frozen=True)
class ReplayResult:
    """What a replay found. `ticks` steps were run and `fields` raw values compared."""

    log: Path
    ticks: int
    fields: int
    first_difference: Difference | None
    rejected: Mapping[str, int]
    state: Mapping[str, int]

    @property
    def is_equal(self) -> bool:
        """Tell whether every compared value is equal."""
        return self.first_difference is None


def replay(log: str | Path, robot: Robot, wire: Wire) -> ReplayResult:
    """Run the firmware model over a log and compare it with the log's odometry frames.

    Stops comparing at the first difference. Raises CanBusError for a log that cannot be read,
    HarnessError for one without odometry frames to compare with.
    """
    path = Path(log)
    node = FirmwareNode(
        robot,
        database=wire.database,
        signal_map=wire.signal_map,
        tick_period_us=wire.tick_period_us,
    )
    wire.signal_map.require(ODOMETRY_ROLES[:1], "a replay")
    ours = _sent_by_firmware(wire)
    ticks = fields = 0
    difference: Difference | None = None
    for now_us, received, sent in _steps(read_log(path), ours):
        computed = node.step(now_us, received)
        if difference is None:
            compared, difference = _compare(ticks, sent, computed, ours)
            fields += compared
        ticks += 1
    if ticks == 0:
        names = ", ".join(spec.name for spec in ours.values())
        raise HarnessError(
            f"{path}: no odometry frames: expected {names} in the log, to compare the replay with"
        )
    return ReplayResult(
        path,
        ticks,
        fields,
        difference,
        {str(why): count for why, count in node.checker.rejected.items()},
        node.kernel.state(),
    )


_Key = tuple[int, bool]


def _sent_by_firmware(wire: Wire) -> dict[_Key, MessageSpec]:
    """Return the messages that the firmware sends: odometry, and what shares its sender."""
    odometry = wire.signal_map.messages(ODOMETRY_ROLES)
    senders = {sender for spec in odometry for sender in spec.senders}
    shared = (
        spec
        for spec in wire.database.messages.values()
        if senders & set(spec.senders) and spec.name in ("STATUS", "ODOMETRY_VELOCITY")
    )
    return {(spec.frame_id, spec.is_extended): spec for spec in (*odometry, *shared)}


def _steps(
    messages: Iterator[can.Message], ours: Mapping[_Key, MessageSpec]
) -> Iterator[tuple[int, list[can.Message], list[can.Message]]]:
    """Yield each step: its time, what the firmware received before it, and what it then sent."""
    received: list[can.Message] = []
    sent: dict[_Key, can.Message] = {}
    for message in messages:
        key = (message.arbitration_id, message.is_extended_id)
        is_ours = key in ours and not message.is_error_frame
        if sent and (not is_ours or key in sent):
            yield timestamp_us(next(iter(sent.values()))), received, list(sent.values())
            received, sent = [], {}
        if is_ours:
            sent[key] = message
        else:
            received.append(message)
    if sent:
        yield timestamp_us(next(iter(sent.values()))), received, list(sent.values())


def _compare(
    tick: int,
    logged: list[can.Message],
    computed: list[can.Message],
    ours: Mapping[_Key, MessageSpec],
) -> tuple[int, Difference | None]:
    """Return how many fields were compared, and the first that differs."""
    fields = 0
    expected = {(m.arbitration_id, m.is_extended_id): m for m in computed}
    found = {(m.arbitration_id, m.is_extended_id): m for m in logged}
    for key, spec in ours.items():
        there, here = found.get(key), expected.get(key)
        if there is None and here is None:
            continue
        if there is None or here is None:
            return fields, _missing(tick, spec, there, here)
        if len(there.data) != spec.length_bytes:
            raise HarnessError(
                f"{spec.name} at tick {tick}: {len(there.data)} bytes: expected {spec.length_bytes}"
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
