"""How far an explanation closes the gap: before, after, the floor that noise leaves, intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.gap.metrics import WindowErrors
from gap_diagnosis.recording import Floats
from gap_diagnosis.result_parts import CLOSABLE, Gap, Metric

UNITS: Final[Mapping[str, str]] = {
    "odometry_position_m": "m",
    "odometry_heading_rad": "rad",
    "drive_position_m": "m",
    "firmware_position_m": "m",
    "turn_difference_rad": "rad",
    "timing_s": "s",
}
METRICS_OF_STAGE: Final[Mapping[str, tuple[str, ...]]] = {
    "actuation": ("drive_position_m",),
    "wheel": ("odometry_position_m", "odometry_heading_rad", "turn_difference_rad"),
    "encoder": ("odometry_position_m", "odometry_heading_rad", "turn_difference_rad"),
    "gyro": ("odometry_position_m", "odometry_heading_rad", "turn_difference_rad"),
    "bus": ("timing_s", "odometry_position_m"),
    "firmware": ("firmware_position_m",),
    "reference": ("odometry_position_m", "odometry_heading_rad"),
    "setup": ("odometry_position_m", "odometry_heading_rad", "turn_difference_rad"),
}
"""Per stage, the metrics in which it can act, the most telling first."""

_MANY_DRAWS: Final = 0.5
"""Of drawn windows so many must have a gap to close for an interval of it: a judgement."""
_MOVED: Final = 0.5
"""An effect that moves a path by less of its floor does not act in it, if it acts in another;"""
_OF_THE_GAP: Final = 0.2
"""nor one that moves it by a smaller part of its gap than of another's times this: a judgement."""
_CLEAR: Final = 3.0
"""So many floors are no doubt a gap."""
_RESAMPLES: Final = 2000
_SEED: Final = 20_200


@dataclass(frozen=True)
class Compared:
    """One metric measured three times on the same windows.

    Attributes:
        before: as described.
        after: with the winning effects on; None where there are none.
        floor: float64[draws, w], mean squares that noise alone leaves; None where unknown.
        after_draws: float64[draws, w], mean squares with values drawn from the posterior of the
            effects' parameters, for the interval; None leaves their spread out.
        extents: float64[w, 2], way [m] and duration [s] of each window; None where unknown.
    """

    before: WindowErrors
    after: WindowErrors | None = None
    floor: Floats | None = None
    after_draws: Floats | None = None
    extents: Floats | None = None


def closed_share(before: float, after: float, floor: float) -> float | None:
    """Return (before − after)/(before − floor), never clipped; None when before < 1.2 floor."""
    if before < CLOSABLE * floor or before <= floor:
        return None
    return (before - after) / (before - floor)


def metric_of(name: str, compared: Compared) -> Metric | None:
    """Return one metric with the 95 % interval of what was closed; None without a window.

    The interval comes from windows drawn anew, with after's parameters drawn along with them; of a
    single window from those parameters, and from what noise may leave of it.
    """
    before = compared.before.rms
    if before is None:
        return None
    after = None if compared.after is None else compared.after.rms
    floor = None
    if compared.floor is not None and compared.floor.size:
        floor = math.sqrt(float(compared.floor.mean()))
    closed = interval = None
    if after is not None and floor is not None:
        closed = closed_share(before, after, floor)
        if closed is not None:
            interval = _closed_interval(compared, closed)
    window_m = window_s = None
    if compared.extents is not None:
        window_m, window_s = (float(mean) for mean in compared.extents.mean(0))
    return Metric(
        unit=UNITS[name],
        before=before,
        after=after,
        floor=floor,
        closed=closed,
        ci95=interval,
        windows=len(compared.before.mean_square),
        window_m=window_m or None,  # over windows at rest no error grows with the way
        window_s=window_s,
    )


def metrics_of(compared: Mapping[str, Compared]) -> dict[str, Metric]:
    """Return each metric that has a window."""
    found = {name: metric_of(name, one) for name, one in compared.items()}
    return {name: metric for name, metric in found.items() if metric is not None}


def pooled(parts: Sequence[Compared]) -> Compared:
    """Return one metric over the windows of several logs, each numbered as in its own.

    What not every log with a window has, none has. Logs' noise is independent: their draws are
    joined as they come, those of a log with fewer again from the first on.
    """
    parts = [one for one in parts if len(one.before.mean_square)] or parts[:1]
    if len(parts) == 1:
        return parts[0]
    afters = [one.after for one in parts if one.after is not None]
    floors = [one.floor for one in parts if one.floor is not None]
    drawn = [one.after_draws for one in parts if one.after_draws is not None]
    extents = [one.extents for one in parts if one.extents is not None]
    everywhere = len(parts)
    return Compared(
        before=_one_after_another([one.before for one in parts]),
        after=_one_after_another(afters) if len(afters) == everywhere else None,
        floor=_side_by_side(floors) if len(floors) == everywhere else None,
        after_draws=_side_by_side(drawn) if len(drawn) == everywhere else None,
        extents=np.concatenate(extents) if len(extents) == everywhere else None,
    )


