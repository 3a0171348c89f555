"""Manoeuvre kinds from commands or wheels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from gap_cases import ROBOT, TICK_S, drives
from hypothesis import given
from hypothesis import strategies as st

from gap_diagnosis.gap.manoeuvres import KINDS, kinds_of, kinds_of_rates, stretches_of

HALF_M = 0.15
PLAN = (
    ("rest", 0.0, 0.0),
    ("straight", 0.5, 0.0),
    ("arc", 0.5, 0.5),
    ("spin", 0.0, 1.0),
    ("reverse", -0.4, 0.0),
)


def planned(scale: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count = round(5.0 / TICK_S)
    v = np.repeat([scale * v for _, v, _ in PLAN], count)
    w = np.repeat([w for _, _, w in PLAN], count)
    return np.arange(len(v)) * TICK_S, v, w


def test_the_middle_of_each_commanded_stretch_is_of_its_kind() -> None:
    t_s, v, w = planned()
    kinds = kinds_of_rates(t_s, v, w * HALF_M, least_m_s=0.0, is_command=True)
    middles = [KINDS[kinds[round((k + 0.5) * 5.0 / TICK_S)]] for k in range(len(PLAN))]
    assert middles == [kind for kind, _, _ in PLAN]


def test_a_step_up_is_accelerating_and_a_step_down_is_braking() -> None:
    t_s = np.arange(600) * TICK_S
    v = np.where((t_s > 2) & (t_s < 4), 0.5, 0.0)
    kinds = kinds_of_rates(t_s, v, np.zeros(600), least_m_s=0.0, is_command=True)
    order = [KINDS[run.kind] for run in stretches_of(kinds)]
    assert order == ["rest", "accelerate", "straight", "brake", "rest"]


@given(scale=st.floats(1e-3, 1e3))
def test_a_robot_of_any_size_is_judged_alike(scale: float) -> None:
    t_s, v, w = planned()
    small = kinds_of_rates(t_s, v, w * HALF_M, least_m_s=0.0, is_command=True)
    large = kinds_of_rates(t_s, scale * v, scale * w * HALF_M, least_m_s=0.0, is_command=True)
    assert np.array_equal(small, large)


@pytest.mark.parametrize("unit", [1000.0, 100.0])
def test_commands_in_millimetres_give_nearly_the_kinds_of_metres(unit: float) -> None:
    _, [(recording, _)] = drives("random")
    assert recording.v_command_m_s is not None
    scaled = replace(recording, v_command_m_s=recording.v_command_m_s * unit)
    same = kinds_of(recording, ROBOT) == kinds_of(scaled, ROBOT)
    assert same.mean() > 0.8


def test_without_commands_the_wheels_tell_nearly_the_same_kinds() -> None:
    _, [(recording, _)] = drives("square")
    wheels = replace(recording, v_command_m_s=None, w_command_rad_s=None)
    assert (kinds_of(recording, ROBOT) == kinds_of(wheels, ROBOT)).mean() > 0.85


def test_a_robot_that_never_moves_rests() -> None:
    _, [(recording, _)] = drives("square")
    still = np.round(np.random.default_rng(1).normal(0, 0.4, len(recording.t_s)))
    resting = replace(
        recording,
        left_ticks=still,
        right_ticks=-still,
        v_command_m_s=None,
        w_command_rad_s=None,
    )
    assert not kinds_of(resting, ROBOT).any()


@given(st.lists(st.integers(0, 6), min_size=1, max_size=60))
def test_stretches_cover_every_tick_once(kinds: list[int]) -> None:
    array = np.array(kinds, dtype=np.int8)
    rebuilt = np.concatenate(
        [np.full(run.stop - run.first, run.kind) for run in stretches_of(array)]
    )
    assert np.array_equal(rebuilt, array)
