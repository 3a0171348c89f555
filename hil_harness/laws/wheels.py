"""Systematic errors of the wheels' geometry: radius, radius mismatch, wheelbase.

Borenstein, Everett and Feng, "Where am I?" (1996), chapter 5, name these three as the dominant
systematic errors of a differential drive; Martinelli, T-RA 18(3) (2002), treats their growth.
"""

from __future__ import annotations

import numpy as np

from hil_harness.laws.bench import Bench
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, Series, dots, law, line, thinned
from sim_plant import Mechanisms

SPEED_M_S = 0.6
DURATION_S = 60.0
RADIUS_ERROR = 0.005
MISMATCH = 0.004
WHEELBASE_ERROR = -0.005
SPIN_RAD_S = 1.0


def _distance_drift(bench: Bench) -> Evidence:
    commands = bench.constant(SPEED_M_S, 0.0, DURATION_S)
    series: list[Series] = []
    errors = (RADIUS_ERROR, -RADIUS_ERROR, 0.02, -0.02)
    measured: dict[float, tuple[np.ndarray, np.ndarray]] = {}
    for colour, error in enumerate(errors, start=1):
        journey = bench.drive(commands, Mechanisms(radius_scale=1 / (1 + error) - 1))
        travelled_m = journey.truth[0, :, 0]
        excess_m = bench.odometry(journey, "wheel")[0, :, 0] - travelled_m
        measured[error] = travelled_m, excess_m
        series += [
            law("", travelled_m[[0, -1]], error * travelled_m[[0, -1]]),
            dots(
                f"ε_r = {100 * error:+.1f} %".replace("-", "−"),
                *_every(travelled_m, excess_m, 12),
                colour,
            ),
        ]
    travelled_m, excess_m = measured[RADIUS_ERROR]
    checks = (
        Check(
            law="distance_drift",
            predicted=RADIUS_ERROR * float(travelled_m[-1]),
            measured=float(excess_m[-1]),
            tolerance=bench.m_per_tick,
            unit="m",
            derivation="a counter that floors reads at most one tick short",
        ),
        Check(
            law="distance_drift_per_metre",
            predicted=RADIUS_ERROR,
            measured=float(np.polyfit(travelled_m, excess_m, 1)[0]),
            tolerance=1.5 * bench.m_per_tick / float(travelled_m[-1]),
            unit="1",
            derivation="least-squares slope through errors confined to one tick: at most "
            "1.5·tick/S",
        ),
    )
    # On a circle of 1 m, at a rate that the gyro's codes can show without rounding.
    rate_rad_s = bench.gyro_rad_s_per_lsb * round(SPEED_M_S / bench.gyro_rad_s_per_lsb)
    circling = bench.drive(
        bench.constant(rate_rad_s, rate_rad_s, DURATION_S),
        Mechanisms(radius_scale=1 / (1 + RADIUS_ERROR) - 1),
    )
    difference = bench.odometry(circling, "gyro")[0] - circling.truth[0]
    path_m = rate_rad_s * bench.tick_s * np.arange(len(difference))
    return Evidence(
        checks,
        (
            Panel(
                "Straight: the drift is ε_r·S",
                "true distance S [m]",
                "Ŝ − S [m]",
                tuple(series),
            ),
            Panel(
                "Circle of 1 m, heading by gyro",
                "true path S [m]",
                "position error [m]",
                (
                    law("ε_r·S", path_m[[0, -1]], RADIUS_ERROR * path_m[[0, -1]]),
                    line(
                        "firmware",
                        thinned(path_m),
                        thinned(np.hypot(difference[:, 0], difference[:, 1])),
                    ),
                ),
                broken=(1.0, float(path_m[-1])),
            ),
        ),
        "First: distance by the firmware minus true distance for four radius errors, with ε_r·S "
        "dashed. Second: the law speaks of distance along the path. On a circle with a right "
        "heading the position error is ε_r times the chord: it leaves ε_r·S after about a radian "
        "and is gone after each turn.",
    )


