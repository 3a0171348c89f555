"""The pictures of a trial: what was told for what, what was missed, how far to be believed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, NullLocator

from chiplog.pages.drawing import (
    BLUE,
    FAINT,
    INK,
    MUTED,
    ORANGE,
    Canvas,
    Picture,
    new_figure,
    picture,
)
from gap_diagnosis.result_parts import STAGES
from gap_diagnosis.trials.yardsticks import best_miss

_ROWS: Final = (*STAGES, "unknown")
_FIRST, _LAST = 0.2, 20.0


def confusion_picture(rows: Sequence[Mapping[str, Any]]) -> Picture:
    """Draw which stage was told for which, by the *stages* of scores."""
    told = np.zeros((len(_ROWS), len(_ROWS)), dtype=np.int64)
    alike = np.zeros(told.shape, dtype=np.bool_)
    for row in rows:
        place = _ROWS.index(row["stage"])
        alike[place, place] = True
        for stage, count in row["told"].items():
            told[place, _ROWS.index(stage)] = count
        for stage in row["alike"]:
            alike[place, _ROWS.index(stage)] = True

    def draw(canvas: Canvas) -> Figure:
        figure, (axes,) = new_figure(canvas, 330 if canvas.is_narrow else 380)
        axes.grid(visible=False)
        names = [one[:5] if canvas.is_narrow else one for one in _ROWS]
        for row in range(len(_ROWS)):
            for column in range(len(_ROWS)):
                if alike[row, column]:
                    axes.plot(column, row, "s", color=FAINT, markersize=22)
                if told[row, column]:
                    right = row == column
                    axes.text(
                        column, row, str(told[row, column]), ha="center", va="center",
                        color=INK if right else ORANGE, fontweight="normal" if right else "bold",
                    )  # fmt: skip
        axes.set_xlim(-0.6, len(_ROWS) - 0.4)
        axes.set_ylim(len(_ROWS) - 0.4, -0.6)
        axes.set_xticks(range(len(_ROWS)), names, rotation=40, ha="right")
        axes.set_yticks(range(len(_ROWS)), names)
        axes.set_ylabel("true stage")
        axes.set_xlabel("told stage")
        return figure

    wrong = int(told.sum() - np.trace(told))
    caption = (
        f"How many cases of each stage (rows) were told as which ({wrong} of {told.sum()} off the "
        "diagonal, bold). Grey squares: stages of answers that the expected separation says nobody "
        "could tell apart in at least one of these cases; mistakes should lie there and nowhere "
        "else. Nulls, and effects at or above twice their detection limit."
    )
    return picture("confusion", "Told for true", caption, draw, alt=caption)


def miss_picture(curve: Sequence[Mapping[str, Any]]) -> Picture:
    """Draw how often nothing was told against size, beside the best of all tests."""

    def draw(canvas: Canvas) -> Figure:
        figure, (axes,) = new_figure(canvas, 260)
        sizes = np.geomspace(_FIRST, _LAST, 200)
        axes.plot(sizes, [best_miss(size) for size in sizes], "-", color=MUTED)
        axes.text(0.62, 0.72, "best of all tests", color=MUTED, ha="left")
        for one in curve:
            low, high = max(one["from"], _FIRST), min(one["to"] or _LAST, _LAST)
            at = math.sqrt(low * high)
            missed = one["missed"]
            axes.plot([low, high], [missed["value"]] * 2, "-", color=BLUE, alpha=0.4)
            axes.plot([at, at], [missed["low"], missed["high"]], "-", color=BLUE, linewidth=1.0)
            axes.plot([at], [missed["value"]], "o", color=BLUE, markersize=5)
            axes.plot([at], [1 - one["in_group"]["value"]], "x", color=ORANGE, markersize=6)
        axes.set_xscale("log")
        axes.set_xlim(_FIRST, _LAST)
        axes.set_ylim(-0.04, 1.04)
        axes.xaxis.set_major_locator(FixedLocator([0.3, 0.5, 1, 2, 5, 10]))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xticklabels(["0.3", "0.5", "1", "2", "5", "10"])
        axes.set_xlabel("size over the detection limit")
        axes.set_title("share of cases", loc="left")
        return figure

    caption = (
        "Blue: share told as no gap, by size, with 95 % intervals. Orange: the truth was not in "
        "the reported group. The line: what the best test could miss at 1 % false alarms over 60 "
        "candidates, had an effect one known shape in one known channel."
    )
    return picture("miss", "What is missed", caption, draw, alt=caption)


def calibration_picture(part: Mapping[str, Any]) -> Picture:
    """Draw how often answers of a probability were right, beside a perfect forecaster."""
    bins = part["calibration"]

    def draw(canvas: Canvas) -> Figure:
        figure, (axes,) = new_figure(canvas, 300)
        axes.plot([0, 1], [0, 1], "-", color=MUTED, linewidth=1.2)
        said = np.linspace(0, 1, 101)
        typical = max(int(np.median([one["count"] for one in bins])), 1) if bins else 1
        half = 1.96 * np.sqrt(said * (1 - said) / typical)
        axes.fill_between(
            said, np.clip(said - half, 0, 1), np.clip(said + half, 0, 1), color=FAINT, alpha=0.6,
            linewidth=0,
        )  # fmt: skip
        for one in bins:
            axes.plot([one["said"]], [one["true"]], "o", color=BLUE, markersize=5)
        axes.set_xlim(-0.02, 1.02)
        axes.set_ylim(-0.04, 1.04)
        axes.set_xlabel("probability of the reported group")
        axes.set_title("share of cases in which the truth was in it", loc="left")
        return figure

    chance = part["ece_by_chance"]
    error = "none" if part["ece"] is None else f"{part['ece']:.3f}"
    by_chance = (
        ""
        if chance is None
        else f" A perfect forecaster of the same probabilities would show {chance[0]:.3f} on "
        f"average by chance alone, and less than {chance[2]:.3f} 39 times in 40."
    )
    caption = (
        f"Each dot is a fifteenth of the cases ({part['cases']} in all); the line and its band are "
        f"a perfect forecaster's. Calibration error {error}.{by_chance}"
    )
    return picture("calibration", "How far to be believed", caption, draw, alt=caption)
