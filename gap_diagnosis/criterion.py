"""A bound on the gap as a person writes it: ``position > 5 mm per 10 m``.

Metrics are RMS errors that grow over windows of about 5 m, but 5 to 10 s. A bound per length or per
time is compared with the metric scaled in proportion to the windows' mean length.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.gap.windows import LEAST_S, WINDOW_M, WINDOW_S
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import LogFacts, Metric

METRICS: Final = MappingProxyType(
    {
        "position": "odometry_position_m",
        "heading": "odometry_heading_rad",
        "drive": "drive_position_m",
        "firmware": "firmware_position_m",
        "turn": "turn_difference_rad",
        "timing": "timing_s",
    }
)
"""The words of a bound, and the metric each stands for."""

_LENGTHS: Final = MappingProxyType({"m": 1.0, "cm": 1e-2, "mm": 1e-3, "µm": 1e-6, "um": 1e-6})
_ANGLES: Final = MappingProxyType(
    {"rad": 1.0, "mrad": 1e-3, "deg": math.pi / 180, "°": math.pi / 180}
)
_TIMES: Final = MappingProxyType({"s": 1.0, "ms": 1e-3, "µs": 1e-6, "us": 1e-6})
_UNITS: Final = MappingProxyType(
    {
        "position": _LENGTHS,
        "heading": _ANGLES,
        "drive": _LENGTHS,
        "firmware": _LENGTHS,
        "turn": _ANGLES,
        "timing": _TIMES,
    }
)
_PER: Final = MappingProxyType({**_LENGTHS, **_TIMES, "min": 60.0, "km": 1000.0})
_SPAN: Final = MappingProxyType(
    {**dict.fromkeys((*_LENGTHS, "km"), "m"), **dict.fromkeys((*_TIMES, "min"), "s")}
)
_NUMBER: Final = r"(\d+(?:\.\d*)?(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)"
_BOUND: Final = re.compile(rf"{_NUMBER}\s*([^\W\d]+|°)(?:\s+per\s+(?:{_NUMBER}\s*)?([^\W\d]+))?")
_LONGEST: Final = 100
_FORM: Final = 'for example "position > 5 mm per 10 m"'


@dataclass(frozen=True)
class Bound:
    """The largest gap that is accepted.

    Attributes:
        metric: a word of `METRICS`.
        limit: SI.
        per: length [m] or time [s] over which `limit` may arise; None for a window, as it is.
        span: "m", "s", or "" without `per`.
    """

    metric: str
    limit: float
    per: float | None = None
    span: str = ""

    def __str__(self) -> str:
        """Return the bound in SI as `parse_bound` and `parse_criterion` take it."""
        unit = next(unit for unit, factor in _UNITS[self.metric].items() if factor == 1.0)
        per = "" if self.per is None else f" per {self.per!r} {self.span}"
        return f"{self.metric} > {self.limit!r} {unit}{per}"


@dataclass(frozen=True)
class Judgement:
    """A bound held against a gap.

    Attributes:
        bound: what was asked.
        value: the gap in the bound's terms, SI.
        holds: whether it is within.
        scaled: length of the windows [m or s] from which `value` was scaled; None where it was not.
        log: the one of several logs that has this gap; empty where there is but one.
    """

    bound: Bound
    value: float
    holds: bool
    scaled: float | None
    log: str = ""


def parse_criterion(text: str) -> Bound:
    """Return the bound in ``METRIC > NUMBER UNIT [per NUMBER UNIT]``.

    Raises DiagnosisError saying what was expected.
    """
    metric, sign, rest = text[:_LONGEST].partition(">")
    if len(text) > _LONGEST or not sign:
        raise DiagnosisError(
            f"{text[:40]!r}: expected METRIC > NUMBER UNIT [per NUMBER UNIT], {_FORM}"
        )
    return parse_bound(metric.strip(), rest)


def parse_bound(metric: str, text: str) -> Bound:
    """Return the bound ``NUMBER UNIT [per NUMBER UNIT]`` on `metric`; raises DiagnosisError."""
    if metric not in METRICS:
        raise DiagnosisError(f"{metric[:40]!r}: no such metric: expected {', '.join(METRICS)}")
    match = _BOUND.fullmatch(text.strip()) if len(text) <= _LONGEST else None
    if match is None:
        raise DiagnosisError(
            f"{text.strip()[:40]!r}: expected NUMBER UNIT [per NUMBER UNIT], {_FORM}"
        )
    number, unit, length, span = match.groups()
    units = _UNITS[metric]
    if unit not in units:
        raise DiagnosisError(f"{unit!r}: no unit of {metric}: expected {', '.join(units)}")
    limit = float(number) * units[unit]
    if not math.isfinite(limit):
        raise DiagnosisError(f"{number}: expected a finite number, {_FORM}")
    if span is None:
        return Bound(metric, limit)
    if span not in _PER:
        raise DiagnosisError(f"per {span!r}: expected a length or a time: {', '.join(_PER)}")
    per = (1.0 if length is None else float(length)) * _PER[span]
    if not 0 < per < math.inf:
        raise DiagnosisError(f"per {length} {span}: expected more than 0")
    return Bound(metric, limit, per, _SPAN[span])


def judge(bound: Bound, diagnosis: Diagnosis) -> Judgement:
    """Hold `bound` against the gap as it is before any effect is switched on.

    Of several logs the one with the largest gap counts. Raises DiagnosisError where this data, or
    one of the logs, does not have the metric.
    """
    if any(log.metrics for log in diagnosis.logs):
        found = [
            _held_against(bound, log.metrics, [log], log.has_reference, name)
            for log, name in zip(diagnosis.logs, _told_apart(diagnosis.logs), strict=True)
        ]
        return max(found, key=lambda one: one.value)
    metrics = {} if diagnosis.gap is None else diagnosis.gap.all
    roles = {one.role for one in diagnosis.inputs}
    has_reference = any(log.has_reference for log in diagnosis.logs)
    if "holdout" in roles:
        has_reference = "holdout_reference" in roles
    return _held_against(bound, metrics, diagnosis.logs, has_reference)


def _told_apart(logs: Sequence[LogFacts]) -> list[str]:
    """Return the logs' names, with their places where a name is given twice, as of two folders."""
    names = [log.name for log in logs]
    return [
        name if names.count(name) == 1 else f"{name} (log {place})"
        for place, name in enumerate(names, 1)
    ]


