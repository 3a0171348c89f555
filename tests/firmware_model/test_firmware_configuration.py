"""Every wrong configuration is one line: field, value, what would be right."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import assume, event, given, settings
from kernel_cases import ROBOT, config_of, robots

from firmware_model import (
    FirmwareChanges,
    FirmwareConstants,
    FirmwareDescription,
    FirmwareError,
    Kernel,
    KernelConfig,
    build_config,
)
from firmware_model.changes import LimitedVariable
from firmware_model.config import CONFIG_FIELDS
from firmware_model.integers import INTERMEDIATE_LIMIT

DESCRIPTION_ROWS: list[tuple[dict[str, Any], str]] = [
    (
        {"mode": "wheels"},
        "firmware.mode = 'wheels': expected 'wheel', 'gyro' or 'blend'",
    ),
    (
        {"blend_weight": 1.5},
        "firmware.blend_weight = 1.5: expected less than or equal to 1",
    ),
    (
        {"trig": {"entries": 1000}},
        "firmware.trig.entries = 1000: expected a power of two, for example 512 or 1024",
    ),
    (
        {"position": {"word_bits": "64"}},
        "firmware.position.word_bits = '64': expected a valid integer",
    ),
    (
        {"position": {"word_bits": 129}},
        "firmware.position.word_bits = 129: expected less than or equal to 128",
    ),
    (
        {"step": {"rounding": "nearest"}},
        "firmware.step.rounding = 'nearest': "
        "expected 'floor', 'half_up', 'half_even' or 'toward_zero'",
    ),
    (
        {"heading": {"bits": 3}},
        "firmware.heading.bits: unknown key: expected one of frac_bits, rounding, carry_remainder",
    ),
    (
        {"standstill": 3},
        "firmware.standstill = 3: expected a valid dictionary or instance of Standstill",
    ),
]


@pytest.mark.parametrize(("table", "message"), DESCRIPTION_ROWS)
def test_a_wrong_entry_of_the_table_is_one_line(table: dict[str, Any], message: str) -> None:
    with pytest.raises(FirmwareError) as caught:
        FirmwareDescription.from_table(table)
    assert str(caught.value) == message


BUILD_ROWS: list[tuple[dict[str, Any], str]] = [
    (
        {"step": {"frac_bits": 40}},
        "firmware.step.frac_bits = 40: the longest step of a tick, 0.01927 m, does not fit "
        "32 bits: expected at most 36",
    ),
    (
        {"step": {"word_bits": 8, "frac_bits": 28}},
        "firmware.step.frac_bits = 28: the longest step of a tick, 0.01927 m, does not fit "
        "8 bits: expected at most 12",
    ),
    (
        {"step": {"constant_frac_bits": 20}},
        "firmware.step.constant_frac_bits = 20: expected 28 to 58: no fewer than "
        "firmware.step.frac_bits keeps, no more than a product of 64 bits bears",
    ),
    (
        {"step": {"frac_bits": 4, "constant_frac_bits": 6}},
        "firmware.step.constant_frac_bits = 6: the constant 7.708e-05 m rounds to zero: "
        "expected at least 14",
    ),
    (
        {"turn_step": {"frac_bits": 31}},
        "firmware.turn_step.frac_bits = 31: expected at least 32, "
        "those of firmware.heading.frac_bits",
    ),
    (
        {"turn_step": {"word_bits": 32}},
        "firmware.turn_step.word_bits = 32: the largest turn, 5.384 turn, does not fit: "
        "expected at least 52, or fewer frac_bits",
    ),
    (
        {"gyro": {"sensitivity_frac_bits": 60}},
        "firmware.gyro.sensitivity_frac_bits = 60: expected 32 to 51: no fewer than "
        "firmware.turn_step.frac_bits keeps, no more than a product of 64 bits bears; only "
        "--kernel python holds more, by --force",
    ),
    (
        {
            "turn_step": {"frac_bits": 32, "constant_frac_bits": 40},
            "gyro": {"sensitivity_frac_bits": 18},
        },
        "firmware.gyro.sensitivity_frac_bits = 18: the constant 2.12e-07 turn rounds to zero: "
        "expected at least 23",
    ),
    (
        {"position": {"word_bits": 16, "frac_bits": 32}},
        "firmware.position.word_bits = 16: the longest step of a tick, 0.01927 m, does "
        "not fit: expected at least 28, or fewer frac_bits",
    ),
    (
        {"position": {"frac_bits": 40}, "trig": {"frac_bits": 8}},
        "firmware.position.frac_bits = 40: expected at most 36, what step.frac_bits and "
        "trig.frac_bits give together",
    ),
    (
        {"standstill": {"block_log2": 9, "max_log2": 8}},
        "firmware.standstill.max_log2 = 8: expected at least 9, "
        "that of firmware.standstill.block_log2",
    ),
    (
        {"step": {"frac_bits": 2}, "velocity": {"frac_bits": 24}},
        "firmware.velocity.frac_bits = 24: expected at most 18, given step.frac_bits",
    ),
]


@pytest.mark.parametrize(("table", "message"), BUILD_ROWS)
def test_a_format_that_cannot_work_is_refused_before_anything_runs(
    table: dict[str, Any], message: str
) -> None:
    with pytest.raises(FirmwareError) as caught:
        config_of(**table)
    assert str(caught.value) == message


def test_the_format_that_a_refusal_proposes_is_accepted() -> None:
    assert config_of(step={"frac_bits": 36})
    assert config_of(step={"word_bits": 8, "frac_bits": 12})
    assert config_of(turn_step={"word_bits": 52})
    assert config_of(position={"word_bits": 36, "frac_bits": 32})
    assert config_of(gyro={"sensitivity_frac_bits": 51})


CONSTANT_ROWS: list[tuple[dict[str, Any], str]] = [
    ({"wheel_radius_m": -0.05}, "wheel_radius_m = -0.05: expected 0.0001 to 100 m"),
    ({"wheelbase_m": float("nan")}, "wheelbase_m = nan: expected 0.001 to 1000 m"),
    ({"tick_period_s": 0.0}, "tick_period_s = 0.0: expected 1e-05 to 10 s"),
    ({"ticks_per_rev": 0}, "ticks_per_rev = 0: expected a whole number from 1 to 16777216"),
    ({"ticks_per_rev": 2.5}, "ticks_per_rev = 2.5: expected a whole number from 1 to 16777216"),
    ({"counter_bits": 64}, "counter_bits = 64: expected a whole number from 4 to 32"),
    (
        {"gyro_zero_rate_code": 5},
        "gyro_zero_rate_code = 5: expected a code between gyro_min_code = 18 and "
        "gyro_max_code = 65518",
    ),
]


@pytest.mark.parametrize(("change", "message"), CONSTANT_ROWS)
def test_a_robot_that_cannot_be_is_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(FirmwareError) as caught:
        replace(ROBOT, **change)
    assert str(caught.value) == message


def test_a_velocity_filter_too_long_for_its_word_is_refused() -> None:
    wild_gyro = replace(ROBOT, gyro_sensitivity_rad_s_per_lsb=1.0)
    table = {"velocity": {"filter_log2": 8}, "turn_step": {"frac_bits": 50}}
    with pytest.raises(FirmwareError) as caught:
        build_config(FirmwareDescription.from_table(table), wild_gyro)
    assert str(caught.value) == (
        "firmware.velocity.filter_log2 = 8: the filter of the largest turn leaves 64 bits: "
        "expected at most 4, or fewer turn_step.frac_bits; only --kernel python holds more, by "
        "--force"
    )


@pytest.mark.parametrize(
    "table",
    [
        {},
        {"step": {"word_bits": 24}},
        {"step": {"word_bits": 32, "frac_bits": 34}},
        {"position": {"word_bits": 12, "frac_bits": 14}},
    ],
)
def test_force_changes_nothing_of_what_need_not_be_forced(table: dict[str, Any]) -> None:
    """Nor does it elsewhere: a gap whose step a narrow word does not hold is not bridged."""
    described = FirmwareDescription.from_table(table)
    usual = build_config(described, ROBOT)
    assert build_config(described, ROBOT, allow_overflow=True) == usual
    turning = FirmwareDescription.from_table(table | {"turn_step": {"word_bits": 16}})
    with pytest.raises(FirmwareError):
        build_config(turning, ROBOT)
    forced = build_config(turning, ROBOT, allow_overflow=True)
    assert forced.gap_limit_ticks == usual.gap_limit_ticks


@pytest.mark.parametrize(("variable", "bits"), [("position", 33), ("step", 20), ("turn_step", 44)])
def test_an_effect_that_narrows_a_word_leaves_all_else_as_described(
    variable: LimitedVariable, bits: int
) -> None:
    """A word so narrow is not bridged over long gaps where it is described: here it overflows."""
    changes = FirmwareChanges(overflow_variable=variable, overflow_bits=bits)
    usual, found = config_of(), changes.config(FirmwareDescription(), ROBOT)
    name = variable.removesuffix("_step")
    apart = {one for one in CONFIG_FIELDS if getattr(usual, one) != getattr(found, one)}
    assert {f"{name}_low_q", f"{name}_high_q"} <= apart
    assert apart <= {f"{name}_low_q", f"{name}_high_q", f"{name}_overflow"}


def test_a_wheel_too_fast_for_its_counter_is_refused() -> None:
    robot = replace(ROBOT, counter_bits=8, max_wheel_rate_rad_s=100.0)
    with pytest.raises(FirmwareError) as caught:
        build_config(FirmwareDescription(), robot)
    assert str(caught.value) == (
        "max_wheel_rate_rad_s = 100: 410 encoder ticks in one tick of 0.01 s, but a counter of "
        "8 bits tells at most 127 apart: expected a wider counter, fewer ticks_per_rev, a shorter "
        "tick or a slower wheel"
    )


@given(robots())
@settings(max_examples=150)
def test_the_default_formats_suit_any_robot_whose_counter_is_fast_enough(
    robot: FirmwareConstants,
) -> None:
    """From a toy with 20 ticks a turn to a lorry: refused only for the counter, a long step, or a
    turn of hundreds of times a second."""
    try:
        config = build_config(FirmwareDescription(), robot)
    except FirmwareError as error:
        reason = str(error)
        event(reason.split("=", maxsplit=1)[0])
        known = "max_wheel_rate_rad_s", "firmware.step.frac_bits", "firmware.velocity.frac_bits"
        assume(not reason.startswith(known))
        raise
    assert config.gap_limit_ticks >= 1
    # constants carry at least 24 significant bits, or the gyro's as many as its code leaves
    assert min(config.half_tick_m_q, config.tick_turn_q, config.sensitivity_turn_q) >= 1 << 24


def test_one_description_and_robot_give_one_configuration() -> None:
    assert config_of() == config_of()
    assert isinstance(config_of(), KernelConfig)


def test_the_description_reads_back_from_its_own_dump() -> None:
    description = FirmwareDescription()
    assert FirmwareDescription.from_table(description.model_dump()) == description


def test_a_kernel_of_another_kind_is_refused() -> None:
    with pytest.raises(FirmwareError, match="expected one of compiled, python, c99"):
        Kernel(config_of(), "c")  # type: ignore[arg-type]


def test_a_stuck_span_that_no_wheel_can_reach_stays_inside_64_bits() -> None:
    """Two LSB of this gyro are more encoder ticks than int64 holds: the gyro is never stuck."""
    robot = replace(
        ROBOT,
        wheel_radius_m=1e-4,
        wheelbase_m=1e3,
        ticks_per_rev=1 << 24,
        counter_bits=32,
        tick_period_s=10.0,
        gyro_sensitivity_rad_s_per_lsb=10.0,
        max_wheel_rate_rad_s=1e-3,
    )
    formats = {
        "turn_step": {"word_bits": 64, "frac_bits": 36},
        "heading": {"frac_bits": 32},
        "stuck": {"block_log2": 12},
    }
    config = build_config(FirmwareDescription.from_table(formats), robot)
    assert config.stuck_span_ticks == INTERMEDIATE_LIMIT
    assert Kernel(config).state() == Kernel(config, "python").state()
