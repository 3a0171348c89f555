"""A reference in a wrong unit, or with a mirrored heading, is put right and told."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest
from diagnosed import ROBOT, WIRE

from gap_diagnosis.recording import Recording
from gap_diagnosis.reference_mistakes import MistakeBlock, with_reference_put_right
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting, parse_effect
from hil_harness.scenarios import scenario


@cache
def drive(*effects: EffectSetting) -> Recording:
    return synthetic_recording(
        ROBOT, WIRE, scenario("random"), effects, 3, reference=ReferenceNoise(), duration_s=60.0
    )


def wrong(recording: Recording, signal: str, factor: float) -> Recording:
    reference = recording.reference
    assert reference is not None
    assert reference.heading_rad is not None
    if signal == "reference_heading":
        return replace(
            recording, reference=replace(reference, heading_rad=factor * reference.heading_rad)
        )
    moved = replace(reference, x_m=factor * reference.x_m, y_m=factor * reference.y_m)
    return replace(recording, reference=moved)


@pytest.mark.parametrize(
    ("signal", "factor"),
    [
        ("reference_position", 1000.0),
        ("reference_position", 0.5),
        ("reference_heading", 180 / math.pi),
        ("reference_heading", math.pi / 180),
        ("reference_heading", -1.0),
    ],
)
def test_a_wrong_signal_of_the_reference_is_found_and_put_right(signal: str, factor: float) -> None:
    recording = drive(parse_effect("gyro_scale.scale=0.05"))
    right, mistake = with_reference_put_right(wrong(recording, signal, factor), ROBOT)
    assert mistake is not None
    assert (mistake.signal, mistake.factor) == (signal, factor)
    assert mistake.effect == ("setup_sign" if factor < 0 else "setup_unit")
    assert mistake.log_evidence > 1000
    assert MistakeBlock(mistake).fit(MistakeBlock(mistake).effects).parameters
    assert right.reference is not None
    assert recording.reference is not None
    assert right.reference.x_m == pytest.approx(recording.reference.x_m)
    assert right.reference.heading_rad == pytest.approx(recording.reference.heading_rad)


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (parse_effect("reference_scale.scale=0.02"),),
        (parse_effect("radius_scale.scale=0.05"), parse_effect("gyro_scale.scale=-0.05")),
        (EffectSetting("setup_wheels_swapped", ()),),
        (EffectSetting("setup_unit", (("signal", "ticks"), ("factor", 2.0))),),
        (EffectSetting("setup_unit", (("signal", "gyro"), ("factor", 0.5))),),
        (EffectSetting("encoder_dead", (("side", "left"), ("start_s", 10.0))),),
    ],
)
def test_what_is_wrong_elsewhere_is_not_laid_to_the_reference(
    effects: tuple[EffectSetting, ...],
) -> None:
    recording = drive(*effects)
    assert with_reference_put_right(recording, ROBOT) == (recording, None)


def test_a_mistake_that_is_not_to_be_named_stays() -> None:
    recording = wrong(drive(), "reference_heading", -1.0)
    assert with_reference_put_right(recording, ROBOT, frozenset({"setup_sign"})) == (
        recording,
        None,
    )
