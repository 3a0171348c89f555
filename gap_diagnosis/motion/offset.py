"""A first guess of how late the reference is stamped."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot

_SEARCH_S: Final = 0.5
_STEP_S: Final = 0.02
_WORTH_S: Final = 0.03


def coarse_delay_s(recording: Recording, robot: Robot) -> float:
    """Return reference stamp - log time, roughly; 0 where it is small or cannot be told.

    The turn of the reference over a fifth of a second is laid over the wheels' turn (or the
    speeds, where there is no orientation); the shift with the best correlation wins. The fit
    itself is never made on differentiated signals: this only chooses where it starts.
    """
    reference = recording.reference
    if reference is None or len(reference.t_s) < 20:
        return 0.0
    motion = estimate_motion(
        Recording(
            name=recording.name,
            tick_period_s=recording.tick_period_s,
            t_s=recording.t_s,
            stamp_s=recording.stamp_s,
            tick=recording.tick,
            left_ticks=recording.left_ticks,
            right_ticks=recording.right_ticks,
        ),
        robot,
    )
    grid = np.arange(motion.t_s[0], motion.t_s[-1], _STEP_S)
    if len(grid) < 100:
        return 0.0
    ours = np.diff(np.interp(grid, motion.t_s, motion.heading_rad))
    if reference.heading_rad is not None:
        theirs = np.diff(np.interp(grid, reference.t_s, reference.heading_rad))
    else:
        path = np.hypot(np.diff(reference.x_m), np.diff(reference.y_m))
        theirs = np.diff(np.interp(grid, reference.t_s[1:], np.cumsum(path)))
        ours = np.abs(
            np.diff(np.interp(grid, motion.t_s, np.cumsum(motion.speed_m_s * motion.dt_s)))
        )
    ours, theirs = (gaussian_filter1d(one, 0.1 / _STEP_S) for one in (ours, theirs))
    if ours.std() < 1e-9 or theirs.std() < 1e-9:
        return 0.0
    shifts = range(-round(_SEARCH_S / _STEP_S), round(_SEARCH_S / _STEP_S) + 1)
    edge = len(shifts)
    scores = []
    for shift in shifts:
        moved = np.roll(theirs, -shift)[edge:-edge]
        scores.append(abs(float(np.corrcoef(ours[edge:-edge], moved)[0, 1])))
    best = shifts[int(np.argmax(scores))] * _STEP_S
    return best if abs(best) >= _WORTH_S and max(scores) > scores[len(scores) // 2] + 1e-3 else 0.0
