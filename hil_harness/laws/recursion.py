"""How step errors become pose errors: k and k², and the first-order recursion on SE(2).

Kelly, IJRR 23(2) (2004); Martinelli, T-RA 18(3) (2002); Barfoot, "State Estimation for Robotics"
(2017).
"""

from __future__ import annotations

import math

import numpy as np

from hil_harness.laws.bench import Bench
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, dots, law, line, thinned
from hil_harness.se2 import (
    propagate_error,
    second_order_bound_m,
)
from sim_plant import Mechanisms

SPEED_M_S = 0.6
DURATION_S = 60.0

MISMATCH = 0.004
LARGE_MISMATCH = 0.05
LONG_S = 240.0

# The lesson's robot: real over described, minus one.
RADIUS_SCALE = 1 / 1.005 - 1
RADIUS_MISMATCH = -0.004
WHEELBASE_SCALE = 1 / 0.995 - 1
SMALL_SHARE = 0.1


def _heading_increment(bench: Bench) -> Evidence:
    def errors(mismatch: float, duration_s: float) -> tuple[float, np.ndarray, np.ndarray]:
        """Return β, the heading error and the position error over the steps of a straight."""
        journey = bench.drive(
            bench.constant(SPEED_M_S, 0.0, duration_s), Mechanisms(radius_mismatch=mismatch)
        )
        difference = bench.odometry(journey, "wheel")[0] - journey.truth[0]
        # The straight turns the wheels by Δs/r(1 ± m/2); the firmware takes the radii for equal.
        step_m = SPEED_M_S * bench.tick_s
        beta_rad = step_m * (1 / (1 + mismatch / 2) - 1 / (1 - mismatch / 2)) / bench.wheelbase_m
        return beta_rad, difference[:, 2], np.hypot(difference[:, 0], difference[:, 1])

    beta_rad, heading_rad, position_m = errors(MISMATCH, DURATION_S)
    k = len(heading_rad) - 1
    half = k // 2
    step_m = SPEED_M_S * bench.tick_s
    tick_rad = bench.m_per_tick / bench.wheelbase_m

    def parabola_m(steps: int) -> float:
        return abs(step_m * beta_rad) * steps**2 / 2

    def doubt(steps: int) -> float:
        """Relative remainder of the parabola, and one tick of heading over the whole path."""
        turned = abs(beta_rad) * steps
        return turned**2 * (1 / 12 + 1 / 18) + 2 * (tick_rad / turned + 1 / steps)

    checks = (
        Check(
            law="heading_increment",
            predicted=k * beta_rad,
            measured=float(heading_rad[-1]),
            tolerance=tick_rad,
            unit="rad",
            derivation="the difference of two counts that floor is within one tick",
        ),
        Check(
            law="heading_increment_position",
            predicted=parabola_m(half),
            measured=float(position_m[half]),
            tolerance=parabola_m(half) * doubt(half),
            unit="m",
            derivation="relative remainder (kβ)²·(1/12 + 1/18) of the small angle, one tick of "
            "heading over the path, one step",
        ),
        Check(
            law="heading_increment_growth",
            predicted=2.0,
            measured=math.log2(float(position_m[half] / position_m[half // 2])),
            tolerance=(doubt(half) + doubt(half // 2)) / math.log(2),
            unit="1",
            derivation="exponent of k from one doubling, with both ends' relative doubt",
        ),
    )
    large_rad, _, large_m = errors(LARGE_MISMATCH, LONG_S)
    steps = np.unique(np.geomspace(30, len(large_m) - 1, 160).astype(int))
    early = steps[steps * abs(large_rad) < 3]
    return Evidence(
        checks,
        (
            Panel(
                "Heading kβ",
                "steps k",
                "heading error [rad]",
                (
                    law("kβ", np.array([0, k]), beta_rad * np.array([0, k])),
                    dots("firmware", thinned(np.arange(k + 1), 14), thinned(heading_rad, 14)),
                ),
            ),
            Panel(
                "Position k², until the turn is done",
                "steps k",
                "position error [m]",
                (
                    law("½·Δs·β·k²", early, abs(step_m * large_rad) * early.astype(float) ** 2 / 2),
                    line("firmware, 5 % mismatch", steps, large_m[steps]),
                    law("distance driven", steps, step_m * steps, 2),
                ),
                log_x=True,
                log_y=True,
                broken=(1 / abs(large_rad), float(steps[-1])),
            ),
        ),
        "A constant error β in every heading step. Second: the position error grows with k² while "
        "kβ is below about a radian; then the believed path closes its circle and the error grows "
        "like the distance driven.",
    )


def _recursion(bench: Bench) -> Evidence:
    commands = bench.lesson_commands(DURATION_S)
    step_m = commands[:-1, 0] * bench.tick_s
    turn_rad = commands[:-1, 1] * bench.tick_s

    def run(share: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return true error, first-order error and the bound on their distance."""
        journey = bench.drive(
            commands,
            Mechanisms(
                radius_scale=share * RADIUS_SCALE,
                radius_mismatch=share * RADIUS_MISMATCH,
                wheelbase_scale=share * WHEELBASE_SCALE,
            ),
        )
        true_error = bench.odometry(journey, "wheel")[0] - journey.truth[0]
        right_m = bench.wheel_radius_m * np.diff(bench.wheel_angle_rad(journey.right_count)[0])
        left_m = bench.wheel_radius_m * np.diff(bench.wheel_angle_rad(journey.left_count)[0])
        step_error_m = (right_m + left_m) / 2 - step_m
        turn_error_rad = (right_m - left_m) / bench.wheelbase_m - turn_rad
        return (
            true_error,
            propagate_error(step_m, turn_rad, step_error_m, turn_error_rad),
            second_order_bound_m(step_m, step_error_m, turn_error_rad),
        )

    true_error, first_order, bound_m = run(SMALL_SHARE)
    path_m = float(np.sum(step_m))
    gap_m = np.hypot(*(true_error - first_order)[:, :2].T)
    checks = (
        Check(
            law="se2_recursion_position",
            predicted=float(np.hypot(*first_order[-1, :2])),
            measured=float(np.hypot(*true_error[-1, :2])),
            tolerance=float(bound_m[-1]) + bench.arithmetic_m(path_m),
            unit="m",
            derivation="Taylor remainder Σ(Δs·e²/2 + |δs·e|) at the end, and the firmware's "
            "rounding",
        ),
        Check(
            law="se2_recursion_everywhere",
            predicted=0.0,
            measured=float(np.max(gap_m / (bound_m + bench.arithmetic_m(path_m)))),
            tolerance=1.0,
            unit="1",
            derivation="largest distance between true and first-order position over all ticks, in "
            "units of its bound: Taylor remainder and the firmware's rounding",
        ),
        Check(
            law="se2_recursion_heading",
            predicted=float(first_order[-1, 2]),
            measured=float(true_error[-1, 2]),
            tolerance=bench.arithmetic_rad,
            unit="rad",
            derivation="the heading recursion is linear, hence exact: the firmware's rounding",
        ),
    )
    full_error, full_first_order, _ = run(1.0)
    time_s = bench.tick_s * np.arange(len(full_error))
    shares = np.geomspace(0.01, 3.0, 16)
    swept = [run(float(share)) for share in shares]
    ends_m = np.array([math.hypot(*true[-1, :2]) for true, _, _ in swept])
    gaps_m = np.array([math.hypot(*(true - first)[-1, :2]) for true, first, _ in swept])
    bounds_m = np.array([bound[-1] for _, _, bound in swept])
    return Evidence(
        checks,
        (
            Panel(
                "The lesson's errors, full size",
                "time [s]",
                "position error [m]",
                (
                    law("x, first order", thinned(time_s), thinned(full_first_order[:, 0])),
                    line("x, firmware", thinned(time_s), thinned(full_error[:, 0])),
                    law("y, first order", thinned(time_s), thinned(full_first_order[:, 1])),
                    line("y, firmware", thinned(time_s), thinned(full_error[:, 1]), 2),
                ),
            ),
            Panel(
                "What first order misses",
                "share of the lesson's errors",
                "at the end of the run [m]",
                (
                    law("bound of the remainder", shares, bounds_m),
                    line("error itself", shares, ends_m, 2),
                    dots("distance to first order", shares, gaps_m),
                ),
                log_x=True,
                log_y=True,
                broken=(1.0, float(shares[-1])),
            ),
        ),
        "First: the lesson's robot; first order follows until the heading is off by some 0.3 rad. "
        "Second: the remainder falls with the square of the errors, the error itself in "
        "proportion; at the lesson's full size and above (shaded) the remainder is a tenth of the "
        "error and more.",
    )


LAWS = (
    Law(
        name="heading_increment",
        title="A constant error in each heading step grows with k, the position with k²",
        formula="θ̂ − θ = kβ; position ½·Δs·β·k² in sustained motion",
        validity="k² while kβ is well below a radian; then at most in proportion to distance",
        source="Kelly 2004; Martinelli 2002",
        measure=_heading_increment,
    ),
    Law(
        name="se2_recursion",
        title="Step errors propagate by a first-order recursion on SE(2)",
        formula="δx' ≈ δx − Δs sin θ_m (δθ_pose + δθ/2) + cos θ_m δs, and so on for y and θ",
        validity="remainder at most Σ(Δs·e²/2 + |δs·e|) with heading error e: 1 % at 0.02 rad; the "
        "heading is exact",
        source="Kelly 2004; Barfoot 2017",
        measure=_recursion,
    ),
)
