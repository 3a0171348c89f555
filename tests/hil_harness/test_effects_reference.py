"""Effects of stage reference change what the measuring system reports, and nothing else."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_harness.effects import apply_effects, combine_effects, parse_effect
from hil_harness.effects.reference_errors import Floats, measure_over_time

TIME_S = np.arange(0.0, 60.0, 0.01)
SPIN = np.column_stack([np.zeros_like(TIME_S), np.zeros_like(TIME_S), TIME_S])
LINE = np.column_stack([0.5 * TIME_S, 0.2 * TIME_S, np.full_like(TIME_S, 0.3)])


def report(*effects: str, of: Floats = LINE, seed: int = 1) -> tuple[Floats, Floats]:
    settings = apply_effects(combine_effects(map(parse_effect, effects)))
    return measure_over_time(TIME_S, of, settings.over_time(lambda at: at.reference), seed)


def test_without_effects_the_reference_is_the_truth_bit_for_bit() -> None:
    stamps, poses = report("reference_yaw.angle=0", "reference_noise.position=0")
    assert stamps is TIME_S
    assert poses is LINE


def test_its_heading_reads_high_by_the_angle_and_its_position_stays() -> None:
    _, poses = report("reference_yaw.angle=0.02")
    np.testing.assert_array_equal(poses[:, :2], LINE[:, :2])
    np.testing.assert_allclose(poses[:, 2] - LINE[:, 2], 0.02)


def test_in_a_spin_the_tracked_point_runs_round_the_lever_arm() -> None:
    _, poses = report("reference_lever_arm.x=0.03", "reference_lever_arm.y=0.04", of=SPIN)
    np.testing.assert_allclose(np.hypot(poses[:, 0], poses[:, 1]), 0.05)
    assert poses[0, :2].tolist() == [0.03, 0.04]


def test_a_positive_offset_stamps_late() -> None:
    stamps, _ = report("reference_time_offset.offset=0.05")
    np.testing.assert_allclose(stamps - TIME_S, 0.05)


def test_a_fast_reference_clock_runs_ahead() -> None:
    stamps, _ = report("reference_clock_skew.skew=1e-4")
    assert stamps[-1] / TIME_S[-1] == pytest.approx(1.0001, abs=1e-12)


def test_distances_are_reported_long_and_headings_as_they_are() -> None:
    _, poses = report("reference_scale.scale=0.01")
    np.testing.assert_allclose(poses[:, :2], 1.01 * LINE[:, :2])
    np.testing.assert_array_equal(poses[:, 2], LINE[:, 2])


@given(st.integers(0, 2**64 - 1))
def test_white_noise_has_its_levels(seed: int) -> None:
    _, poses = report("reference_noise.position=0.002", "reference_noise.heading=0.01", seed=seed)
    spread = np.std(poses - LINE, axis=0)
    np.testing.assert_allclose(spread, [0.002, 0.002, 0.01], rtol=6 / math.sqrt(2 * len(TIME_S)))


def test_coloured_noise_keeps_its_level_and_its_correlation_time() -> None:
    _, poses = report("reference_noise.position=0.002", "reference_noise.correlation_time=0.05")
    noise = poses[:, 0] - LINE[:, 0]
    kept = float(np.mean(noise[5:] * noise[:-5]) / np.mean(noise**2))
    # about 600 independent stretches of two correlation times
    assert kept == pytest.approx(math.exp(-1.0), abs=5 / math.sqrt(600))
    assert np.std(noise) == pytest.approx(0.002, rel=5 / math.sqrt(1200))


def test_a_dropout_has_no_samples() -> None:
    stamps, _ = report("reference_dropout.start_s=10", "reference_dropout.stop_s=12")
    assert not np.any((stamps >= 10) & (stamps < 12))
    assert len(stamps) == len(TIME_S) - 200


def test_a_jump_stays() -> None:
    texts = [f"reference_jump.{part}" for part in ("time=30", "x=0.1", "y=-0.2", "yaw=0.05")]
    _, poses = report(*texts)
    steps = np.where((TIME_S >= 30)[:, np.newaxis], [0.1, -0.2, 0.05], 0.0)
    np.testing.assert_allclose(poses - LINE, steps, atol=1e-12)


def test_an_effect_of_the_reference_may_act_in_a_window() -> None:
    _, poses = report(
        "reference_yaw.angle=0.02", "reference_yaw.start_s=10", "reference_yaw.stop_s=20"
    )
    there = (TIME_S >= 10) & (TIME_S < 20)
    np.testing.assert_allclose(poses[:, 2] - LINE[:, 2], np.where(there, 0.02, 0.0), atol=1e-12)
