"""The catalogue says of each effect what it is, and refuses what it is not."""

import math
import pickle
from dataclasses import fields, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_harness.effects import (
    Effect,
    EffectParameter,
    EffectSetting,
    Settings,
    Value,
    apply_effects,
    catalogue,
    combine_effects,
    load_effects,
    parse_effect,
    read_effects,
)
from hil_harness.errors import HarnessError
from sim_plant import Mechanisms

STAGES = ["actuation", "wheel", "encoder", "gyro", "bus", "firmware", "reference", "setup"]
EFFECTS = list(catalogue().values())
PLANT_EFFECTS = [e for e in EFFECTS if e.stage in ("actuation", "wheel", "encoder", "gyro")]
SWITCHES = {"setup_wheels_swapped"}  # on or off: naming it switches it on

# What must be on beside a parameter for it to be felt.
COMPANY: dict[str, dict[str, Value]] = {
    "frame_loss": {"probability": 0.01},
    "coarse_trig_table": {"entries": 64},
}


def ordinary_value(parameter: EffectParameter) -> Value:
    """Return a value that is allowed and not neutral."""
    if parameter.kind == "message":
        return "IMU"
    if parameter.name in ("entries", "bits"):
        return 4
    if parameter.kind == "whole" and parameter.neutral == 1:
        return 0 if parameter.maximum == 1 else 3
    if parameter.kind == "choice":
        return next(choice for choice in parameter.choices if choice != parameter.neutral)
    if parameter.kind == "whole":
        return int(parameter.maximum) // 2 + 1
    for value in (0.01, 0.0005, 0.1, 1.0, 30.0):
        if parameter.minimum <= value <= parameter.maximum and value != parameter.neutral:
            return value
    raise AssertionError(parameter)


def test_effects_stand_in_the_order_in_which_data_flows() -> None:
    ranks = [STAGES.index(effect.stage) for effect in EFFECTS]
    assert ranks == sorted(ranks)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_an_effect_is_declared_in_full(effect: Effect) -> None:
    assert effect.signature.endswith(".")
    assert len({parameter.name for parameter in effect.parameters}) == len(effect.parameters)
    for parameter in effect.parameters:
        assert parameter.meaning
        assert (parameter.kind == "choice") == bool(parameter.choices)
        assert (parameter.kind in ("choice", "message")) == (parameter.unit == "")
        if parameter.typical is not None:
            assert parameter.typical.source
            assert 0 <= parameter.typical.low < parameter.typical.high <= parameter.maximum
    for twins in effect.twins:
        assert set(twins.effects) <= set(catalogue())


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_twins_without_a_condition_know_of_each_other(effect: Effect) -> None:
    for twins in effect.twins:
        if not twins.condition and len(twins.effects) == 1:
            other = catalogue()[twins.effects[0]]
            assert any(effect.name in back.effects for back in other.twins)


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_at_neutral_an_effect_changes_no_mechanism(effect: Effect) -> None:
    assert (effect.apply(Settings(), effect.neutral()) == Settings()) == (
        effect.name not in SWITCHES
    )
    assert (apply_effects([EffectSetting(effect.name, ())]) == Settings()) == (
        effect.name not in SWITCHES
    )


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_every_number_of_an_effect_moves_a_mechanism_of_its_own(effect: Effect) -> None:
    beside = COMPANY.get(effect.name, {})
    alone = apply_effects([EffectSetting(effect.name, tuple(beside.items()))])
    for parameter in effect.parameters:
        values = beside | {parameter.name: ordinary_value(parameter)}
        if parameter.name == "side" or values == beside:
            continue
        assert apply_effects([EffectSetting(effect.name, tuple(values.items()))]) != alone


