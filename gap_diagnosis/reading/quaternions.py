"""Headings that a reference tells as quaternions."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NORM_TOLERANCE: Final = 0.05
_TURNING_M: Final = 0.5
_PARTS: Final = "xyzw"
_NAMES: Final = frozenset({"q", "quat", "quaternion", "ori", "orientation", "rot", "rotation"})


def heading_of(quaternions: Floats) -> Floats:
    """Return the turn about the vertical, float64[n], of unit quaternions x, y, z, w,
    float64[n, 4]; it may jump by a turn."""
    x, y, z, w = quaternions.T
    return np.asarray(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def is_no_unit(quaternions: Floats) -> NDArray[np.bool_]:
    """Tell which of float64[n, 4] are not of length 1, bool[n]; what is missing is not."""
    norm = np.sqrt(np.sum(quaternions**2, axis=1))
    return np.asarray(np.abs(norm - 1) > NORM_TOLERANCE)


def says_no_heading(heading_rad: Floats, x_m: Floats, y_m: Floats) -> bool:
    """Tell whether every pose has the same heading, float64[n], although its path bends."""
    return bool(np.ptp(heading_rad) == 0 and _bends(x_m, y_m))


def quaternion_columns(names: Iterable[str]) -> tuple[str, ...]:
    """Return the columns x, y, z and w of the one quaternion among *names*; none where there is
    none, or more than one.

    A name has a word for it and ends in the part, as ``qx``, ``orientation.z`` or ``q_RS_w []``.
    """
    found: dict[str, dict[str, str]] = {}
    for name in names:
        words = [word for word in re.split(r"[\W_]+", re.sub(r"[\[(].*", "", name).lower()) if word]
        if not words:
            continue
        *before, last = words
        if len(last) > 1 and last[:-1] in _NAMES:
            before, last = [*before, last[:-1]], last[-1]
        if last in _PARTS and _NAMES & set(before):
            found.setdefault(" ".join(before), {})[last] = name
    whole = [one for one in found.values() if len(one) == len(_PARTS)]
    return tuple(whole[0][part] for part in _PARTS) if len(whole) == 1 else ()


def _bends(x_m: Floats, y_m: Floats) -> bool:
    """Tell whether positions leave the line through their principal axis."""
    centred = np.stack([x_m - x_m.mean(), y_m - y_m.mean()])
    spread = np.linalg.svd(centred, full_matrices=False, compute_uv=False)
    return bool(spread[-1] / np.sqrt(len(x_m)) > 0.05 * _TURNING_M)
