"""An invalid or stale input never moves the pose, and what it carries is not looked at."""

from __future__ import annotations

from typing import Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import INT64, Inputs, config_of, inputs

from firmware_model import FRESH, INVALID, STALE, HeadingSource, Kernel, StatusBit

MODES = st.sampled_from(["wheel", "gyro", "blend"])
RULES = st.sampled_from(["euler_before", "midpoint", "euler_after"])
NOT_FRESH = st.sampled_from([STALE, INVALID])
HEADING_FIELDS = ("heading_turn_q", "heading_remainder_q")
POSITION_FIELDS = ("x_m_q", "y_m_q", "x_remainder_q", "y_remainder_q", "step_remainder_q")


@st.composite
def moving_kernels(draw: st.DrawFn) -> Kernel:
    """Draw a kernel somewhere in the middle of a random drive."""
    config = config_of(mode=draw(MODES), integration=draw(RULES))
    kernel = Kernel(config, "python")
    for tick in draw(inputs(config, max_ticks=20)):
        kernel.step(*tick)
    return kernel


def fields(kernel: Kernel, names: tuple[str, ...]) -> dict[str, int]:
    state = kernel.state()
    return {name: state[name] for name in names}


@given(moving_kernels(), INT64, INT64, INT64, NOT_FRESH, NOT_FRESH)
@settings(max_examples=60)
def test_without_any_fresh_input_the_pose_does_not_move(
    kernel: Kernel, left: int, right: int, code: int, encoder: int, gyro: int
) -> None:
    before = fields(kernel, POSITION_FIELDS + HEADING_FIELDS)
    for _ in range(3):
        kernel.step(left, right, encoder, code, gyro)
        assert fields(kernel, POSITION_FIELDS + HEADING_FIELDS) == before
        assert kernel.heading_source == HeadingSource.HELD


@given(moving_kernels(), INT64, INT64, st.integers(0, 65535), NOT_FRESH)
@settings(max_examples=60)
def test_without_a_fresh_encoder_the_position_does_not_move_and_says_so(
    kernel: Kernel, left: int, right: int, code: int, encoder: int
) -> None:
    before = fields(kernel, POSITION_FIELDS)
    heading = fields(kernel, HEADING_FIELDS)
    kernel.step(left, right, encoder, code, FRESH)
    assert fields(kernel, POSITION_FIELDS) == before
    assert kernel.status & StatusBit.POSITION_HELD
    if kernel.config.description.mode == "wheel":
        assert fields(kernel, HEADING_FIELDS) == heading


@given(moving_kernels(), st.data())
@settings(max_examples=60)
def test_the_value_of_an_input_that_is_not_fresh_leaves_no_trace_anywhere(
    kernel: Kernel, data: st.DataObject
) -> None:
    """Two kernels that differ only in what the unbelieved inputs carry stay equal in all fields."""
    other = Kernel(kernel.config, "python")
    other.load_state(kernel.state())
    for tick in data.draw(inputs(kernel.config, max_ticks=20)):
        encoder = tick.encoder_validity == FRESH
        gyro = tick.gyro_validity == FRESH
        garbled = Inputs(
            tick.left_count if encoder else data.draw(INT64),
            tick.right_count if encoder else data.draw(INT64),
            tick.encoder_validity,
            tick.gyro_code if gyro else data.draw(INT64),
            tick.gyro_validity,
        )
        kernel.step(*tick)
        other.step(*garbled)
        assert kernel.state() == other.state()


@pytest.mark.parametrize("implementation", ["compiled", "python"])
@pytest.mark.parametrize("place", range(len(Inputs._fields)))
@pytest.mark.parametrize("value", [1 << 63, 1 << 70, -(1 << 63) - 1])
def test_an_input_beyond_64_bits_is_refused_and_leaves_no_trace(
    implementation: Literal["compiled", "python"], place: int, value: int
) -> None:
    kernel = Kernel(config_of(), implementation)
    before = kernel.state()
    given_inputs = list(Inputs(0, 0))
    given_inputs[place] = value
    with pytest.raises(OverflowError):
        kernel.step(*given_inputs)
    assert kernel.state() == before


@given(moving_kernels(), st.data())
@settings(max_examples=40)
def test_a_fresh_gyro_never_moves_the_heading_of_a_wheel_firmware(
    kernel: Kernel, data: st.DataObject
) -> None:
    config = config_of(mode="wheel")
    one, two = Kernel(config, "python"), Kernel(config, "python")
    pose_fields = HEADING_FIELDS + POSITION_FIELDS
    for tick in data.draw(inputs(config, max_ticks=20)):
        one.step(*tick)
        two.step(*tick._replace(gyro_code=data.draw(INT64), gyro_validity=FRESH))
        assert fields(one, pose_fields) == fields(two, pose_fields)
