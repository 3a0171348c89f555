"""A reference whose headings are no more than the way from one of its positions to the next."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from gap_diagnosis.reading.angles import within_half_a_turn
from gap_diagnosis.recording import Floats, Reference

_SAME_RAD: Final = 2e-3
_NEARLY_ALL: Final = 0.95
_LEAPS_RAD: Final = 0.5
_LEAPING: Final = 0.01
"""No robot turns so far between two samples of a hundred: where it stands, a course is noise."""


def without_courses(reference: Reference) -> tuple[Reference, tuple[str, ...]]:
    """Return the reference without headings that were made of its own positions, and a note of it:
    they say nothing more than those, and nothing of a robot that stands, turns on the spot or backs
    up."""
    heading = reference.heading_rad
    if heading is None or not _are_courses(reference.x_m, reference.y_m, heading):
        return reference, ()
    note = "The reference's headings are the course of its positions and were left out."
    return replace(reference, heading_rad=None), (note,)


def _are_courses(x_m: Floats, y_m: Floats, heading_rad: Floats) -> bool:
    """Tell whether headings follow from the step before, the next one or both, and leap."""
    if np.mean(np.abs(within_half_a_turn(np.diff(heading_rad))) > _LEAPS_RAD) < _LEAPING:
        return False
    x_step, y_step = np.diff(x_m), np.diff(y_m)
    return any(
        _agree(x, y, heading)
        for x, y, heading in (
            (x_step, y_step, heading_rad[1:]),
            (x_step, y_step, heading_rad[:-1]),
            (x_step[1:] + x_step[:-1], y_step[1:] + y_step[:-1], heading_rad[1:-1]),
        )
    )


def _agree(x_m: Floats, y_m: Floats, heading_rad: Floats) -> bool:
    moved = np.hypot(x_m, y_m) > 0.0
    off = np.abs(within_half_a_turn(heading_rad - np.arctan2(y_m, x_m)))[moved]
    return len(off) > 0 and bool(np.mean(off < _SAME_RAD) > _NEARLY_ALL)