def test_every_mechanism_of_the_plant_is_moved_by_exactly_one_effect() -> None:
    moved: dict[str, list[str]] = {item.name: [] for item in fields(Mechanisms)}
    for effect in [*PLANT_EFFECTS, catalogue()["clock_skew"]]:
        values = tuple(
            (parameter.name, ordinary_value(parameter))
            for parameter in effect.parameters
            if parameter.kind != "choice"
        )
        plant = apply_effects([EffectSetting(effect.name, values)]).plant
        for item in fields(Mechanisms):
            if getattr(plant, item.name) != getattr(Mechanisms(), item.name):
                moved[item.name].append(effect.name)
    assert {name: effects for name, effects in moved.items() if len(effects) != 1} == {}


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_a_side_moves_that_side_alone(effect: Effect) -> None:
    if "side" not in effect.neutral():
        return
    values = tuple((p.name, ordinary_value(p)) for p in effect.parameters if p.kind != "choice")
    left, right, both = (
        apply_effects([EffectSetting(effect.name, (("side", side), *values))]).plant
        for side in ("left", "right", "both")
    )
    for item in fields(Mechanisms):
        neutral = getattr(Mechanisms(), item.name)
        if "left" in item.name:
            assert getattr(left, item.name) == getattr(both, item.name)
            assert getattr(right, item.name) == neutral
        if "right" in item.name:
            assert getattr(right, item.name) == getattr(both, item.name)
            assert getattr(left, item.name) == neutral


settings = st.sampled_from([e for e in EFFECTS if e.name not in SWITCHES]).map(
    lambda effect: EffectSetting(
        effect.name, tuple((p.name, ordinary_value(p)) for p in effect.parameters)
    )
)


@given(st.lists(settings, unique_by=lambda setting: setting.effect), st.randoms())
def test_any_effects_combine_in_any_order(chosen: list[EffectSetting], random: object) -> None:
    together = apply_effects(chosen)
    assert apply_effects(reversed(chosen)) == together
    for part in ("plant", "bus", "firmware", "reference", "setup"):
        neutral = expected = getattr(Settings(), part)
        for setting in chosen:
            alone = getattr(apply_effects([setting]), part)
            moved = {
                item.name: getattr(alone, item.name)
                for item in fields(expected)
                if getattr(alone, item.name) != getattr(neutral, item.name)
            }
            expected = replace(expected, **moved)
        assert getattr(together, part) == expected


def test_a_setting_is_parsed_from_the_command_line() -> None:
    assert parse_effect("gyro_bias.bias=0.005") == EffectSetting("gyro_bias", (("bias", 0.005),))
    assert parse_effect("gyro_bias.bias=-5e-3").values == (("bias", -0.005),)
    assert parse_effect("one_sided_slip.side=left").values == (("side", "left"),)
    assert parse_effect("adc_stuck_bit.bit=3").values == (("bit", 3),)
    assert parse_effect("drive_saturation.limit=inf").values == (("limit", math.inf),)
    assert str(parse_effect(" gyro_bias.bias = 0.005 ")) == "gyro_bias.bias=0.005"


