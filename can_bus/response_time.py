"""How long a frame can take at worst until it is through, from priorities, lengths and periods.

R. I. Davis, A. Burns, R. J. Bril, J. J. Lukkien, "Controller Area Network (CAN) schedulability
analysis: Refuted, revisited and revised", Real-Time Systems 35 (2007), 239-272. It holds for
priority-ordered transmit queues that are never full, and without errors on the bus.

Whole numbers throughout: one unit of time here is 1 ns divided by the bit rate, so that both a
nanosecond and a bit time are whole.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from fractions import Fraction
from typing import Final, NamedTuple

from can_bus.errors import CanBusError
from can_bus.timing import INTERFRAME_BITS

_NS_PER_S: Final = 1_000_000_000


class QueuedFrame(NamedTuple):
    """A frame that is queued again and again.

    Attributes:
        name: of the message.
        key: its arbitration field as a number; the smaller one wins.
        length_bits: on the wire, stuff bits included, intermission not.
        period_ns: the least time from one release to the next.
        jitter_ns: how much later than its release a frame is queued, at most.
    """

    name: str
    key: int
    length_bits: int
    period_ns: int
    jitter_ns: int = 0


class ResponseTime(NamedTuple):
    """The worst case of one frame.

    Attributes:
        frame: which.
        response_s: from release until the bus is free again after the frame, intermission
            included, as the paper counts; None where there is no bound (its own priority and all
            above it ask for the whole bus or more).
        end_of_frame_s: from release to the end of the frame, which is its stamp.
        instance: which instance of a busy period it is, 0 the first.
    """

    frame: QueuedFrame
    response_s: float | None
    end_of_frame_s: float | None
    instance: int


def response_times(
    frames: Sequence[QueuedFrame], bitrate: int, *, arbitration_bits: int = 1
) -> list[ResponseTime]:
    """Return the worst-case response time of each frame, most urgent first.

    Args:
        frames: all that is on the bus; no two with the same key.
        bitrate: in bit/s.
        arbitration_bits: a frame still takes part if it is queued less than so many bit times
            after a start of frame (the paper: 1).

    Raises CanBusError for two frames of one key, or lengths, periods or a bit rate that are not
    positive.
    """
    if bitrate <= 0:
        raise CanBusError(f"bitrate = {bitrate}: expected more than 0 [bit/s]")
    for frame in frames:
        if frame.length_bits <= 0 or frame.period_ns <= 0 or frame.jitter_ns < 0:
            raise CanBusError(
                f"{frame.name}: length {frame.length_bits} bits, period {frame.period_ns} ns, "
                f"jitter {frame.jitter_ns} ns: expected positive numbers"
            )
    ordered = sorted(frames, key=lambda frame: frame.key)
    for first, second in itertools.pairwise(ordered):
        if first.key == second.key:
            raise CanBusError(f"{first.name} and {second.name} have the same identifier")
    return [
        _response(ordered, place, bitrate, arbitration_bits * _NS_PER_S)
        for place in range(len(ordered))
    ]


def utilisation(frames: Sequence[QueuedFrame], bitrate: int) -> Fraction:
    """Return the share of the bus that frames ask for, intermission included."""
    return sum(
        (Fraction(_cost(frame), frame.period_ns * bitrate) for frame in frames),
        Fraction(0),
    )


def _cost(frame: QueuedFrame) -> int:
    return (frame.length_bits + INTERFRAME_BITS) * _NS_PER_S


def _response(ordered: Sequence[QueuedFrame], place: int, bitrate: int, bit: int) -> ResponseTime:
    """Return one frame's worst case: equations 4 to 11 of the paper, in whole units."""
    frame, above = ordered[place], ordered[:place]
    if utilisation(ordered[: place + 1], bitrate) >= 1:
        return ResponseTime(frame, None, None, 0)
    cost, period, jitter = _cost(frame), frame.period_ns * bitrate, frame.jitter_ns * bitrate
    blocking = max((_cost(lower) for lower in ordered[place + 1 :]), default=0)
    rivals = [(_cost(f), f.period_ns * bitrate, f.jitter_ns * bitrate) for f in above]

    def settle(start: int, fixed: int, own: bool) -> int:
        """Return the fixed point of a busy period (own frames too) or of a queueing delay."""
        length = start
        while True:
            seen = length if own else length + bit
            longer = fixed + sum(-(-(seen + late) // every) * c for c, every, late in rivals)
            if own:
                longer += -(-(length + jitter) // period) * cost
            if longer <= length:
                return length
            length = longer

    busy = settle(cost, blocking, own=True)
    instances = -(-(busy + jitter) // period)
    worst, which, delay = 0, 0, blocking
    for number in range(instances):
        delay = settle(max(delay, blocking + number * cost), blocking + number * cost, own=False)
        response = jitter + delay - number * period + cost
        if response > worst:
            worst, which = response, number
    unit_s = 1.0 / (_NS_PER_S * bitrate)
    intermission = INTERFRAME_BITS * _NS_PER_S
    return ResponseTime(frame, worst * unit_s, (worst - intermission) * unit_s, which)
