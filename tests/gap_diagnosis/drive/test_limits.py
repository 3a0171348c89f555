"""A bound of the drive shows from where it holds a wheel back by more than any drive may."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from drive_recordings import ROBOT, recording_of, simulated

from gap_diagnosis.drive import DriveBlock, drive_block, prior
from gap_diagnosis.drive.limits import BOUNDS, limits_of_answers, limits_of_bounds
from gap_diagnosis.drive.noise import Levels, whitened
from gap_diagnosis.ranking import THRESHOLD
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
    assert found["drive_saturation"] == pytest.approx(0.3 / RADIUS_M, rel=0.002)
    assert found["drive_deadband"] == pytest.approx(0.05 / RADIUS_M, rel=0.002)
    # Four lags and more after each step the largest is the next one: a first-order drive begins it
    # with its height over its lag.
    step_m_s = max(np.abs(np.diff(STEPS_M_S)))
    steepest = min(step_m_s / RADIUS_M / LAG_S, ROBOT.plant.drive.max_wheel_acceleration_rad_s2)
    assert 0.9 * steepest < found["drive_acceleration_limit"] < steepest


def test_a_bound_beyond_its_limit_moves_no_wheel_by_more_than_any_drive_may() -> None:
    """A dead band that only the first commands of a ramp met was told to be visible from there on,
    and no effect was found in a log that hardly had it."""
    plain = simulated(duration_s=10.0)
    found = limits_of_bounds([plain], ROBOT)
    v_m_s, w_rad_s = plain.v_command_m_s, plain.w_command_rad_s
    assert v_m_s is not None
    assert w_rad_s is not None
    aside = 0.5 * ROBOT.plant.wheels.wheelbase_m * w_rad_s
    fastest = np.abs([v_m_s - aside, v_m_s + aside]).max() / RADIUS_M
    most_rad = 0.5 * ROBOT.tolerance.time_offset_s * float(fastest)
    most = most_rad * ROBOT.plant.encoder.ticks_per_rev / math.tau + 2  # two counts are rounded
    for effect, value in {
        "drive_saturation": {"limit": found["drive_saturation"] * 1.001},
        "drive_deadband": {"rate": found["drive_deadband"] * 0.999},
    }.items():
        bounded = simulated({effect: value}, duration_s=10.0)
        assert np.abs(bounded.left_ticks - plain.left_ticks).max() <= most
        assert np.abs(bounded.right_ticks - plain.right_ticks).max() <= most


def test_without_commands_nothing_is_said() -> None:
    assert limits_of_bounds([replace(stairs(), v_command_m_s=None)], ROBOT) == {}


def coarse(duration_s: float) -> DriveBlock:
    """Return the block of a drive that is seen by few counts."""
    encoder = ROBOT.plant.encoder.model_copy(update={"ticks_per_rev": 8})
    plant = ROBOT.plant.model_copy(update={"encoder": encoder})
    robot = replace(ROBOT, plant=plant)
    found = drive_block(simulated(duration_s=duration_s, robot=robot), robot)
    assert found is not None
    return found


def test_a_gain_at_its_limit_separates_by_29() -> None:
    """By least squares on whitened angles that the gain alone has bent."""
    block = coarse(6.0)
    limit = limits_of_answers([block])["drive_gain"]
    assert limit is not None
    assert limit > prior.GAIN.tolerance
    setting, data = block.undisturbed, block.data
    separations = []
    for wheel in (0, 1):
        bent = (setting.shapes.gain_columns({}, setting.shapes.angle({}))[wheel] * limit)[None]
        columns = np.concatenate((bent, setting.fixed[2:]))
        white, _ = whitened(data, columns, block.levels)
        others = np.hstack([white[1:], np.diag(1 / setting.nuisance_sd[2:])]).T
        target = np.append(white[0], np.zeros(len(others) - len(white[0])))
        left = target - others @ np.linalg.lstsq(others, target, rcond=None)[0]
        separations.append(float(left @ left))
    assert max(separations) == pytest.approx(THRESHOLD, rel=1e-6)


def test_the_longer_a_drive_the_smaller_what_it_shows_down_to_the_tolerance() -> None:
    short, long = coarse(6.0), coarse(20.0)
    one, two, more = (limits_of_answers(some) for some in ([short], [short, short], [long]))
    assert one["drive_gain"] is not None
    assert two["drive_gain"] == pytest.approx(one["drive_gain"] / 2**0.5)
    for effect, limit in one.items():
        assert limit is None or limit >= (more[effect] or math.inf)
    assert limits_of_answers([]) == dict.fromkeys(one, None)


def test_what_a_drive_shows_at_usual_noise_is_told_without_that_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    block = coarse(20.0)
    found, usual = limits_of_answers([block]), limits_of_answers([block], typical=True)
    assert usual != found
    monkeypatch.setattr(DriveBlock, "levels", Levels(1.0, 1.0, 1.0, 1.0))
    assert limits_of_answers([block]) != found
    assert limits_of_answers([block], typical=True) == usual
