"""Deviations from the estimated motion are exact to first order, however long the drive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import EXACT, ROBOT, WIRE, Floats, nodes_of, without_noise
from scipy.interpolate import CubicSpline

from gap_diagnosis.explanations.registry import EXPLAINED, predict
from gap_diagnosis.motion import nodes as nodes_module
from gap_diagnosis.motion.nodes import _along, residuals, steps_of
from gap_diagnosis.prediction import Prediction
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.scenarios import scenario

RECORDING = synthetic_recording(
    without_noise(ROBOT), WIRE, scenario("figure8"), (), 1, reference=EXACT
)
NODES = nodes_of(RECORDING)


def exact_pose(prediction: Prediction) -> tuple[Floats, Floats, Floats]:
    """Return the predicted steps integrated without any linearisation, from the estimated start."""
    motion = prediction.motion
    heading = motion.heading_rad[0] + np.cumsum(prediction.turn_rad) - prediction.turn_rad[0]
    middle = heading - 0.5 * np.diff(heading, prepend=heading[0])
    forward, lateral = prediction.forward_m, prediction.lateral_m
    x = np.cumsum(forward * np.cos(middle) - lateral * np.sin(middle))
    y = np.cumsum(forward * np.sin(middle) + lateral * np.cos(middle))
    return motion.x_m[0] + x - x[0], motion.y_m[0] + y - y[0], heading


def block_means(values: Floats) -> Floats:
    at = values[NODES.sample_tick]
    return np.add.reduceat(at, NODES.sample_starts) / NODES.samples


def second_order_error(effect: str, size: float) -> float:
    """Return how far the linear change of the reference's residuals is from the exact one."""
    variant, *_ = EXPLAINED[effect].variants(NODES.motion)
    nominal, changed = predict(NODES.motion), predict(NODES.motion, [(variant, (size,))])
    linear = residuals(NODES, nominal) - residuals(NODES, changed)
    errors = []
    for channel, (before, after) in enumerate(
        zip(exact_pose(nominal), exact_pose(changed), strict=True)
    ):
        exact = block_means(after - before)
        errors.append(np.abs(linear[channel, NODES.sample_node] - exact).max())
    return max(errors)


@pytest.mark.parametrize(
    "effect", ["radius_scale", "radius_mismatch", "wheelbase_scale", "lateral_slip"]
)
def test_the_deviation_is_the_exact_integral_to_second_order(effect):
    large, small = second_order_error(effect, 0.004), second_order_error(effect, 0.001)
    # A quarter of the size leaves a sixteenth of the error, but for what both begin with.
    assert small < large / 8 + 1e-6
    assert large < 0.2


def test_what_the_estimated_motion_did_is_worked_out_once_for_all_predictions(monkeypatch):
    """A search makes thousands of predictions, and most of their time went into angles' cosines."""
    nodes, calls = replace(NODES), []

    def counted(motion):
        calls.append(motion)
        return steps_of(motion)

    monkeypatch.setattr(nodes_module, "steps_of", counted)
    first, second = (residuals(nodes, predict(nodes.motion)) for _ in range(2))
    assert np.array_equal(first, second, equal_nan=True)
    assert len(calls) == 1


def test_without_effects_and_noise_the_description_is_the_log():
    left = residuals(NODES, predict(NODES.motion))
    count_m = NODES.motion.radius_m * NODES.motion.rad_per_count
    assert np.nanmax(np.abs(left[:2])) < 20 * count_m
    assert np.nanmax(np.abs(left[2:])) < 20 * count_m / NODES.motion.wheelbase_m


def test_a_lever_arm_lies_where_the_robot_points_however_far_dead_reckoning_has_drifted():
    (lever,) = EXPLAINED["reference_lever_arm"].variants(NODES.motion)
    (bent,) = EXPLAINED["radius_mismatch"].variants(NODES.motion)
    turned = (bent, (0.5,))
    without = residuals(NODES, predict(NODES.motion, [turned]))
    with_lever = residuals(NODES, predict(NODES.motion, [turned, (lever, (0.1, 0.0))]))
    heading = block_means(NODES.motion.heading_rad)
    change = (without - with_lever)[:2, NODES.sample_node]
    np.testing.assert_allclose(change[0], 0.1 * np.cos(heading), atol=1e-3)
    np.testing.assert_allclose(change[1], 0.1 * np.sin(heading), atol=1e-3)


def test_blocks_hold_every_tick_and_every_sample_once():
    assert NODES.ticks.sum() == len(NODES.motion.t_s)
    assert NODES.samples.sum() == len(NODES.sample_tick)
    np.testing.assert_allclose(NODES.mean(np.ones(len(NODES.motion.t_s))), 1.0)


def test_what_is_not_kept_is_compared_nowhere():
    reference = replace(RECORDING.reference, x_m=RECORDING.reference.x_m.copy())
    reference.x_m[100:200] = np.nan
    nodes = nodes_of(replace(RECORDING, reference=reference))
    left = residuals(nodes, predict(nodes.motion))
    assert np.isnan(left[0, 22:38]).all()
    assert np.isfinite(left[3]).all()


