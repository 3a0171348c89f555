"""The predicted answer of a drive: that of the simulated one, for any commands."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gap_diagnosis.drive.answer import predict
from sim_plant.actuation import set_point_rad_s, turn_wheel

DT_S = 0.01
RATES = st.floats(-20.0, 20.0)


@st.composite
def commands(draw: st.DrawFn) -> Any:
    """Wheel rates [rad/s] that stand for a few rows each: float64[2, n]."""
    runs = draw(st.lists(st.tuples(RATES, RATES, st.integers(1, 30)), min_size=1, max_size=8))
    rows = [(left, right) for left, right, count in runs for _ in range(count)]
    return np.array(rows).T.copy()


@given(
    commands(),
    st.tuples(RATES, RATES),
    st.sampled_from([0.0, 0.003, 0.04, 0.5]),
    st.sampled_from([0.0, 0.004, 0.02, 0.0335, 9.0]),
    st.sampled_from([0.0, 2.0]),
    st.sampled_from([5.0, 30.0]),
    st.sampled_from([6.0, 60.0, math.inf]),
)
def test_wheels_turn_as_those_of_the_simulated_drive_row_by_row(
    commanded: Any,
    rate_0: tuple[float, float],
    lag_s: float,
    delay_s: float,
    deadband: float,
    limit_rate: float,
    limit_acceleration: float,
) -> None:
    gains = (0.9, 1.05)
    made = predict(
        commanded,
        np.array(rate_0),
        DT_S,
        lag_s,
        delay_s,
        deadband,
        limit_rate,
        limit_acceleration,
        np.array(gains),
        0.0,
    )
    # The simulated drive knows no limit but a very high one.
    drive = SimpleNamespace(
        deadband_rad_s=deadband,
        max_rate_rad_s=limit_rate,
        max_acceleration_rad_s2=min(limit_acceleration, 1e12),
        time_constant_s=lag_s,
    )
    whole = math.floor(delay_s / DT_S)
    late_s = min(delay_s - whole * DT_S, DT_S)
    for wheel in range(2):
        rate, angle = rate_0[wheel], 0.0
        for row in range(1, commanded.shape[1]):
            for told, part_s in ((row - 2 - whole, late_s), (row - 1 - whole, DT_S - late_s)):
                wanted = set_point_rad_s.py_func(
                    drive, commanded[wheel, max(told, 0)], gains[wheel]
                )
                rate, turned = turn_wheel.py_func(drive, rate, wanted, part_s)
                angle += turned
            assert made[wheel, row] == pytest.approx(angle, abs=1e-9)


def test_a_wheel_that_slows_down_faster_than_it_speeds_up_stands_between() -> None:
    """From 4 rad/s to -4 rad/s at 12 rad/s² and then at 8: through rest after a third of a second,
    and there after half a second more."""
    commanded = np.full((2, 101), -4.0)
    made = predict(commanded, np.full(2, 4.0), DT_S, 0.0, 0.0, 0.0, 30.0, 10.0, np.ones(2), 0.4)
    rates = np.diff(made[0]) / DT_S
    standing, there = 4 / 12, 4 / 12 + 4 / 8
    middle_s = (np.arange(100) + 0.5) * DT_S
    expected = np.interp(middle_s, [0.0, standing, there, 2.0], [4.0, 0.0, -4.0, -4.0])
    # A row in which the slope changes has its mean elsewhere than its middle.
    assert np.abs(rates - expected).max() <= (12 - 8) * DT_S / 2
    assert made[0, 100] == pytest.approx(4 * standing / 2 - 4 * 0.25 - 4 * (1.0 - there), abs=1e-12)
