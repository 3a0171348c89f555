"""What a diagnosis gives to take home: effects that load, a description with only what changed."""

from __future__ import annotations

import difflib
import math
from pathlib import Path

import diagnosis_samples as samples
import pytest
from diagnosis_samples import number
from hypothesis import given
from hypothesis import strategies as st

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import (
    ChoiceEstimate,
    InputFile,
    KnownEffect,
    NumberEstimate,
    ParameterEstimate,
)
from gap_diagnosis.take_home import corrected_effects, effects_text, robot_text
from hil_harness.effects import Effect, EffectParameter, catalogue, load_effects
from hil_harness.robot import Robot, default_robot_text, load_robot

OWN = """# Our robot, measured by Ada.
[robot]
name = "cart"

[wheels]
wheelbase_m = 0.4   # tape measure
radius_m=0.1

[gyro]
sensitivity_lsb_per_rad_s = 1000.0
"""


def own_robot(tmp_path: Path, text: str = OWN) -> Robot:
    file = tmp_path / "cart.toml"
    file.write_text(text, encoding="utf-8", newline="")
    return load_robot(file)


def written(tmp_path: Path, text: str) -> Robot:
    file = tmp_path / "calibrated.toml"
    file.write_text(text, encoding="utf-8", newline="")
    return load_robot(file)


def test_the_found_effects_are_read_by_whoever_reads_effects(tmp_path: Path) -> None:
    file = tmp_path / "explained.toml"
    file.write_text(effects_text(samples.diagnosis()), encoding="utf-8")
    assert [(one.effect, dict(one.values)) for one in load_effects(file)] == [
        ("radius_mismatch", {"mismatch": -0.004}),
        ("radius_scale", {"scale": -0.005}),
    ]
    assert [one.ci95 for one in load_effects(file)] == [
        (("mismatch", (-0.004196, -0.003804)),),
        (("scale", (-0.005392, -0.004608)),),
    ]


def test_intervals_and_the_other_names_of_the_group_stand_beside_them() -> None:
    text = effects_text(samples.diagnosis())
    assert "mismatch = -0.004\nmismatch_ci95 = [-0.004196, -0.003804]" in text
    assert "# This data cannot tell it from radius_mismatch + ticks_per_rev." in text
    assert "in run.log." in text


KNOWN = KnownEffect(
    effect="lateral_slip",
    values={"compliance": 0.03},
    ci95={"compliance": (0.029, 0.031)},
    file="before.toml",
)


def test_what_was_known_before_stands_beside_what_was_found(tmp_path: Path) -> None:
    file = tmp_path / "explained.toml"
    text = effects_text(samples.diagnosis(granted=(KNOWN,)))
    file.write_text(text, encoding="utf-8")
    assert "# Known before, by before.toml.\n[lateral_slip]\n" in text
    (slip,) = (one for one in load_effects(file) if one.effect == "lateral_slip")
    assert (slip.values, slip.ci95) == (
        (("compliance", 0.03),),
        (("compliance", (0.029, 0.031)),),
    )


def test_a_known_effect_that_changed_is_not_written_as_if_it_were_the_change() -> None:
    known = KnownEffect(effect="wheelbase_scale", values={"scale": 0.02}, file="before.toml")
    found = samples.single().model_copy(update={"granted": (known,)})
    with pytest.raises(DiagnosisError, match=r"^wheelbase_scale: before\.toml states another size"):
        effects_text(found)
    assert "[wheelbase_scale]" in effects_text(found, without=["wheelbase_scale"])


def test_a_constant_that_a_replay_tells_to_its_last_digits_is_written_with_them() -> None:
    found = samples.single("firmware_constant", scale=number(0.0131234567891234, 3e-13))
    assert "scale = 0.0131234567891" in effects_text(found)


@pytest.mark.parametrize("found", [samples.nothing(), samples.unlisted()])
def test_without_a_cause_the_file_switches_nothing_on(tmp_path: Path, found: Diagnosis) -> None:
    file = tmp_path / "explained.toml"
    file.write_text(effects_text(found), encoding="utf-8")
    assert load_effects(file) == ()


def test_choices_and_windows_are_written_as_the_simulator_takes_them(tmp_path: Path) -> None:
    found = samples.single(
        "one_sided_slip",
        side=ChoiceEstimate(estimate="left", probabilities={"left": 0.9, "right": 0.1}),
        ratio=number(0.03, 0.001),
        start_s=number(12.0, 0.1, "s"),
    )
    file = tmp_path / "explained.toml"
    file.write_text(effects_text(found), encoding="utf-8")
    (slip,) = load_effects(file)
    assert dict(slip.values) == {"side": "left", "ratio": 0.03, "start_s": 12.0}


def of_a_while(**window: NumberEstimate) -> Diagnosis:
    """Return: a track that is wider for a while, in a log of 60 s."""
    return samples.single("wheelbase_scale", scale=number(0.04, 0.0005), **window)