def test_a_rooms_scale_stretches_the_way_and_not_the_noise_of_the_reference():
    wander = 0.1 * np.sin(np.arange(len(RECORDING.reference.t_s)) / 300)
    noisy = replace(RECORDING.reference, x_m=RECORDING.reference.x_m + wander)
    (scale,) = EXPLAINED["reference_scale"].variants(NODES.motion)
    changes = []
    for nodes in (NODES, nodes_of(replace(RECORDING, reference=noisy))):
        stretched = residuals(nodes, predict(nodes.motion, [(scale, (1.0,))]))
        changes.append(residuals(nodes, predict(nodes.motion)) - stretched)
    assert np.nanmax(np.abs(changes[1][:2] - changes[0][:2])) < 0.01


def test_a_delay_leads_back_along_the_way_however_far_the_wheels_own_heading_has_drifted():
    bent = replace(RECORDING, right_ticks=1.05 * RECORDING.right_ticks)
    nodes = nodes_of(bent)
    drift = nodes.described[2, -1] - nodes.motion.heading_rad[-1]
    assert abs(drift) > 1.0
    (late,) = EXPLAINED["reference_time_offset"].variants(nodes.motion)
    change = residuals(nodes, predict(nodes.motion))
    change -= residuals(nodes, predict(nodes.motion, [(late, (0.1,))]))
    for channel, way in enumerate((nodes.sample_x_m, nodes.sample_y_m)):
        back = np.interp(nodes.sample_t_s - 0.1, nodes.sample_t_s, way) - way
        means = np.add.reduceat(back, nodes.sample_starts) / nodes.samples
        np.testing.assert_allclose(change[channel, nodes.sample_node][5:], means[5:], atol=0.004)


def test_a_short_delay_leads_along_the_same_way_as_a_long_one_where_stamps_jitter():
    """Counts that are late by what the reference is late by are no news, whatever the steps."""
    jitter_s = 0.001 * np.random.default_rng(1).random(len(RECORDING.t_s))
    nodes = nodes_of(replace(RECORDING, t_s=RECORDING.t_s + jitter_s))
    (late,) = EXPLAINED["reference_time_offset"].variants(nodes.motion)

    def per_second(delay_s: float) -> np.ndarray:
        ahead, behind = (
            residuals(nodes, predict(nodes.motion, [(late, (sign * delay_s,))])) for sign in (1, -1)
        )
        return (behind - ahead)[:2] / (2 * delay_s)

    short, long = per_second(0.002), per_second(0.02)
    apart = np.sqrt(np.nanmean((short - long) ** 2) / np.nanmean(long**2))
    # Of a way that turns and speeds up within a second, the third order over 20 ms.
    assert apart < 0.02**2 / 6 / 0.1**2


def test_a_wheel_that_counts_to_and_fro_at_rest_does_not_move():
    """In an hour of it a slip of more than the whole way would take the counts' noise away."""
    stands_s = 30.0
    log = synthetic_recording(
        ROBOT, WIRE, scenario("random"), (), 3, reference=EXACT, duration_s=120.0 + stands_s
    )
    nodes = nodes_of(log)
    late = nodes.motion.t_s > log.t_s[-1] - 0.5 * stands_s
    assert np.count_nonzero(nodes.motion.left_step_rad[late]) > 100
    assert not nodes.smooth.left_step_rad[late].any()


def test_counts_that_are_late_are_early_for_gyro_and_reference_alike():
    late_s = 3 * RECORDING.tick_period_s
    counts = {
        name: np.concatenate([np.repeat(values[:1], 3), values[:-3]])
        for name, values in (
            ("left_ticks", RECORDING.left_ticks),
            ("right_ticks", RECORDING.right_ticks),
        )
    }
    nodes = nodes_of(replace(RECORDING, frames={}, **counts))
    (variant,) = (
        one
        for one in EXPLAINED["frame_latency"].variants(nodes.motion)
        if one.report["frame"] == "ENCODER"
    )
    before = residuals(nodes, predict(nodes.motion))
    after = residuals(nodes, predict(nodes.motion, [(variant, (late_s,))]))
    for channel in range(4):
        assert np.nanstd(after[channel]) < 0.1 * np.nanstd(before[channel])


def test_counts_and_reference_late_by_the_same_are_not_late_for_each_other():
    prediction = Prediction(NODES.motion)
    prediction.encoder_delay_s = prediction.reference_delay_s = 0.02
    together, described = residuals(NODES, prediction), residuals(NODES, Prediction(NODES.motion))
    assert together[:3, NODES.sample_node] == pytest.approx(described[:3, NODES.sample_node], abs=0)


def test_a_log_that_begins_in_motion_begins_with_no_stop():
    """Its first step is unknown; taken for none, what was rounded off there was a jump of eight
    steps, and a constant drive told when its reference began."""
    motion = nodes_of(synthetic_recording(ROBOT, WIRE, scenario("lesson"), (), 1)).sharp
    usual = motion.left_step_rad[20:60].mean()
    assert motion.left_step_rad[1:20] == pytest.approx(usual, rel=0.15)


def test_the_way_at_stamps_that_jitter_is_the_splines_to_the_last_digit() -> None:
    spline = CubicSpline(np.arange(50.0), np.random.default_rng(3).normal(size=(3, 50)), axis=1)
    t_s = np.linspace(0.0, 49.0, 400) + np.random.default_rng(4).normal(0.0, 0.5, 400)
    t_s = np.clip(t_s, 0.0, 49.0)
    assert np.array_equal(_along(spline.c, spline.x, t_s), spline(t_s))
