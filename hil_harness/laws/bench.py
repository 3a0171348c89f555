"""The bench on which laws are checked: our plant and our firmware, with every error at zero.

The robot is the described one with all described noise switched off, so that a law meets the one
error it speaks of and no other. Estimates come from the integer firmware itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from can_bus import load_database
from firmware_model import BatchRuns, build_config, run_batch
from hil_harness.lesson import LessonParameters
from hil_harness.robot import Robot, load_robot
from sim_plant import (
    DriveModel,
    EncoderModel,
    Mechanisms,
    NoiseModel,
    PlantDescription,
    PlantRuns,
    simulate,
)

FloatArray = NDArray[np.float64]
Size = Literal["small", "full"]
Outputs = Literal["all", "odometry"]
Mode = Literal["wheel", "gyro"]
Integration = Literal["euler_before", "midpoint", "euler_after"]

_RUNS: dict[Size, int] = {"small": 400, "full": 1600}
FIRST_SEED = 1000
NEUTRAL = Mechanisms()


@dataclass(frozen=True)
class Bench:
    """Plant and firmware of one robot, at rest, silent and exact until a law disturbs them.

    Attributes:
        size: "small" for 400 runs of a statistical law, "full" for 1600.
        robot: the robot whose plant and firmware are measured.
        tick_period_us: cycle time of the encoder message, microseconds.
    """

    size: Size
    robot: Robot
    tick_period_us: int

    @property
    def runs(self) -> int:
        """Runs of a statistical law."""
        return _RUNS[self.size]

    @property
    def tick_s(self) -> float:
        """Tick period, s."""
        return self.tick_period_us * 1e-6

    @property
    def wheel_radius_m(self) -> float:
        """Described wheel radius, m: the firmware's, and the true one unless disturbed."""
        return self.robot.plant.wheels.radius_m

    @property
    def wheelbase_m(self) -> float:
        """Described wheelbase, m."""
        return self.robot.plant.wheels.wheelbase_m

    @property
    def rad_per_tick(self) -> float:
        """Wheel angle of one encoder tick, Δ = 2π/N, rad."""
        return 2 * np.pi / self.robot.plant.encoder.ticks_per_rev

    @property
    def m_per_tick(self) -> float:
        """Distance of one encoder tick, rΔ, m."""
        return self.wheel_radius_m * self.rad_per_tick

    @property
    def gyro_rad_s_per_lsb(self) -> float:
        """Turn rate of one gyro code, rad/s."""
        return 1 / self.robot.plant.gyro.sensitivity_lsb_per_rad_s

    @property
    def accel_m_s2_per_lsb(self) -> float:
        """Specific force of one accelerometer code, m/s²."""
        return 1 / self.robot.plant.accelerometer.sensitivity_lsb_per_m_s2

    @property
    def arithmetic_rad(self) -> float:
        """Largest heading error of the firmware's own arithmetic, rad.

        One unit of the binary angle for its floor, one for the rounded constants.
        """
        return 2 * math.tau / (1 << self.robot.firmware.heading.frac_bits)

    def arithmetic_m(self, path_m: float) -> float:
        """Largest position error of the firmware's own arithmetic after *path_m* metres, m.

        A straight line between table entries h apart misses sine and cosine by h²/8 each, CORDIC by
        twice its last angle; the heading is off by `arithmetic_rad`; and the remainders that are
        carried leave four units of the step at most.
        """
        firmware = self.robot.firmware
        if firmware.trig.method == "cordic":
            trig = 2.0 ** (1 - firmware.trig.iterations)
        elif firmware.trig.interpolated:
            trig = (math.pi / 2 / firmware.trig.entries) ** 2 / 8
        else:
            trig = math.pi / 4 / firmware.trig.entries
        step_unit_m = 2.0**-firmware.step.frac_bits
        return path_m * (math.sqrt(2) * trig + self.arithmetic_rad) + 4 * step_unit_m

    def ticks(self, duration_s: float) -> int:
        """Ticks of a run whose last tick lies *duration_s* after its first."""
        return round(duration_s * 1e6 / self.tick_period_us) + 1

    def constant(self, v_m_s: float, w_rad_s: float, duration_s: float) -> FloatArray:
        """Commands (ticks, 2) of constant speed and turn rate."""
        return np.tile([v_m_s, w_rad_s], (self.ticks(duration_s), 1))

    def lesson_commands(self, duration_s: float) -> FloatArray:
        """Commands (ticks, 2) of the lesson: 0.6 m/s and 0.10·sin(2πt/20) rad/s."""
        lesson = LessonParameters()
        time_s = self.tick_s * np.arange(self.ticks(duration_s))
        turn_rad_s = lesson.turn_amplitude_rad_s * np.sin(2 * np.pi * time_s / lesson.turn_period_s)
        return np.column_stack([np.full_like(time_s, lesson.speed_m_s), turn_rad_s])

    def drive(
        self,
        commands: FloatArray,
        mechanisms: Mechanisms = NEUTRAL,
        *,
        runs: int = 1,
        first_seed: int = FIRST_SEED,
        motion: DriveModel = "ideal",
        encoder_model: EncoderModel = "counter",
        noise_ticks: float = 0.0,
        noise: NoiseModel = "streams",
        outputs: Outputs = "odometry",
    ) -> PlantRuns:
        """Drive the disturbed robot, once per seed.

        Args:
            commands: (ticks, 2) of v_m_s and w_rad_s.
            mechanisms: how the real robot differs from the described one.
            runs: number of runs, each with its own seed.
            first_seed: seed of the first run; the others follow.
            motion: "ideal": the body follows the commands and the wheels turn as its true geometry
                asks; "motor": both wheels turn as commanded and the body follows them.
            encoder_model: see ``sim_plant.Plant``.
            noise_ticks: encoder noise, standard deviation in ticks.
            noise: random streams of the plant, or the lesson's.
            outputs: "all" for the accelerometer's codes as well.
        """
        return simulate(
            _silenced(self.robot.plant, noise_ticks),
            mechanisms,
            commands,
            range(first_seed, first_seed + runs),
            tick_period_us=self.tick_period_us,
            encoder_model=encoder_model,
            noise=noise,
            drive=motion,
            outputs=outputs,
        )

    def odometry(
        self, journey: PlantRuns, mode: Mode, integration: Integration = "midpoint"
    ) -> FloatArray:
        """Return the firmware's poses on *journey*, (runs, ticks, 3) of x_m, y_m, heading_rad."""
        return self._firmware(journey, mode, integration, twin=False).pose_m_rad()

    def float_odometry(
        self, journey: PlantRuns, mode: Mode, integration: Integration = "midpoint"
    ) -> FloatArray:
        """Return the poses of the firmware's float64 twin, of the same shape."""
        poses = self._firmware(journey, mode, integration, twin=True).twin_pose
        if poses is None:
            raise ValueError("the batch kept no history of the twin")
        return poses

    def wheel_angle_rad(self, counts: NDArray[np.int64]) -> FloatArray:
        """Return the angle that wrapping *counts* (runs, ticks) have covered since the first."""
        half = 1 << (self.robot.plant.encoder.counter_bits - 1)
        wide = counts.astype(np.int64)
        steps = np.diff(wide, axis=1, prepend=wide[:, :1])
        # A wrapping counter moves by less than half its range: the signed difference is the step.
        signed = np.bitwise_and(steps + half, 2 * half - 1) - half
        return np.cumsum(signed, axis=1) * self.rad_per_tick

    def gyro_rad_s(self, journey: PlantRuns) -> FloatArray:
        """Return the turn rate (runs, ticks) that the gyro's codes stand for."""
        zero = self.robot.plant.gyro.zero_rate_code
        return (journey.gyro_code - zero).astype(np.float64) * self.gyro_rad_s_per_lsb

    def accel_x_m_s2(self, journey: PlantRuns) -> FloatArray:
        """Return the forward specific force (runs, ticks) of the accelerometer's codes."""
        if journey.accel_x_code is None:
            raise ValueError("the runs carry no accelerometer codes: expected outputs='all'")
        zero = self.robot.plant.accelerometer.zero_code
        return (journey.accel_x_code - zero).astype(np.float64) * self.accel_m_s2_per_lsb

    def _firmware(
        self, journey: PlantRuns, mode: Mode, integration: Integration, *, twin: bool
    ) -> BatchRuns:
        description = self.robot.firmware.model_copy(
            update={"mode": mode, "integration": integration}
        )
        config = build_config(description, self.robot.firmware_constants(self.tick_period_us))
        counts = (journey.left_count, journey.right_count, journey.gyro_code)
        return run_batch(config, *counts, twin=twin)


