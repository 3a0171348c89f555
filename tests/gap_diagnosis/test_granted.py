"""Effects that are known of a robot: what a log leaves is held against description and these."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from diagnosed import ROBOT, WIRE

from can_bus import CanBusError
from gap_diagnosis.bus import bus_block
from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.drive import drive_block
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.explanations import EXPLAINED
from gap_diagnosis.explanations.known import known_effects
from gap_diagnosis.firmware import firmware_block
from gap_diagnosis.granted import Granted
from gap_diagnosis.granting import load_granted
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.noise import NOISES
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import NumberEstimate
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting, Value, catalogue
from hil_harness.scenarios import scenario

Values = Mapping[str, Mapping[str, Value]]

ELSEWHERE = {"adc_gain", "adc_missing_code", "adc_offset", "blend_weight"}
"""Told by the motion under another name, by the codes alone, by a firmware that blends."""


def settings(values: Values) -> tuple[EffectSetting, ...]:
    return tuple(EffectSetting(effect, tuple(one.items())) for effect, one in values.items())


def driven(values: Values, *, seed: int = 3, duration_s: float = 40.0) -> Recording:
    return synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("calibration"), effects=()),
        settings(values),
        seed,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
        duration_s=duration_s,
    )


def knowing(recording: Recording, values: Values) -> Recording:
    return replace(recording, granted=Granted(settings(values), {}, "explained.toml"))


def stated(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "explained.toml"
    file.write_text(text, encoding="utf-8")
    return file


def taken_by_blocks() -> set[str]:
    recording = driven({})
    blocks = (
        drive_block(recording, ROBOT),
        bus_block(recording, ROBOT, WIRE),
        firmware_block(recording, ROBOT, WIRE),
    )
    effects = frozenset[str]().union(*(one.effects for one in blocks if one is not None))
    return {*EXPLAINED, *NOISES, *effects, *ELSEWHERE}


def is_refused(tmp_path: Path, effect: str) -> bool:
    try:
        load_granted(stated(tmp_path, f"[{effect}]\n"))
    except DiagnosisError as refusal:
        return f": {effect} cannot be known beforehand: " in str(refusal)
    return False


def test_each_effect_is_taken_by_a_block_or_refused_by_name(tmp_path: Path) -> None:
    taken = taken_by_blocks()
    assert [one for one in catalogue() if one not in taken and not is_refused(tmp_path, one)] == []


def test_a_time_of_one_log_says_nothing_of_another(tmp_path: Path) -> None:
    always = '[one_sided_slip]\nside = "left"\nratio = 0.03\n'
    assert load_granted(stated(tmp_path, always)).number("one_sided_slip.ratio") == 0.03
    with pytest.raises(DiagnosisError, match="stop_s is a time of one log"):
        load_granted(stated(tmp_path, always + "stop_s = 20.0\n"))


def test_a_frame_that_the_bus_has_not_is_told() -> None:
    known = {"frame_loss": {"frame": "ENCODR", "probability": 0.01}}
    with pytest.raises(CanBusError, match=r"frame = ENCODR: chiplog\.dbc has no such message"):
        diagnose_recordings(
            [driven({}, duration_s=10.0)], ROBOT, WIRE, granted=Granted(settings(known))
        )


def log_likelihood(recording: Recording) -> float:
    """Return that of no further effect, at the described levels of noise."""
    model = MotionModel(recording, ROBOT, default_prior())
    return model.evidence_at((), model.level_prior.median)


@cache
def of_a_healthy_robot() -> float:
    return log_likelihood(driven({}))


MOTION: dict[str, dict[str, Value]] = {
    "radius_mismatch": {"mismatch": 0.006},
    "wheelbase_scale": {"scale": 0.5},
    "turn_scrub": {"scrub": 0.1},
    "one_sided_slip": {"side": "left", "ratio": 0.03},
    "wheel_eccentricity": {"side": "right", "amplitude": 0.01, "phase": 1.0},
    "encoder_wrap": {"bits": 10},
    "backlash": {"side": "both", "width": 0.03},
    "gyro_bias": {"bias": 0.01},
    "gyro_lag": {"time_constant": 0.08},
    "adc_inl": {"peak": 60.0},
    "reference_lever_arm": {"x": 0.03, "y": 0.01},
}


@pytest.mark.parametrize("speed_m_s", [0.0, 0.3])
def test_a_lateral_slip_that_is_known_acts_in_the_form_that_is_known(speed_m_s: float) -> None:
    """Whatever its speed, it was known to hold at any and at 1 m/s, whichever suited a log."""
    known = Granted(settings({"lateral_slip": {"compliance": 0.03, "speed": speed_m_s}}))
    (found,) = known_effects(known, estimate_motion(driven({}, duration_s=10.0), ROBOT))
    ((variant, sizes),) = found.ways
    assert variant.fixed == {"speed": speed_m_s}
    assert sizes == (0.03,)


@pytest.mark.parametrize("effect", MOTION)
def test_a_log_is_as_likely_beside_a_known_effect_as_a_healthy_robots(effect: str) -> None:
    values = {effect: MOTION[effect]}
    recording = driven(values)
    healthy = of_a_healthy_robot()
    assert log_likelihood(recording) < healthy - 50.0
    assert log_likelihood(knowing(recording, values)) > healthy - 10.0


def test_how_a_wheel_stood_when_the_log_began_the_log_says() -> None:
    recording = driven({"wheel_eccentricity": MOTION["wheel_eccentricity"]})
    elsewhere = {"wheel_eccentricity": {**MOTION["wheel_eccentricity"], "phase": -1.7}}
    assert log_likelihood(knowing(recording, elsewhere)) > of_a_healthy_robot() - 10.0


def test_what_an_estimate_is_off_by_is_no_news() -> None:
    """Three millimetres in ten metres, one standard deviation of what was known."""
    recording = driven({"radius_mismatch": {"mismatch": 0.006}})
    told = EffectSetting(
        "radius_mismatch", (("mismatch", 0.003),), (("mismatch", (-0.003, 0.009)),)
    )
    exact = replace(told, ci95=())
    unsure, sure = (
        log_likelihood(replace(recording, granted=Granted((one,)))) for one in (told, exact)
    )
    assert unsure > of_a_healthy_robot() - 10.0
    assert sure < unsure - 5.0


def test_a_program_that_is_known_gives_the_record_to_its_last_digit_and_a_further_cause_shows() -> (
    None
):
    constant = {"firmware_constant": {"constant": "wheel_radius", "scale": 0.0131234567}}
    euler = {"euler_integration": {"heading": "after"}}
    block = firmware_block(knowing(driven(constant), constant), ROBOT, WIRE)
    assert block is not None
    assert block.is_equal
    further = firmware_block(knowing(driven({**constant, **euler}), constant), ROBOT, WIRE)
    assert further is not None
    assert not further.is_equal
    assert further.fit(frozenset(euler)).log_evidence > 100.0


def test_a_drive_that_is_known_does_as_it_is_told_and_a_further_cause_shows() -> None:
    drive = {"drive_lag": {"time_constant": 0.08}, "drive_gain": {"left": 0.05, "right": 0.0}}
    band = {"drive_deadband": {"rate": 0.6}}

    def gains(values: Values) -> dict[str, float]:
        known = Granted(settings(drive))
        recording = replace(driven(values), granted=known)
        block = drive_block(recording, known.robot(ROBOT))
        assert block is not None
        told = ("drive_lag", "drive_gain", "drive_deadband")
        return {one: block.fit(frozenset({one})).log_evidence for one in told}

    assert max(gains(drive).values()) < 0.0
    assert gains({**drive, **band})["drive_deadband"] > 20.0


def test_counts_with_known_errors_are_no_fault_of_the_drive() -> None:
    ticks = {"ticks_per_rev": {"scale": 0.02}}
    block = drive_block(knowing(driven(ticks), ticks), ROBOT)
    assert block is not None
    for effect in ("drive_gain", "ticks_per_rev"):
        assert block.fit(frozenset({effect})).log_evidence < 0.0


BUS: dict[str, tuple[dict[str, Value], str, float]] = {
    "frame_loss": ({"frame": "ENCODER", "probability": 0.02}, "probability", 10.0),
    "frame_jitter": ({"frame": "IMU", "sigma": 0.002}, "sigma", 4.0),
    "frame_latency": ({"frame": "IMU", "delay": 0.006}, "delay", 3.0),
    "clock_skew": ({"skew": 0.002}, "skew", 3.0),
}


@pytest.mark.parametrize("effect", BUS)
def test_a_bus_that_does_what_it_is_known_for_is_no_news_and_one_that_does_more_is(
    effect: str,
) -> None:
    values, size, times = BUS[effect]
    known = {effect: values}
    worse = {effect: {**values, size: times * float(values[size])}}

    def evidence(recording: Recording) -> float:
        block = bus_block(recording, ROBOT, WIRE)
        assert block is not None
        return block.fit(frozenset({effect})).log_evidence

    assert evidence(driven(known)) > 3.0
    assert evidence(knowing(driven(known), known)) < 1.0
    assert evidence(knowing(driven(worse), known)) > 3.0


ALL_BLOCKS: Values = {
    "drive_lag": {"time_constant": 0.08},
    "lateral_slip": {"compliance": 0.03},
    "gyro_scale": {"scale": 0.02},
    "adc_missing_code": {"code": 32800},
    "frame_loss": {"frame": "ENCODER", "probability": 0.02},
    "firmware_resolution": {"variable": "position", "bits": 4},
    "reference_time_offset": {"offset": 0.03},
}


@pytest.mark.full_size
def test_beside_what_is_known_in_every_block_there_is_no_gap_or_the_further_cause() -> None:
    known = Granted(settings(ALL_BLOCKS), {}, "explained.toml")

    def found(values: Values) -> Diagnosis:
        recording = driven(values, duration_s=60.0)
        return diagnose_recordings([recording], ROBOT, WIRE, granted=known).diagnosis

    healthy = found(ALL_BLOCKS)
    assert healthy.verdict == "no_gap"
    assert healthy.gap is not None
    assert healthy.gap.floor is not None
    assert healthy.gap.before < 1.2 * healthy.gap.floor
    assert [one.effect for one in healthy.granted] == [*ALL_BLOCKS]
    assert {one.file for one in healthy.granted} == {"explained.toml"}
    further = found({**ALL_BLOCKS, "radius_mismatch": {"mismatch": 0.006}})
    assert further.verdict == "radius_mismatch"
    mismatch = further.which[0].parameters["radius_mismatch.mismatch"]
    assert isinstance(mismatch, NumberEstimate)
    assert mismatch.ci95[0] < 0.006 < mismatch.ci95[1]


def test_noise_that_is_known_is_no_less_than_what_is_described(tmp_path: Path) -> None:
    """The plant takes the larger one; a diagnosis took what the file said."""
    described = ROBOT.plant.gyro.noise_density_rad_per_sqrt_s
    quiet = load_granted(stated(tmp_path, f"[gyro_noise]\ndensity = {described / 2}\n"))
    loud = load_granted(stated(tmp_path, f"[gyro_noise]\ndensity = {described * 2}\n"))
    found = [one.robot(ROBOT).plant.gyro.noise_density_rad_per_sqrt_s for one in (quiet, loud)]
    assert found == pytest.approx([described, 2 * described])
