"""Drives that wheels at rest make by trembling, about the heading where that moves x or y most.

Direction and rounding are steps: where the heading is next to the edge of one, a count forward may
be taken along another entry of the table than the same count back, or be rounded up where that is
rounded down. The kernel itself tells where: it turns by a count at a time and trembles in between.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_model import INVALID, KernelConfig, run_batch
from firmware_model.integers import SATURATE
from firmware_model.reach import is_given_back
from precision_study.ranges.envelope import Envelope
from precision_study.ranges.starts import by_wheels, zero_code
from precision_study.ranges.stretches import Drive, Stretch
from precision_study.ranges.swings import creep_counts

Pattern = tuple[tuple[int, int, bool], ...]

_HEADINGS: Final = 1 << 15
_WIDE: Final = 1 << 62
_REPEATS: Final = 4
_KEPT: Final = 2


def losses(config: KernelConfig, envelope: Envelope) -> Iterator[Drive]:
    """Yield drives on which a wheel at rest counts on: what goes back is lost with its frames."""
    ahead = envelope.trembling_ticks // 2
    if ahead > config.max_step_ticks or config.gap_limit_ticks + 2 > envelope.mission_ticks:
        return
    for sign in (1, -1):
        lost = ((0, 0, False),) * config.gap_limit_ticks
        pattern: Pattern = ((sign * ahead, sign * ahead, True), *lost, (0, 0, True))
        yield (_trembling(config, envelope.mission_ticks, pattern),)


def dithers(config: KernelConfig, envelope: Envelope) -> Iterator[Drive]:
    """Yield drives that turn to a heading and tremble there, the farthest of those tried first."""
    every = max(math.ceil(1 / envelope.rate), math.ceil(2 / envelope.turn_rate))
    most_turns = envelope.mission_ticks // (2 * every) + 1
    slowly = math.ceil(1 / envelope.rate)
    found: list[tuple[float, int, Pattern]] = []
    creep = creep_counts(config, 1, 0) if is_given_back(config) else 0
    if creep is None or 2 * creep > envelope.way_ticks:
        return
    start = by_wheels(config, creep * slowly, 1, 1, 1, slowly)
    for pattern in _patterns(min(envelope.trembling_ticks // 2, config.max_step_ticks)):
        gains = _gains(config, creep, most_turns, pattern)
        best = np.argsort(-gains, kind="stable")[:_KEPT]
        found += [(float(gains[one]), int(one), pattern) for one in best if gains[one] > 0]
    found.sort(key=lambda one: -one[0])
    for _, turns, pattern in found[: 2 * _KEPT]:
        turn = by_wheels(config, turns * every, -1, 1, 1, every)
        left = envelope.mission_ticks - start.ticks - turn.ticks
        if left > 0:
            last = _trembling(config, left, pattern)
            yield tuple(one for one in (start, turn, last) if one.ticks > 0)


def _trembling(config: KernelConfig, ticks: int, pattern: Pattern) -> Stretch:
    return replace(by_wheels(config, ticks, 0, 0), pattern=pattern)


def _patterns(most: int) -> Iterator[Pattern]:
    """Yield ways to tremble by so many counts of each wheel, back within four ticks."""
    for ahead in dict.fromkeys((1, most)):
        both, left, right, none = (ahead, ahead), (ahead, 0), (0, ahead), (0, 0)
        for places in (
            (both, none),
            (left, none),
            (right, none),
            (left, both, none),
            (right, both, none),
            (both, left, none),
            (both, right, none),
            (left, both, right, none),
            (right, both, left, none),
        ):
            yield tuple((*place, True) for place in places)


def _to_an_eighth(config: KernelConfig) -> int:
    """Return how many turns of a count each way go an eighth of a turn: x or y has seen it all."""
    eighth = 1 << (config.description.turn_step.frac_bits - 3)
    return -(-(eighth << config.wheel_turn_shift) // max(2 * config.tick_turn_q, 1))


def _gains(config: KernelConfig, creep: int, turns: int, pattern: Pattern) -> NDArray[np.float64]:
    """Return how far a pattern moves x or y in a tick at each heading, a count of turn apart.

    Before it the wheels have crept so far.
    """
    size = _REPEATS * len(pattern)
    headings = min(_HEADINGS, turns, _to_an_eighth(config))
    turn = np.repeat(np.arange(headings), size)  # the first tick at a heading turns to it
    ahead = np.tile(np.array([place[:2] for place in pattern], dtype=np.int64), (headings, 1))
    ahead = np.tile(ahead, (_REPEATS, 1))
    left, right = ahead[:, 0] - turn, ahead[:, 1] + turn
    before = np.arange(creep + 1)
    left, right = (np.concatenate([before, creep + one])[None] for one in (left, right))
    code = np.full_like(left, zero_code(config))
    invalid = np.full_like(left, INVALID)
    wide = replace(config, position_low_q=-_WIDE, position_high_q=_WIDE, position_overflow=SATURATE)
    runs = run_batch(wide, left, right, code, None, invalid, twin=False)
    assert runs.pose_q is not None
    # What a count of turn moves is left out: from the end of one pattern to that of the last.
    ends = runs.pose_q[0, creep:, :2].astype(np.float64)
    first, last = ends[len(pattern) :: size], ends[size::size]
    moved: NDArray[np.float64] = np.abs(last - first[: len(last)]).max(axis=1)
    return moved / (size - len(pattern))
