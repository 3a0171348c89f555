"""A reference whose clock was never set by the log's is moved; one that is late is not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from diagnosed import ROBOT, WIRE

from gap_diagnosis.clock_setting import UNSET_S, with_clock_set
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.motion.offset import coarse_delay_s
from gap_diagnosis.reading.reference_file import refuse_no_overlap
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting, parse_effect
from hil_harness.scenarios import scenario


@cache
def drive(*effects: EffectSetting) -> Recording:
    return synthetic_recording(
        ROBOT, WIRE, scenario("random"), effects, 3, reference=ReferenceNoise(), duration_s=60.0
    )


def late(recording: Recording, by_s: float, *, has_heading: bool = True) -> Recording:
    reference = recording.reference
    assert reference is not None
    heading = reference.heading_rad if has_heading else None
    moved = replace(reference, t_s=reference.t_s + by_s, heading_rad=heading)
    return replace(recording, reference=moved)


@pytest.mark.parametrize("late_s", [0.0, 0.4, -0.4])
def test_what_an_effect_may_be_late_by_is_left_as_it_is(late_s: float) -> None:
    recording = late(drive(), late_s)
    assert with_clock_set(recording, ROBOT) == (recording, 0.0)


@pytest.mark.parametrize("late_s", [1.5, 8.0, -20.0])
@pytest.mark.parametrize("has_heading", [True, False])
def test_a_clock_that_was_never_set_is_found(late_s: float, has_heading: bool) -> None:
    moved, found_s = with_clock_set(late(drive(), late_s, has_heading=has_heading), ROBOT)
    assert found_s == pytest.approx(late_s, abs=ROBOT.tolerance.time_offset_s)
    assert moved.reference is not None
    assert moved.reference.t_s[0] == pytest.approx(late_s - found_s)


def test_beside_a_large_effect_it_is_found_to_what_is_free_from_then_on() -> None:
    recording = drive(parse_effect("turn_scrub.scrub=0.3"))
    _, found_s = with_clock_set(late(recording, 8.0), ROBOT)
    assert found_s == pytest.approx(8.0, abs=0.5 * UNSET_S)


@pytest.mark.parametrize("late_s", [0.0, 8.0])
def test_a_dead_encoder_does_not_move_the_clock_for_the_gyro_knows_the_turns(late_s: float) -> None:
    recording = drive(EffectSetting("encoder_dead", (("side", "left"), ("start_s", 10.0))))
    _, found_s = with_clock_set(late(recording, late_s), ROBOT)
    assert found_s == pytest.approx(late_s, abs=0.5 * UNSET_S)
    assert not coarse_delay_s(recording, ROBOT).any()


@pytest.mark.parametrize("late_s", [0.7, -0.9])
def test_by_speeds_alone_a_reference_is_known_to_be_late_by_more_than_half_a_second(
    late_s: float,
) -> None:
    """A car's was late by 1 s: near enough for no clock to be set, too far to be looked for; it was
    a slip, an arm of 1.3 m and 0.976 s."""
    (found_s,) = set(coarse_delay_s(late(drive(), late_s, has_heading=False), ROBOT))
    assert found_s == pytest.approx(late_s, abs=0.01)


def test_clocks_that_have_nothing_in_common_are_set_by_the_drive() -> None:
    recording = late(drive(), 1.7e9)
    assert recording.reference is not None
    refuse_no_overlap(recording.reference, recording, "reference.tum", ROBOT)
    moved, _ = with_clock_set(recording, ROBOT)
    assert moved.reference is not None
    assert moved.reference.t_s[0] == pytest.approx(0.0, abs=ROBOT.tolerance.time_offset_s)


def test_another_drive_on_another_clock_is_refused() -> None:
    recording = drive()
    other = synthetic_recording(
        ROBOT, WIRE, scenario("square"), (), 3, reference=ReferenceNoise(), duration_s=60.0
    )
    reference = late(other, 1.7e9).reference
    assert reference is not None
    with pytest.raises(DiagnosisError, match="tells how far the clocks are apart"):
        refuse_no_overlap(reference, recording, "reference.tum", ROBOT)
