"""What the sensors of many robots say while they drive a course."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil_harness.assembly import Wire
from hil_harness.effects import apply_effects
from hil_harness.scenarios import Scenario
from precision_study.errors import StudyError
from precision_study.study.requirement import Course
from sim_plant import PlantDescription, simulate

MAX_ROWS_TIMES_TICKS: Final = 4_000_000
"""So many ticks of drives are held at once: 200 MB with the truth."""
_SLACK: Final = 1.05
_MAX_TICKS: Final = 50_000_000


@dataclass(frozen=True)
class Drives:
    """A block of drives of one scenario, one per seed, each repeated until the course is done.

    Attributes:
        scenario: its name.
        seeds: of each row.
        left, right, gyro: int64[rows, ticks], counters and codes.
        truth: float64[rows or 1, ticks, 3], x_m, y_m, heading_rad.
        ticks: int64[rows], ticks until the course is done; what comes later does not count.
    """

    scenario: str
    seeds: tuple[int, ...]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    gyro: NDArray[np.int64]
    truth: NDArray[np.float64]
    ticks: NDArray[np.int64]


def lap_commands(scenario: Scenario, wire: Wire, tick_period_us: int) -> NDArray[np.float64]:
    """Return the commands of one lap at a tick period: float64[ticks, 2], v_m_s and w_rad_s.

    Commands are held as long as the DBC's command frame holds them, a tick at least.
    """
    signal = wire.signal_map.get("v_command")
    hold_us = signal.message.cycle_time_us if signal is not None else None
    hold = max((hold_us or tick_period_us) // tick_period_us, 1)
    return scenario.commands(scenario.tick_count(tick_period_us), tick_period_us, hold_ticks=hold)


def course_ticks(
    scenario: Scenario, lap: NDArray[np.float64], course: Course, tick_period_us: int
) -> int:
    """Return how many ticks surely do the course.

    Raises:
        StudyError: a scenario that gets nowhere, or a course of more ticks than make sense.
    """
    if course.duration_s is not None:
        ticks = round(course.duration_s * 1e6) // tick_period_us + 1
    else:
        lap_m = float(np.abs(lap[:, 0]).sum()) * tick_period_us / 1e6
        if lap_m < 1e-3:
            raise StudyError(
                f"--scenario {scenario.name}: drives {lap_m:.3g} m in a lap and never reaches "
                f"{course.words}: expected a scenario that drives, or a course in seconds"
            )
        assert course.distance_m is not None  # a course is one or the other
        # The last stretch may lie at the end of a lap.
        ticks = math.ceil((_SLACK * course.distance_m / lap_m + 1.0) * len(lap))
    if not 1 <= ticks <= _MAX_TICKS:
        raise StudyError(
            f"{course.words} of {scenario.name} take {ticks} ticks of {tick_period_us} µs: "
            f"expected 1 to {_MAX_TICKS}"
        )
    return ticks


def drive(
    scenario: Scenario,
    plant: PlantDescription,
    wire: Wire,
    tick_period_us: int,
    course: Course,
    seeds: tuple[int, ...],
) -> Drives:
    """Drive the course once per seed.

    Raises:
        StudyError: as `course_ticks`, or a robot that does not get as far as it is told to.
    """
    lap = lap_commands(scenario, wire, tick_period_us)
    ticks = course_ticks(scenario, lap, course, tick_period_us)
    commands = np.tile(lap, (-(-ticks // len(lap)), 1))[:ticks]
    runs = simulate(
        plant,
        apply_effects(scenario.effects).plant_over_time,
        commands,
        seeds,
        tick_period_us=tick_period_us,
        encoder_model=scenario.encoder_model,
        noise=scenario.noise,
        drive=scenario.drive,
        outputs="odometry",
    )
    if course.distance_m is None:
        last = np.full(len(seeds), ticks)
    else:
        last = _reached(runs.truth, course.distance_m)
        if last.max() > ticks:
            raise StudyError(
                f"--scenario {scenario.name}: the robot does not reach {course.words} in "
                f"{ticks} ticks: expected one that is as fast as it is told to be"
            )
        last = np.broadcast_to(last, len(seeds)).copy()
    keep = int(last.max())
    return Drives(
        scenario=scenario.name,
        seeds=seeds,
        left=runs.left_count[:, :keep],
        right=runs.right_count[:, :keep],
        gyro=runs.gyro_code[:, :keep],
        truth=runs.truth[:, :keep],
        ticks=last,
    )


def seed_blocks(seeds: tuple[int, ...], ticks: int) -> list[tuple[int, ...]]:
    """Return the seeds in blocks whose drives fit in memory together."""
    size = min(max(MAX_ROWS_TIMES_TICKS // ticks, 1), 64)
    return [seeds[start : start + size] for start in range(0, len(seeds), size)]


def _reached(truth: NDArray[np.float64], distance_m: float) -> NDArray[np.int64]:
    """Return after how many ticks each robot has driven so far; one more than all if it has not."""
    steps = np.diff(truth[:, :, :2], axis=1)
    driven = np.cumsum(np.hypot(steps[:, :, 0], steps[:, :, 1]), axis=1)
    reached = driven >= distance_m
    first = np.where(reached.any(axis=1), reached.argmax(axis=1) + 2, truth.shape[1] + 1)
    return np.asarray(first, dtype=np.int64)
