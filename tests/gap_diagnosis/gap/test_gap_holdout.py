"""Held-out stretches: a quarter of the log, every kind on both sides, or a sentence why not."""

from __future__ import annotations

import numpy as np
import pytest
from gap_cases import ROBOT, TICK_S, drives
from hypothesis import given, settings
from hypothesis import strategies as st

from gap_diagnosis.gap.holdout import BLOCK_S, CUT_S, HoldOut, hold_out
from gap_diagnosis.gap.manoeuvres import KINDS, Kinds, kinds_of


def sides(duration_s: float, seed: int, run_s: float = 2.0) -> tuple[np.ndarray, Kinds, HoldOut]:
    t_s = np.arange(round(duration_s / TICK_S) + 1) * TICK_S
    runs = np.random.default_rng(seed).integers(1, len(KINDS), int(duration_s / run_s) + 2)
    kinds = runs[(t_s / run_s).astype(int)].astype(np.int8)
    return t_s, kinds, hold_out(t_s, kinds)


@settings(max_examples=40)
@given(duration_s=st.floats(25.0, 400.0), seed=st.integers(0, 99))
def test_held_out_blocks_last_at_least_ten_seconds_and_the_fit_keeps_its_distance(
    duration_s: float, seed: int
) -> None:
    t_s, _, sides_of = sides(duration_s, seed)
    assert sides_of.why_not is None
    assert not (sides_of.fit & sides_of.held_out).any()
    for start_s, stop_s in sides_of.windows:
        assert stop_s - start_s >= BLOCK_S - 1e-9
        assert t_s[0] <= start_s
        assert stop_s <= t_s[-1] + 1e-9
        near = (t_s > start_s - CUT_S) & (t_s < stop_s + CUT_S)
        assert not sides_of.fit[near].any()


@settings(max_examples=25)
@given(duration_s=st.floats(80.0, 1200.0), seed=st.integers(0, 9))
def test_about_a_quarter_of_the_log_is_held_out(duration_s: float, seed: int) -> None:
    _, _, sides_of = sides(duration_s, seed)
    assert sides_of.held_out.mean() == pytest.approx(0.25, abs=0.07)


@pytest.mark.parametrize("name", ["random", "square"])
def test_every_kind_of_a_drive_lies_on_both_sides(name: str) -> None:
    _, [(recording, _)] = drives(name)
    kinds = kinds_of(recording, ROBOT)
    sides_of = hold_out(recording.t_s, kinds)
    assert sides_of.one_sided == ()
    for kind in np.unique(kinds):
        if (kinds == kind).sum() * TICK_S >= 2.0:
            assert (kinds[sides_of.fit] == kind).any()
            assert (kinds[sides_of.held_out] == kind).any()


@given(seed=st.integers(0, 20))
def test_the_same_log_gives_the_same_sides(seed: int) -> None:
    _, _, first = sides(120.0, seed)
    _, _, second = sides(120.0, seed)
    assert np.array_equal(first.fit, second.fit)
    assert first.windows == second.windows


@pytest.mark.parametrize("duration_s", [0.0, 10.0, 24.0])
def test_a_short_log_has_no_held_out_stretch_and_says_why(duration_s: float) -> None:
    _, _, sides_of = sides(duration_s, 1)
    assert sides_of.why_not is not None
    assert f"the log lasts {duration_s:.3g} s" in sides_of.why_not
    assert sides_of.fit.all()
    assert not sides_of.held_out.any()


def test_a_log_that_nearly_always_rests_says_so() -> None:
    t_s = np.arange(12000) * TICK_S
    kinds = np.zeros(12000, dtype=np.int8)
    kinds[6000:6500] = 1
    assert "moves for only 5 s" in str(hold_out(t_s, kinds).why_not)


def test_motion_within_one_block_is_cut_through_so_that_both_sides_move() -> None:
    t_s = np.arange(12000) * TICK_S
    kinds = np.zeros(12000, dtype=np.int8)
    kinds[5000:6200] = 1
    sides_of = hold_out(t_s, kinds)
    assert sides_of.why_not is None
    assert (kinds[sides_of.fit] == 1).any()
    assert (kinds[sides_of.held_out] == 1).any()


@pytest.mark.parametrize("window_s", [(40.0, 60.0), (3.0, 9.0), (100.0, 118.0)])
def test_a_part_of_the_window_in_which_an_effect_acts_is_held_out_and_a_part_is_fitted(
    window_s: tuple[float, float],
) -> None:
    """Of a slip from 40 to 60 s nothing was held out: its share closed was 0 %."""
    t_s, kinds, _ = sides(120.0, 1)
    sides_of = hold_out(t_s, kinds, [window_s])
    inside = (t_s >= window_s[0]) & (t_s <= window_s[1])
    assert (inside & sides_of.held_out).sum() * TICK_S >= 0.5
    assert (inside & sides_of.fit).sum() * TICK_S >= 0.5
    assert sides_of.unmet == ()
    assert sides_of.held_out.mean() == pytest.approx(0.25, abs=0.07)


def test_a_window_of_which_nothing_is_held_out_is_told() -> None:
    """While a robot stands, nothing tells what its wheels would slip."""
    t_s, kinds, _ = sides(120.0, 1)
    resting_s = (50.0, 56.0)
    kinds[(t_s >= resting_s[0]) & (t_s <= resting_s[1])] = 0
    assert hold_out(t_s, kinds, [resting_s, (60.0, 90.0)]).unmet == (resting_s,)
