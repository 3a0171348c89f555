"""What the kernel's tests share: robots, random configurations, random and extreme inputs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

from hypothesis import assume
from hypothesis import strategies as st

from firmware_model import (
    FRESH,
    INVALID,
    STALE,
    FirmwareConstants,
    FirmwareDescription,
    FirmwareError,
    Kernel,
    KernelConfig,
    build_config,
)

ROBOT = FirmwareConstants(
    wheel_radius_m=0.05025,
    wheelbase_m=0.2985,
    ticks_per_rev=2048,
    counter_bits=16,
    tick_period_s=0.01,
    gyro_sensitivity_rad_s_per_lsb=math.radians(1 / 131),
    gyro_zero_rate_code=32768,
    gyro_min_code=18,
    gyro_max_code=65518,
    max_wheel_rate_rad_s=30.0,
)
ZERO_CODE = 32768


class Inputs(NamedTuple):
    """One tick's arguments of `Kernel.step`."""

    left_count: int
    right_count: int
    encoder_validity: int = FRESH
    gyro_code: int = ZERO_CODE
    gyro_validity: int = FRESH


def config_of(**firmware: Any) -> KernelConfig:
    """Return the configuration of the default robot with the given [firmware] entries."""
    return build_config(FirmwareDescription.from_table(firmware), ROBOT)


def kernel_of(**firmware: Any) -> Kernel:
    """Return a readable kernel of the default robot with the given [firmware] entries."""
    return Kernel(config_of(**firmware), "python")


def drive(kernel: Kernel, steps: list[tuple[int, int]], code: int = ZERO_CODE) -> None:
    """Step *kernel* by (left, right) increments, each a fresh tick, with one gyro code."""
    left, right = kernel.state()["left_count"], kernel.state()["right_count"]
    for left_step, right_step in steps:
        left, right = left + left_step, right + right_step
        kernel.step(left, right, FRESH, code, FRESH)


def initialised(**firmware: Any) -> Kernel:
    """Return a readable kernel that has taken its baseline at counts (0, 0)."""
    kernel = kernel_of(**firmware)
    kernel.step(0, 0, FRESH, ZERO_CODE, FRESH)
    return kernel


_ROUNDING = st.sampled_from(["floor", "half_up", "half_even", "toward_zero"])
_OVERFLOW = st.sampled_from(["wrap", "saturate"])


def _seldom(low: int, high: int) -> st.SearchStrategy[int | None]:
    """Draw None four times in five: a constant's fraction bits seldom fit by chance."""
    return st.integers(0, 4).flatmap(lambda n: st.none() if n else st.integers(low, high))


@st.composite
def tables(draw: st.DrawFn) -> dict[str, Any]:
    """Draw a table [firmware] anywhere in its documented ranges, small waiting times preferred.

    Formats that depend on each other are drawn so that most tables are admitted.
    """
    step_bits = draw(st.integers(0, 40))
    trig_bits = draw(st.integers(2, 30))
    turn_bits = draw(st.integers(4, 52))
    product_bits = step_bits + trig_bits
    return {
        "mode": draw(st.sampled_from(["wheel", "gyro", "blend"])),
        "blend_weight": draw(st.floats(0.0, 1.0)),
        "integration": draw(st.sampled_from(["euler_before", "midpoint", "euler_after"])),
        "stale_heading_ticks": draw(st.sampled_from([0, 0, 0, 1, 2, 3, 4])),
        "position": {
            "word_bits": draw(st.sampled_from([64, 48, 32, 24, 16]) | st.integers(8, 64)),
            "frac_bits": draw(st.integers(max(product_bits - 61, 0), min(product_bits, 48))),
            "rounding": draw(_ROUNDING),
            "overflow": draw(_OVERFLOW),
            "carry_remainder": draw(st.booleans()),
        },
        "step": {
            "word_bits": draw(st.sampled_from([32, 24, 16]) | st.integers(8, 32)),
            "frac_bits": step_bits,
            "constant_frac_bits": draw(_seldom(step_bits, 50)),
            "rounding": draw(_ROUNDING),
            "overflow": draw(_OVERFLOW),
            "carry_remainder": draw(st.booleans()),
        },
        "heading": {
            "frac_bits": draw(st.integers(4, min(turn_bits, 32))),
            "rounding": draw(_ROUNDING),
            "carry_remainder": draw(st.booleans()),
        },
        "turn_step": {
            "word_bits": draw(st.sampled_from([64, 48, 32]) | st.integers(8, 64)),
            "frac_bits": turn_bits,
            "constant_frac_bits": draw(_seldom(turn_bits, 54)),
            "rounding": draw(_ROUNDING),
            "overflow": draw(_OVERFLOW),
            "carry_remainder": draw(st.booleans()),
        },
        "trig": {
            "method": draw(st.sampled_from(["table", "cordic"])),
            "entries": 1 << draw(st.integers(0, 10)),
            "interpolated": draw(st.booleans()),
            "iterations": draw(st.integers(1, 34)),
            "frac_bits": trig_bits,
            "rounding": draw(_ROUNDING),
        },
        "gyro": {
            "offset_frac_bits": draw(st.integers(0, 16)),
            "sensitivity_frac_bits": draw(_seldom(20, 50)),
            "rounding": draw(_ROUNDING),
            "auto_zero_rad_s": draw(st.just(0.0) | st.floats(0.0, 1.0)),
        },
        "standstill": {
            "ticks": draw(st.integers(1, 8)),
            "tolerance_ticks": draw(st.integers(0, 3)),
            "max_rate_rad_s": draw(st.floats(0.0, 10.0)),
            "settle_ticks": draw(st.integers(0, 4)),
            "block_log2": draw(st.integers(0, 3)),
            "max_log2": draw(st.integers(3, 16)),
        },
        "plausibility": {
            "rate_margin": draw(st.floats(1.0, 4.0)),
            "extra_ticks": draw(st.integers(0, 10)),
            "jump_confirm_samples": draw(st.integers(1, 4)),
        },
        "stuck": {
            "ticks": draw(st.integers(2, 8)),
            "block_log2": draw(st.integers(0, 3)),
            "span_ticks": draw(st.integers(1, 20)),
        },
        "velocity": {
            "frac_bits": draw(st.integers(0, min(step_bits + 16, 24))),
            "filter_log2": draw(st.integers(0, 8)),
        },
    }


