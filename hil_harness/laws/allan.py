"""The gyro's noise terms, read back from the Allan deviation of its codes at rest.

Woodman, "An introduction to inertial navigation", UCAM-CL-TR-696 (2007), section 3.2 and appendix
B: white noise of density N (angle random walk) gives N²/τ, a bias that walks with density K (rate
random walk) gives K²·τ/3. The plant models these two and no flicker, so its bias instability is the
minimum between them. Degrees of freedom of the overlapping estimate: Riley, "Handbook of Frequency
Stability Analysis", NIST SP 1065 (2008), section 5.4.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hil_harness.laws.bench import FIRST_SEED, Bench
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, dots, law, line
from hil_harness.laws.statistics import (
    FALSE_ALARM,
    Interval,
    mean_interval,
    split_error,
    variance_tolerance,
)
from sim_plant import Mechanisms

FloatArray = NDArray[np.float64]

DURATION_S = 3600.0
NOISE_RAD_PER_SQRT_S = 2e-4
WALK_RAD_S_PER_SQRT_S = 2e-5
WHITE_TAU_S = 1.0
WALK_TAU_S = 200.0
BATCH_RUNS = 8


def overlapping_allan_variance(rate_rad_s: FloatArray, tick_s: float, m: int) -> FloatArray:
    """Return the overlapping Allan variance of rates (runs, ticks) at τ = m ticks, (runs,)."""
    angle = np.pad(np.cumsum(rate_rad_s, axis=1), ((0, 0), (1, 0))) * tick_s
    second = angle[:, 2 * m :] - 2 * angle[:, m:-m] + angle[:, : -2 * m]
    return np.asarray(np.mean(second**2, axis=1) / (2 * (m * tick_s) ** 2))


def white_freedom(samples: int, m: int) -> float:
    """Degrees of freedom of that estimate for white rate noise (NIST SP 1065, table 5)."""
    points = samples + 1
    clusters = 3 * (points - 1) / (2 * m) - 2 * (points - 2) / points
    return clusters * 4 * m**2 / (4 * m**2 + 5)


def walk_freedom(samples: int, m: int) -> float:
    """Degrees of freedom of that estimate for a rate random walk (NIST SP 1065, table 5)."""
    points = samples + 1
    overlap = (points - 1) ** 2 - 3 * m * (points - 1) + 4 * m**2
    return (points - 2) / m * overlap / (points - 3) ** 2


def _read_back(bench: Bench) -> Evidence:
    batches = {"small": 4, "full": 30}[bench.size]
    runs = batches * BATCH_RUNS
    samples = bench.ticks(DURATION_S) - 1
    minimum_tau_s = math.sqrt(3) * NOISE_RAD_PER_SQRT_S / WALK_RAD_S_PER_SQRT_S
    white_m, minimum_m, walk_m = (
        round(tau_s / bench.tick_s) for tau_s in (WHITE_TAU_S, minimum_tau_s, WALK_TAU_S)
    )
    commands = bench.constant(0.0, 0.0, DURATION_S)
    noisy = Mechanisms(
        gyro_noise_rad_per_sqrt_s=NOISE_RAD_PER_SQRT_S,
        gyro_bias_walk_rad_s_per_sqrt_s=WALK_RAD_S_PER_SQRT_S,
    )

    def rates_rad_s(batch: int) -> FloatArray:
        first_seed = FIRST_SEED + batch * BATCH_RUNS
        journey = bench.drive(commands, noisy, runs=BATCH_RUNS, first_seed=first_seed)
        return bench.gyro_rad_s(journey)[:, 1:]

    def variances(rates: FloatArray, m: int) -> FloatArray:
        return overlapping_allan_variance(rates, bench.tick_s, m)

    # All batches are read at the three τ that are checked, the first one everywhere: a picture.
    sizes = np.unique(np.geomspace(1, samples // 3, 22).astype(int))
    first = rates_rad_s(0)
    curve = np.array([variances(first, int(m)) for m in sizes])
    checked = [[variances(first, m) for m in (white_m, minimum_m, walk_m)]]
    for batch in range(1, batches):
        rates = rates_rad_s(batch)
        checked.append([variances(rates, m) for m in (white_m, minimum_m, walk_m)])
    at_white, at_minimum, at_walk = np.concatenate(checked, axis=1)

    rounding = bench.gyro_rad_s_per_lsb**2 / 12 * bench.tick_s
    white_share = NOISE_RAD_PER_SQRT_S**2 + rounding
    walk_share = WALK_RAD_S_PER_SQRT_S**2 / 3
    # Per run: the variance at one τ, less what the other terms give there.
    white = at_white * WHITE_TAU_S - walk_share * WHITE_TAU_S**2 - rounding
    walk = 3 * (at_walk / WALK_TAU_S - white_share / WALK_TAU_S**2)
    least_tau_s = minimum_m * bench.tick_s
    checks = (
        _coefficient(
            "allan_angle_random_walk",
            NOISE_RAD_PER_SQRT_S,
            white,
            runs * white_freedom(samples, white_m),
            "rad/√s",
        ),
        _coefficient(
            "allan_rate_random_walk",
            WALK_RAD_S_PER_SQRT_S,
            walk,
            runs * walk_freedom(samples, walk_m),
            "rad/s/√s",
        ),
        _coefficient(
            "allan_bias_instability",
            math.sqrt(white_share / least_tau_s + walk_share * least_tau_s),
            at_minimum,
            runs * walk_freedom(samples, minimum_m),
            "rad/s",
        ),
    )
    tau_s = sizes * bench.tick_s
    pooled = np.sqrt(np.mean(curve, axis=1))
    single = np.sqrt(curve[:, 0])
    model = np.sqrt(white_share / tau_s + walk_share * tau_s)
    warming = bench.drive(
        commands,
        Mechanisms(
            gyro_noise_rad_per_sqrt_s=NOISE_RAD_PER_SQRT_S,
            gyro_bias_walk_rad_s_per_sqrt_s=WALK_RAD_S_PER_SQRT_S,
            gyro_temperature_bias_rad_s_per_k=5e-4,
            temperature_rise_k=20.0,
            temperature_time_constant_s=1200.0,
        ),
    )
    warm_rates = bench.gyro_rad_s(warming)[:, 1:]
    warm = np.array([math.sqrt(variances(warm_rates, int(m))[0]) for m in sizes])
    return Evidence(
        checks,
        (
            Panel(
                "Allan deviation of the gyro at rest",
                "τ [s]",
                "σ(τ) [rad/s]",
                (
                    law("N/√τ", tau_s, np.sqrt(white_share / tau_s)),
                    law("K·√(τ/3)", tau_s, np.sqrt(walk_share * tau_s), 2),
                    line("both", tau_s, model, 3),
                    dots(f"plant, {BATCH_RUNS} hours", tau_s, pooled),
                ),
                log_x=True,
                log_y=True,
                y_limits=(2e-5, 4e-3),
            ),
            Panel(
                "One hour, and an hour of warming up",
                "τ [s]",
                "σ(τ) [rad/s]",
                (
                    law("N and K", tau_s, model),
                    dots("one run", tau_s, single),
                    line("warming by 20 K", tau_s, warm, 2),
                ),
                log_x=True,
                log_y=True,
                broken=(float(DURATION_S / 10), float(tau_s[-1])),
                y_limits=(2e-5, 4e-3),
            ),
        ),
        "First: white noise falls with slope −½, the walking bias rises with +½, and both "
        "coefficients are read where one of them rules. Second: from a tenth of the record on "
        "(shaded) a single run has too few clusters to tell; and a gyro that warms up leaves the "
        "model altogether, for its drift is a trend and no noise.",
        (
            split_error(
                np.sqrt(white) - NOISE_RAD_PER_SQRT_S, "error of N from one hour", "rad/√s"
            ),
            split_error(
                np.sqrt(np.maximum(walk, 0)) - WALK_RAD_S_PER_SQRT_S,
                "error of K from one hour",
                "rad/s/√s",
            ),
        ),
    )


def _coefficient(
    name: str, predicted: float, squares: FloatArray, freedom: float, unit: str
) -> Check:
    """Check the root of the mean of *squares*, one per run, against *predicted*."""
    # The square strays symmetrically by a relative amount; its root strays farthest downwards.
    relative = variance_tolerance(1.0, freedom)
    interval = mean_interval(squares)
    return Check(
        law=name,
        predicted=predicted,
        measured=math.sqrt(max(float(np.mean(squares)), 0.0)),
        tolerance=predicted * (1 - math.sqrt(1 - relative)),
        unit=unit,
        derivation=f"chi-square of the overlapping Allan variance, {freedom:.0f} degrees of "
        "freedom",
        interval=Interval(math.sqrt(max(interval.low, 0.0)), math.sqrt(max(interval.high, 0.0))),
        false_alarm=FALSE_ALARM,
    )


LAWS = (
    Law(
        name="allan",
        title="The gyro's noise terms can be read back from its Allan deviation",
        formula="σ²(τ) = N²/τ + K²·τ/3",
        validity="stationary noise at rest, τ below a tenth of the record; no trend from warming "
        "up",
        source="Woodman 2007",
        measure=_read_back,
    ),
)
