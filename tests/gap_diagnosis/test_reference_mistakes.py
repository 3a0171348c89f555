"""A reference in a wrong unit, or mirrored, is put right and told."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosed import ROBOT, WIRE
from full_size import at_full_size

from gap_diagnosis.recording import Floats, Recording, Reference
from gap_diagnosis.reference_mistakes import MistakeBlock, with_reference_put_right
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting, parse_effect
from hil_harness.scenarios import scenario

LASTS_S = 30.0


@cache
def drive(*effects: EffectSetting) -> Recording:
    return synthetic_recording(
        ROBOT, WIRE, scenario("random"), effects, 3, reference=ReferenceNoise(), duration_s=LASTS_S
    )


def wrong(recording: Recording, signal: str, factor: float) -> Recording:
    reference = recording.reference
    assert reference is not None
    assert reference.heading_rad is not None
    if signal == "reference":
        flipped = replace(reference, y_m=factor * reference.y_m)
        return replace(
            recording, reference=replace(flipped, heading_rad=factor * reference.heading_rad)
        )
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
        ("reference_heading", 180 / math.pi),
        ("reference_heading", -1.0),
        ("reference", -1.0),
        *at_full_size(("reference_position", 0.5), ("reference_heading", math.pi / 180)),
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
    assert right.reference.y_m == pytest.approx(recording.reference.y_m)
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


def healthy(name: str) -> tuple[Recording, Reference, Floats]:
    """Return a drive without any effect, its reference, and the headings of that."""
    recording = synthetic_recording(
        ROBOT, WIRE, scenario(name), (), 4, reference=ReferenceNoise(), duration_s=LASTS_S
    )
    reference = recording.reference
    assert reference is not None
    assert reference.heading_rad is not None
    return recording, reference, reference.heading_rad


@pytest.mark.parametrize("quarters", [0, 1, *at_full_size(2, 3)])
@pytest.mark.parametrize("name", ["random", *at_full_size("square", "figure8")])
def test_a_clockwise_heading_is_turned_into_the_frame_of_its_positions(
    name: str, quarters: int
) -> None:
    recording, reference, heading_rad = healthy(name)
    compass = replace(reference, heading_rad=quarters * math.pi / 2 - heading_rad)
    right, mistake = with_reference_put_right(replace(recording, reference=compass), ROBOT)
    assert mistake is not None
    assert (mistake.effect, mistake.signal) == ("setup_sign", "reference_heading")
    assert mistake.quarter_turns == -quarters % 4
    assert mistake.log_evidence > 1000
    assert right.reference is not None
    assert right.reference.x_m == pytest.approx(reference.x_m)
    assert right.reference.heading_rad is not None
    off_rad = right.reference.heading_rad - heading_rad
    assert np.exp(1j * off_rad) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["random", *at_full_size("square", "figure8")])
@pytest.mark.parametrize("exchanged", [True, False])
def test_positions_of_the_other_hand_beside_a_right_heading_are_told(
    name: str, exchanged: bool
) -> None:
    """They were an unlisted cause, > 0.999, with a gap of a metre."""
    recording, reference, heading_rad = healthy(name)
    x_m, y_m = (reference.y_m, reference.x_m) if exchanged else (reference.x_m, -reference.y_m)
    other = replace(recording, reference=replace(reference, x_m=x_m, y_m=y_m))
    right, mistake = with_reference_put_right(other, ROBOT)
    assert mistake is not None
    assert (mistake.effect, mistake.signal) == ("setup_sign", "reference_position")
    assert mistake.quarter_turns % 2 == exchanged
    assert mistake.log_evidence > 1000
    assert right.reference is not None
    assert right.reference.heading_rad is not None
    # Turned into the positions' frame, or as it is.
    way = np.diff(right.reference.x_m + 1j * right.reference.y_m)
    true = np.diff(reference.x_m + 1j * reference.y_m)
    turned = np.exp(1j * (right.reference.heading_rad - heading_rad)[:-1])
    assert way == pytest.approx(true * turned, abs=1e-9)


@pytest.mark.parametrize("name", ["random", *at_full_size("square", "figure8")])
@pytest.mark.parametrize("signal", ["reference_heading", "reference_position"])
def test_without_a_gyro_the_third_of_wheels_positions_and_headings_is_wrong(
    name: str, signal: str
) -> None:
    """Of a recorded robot without a gyro both were an unlisted cause, > 0.999."""
    recording, reference, heading_rad = healthy(name)
    blind = replace(recording, gyro_code=None, gyro_rate_rad_s=None, w_command_rad_s=None)
    other = replace(reference, heading_rad=-heading_rad)
    if signal == "reference_position":
        other = replace(reference, x_m=reference.y_m, y_m=reference.x_m)
    _, mistake = with_reference_put_right(replace(blind, reference=other), ROBOT)
    assert mistake is not None
    assert (mistake.effect, mistake.signal) == ("setup_sign", signal)
    assert mistake.log_evidence > 1000
    # With all of it mirrored it may as well be the wheels that are swapped.
    whole = replace(reference, y_m=-reference.y_m, heading_rad=-heading_rad)
    assert with_reference_put_right(replace(blind, reference=whole), ROBOT)[1] is None


def test_a_clockwise_heading_of_no_known_zero_keeps_its_zero() -> None:
    recording = drive()
    reference = recording.reference
    assert reference is not None
    assert reference.heading_rad is not None
    other = replace(reference, heading_rad=0.7 - reference.heading_rad)
    _, mistake = with_reference_put_right(replace(recording, reference=other), ROBOT)
    assert mistake is None or mistake.quarter_turns == 0


def test_a_mistake_that_is_not_to_be_named_stays() -> None:
    recording = wrong(drive(), "reference_heading", -1.0)
    assert with_reference_put_right(recording, ROBOT, frozenset({"setup_sign"})) == (
        recording,
        None,
    )


@cache
def with_positions(name: str, noise_m: float, rate_hz: float) -> Recording:
    """Return a drive beside a reference without orientation."""
    noise = ReferenceNoise(position_m=noise_m, rate_hz=rate_hz)
    recording = synthetic_recording(
        ROBOT, WIRE, scenario(name), (), 3, reference=noise, duration_s=LASTS_S
    )
    assert recording.reference is not None
    return replace(recording, reference=replace(recording.reference, heading_rad=None))


def mirrored(recording: Recording) -> Recording:
    """Return it with the reference's axes as north, east, down has them."""
    reference = recording.reference
    assert reference is not None
    heading = reference.heading_rad
    ned = Reference(
        reference.t_s,
        reference.y_m,
        reference.x_m,
        None if heading is None else math.pi / 2 - heading,
    )
    return replace(recording, reference=ned)