def _curvature(bench: Bench) -> Evidence:
    commands = bench.constant(SPEED_M_S, 0.0, DURATION_S)

    def arc(mismatch: float, common: float = 0.0) -> tuple[np.ndarray, float]:
        """Return the true path and the wheels' angle when both wheels turn alike."""
        journey = bench.drive(
            commands,
            Mechanisms(radius_scale=common, radius_mismatch=mismatch),
            motion="motor",
        )
        return journey.truth[0], float(bench.wheel_angle_rad(journey.left_count)[0, -1])

    truth, angle_rad = arc(MISMATCH)
    straight, _ = arc(0.0, common=0.01)
    unequal = [arc(sign * 10.0**power)[0] for power in range(-12, -1) for sign in (-1, 1)]
    turn_per_rad = bench.wheel_radius_m * MISMATCH / bench.wheelbase_m
    checks = (
        Check(
            law="curvature",
            predicted=turn_per_rad * angle_rad,
            measured=float(truth[-1, 2]),
            tolerance=turn_per_rad * bench.rad_per_tick + 1e-12,
            unit="rad",
            derivation="the wheel angle Δφ is known to one tick; 1e-12 rad for float64 sums",
        ),
        Check(
            law="curvature_straight_if_equal",
            predicted=0.0,
            measured=float(np.max(np.abs(straight[:, 1:]))),
            tolerance=0.0,
            unit="m, rad",
            derivation="exact: both radii 1 % large, largest |y| and |θ| of the run",
        ),
        Check(
            law="curvature_straight_only_if_equal",
            predicted=1.0,
            measured=float(np.mean([path[-1, 2] != 0 for path in unequal])),
            tolerance=0.0,
            unit="1",
            derivation="exact: share of mismatches from ±1e-12 to ±1e-2 that leave the straight",
        ),
    )
    paths: list[Series] = []
    for colour, mismatch in enumerate((0.004, 0.02, 0.05), start=1):
        path, _ = arc(mismatch)
        along_m = SPEED_M_S * bench.tick_s * np.arange(len(path))
        parabola_m = along_m**2 * mismatch / (2 * bench.wheelbase_m)
        shown = parabola_m < 16
        paths += [
            law("", thinned(along_m[shown]), thinned(parabola_m[shown])),
            line(
                f"ε_R − ε_L = {100 * mismatch:g} %",
                thinned(path[:, 0]),
                thinned(path[:, 1]),
                colour,
            ),
        ]
    sweep = np.array([10.0**power for power in range(-12, -1)])
    turned_rad = np.array([abs(path[-1, 2]) for path in unequal[1::2]])
    return Evidence(
        checks,
        (
            Panel(
                "Equal wheel steps: an arc",
                "x [m]",
                "y [m]",
                tuple(paths),
                is_map=True,
            ),
            Panel(
                "Exactly straight only at equality",
                "ε_R − ε_L",
                "heading after 36 m [rad]",
                (
                    law(
                        "r(ε_R − ε_L)Δφ/b",
                        sweep,
                        bench.wheel_radius_m * sweep * angle_rad / bench.wheelbase_m,
                    ),
                    dots("plant", sweep, turned_rad),
                ),
                log_x=True,
                log_y=True,
            ),
        ),
        "First: true paths when both wheels turn alike, with the parabola ½κS² dashed: the arc is "
        "exact, the parabola breaks where the turn is no longer small. Second: twelve decades of "
        "mismatch; no mismatch is small enough for a straight line.",
    )