def default_bench(size: Size = "small") -> Bench:
    """Return the bench of the shipped robot at the shipped DBC's tick period."""
    cycle_us = load_database().messages["ENCODER"].cycle_time_us
    if cycle_us is None:
        raise ValueError("ENCODER has no cycle time: expected GenMsgCycleTime in the DBC")
    return Bench(size, load_robot(None), cycle_us)


def path_lengths_m(poses: FloatArray) -> FloatArray:
    """Return the path covered since the start, shape (…, ticks), of poses (…, ticks, 3), m."""
    steps = np.diff(poses[..., :2], axis=-2, prepend=poses[..., :1, :2])
    lengths: FloatArray = np.cumsum(np.hypot(steps[..., 0], steps[..., 1]), axis=-1)
    return lengths


def _silenced(description: PlantDescription, noise_ticks: float) -> PlantDescription:
    """Return *description* without any described noise but *noise_ticks* of the encoders."""
    quiet = {
        "encoder": {"noise_ticks": noise_ticks},
        "contact": {"noise_m_per_sqrt_m": 0.0},
        "gyro": {"noise_density_rad_per_sqrt_s": 0.0, "bias_walk_density_rad_s_per_sqrt_s": 0.0},
        "accelerometer": {"noise_density_m_s2_per_sqrt_hz": 0.0},
    }
    return description.model_copy(
        update={
            table: getattr(description, table).model_copy(update=values)
            for table, values in quiet.items()
        }
    )
