"""Frames find their ticks again, whatever the bus and the recorder did to them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from gap_diagnosis.reading.cycle_times import page_cycle_us
from gap_diagnosis.reading.ticks import unwrap_ticks

PERIOD_S = 0.01
MODULO = 15
seeds = st.integers(0, 2**32 - 1)


def unwrapped(stamp_s: NDArray[np.float64], tick: NDArray[np.int64]) -> NDArray[np.int64]:
    found = unwrap_ticks(
        stamp_s - stamp_s[0], tick % MODULO, modulo=MODULO, cycle_ticks=1, period_s=PERIOD_S
    )
    assert found.segment.max() == 0
    return found.tick - found.tick[0] + tick[0]


@given(
    seed=seeds,
    skew=st.floats(-2e-3, 2e-3),
    jitter_s=st.floats(0, 0.02),
    loss=st.floats(0, 0.1),
    twice=st.floats(0, 0.1),
    swapped=st.floats(0, 0.1),
)
def test_ticks_survive_jitter_loss_duplication_and_reordering(
    seed: int, skew: float, jitter_s: float, loss: float, twice: float, swapped: float
) -> None:
    random = np.random.default_rng(seed)
    tick = np.arange(1500)[random.random(1500) >= loss]
    stamp_s = np.maximum.accumulate(
        tick * PERIOD_S / (1 + skew) + random.exponential(1.0, len(tick)) * jitter_s
    )
    rows = np.sort(
        np.concatenate((np.arange(len(tick)), np.flatnonzero(random.random(len(tick)) < twice)))
    )
    tick, stamp_s = tick[rows], stamp_s[rows]
    for place in np.flatnonzero(random.random(len(tick) - 1) < swapped):
        tick[[place, place + 1]] = tick[[place + 1, place]]
    assert np.array_equal(unwrapped(stamp_s, tick), tick)


@given(seed=seeds, lost=st.integers(1, 400), after=st.integers(200, 1000))
def test_a_gap_of_any_length_keeps_the_tick(seed: int, lost: int, after: int) -> None:
    random = np.random.default_rng(seed)
    tick = np.concatenate((np.arange(after), np.arange(after + lost, 1800)))
    stamp_s = tick * PERIOD_S * 1.001 + random.uniform(0, 0.003, len(tick))
    assert np.array_equal(unwrapped(stamp_s, tick), tick)


@given(held=st.integers(8, 60), start=st.integers(100, 1000))
def test_frames_held_up_and_released_at_once_are_not_taken_for_lost_ones(
    held: int, start: int
) -> None:
    tick = np.arange(1500)
    stamp_s = tick * PERIOD_S
    late = (tick >= start) & (tick < start + held)
    stamp_s[late] = stamp_s[start + held] + np.arange(held) * 1e-5
    stamp_s = np.maximum.accumulate(stamp_s)
    assert np.array_equal(unwrapped(stamp_s, tick), tick)


def test_a_counter_that_begins_anew_starts_a_segment() -> None:
    first, second = np.arange(700), np.arange(600)
    stamp_s = np.concatenate((first * PERIOD_S, 7.0 + 1.234 + second * PERIOD_S))
    counter = np.concatenate((first, second)) % MODULO
    found = unwrap_ticks(stamp_s, counter, modulo=MODULO, cycle_ticks=1, period_s=PERIOD_S)
    assert np.array_equal(found.segment, np.repeat([0, 1], [700, 600]))
    assert np.all(np.diff(found.tick) > 0)
    assert found.tick[700] - found.tick[699] == pytest.approx(1.244 / PERIOD_S, abs=1)


@given(seed=seeds, skew=st.floats(-2e-3, 2e-3), jitter=st.floats(0, 0.15), losses=st.integers(0, 9))
def test_without_a_counter_the_stamps_tell_lost_frames(
    seed: int, skew: float, jitter: float, losses: int
) -> None:
    random = np.random.default_rng(seed)
    places = random.choice(np.arange(100, 1400, 30), losses, replace=False)
    tick = np.delete(np.arange(1500), places)
    stamp_s = (tick / (1 + skew) + jitter * random.uniform(0, 1, len(tick))) * PERIOD_S
    found = unwrap_ticks(stamp_s, None, modulo=0, cycle_ticks=1, period_s=PERIOD_S)
    assert np.array_equal(found.tick - found.tick[0], tick - tick[0])


@given(seed=seeds, skew=st.floats(-2e-3, 2e-3), jitter=st.floats(0.5, 0.85))
def test_stamps_that_jitter_by_a_cycle_lose_no_frame(seed: int, skew: float, jitter: float) -> None:
    """A car's frames, each 12 ms after the last, came 3 to 23 ms apart: 39 of 4,974 ticks were lost
    that way, and the ECU's clock was 0.8 % off."""
    random = np.random.default_rng(seed)
    tick = np.arange(1500)
    stamp_s = (tick / (1 + skew) + jitter * random.uniform(0, 1, len(tick))) * PERIOD_S
    found = unwrap_ticks(stamp_s, None, modulo=0, cycle_ticks=1, period_s=PERIOD_S)
    # The last frames may be late, or one before them be lost: nothing comes after them to tell.
    assert abs(found.tick[-1] - found.tick[0] - tick[-1]) <= 1


@pytest.mark.parametrize(
    ("jitter", "loss", "twice"), [(0.05, 0.1, 0.0), (0.05, 0.0, 0.05), (1.0, 0.0, 0.0)]
)
def test_how_often_a_message_comes_is_told_whether_frames_are_lost_or_late(
    jitter: float, loss: float, twice: float
) -> None:
    random = np.random.default_rng(1)
    tick = np.arange(4000)[random.random(4000) >= loss]
    tick = np.repeat(tick, 1 + (random.random(len(tick)) < twice))
    stamp_us = np.rint(1e4 * (tick + jitter * random.uniform(0, 1, len(tick)))).astype(np.int64)
    assert page_cycle_us(None, np.sort(stamp_us)) == pytest.approx(1e4, rel=2e-3)


def test_slow_messages_count_in_ticks_as_well() -> None:
    tick = np.arange(0, 4800, 16)[np.random.default_rng(1).random(300) > 0.1]
    found = unwrap_ticks(
        tick * PERIOD_S, tick % MODULO, modulo=MODULO, cycle_ticks=16, period_s=PERIOD_S
    )
    assert np.array_equal(found.tick - found.tick[0], tick - tick[0])
