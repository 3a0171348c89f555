"""What anyone could know of a case: how far an effect is over the limit of what can be seen."""

from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.trials.case import Case
from gap_diagnosis.trials.oracle import Oracle, Values
from gap_diagnosis.trials.reference_noise import ReferenceLevels
from hil_harness.assembly import load_wire
from hil_harness.effects import EffectSetting
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

LEVELS = ReferenceLevels("white", 5e-4, 5e-4, 2e-4, 2e-4, 1.0, 100.0)
ROBOT, WIRE = load_robot(None), load_wire()
CASE = Case(
    "0001", "limit", "single", {}, {}, (), {}, {"micro_slip": {"left": 5e-4, "right": 5e-4}},
    "calibration", "familiar", LEVELS, 4, "00" * 16,
)  # fmt: skip


def log_of(*effects: EffectSetting) -> Recording:
    return synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), effects, 3, reference=ReferenceNoise()
    )


@pytest.fixture(scope="module")
def oracle() -> Oracle:
    return Oracle(log_of(), ROBOT, CASE)


def test_twice_the_size_is_twice_as_far_over_the_limit(oracle: Oracle) -> None:
    once, twice = (
        oracle.over_limit("gyro_g_sensitivity", {"x": 2e-4 * factor, "y": 0.0}) for factor in (1, 2)
    )
    assert once is not None
    assert twice == pytest.approx(2 * once)


def test_a_missing_code_is_as_clear_as_it_is_often_asked_for() -> None:
    """Seldom read codes are missed by nobody."""
    quiet = log_of().gyro_code
    assert quiet is not None
    codes, counts = np.unique(quiet, return_counts=True)
    common, rare = int(codes[np.argmax(counts)]), int(codes[0])
    over = [
        Oracle(log_of(EffectSetting("adc_missing_code", (("code", one),))), ROBOT, CASE).over_limit(
            "adc_missing_code", {"code": one}
        )
        for one in (common, rare, int(codes[-1]) + 50)
    ]
    assert over[0] is not None
    assert over[1] is not None
    assert over[0] > 2
    assert over[1] < 1
    assert over[2] == 0.0


def test_positions_in_another_unit_are_a_reference_whose_scale_is_off_by_as_much(
    oracle: Oracle,
) -> None:
    """Nothing but how usual a factor is tells them apart: where the mistake was withheld, the scale
    was a confident wrong name."""
    unit: Values = {"signal": "reference_position", "factor": 0.25}
    logs = (
        log_of(EffectSetting("setup_unit", tuple(unit.items()))),
        log_of(EffectSetting("reference_scale", (("scale", -0.75),))),
    )
    first, second = (one.reference for one in logs)
    assert first is not None
    assert second is not None
    for axis in ("x_m", "y_m", "heading_rad"):
        here, there = getattr(first, axis), getattr(second, axis)
        assert here - here[0] == pytest.approx(there - there[0], abs=1e-9)
    assert frozenset({"reference_scale"}) in oracle.group({"setup_unit": unit})
    turned: Values = {"signal": "reference_heading", "factor": 0.25}
    assert frozenset({"reference_scale"}) not in oracle.group({"setup_unit": turned})


def test_a_room_out_of_scale_is_wheels_and_a_track_out_of_scale_by_as_much(oracle: Oracle) -> None:
    """The catalogue calls them twins; where the scale was withheld, they were a wrong name."""
    group = oracle.group({"reference_scale": {"scale": 0.02}})
    assert frozenset({"radius_scale", "wheelbase_scale"}) in group


def test_three_effects_are_like_three_others(oracle: Oracle) -> None:
    """Counts that one wheel loses are a smaller wheel, whatever is at work beside it."""
    beside: dict[str, Values] = {"wheelbase_scale": {"scale": 0.02}, "gyro_scale": {"scale": 0.02}}
    group = oracle.group({**beside, "radius_mismatch": {"mismatch": 0.004}})
    assert frozenset({*beside, "radius_mismatch"}) in group
    assert frozenset({*beside, "missed_ticks"}) in group
    assert all(len(one) >= 3 for one in group)


def test_spurious_counts_are_no_clearer_than_their_number_is_certain() -> None:
    """Of n counts expected, n - sqrt(n) or n + sqrt(n) come: what is certain of them is n, however
    smooth the floor. By the mean alone they were five times as far over their limit as they are."""
    rate = 1.0
    values: Values = {"side": "left", "rate": rate}
    log = log_of(EffectSetting("extra_ticks", tuple(values.items())))
    smooth = {"micro_slip": {"left": 1e-5, "right": 1e-5}}
    sure = replace(CASE, surroundings=smooth)
    drawn = replace(sure, effects={"extra_ticks": values})
    certain, by_chance = (
        Oracle(log, ROBOT, one).over_limit("extra_ticks", values) for one in (sure, drawn)
    )
    assert certain is not None
    assert by_chance is not None
    expected = rate * float(log.t_s[-1] - log.t_s[0])
    assert by_chance < np.sqrt(expected / 29.0)
    assert certain > 2 * by_chance