@pytest.mark.parametrize(
    ("name", "noise_m", "rate_hz"),
    [
        ("random", 0.0005, 100.0),
        ("square", 0.005, 10.0),
        *at_full_size(("random", 0.02, 10.0), ("random", 0.02, 1.0)),
    ],
)
def test_mirrored_positions_are_told_without_any_heading(
    name: str, noise_m: float, rate_hz: float
) -> None:
    recording = with_positions(name, noise_m, rate_hz)
    right, mistake = with_reference_put_right(mirrored(recording), ROBOT)
    assert mistake is not None
    assert (mistake.effect, mistake.signal) == ("setup_sign", "reference")
    assert mistake.log_evidence > 20
    # Of another axis than north, east, down has, but of the right hand.
    assert right.reference is not None
    assert recording.reference is not None
    assert right.reference.x_m == pytest.approx(recording.reference.y_m)
    assert right.reference.y_m == pytest.approx(-recording.reference.x_m)
    assert with_reference_put_right(right, ROBOT) == (right, None)


def test_axes_that_are_swapped_and_a_clockwise_heading_are_one_mirrored_reference() -> None:
    _, mistake = with_reference_put_right(mirrored(drive()), ROBOT)
    assert mistake is not None
    assert (mistake.effect, mistake.signal) == ("setup_sign", "reference")


def test_a_mirrored_reference_is_told_of_a_robot_that_turns_less_than_its_wheels_say() -> None:
    recording = drive(parse_effect("wheelbase_scale.scale=0.4"))
    _, mistake = with_reference_put_right(mirrored(recording), ROBOT)
    assert mistake is not None
    assert (mistake.effect, mistake.signal) == ("setup_sign", "reference")


@pytest.mark.parametrize(
    ("name", "noise_m", "rate_hz"),
    [
        ("random", 0.05, 1.0),
        ("random", 0.5, 10.0),
        ("square", 1.0, 1.0),
        ("straight", 0.02, 10.0),
        ("spin", 0.02, 10.0),
    ],
)
def test_noise_without_a_heading_is_no_mirrored_reference(
    name: str, noise_m: float, rate_hz: float
) -> None:
    recording = with_positions(name, noise_m, rate_hz)
    assert with_reference_put_right(recording, ROBOT) == (recording, None)


@pytest.mark.parametrize(
    "effect",
    [
        EffectSetting("setup_wheels_swapped", ()),
        EffectSetting("setup_sign", (("signal", "gyro"),)),
    ],
)
def test_a_wheel_or_a_gyro_that_turns_the_other_way_is_not_laid_to_positions(
    effect: EffectSetting,
) -> None:
    recording = drive(effect)
    assert recording.reference is not None
    positions = replace(recording, reference=replace(recording.reference, heading_rad=None))
    for one in (recording, positions):
        assert with_reference_put_right(one, ROBOT) == (one, None)


def test_without_a_gyro_the_wheels_may_as_well_be_the_ones_that_are_wrong() -> None:
    recording = replace(drive(), gyro_code=None, gyro_rate_rad_s=None)
    for one in (recording, with_positions("random", 0.0005, 100.0)):
        alone = replace(
            one,
            gyro_code=None,
            gyro_rate_rad_s=None,
            v_command_m_s=None,
            w_command_rad_s=None,
        )
        blind = mirrored(alone)
        assert with_reference_put_right(blind, ROBOT) == (blind, None)


def test_commands_tell_as_well_as_a_gyro_whether_it_is_the_reference_that_is_mirrored() -> None:
    recording = replace(drive(), gyro_code=None, gyro_rate_rad_s=None)
    _, mistake = with_reference_put_right(mirrored(recording), ROBOT)
    assert mistake is not None
    assert (mistake.effect, mistake.signal) == ("setup_sign", "reference")
    swapped = replace(recording, left_ticks=recording.right_ticks, right_ticks=recording.left_ticks)
    assert with_reference_put_right(swapped, ROBOT) == (swapped, None)
