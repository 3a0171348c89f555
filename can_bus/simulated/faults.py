"""Faults of a simulated bus: by exact schedule or seeded probability, per frame and per node."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal, get_args

import can

from can_bus.errors import CanBusError
from can_bus.simulated.controller import NS_PER_S, Controller
from can_bus.simulated.queues import Pending
from can_bus.strikes import Strikes, check_chance

BusFaultKind = Literal[
    "loss", "corruption", "delay", "jitter", "duplication", "reordering", "babbling", "silence"
]
BUS_FAULT_KINDS: Final[tuple[BusFaultKind, ...]] = get_args(BusFaultKind)

_LONGEST_PLACE: Final = 512


@dataclass(frozen=True, kw_only=True)
class BusFault:
    """One fault of a simulated bus.

    Attributes:
        kind: `loss`: a frame that was sent well is not taken in by the `receivers`;
            `corruption`: the `receivers` read these `bits` of it inverted, with all that follows;
            `delay`, `jitter`: it reaches the transmit queue later, by `delay_s` or by a time drawn
            evenly from 0 to `delay_s`; `duplication`: it is queued twice; `reordering`: it is
            queued after the next frame of its identifier; `babbling`: `node` sends `data` under
            `arbitration_id` without end, `delay_s` after each; `silence`: `node` neither sends nor
            acknowledges nor receives.
        node: the sender it strikes; None strikes all. `babbling` and `silence` need it.
        arbitration_id: the identifier it strikes; None strikes all.
        receivers: for `loss` and `corruption`: who is struck; None: everyone, for `corruption`
            the sender too.
        start_s, stop_s: window of simulated time, stop exclusive; None never stops.
        turns: which of the frames that it could strike, 0 the first; None: all. What is counted is
            attempts to send for `corruption`, receptions for `loss`, frames queued for the rest.
        count: how many it strikes at most; None means no limit.
        probability: with which it strikes each.
        bits: for `corruption`: places on the wire, 0 is the start of frame, stuff bits count.
        delay_s, data, is_extended: see above; of `babbling`, an identifier of 29 bits.

    Raises CanBusError for a fault that makes no sense.
    """

    kind: BusFaultKind
    node: str | None = None
    arbitration_id: int | None = None
    receivers: tuple[str, ...] | None = None
    start_s: float = 0.0
    stop_s: float | None = None
    turns: tuple[int, ...] | None = None
    count: int | None = None
    probability: float = 1.0
    bits: tuple[int, ...] = ()
    delay_s: float = 0.0
    data: bytes = b""
    is_extended: bool = False

    def __post_init__(self) -> None:
        """Check what belongs together."""
        kind = self.kind
        if kind not in BUS_FAULT_KINDS:
            raise CanBusError(f"no bus fault {kind!r}: there are {', '.join(BUS_FAULT_KINDS)}")
        what = f"bus fault {kind!r}"
        if kind in ("babbling", "silence") and self.node is None:
            raise CanBusError(f"{what} needs the name of a node")
        if kind == "babbling" and self.arbitration_id is None:
            raise CanBusError(f"{what} needs an arbitration_id")
        if kind in ("delay", "jitter") and not 0.0 < self.delay_s < float("inf"):
            raise CanBusError(f"{what}: delay_s = {self.delay_s}: expected more than 0")
        if kind == "babbling" and not 0.0 <= self.delay_s < float("inf"):
            raise CanBusError(f"{what}: delay_s = {self.delay_s}: expected 0 or more")
        if self.receivers is not None and kind not in ("loss", "corruption"):
            raise CanBusError(f"{what}: receivers: it strikes a frame before anyone receives it")
        if kind == "corruption" and not self.bits:
            raise CanBusError(f"{what} needs bits: places on the wire, 0 is the start of frame")
        if any(not 0 <= place < _LONGEST_PLACE for place in self.bits):
            raise CanBusError(f"{what}: bits = {self.bits}: expected 0 to {_LONGEST_PLACE - 1}")
        if not 0.0 <= self.start_s < float("inf"):
            raise CanBusError(f"{what}: start_s = {self.start_s}: expected 0 or more")
        check_chance(what, self.probability, self.count)


class ActiveFault:
    """A fault that is on, with what it has struck so far.

    Attributes:
        struck: how often it has struck.
        is_on: it has not been removed.
        held: frames that wait for their successor, with their senders.
    """

    def __init__(self, fault: BusFault, stream: random.Random) -> None:
        """Start with no frame seen."""
        self.fault = fault
        self.struck = 0
        self.is_on = True
        self.held: list[tuple[Controller, Pending]] = []
        self._strikes = Strikes(
            start=self.start_ns,
            stop=self.stop_ns,
            count=fault.count,
            probability=fault.probability,
            turns=fault.turns,
            stream=stream,
        )

    @property
    def start_ns(self) -> int:
        """When its window opens."""
        return round(self.fault.start_s * NS_PER_S)

    @property
    def stop_ns(self) -> int | None:
        """When it closes; None: never."""
        stop_s = self.fault.stop_s
        return None if stop_s is None else round(stop_s * NS_PER_S)

    def release(self, sender: Controller, follower: Pending) -> list[Pending]:
        """Return the frames of this sender and identifier that go after this one."""
        key = follower.key
        due = [p for one, p in self.held if one is sender and p.key == key]
        self.held = [(one, p) for one, p in self.held if p not in due]
        return due

    def is_open(self, now_ns: int) -> bool:
        """Tell whether its window is open."""
        return self._strikes.is_open(now_ns)

    def concerns(self, node: str, message: can.Message) -> bool:
        """Tell whether it could strike a frame of this sender."""
        fault = self.fault
        return (fault.node is None or fault.node == node) and (
            fault.arbitration_id is None or fault.arbitration_id == message.arbitration_id
        )

    def strike(self, now_ns: int) -> bool:
        """Decide about the next frame that it could strike."""
        strikes = self._strikes.strike(now_ns)
        self.struck += strikes
        return strikes

    def draw_delay_ns(self) -> int:
        """Return the delay of a frame: the fault's own, or a share of it."""
        delay_ns = self.fault.delay_s * NS_PER_S
        if self.fault.kind == "jitter":
            delay_ns *= self._strikes.random.random()
        return round(delay_ns)


