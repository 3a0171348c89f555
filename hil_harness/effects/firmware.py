"""Stage firmware: arithmetic and constants of the ECU. Only a replay of the program sees it."""

from __future__ import annotations

from typing import Final

from firmware_model.changes import (
    CONSTANTS,
    CUT_ROUNDINGS,
    EULER_HEADINGS,
    LIMITED_VARIABLES,
    RESOLVED_VARIABLES,
)
from hil_harness.effects.model import Effect, EffectParameter, Settings, Twins, Typical, Values
from hil_harness.effects.sources import CLEARPATH


def _choice(name: str, choices: tuple[str, ...], meaning: str) -> EffectParameter:
    return EffectParameter(name, "", choices[0], meaning, kind="choice", choices=choices)


def _whole(name: str, meaning: str, maximum: int, *, neutral: int = 0) -> EffectParameter:
    return EffectParameter(name, "1", neutral, meaning, kind="whole", minimum=0, maximum=maximum)


def _truncation(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(rounding=values["rounding"])


def _resolution(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(
        resolution_variable=values["variable"], resolution_bits=values["bits"]
    )


def _trig_table(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(
        trig_entries=values["entries"], trig_interpolated=values["interpolated"]
    )


def _euler(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(euler=values["heading"])


def _stale_heading(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(stale_heading_cycles=values["cycles"])


def _constant(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(constant=values["constant"], constant_scale=values["scale"])


def _overflow(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(
        overflow_variable=values["variable"],
        overflow_bits=values["bits"],
        overflow_mode=values["mode"],
    )


def _moving_calibration(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(
        calibration_start_s=values["start_s"], calibration_stop_s=values["stop_s"]
    )


def _auto_zero(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(auto_zero_rad_s=values["threshold"])


def _tick_period(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(tick_period_scale=values["scale"])


def _blend_weight(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(blend_weight=values["weight"])


def _missed_deadline(settings: Settings, values: Values) -> Settings:
    return settings.with_firmware(missed_deadline=values["probability"])


_INF: Final = float("inf")

EFFECTS: Final[tuple[Effect, ...]] = (
    Effect(
        "firmware_truncation",
        "firmware",
        (_choice("rounding", CUT_ROUNDINGS, "used at every narrowing where another is described"),),
        "The odometry differs from a replay by less than a unit a tick, growing with time where "
        "remainders are not carried.",
        _truncation,
    ),
    Effect(
        "firmware_resolution",
        "firmware",
        (
            _choice("variable", RESOLVED_VARIABLES, "the format"),
            _whole("bits", "fraction bits fewer than described", 40),
        ),
        "The odometry moves in coarser steps; slow motion can be lost altogether.",
        _resolution,
    ),
    Effect(
        "coarse_trig_table",
        "firmware",
        (
            _whole("entries", "steps per quarter wave, a power of two; 0: as described", 65536),
            EffectParameter(
                "interpolated",
                "1",
                1,
                "1: straight lines between entries, 0: the nearest entry",
                kind="whole",
                minimum=0,
                maximum=1,
            ),
        ),
        "An error of direction that repeats with the heading, four times or more a turn.",
        _trig_table,
    ),
    Effect(
        "euler_integration",
        "firmware",
        (_choice("heading", EULER_HEADINGS, "of the tick: the one before or the one after it"),),
        "While it turns, the path is rotated by half a tick's turn.",
        _euler,
        twins=(Twins(("stale_heading",), "cycles is 1 and heading is before"),),
    ),
    Effect(
        "stale_heading",
        "firmware",
        (
            _whole(
                "cycles", "the position uses the heading of so many ticks ago; 0: as described", 4
            ),
        ),
        "While it turns, the path is rotated by whole ticks' turns.",
        _stale_heading,
        twins=(Twins(("euler_integration",), "cycles is 1 and heading is before"),),
    ),
    Effect(
        "firmware_constant",
        "firmware",
        (
            _choice("constant", CONSTANTS, "which one is wrong"),
            EffectParameter(
                "scale",
                "1",
                0.0,
                "used over described − 1",
                minimum=-0.9,
                maximum=9.0,
                typical=Typical(0.001, 1.0, f"{CLEARPATH} (a factor of two)"),
            ),
        ),
        "The odometry differs from a replay by a constant ratio of path or turn.",
        _constant,
        twins=(
            Twins(
                ("radius_scale",),
                "there are no raw counts in the log (opposite sign; wheel_radius)",
            ),
            Twins(("fixed_tick_period",), "the constant is tick_period"),
        ),
    ),
    Effect(
        "firmware_overflow",
        "firmware",
        (
            _choice("variable", LIMITED_VARIABLES, "the word"),
            _whole("bits", "its width; 0: as described", 64),
            _choice("mode", ("wrap", "saturate"), "what happens beyond it"),
        ),
        "The odometry jumps by the word's modulus, or stays at its end.",
        _overflow,
    ),
    Effect(
        "moving_calibration",
        "firmware",
        (
            EffectParameter("start_s", "s", _INF, "the gyro's offset is averaged from here"),
            EffectParameter("stop_s", "s", _INF, "until here, whether or not the robot moves"),
        ),
        "A constant drift of the odometry's heading that no raw gyro code shows.",
        _moving_calibration,
        twins=(Twins(("gyro_bias",), "only the pose is looked at"),),
    ),
    Effect(
        "auto_zero",
        "firmware",
        (
            EffectParameter(
                "threshold",
                "rad/s",
                0.0,
                "slower turns are taken for rest and zeroed",
                minimum=0.0,
                maximum=100.0,
                typical=Typical(0.0035, 0.0175, "engineering estimate, 0.2 to 1 °/s"),
            ),
        ),
        "Slow turns are missing from the odometry's heading, fast ones are whole.",
        _auto_zero,
    ),
    Effect(
        "fixed_tick_period",
        "firmware",
        (
            EffectParameter(
                "scale",
                "1",
                0.0,
                "assumed over real tick period − 1",
                minimum=-0.5,
                maximum=1.0,
            ),
        ),
        "The odometry's gyro turns are off by a constant ratio, its distances are not.",
        _tick_period,
        twins=(Twins(("firmware_constant",), "its constant is tick_period"),),
    ),
    Effect(
        "blend_weight",
        "firmware",
        (
            EffectParameter(
                "weight",
                "1",
                0.0,
                "used − described weight of the gyro in the heading (mode blend)",
                minimum=-1.0,
                maximum=1.0,
            ),
        ),
        "The odometry's heading leans to wheels or gyro more than a replay does.",
        _blend_weight,
    ),
    Effect(
        "missed_deadline",
        "firmware",
        (
            EffectParameter(
                "probability",
                "1",
                0.0,
                "a tick is not executed",
                minimum=0.0,
                maximum=1.0,
                typical=Typical(1e-4, 1e-2, "engineering estimate"),
            ),
        ),
        "Odometry frames are missing, and the gyro's turn of those ticks with them.",
        _missed_deadline,
    ),
)
