"""What a robot turns while its reference does not see it, its wheels and its gyro count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from motion_cases import ROBOT, WIRE
from numpy.typing import NDArray

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.reading.angles import unwrapped
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.whole_turns import with_whole_turns
from hil_harness.scenarios import scenario

SPIN = replace(scenario("spin"), effects=())
WHOLE = synthetic_recording(ROBOT, WIRE, SPIN, (), 1, reference=ReferenceNoise())
"""A robot that turns by nearly 8 rad in five seconds."""


CALIBRATION = synthetic_recording(
    ROBOT, WIRE, replace(scenario("calibration"), effects=()), (), 1, reference=ReferenceNoise()
)


def headings(recording: Recording) -> Floats:
    """Return the reference's headings."""
    assert recording.reference is not None
    assert recording.reference.heading_rad is not None
    return recording.reference.heading_rad


def read_again(whole: Recording, kept: NDArray[np.bool_], sense: float = 1.0) -> Recording:
    """Return a drive with these samples of its reference, as a file of them is read: turns are
    counted from each to the next."""
    assert whole.reference is not None
    reference = whole.reference.only(kept)
    within = np.angle(np.exp(1j * sense * headings(whole)[kept]))
    return replace(whole, reference=replace(reference, heading_rad=unwrapped(within)))


def seen_but_from(whole: Recording, start_s: float, stop_s: float) -> NDArray[np.bool_]:
    """Return which samples a reference has that loses the robot from then to then, bool[s]."""
    assert whole.reference is not None
    return (whole.reference.t_s < start_s) | (whole.reference.t_s > stop_s)


@pytest.mark.full_size
@given(
    start_s=st.floats(5.0, 75.0), lasts_s=st.floats(1.0, 20.0), sense=st.sampled_from([1.0, -1.0])
)
def test_a_turn_in_a_hole_is_counted_whichever_way_a_reference_counts(
    start_s: float, lasts_s: float, sense: float
) -> None:
    kept = seen_but_from(WHOLE, start_s, start_s + lasts_s)
    found = headings(with_whole_turns(read_again(WHOLE, kept, sense), ROBOT))
    off = found - sense * headings(WHOLE)[kept]
    np.testing.assert_allclose(off, off[0], atol=1e-9)


@pytest.mark.parametrize("every", [200, 300, 400])
def test_a_turn_between_two_fixes_seconds_apart_is_counted(every: int) -> None:
    kept = np.arange(len(headings(WHOLE))) % every == 0
    found = headings(with_whole_turns(read_again(WHOLE, kept), ROBOT))
    off = found - headings(WHOLE)[kept]
    np.testing.assert_allclose(off, off[0], atol=1e-9)


def test_what_is_seen_all_the_time_stays_as_it_is() -> None:
    assert with_whole_turns(WHOLE, ROBOT) is WHOLE


def test_a_reference_that_turns_otherwise_than_wheels_and_gyro_is_believed() -> None:
    holed = read_again(WHOLE, seen_but_from(WHOLE, 40.0, 46.0))
    assert holed.reference is not None
    steps = np.random.default_rng(1).normal(0.0, 0.02, len(headings(holed)))
    other = replace(holed, reference=replace(holed.reference, heading_rad=np.cumsum(steps)))
    assert with_whole_turns(other, ROBOT) is other


def test_a_healthy_robot_that_turns_around_unseen_has_no_gap() -> None:
    turned = read_again(CALIBRATION, seen_but_from(CALIBRATION, 60.3, 62.4))
    assert diagnose_recordings([turned], ROBOT, WIRE).diagnosis.verdict == "no_gap"
