"""Which stretches of a log no fit may see, so that the shrink of the gap is proved on them.

Chosen from the manoeuvres and from where effects act: blocks of at least 10 s, together about a
quarter of the log, such that each kind of manoeuvre and each window in which an effect acts lies on
both sides. The fit loses 1 s more at each border.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.gap.manoeuvres import KINDS, REST, Kinds
from gap_diagnosis.recording import Floats

BLOCK_S: Final = 10.0
CUT_S: Final = 1.0
SHARE: Final = 0.25
_SHORTEST_LOG_S: Final = 2.5 * BLOCK_S
_LEAST_MOVING_S: Final = 8.0
_MOST_SLOTS: Final = 48
_WORTH_S: Final = 2.0  # a kind shorter than this in the whole log cannot be halved by blocks
_PRESENT_S: Final = 0.5
_OFFSETS: Final = 10

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class HoldOut:
    """Two sides of a log.

    Attributes:
        fit: bool[n], ticks that a fit may use.
        held_out: bool[n], ticks that it never sees; false everywhere where no hold-out is possible.
        windows: [start_s, stop_s] of each held-out block.
        one_sided: kinds of manoeuvre (of at least 2 s) that lie on one side only.
        unmet: of the windows in which effects act, those whose motion is not held out.
        why_not: one sentence where no hold-out is possible, else None.
    """

    fit: Mask
    held_out: Mask
    windows: tuple[tuple[float, float], ...]
    one_sided: tuple[str, ...] = ()
    unmet: tuple[tuple[float, float], ...] = ()
    why_not: str | None = None


def hold_out(t_s: Floats, kinds: Kinds, acting_s: Sequence[tuple[float, float]] = ()) -> HoldOut:
    """Return the sides of a log whose ticks at t_s, float64[n], are of these kinds, int8[n];
    *acting_s* are the windows [start_s, stop_s] in which effects act.

    The same log gives the same sides. Between 25 and 40 s the one block of 10 s is more than a
    quarter; a shorter log, or one that moves for less than 8 s, has none.
    """
    count = len(t_s)
    duration_s = float(t_s[-1] - t_s[0]) if count else 0.0
    weight_s = np.diff(t_s, append=t_s[-1:]) if count else np.zeros(0)
    moving_s = float(weight_s[kinds != REST].sum())
    if duration_s < _SHORTEST_LOG_S:
        return _none(
            count,
            f"nothing is held out: the log lasts {duration_s:.3g} s, and a held-out stretch of "
            f"{BLOCK_S:g} s needs a log of at least {_SHORTEST_LOG_S:g} s",
        )
    if moving_s < _LEAST_MOVING_S:
        return _none(
            count,
            f"nothing is held out: the robot moves for only {moving_s:.3g} s, and both sides need "
            f"motion (at least {_LEAST_MOVING_S:g} s in all)",
        )
    moving = kinds != REST
    acts = [moving & (t_s >= start_s) & (t_s <= stop_s) for start_s, stop_s in acting_s]
    sorts = np.column_stack([*(kinds == kind for kind in range(len(KINDS))), *acts])
    blocks = _best_blocks(t_s, sorts, weight_s, duration_s)
    held, near = np.zeros(count, np.bool_), np.zeros(count, np.bool_)
    for start_s, stop_s in blocks:
        held |= (t_s >= start_s) & (t_s <= stop_s)
        near |= (t_s >= start_s - CUT_S) & (t_s <= stop_s + CUT_S)
    fit = ~near
    sides = [float(weight_s[side & moving].sum()) for side in (fit, held)]
    if min(sides) < _WORTH_S:
        return _none(
            count,
            "nothing is held out: all motion lies so close together that no stretch of "
            f"{BLOCK_S:g} s leaves motion on both sides",
        )
    one_sided = tuple(
        KINDS[kind]
        for kind in range(len(KINDS))
        if weight_s[kinds == kind].sum() >= _WORTH_S
        and min(weight_s[side & (kinds == kind)].sum() for side in (fit, held)) < _PRESENT_S
    )
    unmet = tuple(
        window
        for window, act in zip(acting_s, acts, strict=True)
        if weight_s[held & act].sum() < _PRESENT_S
    )
    return HoldOut(fit, held, tuple(blocks), one_sided, unmet)


def _none(count: int, why: str) -> HoldOut:
    return HoldOut(np.ones(count, np.bool_), np.zeros(count, np.bool_), (), why_not=why)


def _best_blocks(
    t_s: Floats, sorts: Mask, weight_s: Floats, duration_s: float
) -> list[tuple[float, float]]:
    """Try several grids of slots; in each, swap slots until nothing gets better.

    *sorts*, bool[n, s], are the kinds of the ticks and then the windows that they lie in.
    """
    length_s = max(BLOCK_S, duration_s / _MOST_SLOTS)
    chosen_count = max(1, round(SHARE * duration_s / length_s))
    slots = int(duration_s / length_s + 1e-9)
    spare_s = duration_s - slots * length_s
    grids = [(spare_s * k / _OFFSETS, slots) for k in range(_OFFSETS + 1)]
    grids += [
        (spare_s + length_s * k / _OFFSETS, slots - 1) for k in range(1, _OFFSETS) if slots > 1
    ]
    # Time of each sort up to each tick: a block's content is a difference of two rows.
    times_s = sorts * weight_s[:, np.newaxis]
    until = np.vstack([np.zeros(sorts.shape[1]), np.cumsum(times_s, axis=0)])

    def content(edges_s: Floats) -> Floats:
        return np.asarray(until[np.searchsorted(t_s, edges_s)])

    total = until[-1]
    found: list[tuple[float, list[tuple[float, float]]]] = []
    for offset_s, slot_count in grids:
        if slot_count < chosen_count:
            continue
        starts = t_s[0] + offset_s + length_s * np.arange(slot_count)
        held = content(starts + length_s) - content(starts)
        lost = content(starts + length_s + CUT_S) - content(starts - CUT_S)
        chosen, cost = _swapped(held, lost, total, chosen_count)
        blocks = [(float(starts[k]), float(starts[k] + length_s)) for k in sorted(chosen)]
        found.append((round(cost, 9), blocks))
    return min(found)[1]


def _swapped(
    held: Floats, lost: Floats, total: Floats, chosen_count: int
) -> tuple[list[int], float]:
    slots = len(held)
    chosen = [int((k + 0.5) * slots / chosen_count) for k in range(chosen_count)]
    cost = float(_cost(held[chosen].sum(0), lost[chosen].sum(0), total))
    while True:
        free = np.setdiff1d(np.arange(slots), chosen)
        best = (cost, -1, -1)
        for place in range(chosen_count):
            rest = chosen[:place] + chosen[place + 1 :]
            costs = _cost(held[rest].sum(0) + held[free], lost[rest].sum(0) + lost[free], total)
            if len(free) and costs.min() < best[0] - 1e-9:
                best = float(costs.min()), place, int(free[np.argmin(costs)])
        if best[1] < 0:
            return chosen, cost
        cost = best[0]
        chosen[best[1]] = best[2]


def _cost(held: Floats, lost: Floats, total: Floats) -> Floats:
    """Return how badly held-out times per sort, float64[..., s], share out the log's."""
    worth = total >= _WORTH_S
    share = held / np.maximum(total, 1e-9)
    uneven = np.where(worth, (share - SHARE) ** 2, 0.0).sum(-1)
    missing = worth & ((held < _PRESENT_S) | (total - lost < _PRESENT_S))
    unseen = worth & (total - lost < _PRESENT_S)  # worse: the fit would never have met it
    moves = slice(REST + 1, len(KINDS))
    moving = held[..., moves].sum(-1) / max(float(total[moves].sum()), 1e-9)
    return np.asarray(
        uneven + 2.0 * (moving - SHARE) ** 2 + 10.0 * missing.sum(-1) + 5.0 * unseen.sum(-1)
    )
