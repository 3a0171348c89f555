"""What a real bus does to frames on their way: late, lost, doubled, swapped, stale, not at all.

Each message draws from a stream of its own (Philox, keyed by seed and identifier), five numbers a
frame, so that a frame's fate depends on nothing but the seed, its message and how many frames of it
went before: frame by frame in a loop and for a whole run at once it is the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Final

import can
import numpy as np
from numpy.typing import NDArray

from can_bus.database import Database, identifier_key
from can_bus.errors import CanBusError
from can_bus.frames import MICROSECONDS_PER_S
from can_bus.specs import protect

Ints = NDArray[np.int64]

SENSORS: Final = "sensors"
"""Stands for every message that carries a sensor, where a message's name is expected."""

_DRAWS: Final = 5
_BLOCK: Final = 256
_WORD: Final = 2**64 - 1


@dataclass(frozen=True, kw_only=True)
class Disturbances:
    """Everything that happens on the way; all neutral by default. `…_frame` names a message.

    Attributes:
        latency_s: arrival later than sampling by this constant.
        jitter_s: standard deviation of the delay about its mean (exponential, so never early).
        loss_probability, loss_burst: share of frames lost, and their mean number in a row.
        duplication_probability: a frame comes twice.
        reordering_probability: a frame comes after its successor.
        stale_cycles, stale_probability: the payload is repeated for so many cycles, with this
            probability in each cycle; the counter goes on.
        poll_delay_s, poll_period_s: a frame is seen when it is polled after this delay.
        gap_start_s, gap_stop_s: no frame at all.
    """

    latency_frame: str = SENSORS
    latency_s: float = 0.0
    jitter_frame: str = SENSORS
    jitter_s: float = 0.0
    loss_frame: str = SENSORS
    loss_probability: float = 0.0
    loss_burst: float = 1.0
    duplication_frame: str = SENSORS
    duplication_probability: float = 0.0
    reordering_frame: str = SENSORS
    reordering_probability: float = 0.0
    stale_frame: str = SENSORS
    stale_cycles: int = 0
    stale_probability: float = 0.0
    poll_frame: str = SENSORS
    poll_delay_s: float = 0.0
    poll_period_s: float = 0.0
    gap_start_s: float = math.inf
    gap_stop_s: float = math.inf

    def named_frames(self) -> set[str]:
        """Return the messages that are named, SENSORS left out."""
        names = {
            self.latency_frame,
            self.jitter_frame,
            self.loss_frame,
            self.duplication_frame,
            self.reordering_frame,
            self.stale_frame,
            self.poll_frame,
        }
        return names - {SENSORS}

    def require_messages(self, database: Database) -> None:
        """Raise CanBusError for a message that is named and that the database does not have."""
        for name in sorted(self.named_frames() - database.messages.keys()):
            known = ", ".join(database.messages)
            raise CanBusError(
                f"frame = {name}: {database.path.name} has no such message: expected "
                f"{SENSORS} or one of {known}"
            )

    def touches(self, message: str, *, is_sensor: bool) -> bool:
        """Tell whether a frame of this message can be touched."""
        own = (message, SENSORS) if is_sensor else (message,)
        return self.gap_start_s < self.gap_stop_s or any(
            level != 0.0 and frame in own
            for frame, level in (
                (self.latency_frame, self.latency_s),
                (self.jitter_frame, self.jitter_s),
                (self.loss_frame, self.loss_probability),
                (self.duplication_frame, self.duplication_probability),
                (self.reordering_frame, self.reordering_probability),
                (self.stale_frame, self.stale_cycles * self.stale_probability),
                (self.poll_frame, self.poll_delay_s + self.poll_period_s),
            )
        )


DisturbanceSchedule = tuple[tuple[float, Disturbances], ...]
"""(from_s, disturbances) in ascending order; the first holds from the start."""


@dataclass(frozen=True)
class Arrivals:
    """The frames of one message as they arrive, in their order; each int64[arrived].

    Attributes:
        frame: which of the frames sent it is.
        payload: whose payload it carries: itself, or an older one where the producer was stale.
        time_us: when it arrives.
    """

    frame: Ints
    payload: Ints
    time_us: Ints


