"""The gyro as a heading sensor: a bias drifts with time, its noise walks, and both bend the path.

ω_meas = ω + b_g + n_g integrates to θ + b_g·t + ∫n_g (Woodman, "An introduction to inertial
navigation", UCAM-CL-TR-696, 2007, section 3.2); on a straight the growing heading error becomes the
cross-track error ½·v·b_g·t².
"""

from __future__ import annotations

import math

import numpy as np

from hil_harness.laws.bench import Bench
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, dots, law, line, means, spreads, thinned
from hil_harness.laws.statistics import (
    FALSE_ALARM,
    mean_interval,
    mean_tolerance,
    split_error,
    variance_interval,
    variance_tolerance,
)
from sim_plant import Mechanisms

SPEED_M_S = 0.6
DURATION_S = 60.0
BIAS_RAD_S = 0.005
NOISE_RAD_PER_SQRT_S = 2e-4
SHORT_S = 12.0
LARGE_BIAS_RAD_S = 0.05


def _heading(bench: Bench) -> Evidence:
    runs = bench.runs
    journey = bench.drive(
        bench.constant(SPEED_M_S, 0.0, DURATION_S),
        Mechanisms(gyro_bias_rad_s=BIAS_RAD_S, gyro_noise_rad_per_sqrt_s=NOISE_RAD_PER_SQRT_S),
        runs=runs,
    )
    error_rad = bench.odometry(journey, "gyro")[..., 2] - journey.truth[..., 2]
    time_s = bench.tick_s * np.arange(error_rad.shape[1])
    end_s = float(time_s[-1])
    variance_rad2 = _noise_rad2_per_s(bench) * end_s
    checks = (
        Check(
            law="gyro_bias_heading",
            predicted=BIAS_RAD_S * end_s,
            measured=float(np.mean(error_rad[:, -1])),
            tolerance=mean_tolerance(math.sqrt(variance_rad2), runs),
            unit="rad",
            derivation="standard error of the mean, from the predicted spread",
            interval=mean_interval(error_rad[:, -1]),
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="gyro_noise_heading",
            predicted=variance_rad2,
            measured=float(np.var(error_rad[:, -1], ddof=1)),
            tolerance=variance_tolerance(variance_rad2, runs - 1),
            unit="rad²",
            derivation=f"chi-square with {runs - 1} degrees of freedom about the density squared "
            "times t, with the ADC's rounding as further white noise",
            interval=variance_interval(error_rad[:, -1]),
            false_alarm=FALSE_ALARM,
        ),
    )
    # An unlucky bias: without noise the ADC rounds every sample alike.
    half_lsb_rad_s = bench.gyro_rad_s_per_lsb / 2
    biases = half_lsb_rad_s * np.linspace(0, 6, 49)
    rounded = np.array([_end_heading(bench, bias, 0.0) for bias in biases])
    dithered = np.array(
        [_end_heading(bench, bias, NOISE_RAD_PER_SQRT_S, runs // 8) for bias in biases[::8]]
    )
    at = np.unique(np.geomspace(10, len(time_s) - 1, 14).astype(int))
    spread = [split_error(error_rad[:, step], "", "rad") for step in at]
    return Evidence(
        checks,
        (
            Panel(
                "Systematic part b_g·t, random part √t",
                "time [s]",
                "heading error [rad]",
                (
                    law("b_g·t", time_s[at], BIAS_RAD_S * time_s[at]),
                    law("N·√t", time_s[at], NOISE_RAD_PER_SQRT_S * np.sqrt(time_s[at]), 2),
                    means("mean", time_s[at], spread),
                    spreads("spread", time_s[at], spread, 2),
                ),
                log_x=True,
                log_y=True,
            ),
            Panel(
                "Biases of a few codes: the ADC breaks b_g·t",
                "bias [LSB]",
                "heading error after 60 s [LSB·s]",
                (
                    law(
                        "b_g·t",
                        biases / (2 * half_lsb_rad_s),
                        biases * end_s / (2 * half_lsb_rad_s),
                    ),
                    line("no noise", biases / (2 * half_lsb_rad_s), rounded / (2 * half_lsb_rad_s)),
                    dots(
                        f"noise of 15 LSB, {runs // 8} runs",
                        biases[::8] / (2 * half_lsb_rad_s),
                        dithered / (2 * half_lsb_rad_s),
                        2,
                    ),
                ),
            ),
        ),
        "First: mean and spread of the heading error over seeds. The mean drifts, the spread "
        "walks. Second: a bias below half a code of a silent sensor is never seen and one above "
        "counts as a whole code; the noise of a real gyro dithers the converter and restores the "
        "law.",
        (split_error(error_rad[:, -1], f"heading error after {end_s:g} s", "rad"),),
    )


def _cross_track(bench: Bench) -> Evidence:
    runs = bench.runs
    journey = bench.drive(
        bench.constant(SPEED_M_S, 0.0, DURATION_S),
        Mechanisms(gyro_bias_rad_s=BIAS_RAD_S, gyro_noise_rad_per_sqrt_s=NOISE_RAD_PER_SQRT_S),
        runs=runs,
    )
    across_m = bench.odometry(journey, "gyro", "midpoint")[..., 1] - journey.truth[..., 1]
    time_s = bench.tick_s * np.arange(across_m.shape[1])
    short = round(SHORT_S / bench.tick_s)

    def spread_m(until_s: float) -> float:
        """Return the spread across the track from a heading that walks: v·N·√(t³/3)."""
        return SPEED_M_S * math.sqrt(_noise_rad2_per_s(bench) * until_s**3 / 3)

    def exact_m(until_s: np.ndarray, bias_rad_s: float) -> np.ndarray:
        return np.asarray(SPEED_M_S / bias_rad_s * (1 - np.cos(bias_rad_s * until_s)))

    end_s = float(time_s[-1])
    # The mean cosine of a walking heading falls short of one by half its variance at most.
    sagging_m = SPEED_M_S * end_s * BIAS_RAD_S * end_s * _noise_rad2_per_s(bench) * end_s / 2
    checks = (
        Check(
            law="gyro_bias_cross_track",
            predicted=0.5 * SPEED_M_S * BIAS_RAD_S * SHORT_S**2,
            measured=float(np.mean(across_m[:, short])),
            tolerance=mean_tolerance(spread_m(SHORT_S), runs)
            + SPEED_M_S * BIAS_RAD_S**3 * SHORT_S**4 / 24
            + bench.m_per_tick * BIAS_RAD_S * SHORT_S,
            unit="m",
            derivation="standard error of the mean; remainder v·b_g³·t⁴/24; one tick of distance "
            "at the final heading",
            interval=mean_interval(across_m[:, short]),
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="gyro_bias_cross_track_exact",
            predicted=float(exact_m(np.array(end_s), BIAS_RAD_S)),
            measured=float(np.mean(across_m[:, -1])),
            tolerance=mean_tolerance(spread_m(end_s), runs)
            + sagging_m
            + bench.m_per_tick * BIAS_RAD_S * end_s,
            unit="m",
            derivation="standard error of the mean; half the heading's variance times the error; "
            "one tick of distance at the final heading",
            interval=mean_interval(across_m[:, -1]),
            false_alarm=FALSE_ALARM,
        ),
    )
    large = bench.drive(
        bench.constant(SPEED_M_S, 0.0, DURATION_S),
        Mechanisms(
            gyro_bias_rad_s=LARGE_BIAS_RAD_S, gyro_noise_rad_per_sqrt_s=NOISE_RAD_PER_SQRT_S
        ),
    )
    large_m = bench.odometry(large, "gyro", "midpoint")[0, :, 1]
    parabola_m = 0.5 * SPEED_M_S * LARGE_BIAS_RAD_S * time_s**2
    return Evidence(
        checks,
        (
            Panel(
                "b_g = 0.005 rad/s",
                "time [s]",
                "cross-track error [m]",
                (
                    law(
                        "½·v·b_g·t²",
                        thinned(time_s),
                        thinned(0.5 * SPEED_M_S * BIAS_RAD_S * time_s**2),
                    ),
                    dots(
                        f"mean of {runs} runs",
                        thinned(time_s, 14),
                        thinned(np.mean(across_m, axis=0), 14),
                    ),
                ),
            ),
            Panel(
                "b_g = 0.05 rad/s: the parabola becomes a circle",
                "time [s]",
                "cross-track error [m]",
                (
                    law("½·v·b_g·t²", thinned(time_s), thinned(parabola_m)),
                    law(
                        "v/b_g·(1 − cos b_g·t)",
                        thinned(time_s),
                        thinned(exact_m(time_s, LARGE_BIAS_RAD_S)),
                        2,
                    ),
                    line("firmware", thinned(time_s), thinned(large_m)),
                ),
                broken=(math.sqrt(0.12) / LARGE_BIAS_RAD_S, DURATION_S),
                y_limits=(-2.0, 36.0),
            ),
        ),
        "The robot drives straight and believes it turns. The parabola is 1 % off when b_g·t "
        "reaches 0.35 rad (shaded from there on); the exact curve goes round a circle of radius "
        "v/b_g.",
        (
            split_error(across_m[:, short], f"cross-track error after {SHORT_S:g} s", "m"),
            split_error(across_m[:, -1], f"cross-track error after {end_s:g} s", "m"),
        ),
    )


def _end_heading(bench: Bench, bias_rad_s: float, noise: float, runs: int = 1) -> float:
    """Return the mean heading error at the end of a straight, with this bias and noise density."""
    journey = bench.drive(
        bench.constant(SPEED_M_S, 0.0, DURATION_S),
        Mechanisms(gyro_bias_rad_s=bias_rad_s, gyro_noise_rad_per_sqrt_s=noise),
        runs=runs,
    )
    return float(np.mean(bench.odometry(journey, "gyro")[:, -1, 2]))


def _noise_rad2_per_s(bench: Bench) -> float:
    """Return the heading variance gathered per second: the gyro's noise and the ADC's rounding."""
    return NOISE_RAD_PER_SQRT_S**2 + bench.gyro_rad_s_per_lsb**2 / 12 * bench.tick_s


LAWS = (
    Law(
        name="gyro_bias_heading",
        title="A gyro bias drifts in heading with time, its noise walks",
        formula="θ̂ − θ = b_g·t + ∫n_g: mean b_g·t, variance N²·t",
        validity="bias constant; ADC dithered by noise above about half a code, else rounded to "
        "codes",
        source="Woodman 2007",
        measure=_heading,
    ),
    Law(
        name="gyro_bias_cross_track",
        title="A gyro bias bends a straight into a parabola",
        formula="e_y = ½·v·b_g·t², exactly v/b_g·(1 − cos b_g·t)",
        validity="to 1 % while b_g·t < 0.35 rad; bounded by 2v/b_g ever after",
        source="Woodman 2007; Borenstein, Everett & Feng 1996",
        measure=_cross_track,
    ),
)
