"""The textbook lesson, number by number."""

import lesson_as_printed
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_harness.errors import HarnessError
from hil_harness.lesson import (
    ENCODERS,
    HEADINGS,
    ROUNDINGS,
    LessonParameters,
    integrate,
    lesson_choices,
    run_lesson,
)

# The lesson prints 12 decimals; two orders of summation differ by rounding alone, which over
# 6000 steps of sums below 40 m is below 6000 · 40 m · 2^-53 = 3e-11 m.
PRINTED_M = 1e-9


def test_the_wheel_only_position_error_is_the_printed_one() -> None:
    assert run_lesson().wheel_position_error_m[-1] == pytest.approx(6.850364433010, abs=PRINTED_M)


def test_the_gyro_heading_position_error_is_the_printed_one() -> None:
    assert run_lesson().gyro_position_error_m[-1] == pytest.approx(5.280131440064, abs=PRINTED_M)


def test_the_compiled_listings_use_the_heading_after_the_update() -> None:
    run = run_lesson(gyro_heading="after")
    assert run.gyro_position_error_m[-1] == pytest.approx(5.281874284, abs=PRINTED_M)


def test_the_heading_errors_are_the_printed_ones() -> None:
    run = run_lesson()
    wheel_deg, gyro_deg = np.degrees(
        [run.wheel_heading_error_rad[-1], run.gyro_heading_error_rad[-1]]
    )
    assert wheel_deg == pytest.approx(21.043427, abs=5e-7)
    assert gyro_deg == pytest.approx(17.215566, abs=5e-7)


@pytest.mark.parametrize(
    ("encoder", "wheel_m", "gyro_m"),
    [("lesson_counter", 6.850275, 5.280128), ("counter", 8.581812, 5.281302)],
)
def test_the_encoders_that_fit_a_counter_have_their_own_errors(
    encoder: str, wheel_m: float, gyro_m: float
) -> None:
    run = run_lesson(encoder=encoder)  # type: ignore[arg-type]
    assert run.wheel_position_error_m[-1] == pytest.approx(wheel_m, abs=5e-7)
    assert run.gyro_position_error_m[-1] == pytest.approx(gyro_m, abs=5e-7)


@pytest.mark.parametrize("seed", [0, 7, 123456789])
def test_the_vectorised_lesson_is_the_printed_loop(seed: int) -> None:
    run = run_lesson(seed=seed)
    for ours, printed in zip(
        (run.truth, run.wheel, run.gyro), lesson_as_printed.simulate(seed), strict=True
    ):
        np.testing.assert_allclose(ours, printed, rtol=0, atol=PRINTED_M)


def test_the_table_of_choices_holds_every_choice_once() -> None:
    rows = list(lesson_choices())
    assert len(rows) == len(ENCODERS) * len(ROUNDINGS) * len(HEADINGS)
    assert len({(row.encoder, row.rounding, row.heading) for row in rows}) == len(rows)


def test_rounding_the_increment_moves_the_wheels_and_hardly_the_gyro() -> None:
    rows = {
        row.rounding: row
        for row in lesson_choices()
        if row.encoder == "lesson" and row.heading == "midpoint"
    }
    moved_wheel_m = abs(rows["round"].wheel_position_m - rows["none"].wheel_position_m)
    moved_gyro_m = abs(rows["round"].gyro_position_m - rows["none"].gyro_position_m)
    assert moved_wheel_m > 1.0
    assert moved_gyro_m < 0.01


def test_without_errors_the_estimators_follow_the_truth() -> None:
    ideal = LessonParameters(
        believed_radius_ratio=1.0,
        believed_wheelbase_ratio=1.0,
        wheel_error_left=0.0,
        wheel_error_right=0.0,
        tick_noise_ticks=0.0,
        gyro_bias_rad_s=0.0,
        gyro_noise_rad_s=0.0,
    )
    run = run_lesson(rounding="none", gyro_heading="midpoint", parameters=ideal)
    assert np.max(run.wheel_position_error_m) < PRINTED_M
    assert np.max(run.gyro_position_error_m) < PRINTED_M


@given(turn_rad=st.floats(0.01, 6.0), steps=st.integers(1, 2000))
def test_midpoint_steps_of_a_circle_end_on_the_chord_of_their_polygon(
    turn_rad: float, steps: int
) -> None:
    """n chords of length s, each turned by α = turn/n, end at s·sin(nα/2)/sin(α/2)."""
    alpha_rad = turn_rad / steps
    pose = integrate(np.full(steps, 1 / steps), np.full(steps, alpha_rad), "midpoint")
    chord_m = np.sin(turn_rad / 2) / np.sin(alpha_rad / 2) / steps
    np.testing.assert_allclose(
        pose[-1],
        [chord_m * np.cos(turn_rad / 2), chord_m * np.sin(turn_rad / 2), turn_rad],
        rtol=0,
        atol=1e-11,
    )


def test_a_name_that_does_not_exist_is_refused_in_one_line() -> None:
    with pytest.raises(HarnessError, match=r'^encoder = "optical": expected one of lesson, '):
        run_lesson(encoder="optical")  # type: ignore[arg-type]
