"""The line from ticks to the log's clock: unmoved by jitter, honest about what it does not know."""

import numpy as np
import pytest
from full_size import at_full_size
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from gap_diagnosis.reading.clock import fit_clock, lowered

PERIOD_S = 0.01


def one_segment(tick: np.ndarray) -> np.ndarray:
    return np.zeros(len(tick), dtype=np.int64)


@given(skew=st.floats(-2e-3, 2e-3), start_s=st.floats(0, 1e3), ticks=st.integers(100, 20_000))
def test_stamps_without_jitter_give_the_clock_to_the_step_of_the_stamps(
    skew: float, start_s: float, ticks: int
) -> None:
    tick = np.arange(ticks)
    stamp_s = np.round(start_s + tick * PERIOD_S / (1 + skew), 6)
    clock = fit_clock(tick, one_segment(tick), stamp_s, PERIOD_S)
    assert np.max(np.abs(clock.time_s(tick) - start_s - tick * PERIOD_S / (1 + skew))) < 2e-6
    # Rounding that goes one way over the log is no noise: it tilts the line by a step at most.
    assert abs(clock.skew - skew) < 6 * clock.skew_sd + 1e-6 / (ticks * PERIOD_S)


@pytest.mark.parametrize("law", ["exponential", *at_full_size("normal", "uniform")])
def test_the_skew_misses_by_what_its_standard_deviation_says(law: str) -> None:
    tick = np.arange(2000)
    scores = []
    for seed in range(200):
        draw = getattr(np.random.default_rng(seed), law)
        jitter_s = 0.002 * draw(size=len(tick))
        clock = fit_clock(tick, one_segment(tick), tick * PERIOD_S / 1.0012 + jitter_s, PERIOD_S)
        scores.append((clock.skew - 0.0012) / clock.skew_sd)
    spread = float(np.std(scores))
    # The standard deviation of 200 scores is itself known to 1/√400; 60 blocks add their own share.
    assert 0.83 < spread < 1.25
    assert abs(np.mean(scores)) < stats.norm.ppf(0.9995) * spread / np.sqrt(200)


def test_a_burst_of_late_stamps_has_no_say() -> None:
    tick = np.arange(4000)
    stamp_s = tick * PERIOD_S + 0.0005 * np.random.default_rng(0).exponential(size=4000)
    without = fit_clock(tick[100:], one_segment(tick[100:]), stamp_s[100:], PERIOD_S)
    stamp_s[:100] = stamp_s[100]
    burst = fit_clock(tick, one_segment(tick), stamp_s, PERIOD_S)
    assert burst.skew == pytest.approx(without.skew, abs=without.skew_sd / 2)


def test_segments_share_the_slope_and_have_their_own_start() -> None:
    tick = np.concatenate((np.arange(500), np.arange(600, 900)))
    segment = np.repeat([0, 1], [500, 300])
    stamp_s = tick * PERIOD_S * 1.001 + np.where(segment == 1, 0.0137, 0.0)
    clock = fit_clock(tick, segment, stamp_s, PERIOD_S)
    assert clock.time_s(tick, segment) == pytest.approx(stamp_s, abs=1e-9)
    assert clock.tick(stamp_s, segment) == pytest.approx(tick, abs=1e-6)


def test_too_few_stamps_say_nothing_of_the_skew() -> None:
    tick = np.arange(3)
    assert np.isnan(fit_clock(tick, one_segment(tick), tick * PERIOD_S, PERIOD_S).skew_sd)


@given(
    seed=st.integers(0, 2**32 - 1),
    jitter_s=st.floats(0, 0.005),
    latency_s=st.floats(0, 0.03),
    common_s=st.floats(0, 0.03),
    skew=st.floats(-2e-3, 2e-3),
)
def test_only_what_every_message_is_late_by_moves_the_line(
    seed: int, jitter_s: float, latency_s: float, common_s: float, skew: float
) -> None:
    random = np.random.default_rng(seed)
    tick = np.arange(4000)
    segment = (tick >= 1500).astype(np.int64)
    sampled_s = tick * PERIOD_S / (1 + skew) + 0.7 * segment
    late_s = common_s + jitter_s * random.exponential(size=(2, len(tick)))
    wheels_s = sampled_s + late_s[0] + latency_s
    line = fit_clock(tick, segment, wheels_s, PERIOD_S)
    messages = [(tick, segment, wheels_s), (tick, segment, sampled_s + late_s[1])]
    away_s = lowered(line, messages).time_s(tick, segment) - sampled_s - common_s
    # The slope remains that of the middle; the earliest of 1,500 delays is nearly none.
    assert np.max(np.abs(away_s)) < 0.01 * jitter_s + 6 * line.skew_sd * tick[-1] * PERIOD_S + 1e-6


def test_a_single_early_stamp_has_no_say() -> None:
    tick = np.arange(4000)
    stamp_s = tick * PERIOD_S + 0.001 * np.random.default_rng(0).exponential(size=4000)
    line = fit_clock(tick, one_segment(tick), stamp_s, PERIOD_S)
    without = lowered(line, [(tick, one_segment(tick), stamp_s)])
    stamp_s[1234] -= 0.5
    early = lowered(line, [(tick, one_segment(tick), stamp_s)])
    assert early.start_s == pytest.approx(without.start_s, abs=2e-6)


@pytest.mark.parametrize("begins", [3000, 9000])
def test_a_delay_from_some_time_on_neither_tilts_nor_lifts_the_line(begins: int) -> None:
    """Of 20 ms from half of two minutes on it was 240 ppm slow, and 10 ms high where it was not."""
    tick = np.arange(12_000)
    stamp_s = tick * PERIOD_S + np.where(tick >= begins, 0.02, 0.0)
    clock = fit_clock(tick, one_segment(tick), stamp_s, PERIOD_S)
    clock = lowered(clock, [(tick, one_segment(tick), stamp_s)])
    assert clock.skew == pytest.approx(0.0, abs=1e-7)
    assert clock.start_s[0] == pytest.approx(0.0, abs=1e-5)
