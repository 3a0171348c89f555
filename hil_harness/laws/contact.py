"""Contact: the ground step differs from the wheel step, Δs_eff = Δs + w, per wheel.

A biased w (persistent slip) drifts with the number of steps k; a noisy w (micro-slip) walks with
√k (Borenstein, Everett and Feng 1996, chapter 5; Chong and Kleeman 1997 let the variance of each
wheel grow with its distance).
"""

from __future__ import annotations

import numpy as np

from hil_harness.laws.bench import Bench, path_lengths_m
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, dots, law, line, spreads, thinned
from hil_harness.laws.statistics import (
    FALSE_ALARM,
    growth,
    growth_tolerance,
    split_error,
    variance_interval,
    variance_tolerance,
)
from sim_plant import Mechanisms

SPEED_M_S = 0.6
DURATION_S = 60.0
OFFSET_LEFT_M = 10e-6
OFFSET_RIGHT_M = -20e-6
SLIP_RATIO = 0.01
SLIP_WINDOW_S = (20.0, 40.0)
NOISE_M = 20e-6
GROWTH_BLOCKS = 16


def _biased(bench: Bench) -> Evidence:
    commands = bench.constant(SPEED_M_S, 0.0, DURATION_S)
    journey = bench.drive(
        commands,
        Mechanisms(contact_offset_left_m=OFFSET_LEFT_M, contact_offset_right_m=OFFSET_RIGHT_M),
    )
    believed = bench.odometry(journey, "wheel")[0]
    steps = np.arange(len(believed))
    distance_error_m = path_lengths_m(believed) - path_lengths_m(journey.truth[0])
    heading_error_rad = believed[:, 2] - journey.truth[0, :, 2]
    common_m = (OFFSET_RIGHT_M + OFFSET_LEFT_M) / 2
    turn_rad = (OFFSET_RIGHT_M - OFFSET_LEFT_M) / bench.wheelbase_m
    last = float(steps[-1])
    checks = (
        Check(
            law="contact_biased_distance",
            predicted=-common_m * last,
            measured=float(distance_error_m[-1]),
            tolerance=bench.m_per_tick,
            unit="m",
            derivation="a counter that floors reads at most one tick short",
        ),
        Check(
            law="contact_biased_heading",
            predicted=-turn_rad * last,
            measured=float(heading_error_rad[-1]),
            tolerance=bench.m_per_tick / bench.wheelbase_m,
            unit="rad",
            derivation="the difference of two counts that floor is within one tick",
        ),
    )
    windowed = bench.drive(
        commands,
        Mechanisms(
            slip_ratio_right=SLIP_RATIO,
            slip_start_s=SLIP_WINDOW_S[0],
            slip_stop_s=SLIP_WINDOW_S[1],
        ),
    )
    slipped_rad = bench.odometry(windowed, "wheel")[0, :, 2] - windowed.truth[0, :, 2]
    time_s = bench.tick_s * steps
    slope_rad_s = SLIP_RATIO * SPEED_M_S / bench.wheelbase_m
    from_s = np.array([0.0, SLIP_WINDOW_S[1] - SLIP_WINDOW_S[0]])
    return Evidence(
        checks,
        (
            Panel(
                "The same w in every step: a drift",
                "steps k",
                "error [mm, mrad]",
                (
                    law("", thinned(steps), thinned(-1e3 * common_m * steps)),
                    law("", thinned(steps), thinned(-1e3 * turn_rad * steps)),
                    dots("distance [mm]", thinned(steps, 12), thinned(1e3 * distance_error_m, 12)),
                    dots(
                        "heading [mrad]",
                        thinned(steps, 12),
                        thinned(1e3 * heading_error_rad, 12),
                        2,
                    ),
                ),
            ),
            Panel(
                "Slip of one wheel from 20 s to 40 s",
                "time [s]",
                "heading error [rad]",
                (
                    law("∝ steps", from_s + SLIP_WINDOW_S[0], slope_rad_s * from_s),
                    line("firmware", thinned(time_s), thinned(slipped_rad)),
                ),
                broken=(SLIP_WINDOW_S[1], DURATION_S),
            ),
        ),
        "First: contact adds the same 10 µm to each left and takes 20 µm from each right ground "
        "step. Second: the right wheel slips by 1 % for 20 s. The law counts steps under slip, not "
        "steps: after the window (shaded) the error stays and does not grow.",
    )