def _held_against(
    bound: Bound,
    metrics: Mapping[str, Metric],
    logs: Sequence[LogFacts],
    has_reference: bool,
    log: str = "",
) -> Judgement:
    name = METRICS[bound.metric]
    if name not in metrics:
        where = f"{log}: " if log else ""
        raise DiagnosisError(
            f"{where}this data has no gap in {bound.metric}{_needs(name, metrics, has_reference)}: "
            f"{_instead(metrics, logs)}"
        )
    metric = metrics[name]
    if bound.per is None:
        return Judgement(bound, metric.before, metric.before <= bound.limit, None, log)
    window = _window(bound, metric, logs)
    value = metric.before * bound.per / window
    return Judgement(bound, value, value <= bound.limit, window, log)


def _needs(name: str, metrics: Mapping[str, Metric], has_reference: bool) -> str:
    """Return what of the reference a missing metric needs, in brackets; "" where it is not that."""
    if not name.startswith("odometry"):
        return ""
    if not has_reference:
        return " (it needs a reference)"
    if METRICS["position"] in metrics:
        return " (its reference has no headings)"
    return " (its reference tells too little of what was held out)" if metrics else ""


def _instead(metrics: Mapping[str, Metric], logs: Sequence[LogFacts]) -> str:
    """Return which metrics there are, or why there are none."""
    known = [word for word, metric in METRICS.items() if metric in metrics]
    if known:
        return f"it has {', '.join(known)}"
    reasons = [log.unmeasured for log in logs if log.unmeasured is not None]
    return reasons[0].rstrip(".") if reasons else "nothing was held out to measure on"


def _window(bound: Bound, metric: Metric, logs: Sequence[LogFacts]) -> float:
    """Return the windows' mean length; by the logs' mean speed where the metric does not tell."""
    told = metric.window_m if bound.span == "m" else metric.window_s
    if told is not None:
        return told
    driven_m = math.fsum(log.distance_m or 0.0 for log in logs)
    lasted_s = math.fsum(log.duration_s for log in logs)
    if not driven_m:
        return WINDOW_M if bound.span == "m" else WINDOW_S
    window_s = min(WINDOW_S, max(LEAST_S, WINDOW_M * lasted_s / driven_m))
    return window_s * driven_m / lasted_s if bound.span == "m" else window_s