@given(settings)
def test_a_setting_reads_back_what_it_prints(setting: EffectSetting) -> None:
    parsed = combine_effects(parse_effect(text) for text in str(setting).split())
    assert parsed == (setting,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "gyro_bais.bias=1",
            "effect gyro_bais.bias=1: no such effect: the nearest is gyro_bias",
        ),
        (
            "gyro_bias.bais=1",
            "effect gyro_bias.bais=1: gyro_bias has no such parameter: the nearest is bias",
        ),
        (
            "gyro_bias.zzz=1",
            "effect gyro_bias.zzz=1: gyro_bias has no such parameter: known are bias",
        ),
        ("gyro_bias=1", "effect gyro_bias=1: expected NAME.PARAMETER=VALUE, for example "),
        ("gyro_bias.bias", "effect gyro_bias.bias: expected NAME.PARAMETER=VALUE, for example "),
        ("", "effect : expected NAME.PARAMETER=VALUE, for example gyro_bias.bias=0.005"),
        (
            "gyro_bias.bias=fast",
            "effect gyro_bias.bias=fast: expected a number from -1000 to 1000 [rad/s]",
        ),
        ("gyro_bias.bias=nan", "effect gyro_bias.bias=nan: expected a number from"),
        ("gyro_bias.bias=inf", "effect gyro_bias.bias=inf: expected a number from"),
        ("drive_lag.time_constant=-1", "effect drive_lag.time_constant=-1: expected a number from"),
        ("adc_stuck_bit.bit=1.5", "effect adc_stuck_bit.bit=1.5: expected a whole number from"),
        ("one_sided_slip.side=up", "effect one_sided_slip.side=up: expected one of left, right, "),
        ("one_sided_slip.start_s=1e300", "effect one_sided_slip.start_s=1e300: expected a number "),
        ("gyro_bias.bias=" + "9" * 400, "effect gyro_bias.bias=99999"),
        ("gyro_bias.bias=" + "9" * 5000, "effect gyro_bias.bias=99999"),
    ],
)
def test_a_mistake_on_the_command_line_is_said_in_one_line(text: str, message: str) -> None:
    with pytest.raises(HarnessError) as caught:
        parse_effect(text)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_an_effects_file_has_a_table_per_effect(tmp_path: Path) -> None:
    file = tmp_path / "effects.toml"
    file.write_text(
        "[gyro_bias]\nbias = 0.005\n"
        "[one_sided_slip]\nratio = 1\nside = 'left'\nstart_s = 10\nstop_s = 12.5\n"
        "[wheel_toe]\n"
    )
    assert load_effects(file) == (
        EffectSetting("gyro_bias", (("bias", 0.005),)),
        EffectSetting(
            "one_sided_slip",
            (("side", "left"), ("ratio", 1.0), ("start_s", 10.0), ("stop_s", 12.5)),
        ),
        EffectSetting("wheel_toe", ()),
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[gyro_bais]\nbias = 1", "e.toml:1: gyro_bais: no such effect: the nearest is gyro_bias"),
        (
            "[gyro_bias]\nbais = 1",
            "e.toml:2: gyro_bias.bais: gyro_bias has no such parameter: the nearest is bias",
        ),
        (
            "[gyro_bias]\nbias = 'high'",
            'e.toml:2: gyro_bias.bias = "high": expected a number from -1000 to 1000 [rad/s]',
        ),
        ("gyro_bias = 0.1", "e.toml:1: gyro_bias = 0.1: expected a table per effect, for example "),
        ("[gyro_bias]\nbias = 2020-01-01", "e.toml:2: gyro_bias.bias = 2020-01-01: expected a num"),
        ("[gyro_bias", "e.toml:1: not a TOML file: "),
    ],
)
def test_a_mistake_in_an_effects_file_is_said_with_its_line(
    tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / "e.toml"
    file.write_text(text)
    with pytest.raises(HarnessError) as caught:
        load_effects(file)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_a_later_source_overrides_an_earlier_one_parameter_by_parameter() -> None:
    scenario = [EffectSetting("one_sided_slip", (("side", "left"), ("ratio", 0.1)))]
    command_line = [parse_effect("one_sided_slip.ratio=0.2"), parse_effect("gyro_bias.bias=1")]
    assert [str(setting) for setting in combine_effects(scenario, command_line)] == [
        "one_sided_slip.side=left one_sided_slip.ratio=0.2",
        "gyro_bias.bias=1.0",
    ]


def test_one_source_may_not_say_a_thing_twice() -> None:
    twice = [parse_effect("gyro_bias.bias=1"), parse_effect("gyro_bias.bias=2")]
    with pytest.raises(HarnessError, match=r"^effect gyro_bias\.bias is given twice$"):
        apply_effects(twice)


def test_a_text_wins_over_a_file_and_a_later_file_over_an_earlier_one(tmp_path: Path) -> None:
    earlier, later = tmp_path / "earlier.toml", tmp_path / "later.toml"
    earlier.write_text("[gyro_bias]\nbias = 0.1\n[one_sided_slip]\nside = 'left'\nratio = 0.1\n")
    later.write_text("[one_sided_slip]\nratio = 0.2\n[gyro_scale]\nscale = 0.3\n")
    found = read_effects(["gyro_scale.scale=0.4"], [earlier, later])
    assert [str(setting) for setting in found] == [
        "one_sided_slip.side=left one_sided_slip.ratio=0.2",
        "gyro_bias.bias=0.1",
        "gyro_scale.scale=0.4",
    ]


def test_beside_a_number_its_interval_may_stand_which_no_run_needs(tmp_path: Path) -> None:
    file = tmp_path / "explained.toml"
    file.write_text("[gyro_bias]\nbias = 0.005\nbias_ci95 = [0.004, 0.006]\n")
    (known,) = load_effects(file)
    assert known.ci95 == (("bias", (0.004, 0.006)),)
    assert apply_effects([known]) == apply_effects([parse_effect("gyro_bias.bias=0.005")])


@pytest.mark.parametrize(
    "interval",
    [
        *("0.1", "[0.004]", "[0.006, 0.004]", "[0.006, 0.007]", '["a", "b"]'),
        *("[-inf, inf]", "[0.004, inf]", "[nan, nan]", "[false, true]"),
    ],
)
def test_an_interval_is_two_numbers_with_the_value_between(tmp_path: Path, interval: str) -> None:
    file = tmp_path / "explained.toml"
    file.write_text(f"[gyro_bias]\nbias = 0.005\nbias_ci95 = {interval}\n")
    with pytest.raises(HarnessError, match=r"explained\.toml:3: gyro_bias\.bias_ci95 = "):
        load_effects(file)


def test_an_interval_of_nothing_is_no_parameter(tmp_path: Path) -> None:
    file = tmp_path / "explained.toml"
    file.write_text("[gyro_bias]\nbias_ci95 = [0.004, 0.006]\n")
    with pytest.raises(HarnessError, match="no such parameter"):
        load_effects(file)


def test_settings_made_in_code_are_checked_too() -> None:
    with pytest.raises(HarnessError, match="no such effect"):
        apply_effects([EffectSetting("nothing", ())])
    with pytest.raises(HarnessError, match=r"gyro_bias\.bias=high: expected a number"):
        apply_effects([EffectSetting("gyro_bias", (("bias", "high"),))])


def test_an_effect_may_act_in_a_part_of_the_log_only() -> None:
    texts = ["gyro_bias.bias=1", "gyro_bias.start_s=2", "gyro_scale.scale=0.1"]
    texts += ["frame_loss.probability=0.5", "frame_loss.start_s=1", "frame_loss.stop_s=2"]
    whole = apply_effects(combine_effects(map(parse_effect, texts)))
    assert [start_s for start_s, _ in whole.later] == [1.0, 2.0]
    plants = whole.over_time(lambda at: at.plant)
    assert [(s, p.gyro_bias_rad_s, p.gyro_scale) for s, p in plants] == [
        (-math.inf, 0.0, 0.1),
        (2.0, 1.0, 0.1),
    ]
    buses = whole.over_time(lambda at: at.bus)
    assert [(s, b.loss_probability) for s, b in buses] == [
        (-math.inf, 0.0),
        (1.0, 0.5),
        (2.0, 0.0),
    ]


def test_a_switch_is_named_alone() -> None:
    assert parse_effect("setup_wheels_swapped") == EffectSetting("setup_wheels_swapped", ())
    assert apply_effects([parse_effect("setup_wheels_swapped")]).setup.wheels_swapped == 1


@pytest.mark.parametrize("name", ["setup_sign", "clock_skew"])
def test_what_cannot_change_in_a_run_takes_no_window(name: str) -> None:
    setting = EffectSetting(name, (("start_s", 1.0),))
    with pytest.raises(HarnessError, match=rf"^effect {name}\.start_s: .*: expected no start_s"):
        apply_effects([setting])


def test_a_setting_can_be_sent_to_another_process() -> None:
    setting = parse_effect("gyro_bias.bias=0.005")
    assert pickle.loads(pickle.dumps(setting)) == setting