def test_an_effect_that_began_on_the_way_begins_in_the_simulator_as_well(tmp_path: Path) -> None:
    """It acted from the start there; the log's own end is none of the effect's."""
    file = tmp_path / "explained.toml"
    window = {"start_s": number(30.0, 0.1, "s"), "stop_s": number(59.99, 0.001, "s")}
    file.write_text(effects_text(of_a_while(**window)), encoding="utf-8")
    (wider,) = load_effects(file)
    assert dict(wider.values) == {"scale": 0.04, "start_s": 30.0}


def test_what_may_as_well_act_up_to_the_end_of_a_log_has_no_end_in_the_simulator(
    tmp_path: Path,
) -> None:
    """A robot that rests at the end tells of no moment of its rest whether its track is wider: in
    another drive it was wider for half of the time."""
    file = tmp_path / "explained.toml"
    anywhere = number(55.0, 3.0, "s").model_copy(update={"ci95": (50.7, 59.99)})
    begins = number(30.0, 0.1, "s")
    file.write_text(effects_text(of_a_while(start_s=begins, stop_s=anywhere)), encoding="utf-8")
    (wider,) = load_effects(file)
    assert dict(wider.values) == {"scale": 0.04, "start_s": 30.0}


def test_what_acts_for_a_while_corrects_no_constant() -> None:
    """A calibration of all times had a track that was wider for half a minute."""
    window = {"start_s": number(10.0, 0.1, "s"), "stop_s": number(40.0, 0.1, "s")}
    assert corrected_effects(of_a_while(), load_robot()) == ("wheelbase_scale",)
    assert corrected_effects(of_a_while(**window), load_robot()) == ()
    until = {"stop_s": number(40.0, 0.1, "s")}
    assert corrected_effects(of_a_while(**until), load_robot()) == ()


def estimated(parameter: EffectParameter) -> ParameterEstimate:
    """Return what a diagnosis could say of `parameter`: its choice, or a size within its range."""
    if parameter.kind in ("choice", "message"):
        one = parameter.choices[-1] if parameter.choices else "IMU"
        return ChoiceEstimate(estimate=one, probabilities={one: 0.9, "other": 0.1})
    low, high = max(parameter.minimum, -1.0), min(parameter.maximum, 1.0)
    return number(low if low == high else (low + high) / 2, 0.001, parameter.unit)


@pytest.mark.parametrize("effect", catalogue().values(), ids=lambda effect: effect.name)
def test_each_effect_of_the_catalogue_is_written_as_the_simulator_reads_it(
    tmp_path: Path, effect: Effect
) -> None:
    told = {parameter.name: estimated(parameter) for parameter in effect.parameters}
    file = tmp_path / "explained.toml"
    file.write_text(effects_text(samples.single(effect.name, **told)), encoding="utf-8")
    (setting,) = load_effects(file)
    assert setting.effect == effect.name
    assert [name for name, _ in setting.values] == list(told)
    for name, value in setting.values:
        if isinstance(value, str):
            assert value == told[name].estimate


def test_an_estimate_beyond_what_can_be_is_written_at_the_edge(tmp_path: Path) -> None:
    file = tmp_path / "explained.toml"
    found = samples.single("longitudinal_slip", compliance=number(-1e-6, 1e-4, "s²/m"))
    file.write_text(effects_text(found), encoding="utf-8")
    assert dict(load_effects(file)[0].values) == {"compliance": 0.0}


def test_an_effect_that_the_simulator_lacks_is_told() -> None:
    with pytest.raises(DiagnosisError, match="sticky_floor: the simulator has no effect"):
        effects_text(samples.single("sticky_floor", glue=number(1.0, 0.1)))


@given(scale=st.floats(-0.2, 0.2))
def test_a_corrected_length_is_described_times_one_plus_scale(scale: float) -> None:
    robot = load_robot()
    text = robot_text(samples.single("wheelbase_scale", scale=number(scale, 1e-4)), robot)
    line = next(line for line in text.split("\n") if line.startswith("wheelbase_m"))
    value = float(line.split("=")[1].split("#")[0])
    assert math.isclose(value, 0.2985 * (1 + scale), rel_tol=1e-8)


def test_only_the_corrected_line_changes_and_it_says_from_to_and_whence(tmp_path: Path) -> None:
    robot = own_robot(tmp_path)
    text = robot_text(samples.single("wheelbase_scale", scale=number(0.01, 0.001)), robot)
    changes = [
        line
        for line in difflib.ndiff(OWN.split("\n"), text.split("\n"))
        if line.startswith(("-", "+"))
    ]
    assert changes == [
        "- wheelbase_m = 0.4   # tape measure",
        "+ wheelbase_m = 0.404   # tape measure; from 0.4 to 0.404 ± 0.0004, "
        "diagnosed from run.log",
    ]
    assert written(tmp_path, text).plant.wheels.wheelbase_m == 0.404