class _Stream:
    """The fates of the frames of one message, one after another."""

    def __init__(
        self, schedule: DisturbanceSchedule, name: str, key: int, seed: int, *, is_sensor: bool
    ) -> None:
        self._schedule = schedule
        self._own = (name, SENSORS) if is_sensor else (name,)
        words = np.array([seed & _WORD, 0x62757300_00000000 + key], dtype=np.uint64)
        high = np.array([0, 0, seed >> 64 & _WORD, 0], dtype=np.uint64)
        self._generator = np.random.Generator(np.random.Philox(key=words, counter=high))
        self._draws: list[list[float]] = []
        self.number = -1
        self._in_burst = False
        self._stale_left = 0
        self._payload = -1
        self._last_us = 0
        self._held: tuple[int, int] | None = None

    @property
    def held(self) -> int:
        """The frame that waits for its successor; the last one sent if none does."""
        return self.number if self._held is None else self._held[0]

    def pass_frame(self, sent_us: int) -> list[tuple[int, int, int]]:
        """Return (frame, payload, arrival in µs) of all that is on its way because of this one."""
        self.number += 1
        if not self._draws:
            self._draws = self._generator.random((_BLOCK, _DRAWS)).tolist()[::-1]
        loss, twice, swap, stale, late = self._draws.pop()
        sent_s = sent_us / MICROSECONDS_PER_S
        now = next(d for start_s, d in reversed(self._schedule) if sent_s >= start_s)
        self._age(now, stale)
        if self._is_lost(now, loss) or now.gap_start_s <= sent_s < now.gap_stop_s:
            return []
        arrival_us = self._arrival_us(now, sent_us, late)
        this = (self.number, self._payload)
        if (
            self._held is None
            and now.reordering_frame in self._own
            and swap < now.reordering_probability
        ):
            self._held = this
            return []
        found = [(*this, arrival_us)]
        if now.duplication_frame in self._own and twice < now.duplication_probability:
            found.append((*this, arrival_us))
        if self._held is not None:
            found.append((*self._held, arrival_us))
            self._held = None
        return found

    def _age(self, now: Disturbances, draw: float) -> None:
        """Decide whose payload this frame carries."""
        begins = (
            now.stale_frame in self._own
            and now.stale_cycles > 0
            and draw < now.stale_probability
            and self._payload >= 0
        )
        if self._stale_left > 0:
            self._stale_left -= 1
        elif begins:
            self._stale_left = now.stale_cycles - 1
        else:
            self._payload = self.number

    def _is_lost(self, now: Disturbances, draw: float) -> bool:
        """Follow the losses: independent, or in bursts (Gilbert's two states)."""
        if now.loss_probability == 0.0 or now.loss_frame not in self._own:
            return False
        chance, burst = now.loss_probability, now.loss_burst
        if burst > 1.0 and chance < 1.0:
            begins = min(chance / (burst * (1.0 - chance)), 1.0)
            chance = 1.0 - 1.0 / burst if self._in_burst else begins
        self._in_burst = draw < chance
        return self._in_burst

    def _arrival_us(self, now: Disturbances, sent_us: int, draw: float) -> int:
        delay_us = 0.0
        if now.latency_frame in self._own:
            delay_us += now.latency_s * MICROSECONDS_PER_S
        if now.jitter_frame in self._own:
            delay_us -= now.jitter_s * MICROSECONDS_PER_S * math.log1p(-draw)
        arrival_us = sent_us + round(delay_us)
        if now.poll_frame in self._own:
            arrival_us += round(now.poll_delay_s * MICROSECONDS_PER_S)
            if now.poll_period_s > 0.0:
                period_us = max(round(now.poll_period_s * MICROSECONDS_PER_S), 1)
                arrival_us = -(-arrival_us // period_us) * period_us
        # Frames of one message do not overtake each other: the next waits for the last.
        self._last_us = max(arrival_us, self._last_us)
        return self._last_us


class _Direction:
    """Frames under way in one direction."""

    def __init__(self, traffic: Traffic) -> None:
        self._traffic = traffic
        self._streams: dict[int, _Stream | None] = {}
        self._payloads: dict[int, dict[int, can.Message]] = {}
        self._waiting: list[tuple[int, int, can.Message]] = []
        self._count = 0

    def transfer(self, now_us: int, frames: Sequence[can.Message]) -> list[can.Message]:
        for frame in frames:
            self._send(now_us, frame)
        waiting = sorted(self._waiting, key=lambda entry: entry[:2])
        due = [entry for entry in waiting if entry[0] <= now_us]
        self._waiting = waiting[len(due) :]
        return [frame for _, _, frame in due]

    def _send(self, now_us: int, frame: can.Message) -> None:
        key = identifier_key(frame.arbitration_id, frame.is_extended_id)
        if key not in self._streams:
            self._streams[key] = self._traffic.stream(frame.arbitration_id, frame.is_extended_id)
        stream = self._streams[key]
        if stream is None:
            self._wait(now_us, frame)
            return
        sent = self._payloads.setdefault(key, {})
        number = stream.number + 1
        sent[number] = frame
        for which, payload, arrival_us in stream.pass_frame(now_us):
            late = deepcopy(sent[which])
            if payload != which and payload in sent:
                self._traffic.repeat(late, sent[payload])
            late.timestamp = arrival_us / MICROSECONDS_PER_S
            self._wait(arrival_us, late)
        oldest = min(number - self._traffic.memory, stream.held)
        for old in [n for n in sent if n < oldest]:
            del sent[old]

    def _wait(self, arrival_us: int, frame: can.Message) -> None:
        self._waiting.append((arrival_us, self._count, frame))
        self._count += 1


class Traffic:
    """Carries frames to and from the ECU under disturbances that may change with time.

    Args:
        database: the messages.
        schedule: the disturbances over time.
        sensors: names of the messages that carry sensors, which `SENSORS` stands for.
        seed: of everything random here.

    Raises CanBusError for a message that the database does not have.
    """

    def __init__(
        self,
        database: Database,
        schedule: DisturbanceSchedule,
        sensors: Iterable[str],
        seed: int,
    ) -> None:
        self._database = database
        self._schedule = schedule
        self._sensors = frozenset(sensors)
        self._seed = seed
        for _, disturbances in schedule:
            disturbances.require_messages(database)
        self.memory = 2 + max(disturbances.stale_cycles for _, disturbances in schedule)
        self._to_ecu, self._from_ecu = _Direction(self), _Direction(self)

    def to_ecu(self, now_us: int, frames: Sequence[can.Message]) -> list[can.Message]:
        """Return what reaches the ECU's side until now, each stamped with its arrival."""
        return self._to_ecu.transfer(now_us, frames)

    def from_ecu(self, now_us: int, frames: Sequence[can.Message]) -> list[can.Message]:
        """Return what comes from the ECU until now."""
        return self._from_ecu.transfer(now_us, frames)

    def touches(self, message: str) -> bool:
        """Tell whether frames of this message can be touched at all."""
        is_sensor = message in self._sensors
        return any(d.touches(message, is_sensor=is_sensor) for _, d in self._schedule)

    def arrivals(self, message: str, sent_us: Ints) -> Arrivals:
        """Return the fate of a whole run's frames of one message, sent at these times."""
        spec = self._database.message(message)
        stream = self.stream(spec.frame_id, spec.is_extended)
        if stream is None:
            all_frames = np.arange(len(sent_us), dtype=np.int64)
            return Arrivals(all_frames, all_frames, sent_us)
        found = [entry for time_us in sent_us.tolist() for entry in stream.pass_frame(time_us)]
        columns = np.array(found, dtype=np.int64).reshape(-1, 3).T
        return Arrivals(*np.ascontiguousarray(columns))

    def stream(self, arbitration_id: int, is_extended: bool) -> _Stream | None:
        """Return a message's fates from its first frame on; None where nothing touches it."""
        spec = self._database.by_id(arbitration_id, is_extended)
        if spec is None or not self.touches(spec.name):
            return None
        key = identifier_key(arbitration_id, is_extended)
        is_sensor = spec.name in self._sensors
        return _Stream(self._schedule, spec.name, key, self._seed, is_sensor=is_sensor)

    def repeat(self, frame: can.Message, older: can.Message) -> None:
        """Give a frame the payload of an older one; its counter stays alive and its CRC right."""
        spec = self._database.by_id(frame.arbitration_id, frame.is_extended_id)
        if spec is None or not spec.is_protected:
            frame.data = bytearray(older.data)
            return
        counter = frame.data[1] & 0x0F
        frame.data = bytearray(older.data)
        protect(spec, frame.data, counter)
