"""What is off by far more than usual is told by its name: a tracker is mounted as it comes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest
from diagnosed import ROBOT, WIRE, number
from full_size import at_full_size

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

RIVALS = frozenset(
    {
        "gyro_bias",
        "gyro_lag",
        "gyro_scale",
        "lateral_slip",
        "one_sided_slip",
        "radius_scale",
        "reference_clock_skew",
        "reference_lever_arm",
        "reference_scale",
        "reference_time_offset",
        "reference_yaw",
        "wheelbase_scale",
    }
)
"""What each passed for, and what else it might pass for; those of the drive besides."""


@pytest.mark.parametrize(
    ("drive", "duration_s", "effect", "values", "seed"),
    [
        ("figure8", 30.0, "reference_yaw", {"angle": 1.5708}, 101),
        *at_full_size(
            ("figure8", 30.0, "drive_delay", {"delay": 0.5}, 140),
            ("figure8", 30.0, "reference_yaw", {"angle": -2.5}, 5),
            ("figure8", 60.0, "reference_scale", {"scale": 0.1}, 110),
            ("calibration", 30.0, "reference_time_offset", {"offset": 0.8}, 106),
        ),
    ],
    ids=["a tracker across", "a late drive", "a tracker backwards", "a large room", "a late one"],
)
def test_an_effect_far_beyond_its_usual_size_is_told(
    drive: str, duration_s: float, effect: str, values: Mapping[str, float], seed: int
) -> None:
    """A tracker turned by more than 46 degrees and a room a tenth too large were unlisted causes
    (> 0.99), a drive half a second late one of 0.3 s with a lag, a reference 0.8 s late one with
    a slip and a room's scale beside it."""
    recording = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario(drive), effects=()),
        [EffectSetting(effect, tuple(values.items()))],
        seed,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
        duration_s=duration_s,
    )
    others = frozenset(EXPLAINED) - RIVALS
    diagnosis = diagnose_recordings([recording], ROBOT, WIRE, without=others).diagnosis
    best = diagnosis.which[0]
    assert best.effects == (effect,)
    assert best.group_probability > 0.9
    for name, value in values.items():
        assert abs(number(diagnosis, f"{effect}.{name}").estimate - value) < 0.002


def test_wheels_described_twice_as_far_apart_are_told_by_positions_alone() -> None:
    """About a robot that turns twice as far, a straight line asks for wheels on one another: the
    set was beyond belief, and never fitted: an unlisted cause, as of a real robot in a hall."""
    effects = (("wheelbase_scale", -0.5), ("radius_scale", -0.02))
    recording = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("figure8"), effects=()),
        [EffectSetting(name, (("scale", size),)) for name, size in effects],
        1,
        reference=ReferenceNoise(0.003, 0.01, rate_hz=10.0),
    )
    assert recording.reference is not None
    alone = replace(
        recording,
        gyro_code=None,
        gyro_rate_rad_s=None,
        v_command_m_s=None,
        w_command_rad_s=None,
        reference=replace(recording.reference, heading_rad=None),
    )
    others = frozenset(EXPLAINED) - {
        "cross_slope_drift",
        "missed_ticks",
        "radius_scale",
        "turn_scrub",
        "wheelbase_scale",
    }
    found = diagnose_recordings([alone], ROBOT, WIRE, without=others).diagnosis
    assert {"radius_scale", "wheelbase_scale"} <= set(found.which[0].effects)
    for name, size in effects:
        assert number(found, f"{name}.scale").estimate == pytest.approx(size, abs=0.01)
