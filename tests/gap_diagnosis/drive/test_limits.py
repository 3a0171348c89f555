"""A bound of the drive shows from where a command meets it on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drive_recordings import ROBOT, recording_of, simulated

from gap_diagnosis.drive.limits import BOUNDS, limits_of_bounds
from gap_diagnosis.recording import Recording

RADIUS_M = ROBOT.plant.wheels.radius_m
LAG_S = ROBOT.plant.drive.time_constant_s
STEPS_M_S = (0.0, 0.05, 0.3, 0.1, 0.0)


def stairs() -> Recording:
    """Return two seconds at each speed, straight ahead; the wheels are of no interest."""
    v_m_s = np.repeat(STEPS_M_S, 200)
    counts = np.cumsum(v_m_s) * 0.01 / RADIUS_M * 2048 / (2 * np.pi)
    return recording_of(np.stack([v_m_s, np.zeros(len(v_m_s))], axis=1), counts, counts.copy())


def test_bounds_are_told_by_the_rates_and_steps_that_were_commanded() -> None:
    found = limits_of_bounds([stairs()], ROBOT)
    assert set(found) == set(BOUNDS)
    assert found["drive_saturation"] == pytest.approx(0.3 / RADIUS_M)
    assert found["drive_deadband"] == pytest.approx(0.05 / RADIUS_M)
    # Four lags and more after each step the largest is the next one: a first-order drive begins it
    # with its height over its lag.
    step_m_s = max(np.abs(np.diff(STEPS_M_S)))
    assert found["drive_acceleration_limit"] == pytest.approx(
        min(step_m_s / RADIUS_M / LAG_S, ROBOT.plant.drive.max_wheel_acceleration_rad_s2), rel=0.01
    )


def test_a_bound_that_no_command_meets_leaves_the_same_counts() -> None:
    """What lies beyond the limits does nothing to the simulated wheels, bit for bit."""
    plain = simulated(duration_s=10.0)
    found = limits_of_bounds([plain], ROBOT)
    beyond = {
        "drive_saturation": {"limit": found["drive_saturation"] * 1.001},
        "drive_deadband": {"rate": found["drive_deadband"] * 0.999},
    }
    bounded = simulated(beyond, duration_s=10.0)
    np.testing.assert_array_equal(bounded.left_ticks, plain.left_ticks)
    np.testing.assert_array_equal(bounded.right_ticks, plain.right_ticks)


def test_without_commands_nothing_is_said() -> None:
    assert limits_of_bounds([replace(stairs(), v_command_m_s=None)], ROBOT) == {}
