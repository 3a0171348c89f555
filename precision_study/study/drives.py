"""What the sensors of many robots say while they drive a course, some ticks at a time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from hil_harness.assembly import Wire
from hil_harness.effects import apply_effects
from hil_harness.scenarios import Scenario
from precision_study.errors import StudyError
from precision_study.study.requirement import Course
from sim_plant import BLOCK_TICKS, Batch, PlantDescription

Floats = NDArray[np.float64]

TOGETHER_SEEDS: Final = 16
TOGETHER_TICKS: Final = 4_000_000
"""So many seeds, or those with so many ticks of drives, are run and written to disk together."""
HELD_TICKS: Final = 1 << 18
"""So many ticks of drives are held at once, 12 MB with the truth, …"""
HELD_TICKS_OF_A_ROW: Final = 1 << 16
"""… and of each drive no more than these."""
_SLACK: Final = 1.05
_MAX_TICKS: Final = 50_000_000


@dataclass(frozen=True)
class Drives:
    """Drives of one scenario, one per seed, each repeated until the course is done; or some ticks.

    Attributes:
        scenario: its name.
        seeds: of each row.
        left, right, gyro: int64[rows, ticks], counters and codes.
        truth: float64[rows or 1, ticks, 3], x_m, y_m, heading_rad.
        ticks: int64[rows], so many until the course is done; what comes later does not count.
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
    """Drive the whole course once per seed.

    Raises:
        StudyError: as `drive_in_blocks`.
    """
    lap = lap_commands(scenario, wire, tick_period_us)
    ticks = course_ticks(scenario, lap, course, tick_period_us)
    rounded = -(-ticks // BLOCK_TICKS) * BLOCK_TICKS
    (whole,) = drive_in_blocks(scenario, plant, wire, tick_period_us, course, seeds, rounded)
    return whole


def drive_in_blocks(
    scenario: Scenario,
    plant: PlantDescription,
    wire: Wire,
    tick_period_us: int,
    course: Course,
    seeds: tuple[int, ...],
    block_ticks: int | None = None,
) -> Iterator[Drives]:
    """Drive the course once per seed; yield some ticks at a time.

    Args:
        scenario, plant, wire, tick_period_us, course, seeds: who drives what, and how far.
        block_ticks: ticks at a time, a multiple of `BLOCK_TICKS`; None: as fit in memory.

    Raises:
        StudyError: as `course_ticks`, or a robot that does not get as far as it is told to.
    """
    lap = lap_commands(scenario, wire, tick_period_us)
    ticks = course_ticks(scenario, lap, course, tick_period_us)
    size = block_ticks or min(HELD_TICKS // len(seeds), HELD_TICKS_OF_A_ROW)
    size = max(size // BLOCK_TICKS, 1) * BLOCK_TICKS
    robots = Batch(
        plant,
        apply_effects(scenario.effects).plant_over_time,
        lap,
        seeds,
        tick_period_us=tick_period_us,
        encoder_model=scenario.encoder_model,
        noise=scenario.noise,
        drive=scenario.drive,
        outputs="odometry",
        workers=1,
    )
    position_m, driven_m = np.zeros((1, 1, 2)), np.zeros((1, 1))
    for start in range(0, ticks, size):
        runs = robots.advance(min(size, ticks - start))
        count = runs.left_count.shape[1]
        counted = np.full(len(seeds), count)
        if course.distance_m is not None:
            before_m, position_m, driven_m = _driven(runs.truth, position_m, driven_m)
            # The tick that reaches the distance is the last one.
            counted[:] = np.count_nonzero(before_m < course.distance_m, axis=1)
        keep = int(counted.max())
        yield Drives(
            scenario=scenario.name,
            seeds=seeds,
            left=runs.left_count[:, :keep],
            right=runs.right_count[:, :keep],
            gyro=runs.gyro_code[:, :keep],
            truth=runs.truth[:, :keep],
            ticks=counted,
        )
        if course.distance_m is not None and driven_m.min() >= course.distance_m:
            return
    if course.distance_m is not None:
        raise StudyError(
            f"--scenario {scenario.name}: the robot does not reach {course.words} in "
            f"{ticks} ticks: expected one that is as fast as it is told to be"
        )


def seed_blocks(seeds: tuple[int, ...], ticks: int) -> list[tuple[int, ...]]:
    """Return the seeds in blocks that are run together."""
    size = min(max(TOGETHER_TICKS // ticks, 1), TOGETHER_SEEDS)
    return [seeds[start : start + size] for start in range(0, len(seeds), size)]


def _driven(truth: Floats, position_m: Floats, driven_m: Floats) -> tuple[Floats, Floats, Floats]:
    """Return how far each robot has driven before each tick; then where it is, and how far, now.

    Args:
        truth: float64[rows, n, 3], the next ticks.
        position_m: float64[rows or 1, 1, 2], where it was.
        driven_m: float64[rows or 1, 1], how far it had driven.
    """
    rows = len(truth)
    way = np.concatenate([np.broadcast_to(position_m, (rows, 1, 2)), truth[:, :, :2]], axis=1)
    steps = np.diff(way, axis=1)
    gains = np.hypot(steps[:, :, 0], steps[:, :, 1])
    driven = np.concatenate([np.broadcast_to(driven_m, (rows, 1)), gains], axis=1)
    np.cumsum(driven, axis=1, out=driven)
    return driven[:, :-1], truth[:, -1:, :2].copy(), driven[:, -1:].copy()
