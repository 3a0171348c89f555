"""Noise levels of a drive are sought until they gain no more."""

from __future__ import annotations

import pytest
from drive_recordings import ROBOT, block_of, simulated

from gap_diagnosis.drive.likelihood import fitted_levels, setting_of
from gap_diagnosis.drive.noise import STARTS


@pytest.mark.parametrize("start", STARTS[1:], ids=["quiet", "rough"])
def test_a_search_for_noise_levels_is_not_over_after_so_many_steps(start) -> None:
    """Cut short after 25, levels beside a dead encoder were 545 nats worse than beside a gain of
    nothing as well: that hid counts which came too often (a dead encoder alone, 1.00)."""
    effects = {
        "encoder_dead": {"side": "right", "start_s": 20.0},
        "extra_ticks": {"side": "left", "rate": 5.0},
    }
    block = block_of(simulated(effects, seed=5))
    names = frozenset(effects)
    setting = setting_of(block._variants(names)[0], ROBOT, names)
    levels, reached = fitted_levels(setting, {}, start)
    _, again = fitted_levels(setting, {}, levels)
    assert again < reached + 1.0
