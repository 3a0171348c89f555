"""Fixes of a satellite receiver, latitude and longitude, as metres on a plane."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.recording import Reference
from hil_harness.signal_roles import Quantity

Floats = NDArray[np.float64]

_MOST_LATITUDE_RAD: Final = math.pi / 2
_MOST_LONGITUDE_RAD: Final = 2 * math.pi
_SEMI_MAJOR_M: Final = 6_378_137.0
_FLATTENING: Final = 1 / 298.257223563
"""Of the ellipsoid WGS 84 (NIMA TR8350.2, 2000, table 3.1)."""


def reference_of(
    t_s: Floats,
    x: tuple[Floats, Quantity | None],
    y: tuple[Floats, Quantity | None],
    heading_rad: Floats | None,
    name: str,
    *,
    is_turned_round: bool = False,
) -> Reference | None:
    """Return the reference of columns or signals float64[n] in SI units, each with what it
    measures; None where fewer than two samples are whole.

    Angles are a longitude (x) and a latitude (y). Where both are zero to the last digit a receiver
    had no fix. A heading beside them that ran clockwise and *is turned round* is a compass's: it
    counts from north.

    Raises DiagnosisError for a length beside an angle, and for angles that are no such place.
    """
    (x_m, of_x), (y_m, of_y) = x, y
    if of_x != of_y:
        raise DiagnosisError(
            f"{name}: reference_x measures {of_x}, reference_y {of_y}: expected two lengths, or a "
            "longitude and a latitude"
        )
    known = np.isfinite(x_m) & np.isfinite(y_m)
    if heading_rad is not None:
        known &= np.isfinite(heading_rad)
    without_fix = known & (x_m == 0.0) & (y_m == 0.0) & (of_x == "angle")
    known &= ~without_fix
    if np.count_nonzero(known) < 2:
        return None
    x_m, y_m = x_m[known], y_m[known]
    if of_x == "angle":
        _refuse_no_places(y_m, x_m, name)
        x_m, y_m = east_north_m(y_m, x_m)
    if heading_rad is not None:
        heading_rad = heading_rad[known]
        if is_turned_round and of_x == "angle":
            heading_rad = heading_rad + 0.5 * math.pi
    return Reference(t_s[known], x_m, y_m, heading_rad, without_fix=int(without_fix.sum()))


def _refuse_no_places(latitude_rad: Floats, longitude_rad: Floats, name: str) -> None:
    wrong = np.abs(latitude_rad) > _MOST_LATITUDE_RAD
    wrong |= np.abs(longitude_rad) > _MOST_LONGITUDE_RAD
    if wrong.any():
        first = int(np.argmax(wrong))
        places = np.degrees([latitude_rad[first], longitude_rad[first]])
        raise DiagnosisError(
            f"{name}: a fix at latitude {places[0]:g}°, longitude {places[1]:g}°: expected at most "
            "90° and 360°; reference_x is the longitude, reference_y the latitude"
        )


def east_north_m(
    latitude_rad: Floats, longitude_rad: Floats, height_m: float = 0.0
) -> tuple[Floats, Floats]:
    """Return metres to the east and to the north of the first fix, float64[n] each, on the plane
    that touches WGS 84 there.

    All are laid at one height: what a receiver says of heights wanders by metres, and a metre more
    makes the ground larger by 0.16 millionths.
    """
    squared = _FLATTENING * (2 - _FLATTENING)
    sine = np.sin(latitude_rad)
    normal_m = _SEMI_MAJOR_M / np.sqrt(1 - squared * sine**2)
    from_axis_m = (normal_m + height_m) * np.cos(latitude_rad)
    along_axis_m = (normal_m * (1 - squared) + height_m) * sine
    away = longitude_rad - longitude_rad[0]
    outward_m = from_axis_m * np.cos(away) - from_axis_m[0]
    east_m = from_axis_m * np.sin(away)
    north_m = (along_axis_m - along_axis_m[0]) * np.cos(latitude_rad[0]) - outward_m * sine[0]
    return east_m, north_m
