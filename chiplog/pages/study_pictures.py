"""The pictures of a study: error against cost, what each choice buys, where the error is from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

from chiplog.pages.drawing import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    ROSE,
    Canvas,
    Picture,
    picture,
)
from chiplog.pages.study_words import said_error
from precision_study.budget import CAUSES
from precision_study.study import Outcome, Requirement, Study, high_words

_TINY: Final = 1e-18
_MAX_LABELS: Final = 12


def front_picture(
    study: Study,
    found: Sequence[Outcome],
    best: Sequence[Outcome],
    chosen: Outcome | None,
    requirement: Requirement | None,
    kind: str,
) -> Picture:
    """Draw the error of every configuration against instructions and against memory."""

    def draw(canvas: Canvas) -> Figure:
        figure, panels = _panels(canvas, 2, 330)
        for axes, name, label in (
            (panels[0], "instructions_per_s", "instructions a second"),
            (panels[1], "memory_bytes", "bytes of table and state"),
        ):
            _scatter(axes, found, best, chosen, name, kind)
            axes.set_xlabel(label)
            if requirement is not None:
                axes.axhline(requirement.limit, color=ROSE, linewidth=1.2, linestyle="--")
                axes.text(
                    *(0.99, requirement.limit),
                    f"limit {said_error(requirement.limit, kind)}",
                    color=ROSE,
                    transform=axes.get_yaxis_transform(),
                    ha="right",
                    va="bottom",
                )
            _widen(axes)
        panels[0].set_title(f"{kind} error", loc="left")
        panels[0].legend(loc="lower left", frameon=False, fontsize=10, handletextpad=0.3)
        return figure

    chosen_words = "" if chosen is None else " The orange ring is the cheapest that holds."
    caption = (
        f"Each dot is a configuration: the {high_words(len(study.seeds))} on its worst scenario. "
        f"Blue ones are beaten by none in error, instructions and memory together.{chosen_words}"
    )
    return picture("front", "Error against cost", caption, draw, alt=caption)


def _scatter(
    axes: Axes,
    found: Sequence[Outcome],
    best: Sequence[Outcome],
    chosen: Outcome | None,
    name: str,
    kind: str,
) -> None:
    def xy(those: Sequence[Outcome]) -> tuple[list[float], list[float]]:
        costs = [float(getattr(one.cost, name)) for one in those]
        return costs, [max(one.error(kind), _TINY) for one in those]

    sound = [one for one in found if one.overflows == 0]
    wrong = [one for one in found if one.overflows > 0]
    axes.plot(*xy(sound), "o", color=MUTED, alpha=0.35, markersize=3, label="configuration")
    if wrong:
        axes.plot(*xy(wrong), "x", color=ROSE, markersize=4, label="overflows")
    axes.plot(*xy(best), "o", color=BLUE, markersize=4.5, label="front")
    if chosen is not None:
        axes.plot(
            *xy([chosen]),
            "o",
            color=ORANGE,
            markersize=11,
            fillstyle="none",
            markeredgewidth=2,
            label="chosen",
        )
    axes.set_yscale("log")
    axes.set_xscale("log")
    _label_errors(axes.yaxis, kind)
    _label_costs(axes.xaxis, [float(getattr(one.cost, name)) for one in found])


def choices_picture(
    study: Study, found: Sequence[Outcome], requirement: Requirement | None, kind: str
) -> Picture | None:
    """Draw for each axis and value the errors of all configurations that have it."""
    axes_of = _swept(study)
    if not axes_of:
        return None

    def draw(canvas: Canvas) -> Figure:
        columns = 1 if canvas.is_narrow else min(3, len(axes_of))
        figure, panels = _panels(canvas, len(axes_of), 230, columns=columns)
        for axes, (name, values) in zip(panels, axes_of.items(), strict=True):
            for place, value in enumerate(values):
                errors = np.array(
                    [
                        max(one.error(kind), _TINY)
                        for one in found
                        if dict(one.point.values)[name] == value
                    ]
                )
                low, middle, high = np.quantile(errors, (0.0, 0.5, 1.0), method="nearest")
                axes.plot([place, place], [low, high], "-", color=FAINT, linewidth=6)
                axes.plot([place], [low], "o", color=BLUE, markersize=5)
                axes.plot([place], [middle], "_", color=INK, markersize=11, markeredgewidth=1.6)
            axes.set_yscale("log")
            _label_errors(axes.yaxis, kind)
            axes.set_xlim(-0.6, len(values) - 0.4)
            places = range(0, len(values), -(-len(values) // _MAX_LABELS))
            axes.set_xticks(places, [_short(values[place]) for place in places])
            axes.set_title(name, loc="left")
            if requirement is not None:
                axes.axhline(requirement.limit, color=ROSE, linewidth=1.2, linestyle="--")
            _widen(axes)
        return figure

    caption = (
        "For each value of a choice, all configurations that have it: the bar reaches from the "
        "best (blue) to the worst, the stroke is the median. Where the blue dots stay level, the "
        "choice buys nothing that another does not limit."
    )
    return picture("choices", "What each choice buys", caption, draw, alt=caption)


def budget_picture(one: Outcome) -> Picture:
    """Draw expected and guaranteed error by cause, and what was measured."""
    worst = one.worst("arithmetic position")
    named = [(name, worst.budget[name]) for name in CAUSES if worst.budget[name][0] > 0.0]
    measured = worst.final_rms["arithmetic position"]

    def draw(canvas: Canvas) -> Figure:
        figure, (axes,) = _panels(canvas, 1, 60 + 27 * len(named), columns=1)
        floor = min([measured, *(part[1] for _, part in named if part[1] > 0.0)]) / 3.0
        for place, (_, (bound, expected, *_)) in enumerate(reversed(named)):
            shown = max(expected, floor)
            axes.plot([shown, bound], [place, place], "-", color=FAINT, linewidth=5)
            axes.plot([bound], [place], "|", color=INK, markersize=12, markeredgewidth=2)
            if expected > 0.0:
                axes.plot([expected], [place], "o", color=BLUE, markersize=6)
        axes.axvline(measured, color=GREEN, linewidth=1.4)
        axes.text(
            *(measured, len(named) - 0.35),
            f"measured {said_error(measured, 'position')}",
            color=GREEN,
            ha="center",
            va="bottom",
        )
        axes.set_xscale("log")
        _label_errors(axes.xaxis, "position")
        axes.set_ylim(-0.6, len(named) + 0.2)
        axes.set_yticks(range(len(named)), [name.replace("_", " ") for name, _ in reversed(named)])
        axes.grid(visible=False, axis="y")
        return figure

    caption = (
        f"On {worst.scenario}: for each cause of firmware − float the expected error at the end "
        "(dot) and the most it can be (stroke). The green line is the root mean square measured."
    )
    return picture("budget", "Where the error comes from", caption, draw, alt=caption)


def _panels(
    canvas: Canvas, count: int, height_px: float, *, columns: int = 2
) -> tuple[Figure, list[Axes]]:
    across = 1 if canvas.is_narrow else min(columns, count)
    down = -(-count // across)
    figure = Figure(figsize=(canvas.width_px / 72, height_px * down / 72), dpi=72)
    figure.set_layout_engine("constrained", w_pad=6 / 72, h_pad=7 / 72)
    grid = figure.subplots(down, across, squeeze=False)
    flat: list[Any] = [axes for row in grid for axes in row]
    for spare in flat[count:]:
        spare.set_visible(False)
    return figure, flat[:count]


def _swept(study: Study) -> dict[str, list[Any]]:
    """Return the axes of which more than one value is studied, and these."""
    values: dict[str, list[Any]] = {}
    for point in study.points:
        for name, value in point.values:
            known = values.setdefault(name, [])
            if value not in known:
                known.append(value)
    return {name: known for name, known in values.items() if len(known) > 1}


def _label_errors(axis: Axis, kind: str) -> None:
    axis.set_major_locator(LogLocator(numticks=7))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _error_tick(value, kind)))
    axis.set_minor_formatter(NullFormatter())


def _widen(axes: Axes) -> None:
    """Let errors of less than two decades span whole ones: labels stand at decades."""
    low, high = axes.get_ylim()
    if high < 100.0 * low:
        axes.set_ylim(10.0 ** math.floor(math.log10(low)), 10.0 ** math.ceil(math.log10(high)))


def _error_tick(value: float, kind: str) -> str:
    unit = "rad" if kind.endswith("heading") else "m"
    for prefix, factor in (("", 1.0), ("m", 1e-3), ("µ", 1e-6), ("n", 1e-9), ("p", 1e-12)):
        if value >= factor * 0.999:
            return f"{value / factor:g} {prefix}{unit}"
    return f"{value:.0e} {unit}"


def _label_costs(axis: Axis, costs: Sequence[float]) -> None:
    """Label a few round costs: decades alone would leave a narrow range without any."""
    low, high = min(costs), max(costs)
    steps = (1.0, 2.0, 5.0) if high / low > 4.0 else (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0)
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    ticks = [step * 10.0**power for power in range(first, last + 1) for step in steps]
    inside = [tick for tick in ticks if 0.8 * low <= tick <= 1.25 * high] or [low]
    axis.set_ticks(inside, [_cost_tick(tick) for tick in inside])
    axis.set_minor_locator(NullLocator())
    axes = axis.axes
    assert isinstance(axes, Axes)  # an axis of a figure of ours
    axes.set_xlim(0.85 * low, 1.18 * high)


def _cost_tick(value: float) -> str:
    return f"{value / 1000:g}k" if value >= 1000 else f"{value:g}"


def _short(value: Any) -> str:
    word = str(value).lower() if isinstance(value, bool) else str(value)
    return word.replace("toward_zero", "to zero").replace("_", " ")
