"""The lesson's robot: counts of the plant, read back by float estimators, give its figures."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_plant import EncoderModel, Mechanisms, Plant, PlantDescription, PlantRuns, simulate

LESSON = Mechanisms(
    radius_scale=1 / 1.005 - 1,
    radius_mismatch=-0.004,
    wheelbase_scale=1 / 0.995 - 1,
    gyro_bias_rad_s=0.005,
)
TICKS = 6000
PERIOD_S = 0.01
DESCRIBED_RADIUS_M = 0.05025
DESCRIBED_WHEELBASE_M = 0.2985


def lesson_commands() -> NDArray[np.float64]:
    time_s = np.arange(TICKS) * PERIOD_S
    return np.column_stack([np.full(TICKS, 0.6), 0.10 * np.sin(2 * np.pi * time_s / 20)])


def lesson_runs(encoder_model: EncoderModel) -> PlantRuns:
    return simulate(
        PlantDescription(),
        LESSON,
        lesson_commands(),
        [7],
        tick_period_us=10_000,
        encoder_model=encoder_model,
        noise="lesson",
        drive="ideal",
    )


def wheel_steps_m(runs: PlantRuns) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    m_per_tick = 2 * np.pi * DESCRIBED_RADIUS_M / 2048
    left = np.diff(runs.left_count[0].astype(np.int16)).astype(float) * m_per_tick
    right = np.diff(runs.right_count[0].astype(np.int16)).astype(float) * m_per_tick
    return 0.5 * (left + right), (right - left) / DESCRIBED_WHEELBASE_M


def final_error_m(runs: PlantRuns, x_m: float, y_m: float) -> float:
    return float(np.hypot(x_m - runs.truth[0, -1, 0], y_m - runs.truth[0, -1, 1]))


@pytest.mark.parametrize(
    ("encoder_model", "wheel_m", "gyro_m"),
    [("lesson_counter", 6.850275, 5.280128), ("counter", 8.581812, 5.281302)],
)
def test_float_estimators_on_the_lessons_counts_reach_its_figures(
    encoder_model: EncoderModel, wheel_m: float, gyro_m: float
) -> None:
    runs = lesson_runs(encoder_model)
    forward_m, turn_rad = wheel_steps_m(runs)

    heading_rad = np.concatenate([[0.0], np.cumsum(turn_rad)])[:-1] + 0.5 * turn_rad
    x_m, y_m = np.sum(forward_m * np.cos(heading_rad)), np.sum(forward_m * np.sin(heading_rad))
    assert f"{final_error_m(runs, x_m, y_m):.6f}" == f"{wheel_m:.6f}"

    assert runs.gyro_rate_rad_s is not None
    turn_rad = runs.gyro_rate_rad_s[0, 1:] * PERIOD_S
    heading_rad = np.concatenate([[0.0], np.cumsum(turn_rad)])[:-1]
    x_m, y_m = np.sum(forward_m * np.cos(heading_rad)), np.sum(forward_m * np.sin(heading_rad))
    assert f"{final_error_m(runs, x_m, y_m):.6f}" == f"{gyro_m:.6f}"


def test_the_lessons_body_follows_its_commands_exactly() -> None:
    truth = lesson_runs("counter").truth[0]
    v_m_s, w_rad_s = lesson_commands().T
    heading_rad = np.concatenate([[0.0], np.cumsum(w_rad_s[:-1] * PERIOD_S)])
    middle_rad = heading_rad[:-1] + 0.5 * w_rad_s[:-1] * PERIOD_S
    x_m = np.sum(v_m_s[:-1] * PERIOD_S * np.cos(middle_rad))
    y_m = np.sum(v_m_s[:-1] * PERIOD_S * np.sin(middle_rad))
    # 6000 additions of numbers below 34, each within half an ulp of 32: 6000 · 3.6e-15 / 2
    assert np.abs(truth[:, 2] - heading_rad).max() < 1e-11
    assert truth[-1, :2] == pytest.approx([x_m, y_m], abs=1.1e-11)


def test_the_lessons_gyro_is_rate_plus_bias_plus_the_third_draw_of_each_step() -> None:
    runs = lesson_runs("lesson_counter")
    assert runs.gyro_rate_rad_s is not None
    third = np.random.default_rng(7).standard_normal((TICKS - 1, 3))[:, 2]
    expected = lesson_commands()[:-1, 1] + 0.005 + 0.002 * third
    assert np.abs(runs.gyro_rate_rad_s[0, 1:] - expected).max() < 1e-14


@pytest.mark.parametrize("encoder_model", ["counter", "lesson_counter"])
def test_the_lesson_one_tick_at_a_time_is_the_lesson_in_a_batch(
    encoder_model: EncoderModel,
) -> None:
    runs = lesson_runs(encoder_model)
    plant = Plant(
        PlantDescription(),
        LESSON,
        tick_period_us=10_000,
        seed=7,
        encoder_model=encoder_model,
        noise="lesson",
        drive="ideal",
    )
    for k, (v_m_s, w_rad_s) in enumerate(lesson_commands()):
        assert plant.pose == tuple(runs.truth[0, k])
        assert plant.counts[:3] == (
            runs.left_count[0, k],
            runs.right_count[0, k],
            runs.gyro_code[0, k],
        )
        plant.step(v_m_s, w_rad_s)
