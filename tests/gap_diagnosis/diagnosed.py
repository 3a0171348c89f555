"""A few drives with known effects, diagnosed once for all tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.recording import Recording
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import NumberEstimate
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness import load_robot, load_wire
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

ROBOT = load_robot()
WIRE = load_wire()


@dataclass(frozen=True)
class Case:
    """A drive: its effects' values by ``effect.parameter``, what is withheld, how long it is."""

    values: Mapping[str, float | str] = field(default_factory=dict)
    has_reference: bool = True
    without: frozenset[str] = frozenset()
    duration_s: float = 90.0


CASES = {
    "pair": Case({"gyro_bias.bias": 0.004, "lateral_slip.compliance": 0.02}),
    "three": Case(
        {
            "wheelbase_scale.scale": 0.02,
            "gyro_bias.bias": 0.003,
            "reference_time_offset.offset": 0.03,
        }
    ),
    "no reference": Case({"wheelbase_scale.scale": 0.02}, has_reference=False),
    "sign": Case({"setup_sign.signal": "gyro"}, duration_s=30.0),
    "play": Case({"backlash.side": "left", "backlash.width": 0.03}, duration_s=120.0),
    "withheld": Case(
        {"cross_slope_drift.ratio": 0.01, "cross_slope_drift.direction": 0.5},
        without=frozenset({"cross_slope_drift"}),
        duration_s=60.0,
    ),
}


def recording(name: str) -> Recording:
    case = CASES[name]
    named: dict[str, dict[str, float | str]] = {}
    for key, value in case.values.items():
        effect, _, parameter = key.partition(".")
        named.setdefault(effect, {})[parameter] = value
    return synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("calibration"), effects=()),
        [EffectSetting(effect, tuple(values.items())) for effect, values in named.items()],
        7,
        reference=ReferenceNoise() if case.has_reference else None,
        contact_noise_m_per_sqrt_m=5e-4,
        duration_s=case.duration_s,
    )


def diagnose(name: str) -> Diagnosis:
    report = diagnose_recordings([recording(name)], ROBOT, WIRE, without=CASES[name].without)
    return report.diagnosis


@cache
def diagnosed(name: str) -> Diagnosis:
    """Return the diagnosis of a drive; made once."""
    return diagnose(name)


def number(diagnosis: Diagnosis, key: str) -> NumberEstimate:
    """Return what the first answer says of a number."""
    known = diagnosis.which[0].parameters[key]
    assert isinstance(known, NumberEstimate)
    return known
