"""The bound of x and y holds on any drive, and a word that does not hold it is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import ROBOT

from firmware_model import (
    FRESH,
    FirmwareDescription,
    FirmwareError,
    Kernel,
    build_config,
)
from firmware_model.reach import counts_of, position_reach, require_position_holds

ROUNDING = st.sampled_from(["floor", "half_up", "half_even", "toward_zero"])
FORMAT = st.fixed_dictionaries({"rounding": ROUNDING, "carry_remainder": st.booleans()})


@given(FORMAT, FORMAT, st.integers(0, 20), st.integers(10, 28), st.integers(0, 2**32))
@settings(max_examples=60)
def test_no_drive_leaves_the_reach_of_its_counts(
    position: dict[str, Any], step: dict[str, Any], coarse: int, fine: int, seed: int
) -> None:
    table = {
        "mode": "wheel",
        "position": position | {"frac_bits": coarse},
        "step": step | {"frac_bits": fine},
        "trig": {"entries": 16},
    }
    config = build_config(FirmwareDescription.from_table(table), ROBOT)
    rng = np.random.default_rng(seed)
    fastest = int(rng.choice([1, 2, config.max_step_ticks]))
    steps = rng.integers(-fastest, fastest, endpoint=True, size=(300, 2))
    if rng.random() < 0.5:
        steps = np.abs(steps)  # straight on: all of the way is in x
    kernel, moving = Kernel(config), 0
    for ticks, (left, right) in enumerate(np.cumsum(steps, axis=0).tolist()):
        kernel.step(left, right, FRESH, 32768, FRESH)
        moving = int(np.abs(steps[1 : ticks + 1].sum(axis=1)).sum())
        reach = position_reach(config, moving, ticks)
        assert max(abs(kernel.x_m_q), abs(kernel.y_m_q)) <= reach


def test_a_distance_is_so_many_counts_that_the_reach_is_not_below_it() -> None:
    config = build_config(FirmwareDescription(), ROBOT)
    reach = position_reach(config, counts_of(config, 100.0), 10_000)
    assert 100.0 <= reach / 2**32 < 100.001


def test_what_would_be_right_is_said_and_is_right() -> None:
    def config(word_bits: int, frac_bits: int) -> Any:
        table = {"position": {"word_bits": word_bits, "frac_bits": frac_bits}}
        return build_config(FirmwareDescription.from_table(table), ROBOT)

    def require(word_bits: int, frac_bits: int, distance_m: float) -> None:
        one = config(word_bits, frac_bits)
        reach = position_reach(one, counts_of(one, distance_m), 1000)
        require_position_holds(one, reach, f"{distance_m:g} m")

    with pytest.raises(FirmwareError, match=r"= 25: 10 m do not fit with 21 .* at least 26 bits$"):
        require(25, 21, 10.0)
    require(26, 21, 10.0)
    with pytest.raises(FirmwareError, match=r"do not fit with 48 .* at most 46 fraction bits$"):
        require(64, 48, 1e5)
    require(64, 46, 1e5)
