"""Quantisation of the encoder, Δ = 2π/N per tick.

Where the wheel's phase within a tick is spread evenly, the error of one reading is uniform over one
tick: variance Δ²/12, and r²Δ²/12 on the distance (Borenstein, Everett and Feng 1996). It is a
property of the *reading* and does not add up over steps.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from hil_harness.laws.bench import Bench
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, dots, law, line, thinned
from hil_harness.laws.statistics import (
    FALSE_ALARM,
    mean_interval,
    mean_tolerance,
    split_error,
    variance_tolerance_of,
)

UNIFORM_KURTOSIS = 9 / 5
DITHER_TICKS = 20
DURATION_S = 60.0
SEED = 20260


def _quantisation(bench: Bench) -> Evidence:
    ticks = bench.ticks(DURATION_S)
    # Steps spread evenly over a whole number of ticks leave the phase within a tick independent
    # from one reading to the next and uniform: the uniform model's own conditions.
    steps_ticks = 20 + DITHER_TICKS * np.random.default_rng(SEED).random(ticks)
    error_ticks, error_m = _reading_errors(bench, steps_ticks)
    angle_rad = error_ticks * bench.rad_per_tick
    variance_rad2 = bench.rad_per_tick**2 / 12
    variance_m2 = bench.m_per_tick**2 / 12
    readings = len(error_ticks)
    derivation = (
        f"variance of a sample variance of {readings} independent uniform readings, kurtosis 9/5"
    )
    spread = float(stats.kstest(-error_ticks, "uniform").statistic)
    still_ticks, _ = _reading_errors(bench, np.r_[0.3, np.zeros(ticks - 1)])
    half_ticks, _ = _reading_errors(bench, np.r_[0.3, np.full(ticks - 1, 38.5)])
    # From −0.3 on, the two phases alternate; an even number of readings has both equally often.
    half_rad2 = float(np.var(half_ticks[: readings // 2 * 2])) * bench.rad_per_tick**2
    checks = (
        Check(
            law="quantisation_angle",
            predicted=variance_rad2,
            measured=float(np.var(angle_rad, ddof=1)),
            tolerance=variance_tolerance_of(UNIFORM_KURTOSIS, variance_rad2, readings),
            unit="rad²",
            derivation=derivation,
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="quantisation_distance",
            predicted=variance_m2,
            measured=float(np.var(error_m, ddof=1)),
            tolerance=variance_tolerance_of(UNIFORM_KURTOSIS, variance_m2, readings),
            unit="m²",
            derivation=derivation,
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="quantisation_mean",
            predicted=-0.5,
            measured=float(np.mean(error_ticks)),
            tolerance=mean_tolerance(math.sqrt(1 / 12), readings),
            unit="ticks",
            derivation="mean of uniform readings; the counter floors, so ±Δ/2 is shifted by −Δ/2",
            interval=mean_interval(error_ticks),
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="quantisation_uniform",
            predicted=0.0,
            measured=spread,
            tolerance=float(stats.kstwo.isf(FALSE_ALARM, readings)),
            unit="1",
            derivation="Kolmogorov–Smirnov distance between the errors and the uniform law",
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="quantisation_rest",
            predicted=0.0,
            measured=float(np.ptp(still_ticks)),
            tolerance=0.0,
            unit="ticks",
            derivation="exact: at rest one reading is repeated; range of its error",
        ),
        Check(
            law="quantisation_half_tick_speed",
            predicted=bench.rad_per_tick**2 / 16,
            measured=half_rad2,
            tolerance=1e-9 * bench.rad_per_tick**2,
            unit="rad²",
            derivation="38½ ticks per step: two phases half a tick apart, variance Δ²/16; 1e-9 "
            "tick for float64 sums of 2e5 ticks",
        ),
    )
    share = np.round(np.linspace(0.0, 1.0, 181), 9)
    relative = np.array(
        [
            12 * float(np.var(_reading_errors(bench, np.r_[0.3 / 7, np.full(420, 38 + s)])[0][1:]))
            for s in share
        ]
    )
    few = [(p, q) for q in range(1, 7) for p in range(q + 1) if math.gcd(p, q) == 1]
    return Evidence(
        checks,
        (
            Panel(
                "Evenly spread phases: uniform",
                "error of one reading [ticks]",
                "share of readings below",
                (
                    law("uniform", np.array([-1.0, 0.0]), np.array([0.0, 1.0])),
                    line(
                        f"plant, {readings} readings",
                        thinned(np.sort(error_ticks)),
                        thinned(np.arange(1, readings + 1) / readings),
                    ),
                    line("at rest", np.array([-1, -0.3, -0.3, 0]), np.array([0, 0, 1, 1]), 2),
                    line(
                        "38½ ticks per step",
                        np.array([-1, -0.8, -0.8, -0.3, -0.3, 0]),
                        np.array([0, 0, 0.5, 0.5, 1, 1]),
                        3,
                    ),
                ),
            ),
            Panel(
                "Constant speed: the model fails at simple ratios",
                "fraction of a tick per step",
                "variance / (Δ²/12)",
                (
                    law("uniform model", np.array([0.0, 1.0]), np.array([1.0, 1.0])),
                    line("plant, 420 steps", share, relative),
                    dots(
                        "1 − 1/q² at p/q",
                        np.array([p / q for p, q in few]),
                        np.array([1 - 1 / q**2 for _, q in few]),
                        2,
                    ),
                ),
            ),
        ),
        "First: how the error of one reading is spread when the wheel's phase is, and when it is "
        "not. Second: at a constant speed of p/q of a tick per step beyond whole ticks, only q "
        "phases occur and the variance is 1 − 1/q² of Δ²/12: nothing at whole ticks and at rest, "
        "three quarters at half ticks.",
        (split_error(error_m, "error of a distance reading, over readings", "m"),),
    )


def _reading_errors(bench: Bench, steps_ticks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drive straight by these ticks per step; return the reading errors in ticks and metres.

    The first is counter minus true wheel angle, the second distance by the firmware minus true
    distance; both of shape (steps,), the tick before the first step left out.
    """
    commands = np.zeros((len(steps_ticks), 2))
    commands[:, 0] = steps_ticks * bench.m_per_tick / bench.tick_s
    journey = bench.drive(commands)
    true_m = journey.truth[0, 1:, 0]
    counted = bench.wheel_angle_rad(journey.left_count)[0, 1:] / bench.rad_per_tick
    return (
        counted - true_m / bench.m_per_tick,
        bench.odometry(journey, "wheel")[0, 1:, 0] - true_m,
    )


LAWS = (
    Law(
        name="quantisation",
        title="One encoder reading is off by a uniform fraction of a tick",
        formula="q uniform over Δ = 2π/N: variance Δ²/12, on the distance r²Δ²/12",
        validity="phases spread evenly within a tick; not at rest, not at constant speeds of p/q "
        "tick per step with small q",
        source="Borenstein, Everett & Feng 1996",
        measure=_quantisation,
    ),
)
