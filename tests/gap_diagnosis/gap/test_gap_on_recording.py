"""The gap of whole drives whose only effect is known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gap_cases import LEVELS, drives, setting

from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.explanations.variant import Setting, Variant
from gap_diagnosis.gap.drive_path import commanded_path
from gap_diagnosis.gap.holdout import hold_out
from gap_diagnosis.gap.how_far import gap_of, metrics_of
from gap_diagnosis.gap.manoeuvres import kinds_of
from gap_diagnosis.gap.on_recording import (
    Replayed,
    compare,
    compare_all,
    floor_on,
    levels_of,
    odometry_rms,
    recorded_odometry,
    windows_on,
)
from gap_diagnosis.gap.shares import shares_of
from gap_diagnosis.gap.waterfall import shapley_reductions
from gap_diagnosis.gap.where import manoeuvre_segments, metric_chain
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.whitening import LEVELS as LEVEL_NAMES
from gap_diagnosis.result_parts import Metric

# Effect, parameter, value, the firmware's mode, the stage.
CASES = [
    ("radius_scale", "scale", 0.01, "wheel", "wheel"),
    ("wheelbase_scale", "scale", 0.02, "wheel", "wheel"),
    ("radius_mismatch", "mismatch", 0.01, "wheel", "wheel"),
    ("gyro_scale", "scale", 0.02, "gyro", "gyro"),
    ("reference_yaw", "angle", 0.02, "gyro", "reference"),
]


def measure(*of: Any, **known: Any) -> dict[str, Metric]:
    return metrics_of(compare_all(*of, **known))


@pytest.mark.parametrize(("effect", "parameter", "value", "mode", "stage"), CASES)
def test_the_true_effect_closes_the_gap_on_held_out_stretches_and_its_stage_carries_it(
    effect: str, parameter: str, value: float, mode: str, stage: str
) -> None:
    robot, [(recording, motion)] = drives("random", effect, mode=mode, **{parameter: value})
    kinds = kinds_of(recording, robot)
    windows = windows_on(motion, hold_out(recording.t_s, kinds).held_out)
    effects = [setting(motion, effect, value)]
    compared = compare_all(recording, robot, motion, windows, effects=effects, levels=LEVELS)
    gap = gap_of(compared, stage, "stretches")
    assert gap is not None
    assert gap.metric == "odometry_position_m"
    assert gap.floor is not None
    assert gap.before > 3 * gap.floor
    assert gap.closed == pytest.approx(1, abs=0.15)
    shares = shares_of(metric_chain(gap.metric, recording, robot, motion, windows, effects))
    assert math.fsum(shares.values()) == pytest.approx(1, abs=1e-9)
    assert max(shares, key=lambda name: shares[name]) == stage
    assert shares[stage] > 0.7


def test_a_metric_tells_how_long_and_how_far_its_windows_are_on_average() -> None:
    robot, [(recording, motion)] = drives("random", "radius_scale", scale=0.01)
    held_out = hold_out(recording.t_s, kinds_of(recording, robot)).held_out
    windows = windows_on(motion, held_out)
    found = measure(recording, robot, motion, windows)["odometry_position_m"]
    seconds = [one.stop_s - one.start_s for one in windows]
    assert found.windows == len(windows)
    assert found.window_s == pytest.approx(np.mean(seconds))
    # Wheels are described with the radius that the odometry counts in.
    wheel_m = 0.5 * motion.radius_m * np.abs(motion.left_step_rad + motion.right_step_rad)
    metres = [wheel_m[(motion.t_s > a.start_s) & (motion.t_s <= a.stop_s)].sum() for a in windows]
    assert found.window_m == pytest.approx(np.mean(metres), rel=0.01)


def test_a_wheelbase_is_seen_against_the_gyro_where_the_odometry_follows_the_gyro() -> None:
    robot, [(recording, motion)] = drives("random", "wheelbase_scale", mode="gyro", scale=0.02)
    windows = windows_on(motion)
    effects = [setting(motion, "wheelbase_scale", 0.02)]
    compared = compare_all(recording, robot, motion, windows, effects=effects, levels=LEVELS)
    gap = gap_of(compared, "wheel", "stretches")
    assert gap is not None
    assert gap.all["odometry_position_m"].closed is None
    assert gap.metric == "turn_difference_rad"
    assert gap.closed == pytest.approx(1, abs=0.1)
    shares = shares_of(metric_chain(gap.metric, recording, robot, motion, windows, effects))
    assert max(shares, key=lambda name: shares[name]) == "wheel"


def drives_of(size: str) -> tuple[int, float]:
    """Return how many drives a floor is held to, and how near.

    30 drives of 12 windows: the RMS is known to about 3 %; the tolerance is four times that.
    """
    count = 30 if size == "full" else 12
    return count, 0.12 * math.sqrt(30 / count)


@pytest.mark.parametrize("mode", ["wheel", "gyro"])
def test_the_floor_is_what_drives_without_an_effect_leave(mode: str, size: str) -> None:
    count, tolerance = drives_of(size)
    robot, made = drives("random", mode=mode, count=count)
    squares: dict[str, list[tuple[float, float]]] = {}
    for recording, motion in made:
        windows = windows_on(motion)
        for name, one in compare(recording, robot, motion, windows, levels=LEVELS).items():
            assert one.floor is not None
            squares.setdefault(name, []).append(
                (float(one.before.mean_square.mean()), float(one.floor.mean()))
            )
    assert set(squares) == {"odometry_position_m", "odometry_heading_rad", "turn_difference_rad"}
    for pairs in squares.values():
        before, floor = np.array(pairs).mean(0)
        assert math.sqrt(before / floor) == pytest.approx(1, abs=tolerance)


def test_the_floor_also_holds_where_the_reference_has_positions_only(size: str) -> None:
    count, tolerance = drives_of(size)
    robot, made = drives("random", mode="gyro", count=count)
    squares = []
    for recording, motion in made:
        assert recording.reference is not None
        points = replace(recording.reference, heading_rad=None)
        alone = replace(recording, reference=points)
        found = compare(alone, robot, motion, windows_on(motion), levels=LEVELS)
        assert "odometry_heading_rad" not in found
        one = found["odometry_position_m"]
        assert one.floor is not None
        squares.append((float(one.before.mean_square.mean()), float(one.floor.mean())))
    before, floor = np.array(squares).mean(0)
    assert math.sqrt(before / floor) == pytest.approx(1, abs=tolerance)


@pytest.mark.parametrize(("rounded_ticks2", "louder"), [(0.0, 1.0), (2.4, 2.0)])
def test_speeds_that_were_added_up_leave_what_they_are_unsure_of_and_no_rounding(
    rounded_ticks2: float, louder: float
) -> None:
    """Noise of speeds may be louder than told; what a step rounds off now and then is not."""
    robot, [(recording, counted)] = drives("random")
    unsure_ticks2 = np.full((2, len(recording.t_s)), 0.3)
    unsure_ticks2[:, ::2] += rounded_ticks2
    told = replace(recording, speed_cycle_s=0.01, unsure_ticks2=unsure_ticks2)
    motion = estimate_motion(told, robot)
    levels = np.zeros(len(LEVEL_NAMES))
    assert levels_of(levels, robot, counted).quantum_rad == pytest.approx(LEVELS.quantum_rad)
    none = levels_of(levels, robot, motion)
    assert none.quantum_rad < 0.1 * LEVELS.quantum_rad
    windows = windows_on(motion)
    as_told = replace(none, slow_s=1.0, quantum_rad=0.0, speed_noise=louder)
    found = floor_on(told, robot, motion, windows, (), as_told).turn_difference
    # A walk W of variance q a second, about its mean over the first second, has (t - 2/3) q.
    tick_s = recording.t_s[1] - recording.t_s[0]
    ticks2 = 0.3 * louder**2 + 0.5 * rounded_ticks2
    q = 2 * ticks2 / tick_s * (motion.radius_m * motion.rad_per_count / motion.wheelbase_m) ** 2
    lasts_s = np.array([one.stop_s - one.start_s for one in windows])
    expected = (q * (lasts_s / 2 - 1 / 6)).mean()
    # A window's mean square scatters by at most its own size: 200 draws of ten windows, four sd.
    assert found.mean() == pytest.approx(expected, rel=4 / math.sqrt(found.size))


def test_the_floor_is_the_same_each_time() -> None:
    robot, [(recording, motion)] = drives("figure8")
    windows = windows_on(motion)
    first = floor_on(recording, robot, motion, windows, (), LEVELS)
    again = floor_on(recording, robot, motion, windows, (), LEVELS)
    assert np.array_equal(first.position, again.position)


def test_without_a_reference_the_turn_difference_remains() -> None:
    robot, [(recording, motion)] = drives("random", "gyro_scale", mode="gyro", scale=0.02)
    alone = replace(recording, reference=None)
    effects = [setting(motion, "gyro_scale", 0.02)]
    windows = windows_on(motion)
    metrics = measure(alone, robot, motion, windows, effects=effects, levels=LEVELS)
    assert "odometry_position_m" not in metrics
    assert metrics["turn_difference_rad"].closed == pytest.approx(1, abs=0.1)
    shares = shares_of(metric_chain("turn_difference_rad", alone, robot, motion, windows, effects))
    assert shares["gyro"] == pytest.approx(1, abs=0.1)
    assert shares_of(metric_chain("turn_difference_rad", alone, robot, motion, windows)) == {}


def test_odometry_frames_that_a_replay_meets_have_no_firmware_gap() -> None:
    robot, [(recording, motion)] = drives("random")
    odometry = recorded_odometry(recording)
    assert odometry is not None
    assert len(odometry.t_s) == len(recording.t_s)
    columns = np.column_stack([odometry.x_m, odometry.y_m, odometry.heading_rad])
    turned = columns * np.array([1.01, 1.01, 1.0])
    windows = windows_on(motion)
    same = measure(recording, robot, motion, windows, firmware=Replayed(columns))
    other = metrics_of(
        compare_all(recording, robot, motion, windows, firmware=Replayed(turned, columns))
    )
    assert same["firmware_position_m"].before == pytest.approx(0, abs=1e-12)
    assert other["firmware_position_m"].closed == pytest.approx(1, abs=1e-9)


def test_the_true_lag_closes_the_gap_between_commands_and_wheels() -> None:
    lag = {"drive_lag.time_constant": 0.1}
    robot, [(recording, motion)] = drives("random", "drive_lag", time_constant=0.1)
    before, after = commanded_path(recording, robot), commanded_path(recording, robot, lag)
    assert before is not None
    windows = windows_on(motion)
    compared = compare_all(recording, robot, motion, windows, drive=Replayed(before, after))
    gap = gap_of(compared, "actuation", "stretches")
    assert gap is not None
    assert gap.metric == "drive_position_m"
    assert gap.closed == pytest.approx(1, abs=0.1)


def test_the_described_drive_follows_the_commands_to_the_floor() -> None:
    robot, [(recording, motion)] = drives("random")
    path = commanded_path(recording, robot)
    assert path is not None
    found = metrics_of(
        compare_all(recording, robot, motion, windows_on(motion), drive=Replayed(path))
    )
    assert found["drive_position_m"].before < 3e-4


def test_posterior_draws_widen_the_interval_of_closed() -> None:
    robot, [(recording, motion)] = drives("random", "radius_scale", scale=0.01)
    windows = windows_on(motion)
    effects = [setting(motion, "radius_scale", 0.01)]
    random = np.random.default_rng(5)
    draws = [[setting(motion, "radius_scale", one)] for one in random.normal(0.01, 0.006, 30)]
    sharp = metrics_of(
        compare_all(recording, robot, motion, windows, effects=effects, levels=LEVELS)
    )
    wide = metrics_of(
        compare_all(recording, robot, motion, windows, effects=effects, draws=draws, levels=LEVELS)
    )
    spans = [one["odometry_position_m"].ci95 for one in (sharp, wide)]
    assert spans[0] is not None
    assert spans[1] is not None
    assert spans[1][1] - spans[1][0] > 2 * (spans[0][1] - spans[0][0])


def test_a_waterfall_of_two_effects_ends_at_what_is_explained() -> None:
    robot, [(recording, motion)] = drives("random", "radius_scale", scale=0.01)
    windows = windows_on(motion)
    known = {
        "radius_scale": setting(motion, "radius_scale", 0.01),
        "wheelbase_scale": setting(motion, "wheelbase_scale", 1e-4),
    }

    def rms(on: Sequence[Setting]) -> float:
        return odometry_rms("odometry_position_m", recording, robot, motion, windows, on)

    steps = shapley_reductions(known, lambda on: rms([known[name] for name in sorted(on)]))
    assert math.fsum(steps.values()) == pytest.approx(rms([]) - rms(list(known.values())))
    assert steps["radius_scale"] > 20 * abs(steps["wheelbase_scale"])


def test_each_manoeuvre_is_given_the_stage_that_carries_its_error() -> None:
    robot, [(recording, motion)] = drives("random", "radius_scale", scale=0.03)
    kinds = kinds_of(recording, robot)
    effects = [setting(motion, "radius_scale", 0.03)]
    segments = manoeuvre_segments(recording, robot, motion, kinds, effects)
    straight = [one for one in segments if one.kind in ("straight", "arc", "reverse")]
    assert len(straight) > 5
    assert np.mean([one.stage == "wheel" for one in straight]) > 0.8
    assert all(one.stop_s > one.start_s for one in segments)


def test_shares_are_of_the_windows_in_which_every_link_moves() -> None:
    """Against positions alone, a robot whose left wheel is said to turn backwards hardly moves by
    one link in windows in which it does by another: that was an internal error."""
    robot, [(recording, motion)] = drives("random")
    assert recording.reference is not None
    positions = replace(recording, reference=replace(recording.reference, heading_rad=None))
    backwards = replace(
        motion,
        left_step_rad=-motion.left_step_rad,
        left_angle_rad=-motion.left_angle_rad,
        left_rate_rad_s=-motion.left_rate_rad_s,
    )
    turned = next(one for one in EXPLAINED["setup_sign"].variants(motion) if _is_left(one))
    windows = windows_on(backwards)
    effects = [(turned, ())]
    chain = metric_chain("odometry_position_m", positions, robot, backwards, windows, effects)
    assert 0 < chain.total.shape[0] < len(windows)
    assert math.fsum(shares_of(chain).values()) == pytest.approx(1, abs=1e-9)


def _is_left(variant: Variant) -> bool:
    return variant.report["signal"] == "left_ticks"
