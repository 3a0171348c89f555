"""Where a reference lost the robot is left out or put back, said, and no news of the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_outliers import drive, reference, with_x

from gap_diagnosis.analysis import analyse
from gap_diagnosis.lost_tracking import Leap, Lost, with_tracking
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording, Reference
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.effects import EffectSetting
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

ROBOT = load_robot()
NOISE = ReferenceNoise()
FROZEN = slice(1000, 1200)


def frozen() -> Reference:
    """Return a reference that repeats its last pose for two seconds of a figure of eight."""
    held = {}
    for name in ("x_m", "y_m", "heading_rad"):
        values = getattr(reference(), name).copy()
        values[FROZEN] = values[FROZEN.start - 1]
        held[name] = values
    return replace(reference(), **held)


def with_reference(changed: Reference) -> Recording:
    return replace(drive(), reference=changed)


def test_a_reference_that_holds_tracking_is_left_as_it_is() -> None:
    same, lost = with_tracking(drive(), ROBOT)
    assert lost == Lost()
    assert same is drive()


def test_poses_that_repeat_while_the_wheels_drive_are_left_out() -> None:
    cleaned, lost = with_tracking(with_reference(frozen()), ROBOT)
    assert cleaned.reference is not None
    assert lost.frozen == FROZEN.stop - FROZEN.start
    np.testing.assert_array_equal(
        cleaned.reference.t_s, np.delete(reference().t_s, np.arange(FROZEN.start, FROZEN.stop))
    )
    t_s = reference().t_s
    assert lost.windows == ((t_s[FROZEN.start], t_s[FROZEN.stop - 1]),)


def test_poses_that_fill_up_the_last_rows_are_left_out_and_no_loss() -> None:
    """A table whose last fifth of a second held the last pose had an unlisted cause (0.93)."""
    whole = reference()
    held = {name: getattr(whole, name).copy() for name in ("x_m", "y_m", "heading_rad")}
    for values in held.values():
        values[1500:] = values[1499]
    filled = replace(whole, **held).only(np.arange(len(whole.t_s)) < 1530)
    _, lost = with_tracking(with_reference(filled), ROBOT)
    assert lost.frozen == 30
    assert lost.as_ever == 1.0


def test_poses_that_fill_up_the_first_rows_are_all_left_out() -> None:
    """The first of them stayed: the pose of a third of a second later."""
    whole = reference()
    held = {name: getattr(whole, name).copy() for name in ("x_m", "y_m", "heading_rad")}
    begins = 800
    for values in held.values():
        values[:begins] = values[begins]
    filled = replace(whole, **held).only(np.arange(len(whole.t_s)) >= begins - 30)
    cleaned, lost = with_tracking(with_reference(filled), ROBOT)
    assert cleaned.reference is not None
    assert cleaned.reference.t_s[0] > whole.t_s[begins - 1]
    assert lost.as_ever == 1.0


def without_samples(hole: slice) -> Reference:
    there = np.ones(len(reference().t_s), dtype=np.bool_)
    there[hole] = False
    return reference().only(there)


def test_a_second_without_samples_while_the_wheels_drive_is_a_loss() -> None:
    same, lost = with_tracking(with_reference(without_samples(slice(1000, 1100))), ROBOT)
    assert lost.windows == ((reference().t_s[999], reference().t_s[1100]),)
    assert same.reference is not None
    assert len(same.reference.t_s) == len(reference().t_s) - 100, "the rest is as good as ever"


def test_a_reference_that_says_what_is_not_so_is_wrong_and_one_that_is_silent_may_always_be() -> (
    None
):
    """A healthy robot in a room with a blind corner was told an unlisted reference, 0.94."""
    window = (3.0, 4.5)
    assert Lost().as_ever == 1.0
    assert Lost(holes=(window,)).as_ever > 0.5
    for wrong in (Lost(frozen=9, stopped=(window,)), Lost(leaps=(Leap(3.0, 1.0, 0.0, 0.0),))):
        assert wrong.as_ever < 0.05


def test_so_is_one_while_the_robot_turns_on_the_spot() -> None:
    """Its middle goes no way then: a loss of 6.5 limits was none."""
    log = synthetic_recording(ROBOT, load_wire(), scenario("square"), (), 3, reference=NOISE)
    assert log.reference is not None
    assert log.w_command_rad_s is not None
    assert log.v_command_m_s is not None
    on_the_spot = (log.v_command_m_s == 0.0) & (log.w_command_rad_s != 0.0)
    start_s = log.t_s[int(np.argmax(on_the_spot))] + 0.2
    t_s = log.reference.t_s
    there = (t_s < start_s) | (t_s > start_s + 1.1)
    lost = with_tracking(replace(log, reference=log.reference.only(there)), ROBOT)[1]
    assert len(lost.holes) == 1


def test_every_motion_capture_blinks() -> None:
    log = with_reference(without_samples(slice(1000, 1080)))
    assert with_tracking(log, ROBOT)[1] == Lost()


def test_a_reference_that_says_a_pose_every_two_seconds_has_no_holes() -> None:
    seldom = np.arange(len(reference().t_s)) % 200 == 0
    log = with_reference(reference().only(seldom))
    assert with_tracking(log, ROBOT)[1] == Lost()


def test_while_a_robot_stands_its_reference_may_be_silent() -> None:
    stands = slice(1000, 1300)
    ticks = {}
    for name in ("left_ticks", "right_ticks"):
        ticks[name] = getattr(drive(), name).copy()
        ticks[name][stands] = ticks[name][stands.start]
        ticks[name][stands.stop :] -= ticks[name][stands.stop] - ticks[name][stands.start]
    log = replace(with_reference(without_samples(slice(1020, 1280))), **ticks)
    assert with_tracking(log, ROBOT)[1].holes == ()


def test_a_reference_without_noise_may_show_wheels_that_spin() -> None:
    """At rest it repeats itself too: that its pose stands still is no loss of tracking."""
    still = frozen()
    stands = slice(0, 120)
    for name in ("x_m", "y_m", "heading_rad"):
        values = getattr(still, name)
        values[stands] = values[0]
    resting = drive().left_ticks.copy(), drive().right_ticks.copy()
    for ticks in resting:
        ticks[stands] = ticks[stands.stop]
    recording = replace(with_reference(still), left_ticks=resting[0], right_ticks=resting[1])
    assert with_tracking(recording, ROBOT)[1].frozen == 0


def test_counters_that_tremble_at_rest_are_no_drive() -> None:
    """A count to and fro in every tick adds up to a way of metres, though the robot stands."""
    stands = slice(0, 500)
    held = {}
    for name in ("x_m", "y_m", "heading_rad"):
        held[name] = getattr(reference(), name).copy()
        held[name][stands] = held[name][0]
    ticks = {}
    for name in ("left_ticks", "right_ticks"):
        ticks[name] = getattr(drive(), name).copy()
        ticks[name][stands] = ticks[name][stands.stop] + np.arange(500) % 2
    recording = replace(with_reference(replace(reference(), **held)), **ticks)
    assert with_tracking(recording, ROBOT)[1].frozen == 0


@pytest.mark.parametrize("leap_m", [0.05, -0.3, 5.0])
def test_a_leap_is_put_back(leap_m: float) -> None:
    x_m = reference().x_m.copy()
    x_m[700:] += leap_m
    cleaned, lost = with_tracking(with_x(x_m), ROBOT)
    assert cleaned.reference is not None
    (leap,) = lost.leaps
    assert leap.t_s == reference().t_s[700]
    assert lost.windows == ((leap.t_s, leap.t_s),)
    np.testing.assert_allclose(cleaned.reference.x_m, reference().x_m, atol=2e-3)


@pytest.mark.parametrize("leap_m", [0.7, 1.4])
def test_a_receivers_leap_between_two_of_its_fixes_is_no_drift_over_five(leap_m: float) -> None:
    """Of four leaps of a real car's, 0.8 to 1.5 m, three were taken for the drift of five fixes,
    and one of them for a wheel that slipped by 9 % for 0.6 s."""
    every = slice(None, None, 20)
    fixes = Reference(*(getattr(reference(), name)[every] for name in ("t_s", "x_m", "y_m")), None)
    wander = 0.14 * leap_m * np.sin(np.outer([1.0, 1.3], fixes.t_s))
    gone = leap_m * (fixes.t_s > fixes.t_s[70])
    leapt = replace(fixes, x_m=fixes.x_m + wander[0] + gone, y_m=fixes.y_m + wander[1])
    (leap,) = with_tracking(with_reference(leapt), ROBOT)[1].leaps
    assert leap.t_s == fixes.t_s[71]
    assert leap.x_m == pytest.approx(leap_m, rel=0.2)


@pytest.mark.parametrize("every", [1, 10])
def test_what_wheels_could_do_is_no_leap(every: int) -> None:
    """Ten centimetres within a tenth of a second: a slip, a kick, not another marker."""
    x_m = reference().x_m.copy()
    x_m[700:] += 0.1 * np.clip(np.arange(len(x_m) - 700) / 10.0, 0.0, 1.0)
    moved = with_x(x_m)
    seldom = replace(reference(), x_m=x_m).only(np.arange(len(x_m)) % every == 0)
    assert with_tracking(replace(moved, reference=seldom), ROBOT)[1] == Lost()


def test_counts_that_leap_after_they_were_said_again_are_no_leaps_of_the_reference() -> None:
    values = (("frame", "ENCODER"), ("cycles", 12), ("probability", 0.005))
    stale = EffectSetting("stale_producer", values)
    wire = load_wire()
    log = synthetic_recording(
        ROBOT, wire, scenario("figure8"), (stale,), 3, reference=ReferenceNoise(), duration_s=30.0
    )
    assert with_tracking(log, ROBOT)[1].leaps, "else there is nothing to mistake"
    assert analyse(log, ROBOT, wire, default_prior()).lost == Lost()
