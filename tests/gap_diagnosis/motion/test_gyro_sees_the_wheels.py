"""What the gyro reads is the turn that the wheels make, trailed and late by all of it."""

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import EXACT, ROBOT, WIRE, nodes_of

from gap_diagnosis.explanations.registry import EXPLAINED, predict
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.manoeuvres import manoeuvres
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats, Reference
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

LATE_TICKS = 8
LAG_S = 0.05


@pytest.fixture(scope="module")
def motion() -> Motion:
    """A table's smooth motion."""
    log = synthetic_recording(ROBOT, WIRE, scenario("calibration"), (), seed=3, duration_s=30.0)
    return nodes_of(replace(log, frames={})).smooth


def setting(motion: Motion, effect: str, size: float) -> Setting:
    return next(iter(EXPLAINED[effect].variants(motion))), (size,)


def later(motion: Motion, rate: Floats) -> Floats:
    tick_s = float(np.median(motion.dt_s[1:]))
    return np.asarray(np.interp(motion.t_s - LATE_TICKS * tick_s, motion.t_s, rate))


def late(motion: Motion) -> Setting:
    return setting(motion, "frame_latency", LATE_TICKS * float(np.median(motion.dt_s[1:])))


def inside(motion: Motion, rate: Floats) -> Floats:
    """Leave out the ends, where a filter or a shift has no past."""
    return rate[100:-100]


def test_a_late_gyro_shows_its_lag_late(motion: Motion) -> None:
    lag = setting(motion, "gyro_lag", LAG_S)
    both = predict(motion, [late(motion), lag]).gyro_rad_s
    expected = later(motion, predict(motion, [lag]).gyro_rad_s)
    most = float(np.abs(motion.turn_rate_rad_s).max())
    # Ticks are even to the last digits of the times only.
    np.testing.assert_allclose(inside(motion, both), inside(motion, expected), atol=1e-6 * most)


def test_a_late_gyro_shows_the_turn_of_a_wider_wheelbase_late(motion: Motion) -> None:
    wider = setting(motion, "wheelbase_scale", 0.1)
    both = predict(motion, [late(motion), wider]).gyro_rad_s
    change = predict(motion, [wider]).turn_rad - predict(motion).turn_rad
    expected = later(motion, motion.turn_rate_rad_s + change / np.median(motion.dt_s[1:]))
    most = float(np.abs(motion.turn_rate_rad_s).max())
    np.testing.assert_allclose(inside(motion, both), inside(motion, expected), atol=1e-6 * most)


def test_the_gyro_sees_all_that_a_wheel_effect_changes_of_the_turn(motion: Motion) -> None:
    found, described = predict(motion, [setting(motion, "wheelbase_scale", 0.1)]), predict(motion)
    by_gyro = np.cumsum((found.gyro_rad_s - described.gyro_rad_s) * motion.dt_s)
    by_wheels = np.cumsum(found.turn_rad - described.turn_rad)
    most = float(np.abs(by_wheels).max())
    np.testing.assert_allclose(by_gyro, by_wheels, atol=1e-6 * most)


def test_without_an_effect_of_its_own_the_gyro_adds_nothing_to_the_wheels(motion: Motion) -> None:
    found = predict(motion, [setting(motion, "wheelbase_scale", 0.1)])
    assert not found.gyro_added_rad_s.any()


def test_what_a_reference_showed_of_a_larger_wheel_is_not_seen_by_the_gyro_twice() -> None:
    """The estimated turn is bent onto the reference: with the change once more a gyro that clips at
    80 % of a spin clipped a tenth too much, and had a room of another scale for company (0.998)."""
    larger = EffectSetting("radius_scale", (("scale", 0.02),))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("spin"), (larger,), seed=3, duration_s=20.0, reference=EXACT
    )
    smooth = nodes_of(log).smooth
    estimated = smooth.turn_rate_rad_s
    found = predict(smooth, [setting(smooth, "radius_scale", 0.02)]).turned_rad_s
    spinning = np.abs(estimated) > 0.9 * np.abs(estimated).max()
    assert spinning.sum() > 200
    by_wheels = (smooth.right_step_rad - smooth.left_step_rad) / smooth.tick_s
    truly = 1.02 * by_wheels * smooth.radius_m / smooth.wheelbase_m
    assert np.mean(found[spinning] / truly[spinning]) == pytest.approx(1.0, abs=0.002)


def test_before_a_reference_begins_the_gyro_sees_a_larger_wheel_by_that_alone() -> None:
    larger = EffectSetting("radius_scale", (("scale", 0.02),))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("spin"), (larger,), seed=3, duration_s=20.0, reference=EXACT
    )
    assert log.reference is not None
    late = log.reference.t_s > 0.5 * (log.t_s[0] + log.t_s[-1])
    heading = log.reference.heading_rad
    assert heading is not None
    kept = Reference(
        log.reference.t_s[late], log.reference.x_m[late], log.reference.y_m[late], heading[late]
    )
    smooth = nodes_of(replace(log, reference=kept)).smooth
    found = predict(smooth, [setting(smooth, "radius_scale", 0.02)])
    before = (smooth.bent == 0) & (np.abs(smooth.turn_rate_rad_s) > 0.5)
    assert before.sum() > 100
    ratio = found.turned_rad_s[before] / smooth.turn_rate_rad_s[before]
    assert float(np.median(ratio)) == pytest.approx(1.02, abs=0.002)


def test_a_gyros_scale_is_a_wheelbases_however_short_the_turns_are() -> None:
    """With encoders and gyro alone the two are one: (1 + s)(1 + w) = 1. Where a turn was hardly
    longer than the smoothing of its rate, a scale of 3 % was off by four times the gyro's noise."""
    (dithers,) = (one.scenario for one in manoeuvres() if one.file == "dithers.toml")
    log = synthetic_recording(ROBOT, WIRE, dithers, (), seed=3, reference=None)
    nodes = nodes_of(log)
    wider = 1e-3
    changes = []
    for effect, size in (("wheelbase_scale", wider), ("gyro_scale", 1 / (1 + wider) - 1)):
        told = predict(nodes.smooth, [setting(nodes.smooth, effect, size)])
        change = residuals(nodes, told)[3] - residuals(nodes, predict(nodes.smooth))[3]
        changes.append(np.diff(change))
    np.testing.assert_allclose(changes[0], changes[1], atol=0.02 * np.abs(changes[0]).max())


def test_wheels_that_speed_up_alike_slip_alike_whatever_their_counts_err() -> None:
    """What one wheel's counts sped up more than the other's, on a straight nothing but their noise,
    gave a slip and a lag something to cancel that noise by: a healthy robot that stopped and went
    without a reference had both, > 99.9 %."""
    log = synthetic_recording(ROBOT, WIRE, scenario("stop_and_go"), (), seed=3, reference=None)
    nodes = nodes_of(log)
    slips = predict(nodes.smooth, [setting(nodes.smooth, "longitudinal_slip", 0.06)])
    change = residuals(nodes, slips)[3] - residuals(nodes, predict(nodes.smooth))[3]
    counts = np.diff(residuals(nodes, predict(nodes.motion))[3])
    assert float(np.diff(change).std()) < 0.01 * float(counts.std())
