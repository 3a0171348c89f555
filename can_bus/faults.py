"""Faults on the way to a node: frames dropped, delayed, corrupted, duplicated; nodes silenced."""

from __future__ import annotations

import random
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Final, Literal, get_args

import can

from can_bus.database import Database, identifier_key
from can_bus.errors import CanBusError
from can_bus.frames import MICROSECONDS_PER_S
from can_bus.strikes import Strikes, check_chance

FaultKind = Literal["drop", "delay", "corrupt", "duplicate", "silence"]
FAULT_KINDS: Final[tuple[FaultKind, ...]] = get_args(FaultKind)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One fault.

    Attributes:
        kind: `drop` loses a frame, `delay` holds it back, `corrupt` inverts a bit of its data,
            `duplicate` delivers it twice, `silence` loses everything that a node sends.
        message: name of the message it strikes; None strikes all (of `node`).
        node: name of the sender it strikes; None strikes all. `silence` needs it.
        start_us, stop_us: window of simulated time, stop exclusive; None never stops.
        count: how many frames it strikes at most; None means no limit.
        probability: with which it strikes each frame in the window.
        delay_us: for `delay`: the frame comes out with the first transfer at least so much later.
        bit: for `corrupt`: which data bit (0 is the least significant of byte 0); None draws one.
    """

    kind: FaultKind
    message: str | None = None
    node: str | None = None
    start_us: int = 0
    stop_us: int | None = None
    count: int | None = None
    probability: float = 1.0
    delay_us: int = 0
    bit: int | None = None

    def __post_init__(self) -> None:
        """Raise CanBusError for a fault that makes no sense."""
        if self.kind not in FAULT_KINDS:
            raise CanBusError(f"no fault {self.kind!r}: there are {', '.join(FAULT_KINDS)}")
        if self.kind == "silence" and self.node is None:
            raise CanBusError("fault 'silence' needs the name of a node")
        if self.kind == "delay" and self.delay_us <= 0:
            raise CanBusError(f"fault 'delay': delay_us = {self.delay_us}: expected more than 0")
        check_chance("fault", self.probability, self.count)
        if self.bit is not None and self.bit < 0:
            raise CanBusError(f"fault 'corrupt': bit = {self.bit}: expected 0 or more")


class _ActiveFault:
    """A fault with the identifiers it strikes and its own random stream."""

    __slots__ = ("_strikes", "fault", "keys", "random")

    def __init__(self, fault: Fault, keys: frozenset[int] | None, stream: random.Random) -> None:
        self.fault = fault
        self.keys = keys
        self.random = stream
        self._strikes = Strikes(
            start=fault.start_us,
            stop=fault.stop_us,
            count=fault.count,
            probability=fault.probability,
            stream=stream,
        )

    def strikes(self, now_us: int, message: can.Message) -> bool:
        """Decide about one frame; draws only for frames that the fault could strike."""
        if self.keys is not None:
            key = identifier_key(message.arbitration_id, message.is_extended_id)
            if key not in self.keys:
                return False
        return self._strikes.strike(now_us)


class FaultInjector:
    """Carries frames from one side to the other and applies faults on the way.

    Deterministic: the same seed, faults and frames give the same result. Each fault draws from its
    own stream, so adding one does not shift another. Faults apply in the order they were added.
    """

    def __init__(self, database: Database, seed: int = 0) -> None:
        """Start without faults; `struck` counts, by kind, the frames that faults have struck."""
        self.struck = dict.fromkeys(FAULT_KINDS, 0)
        self._database = database
        self._seed = seed
        self._added = 0
        self._active: list[_ActiveFault] = []
        self._held: list[tuple[int, int, can.Message]] = []
        self._held_count = 0

    def add(self, fault: Fault) -> None:
        """Switch a fault on. Raises CanBusError for an unknown message or node."""
        keys: set[int] | None = None
        if fault.message is not None:
            spec = self._database.message(fault.message)
            keys = {identifier_key(spec.frame_id, spec.is_extended)}
        if fault.node is not None:
            sent = self._database.sent_by(fault.node)
            of_node = {identifier_key(spec.frame_id, spec.is_extended) for spec in sent}
            keys = of_node if keys is None else keys & of_node
        stream = random.Random(f"{self._seed}/{self._added}")
        self._added += 1
        self._active.append(_ActiveFault(fault, None if keys is None else frozenset(keys), stream))

    def remove(self, fault: Fault) -> None:
        """Switch this one fault off; frames it holds back still come out when they are due."""
        self._active = [active for active in self._active if active.fault is not fault]

    def clear(self) -> None:
        """Switch all faults off; frames held back still come out when they are due."""
        self._active.clear()

    def transfer(self, now_us: int, frames: Sequence[can.Message]) -> list[can.Message]:
        """Return the frames to deliver now: first those held back that are due, then `frames`.

        A frame held back is stamped with the time of its delivery. The frames given are not
        changed: what differs is a copy.
        """
        if not self._active and not self._held:
            return list(frames)
        delivered = self._release(now_us)
        for frame in frames:
            delivered.extend(self._pass(now_us, frame))
        return delivered

    def _release(self, now_us: int) -> list[can.Message]:
        due = sorted(entry[:2] for entry in self._held if entry[0] <= now_us)
        by_order = {entry[:2]: entry[2] for entry in self._held}
        self._held = [entry for entry in self._held if entry[0] > now_us]
        released = [by_order[order] for order in due]
        for message in released:
            message.timestamp = now_us / MICROSECONDS_PER_S
        return released

    def _pass(self, now_us: int, frame: can.Message) -> list[can.Message]:
        copies = [frame]
        for active in self._active:
            if not active.strikes(now_us, frame):
                continue
            fault = active.fault
            self.struck[fault.kind] += 1
            if fault.kind in ("drop", "silence"):
                return []
            if fault.kind == "delay":
                for message in copies:
                    held = (now_us + fault.delay_us, self._held_count, deepcopy(message))
                    self._held.append(held)
                    self._held_count += 1
                return []
            if fault.kind == "duplicate":
                copies.append(deepcopy(copies[-1]))
            elif frame.data:
                copies = [_corrupted(message, fault.bit, active.random) for message in copies]
        return copies


def _corrupted(message: can.Message, bit: int | None, stream: random.Random) -> can.Message:
    twin: can.Message = deepcopy(message)
    bits = 8 * len(twin.data)
    position = stream.randrange(bits) if bit is None else bit % bits
    twin.data[position // 8] ^= 1 << position % 8
    return twin
