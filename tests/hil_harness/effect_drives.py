"""Drives without noise, with effects switched on, and what can be read from them."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hil_harness.effects import apply_effects, parse_effect
from hil_harness.scenarios import Segment, SegmentProfile
from sim_plant import DriveModel, PlantDescription, PlantRuns, simulate

FloatArray = NDArray[np.float64]
TICK_US = 10_000
TICK_S = 0.01

QUIET = PlantDescription.from_tables(
    {
        "encoder": {"noise_ticks": 0.0},
        "gyro": {"noise_density_rad_per_sqrt_s": 0.0},
        "accelerometer": {"noise_density_m_s2_per_sqrt_hz": 0.0},
        "drive": {"time_constant_s": 0.0, "max_wheel_acceleration_rad_s2": 1e6},
    }
)
RADIUS_M = QUIET.wheels.radius_m
BASE_M = QUIET.wheels.wheelbase_m
TICK_M = 2 * math.pi * RADIUS_M / QUIET.encoder.ticks_per_rev
TICK_TURN_RAD = TICK_M / BASE_M
TILT = math.cos(0.1) * math.cos(0.2)
CODE_RAD_S = 1 / QUIET.gyro.sensitivity_lsb_per_rad_s


@dataclass(frozen=True)
class Drive:
    """One run and what can be read from it."""

    runs: PlantRuns

    @property
    def pose(self) -> FloatArray:
        pose: FloatArray = self.runs.truth[0]
        return pose

    @property
    def path_m(self) -> float:
        return float(np.hypot(*np.diff(self.pose[:, :2], axis=0).T).sum())

    @property
    def turn_rad(self) -> float:
        return float(self.pose[-1, 2])

    @property
    def counted_m(self) -> float:
        return (self.ticks("left") + self.ticks("right")) / 2 * TICK_M

    @property
    def counted_turn_rad(self) -> float:
        return (self.ticks("right") - self.ticks("left")) * TICK_TURN_RAD

    @property
    def codes(self) -> FloatArray:
        """Gyro codes from the described zero, tick by tick."""
        codes: FloatArray = self.runs.gyro_code[0].astype(float) - QUIET.gyro.zero_rate_code
        return codes

    @property
    def gyro_turn_rad(self) -> float:
        return float(self.codes[1:].sum() * CODE_RAD_S * TICK_S)

    def ticks(self, side: str) -> int:
        return int(self.tick_steps(side).sum())

    def tick_steps(self, side: str) -> NDArray[np.int64]:
        counts = self.runs.left_count if side == "left" else self.runs.right_count
        steps = np.diff(counts[0].astype(np.int64))
        unwrapped: NDArray[np.int64] = (steps + 32768) % 65536 - 32768
        return unwrapped


def run(
    *effects: str,
    v: float = 0.0,
    w: float = 0.0,
    seconds: float = 10.0,
    drive: DriveModel = "ideal",
    robot: PlantDescription = QUIET,
    commands: FloatArray | None = None,
    seed: int = 1,
) -> Drive:
    if commands is None:
        commands = np.full((round(seconds / TICK_S) + 1, 2), (v, w))
    plant = apply_effects(parse_effect(text) for text in effects).plant_over_time
    runs = simulate(robot, plant, commands, [seed], tick_period_us=TICK_US, drive=drive)
    return Drive(runs)


def rich_commands() -> FloatArray:
    """Speed up, straight, arcs both ways, spin, reverse, rest: something for every effect."""
    profile = SegmentProfile(
        [
            Segment(0.0, 0.0, 1.0),
            Segment(0.6, 0.0, 3.0),
            Segment(0.5, 0.8, 3.0),
            Segment(0.5, -0.8, 2.0),
            Segment(0.0, 2.0, 2.0),
            Segment(-0.3, 0.2, 3.0),
            Segment(0.0, 0.0, 1.0),
        ]
    )
    return profile.rates(np.arange(0, 15.0, TICK_S))
