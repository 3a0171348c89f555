"""The plots that pictures are made of: a map, curves over time, a timeline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from chiplog.pages import quantities as q
from chiplog.pages.drawing import BLUE, FAINT, MUTED, Canvas, new_figure
from hil_harness.results import Poses

Floats = NDArray[np.float64]

_POINTS = 1500  # more than a screen can show, few enough for a small page
_LINE_HEIGHT_PX = 15.0
_LONGEST_LABEL = 24
_CROWDED = 0.12  # an end within this share of the map from the start shares its labels' column
_SCALES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))


@dataclass(frozen=True)
class Curve:
    """One line with the label that stands at its end."""

    label: str
    colour: str
    values: Floats


@dataclass(frozen=True)
class Track:
    """One path on the map."""

    label: str
    colour: str
    poses: Poses
    width: float = 2.0

    @property
    def end(self) -> tuple[float, float]:
        """Where the path ends, (x_m, y_m); NaN if it never began."""
        if len(self.poses) == 0:
            return (np.nan, np.nan)
        return float(self.poses[-1, 0]), float(self.poses[-1, 1])


def draw_map(canvas: Canvas, tracks: Sequence[Track]) -> Figure:
    """Draw paths seen from above, one scale on both axes, each named at its end."""
    points = np.concatenate([track.poses[:, :2] for track in tracks] or [np.zeros((0, 2))])
    points = points[np.isfinite(points).all(axis=1)]
    low, high = _padded_extent(points)
    plot_width_px = canvas.width_px - (140 if not canvas.is_narrow else 60)
    ratio = (high[1] - low[1]) / (high[0] - low[0])
    height_px = float(np.clip(plot_width_px * ratio, 160, 560)) + 45
    figure, (axes,) = new_figure(canvas, height_px)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0)
    axes.update_datalim([low, high])
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    for track in tracks:
        rows = _thinned(track.poses)
        axes.plot(rows[:, 0], rows[:, 1], color=track.colour, linewidth=track.width)
        axes.plot(*track.end, "o", color=track.colour, markersize=5)
    axes.plot(0, 0, "o", markersize=6, markerfacecolor="none", markeredgecolor=MUTED)
    ends = [(track.label, track.colour, track.end) for track in tracks]
    room_m = _CROWDED * float((high - low).max())
    if any(np.hypot(*end) < room_m for _, _, end in ends):
        ends.append(("start", MUTED, (0.0, 0.0)))
    else:
        axes.annotate("start", (0, 0), (7, -5), textcoords="offset points", color=MUTED, va="top")
    _settle(figure, [(axes, _label_ends(axes, ends))], _LINE_HEIGHT_PX)
    return figure


def _label_ends(
    axes: Axes, ends: Sequence[tuple[str, str, tuple[float, float]]]
) -> list[Annotation]:
    """Name each path beside its end; return the labels in ascending order."""
    shown = sorted((end for end in ends if np.isfinite(end[2]).all()), key=lambda end: end[2][1])
    return [
        axes.annotate(
            _short(name),
            end,
            (9, 0),
            textcoords="offset points",
            color=colour,
            va="center",
            fontweight="bold",
            annotation_clip=False,
        )
        for name, colour, end in shown
    ]


def _settle(
    figure: Figure, groups: Sequence[tuple[Axes, Sequence[Annotation]]], gap_px: float
) -> None:
    """Lay the figure out, then move labels (ascending) until they are `gap_px` apart.

    Laid out first, and only once: labels take room from the axes, and what counts is where their
    ends are then.
    """
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes, labels in groups:
        pixels = [float(axes.transData.transform(label.xy)[1]) for label in labels]
        for label, pixel, height in zip(labels, pixels, _spread(pixels, gap_px), strict=True):
            label.xyann = (label.xyann[0], height - pixel)


def draw_over_time(
    canvas: Canvas,
    time_s: Floats,
    panels: Sequence[Sequence[Curve]],
    names: Sequence[str],
    units: Sequence[str],
    *,
    height_px: float,
    width: float = 1.8,
) -> Figure:
    """Draw one panel of curves below the other over a common time axis."""
    figure, all_axes = new_figure(canvas, height_px, rows=len(panels))
    groups = []
    for axes, curves, name, unit in zip(all_axes, panels, names, units, strict=True):
        factor, prefix = _scale_of([curve.values for curve in curves])
        for curve in curves:
            rows = _thinned(np.column_stack([time_s, curve.values / factor]))
            axes.plot(rows[:, 0], rows[:, 1], color=curve.colour, linewidth=width)
        axes.set_ylabel(f"{name} [{prefix}{unit}]")
        axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))
        axes.margins(x=0)
        groups.append((axes, _label_curves(axes, time_s, curves, factor, unit)))
    all_axes[-1].set_xlim(time_s[0], 2 * time_s[-1] - time_s[-2])  # the last tick lasts a period
    all_axes[-1].set_xlabel("time [s]")
    all_axes[-1].xaxis.set_major_locator(
        MaxNLocator(4 if canvas.is_narrow else 8, steps=[1, 2, 5, 10])
    )
    _settle(figure, groups, 2 * _LINE_HEIGHT_PX)
    return figure


def _label_curves(
    axes: Axes, time_s: Floats, curves: Sequence[Curve], factor: float, unit: str
) -> list[Annotation]:
    """Name each curve to the right of its end, with its last value; ascending."""
    shown = sorted(
        (curve for curve in curves if len(curve.values) and np.isfinite(curve.values[-1])),
        key=lambda curve: float(curve.values[-1]),
    )
    return [
        axes.annotate(
            f"{_short(curve.label)}\n{q.prefixed(float(curve.values[-1]), unit)}",
            (time_s[-1], curve.values[-1] / factor),
            (6, 0),
            textcoords="offset points",
            color=curve.colour,
            va="center",
            fontweight="bold",
            annotation_clip=False,
        )
        for curve in shown
    ]


def draw_timeline(
    canvas: Canvas, time_s: Floats, duration_s: float, rows: Mapping[str, NDArray[np.bool_]]
) -> Figure:
    """Draw a row per name, with a bar for each stretch in which it held."""
    figure, (axes,) = new_figure(canvas, 50 + 22 * len(rows))
    for height, on in enumerate(rows.values()):
        axes.broken_barh(_spans(time_s, duration_s, on), (height - 0.3, 0.6), color=BLUE)
        axes.axhline(height, color=FAINT, linewidth=0.6, zorder=0)
    axes.set_yticks(range(len(rows)), [name.lower().replace("_", " ") for name in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_xlim(0, duration_s)
    axes.grid(False)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("time [s]")
    axes.xaxis.set_major_locator(MaxNLocator(4 if canvas.is_narrow else 8, steps=[1, 2, 5, 10]))
    return figure


def _spans(time_s: Floats, duration_s: float, on: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return (start, length) of each stretch in which `on` holds; the last tick lasts a period."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], on, [False]]).astype(np.int8)))
    times = np.append(time_s, duration_s)
    starts, stops = times[edges[::2]], times[edges[1::2]]
    return [(float(a), float(b - a)) for a, b in zip(starts, stops, strict=True)]


def _short(label: str) -> str:
    return label if len(label) <= _LONGEST_LABEL else label[: _LONGEST_LABEL - 1] + "…"


def _thinned(rows: Floats) -> Floats:
    """Return at most about `_POINTS` rows, first and last kept."""
    if len(rows) <= _POINTS:
        return rows
    keep = np.unique(np.linspace(0, len(rows) - 1, _POINTS).round().astype(np.int64))
    return np.asarray(rows[keep])


def _scale_of(values: Sequence[Floats]) -> tuple[float, str]:
    """Return the unit prefix for an axis: the largest value reads between 1 and 1000."""
    finite = np.concatenate([v[np.isfinite(v)] for v in values] or [np.zeros(0)])
    largest = float(np.max(np.abs(finite), initial=0.0))
    if largest == 0:
        return _SCALES[0]
    return next((scale for scale in _SCALES if largest >= scale[0]), _SCALES[-1])


def _padded_extent(points: Floats) -> tuple[Floats, Floats]:
    """Return the corners of the map: all points and the start, with a margin, never flat."""
    points = np.concatenate([points, np.zeros((1, 2))])
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(float((high - low).max()), 1e-3)
    middle, half = (low + high) / 2, np.maximum(high - low, 0.25 * size) / 2 + 0.06 * size
    return middle - half, middle + half


def _spread(positions: Sequence[float], gap: float) -> list[float]:
    """Return `positions` (ascending) moved as little as needed to be `gap` apart.

    The least squares answer: crowded neighbours form a block about their common mean, and blocks
    that meet merge (pool adjacent violators).
    """
    blocks: list[tuple[float, int]] = []  # sum of position − rank·gap, members
    for rank, position in enumerate(positions):
        total, members = position - rank * gap, 1
        while blocks and blocks[-1][0] / blocks[-1][1] > total / members:
            before, count = blocks.pop()
            total, members = total + before, members + count
        blocks.append((total, members))
    means = [total / members for total, members in blocks for _ in range(members)]
    return [mean + rank * gap for rank, mean in enumerate(means)]
