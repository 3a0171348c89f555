"""How fast a wheel turns that may lose counts is told by what does not lose any."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gap_diagnosis.wheel_speeds import WheelSpeed, wheel_speed

TICK_S = 0.01
RAD_PER_COUNT = math.tau / 2048
RADII_DIFFER = 1.003
SCALE = 0.99
NOISE_RAD_S = 0.05
CRUISE_RAD_S = 6.0
SLOWER_RAD_S = 3.0
SMOOTH_TICKS = 5.0


def speeds() -> np.ndarray:
    """Return a wheel's true speed, float64[n]: rest, a cruise, a slower one, rest."""
    t_s = np.arange(0.0, 16.0, TICK_S)
    return np.interp(
        t_s,
        [1.0, 1.5, 6.0, 6.5, 12.0, 12.5],
        [0.0, CRUISE_RAD_S, CRUISE_RAD_S, SLOWER_RAD_S, SLOWER_RAD_S, 0.0],
    )


def counted(
    own: np.ndarray, rng: np.random.Generator, *, lost: float = 0.0, above: float = 0.0
) -> np.ndarray:
    """Return the rate that a counter shows of a speed, losing each count with a probability."""
    angle = np.cumsum(own) * TICK_S
    counts = np.diff(np.floor(angle / RAD_PER_COUNT), prepend=0.0).astype(int)
    counts -= np.where(own > above, rng.binomial(counts, lost), 0)
    return np.asarray(counts * RAD_PER_COUNT / TICK_S)


def known(own: np.ndarray, *, seed: int, gyro_seed: int, lost: float, above: float) -> WheelSpeed:
    """Return what is known of a wheel beside a slower one and a gyro, both of other scales."""
    rng, noise = np.random.default_rng(seed), np.random.default_rng(gyro_seed)
    other = 0.6 * own
    return wheel_speed(
        counted(own, rng, lost=lost, above=above),
        counted(other * RADII_DIFFER, rng),
        SCALE * (own - other) + NOISE_RAD_S * noise.standard_normal(len(own)),
        smooth_ticks=SMOOTH_TICKS,
        tick_s=TICK_S,
        rad_per_count=RAD_PER_COUNT,
        rounding_rad=RAD_PER_COUNT,
    )


@pytest.mark.parametrize("probability", [0.002, 0.02, 0.12])
def test_a_cruise_above_the_threshold_is_told_from_one_below_whatever_is_lost(
    probability: float,
) -> None:
    """At 12 % lost, a cruise of 6 rad/s counts 5.3: below a threshold of 5.8."""
    own = speeds()
    threshold = 5.8
    speed = known(own, seed=1, gyro_seed=2, lost=probability, above=threshold)
    share = speed.losing(threshold, probability).share_above
    fast, slow = own == CRUISE_RAD_S, own == SLOWER_RAD_S
    assert share[fast].min() > 0.99
    assert share[slow].max() < 0.01


def test_a_speed_is_as_well_known_as_it_is_said_to_be() -> None:
    """Over cruises and ramps, with a gyro and another wheel of wrong scales."""
    own = speeds()
    scores = []
    for seed in range(8):
        speed = known(own, seed=seed, gyro_seed=100 + seed, lost=0.02, above=5.0)
        told = speed.losing(5.0, 0.02)
        moving = own > 0.5
        scores.append(((told.rad_s - own) / told.sd_rad_s)[moving])
    # Six independent stretches of a log at least, eight logs: its root mean square is known to a
    # tenth; the stated one is an upper bound, of means that were found to agree within three.
    assert 0.2 < math.sqrt(float(np.mean(np.square(scores)))) < 1.3


def test_the_gyros_noise_does_not_choose_the_ticks_of_a_cruise_that_lose_counts() -> None:
    """With it in the speed, a threshold amid a cruise won 18 nats: it picked those ticks in which
    the gyro's noise asked for more counts."""
    own = speeds()
    cruise = (own == CRUISE_RAD_S) & (np.abs(np.arange(len(own)) * TICK_S - 3.75) < 1.0)
    shares = [
        known(own, seed=1, gyro_seed=seed, lost=0.004, above=0.0)
        .losing(CRUISE_RAD_S, 0.004)
        .share_above[cruise]
        for seed in (2, 3)
    ]
    assert np.ptp(shares[0] - shares[1]) < 0.2


def test_without_a_gyro_counts_alone_tell() -> None:
    own = speeds()
    rng = np.random.default_rng(1)
    speed = wheel_speed(
        counted(own, rng),
        counted(0.6 * own, rng),
        None,
        smooth_ticks=SMOOTH_TICKS,
        tick_s=TICK_S,
        rad_per_count=RAD_PER_COUNT,
        rounding_rad=RAD_PER_COUNT,
    )
    share = speed.losing(4.0, 0.01).share_above
    assert share[own == CRUISE_RAD_S].min() > 0.99
    assert share[own == SLOWER_RAD_S].max() < 0.01
