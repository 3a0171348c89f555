"""How busy a bus is, and how long each of its frames can take, from the database alone."""

from __future__ import annotations

from dataclasses import dataclass

from can_bus.database import Database
from can_bus.errors import CanBusError
from can_bus.response_time import QueuedFrame, ResponseTime, response_times
from can_bus.simulated.queues import arbitration_key
from can_bus.specs import MessageSpec
from can_bus.timing import INTERFRAME_BITS, worst_length_bits


@dataclass(frozen=True)
class FrameLoad:
    """One cyclic frame: its part in the load, with as many stuff bits as can be, and its worst."""

    spec: MessageSpec
    load: float
    response: ResponseTime


@dataclass(frozen=True)
class BusLoad:
    """A whole bus, most urgent frame first.

    Attributes:
        bitrate: in bit/s.
        jitter_us: of every frame.
        frames: the cyclic ones of classic CAN.
        not_cyclic, not_classic: names of the messages that are left out, and why.
    """

    bitrate: int
    jitter_us: int
    frames: tuple[FrameLoad, ...]
    not_cyclic: tuple[str, ...]
    not_classic: tuple[str, ...]

    @property
    def load(self) -> float:
        """The share of the bus that all cyclic frames ask for at worst."""
        return sum(one.load for one in self.frames)


def bus_load(database: Database, bitrate: int | None = None, *, jitter_us: int = 0) -> BusLoad:
    """Return what a database's cyclic frames ask of a bus.

    Args:
        database: cycle times and lengths.
        bitrate: in bit/s; None: the database's own.
        jitter_us: how much later than its cycle a frame may be queued.

    Raises CanBusError where there is no bit rate, or nothing cyclic.
    """
    rate = bitrate if bitrate is not None else database.bitrate
    if rate is None:
        raise CanBusError(f"{database.path.name} names no Baudrate: expected --bitrate")
    cyclic, not_cyclic, not_classic = [], [], []
    for spec in database.messages.values():
        if spec.is_fd or spec.length_bytes > 8:
            not_classic.append(spec.name)
        elif not spec.cycle_time_us:
            not_cyclic.append(spec.name)
        else:
            cyclic.append(spec)
    if not cyclic:
        raise CanBusError(
            f"{database.path.name}: no classic CAN message has a cycle time: expected "
            "GenMsgCycleTime"
        )
    queued = {spec.name: _queued(spec, jitter_us) for spec in cyclic}
    responses = {one.frame.name: one for one in response_times(list(queued.values()), rate)}
    frames = [
        FrameLoad(spec, _load(queued[spec.name], rate), responses[spec.name]) for spec in cyclic
    ]
    frames.sort(key=lambda one: one.response.frame.key)
    return BusLoad(rate, jitter_us, tuple(frames), tuple(not_cyclic), tuple(not_classic))


def _queued(spec: MessageSpec, jitter_us: int) -> QueuedFrame:
    return QueuedFrame(
        spec.name,
        arbitration_key(spec.frame_id, spec.is_extended, False),
        worst_length_bits(spec.is_extended, spec.length_bytes),
        1000 * (spec.cycle_time_us or 0),
        1000 * jitter_us,
    )


def _load(frame: QueuedFrame, bitrate: int) -> float:
    return (frame.length_bits + INTERFRAME_BITS) * 1e9 / (frame.period_ns * bitrate)
