"""Reference samples that cannot be: lost markers and wrong fixes, left out and counted."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.offset import coarse_delay_s
from gap_diagnosis.recording import Floats, Recording, Reference
from hil_harness.robot import Robot

_NEIGHBOURS: Final = 11
_FAR: Final = 15.0
"""In standard deviations: Student's noise of five degrees of freedom gets there once in 10^5."""
_LEAST: Final = 0.005
"""[m, rad]"""
_BESIDE: Final = 4.0
"""Times as far off as those around it: where wheels turn otherwise than described, all are off."""
_MOST: Final = 0.1
"""Where more samples than this share are far off, that is how the reference measures."""
_ROUNDS: Final = 4

Bools = NDArray[np.bool_]


def without_outliers(recording: Recording, robot: Robot) -> tuple[Recording, int]:
    """Return the recording without reference samples far off their neighbours, and their count.

    A sample is compared with what dead reckoning leaves of the ten samples around it, by the
    median, so that a run of up to five wrong ones is seen. Robust scale: the median absolute
    deviation (Rousseeuw and Croux 1993). Dead reckoning is bent onto the reference, and a wrong
    sample bends it beside its good neighbours; so it is asked again without those that were found,
    until none comes or goes.
    """
    reference = recording.reference
    if reference is None or len(reference.t_s) < 2 * _NEIGHBOURS:
        return recording, 0
    delay_s = coarse_delay_s(recording, robot)
    far = np.zeros(len(reference.t_s), dtype=np.bool_)
    for _ in range(_ROUNDS):
        found = _far_off(recording, robot, reference, delay_s, far)
        is_settled = np.array_equal(found, far)
        far = found
        if is_settled or far.mean() > 0.5:
            break
    count = int(far.sum())
    if not 0 < count <= _MOST * len(far):
        return recording, 0
    return replace(recording, reference=reference.only(~far)), count


def _far_off(
    recording: Recording, robot: Robot, reference: Reference, delay_s: Floats, without: Bools
) -> Bools:
    """Return which samples are far off a motion that is bent onto all but those in *without*."""
    motion = estimate_motion(
        replace(recording, reference=reference.only(~without)),
        robot,
        reference_delay_s=delay_s[~without],
    )
    stamps = reference.t_s - delay_s
    pairs = [(reference.x_m, motion.x_m), (reference.y_m, motion.y_m)]
    if reference.heading_rad is not None:
        pairs.append((reference.heading_rad, motion.heading_rad))
    far = np.zeros(len(stamps), dtype=np.bool_)
    for measured, estimated in pairs:
        far |= _far(measured - np.interp(stamps, motion.t_s, estimated))
    return far


def _far(residual: Floats) -> Bools:
    known = np.where(np.isfinite(residual), residual, 0.0)
    off = np.abs(known - median_filter(known, _NEIGHBOURS, mode="nearest"))
    beside = 1.4826 * median_filter(off, _NEIGHBOURS, mode="nearest")
    least = max(_FAR * 1.4826 * float(np.median(off)), _LEAST)
    return np.asarray((off > least) & (off > _BESIDE * beside))
