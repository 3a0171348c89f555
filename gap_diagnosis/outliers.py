"""Reference samples that cannot be: lost markers and wrong fixes, left out and counted."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.offset import coarse_delay_s
from gap_diagnosis.recording import Floats, Recording
from hil_harness.robot import Robot

_NEIGHBOURS: Final = 11
_FAR: Final = 15.0
"""In standard deviations: Student's noise of five degrees of freedom gets there once in 10^5."""
_LEAST: Final = 0.005
"""[m, rad]"""
_MOST: Final = 0.02
"""Where more samples than this share are far off, that is how the reference measures."""


def without_outliers(recording: Recording, robot: Robot) -> tuple[Recording, int]:
    """Return the recording without reference samples far off their neighbours, and their count.

    A sample is compared with what dead reckoning leaves of the ten samples around it, by the
    median, so that a run of up to five wrong ones is seen. Robust scale: the median absolute
    deviation (Rousseeuw and Croux 1993).
    """
    reference = recording.reference
    if reference is None or len(reference.t_s) < 2 * _NEIGHBOURS:
        return recording, 0
    delay_s = coarse_delay_s(recording, robot)
    motion = estimate_motion(recording, robot, reference_delay_s=delay_s)
    stamps = reference.t_s - delay_s
    pairs = [(reference.x_m, motion.x_m), (reference.y_m, motion.y_m)]
    if reference.heading_rad is not None:
        pairs.append((reference.heading_rad, motion.heading_rad))
    far = np.zeros(len(stamps), dtype=np.bool_)
    for measured, estimated in pairs:
        far |= _far(measured - np.interp(stamps, motion.t_s, estimated))
    count = int(far.sum())
    if not 0 < count <= _MOST * len(far):
        return recording, 0
    return replace(recording, reference=reference.only(~far)), count


def _far(residual: Floats) -> NDArray[np.bool_]:
    known = np.where(np.isfinite(residual), residual, 0.0)
    off = np.abs(known - median_filter(known, _NEIGHBOURS, mode="nearest"))
    return np.asarray(off > max(_FAR * 1.4826 * float(np.median(off)), _LEAST))