def _heading_drift(bench: Bench) -> Evidence:
    commands = bench.constant(0.0, SPIN_RAD_S, DURATION_S)

    def per_radian(error: float) -> tuple[float, float]:
        """Return the heading error per radian turned, and the radians turned."""
        journey = bench.drive(commands, Mechanisms(wheelbase_scale=1 / (1 + error) - 1))
        turned_rad = float(journey.truth[0, -1, 2])
        return float(bench.odometry(journey, "wheel")[0, -1, 2]) / turned_rad - 1, turned_rad

    measured, turned_rad = per_radian(WHEELBASE_ERROR)
    tick_rad = bench.m_per_tick / bench.wheelbase_m
    remainder = WHEELBASE_ERROR**2 / (1 + WHEELBASE_ERROR)
    checks = (
        Check(
            law="heading_drift_exact",
            predicted=1 / (1 + WHEELBASE_ERROR) - 1,
            measured=measured,
            tolerance=tick_rad / turned_rad,
            unit="rad/rad",
            derivation="each counter floors: the difference of two counts is within one tick",
        ),
        Check(
            law="heading_drift",
            predicted=-WHEELBASE_ERROR,
            measured=measured,
            tolerance=tick_rad / turned_rad + remainder,
            unit="rad/rad",
            derivation="one tick, and the second-order remainder ε_b²/(1 + ε_b)",
        ),
    )
    errors = np.linspace(-0.4, 0.6, 21)
    curve = np.linspace(-0.4, 0.6, 201)
    spins = np.array([per_radian(float(error))[0] for error in errors])
    small = np.logspace(-4, -0.3, 16)
    gaps = np.array([abs(per_radian(float(error))[0] + error) for error in small])
    return Evidence(
        checks,
        (
            Panel(
                "Error per radian turned",
                "ε_b = b̂/b − 1",
                "heading error [rad/rad]",
                (
                    law("first order −ε_b", curve, -curve),
                    line("exact 1/(1 + ε_b) − 1", curve, 1 / (1 + curve) - 1, 2),
                    dots("firmware", errors, spins),
                ),
            ),
            Panel(
                "What the first order misses",
                "|ε_b|",
                "|measured + ε_b| [rad/rad]",
                (
                    law("ε_b²/(1 + ε_b)", small, small**2 / (1 + small)),
                    line("one tick", small, np.full_like(small, tick_rad / turned_rad), 2),
                    dots("firmware", small, gaps),
                ),
                log_x=True,
                log_y=True,
                broken=(0.1, float(small[-1])),
            ),
        ),
        "First: a spin of 60 rad with wrong wheelbases. Second: the gap between measurement and "
        "the first-order law is its remainder ε_b²; above 10 % the law is wrong by more than a "
        "tenth of itself (shaded), below 0.3 % one encoder tick hides the difference.",
    )


def _every(x: np.ndarray, y: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    return thinned(x, points), thinned(y, points)


LAWS = (
    Law(
        name="distance_drift",
        title="A wrong wheel radius drifts in proportion to distance",
        formula="Ŝ − S = ε_r·S",
        validity="exact for distance along the path, any ε_r; drowned by one tick below "
        "S = rΔ/ε_r; not a law of position once the robot turns",
        source="Borenstein, Everett & Feng 1996",
        measure=_distance_drift,
    ),
    Law(
        name="curvature",
        title="Unequal wheels that turn alike drive an arc",
        formula="Δθ = r(ε_R − ε_L)Δφ/b",
        validity="exact for constant radii; straight if and only if ε_R = ε_L; the parabola ½κS² "
        "holds to 1 % while κS < 0.35 rad",
        source="Borenstein, Everett & Feng 1996",
        measure=_curvature,
    ),
    Law(
        name="heading_drift",
        title="A wrong wheelbase drifts in proportion to rotation",
        formula="Δθ̂ = Δθ/(1 + ε_b) ≈ Δθ(1 − ε_b)",
        validity="first order to 1 % of itself while |ε_b| < 1 %; exact form for any ε_b > −1; "
        "zero without rotation",
        source="Borenstein, Everett & Feng 1996; Martinelli 2002",
        measure=_heading_drift,
    ),
)
