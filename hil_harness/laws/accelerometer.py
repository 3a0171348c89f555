"""The accelerometer integrated twice: b_a·t, ½·b_a·t², and variances that grow with t and t³.

Woodman, "An introduction to inertial navigation", UCAM-CL-TR-696 (2007), section 4.2. The codes are
the plant's; the integration, exact for an acceleration held over each tick, is the law's own, since
the firmware does not navigate by acceleration.
"""

from __future__ import annotations

import math

import numpy as np

from hil_harness.laws.bench import Bench
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, dots, law, line, spreads
from hil_harness.laws.statistics import (
    FALSE_ALARM,
    mean_interval,
    mean_tolerance,
    split_error,
    variance_interval,
    variance_tolerance,
)
from sim_plant import Mechanisms

DURATION_S = 60.0
BIAS_M_S2 = 0.02
NOISE_M_S2_PER_SQRT_HZ = 0.004


def integrate_twice(accel_m_s2: np.ndarray, tick_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity and position at the end of each tick, shapes as *accel_m_s2* (…, ticks)."""
    velocity = tick_s * np.cumsum(accel_m_s2, axis=-1)
    position = np.cumsum(tick_s * velocity - tick_s**2 / 2 * accel_m_s2, axis=-1)
    return velocity, position


def _measure(bench: Bench) -> Evidence:
    runs = bench.runs
    commands = bench.constant(0.0, 0.0, DURATION_S)
    journey = bench.drive(
        commands,
        Mechanisms(
            accel_bias_x_m_s2=BIAS_M_S2, accel_noise_m_s2_per_sqrt_hz=NOISE_M_S2_PER_SQRT_HZ
        ),
        runs=runs,
        outputs="all",
    )
    velocity, position = integrate_twice(bench.accel_x_m_s2(journey)[:, 1:], bench.tick_s)
    k = velocity.shape[1]
    end_s = k * bench.tick_s
    # One sample's variance: the noise in the tick's bandwidth and the rounding of the ADC.
    sample_m2_s4 = NOISE_M_S2_PER_SQRT_HZ**2 / bench.tick_s + bench.accel_m_s2_per_lsb**2 / 12
    velocity_m2_s2 = sample_m2_s4 * bench.tick_s * end_s
    position_m2 = sample_m2_s4 * bench.tick_s**4 * (k**3 / 3 - k / 12)
    checks = (
        Check(
            law="accel_bias_velocity",
            predicted=BIAS_M_S2 * end_s,
            measured=float(np.mean(velocity[:, -1])),
            tolerance=mean_tolerance(math.sqrt(velocity_m2_s2), runs),
            unit="m/s",
            derivation="standard error of the mean, from the predicted spread",
            interval=mean_interval(velocity[:, -1]),
            false_alarm=FALSE_ALARM,
        ),
        Check(
            law="accel_bias_position",
            predicted=0.5 * BIAS_M_S2 * end_s**2,
            measured=float(np.mean(position[:, -1])),
            tolerance=mean_tolerance(math.sqrt(position_m2), runs),
            unit="m",
            derivation="standard error of the mean, from the predicted spread",
            interval=mean_interval(position[:, -1]),
            false_alarm=FALSE_ALARM,
        ),
        *_variance_checks(velocity, position, sample_m2_s4, bench.tick_s),
    )
    at = np.unique(np.geomspace(1, k, 14).astype(int)) - 1
    time_s = bench.tick_s * (at + 1)
    speed = [split_error(velocity[:, step], "", "m/s") for step in at]
    place = [split_error(position[:, step], "", "m") for step in at]
    lsb = bench.accel_m_s2_per_lsb
    biases = np.linspace(0, 3, 49)
    silent = np.array([_end_speed(bench, bias * lsb, 0.0) for bias in biases]) / (lsb * end_s)
    return Evidence(
        checks,
        (
            Panel(
                "Random part: √t in velocity, t^(3/2) in position",
                "time [s]",
                "spread [m/s, m]",
                (
                    law("", time_s, NOISE_M_S2_PER_SQRT_HZ * np.sqrt(time_s)),
                    law("", time_s, NOISE_M_S2_PER_SQRT_HZ * np.sqrt(time_s**3 / 3)),
                    spreads("velocity [m/s]", time_s, speed),
                    spreads("position [m]", time_s, place, 2),
                ),
                log_x=True,
                log_y=True,
                broken=(float(time_s[0]), 5 * bench.tick_s),
            ),
            Panel(
                "Systematic part: biases of a few codes",
                "bias [LSB]",
                "velocity after 60 s over LSB·t",
                (
                    law("b_a·t", biases, biases),
                    line("no noise", biases, silent),
                    dots(
                        f"noise of 66 LSB, {runs // 8} runs",
                        biases[::8],
                        np.array(
                            [
                                _end_speed(bench, bias * lsb, NOISE_M_S2_PER_SQRT_HZ, runs // 8)
                                for bias in biases[::8]
                            ]
                        )
                        / (lsb * end_s),
                        2,
                    ),
                ),
            ),
        ),
        "First: white noise integrated once and twice at rest; in the first few ticks (shaded) t³ "
        "does not hold yet, since the first samples have had no time to be integrated. Second: a "
        "silent sensor's ADC rounds the bias to whole codes and breaks b_a·t; noise dithers it.",
        (
            split_error(velocity[:, -1], f"velocity error after {end_s:g} s", "m/s"),
            split_error(position[:, -1], f"position error after {end_s:g} s", "m"),
        ),
    )


def _variance_checks(
    velocity: np.ndarray, position: np.ndarray, sample_m2_s4: float, tick_s: float
) -> list[Check]:
    """Check both variances at half time and at the end: two points tell t from t³."""
    runs, ticks = velocity.shape
    checks = []
    for when, k in (("_half_time", ticks // 2), ("", ticks)):
        # Σ 1 and Σ (k − j − ½)² over the k samples: k and k³/3 − k/12.
        for name, values, samples, unit, growth in (
            ("velocity", velocity, tick_s**2 * k, "m²/s²", "N²·t"),
            ("position", position, tick_s**4 * (k**3 / 3 - k / 12), "m²", "N²·t³/3"),
        ):
            predicted = sample_m2_s4 * samples
            checks.append(
                Check(
                    law=f"accel_noise_{name}{when}",
                    predicted=predicted,
                    measured=float(np.var(values[:, k - 1], ddof=1)),
                    tolerance=variance_tolerance(predicted, runs - 1),
                    unit=unit,
                    derivation=f"chi-square with {runs - 1} degrees of freedom about {growth}",
                    interval=variance_interval(values[:, k - 1]),
                    false_alarm=FALSE_ALARM,
                )
            )
    return checks


def _end_speed(bench: Bench, bias_m_s2: float, noise: float, runs: int = 1) -> float:
    """Return the mean velocity error at the end of a rest with this bias and noise density."""
    journey = bench.drive(
        bench.constant(0.0, 0.0, DURATION_S),
        Mechanisms(accel_bias_x_m_s2=bias_m_s2, accel_noise_m_s2_per_sqrt_hz=noise),
        runs=runs,
        outputs="all",
    )
    velocity, _ = integrate_twice(bench.accel_x_m_s2(journey)[:, 1:], bench.tick_s)
    return float(np.mean(velocity[:, -1]))


LAWS = (
    Law(
        name="accelerometer",
        title="An accelerometer's bias and noise, integrated twice",
        formula="b_a·t and ½·b_a·t²; variances N²·t and N²·t³/3",
        validity="bias constant, noise white and above about half a code of the ADC; t³ from a few "
        "ticks on; sensor level, for tilt adds g·sin(tilt)",
        source="Woodman 2007",
        measure=_measure,
    ),
)