def test_what_a_comment_says_of_the_old_value_in_another_unit_was_so() -> None:
    robot = load_robot()
    text = robot_text(samples.single("gyro_scale", scale=number(0.012, 1e-4)), robot)
    line = next(one for one in text.split("\n") if one.startswith("sensitivity_lsb_per_rad_s"))
    assert "codes per rad/s; this was 131 LSB per °/s; from 7505.7" in line
    assert "this is 250 °/s" in text  # of a line that stays


def test_line_ends_of_another_system_are_kept(tmp_path: Path) -> None:
    robot = own_robot(tmp_path, OWN.replace("\n", "\r\n"))
    text = robot_text(samples.single("wheelbase_scale", scale=number(0.01, 0.001)), robot)
    assert text.count("\r\n") == OWN.count("\n")
    assert written(tmp_path, text).plant.wheels.wheelbase_m == 0.404


def test_a_constant_that_the_file_left_out_is_added_to_its_table(tmp_path: Path) -> None:
    robot = own_robot(tmp_path)
    text = robot_text(samples.single("gyro_bias", bias=number(0.1, 0.001, "rad/s")), robot)
    assert "[gyro]\nzero_rate_code = 32868  # from 32768 to 32868 ± 1, diagnosed" in text
    assert written(tmp_path, text).plant.gyro.zero_rate_code == 32868


def test_a_table_that_the_file_left_out_is_added(tmp_path: Path) -> None:
    robot = own_robot(tmp_path)
    text = robot_text(samples.single("drive_lag", time_constant=number(0.02, 0.001, "s")), robot)
    assert written(tmp_path, text).plant.drive.time_constant_s == pytest.approx(0.07)


def test_the_shipped_robot_keeps_its_page_of_comments() -> None:
    text = robot_text(samples.single("radius_scale", scale=number(-0.005, 1e-4)), load_robot())
    assert len(text.split("\n")) == len(default_robot_text().split("\n"))
    assert "radius_m = 0.04999875    # mean rolling radius" in text


@pytest.mark.parametrize(
    ("effect", "parameter", "table", "key", "value"),
    [
        ("gyro_scale", number(0.01, 1e-4), "gyro", "sensitivity_lsb_per_rad_s", 7580.80458727),
        ("ticks_per_rev", number(0.005, 1e-4), "encoder", "ticks_per_rev", 2058),
        ("adc_offset", number(20.0, 0.5, "LSB"), "gyro", "zero_rate_code", 32788),
        ("drive_saturation", number(12.0, 0.1, "rad/s"), "drive", "max_wheel_rate_rad_s", 12.0),
    ],
)
def test_each_correctable_effect_moves_its_constant(
    tmp_path: Path, effect: str, parameter: NumberEstimate, table: str, key: str, value: int
) -> None:
    name = {"adc_offset": "offset", "drive_saturation": "limit"}.get(effect, "scale")
    found = samples.single(effect, **{name: parameter})
    robot = written(tmp_path, robot_text(found, load_robot()))
    assert getattr(getattr(robot.plant, table), key) == pytest.approx(value, rel=1e-9)
    assert corrected_effects(found, load_robot()) == (effect,)


def test_what_the_description_cannot_say_stays_an_effect() -> None:
    found = samples.diagnosis()
    taken = corrected_effects(found, load_robot())
    assert taken == ("radius_scale",)
    left = effects_text(found, without=taken)
    assert "[radius_mismatch]" in left
    assert "[radius_scale]" not in left


def test_a_fraction_of_a_coarse_tick_is_not_rounded_away(tmp_path: Path) -> None:
    robot = own_robot(tmp_path, OWN + "[encoder]\nticks_per_rev = 20\n")
    found = samples.single("ticks_per_rev", scale=number(0.01, 1e-3))
    assert corrected_effects(found, robot) == ()
    assert robot_text(found, robot) == OWN + "[encoder]\nticks_per_rev = 20\n"


def test_a_strangers_file_name_cannot_write_lines() -> None:
    evil = InputFile(role="log", name="a\n[wheels]\nradius_m = 9", sha256=samples.SHA256)
    found = samples.diagnosis(inputs=(evil,))
    assert "\n[wheels]\nradius_m = 9" not in effects_text(found)
    assert "\nradius_m = 9" not in robot_text(found, load_robot())


def test_a_changed_line_says_from_what_the_data_cannot_tell_its_cause(tmp_path: Path) -> None:
    """A corrected radius looked as sure as one that no count of ticks could explain."""
    robot = own_robot(tmp_path)
    line = next(
        one
        for one in robot_text(samples.diagnosis(), robot).split("\n")
        if one.startswith("radius_m=")
    )
    assert line.endswith(
        "diagnosed from run.log; this data cannot tell radius_mismatch + radius_scale from "
        "radius_mismatch + ticks_per_rev"
    )
