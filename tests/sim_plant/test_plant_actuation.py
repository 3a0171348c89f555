"""Commands to wheel rotation: exact against closed forms at every tick."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from quiet_robot import (
    PERIOD_S,
    RADIUS_M,
    TICKS_PER_RAD,
    WHEELBASE_M,
    drive,
    held,
    quiet,
    unwrapped,
)

from sim_plant import Mechanisms, PlantDescription
from sim_plant.actuation import turn_wheel
from sim_plant.records import build_parameters

V_M_S = 0.5
RATE_RAD_S = V_M_S / RADIUS_M
LIMITLESS = {"max_wheel_rate_rad_s": 1e4, "max_wheel_acceleration_rad_s2": 1e6}


def motors(**fields: float) -> PlantDescription:
    return quiet(drive={"time_constant_s": 0.0, "delay_s": 0.0} | LIMITLESS | fields)


def distance_m(
    description: PlantDescription, ticks: int, mechanisms: Mechanisms | None = None
) -> NDArray[np.float64]:
    """Return how far a command of V_M_S from rest has taken the robot, tick by tick."""
    runs = drive(held(V_M_S, 0.0, ticks), mechanisms, description=description, ideal=False)
    return runs.truth[0, :, 0]


TIME_S = np.arange(200) * PERIOD_S


def test_without_dynamics_the_wheels_turn_as_told_at_once() -> None:
    # the neutral motor needs one acceleration step of RATE/1e6 s
    assert np.abs(distance_m(motors(), 200) - V_M_S * TIME_S).max() < V_M_S * RATE_RAD_S / 1e6


@pytest.mark.parametrize("lag_s", [0.003, 0.05, 0.4])
def test_a_first_order_lag_is_solved_exactly(lag_s: float) -> None:
    exact = V_M_S * (TIME_S - lag_s * (1 - np.exp(-TIME_S / lag_s)))
    described = distance_m(motors(time_constant_s=lag_s), 200)
    assert described == pytest.approx(exact, abs=1e-12)
    extra = distance_m(motors(), 200, Mechanisms(drive_lag_s=lag_s))
    assert np.array_equal(described, extra)


@pytest.mark.parametrize("delay_s", [0.01, 0.03, 0.0137, 0.5])
def test_a_delay_shifts_the_motion_by_any_fraction_of_a_tick(delay_s: float) -> None:
    exact = V_M_S * np.maximum(TIME_S - delay_s, 0.0)
    late = distance_m(motors(), 200, Mechanisms(drive_delay_s=delay_s))
    # the one acceleration step of the neutral motor again
    assert np.abs(late - exact).max() < V_M_S * RATE_RAD_S / 1e6
    assert np.array_equal(late, distance_m(motors(delay_s=delay_s), 200))


@pytest.mark.parametrize("limit_rad_s2", [3.0, 25.0])
def test_a_limited_acceleration_is_a_ramp(limit_rad_s2: float) -> None:
    ramp_s = RATE_RAD_S / limit_rad_s2
    exact = RADIUS_M * np.where(
        ramp_s > TIME_S,
        0.5 * limit_rad_s2 * TIME_S**2,
        RATE_RAD_S * (TIME_S - 0.5 * ramp_s),
    )
    slow = Mechanisms(drive_acceleration_limit_rad_s2=limit_rad_s2)
    assert distance_m(motors(), 200, slow) == pytest.approx(exact, abs=1e-12)


def test_a_limited_acceleration_hands_over_to_the_lag_without_a_step() -> None:
    limit, lag_s = 25.0, 0.1
    ramp_s = (RATE_RAD_S - limit * lag_s) / limit
    later_s = TIME_S - ramp_s
    exact = RADIUS_M * np.where(
        later_s < 0,
        0.5 * limit * TIME_S**2,
        0.5 * limit * ramp_s**2
        + RATE_RAD_S * later_s
        - limit * lag_s * lag_s * (1 - np.exp(-later_s / lag_s)),
    )
    driven = distance_m(motors(time_constant_s=lag_s, max_wheel_acceleration_rad_s2=limit), 200)
    assert driven == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize(
    ("mechanisms", "left", "right"),
    [
        (Mechanisms(drive_gain_left=0.05, drive_gain_right=-0.1), 1.05, 0.9),
        (Mechanisms(drive_saturation_rad_s=4.0), 4.0 / RATE_RAD_S, 4.0 / RATE_RAD_S),
        (Mechanisms(drive_deadband_rad_s=RATE_RAD_S * 0.999), 1.0, 1.0),
        (Mechanisms(drive_deadband_rad_s=RATE_RAD_S * 1.001), 0.0, 0.0),
    ],
)
@pytest.mark.parametrize("direction", [1, -1])
def test_the_steady_wheel_rate_obeys_gain_saturation_and_deadband(
    mechanisms: Mechanisms, left: float, right: float, direction: int
) -> None:
    runs = drive(held(direction * V_M_S, 0.0, 101), mechanisms, description=motors(), ideal=False)
    per_tick = direction * RATE_RAD_S * PERIOD_S * TICKS_PER_RAD
    # both ends of the stretch are floored to whole ticks
    for count, factor in ((runs.left_count, left), (runs.right_count, right)):
        steps = unwrapped(count)[0]
        assert abs(steps[-1] - steps[50] - 50 * factor * per_tick) <= 1


def test_the_set_points_use_the_described_geometry() -> None:
    runs = drive(held(0.0, 1.0, 101), description=motors(), ideal=False)
    turned = 0.5 * WHEELBASE_M / RADIUS_M * 1.0 * TICKS_PER_RAD
    assert abs(unwrapped(runs.right_count)[0, -1] - turned) <= 1
    assert abs(unwrapped(runs.left_count)[0, -1] + turned) <= 1


@given(
    lag_s=st.sampled_from([0.0, 0.02, 0.3]),
    limit=st.floats(0.1, 1e3),
    start=st.floats(-20, 20),
    target=st.floats(-20, 20),
    whole_s=st.floats(1e-4, 1.0),
    share=st.floats(0.0, 1.0),
)
def test_one_long_step_of_a_wheel_is_two_short_ones(
    lag_s: float, limit: float, start: float, target: float, whole_s: float, share: float
) -> None:
    description = motors(time_constant_s=lag_s, max_wheel_acceleration_rad_s2=limit)
    p = build_parameters(
        description, Mechanisms(), tick_s=0.01, drive_model="motor", encoder_model="counter"
    ).view(np.recarray)[0]
    step = turn_wheel.py_func
    rate, angle = step(p, start, target, whole_s)
    middle, first = step(p, start, target, share * whole_s)
    end, second = step(p, middle, target, whole_s - share * whole_s)
    # rates below 20 rad/s over at most 1 s: some ulps of 20, and of the time where a ramp ends
    assert end == pytest.approx(rate, abs=1e-12 * (1 + limit))
    assert first + second == pytest.approx(angle, abs=1e-12 * (1 + limit))
    assert min(start, target) - 1e-12 <= rate <= max(start, target) + 1e-12


def test_an_ideal_drive_obeys_at_once_whatever_the_motors() -> None:
    slow = quiet(drive={"time_constant_s": 5.0, "delay_s": 1.0})
    runs = drive(held(V_M_S, 0.3, 200), description=slow)
    assert runs.truth[0, :, 2] == pytest.approx(0.3 * TIME_S, abs=1e-12)
    chord = 2 * V_M_S / 0.3 * math.sin(0.15 * PERIOD_S)  # midpoint steps on a circle of chords
    radius = 0.5 * V_M_S * PERIOD_S / math.sin(0.15 * PERIOD_S)
    assert chord == pytest.approx(V_M_S * PERIOD_S, rel=1e-6)
    assert runs.truth[0, :, 0] == pytest.approx(radius * np.sin(0.3 * TIME_S), abs=1e-12)
