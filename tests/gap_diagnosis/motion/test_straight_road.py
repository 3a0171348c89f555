"""A car that hardly turns has no wheelbase to be told, whatever its wheels tremble."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.reading import read_recordings
from gap_diagnosis.recording import Recording
from hil_harness import Robot, load_robot

TRACK_M, RADIUS_M, LONGER = 1.56, 0.316, 0.009
STEP_S, FIX_S, LASTS_S = 0.012, 0.05, 60.0
BIAS_RAD_S, GYRO_RAD_PER_SQRT_S, CONTACT_M_PER_SQRT_M = -0.068, 3.5e-4, 4e-4
HOP_M, HOP_HZ, HOP_LASTS_S, TOGETHER = 0.6e-3, 12.5, 0.05, 0.6
"""An axle that hops: how far a wheel is off its way meanwhile, and the share of both wheels."""
FIX_M, WANDER_M, WANDER_S = 0.011, 0.05, 19.0
ROBOT = f"""schema = 1
[robot]
name = "car"
[wheels]
radius_m = {RADIUS_M}
wheelbase_m = {TRACK_M}
[encoder]
ticks_per_rev = 4096
[drive]
max_wheel_rate_rad_s = 150.0
"""
MAP = """[columns]
time = { column = "t_s", unit = "s" }
left_count = { column = "left_m_s", unit = "m/s" }
right_count = { column = "right_m_s", unit = "m/s" }
gyro = { column = "yaw_rad_s", unit = "rad/s" }
"""


def write_minute(home: Path, seed: int) -> None:
    """Write a minute on a motorway: what wheels and gyro say, and where a GPS was.

    Levels of noise are those of a public recording of a car (comma2k19's example).
    """
    rng = np.random.default_rng(seed)
    t_s = np.arange(0.0, LASTS_S, STEP_S)
    count = len(t_s)
    speed = 16.0 + 4.0 * np.sin(0.1 * t_s)
    wander = gaussian_filter1d(rng.standard_normal(count), 2.0 / STEP_S)
    turn_rate = 0.002 * wander / wander.std()
    heading = np.cumsum(turn_rate) * STEP_S
    x_m, y_m = np.cumsum([speed * np.cos(heading), speed * np.sin(heading)], axis=1) * STEP_S
    decay = np.exp((2j * math.pi * HOP_HZ - 1 / HOP_LASTS_S) * STEP_S)
    pushes = rng.standard_normal((3, count)) + 1j * rng.standard_normal((3, count))
    hops = math.sqrt(1 - abs(decay) ** 2) * lfilter([1.0], [1.0, -decay], pushes).real
    both = math.sqrt(TOGETHER) * hops[2]
    wheels = []
    for side, own in ((-0.5, hops[0]), (0.5, hops[1])):
        trembles_m = HOP_M * (both + math.sqrt(1 - TOGETHER) * own)
        slips = CONTACT_M_PER_SQRT_M * np.sqrt(speed / STEP_S) * rng.standard_normal(count)
        rolled = speed + side * TRACK_M * turn_rate
        wheels.append(rolled / (1.0 + LONGER) + np.gradient(trembles_m, STEP_S) + slips)
    gyro = turn_rate + BIAS_RAD_S
    gyro += GYRO_RAD_PER_SQRT_S / math.sqrt(STEP_S) * rng.standard_normal(count)
    np.savetxt(
        home / "car.csv",
        np.array([t_s, *wheels, gyro]).T,
        fmt="%.5f",
        delimiter=",",
        header="t_s,left_m_s,right_m_s,yaw_rad_s",
        comments="",
    )
    fixes_s = np.arange(0.0037, t_s[-1], FIX_S)
    fixes = np.zeros((len(fixes_s), 8))
    fixes[:, 0], fixes[:, 7] = fixes_s, 1.0
    stays = math.exp(-FIX_S / WANDER_S)
    for column, way in ((1, x_m), (2, y_m)):
        fresh = WANDER_M * math.sqrt(1 - stays**2) * rng.standard_normal(len(fixes))
        noise = FIX_M * rng.standard_normal(len(fixes)) + lfilter([1.0], [1.0, -stays], fresh)
        fixes[:, column] = np.interp(fixes_s, t_s, way) + noise
    np.savetxt(home / "car.tum", fixes, fmt="%.5f")
    for name, text in (("map.toml", MAP), ("robot.toml", ROBOT)):
        (home / name).write_text(text, encoding="utf-8")


def minute(home: Path) -> tuple[Recording, Robot]:
    """Return the minute as it is read, and the car as it is described."""
    write_minute(home, 1)
    robot = load_robot(home / "robot.toml")
    (recording,) = read_recordings(
        [home / "car.csv"],
        robot=robot,
        references=[home / "car.tum"],
        signals=home / "map.toml",
    )
    return recording, robot


def test_a_car_on_a_straight_road_has_no_wheelbase_to_be_told(tmp_path: Path) -> None:
    """Wheels farther apart make all that they tremble turn it by less. Where they tremble more than
    is said, as those of a real car did, they stood 27 % farther apart, by 240 nats."""
    recording, robot = minute(tmp_path)
    assert recording.unsure_ticks2 is not None
    surer = replace(recording, unsure_ticks2=0.1 * recording.unsure_ticks2)
    model = MotionModel(surer, robot, default_prior())
    by_effect = {term.variant.effect: term for term in model.columns.terms}
    constants = [by_effect["gyro_bias"], by_effect["radius_scale"]]
    as_described = model.refit(constants, model.level_prior.median)
    wider = model.refit([*constants, by_effect["wheelbase_scale"]], model.level_prior.median)
    # 7 here; 123 where what trembles has its say.
    assert wider.log_likelihood < as_described.log_likelihood + THRESHOLD
