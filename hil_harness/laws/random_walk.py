"""Independent errors of increments add up to a random walk; errors of readings do not.

e_{k+1} = e_k + η_k has mean 0 and variance k·var(η) (Kelly, IJRR 23(2), 2004; Chong and Kleeman,
ICRA 1997). The lesson's encoder disturbs each increment, a real counter each reading.
"""

from __future__ import annotations

import math

import numpy as np

from hil_harness.laws.bench import Bench, path_lengths_m
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, dots, law, line, spreads, thinned
from hil_harness.laws.statistics import (
    FALSE_ALARM,
    growth,
    growth_tolerance,
    mean_interval,
    mean_tolerance,
    split_error,
    variance_interval,
    variance_tolerance,
)

DURATION_S = 60.0
SPEED_M_S = 0.6
TICK_NOISE_TICKS = 0.2
GROWTH_BLOCKS = 16


def _random_walk(bench: Bench) -> Evidence:
    runs = bench.runs
    commands = bench.constant(SPEED_M_S, 0.0, DURATION_S)
    journey = bench.drive(
        commands, runs=runs, encoder_model="lesson_counter", noise_ticks=TICK_NOISE_TICKS
    )
    error_m = path_lengths_m(bench.odometry(journey, "wheel")) - path_lengths_m(journey.truth)
    k = error_m.shape[1] - 1
    true_ticks = SPEED_M_S * bench.tick_s / bench.m_per_tick
    bias_m = (round(true_ticks) - true_ticks) * bench.m_per_tick
    # The mean of two wheels: each carries the walk of its increments and, at the last reading only,
    # the rounding of its counter.
    variance_m2 = bench.m_per_tick**2 / 2 * (k * TICK_NOISE_TICKS**2 + 1 / 12)
    # A block's error has the rounding of both its ends.
    block_ticks2 = k // GROWTH_BLOCKS * TICK_NOISE_TICKS**2 + 2 / 12
    predicted_growth = (k * TICK_NOISE_TICKS**2 + 1 / 12) / block_ticks2
    checks = (
        Check(
            law="random_walk_mean",
            predicted=k * bias_m,
            measured=float(np.mean(error_m[:, k])),
            tolerance=mean_tolerance(math.sqrt(variance_m2), runs),
            unit="m",
            derivation="standard error of the mean, from the predicted spread",
            interval=mean_interval(error_m[:, k]),
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="random_walk_variance",
            predicted=variance_m2,
            measured=float(np.var(error_m[:, k], ddof=1)),
            tolerance=variance_tolerance(variance_m2, runs - 1),
            unit="m²",
            derivation=f"chi-square with {runs - 1} degrees of freedom about k·var(η)",
            interval=variance_interval(error_m[:, k]),
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="random_walk_growth",
            predicted=predicted_growth,
            measured=growth(error_m, GROWTH_BLOCKS),
            tolerance=growth_tolerance(predicted_growth, runs, GROWTH_BLOCKS),
            unit="1",
            derivation="variance over all steps to that over a sixteenth of them: F distribution "
            "about 16; a drift would give 256, noise of readings 1",
            false_alarm=FALSE_ALARM,
        ),
    )
    white = bench.drive(commands, runs=runs, noise_ticks=TICK_NOISE_TICKS)
    white_m = path_lengths_m(bench.odometry(white, "wheel")) - path_lengths_m(white.truth)
    at = np.unique(np.geomspace(10, k, 16).astype(int))
    walk = [split_error(1e3 * error_m[:, step], "", "mm") for step in at]
    shown = np.unique(np.geomspace(10, k, 160).astype(int))
    return Evidence(
        checks,
        (
            Panel(
                "Spread: increments walk, readings do not",
                "steps k",
                "spread of the distance error [mm]",
                (
                    law(
                        "√k",
                        at,
                        1e3 * bench.m_per_tick * TICK_NOISE_TICKS * np.sqrt(at / 2),
                    ),
                    spreads("noise on each increment", at, walk),
                    line(
                        "noise on each reading",
                        shown,
                        1e3 * np.std(white_m[:, shown], axis=0, ddof=1),
                        2,
                    ),
                ),
                log_x=True,
                log_y=True,
            ),
            Panel(
                "Mean: rounding each step drifts",
                "steps k",
                "mean distance error [mm]",
                (
                    law(
                        "k·(round(n) − n) ticks", np.array([0, k]), 1e3 * bias_m * np.array([0, k])
                    ),
                    dots(
                        f"mean of {runs} runs",
                        thinned(np.arange(k + 1), 12),
                        thinned(1e3 * np.mean(error_m, axis=0), 12),
                    ),
                    line(
                        "a real counter",
                        thinned(np.arange(k + 1)),
                        thinned(1e3 * np.mean(white_m, axis=0)),
                        2,
                    ),
                ),
            ),
        ),
        "The lesson's encoder rounds and disturbs each increment: a mean that drifts with k and a "
        "spread that walks with √k. A real counter is disturbed at each reading: neither grows, "
        "and √k does not hold for it.",
        (split_error(error_m[:, k], f"distance error after {k} steps", "m"),),
    )


LAWS = (
    Law(
        name="random_walk",
        title="Independent step errors walk with the square root of the steps",
        formula="e_{k+1} = e_k + η_k: var(e_k) = k·var(η)",
        validity="errors of increments, independent from step to step; not errors of readings",
        source="Kelly 2004; Chong & Kleeman 1997",
        measure=_random_walk,
    ),
)