class FaultPlan:
    """All faults of a channel that are on, by the place where they act."""

    def __init__(self) -> None:
        """Start with none."""
        self.queueing: list[ActiveFault] = []
        self.corruption: list[ActiveFault] = []
        self.loss: list[ActiveFault] = []
        self.silence: list[ActiveFault] = []
        self.is_empty = True
        self._added = 0

    def add(self, fault: BusFault, seed: int) -> ActiveFault:
        """Switch a fault on; each draws from a stream of its own, by seed and order."""
        active = ActiveFault(fault, random.Random(f"{seed}/bus/{self._added}"))
        self._added += 1
        places = self._places(fault.kind)
        if places is not None:
            places.append(active)
            self.is_empty = False
        return active

    def remove(self, active: ActiveFault) -> None:
        """Switch a fault off; may be called twice. One that holds frames stays until they go."""
        active.is_on = False
        places = self._places(active.fault.kind)
        if places is not None and active in places and not active.held:
            places.remove(active)
        self._look_again()

    def let_go(self) -> None:
        """Forget the faults that were switched off and have now released what they held."""
        self.queueing = [one for one in self.queueing if one.is_on or one.held]
        self._look_again()

    def _look_again(self) -> None:
        self.is_empty = not (self.queueing or self.corruption or self.loss or self.silence)

    def is_silent(self, node: str, now_ns: int) -> bool:
        """Tell whether a node is off the bus."""
        return any(one.fault.node == node and one.is_open(now_ns) for one in self.silence)

    def inverted(
        self, node: str, message: can.Message, stations: Iterable[str], now_ns: int
    ) -> dict[int, list[int]]:
        """Return, by place on the wire, the numbers of the stations that read it inverted."""
        found: dict[int, list[int]] = {}
        names = tuple(stations)
        for active in self.corruption:
            if active.concerns(node, message) and active.strike(now_ns):
                struck = active.fault.receivers
                who = [n for n, name in enumerate(names) if struck is None or name in struck]
                for place in active.fault.bits:
                    for number in who:
                        _toggle(found.setdefault(place, []), number)
        return found

    def loses(self, node: str, receiver: str, message: can.Message, now_ns: int) -> bool:
        """Decide whether a receiver misses a frame."""
        for active in self.loss:
            struck = active.fault.receivers
            if struck is not None and receiver not in struck:
                continue
            if active.concerns(node, message) and active.strike(now_ns):
                return True
        return False

    def _places(self, kind: BusFaultKind) -> list[ActiveFault] | None:
        if kind == "corruption":
            return self.corruption
        if kind == "loss":
            return self.loss
        if kind == "silence":
            return self.silence
        return None if kind == "babbling" else self.queueing


def _toggle(numbers: list[int], number: int) -> None:
    """Two faults that invert the same bit leave it as it was."""
    if number in numbers:
        numbers.remove(number)
    else:
        numbers.append(number)
