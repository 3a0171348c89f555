"""What `build_config` admits never leaves 64 bits: proved there, watched here."""

from __future__ import annotations

import sys
from dataclasses import fields, replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import configs, inputs

from firmware_model.config import CONFIG_FIELDS
from firmware_model.integers import floor_shift
from firmware_model.kernel import initial_state
from firmware_model.state import State
from firmware_model.step import step_kernel
from firmware_model.velocity import speed_m_s, turn_rate_rad_s

INT64_MIN, INT64_MAX = -(1 << 63), (1 << 63) - 1


class Watched(int):
    """An integer that fails the test where C99's int64_t would overflow.

    So does a shift that C99 leaves undefined, or to the implementation: a negative value shifted
    right anywhere but in `floor_shift`.
    """


def _watch(name: str, *, reflected: bool) -> None:
    method = f"__{'r' if reflected else ''}{name}__"
    plain = getattr(int, method)

    def operate(*operands: Any) -> Any:
        result = plain(*operands)
        if result is NotImplemented:
            return result
        assert INT64_MIN <= result <= INT64_MAX, f"{method}{operands} = {result}"
        if name in ("lshift", "rshift"):
            value, count = reversed(operands) if reflected else operands
            assert 0 <= count <= 63, f"{value}, {count}: undefined shift"
            in_floor_shift = sys._getframe(1).f_code is floor_shift.__code__
            is_floor_shift = name == "rshift" and in_floor_shift
            assert value >= 0 or is_floor_shift, f"{method}{operands}: a negative value"
        return Watched(result)

    setattr(Watched, method, operate)


for _operator in ("add", "sub", "mul", "and", "or", "xor", "lshift", "rshift"):
    _watch(_operator, reflected=False)
    _watch(_operator, reflected=True)
_watch("neg", reflected=False)


def test_a_negative_value_is_shifted_right_only_in_floor_shift() -> None:
    assert floor_shift(Watched(-5), 1) == -3
    with pytest.raises(AssertionError, match="a negative value"):
        Watched(-5) >> 1
    with pytest.raises(AssertionError, match="a negative value"):
        -5 >> Watched(1)


@given(st.data())
@settings(max_examples=60)
def test_no_intermediate_of_an_admitted_configuration_leaves_64_bits(data: st.DataObject) -> None:
    config = data.draw(configs())
    watched = replace(
        config,
        table=tuple(Watched(value) for value in config.table),
        **{name: Watched(getattr(config, name)) for name in CONFIG_FIELDS},
    )
    state = initial_state(config)
    for one in fields(State):
        setattr(state, one.name, Watched(getattr(state, one.name)))
    for tick in data.draw(inputs(config)):
        step_kernel(state, watched, watched.table, *(Watched(value) for value in tick))
        speed_m_s(state, watched)
        turn_rate_rad_s(state, watched)
    for one in fields(State):
        assert INT64_MIN <= getattr(state, one.name) <= INT64_MAX
