"""The C99 kernel is the same kernel: every field of the state, after every tick, on any input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import Inputs, config_of, configs, inputs
from test_kernel_bit_equal import random_ticks

from firmware_model import FRESH, INVALID, STALE, STATE_FIELDS, Kernel, run_batch, run_batch_c99
from firmware_model.c99_kernel import C99Kernel

BUILDS = [
    ("-std=c99", "-O0"),
    ("-std=c99", "-O2"),
    ("-std=c99", "-O3", "-flto"),
]
ROUNDINGS = ("floor", "half_up", "half_even", "toward_zero")
MODES = ("wheel", "gyro", "blend")
RULES = ("euler_before", "midpoint", "euler_after")


@given(st.data())
@settings(max_examples=150)
def test_c_and_python_agree_in_the_whole_state_after_every_tick(data: st.DataObject) -> None:
    config = data.draw(configs())
    oracle, twin = Kernel(config, "python"), Kernel(config, "c99")
    assert twin.state() == oracle.state()
    for tick in data.draw(inputs(config)):
        oracle.step(*tick)
        twin.step(*tick)
        assert twin.state() == oracle.state()
        assert (twin.v_m_s_q, twin.w_rad_s_q) == (oracle.v_m_s_q, oracle.w_rad_s_q)
        assert twin.pose_q == oracle.pose_q


@given(st.data())
@settings(max_examples=40)
def test_the_state_goes_on_in_c_where_python_left_it_and_under_another_configuration(
    data: st.DataObject,
) -> None:
    first, second = data.draw(configs()), data.draw(configs())
    oracle, twin = Kernel(first, "python"), Kernel(first, "c99")
    for tick in data.draw(inputs(first)):
        oracle.step(*tick)
    twin.load_state(oracle.state())
    for kernel in (oracle, twin):
        kernel.reconfigure(first)
        kernel.set_gyro_offset(first.gyro_max_code / 3)
    assert twin.state() == oracle.state()
    oracle, twin = Kernel(second, "python"), Kernel(second, "c99")
    for tick in data.draw(inputs(second, max_ticks=20)):
        oracle.step(*tick)
        twin.step(*tick)
    assert twin.state() == oracle.state()


@pytest.mark.parametrize("flags", BUILDS, ids=" ".join)
@pytest.mark.parametrize("mode", MODES)
def test_every_optimisation_gives_the_compiled_kernels_state_over_long_random_drives(
    mode: str, flags: tuple[str, ...], size: str
) -> None:
    count = 20_000 if size == "small" else 1_000_000
    for place, rule in enumerate(RULES):
        config = config_of(mode=mode, integration=rule, **formats(place + len(mode)))
        ticks = random_ticks(config, seed=place, count=count)
        twin = C99Kernel(config, flags)
        twin.run(ticks)
        columns = ticks.T[:, None, :]
        batch = run_batch(
            config, columns[0], columns[1], columns[3], columns[2], columns[4], history=False
        )
        assert twin.state() == dict(zip(STATE_FIELDS, batch.final_states[0].item(), strict=True))


FORMATS = 16
"""So many formats have every rounding with every overflow and both ways to a sine."""


def formats(place: int) -> dict[str, dict[str, object]]:
    """Return narrow words of every rounding, so that each tick rounds and many overflow."""
    rounding = ROUNDINGS[place % 4]
    overflow = ("wrap", "saturate")[place // 4 % 2]
    carry = place % 5 > 0
    return {
        "position": {
            "word_bits": 24,
            "frac_bits": 14,
            "rounding": rounding,
            "overflow": overflow,
            "carry_remainder": carry,
        },
        "step": {"frac_bits": 24, "rounding": rounding, "carry_remainder": place % 7 > 0},
        "heading": {
            "frac_bits": 20 + place % 13,
            "rounding": rounding,
            "carry_remainder": place % 3 > 0,
        },
        "turn_step": {"frac_bits": 40, "rounding": rounding, "carry_remainder": place % 2 > 0},
        "trig": {
            "method": ("table", "cordic")[place // 8 % 2],
            "entries": 64,
            "interpolated": place % 3 > 0,
            "rounding": rounding,
        },
        "gyro": {"rounding": rounding, "auto_zero_rad_s": 0.002 * (place % 2)},
    }


@pytest.mark.parametrize("stale", range(5))
@pytest.mark.parametrize("mode", MODES)
def test_an_old_heading_and_a_rate_taken_for_rest_are_the_same_in_c(mode: str, stale: int) -> None:
    config = config_of(mode=mode, stale_heading_ticks=stale, gyro={"auto_zero_rad_s": 0.05})
    oracle, twin = Kernel(config, "compiled"), Kernel(config, "c99")
    for tick in random_ticks(config, seed=stale, count=2_000).tolist():
        oracle.step(*tick)
        twin.step(*tick)
        assert twin.state() == oracle.state()


LIMITS = [0, 1, -1, 32767, 32768, 65535, 65536, 2**31 - 1, 2**31, -(2**31), 2**63 - 1, -(2**63)]


def test_inputs_at_every_limit_of_their_integers_mean_the_same_in_c() -> None:
    config = config_of(mode="blend")
    oracle, twin = Kernel(config, "python"), Kernel(config, "c99")
    validities = (FRESH, STALE, INVALID, 3, -1, 256, 2**63 - 1)
    for count in LIMITS:
        for code in LIMITS:
            for validity in validities:
                tick = Inputs(count, -count - 1, FRESH, code, validity)
                for one in (tick, Inputs(count, count, validity, code, FRESH)):
                    oracle.step(*one)
                    twin.step(*one)
                    assert twin.state() == oracle.state()


def test_an_input_outside_int64_is_refused_and_changes_nothing() -> None:
    twin = Kernel(config_of(), "c99")
    before = twin.state()
    with pytest.raises(OverflowError, match="expected integers of 64 bits"):
        twin.step(1 << 63, 0, FRESH, 0, FRESH)
    assert twin.state() == before


def test_a_batch_in_c_has_the_history_and_the_states_of_the_compiled_one() -> None:
    several = [config_of(mode=mode, integration=rule) for mode in MODES for rule in RULES]
    ticks = random_ticks(several[0], seed=5, count=3_000).T[:, None, :]
    given_inputs = ticks[0], ticks[1], ticks[3], ticks[2], ticks[4]
    for history in (True, False):
        expected = run_batch(several, *given_inputs, twin=False, history=history)
        found = run_batch_c99(several, *given_inputs, history=history)
        assert np.array_equal(found.final_states, expected.final_states)
        for name in ("pose_q", "status", "heading_source"):
            want, have = getattr(expected, name), getattr(found, name)
            assert (have is None) if want is None else np.array_equal(have, want)
