"""The figures of a trial's page: what each is called, what it must reach, how it is said."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from gap_diagnosis.trials.full import OTHER

Direction = Literal["least", "most", "none"]


@dataclass(frozen=True)
class Goal:
    """What a figure must reach.

    Attributes:
        key: of the score.
        direction: whether *value* is the least or the most that will do; none: it is only told.
        value: the bound.
        words: the same for people.
    """

    key: str
    direction: Direction = "none"
    value: float = 0.0

    @property
    def words(self) -> str:
        """Return the bound with its sign."""
        if self.direction == "none":
            return ""
        sign = "≥" if self.direction == "least" else "≤"
        return f"{sign} {self.value:g}"


@dataclass(frozen=True)
class Figure:
    """One line of the page."""

    key: str
    label: str
    direction: Direction = "none"
    value: float = 0.0


FIGURES: Final = (
    Figure("stage", "stage", "least", 0.98),
    Figure("group_top1", "group-top-1", "least", 0.97),
    Figure("group_ratio", "mean reported over mean oracle group", "most", 1.3),
    Figure("top1", "top-1, where one name is right", "least", 0.92),
    Figure("true_probability", "probability of the truth, where one name is right", "least", 0.88),
    Figure("top3", "top-3"),
    Figure("own_name", "in the group under its own name, twins apart"),
    Figure("pairs_both_named", "pairs, both named", "least", 0.85),
    Figure("false_alarms", "false alarms", "most", 0.01),
    Figure("forecast", "calibration error of the top group, prior and leave-one-out", "most", 0.03),
    Figure("by_chance", "calibration error that a perfect forecaster shows of so many"),
    Figure("ece", "calibration error over all cases, sizes about the limit too"),
    Figure("ece_by_chance", "what a perfect forecaster shows of all"),
    Figure("brier", "Brier score"),
    Figure("log_score", "log score [nat]"),
    Figure("unknown_auroc", "unknown, AUROC", "least", 0.95),
    Figure("unknown_stage", "unknown told, with the right stage"),
    Figure("unknown_goes_with", "unknown told, with what the leftover goes with"),
    Figure("unknown_closes", "a model of that closes some of the held-out gap"),
    Figure("unknown_half", "the same, half of it or more"),
    Figure("confident_wrong", "unknown, confident wrong names", "most", 0.02),
    Figure("imitable_right", "withheld but imitable, told as what imitates it or unknown"),
    Figure("imitable_named", "of the imitable, told as what imitates it"),
    Figure("confident_wrong_nameless", "confident wrong names of what no library has"),
    Figure("ci50", "50 % intervals that hold the truth"),
    Figure("ci80", "80 % intervals that hold the truth"),
    Figure("ci95", "95 % intervals that hold the truth"),
    Figure("ranks", "ranks of true values even, chance of a worse fit"),
    Figure("error_over_bound", "parameter error over the Cramér-Rao bound"),
    Figure("window_overlap", "true and reported window, intersection over union"),
    Figure("gap_closed", "held-out gap closed over what noise leaves to close", "least", 0.95),
    Figure("gap_closed_each", "the same, case by case"),
    Figure("gap_closed_exact", "held-out gap closed where noise leaves nothing, case by case"),
    Figure("recommended", "probability of the truth after the recommended manoeuvre"),
    Figure("random", "probability of the truth after another manoeuvre"),
    Figure("more", "by how much the recommended one tells more"),
    Figure("seconds", "seconds a case"),
)
NOT_MEASURED: Final = "–"
_FALSE_ALARMS: Final = {"new drive": 0.02, "new noise": 0.02, "new robot": 0.02, OTHER: 0.05}
"""More of them are allowed on what is new, and in another engine's physics."""


def goal_of(one: Figure, part: str = "all") -> Goal:
    """Return what a figure must reach in a part of the cases."""
    value = _FALSE_ALARMS.get(part, one.value) if one.key == "false_alarms" else one.value
    return Goal(one.key, one.direction, value)


def value_of(
    part: Mapping[str, Any], key: str
) -> tuple[float | None, tuple[float, float] | None, int]:
    """Return a figure's value, its interval and its count of cases."""
    if key == "forecast":
        low_high, of = part["forecast"]["interval"], part["forecast"]["cases"]
        return part["forecast"]["error"], None if low_high is None else tuple(low_high), of
    if key == "by_chance":
        chance, of = part["forecast"]["by_chance"], part["forecast"]["cases"]
        return (None, None, 0) if chance is None else (chance[0], tuple(chance[1:]), of)
    if key == "ece":
        low_high = part["ece_interval"]
        return part["ece"], None if low_high is None else tuple(low_high), part["cases"]
    if key == "ece_by_chance":
        chance = part["ece_by_chance"]
        return (None, None, 0) if chance is None else (chance[0], tuple(chance[1:]), part["cases"])
    if key == "ranks":
        return part["ranks"]["p"], None, sum(part["ranks"]["counts"])
    if key in part:
        return _shared(part[key])
    return _shared(next(part[name][key] for name in ("coverage", "again") if key in part[name]))


def figure(part: Mapping[str, Any], one: Figure) -> str:
    """Return a figure as text: value, interval, cases."""
    return _words(*value_of(part, one.key))


def share_words(one: Mapping[str, Any]) -> str:
    """Return a share as text: value, interval, cases."""
    return _words(*_shared(one))


def _shared(one: Mapping[str, Any]) -> tuple[float | None, tuple[float, float] | None, int]:
    interval = None if one["low"] is None else (one["low"], one["high"])
    return one["value"], interval, one["count"]


def _words(value: float | None, interval: tuple[float, float] | None, count: int) -> str:
    if value is None:
        return NOT_MEASURED
    decimals = 3 if abs(value) < 0.1 or 0.995 <= value < 1 else 2  # 1.00 is all of them
    span = (
        "" if interval is None else f" ({interval[0]:.{decimals}f} to {interval[1]:.{decimals}f})"
    )
    return f"{value:.{decimals}f}{span}, {count}"


REACHED: Final = "reached"
UNPROVED: Final = "reached, not proved"
MISSED: Final = "MISSED"


def verdict_on(part: Mapping[str, Any], goal: Goal) -> str:
    """Return whether a figure reaches its goal: the measured value decides, as it stands.

    Where its interval holds values that would not do, the goal is not proved to be reached.
    """
    value, interval, _ = value_of(part, goal.key)
    if goal.direction == "none" or value is None:
        return ""
    sign = 1 if goal.direction == "least" else -1
    if sign * (value - goal.value) < 0:
        return MISSED
    worst = value if interval is None else interval[0 if sign > 0 else 1]
    return REACHED if sign * (worst - goal.value) >= 0 else UNPROVED
