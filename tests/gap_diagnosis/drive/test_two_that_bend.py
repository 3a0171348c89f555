"""Two effects that bend the way from command to wheel are both found and measured."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from drive_recordings import ROBOT, WIRE
from foreign_drives import weak_motors
from full_size import at_full_size

from gap_diagnosis.drive import drive_block
from gap_diagnosis.drive.grid import Floats, locate
from gap_diagnosis.synthetic import synthetic_recording
from gap_diagnosis.trials.drives import drive
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

BENDING = {
    "drive_lag": ("time_constant", 0.06),
    "drive_delay": ("delay", 0.05),
    "drive_deadband": ("rate", 1.0),
    "drive_saturation": ("limit", 6.0),
    "drive_acceleration_limit": ("limit", 6.0),
}


PAIRS = list(combinations(BENDING, 2))


@pytest.mark.parametrize(("first", "second"), [*PAIRS[::2], *at_full_size(*PAIRS[1::2])])
def test_any_two_effects_that_bend_the_drive_are_found_however_narrow_their_peak(
    first: str, second: str
) -> None:
    """A dead band's peak is narrower than the coarse grid's cells: beside a limit of the rate it
    was missed by 9,000 nats, and a gain of -5 % told in the limit's place."""
    named = {one: dict([BENDING[one]]) for one in (first, second)}
    settings = [EffectSetting(one, tuple(values.items())) for one, values in named.items()]
    drive = replace(scenario("calibration"), effects=())
    block = drive_block(
        synthetic_recording(ROBOT, WIRE, drive, settings, 900, duration_s=60.0), ROBOT
    )
    assert block is not None
    both = block.fit(frozenset(named))
    assert both.log_evidence > max(block.fit(frozenset({one})).log_evidence for one in named) + 20
    for effect in named:
        parameter, value = BENDING[effect]
        assert both.parameters[f"{effect}.{parameter}"].value == pytest.approx(value, rel=0.05)


@pytest.mark.parametrize("kind", ["weave", *at_full_size("delivery", "one_way")])
def test_motors_of_little_torque_have_a_limit_of_acceleration_and_nothing_else(kind: str) -> None:
    """Friction lets them slow down a tenth faster than they speed up: the limit is the mean of the
    two, and no second effect is told for the difference."""
    block = drive_block(weak_motors(drive(kind, np.random.default_rng(1), 0.4), 1), ROBOT)
    assert block is not None
    alone = block.fit(frozenset({"drive_acceleration_limit"}))
    told = alone.parameters["drive_acceleration_limit.limit"]
    assert told.value == pytest.approx(3.3, rel=0.01)
    for other in set(BENDING) - {"drive_acceleration_limit"}:
        both = block.fit(frozenset({"drive_acceleration_limit", other}))
        assert both.log_evidence < alone.log_evidence + 3
    gain = block.fit(frozenset({"drive_acceleration_limit", "drive_gain"})).parameters
    for side in ("left", "right"):
        assert abs(gain[f"drive_gain.{side}"].value) < 0.01


def test_a_peak_that_is_known_is_found_however_narrow_it_is() -> None:
    """Where a limit is laid anew its peak is narrower than a grid's cells, and so is what stands
    beside it: a dead band was found or not by the last digit of a noise level (27 nats)."""
    peak = np.array([0.3, 0.7])

    def log_density(points: Floats) -> Floats:
        away = (points - peak) / 1e-3
        return np.asarray(np.log(np.exp(-0.5 * np.sum(away**2, axis=1)) + 1e-3))

    bounds = [(0.0, 1.0), (0.0, 1.0)]
    assert locate(log_density, bounds, [0.3, 0.7]) == pytest.approx(peak, abs=1e-3)
