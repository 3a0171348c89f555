"""The arrays that a diagnosis page draws from, as JSON that is safe inside a page."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from gap_diagnosis.pictures import HeldOutPath, Report, ResidualMap, ResidualSeries
from gap_diagnosis.recording import Floats

_POINTS = 1200  # more than a screen can show, few enough for a page to mail
_DIGITS = 5


def embedded(report: Report) -> str:
    """Return the page's data; nothing in it can end the element it stands in."""
    pictures = report.pictures
    content = {
        "residuals": [_residual(one) for one in pictures.residuals],
        "map": None if pictures.residual_map is None else _map(pictures.residual_map),
        "segments": [
            segment.model_dump(mode="json") for segment in report.diagnosis.where.segments
        ],
        "paths": [_path(one) for one in pictures.paths],
        "path": max(
            range(len(pictures.paths)), key=lambda k: _apart_m(pictures.paths[k]), default=0
        ),
    }
    text = json.dumps(content, allow_nan=False, separators=(",", ":"))
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _residual(one: ResidualSeries) -> dict[str, Any]:
    keep = _kept(len(one.t_s))
    explained = None if one.explained is None else _numbers(one.explained[keep])
    return {
        "stage": one.stage,
        "name": one.name,
        "unit": one.unit,
        "t": _numbers(one.t_s[keep], digits=8),
        "value": _numbers(one.value[keep]),
        "explained": explained,
    }


def _map(one: ResidualMap) -> dict[str, Any]:
    return {
        "edges": _numbers(one.edges_s, digits=8),
        "stages": list(one.stages),
        "shares": [_numbers(np.nan_to_num(row)) for row in one.shares],
    }


def _path(one: HeldOutPath) -> dict[str, Any]:
    return {
        "name": one.name,
        "reference": _xy(one.reference),
        "before": _xy(one.before),
        "after": _xy(one.after),
    }


def _apart_m(one: HeldOutPath) -> float:
    """Return how far the described way ends from the measured one, or from the explained: each has
    samples of its own."""
    other = one.after if one.reference is None else one.reference
    ends = [
        way[np.isfinite(way).all(axis=1)][-1:] for way in (one.before, other) if way is not None
    ]
    return (
        float(np.hypot(*(ends[0] - ends[1])[0])) if all(map(len, ends)) and len(ends) > 1 else 0.0
    )


def _xy(points: Floats | None) -> list[list[float | None]] | None:
    if points is None:
        return None
    kept = points[_kept(len(points))]
    return [_numbers(kept[:, 0]), _numbers(kept[:, 1])]


def _kept(count: int) -> Any:
    """Return the rows to draw: first and last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, _POINTS)).round().astype(np.int64))


def _numbers(values: Floats, digits: int = _DIGITS) -> list[float | None]:
    """Return plain rounded numbers; JSON has no NaN, so a missing one is null."""
    return [
        float(f"{value:.{digits}g}") if math.isfinite(value) else None
        for value in np.asarray(values).tolist()
    ]