def _noisy(bench: Bench) -> Evidence:
    runs = bench.runs
    journey = bench.drive(
        bench.constant(SPEED_M_S, 0.0, DURATION_S),
        Mechanisms(micro_slip_step_left_m=NOISE_M, micro_slip_step_right_m=NOISE_M),
        runs=runs,
    )
    believed = bench.odometry(journey, "wheel")
    distance_m = path_lengths_m(believed) - path_lengths_m(journey.truth)
    heading_rad = believed[..., 2] - journey.truth[..., 2]
    across_m = believed[..., 1] - journey.truth[..., 1]
    k = distance_m.shape[1] - 1
    distance_variance_m2 = NOISE_M**2 / 2 * k
    heading_variance_rad2 = 2 * NOISE_M**2 / bench.wheelbase_m**2 * k
    checks = (
        Check(
            law="contact_noisy_distance",
            predicted=distance_variance_m2,
            measured=float(np.var(distance_m[:, k], ddof=1)),
            tolerance=variance_tolerance(distance_variance_m2, runs - 1),
            unit="m²",
            derivation=f"chi-square with {runs - 1} degrees of freedom about k·σ²/2",
            interval=variance_interval(distance_m[:, k]),
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="contact_noisy_heading",
            predicted=heading_variance_rad2,
            measured=float(np.var(heading_rad[:, k], ddof=1)),
            tolerance=variance_tolerance(heading_variance_rad2, runs - 1),
            unit="rad²",
            derivation=f"chi-square with {runs - 1} degrees of freedom about 2k·σ²/b²",
            interval=variance_interval(heading_rad[:, k]),
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="contact_noisy_growth",
            predicted=GROWTH_BLOCKS,
            measured=growth(distance_m, GROWTH_BLOCKS),
            tolerance=growth_tolerance(GROWTH_BLOCKS, runs, GROWTH_BLOCKS),
            unit="1",
            derivation="variance over all steps to that over a sixteenth of them: F distribution "
            "about 16; a drift would give 256",
            false_alarm=FALSE_ALARM,
        ),
    )
    at = np.unique(np.geomspace(10, k, 16).astype(int))
    spread = [split_error(1e3 * distance_m[:, step], "", "mm") for step in at]
    across = [split_error(1e3 * across_m[:, step], "", "mm") for step in at]
    across_law_mm = 1e3 * np.sqrt(
        2 * NOISE_M**2 / bench.wheelbase_m**2 * (SPEED_M_S * bench.tick_s) ** 2 * at**3.0 / 3
    )
    return Evidence(
        checks,
        (
            Panel(
                "A fresh w in every step: a random walk",
                "steps k",
                "spread of the distance error [mm]",
                (
                    law("σ√(k/2)", at, 1e3 * NOISE_M * np.sqrt(at / 2)),
                    spreads(f"{runs} runs, 95 %", at, spread),
                ),
                log_x=True,
                log_y=True,
            ),
            Panel(
                "Across the track: no longer √k",
                "steps k",
                "spread across the track [mm]",
                (
                    law("√k", at, across_law_mm[0] * np.sqrt(at / at[0])),
                    law("k^(3/2)", at, across_law_mm, 2),
                    spreads("firmware", at, across),
                ),
                log_x=True,
                log_y=True,
                broken=(float(at[1]), float(at[-1])),
            ),
        ),
        "First: the spread of the distance error grows with √k. Second: the heading walks as well, "
        "and the error across the track adds it up step by step: √k breaks there from the first "
        "steps on, and k^(3/2) holds.",
        (
            split_error(distance_m[:, k], f"distance error after {k} steps", "m"),
            split_error(heading_rad[:, k], f"heading error after {k} steps", "rad"),
        ),
    )


LAWS = (
    Law(
        name="contact_biased",
        title="Persistent slip drifts in proportion to the steps taken under it",
        formula="Δs_eff = Δs + w, w = const: error −k·w̄ in distance, −k(w_R − w_L)/b in heading",
        validity="exact while w is constant; counts only steps in which the wheel turns and slips",
        source="Borenstein, Everett & Feng 1996",
        measure=_biased,
    ),
    Law(
        name="contact_noisy",
        title="Micro-slip walks with the square root of the steps",
        formula="var(Ŝ − S) = k·σ²/2, var(θ̂ − θ) = 2k·σ²/b²",
        validity="distance and heading, steps independent; across the track the variance grows as "
        "k³",
        source="Chong & Kleeman 1997; Kelly 2004",
        measure=_noisy,
    ),
)
