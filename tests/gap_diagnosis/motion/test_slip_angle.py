"""Tyres that yield by an angle slide by the square of the speed, and are told as such."""

from dataclasses import replace

import pytest
from full_size import at_full_size
from motion_cases import ROBOT, WIRE, model_of

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

DRIVE = scenario("random")


@pytest.mark.parametrize(
    ("speed_m_s", "seed"), [(0.3, 2), *at_full_size((0.0, 1), (0.0, 3), (0.3, 4), (0.6, 5))]
)
def test_a_lateral_slip_is_told_with_how_it_grows_with_the_speed(
    speed_m_s: float, seed: int
) -> None:
    tyres = EffectSetting("lateral_slip", (("compliance", 0.03), ("speed", speed_m_s)))
    drive = replace(DRIVE, seed=seed)
    log = synthetic_recording(
        ROBOT, WIRE, drive, [tyres], seed, reference=ReferenceNoise(), duration_s=60.0
    )
    found = diagnose_recordings([log], ROBOT, WIRE).diagnosis
    assert found.verdict == "lateral_slip"
    told = found.which[0].parameters
    # As large as it would be at 1 m/s.
    at_one_m_s = 0.03 / speed_m_s if speed_m_s else 0.03
    assert told["lateral_slip.speed"].estimate == (1 if speed_m_s else 0)
    low, high = told["lateral_slip.compliance"].ci95
    assert low < at_one_m_s < high


def test_where_a_speed_hardly_changes_a_size_is_that_of_the_form_that_is_told() -> None:
    """A slide of 0.03 s at half a metre a second is one of 0.06 at 1 m/s: drawn from both forms it
    was 0.034, and up to 0.061."""
    tyres = EffectSetting("lateral_slip", (("compliance", 0.03),))
    drive = replace(scenario("figure8"), effects=())
    log = synthetic_recording(
        ROBOT, WIRE, drive, [tyres], 5, reference=ReferenceNoise(), duration_s=60.0
    )
    block = MotionBlock(model_of(log, "lateral_slip"))
    told = block.detail(frozenset({"lateral_slip"})).parameters
    form = told["lateral_slip.speed"]
    assert form.probabilities is not None
    assert min(form.probabilities.values()) > 0.01  # this log hardly tells which it is
    at_any_speed = 0.03 if form.value == 0 else 0.06
    assert told["lateral_slip.compliance"].value == pytest.approx(at_any_speed, rel=0.1)
    assert told["lateral_slip.compliance"].sd < 0.1 * at_any_speed


def test_beside_a_slip_angle_no_little_one_is_free() -> None:
    """However well a log told a car's, it was told to 4 ms at 1 m/s: what tyres usually yield by
    was free beside it."""
    tyres = EffectSetting("lateral_slip", (("compliance", 0.03), ("speed", 0.3)))
    log = synthetic_recording(
        ROBOT, WIRE, replace(DRIVE, seed=2), [tyres], 2, reference=ReferenceNoise(), duration_s=30.0
    )
    columns = model_of(log, "lateral_slip").columns
    little = {place for place, (one, _) in columns.little.items() if one.effect == "lateral_slip"}
    (angle,) = (one for one in columns.terms if one.variant.report.get("speed") == 1)
    assert little
    assert all((place, 0.0) in angle.weights[0] for place in little)
