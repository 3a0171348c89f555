"""The state can be written down and taken up again, and stays plain integers."""

from __future__ import annotations

import json

import pytest
from kernel_cases import config_of
from test_kernel_bit_equal import random_ticks

from firmware_model import STATE_FIELDS, FirmwareError, HeadingSource, Kernel, StatusBit
from firmware_model.kernel import Implementation

IMPLEMENTATIONS: list[Implementation] = ["python", "compiled"]


@pytest.mark.parametrize("first", IMPLEMENTATIONS)
@pytest.mark.parametrize("second", IMPLEMENTATIONS)
def test_a_run_continues_from_a_saved_state_as_if_never_stopped(
    first: Implementation, second: Implementation
) -> None:
    config = config_of(mode="blend")
    ticks = random_ticks(config, seed=2, count=2_000).tolist()
    through, stopped = Kernel(config, first), Kernel(config, first)
    for tick in ticks:
        through.step(*tick)
    for tick in ticks[:1_000]:
        stopped.step(*tick)
    resumed = Kernel(config, second)
    resumed.load_state(json.loads(json.dumps(stopped.state())))
    for tick in ticks[1_000:]:
        resumed.step(*tick)
    assert resumed.state() == through.state()


@pytest.mark.parametrize("implementation", ["python", "compiled", "c99"])
def test_many_ticks_taken_at_once_are_the_same_ticks(implementation: Implementation) -> None:
    config = config_of(mode="blend")
    ticks = random_ticks(config, seed=6, count=1_500)
    ticks[::7, 2] = 259  # no validity; 3 in its lower 8 bits
    ticks[::11, 4] = -256  # FRESH in its lower 8 bits
    together, one_by_one = Kernel(config, implementation), Kernel(config, "python")
    together.run(ticks[:1_000])
    together.run(ticks[1_000:])
    for tick in ticks.tolist():
        one_by_one.step(*tick)
    assert together.state() == one_by_one.state()


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_every_field_is_a_plain_int_at_all_times(implementation: Implementation) -> None:
    kernel = Kernel(config_of(), implementation)
    for tick in random_ticks(kernel.config, seed=5, count=500).tolist():
        kernel.step(*tick)
        assert all(type(value) is int for value in kernel.state().values())
    assert tuple(kernel.state()) == STATE_FIELDS


@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
def test_the_properties_are_those_fields(implementation: Implementation) -> None:
    kernel = Kernel(config_of(), implementation)
    for tick in random_ticks(kernel.config, seed=6, count=300).tolist():
        kernel.step(*tick)
    state = kernel.state()
    assert (kernel.x_m_q, kernel.y_m_q) == (state["x_m_q"], state["y_m_q"])
    assert kernel.heading_turn_q == kernel.heading_turn_q32 == state["heading_turn_q"]
    assert kernel.status == StatusBit(state["status"])
    assert kernel.heading_source == HeadingSource(state["heading_source"])
    assert kernel.gyro_offset_q == state["gyro_offset_q"]
    assert kernel.overflow_count == state["overflow_count"]


def test_a_state_that_is_not_one_is_refused() -> None:
    kernel = Kernel(config_of(), "python")
    state = kernel.state()
    missing = {name: value for name, value in state.items() if name != "x_m_q"}
    for wrong, message in (
        (missing, "state: field x_m_q is missing"),
        ({**state, "z_m_q": 0}, "state: field z_m_q is unknown"),
        ({**state, "x_m_q": 1.5}, "state.x_m_q = 1.5: expected an integer of 64 bits"),
        ({**state, "x_m_q": 1 << 63}, "expected an integer of 64 bits"),
    ):
        with pytest.raises(FirmwareError, match=message):
            kernel.load_state(wrong)  # type: ignore[arg-type]
    assert kernel.state() == state


def test_a_coarse_heading_is_shown_in_the_frames_resolution() -> None:
    kernel = Kernel(config_of(heading={"frac_bits": 8}), "python")
    kernel.load_state({**kernel.state(), "heading_turn_q": -128})
    assert kernel.heading_turn_q32 == -(1 << 31)
