"""A reference whose poses were put on straight lines between those that were measured."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.recording import Floats, Ints, Reference

_MOST_DECIMALS: Final = 9
_ROUNDED: Final = 1.5
"""By so many steps of its digits a pose may lie beside the line that it was put on."""
_CLOSE: Final = 5.0
"""Poses off a line by no more than so many times that may be near it by chance;"""
_BY_CHANCE: Final = 0.3
"""if so many of those that are off are no farther, those on lines may be there by chance too."""
_THE_RULE: Final = 0.25
"""If so many of the poses are on lines, that is how the reference was made."""
_SIZES: Final = 15
"""Places on a grid lie off lines by fewer sizes than that, told apart to a hundredth."""
_BENDS: Final = 20
"""A robot on straight lines stops and turns fewer times."""
_ALONE: Final = 0.95
"""Where lines meet one pose or two lie beside both; in the curve of a robot lie many."""


def without_interpolated_poses(reference: Reference) -> tuple[Reference, tuple[str, ...]]:
    """Return the reference with nothing but the poses between which the others lie on straight
    lines in time, and a note of it.

    A robot that turns was not on those lines, nor was one that sped up as far along them. Where two
    of them meet something was measured.
    """
    on_lines = _on_lines(reference)
    first, last = _bends(on_lines)
    if first.size < _BENDS:
        return reference, ()
    poses = [reference.x_m, reference.y_m]
    poses += [] if reference.heading_rad is None else [reference.heading_rad]
    t_s, met = _where_lines_meet(reference.t_s, np.stack(poses, axis=-1), first, last)
    note = (
        f"{np.count_nonzero(on_lines):,} of the reference's {on_lines.size:,} poses lie on "
        f"straight lines between others: only the {first.size:,} where these meet were measured."
    )
    heading_rad = None if reference.heading_rad is None else met[:, 2]
    measured = replace(reference, t_s=t_s, x_m=met[:, 0], y_m=met[:, 1], heading_rad=heading_rad)
    return measured, (note,)


def _on_lines(reference: Reference) -> NDArray[np.bool_]:
    """Tell, bool[m], which poses lie on the line between their neighbours, if that is the rule."""
    t_s, x_m, y_m = reference.t_s, reference.x_m, reference.y_m
    none = np.zeros(len(t_s), dtype=np.bool_)
    if len(t_s) < 3:
        return none
    off_m = np.hypot(_beside_line(t_s, x_m), _beside_line(t_s, y_m))
    digits_m = _ROUNDED * max(_last_digit(x_m), _last_digit(y_m))
    digits_m += 1e-12 * float(max(np.abs(x_m).max(), np.abs(y_m).max()))
    inside = off_m <= digits_m
    if reference.heading_rad is not None:
        off_rad = np.abs(_beside_line(t_s, reference.heading_rad))
        inside &= off_rad <= _ROUNDED * _last_digit(reference.heading_rad) + 1e-6
    beside_m = off_m[~inside]
    by_chance = np.sum(beside_m <= _CLOSE * digits_m)
    sizes = np.unique(np.rint(100.0 * np.log(beside_m[beside_m > 0.0])))
    is_rule = np.mean(inside) >= _THE_RULE and by_chance <= _BY_CHANCE * len(beside_m)
    if not is_rule or len(sizes) < _SIZES:
        return none
    return np.concatenate(([False], inside, [False]))


def _beside_line(t_s: Floats, values: Floats) -> Floats:
    """Return how far each value but the ends is off the line between its neighbours."""
    share = (t_s[1:-1] - t_s[:-2]) / (t_s[2:] - t_s[:-2])
    return np.asarray(values[1:-1] - values[:-2] - share * (values[2:] - values[:-2]))


def _last_digit(values: Floats) -> float:
    """Return the step of a column's last decimal; nothing where it has more than any file's."""
    for decimals in range(_MOST_DECIMALS + 1):
        scaled = values * 10.0**decimals
        if np.all(np.abs(scaled - np.rint(scaled)) < 1e-5):
            return float(10.0**-decimals)
    return 0.0


def _bends(on_lines: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Return the first and the last pose of each run between lines, if no more than a few runs are
    longer than where two lines meet."""
    nothing = np.zeros(0, dtype=np.int64)
    if not on_lines.any():
        return nothing, nothing
    change = np.diff(on_lines.astype(np.int64))
    ends, starts = np.flatnonzero(change == -1) + 1, np.flatnonzero(change == 1)
    first, last = ends[:-1], starts[1:]
    lengths = last - first + 1
    alone = lengths <= 2
    if np.sum(lengths[alone]) < _ALONE * np.sum(lengths):
        return nothing, nothing
    return first[alone], last[alone]


def _where_lines_meet(t_s: Floats, poses: Floats, first: Ints, last: Ints) -> tuple[Floats, Floats]:
    """Return when and where the line that ends at each pose of *first*, int64[n], meets the one
    that begins at *last*: float64[n] and float64[n, k] of *poses*, float64[m, k]."""
    before = (poses[first] - poses[first - 1]) / (t_s[first] - t_s[first - 1])[:, None]
    after = (poses[last + 1] - poses[last]) / (t_s[last + 1] - t_s[last])[:, None]
    apart_s = t_s[last] - t_s[first]
    turns = after - before
    gap = poses[last] - poses[first] - after * apart_s[:, None]
    size = np.sum(turns**2, axis=1)
    since_s = -np.sum(turns * gap, axis=1) / np.where(size > 0.0, size, 1.0)
    since_s = np.clip(since_s, 0.0, apart_s)
    return t_s[first] + since_s, poses[first] + before * since_s[:, None]
