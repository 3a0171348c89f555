"""Paths, commands and recordings whose gap is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.gap.floor import NoiseLevels
from gap_diagnosis.gap.metrics import Path
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recordings
from hil_harness import load_robot, load_wire
from hil_harness.effects import EffectSetting
from hil_harness.robot import Robot
from hil_harness.scenarios import scenario

Floats = NDArray[np.float64]

TICK_S = 0.01
ROBOT = load_robot()
CONTACT = 5e-4
"""Contact noise of every synthetic drive, m/√m."""
NOISE = ReferenceNoise()
LEVELS = NoiseLevels(
    contact_m_per_sqrt_m=CONTACT,
    lateral_m_per_sqrt_m=0.0,
    gyro_noise_rad_per_sqrt_s=ROBOT.plant.gyro.noise_density_rad_per_sqrt_s,
    gyro_bias_walk_rad_s_per_sqrt_s=0.0,
    reference_position_m=NOISE.position_m,
    reference_heading_rad=NOISE.heading_rad,
    reference_slow_position_m=NOISE.coloured_position_m,
    reference_slow_heading_rad=NOISE.coloured_heading_rad,
    slow_s=NOISE.correlation_time_s,
    quantum_rad=(1 / 12 + ROBOT.plant.encoder.noise_ticks**2) ** 0.5 * 2 * np.pi / 2048,
)


def wavy_path(duration_s: float = 40.0, *, seed: int = 0, tick_s: float = TICK_S) -> Path:
    """Return a path of arcs at about 0.5 m/s."""
    random = np.random.default_rng(seed)
    t_s = np.arange(round(duration_s / tick_s)) * tick_s
    a, b, c = random.uniform(0.2, 1.0, 3)
    heading = a * np.sin(0.3 * t_s) + b * np.sin(0.11 * t_s + c)
    speed = 0.5 + 0.1 * np.sin(0.2 * t_s + a)
    x_m = np.cumsum(speed * np.cos(heading)) * tick_s
    y_m = np.cumsum(speed * np.sin(heading)) * tick_s
    return Path(t_s, x_m, y_m, heading)


def moved(path: Path, angle_rad: float, x_m: float, y_m: float) -> Path:
    """Return the whole path turned about the origin, then shifted."""
    point = (path.x_m + 1j * path.y_m) * np.exp(1j * angle_rad) + (x_m + 1j * y_m)
    heading = None if path.heading_rad is None else path.heading_rad + angle_rad
    return Path(path.t_s, point.real, point.imag, heading)


def way_of(path: Path) -> Floats:
    """Return the distance travelled until each tick."""
    steps = np.hypot(np.diff(path.x_m, prepend=path.x_m[0]), np.diff(path.y_m, prepend=path.y_m[0]))
    return np.asarray(np.cumsum(steps))


def drives(
    name: str, effect: str | None = None, *, mode: str = "wheel", count: int = 1, **values: float
) -> tuple[Robot, list[tuple[Recording, Motion]]]:
    """Return *count* recordings of a scenario, with one effect at work or none."""
    firmware = ROBOT.firmware.model_copy(update={"mode": mode})
    robot = replace(ROBOT, firmware=firmware)
    settings = () if effect is None else (EffectSetting(effect, tuple(values.items())),)
    recordings = synthetic_recordings(
        robot,
        load_wire(),
        scenario(name, seed=3),
        [(settings, seed) for seed in range(count)],
        reference=NOISE,
        contact_noise_m_per_sqrt_m=CONTACT,
    )
    return robot, [(one, estimate_motion(one, robot)) for one in recordings]


def setting(motion: Motion, effect: str, *coefficients: float) -> Setting:
    """Return an effect's first way of acting with these coefficients."""
    return next(iter(EXPLAINED[effect].variants(motion))), coefficients