@st.composite
def robots(draw: st.DrawFn) -> FirmwareConstants:
    """Draw a robot between a toy and a lorry."""
    bits = draw(st.integers(8, 16))
    top = (1 << bits) - 1
    return replace(
        ROBOT,
        wheel_radius_m=draw(st.floats(0.005, 1.0)),
        wheelbase_m=draw(st.floats(0.05, 5.0)),
        ticks_per_rev=draw(st.sampled_from([20, 360, 2048, 65536])),
        counter_bits=draw(st.sampled_from([8, 16, 16, 32])),
        tick_period_s=draw(st.sampled_from([0.001, 0.01, 0.02, 0.1])),
        gyro_sensitivity_rad_s_per_lsb=draw(st.floats(1e-5, 0.1)),
        gyro_zero_rate_code=draw(st.integers(1, top - 1)),
        gyro_min_code=0,
        gyro_max_code=top,
        max_wheel_rate_rad_s=draw(st.sampled_from([1.0, 30.0, 300.0])),
    )


@st.composite
def configs(draw: st.DrawFn) -> KernelConfig:
    """Draw a configuration that C can hold; overflowing words are allowed by force."""
    description = FirmwareDescription.from_table(draw(tables()))
    try:
        config = build_config(description, draw(st.just(ROBOT) | robots()), allow_overflow=True)
    except FirmwareError:
        assume(False)
        raise
    assume(not config.beyond_c)
    return config


INT64 = st.integers(-(1 << 63), (1 << 63) - 1)
_EXTREMES = st.sampled_from(
    [0, 1, -1, 32767, 32768, 65535, 65536, 131071, (1 << 31) - 1, 1 << 31, -(1 << 31), -(1 << 63)]
)
_VALIDITY = st.sampled_from([FRESH] * 12 + [STALE, INVALID, 3, -1])


@st.composite
def inputs(draw: st.DrawFn, config: KernelConfig, max_ticks: int = 60) -> list[Inputs]:
    """Draw ticks: plausible drives with pauses and reversals, glitches, rails, random validity."""
    counts = [draw(st.sampled_from([0, 65530, 32760]) | INT64) for _ in range(2)]
    ticks: list[Inputs] = []
    fastest = config.max_step_ticks
    while len(ticks) < draw(st.integers(1, max_ticks)):
        speeds = [
            draw(st.sampled_from([0, 1, -1, fastest, -fastest]) | st.integers(-fastest, fastest))
            for _ in range(2)
        ]
        code = draw(
            st.sampled_from([0, config.gyro_min_code, config.gyro_max_code, 65535])
            | st.integers(config.gyro_min_code, config.gyro_max_code)
            | st.just(config.constants.gyro_zero_rate_code).map(int)
            | INT64
        )
        for _ in range(draw(st.integers(1, 12))):
            counts = [count + speed for count, speed in zip(counts, speeds, strict=True)]
            left, right = counts
            if draw(st.integers(0, 15)) == 0:
                left = draw(_EXTREMES | INT64)
            in_range = [min(max(count, -(1 << 63)), (1 << 63) - 1) for count in (left, right)]
            ticks.append(Inputs(*in_range, draw(_VALIDITY), code, draw(_VALIDITY)))
    return ticks
