"""How often a robot turned all around while its reference saw nothing.

Headings are known up to whole turns. From sample to sample the shorter way round is the right one,
but in a hole, or between two fixes a second apart, a robot turns by more than half a turn, and what
is counted on from there is off by a whole one. Wheels and gyro tell how often it went around.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.offset import coarse_delay_s, turns_of
from gap_diagnosis.recording import Floats, Recording
from hil_harness.robot import Robot

_FAR_RAD: Final = 0.5 * math.pi
"""What turns by less between two samples takes the shorter way round."""
_NEAR_RAD: Final = 1.0
"""Other steps tell by how much wheels or gyro turn too far: of so much at most, nobody counts one
turn too many."""
_ALIKE: Final = 0.8
"""What agrees less with the reference tells nothing of its turns."""


def with_whole_turns(recording: Recording, robot: Robot) -> Recording:
    """Return the recording with the turns put right that its reference made unseen."""
    reference = recording.reference
    if reference is None or reference.heading_rad is None or len(reference.t_s) < 2:
        return recording
    motion = estimate_motion(replace(recording, reference=None), robot)
    at_s = reference.t_s - coarse_delay_s(recording, robot)
    seen = np.diff(reference.heading_rad)
    inside = (at_s[:-1] >= motion.t_s[0]) & (at_s[1:] <= motion.t_s[-1])
    told = [np.diff(np.interp(at_s, motion.t_s, turn)) for turn in turns_of(motion)]
    alike, scale, turned = max(
        ((*_agreement(one, seen, inside), one) for one in told), key=lambda one: one[0]
    )
    foreseen = scale * turned
    if alike < _ALIKE:
        return recording
    missing = np.rint((foreseen - seen) / math.tau)
    missing[~inside | (np.abs(foreseen) < _FAR_RAD)] = 0.0
    if not missing.any():
        return recording
    heading_rad = reference.heading_rad.copy()
    heading_rad[1:] += math.tau * np.cumsum(missing)
    return replace(recording, reference=replace(reference, heading_rad=heading_rad))


def _agreement(turned: Floats, seen: Floats, inside: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the correlation, whatever its sign, of small steps of wheels or gyro with those of the
    reference, and the factor between them."""
    small = inside & (np.abs(turned) < _NEAR_RAD) & (np.abs(seen) < _NEAR_RAD)
    ours, theirs = turned[small], seen[small]
    power = float(ours @ ours)
    shared = float(ours @ theirs)
    if power == 0.0 or shared == 0.0:
        return 0.0, 1.0
    return abs(shared) / math.sqrt(power * float(theirs @ theirs)), shared / power