def _one_after_another(parts: Sequence[WindowErrors]) -> WindowErrors:
    return WindowErrors(
        np.concatenate([one.window for one in parts]),
        np.concatenate([one.mean_square for one in parts]),
        np.concatenate([one.end for one in parts]),
    )


def _side_by_side(draws: Sequence[Floats]) -> Floats:
    """Return draws float64[d, w] of several logs' windows, as many as the log with the most has."""
    most = max(len(one) for one in draws)
    return np.hstack([one[np.arange(most) % len(one)] for one in draws])


def moved_by(compared: Compared) -> float:
    """Return how far the effects move the ends of windows, RMS, in floors of noise; whether that is
    towards what was measured does not matter. 0 without effects."""
    after, floor = compared.after, compared.floor
    if after is None or floor is None or not floor.size or not len(after.end):
        return 0.0
    moved = math.sqrt(float(np.mean(np.sum((after.end - compared.before.end) ** 2, axis=1))))
    return moved / max(math.sqrt(float(floor.mean())), 1e-12)


def gap_of(
    compared: Mapping[str, Compared], stage: str, held_out: Literal["log", "stretches"]
) -> Gap | None:
    """Return the gap in the metric in which *stage* acts; None where none of these was measured.

    What the effects hardly move is not theirs (of an odometry by its gyro a wider axle moves
    nothing, and wheels that differ by 1 % next to nothing), as long as they move another. Of
    several the first that stands clearly above its floor; without any the one that stands highest,
    if there is a gap to close (before at least 1.2 floor), or else the first.
    """
    metrics = metrics_of(compared)
    able = [name for name in METRICS_OF_STAGE.get(stage, tuple(UNITS)) if name in metrics]
    if not able:
        return None
    moved = {name: moved_by(compared[name]) for name in able}
    able = [name for name in able if moved[name] >= min(_MOVED, max(moved.values()))]
    of_gap = {name: _part(moved[name], _above_floor(metrics[name])) for name in able}
    able = [name for name in able if of_gap[name] >= _OF_THE_GAP * max(of_gap.values())]
    telling = [name for name in able if metrics[name].closed is not None]
    clear = [name for name in telling if _above_floor(metrics[name]) >= _CLEAR]
    if clear or not telling:
        name = (clear or able)[0]
    else:
        name = max(telling, key=lambda one: _above_floor(metrics[one]))
    chosen = metrics[name]
    return Gap(metric=name, held_out=held_out, all=metrics, **dict(chosen))


def _part(moved: float, gap: float) -> float:
    """Return the part of a gap that effects move; what moves more than there is moves all."""
    return min(moved / max(gap, 1e-12), 1.0)


def _above_floor(metric: Metric) -> float:
    return metric.before / max(metric.floor or 0.0, 1e-12)


def _picks(count: int) -> NDArray[np.int64] | None:
    if count < 2:
        return None
    return np.random.default_rng(_SEED).integers(count, size=(_RESAMPLES, count))


def _closed_interval(compared: Compared, closed: float) -> tuple[float, float] | None:
    """Return the interval, which holds what was *closed*: drawn values leave more of a gap than the
    best do, and of few windows, one of them hardly a gap, all draws may close less."""
    before, after, floor = compared.before, compared.after, compared.floor
    picks = _picks(len(before.mean_square))
    if after is None or floor is None:
        return None
    floors = np.broadcast_to(floor.mean(0), (_RESAMPLES, floor.shape[1]))
    if picks is None:
        if compared.after_draws is None:
            return None
        picks = np.zeros((_RESAMPLES, 1), dtype=np.int64)
        floors = floor[np.random.default_rng(_SEED).integers(len(floor), size=_RESAMPLES)]
    afters = np.broadcast_to(after.mean_square, (_RESAMPLES, len(after.mean_square)))
    if compared.after_draws is not None and len(compared.after_draws):
        afters = compared.after_draws[np.arange(_RESAMPLES) % len(compared.after_draws)]
    before_rms = np.sqrt(before.mean_square[picks].mean(1))
    after_rms = np.sqrt(np.take_along_axis(afters, picks, axis=1).mean(1))
    floor_rms = np.sqrt(np.take_along_axis(floors, picks, axis=1).mean(1))
    width = before_rms - floor_rms
    # As of the whole: draws of windows in which nothing is to be closed say nothing of it.
    good = (width > 0) & (before_rms >= CLOSABLE * floor_rms)
    if good.mean() < _MANY_DRAWS:
        return None
    low, high = np.quantile((before_rms - after_rms)[good] / width[good], [0.025, 0.975])
    return min(float(low), closed), max(float(high), closed)
