"""What a law's picture shows, as data: who draws it chooses size, colours and file format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hil_harness.laws.statistics import Split

FloatArray = NDArray[np.float64]
Numbers = NDArray[np.floating[Any]] | NDArray[np.integer[Any]]

Style = Literal["law", "line", "dots"]
"""A prediction (dashed line), a measured line, or measured dots."""


@dataclass(frozen=True)
class Series:
    """One line or cloud of a panel.

    Attributes:
        label: what it is, in the legend; empty for no entry.
        x: horizontal values, shape (n,).
        y: vertical values, shape (n,).
        style: how it is drawn.
        colour: 0 is the ink of predictions, 1 to 4 are colours for measurements.
        low: lower ends of intervals or of a band, shape (n,); None for none.
        high: upper ends, likewise.
    """

    label: str
    x: FloatArray
    y: FloatArray
    style: Style
    colour: int
    low: FloatArray | None = None
    high: FloatArray | None = None


@dataclass(frozen=True)
class Panel:
    """One pair of axes.

    Attributes:
        title: what the panel shows, one short sentence.
        x_label: with unit.
        y_label: with unit.
        series: what is drawn, back to front.
        log_x: logarithmic horizontal axis.
        log_y: logarithmic vertical axis.
        is_map: both axes are metres and drawn to the same scale.
        broken: horizontal range in which the law no longer holds, shaded; None for none.
        y_limits: vertical range shown; None for all there is.
    """

    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]
    log_x: bool = False
    log_y: bool = False
    is_map: bool = False
    broken: tuple[float, float] | None = None
    y_limits: tuple[float, float] | None = None


def law(label: str, x: Numbers, y: Numbers, colour: int = 0) -> Series:
    """Return a prediction: a dashed line."""
    return Series(label, _floats(x), _floats(y), "law", colour)


def line(label: str, x: Numbers, y: Numbers, colour: int = 1) -> Series:
    """Return a measurement with too many points for dots: a solid line."""
    return Series(label, _floats(x), _floats(y), "line", colour)


def dots(label: str, x: Numbers, y: Numbers, colour: int = 1) -> Series:
    """Return measured dots."""
    return Series(label, _floats(x), _floats(y), "dots", colour)


def means(label: str, x: Numbers, splits: Sequence[Split], colour: int = 1) -> Series:
    """Return the systematic parts of *splits* as dots with their intervals."""
    return Series(
        label,
        _floats(x),
        np.array([split.systematic for split in splits]),
        "dots",
        colour,
        low=np.array([split.systematic_interval.low for split in splits]),
        high=np.array([split.systematic_interval.high for split in splits]),
    )


def spreads(label: str, x: Numbers, splits: Sequence[Split], colour: int = 1) -> Series:
    """Return the random parts of *splits* as dots with their intervals."""
    return Series(
        label,
        _floats(x),
        np.array([split.random for split in splits]),
        "dots",
        colour,
        low=np.array([split.random_interval.low for split in splits]),
        high=np.array([split.random_interval.high for split in splits]),
    )


def thinned(values: Numbers, points: int = 400) -> FloatArray:
    """Return at most about *points* of *values*, evenly spaced, the last one among them."""
    stride = max(1, -(-len(values) // points))
    return _floats(values[(len(values) - 1) % stride :: stride])


def _floats(values: Numbers) -> FloatArray:
    return np.asarray(values, np.float64)
