"""By force the kernel in Python runs what C cannot hold: wider words, and wider products."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from kernel_cases import ROBOT, ZERO_CODE, drive, inputs, tables

from firmware_model import (
    FRESH,
    FirmwareConstants,
    FirmwareDescription,
    FirmwareError,
    Kernel,
    KernelConfig,
    StatusBit,
    build_config,
    run_batch,
    run_batch_c99,
)
from firmware_model.build_scales import PI
from firmware_model.c99_export import config_header
from precision_study.streaming import stream

C_WORDS = {"position": 64, "step": 32, "turn_step": 64}
WIDER = {"position": 72, "step": 40, "turn_step": 96}
WIDE_STEP = {"step": {"word_bits": 33, "frac_bits": 40}}


def forced(robot: FirmwareConstants = ROBOT, **firmware: Any) -> KernelConfig:
    """Return a configuration as --force takes it."""
    return build_config(FirmwareDescription.from_table(firmware), robot, allow_overflow=True)


def with_words(table: dict[str, Any], bits: dict[str, int]) -> dict[str, Any]:
    """Return the table with words of other widths."""
    return table | {name: table[name] | {"word_bits": width} for name, width in bits.items()}


def heavy() -> FirmwareConstants:
    """Return a robot whose half tick is 20 π m: of 2^16 counts in 2^-40 m it leaves 2^61."""
    return replace(
        ROBOT, wheel_radius_m=20.0, wheelbase_m=60.0, ticks_per_rev=1, max_wheel_rate_rad_s=300.0
    )


HEAVY_STEP = {
    "step": {"word_bits": 72, "frac_bits": 40},
    "position": {"word_bits": 96, "frac_bits": 48},
}


@pytest.mark.parametrize(
    ("table", "line"),
    [
        ({"position": {"word_bits": 65}}, "firmware.position.word_bits = 65: expected at most 64"),
        ({"step": {"word_bits": 33}}, "firmware.step.word_bits = 33: expected at most 32"),
        (
            {"turn_step": {"word_bits": 65}},
            "firmware.turn_step.word_bits = 65: expected at most 64",
        ),
        ({"trig": {"frac_bits": 31}}, "firmware.trig.frac_bits = 31: expected at most 30"),
        (
            {"step": {"constant_frac_bits": 60}},
            "firmware.step.constant_frac_bits = 60: expected 28 to 58",
        ),
    ],
)
def test_what_c_cannot_hold_is_refused_and_by_force_it_is_python_s_alone(
    table: dict[str, Any], line: str
) -> None:
    with pytest.raises(FirmwareError, match=line) as refused:
        build_config(FirmwareDescription.from_table(table), ROBOT)
    assert "only --kernel python holds more, by --force" in str(refused.value)
    config = forced(**table)
    assert Kernel(config).implementation == "python"
    counts = [[0, 1]]
    for refuse in (
        lambda: Kernel(config, "compiled"),
        lambda: Kernel(config, "c99"),
        lambda: config_header(config, "robot"),
        lambda: run_batch_c99(config, counts, counts, counts),
    ):
        with pytest.raises(FirmwareError) as again:
            refuse()
        assert str(again.value) == str(refused.value)


@given(st.data())
@settings(max_examples=40)
def test_wider_words_give_the_same_integers_where_those_of_c_suffice(data: st.DataObject) -> None:
    table = data.draw(tables())
    try:
        usual = forced(**with_words(table, C_WORDS))
    except FirmwareError:  # formats that do not belong together
        assume(False)
        raise
    assume(not usual.beyond_c)
    wider = forced(**with_words(table, WIDER))
    assume(wider.gap_limit_ticks == usual.gap_limit_ticks)  # longer gaps fit a wider word
    narrow, wide = Kernel(usual, "compiled"), Kernel(wider)
    assert wide.implementation == "python"
    for tick in data.draw(inputs(usual)):
        narrow.step(*tick)
        wide.step(*tick)
        assume(narrow.overflow_count == 0)
        assert wide.state() == narrow.state()
        assert (wide.v_m_s_q, wide.w_rad_s_q) == (narrow.v_m_s_q, narrow.w_rad_s_q)


@pytest.mark.parametrize(("overflow", "low_after"), [("wrap", True), ("saturate", False)])
def test_a_wide_word_overflows_at_its_own_width_and_is_counted(
    overflow: str, low_after: bool
) -> None:
    kernel = Kernel(forced(position={"word_bits": 72, "overflow": overflow}))
    drive(kernel, [(0, 0)])
    high = (1 << 71) - 1
    kernel.load_state(kernel.state() | {"x_m_q": high - 1})
    drive(kernel, [(1, 1)])
    assert (kernel.x_m_q < 0) == low_after
    assert low_after or kernel.x_m_q == high
    assert kernel.overflow_count == 1
    assert StatusBit.OVERFLOW in kernel.status


def test_a_step_beyond_32_bits_overflows_in_every_tick_that_is_longer_than_its_word() -> None:
    """33 bits of 2^-40 m hold 3.9 mm, which are 25.3 counts of 0.154 mm."""
    config = forced(**WIDE_STEP)
    kernel = Kernel(config)
    drive(kernel, [(0, 0), *[(25, 25)] * 3, *[(26, 26)] * 4])
    assert kernel.overflow_count == 4
    held = 3 * 25 * 2 * Fraction(config.half_tick_m_q, 1 << config.step_shift) / (1 << 40)
    held += 4 * Fraction((1 << 32) - 1, 1 << 40)
    unit = Fraction(1, 1 << config.position_frac_bits)  # of the sum; a step drops less, and carries
    assert abs(Fraction(kernel.x_m_q) * unit - held) <= 2 * unit


def test_what_would_leave_64_bits_on_the_way_is_exact() -> None:
    """The remainders of step and position are carried: each keeps the sum within a unit."""
    robot = heavy()
    assert "m leaves 64 bits" in forced(robot, step={"frac_bits": 40}).beyond_c
    config = forced(robot, **HEAVY_STEP)
    counts, ticks = 3, 2_000
    kernel = Kernel(config)
    drive(kernel, [(0, 0), *[(counts, counts)] * ticks])
    way_m = 2 * counts * ticks * PI * Fraction(robot.wheel_radius_m)
    constant = Fraction(counts * ticks, 1 << (config.step_shift + 40))  # half a unit a half tick
    units = Fraction(1, 1 << 40) + Fraction(1, 1 << config.position_frac_bits)
    assert kernel.overflow_count == 0
    assert abs(Fraction(kernel.x_m_q, 1 << config.position_frac_bits) - way_m) <= constant + units


def test_batches_and_streams_of_what_c_cannot_hold_are_those_of_the_kernel_in_python() -> None:
    """A position beyond 64 bits is told to the bit: no array of 64 bits is in between."""
    config, ticks = forced(robot=heavy(), **HEAVY_STEP), 250
    left = np.cumsum([[3] * ticks, [2] * ticks], axis=1)
    right, code = left[:, ::-1].copy() % 7, np.full((2, ticks), ZERO_CODE + 40)
    batch = run_batch(config, left, right, code)
    assert batch.pose_q is not None
    for row in range(2):
        kernel = Kernel(config)
        for tick in range(ticks):
            given = int(left[row, tick]), int(right[row, tick])
            kernel.step(*given, FRESH, ZERO_CODE + 40, FRESH)
            assert tuple(batch.pose_q[row, tick]) == kernel.pose_q
        assert batch.final_states[row].item() == tuple(kernel.state().values())
    assert max(batch.pose_q[:, -1, 0]) >= 1 << 63
    assert batch.twin_pose is not None
    for part in stream(config, left, right, code, chunk_ticks=100):
        ticks_of_part = slice(part.start, part.start + part.pose_q.shape[1])
        assert part.pose_q.tolist() == batch.pose_q[:, ticks_of_part].tolist()
        assert np.array_equal(part.twin_pose, batch.twin_pose[:, ticks_of_part])
