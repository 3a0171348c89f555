"""What is put right in a recording before it is compared with anything: none of it is a gap."""

from __future__ import annotations

from dataclasses import dataclass

from gap_diagnosis.clock_setting import with_clock_set
from gap_diagnosis.lost_tracking import Lost, with_tracking
from gap_diagnosis.motion.blanks import without_blanks
from gap_diagnosis.recording import Recording
from gap_diagnosis.reference_mistakes import Mistake, with_reference_put_right
from gap_diagnosis.speed_means import with_means_added_up
from gap_diagnosis.whole_turns import with_whole_turns
from hil_harness.robot import Robot


@dataclass(frozen=True)
class Prepared:
    """A recording with its reference put right.

    Attributes:
        recording: what is left to compare.
        mistake: of the reference's set-up.
        late_s: by how much the reference's stamps were moved: its clock was never set.
        lost: where the reference lost the robot.
    """

    recording: Recording
    mistake: Mistake | None
    late_s: float
    lost: Lost


def prepared(recording: Recording, robot: Robot, without: frozenset[str] = frozenset()) -> Prepared:
    """Return the recording with its reference put right: each step stands on those before it."""
    recording, mistake = with_reference_put_right(recording, robot, without)
    recording, late_s = with_clock_set(recording, robot)
    recording = with_means_added_up(recording, robot)
    recording = with_whole_turns(recording, robot)
    recording, lost = with_tracking(recording, robot)
    return Prepared(without_blanks(recording), mistake, late_s, lost)
