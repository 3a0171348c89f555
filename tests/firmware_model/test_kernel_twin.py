"""Firmware against its float twin, and the twin against an independent float estimator."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
from kernel_cases import ROBOT, ZERO_CODE, config_of
from test_kernel_bit_equal import random_ticks

from firmware_model import (
    FirmwareConstants,
    FirmwareDescription,
    FloatTwin,
    Kernel,
    build_config,
    run_batch,
)

Int64Array = npt.NDArray[np.int64]

# A gyro so fine that its rounding is far below the lesson's digits: the lesson has no ADC.
FINE_GYRO = replace(ROBOT, gyro_sensitivity_rad_s_per_lsb=0.15 / 32768)
PATH_M = 0.6 * 60


class Lesson(NamedTuple):
    """The textbook lesson's truth and what its 16-bit counters and gyro read, seed 7."""

    truth: npt.NDArray[np.float64]
    left_count: Int64Array
    right_count: Int64Array
    gyro_code: Int64Array


def lesson(constants: FirmwareConstants) -> Lesson:
    rng = np.random.default_rng(7)
    steps, dt = 5_999, 0.01
    rate = 0.10 * np.sin(2 * np.pi * np.arange(steps) * dt / 20)
    draws = rng.standard_normal((steps, 3))
    to_ticks = 2048 / (2 * np.pi) * dt
    right = np.round((0.6 + rate * 0.15) / (0.05 * 0.998) * to_ticks) + 0.2 * draws[:, 0]
    left = np.round((0.6 - rate * 0.15) / (0.05 * 1.002) * to_ticks) + 0.2 * draws[:, 1]
    gyro = rate + 0.005 + 0.002 * draws[:, 2]
    heading = np.concatenate([[0.0], np.cumsum(rate * dt)])
    middle = heading[:-1] + rate * dt / 2
    x = np.concatenate([[0.0], np.cumsum(0.6 * dt * np.cos(middle))])
    y = np.concatenate([[0.0], np.cumsum(0.6 * dt * np.sin(middle))])

    def counter(increments: npt.NDArray[np.float64]) -> Int64Array:
        total = np.rint(np.cumsum(np.concatenate([[0.0], increments])))
        return total.astype(np.int64) % 65_536

    codes = np.rint(ZERO_CODE + gyro / constants.gyro_sensitivity_rad_s_per_lsb).astype(np.int64)
    return Lesson(
        np.stack([x, y, heading], axis=1),
        counter(left),
        counter(right),
        np.concatenate([[ZERO_CODE], codes]),
    )


def errors(
    firmware: dict[str, Any], constants: FirmwareConstants = ROBOT
) -> tuple[npt.NDArray[np.float64], float]:
    """Return firmware − twin [ticks, 3] and the twin's final distance from the truth [m]."""
    data = lesson(constants)
    config = build_config(FirmwareDescription.from_table(firmware), constants)
    runs = run_batch(config, data.left_count[None], data.right_count[None], data.gyro_code[None])
    assert runs.twin_pose is not None
    model = runs.twin_pose[0] - data.truth
    return runs.pose_m_rad()[0] - runs.twin_pose[0], float(np.hypot(*model[-1, :2]))


LESSON_WHEEL = {"mode": "wheel", "integration": "midpoint"}
LESSON_GYRO = {"mode": "gyro", "integration": "euler_before"}


def test_the_twin_gives_the_lessons_wheel_only_error() -> None:
    assert errors(LESSON_WHEEL)[1] == pytest.approx(6.850275, abs=5e-7)


def test_the_twin_gives_the_lessons_gyro_error_when_the_gyro_is_fine_enough() -> None:
    # rounded codes: a random walk of the heading, LSB/√12·dt·√6000 = 1.0e-6 rad at the end;
    # it moves the end of a 36 m path by 36/√3 m times that, here with four standard deviations
    heading_rad = FINE_GYRO.gyro_sensitivity_rad_s_per_lsb / math.sqrt(12) * 0.01 * math.sqrt(6000)
    allowed_m = 4 * PATH_M / math.sqrt(3) * heading_rad
    assert allowed_m < 1e-4
    assert errors(LESSON_GYRO, FINE_GYRO)[1] == pytest.approx(5.280128, abs=allowed_m)


def test_the_default_firmware_is_the_lessons_gyro_estimator() -> None:
    assert errors({})[1] == errors(LESSON_GYRO)[1]


@pytest.mark.parametrize(
    "firmware", [LESSON_WHEEL, LESSON_GYRO, {"mode": "blend", "blend_weight": 0.875}]
)
def test_the_firmware_stays_within_the_tables_error_of_its_twin(firmware: dict[str, Any]) -> None:
    """Chords of 1/1024 of a quarter wave lie below the arc by step²/8: the longest path error."""
    arithmetic, _ = errors(firmware)
    table_m = (math.pi / 2 / 1024) ** 2 / 8 * PATH_M
    assert np.abs(arithmetic[:, :2]).max() < table_m + 1e-7
    assert np.abs(arithmetic[:, 2]).max() < 1e-8


def test_the_blends_weight_is_rounded_by_less_than_it_matters() -> None:
    arithmetic, _ = errors({"mode": "blend", "blend_weight": 0.9})
    apart_rad = math.radians(21.05 + 17.25)  # how far wheels and gyro drift apart in the lesson
    weight = 2.0 ** -(config_of(mode="blend").blend_frac_bits + 1)
    assert np.abs(arithmetic[:, 2]).max() < weight * apart_rad + 1e-8


def test_with_cordic_the_firmware_stays_within_a_fifth_of_a_micrometre() -> None:
    arithmetic, _ = errors({**LESSON_WHEEL, "trig": {"method": "cordic"}})
    # 30 rotations: angle 2^-29 rad over the whole path, and the rounding of sine and cosine
    assert np.abs(arithmetic[:, :2]).max() < 3 * 2.0**-29 * PATH_M
    assert np.abs(arithmetic[:, :2]).max() < 2e-7


def slope(bits: list[int], rms: list[float]) -> float:
    return float(np.polyfit(bits, np.log2(rms), 1)[0])


def lesson_rms(firmware: dict[str, Any]) -> float:
    arithmetic, _ = errors({**LESSON_WHEEL, "trig": {"method": "cordic"}, **firmware})
    return float(np.sqrt(np.mean(arithmetic[:, :2] ** 2)))


def random_arithmetic(position: dict[str, Any], runs: int = 12) -> npt.NDArray[np.float64]:
    """Return firmware − twin (x, y) over drives that turn and change speed: [runs, ticks, 2].

    At constant speed and heading every step is rounded alike; the laws below are about steps
    that are spread over many quanta.
    """
    steps = np.random.default_rng(5).integers(10, 91, size=(2, runs, 3_000))
    left, right = np.cumsum(steps, axis=2)
    firmware = {"mode": "wheel", "trig": {"method": "cordic"}, "position": position}
    config = config_of(**firmware)
    batch = run_batch(config, left, right, np.full_like(left, ZERO_CODE))
    assert batch.twin_pose is not None
    return (batch.pose_m_rad() - batch.twin_pose)[:, :, :2]


@pytest.mark.parametrize("carry", [True, False])
@pytest.mark.parametrize("rounding", ["floor", "half_up", "half_even", "toward_zero"])
def test_each_bit_of_the_position_halves_the_error(rounding: str, carry: bool) -> None:
    bits = list(range(12, 22))  # a step is 2 to 14 mm: at 12 bits, dozens of quanta
    rms = [
        float(np.sqrt(np.mean(random_arithmetic(position) ** 2)))
        for position in (
            {"frac_bits": one, "rounding": rounding, "carry_remainder": carry} for one in bits
        )
    ]
    # without carry the error is a random walk: the rms of 24 walks scatters by 0.2 (in log2),
    # so the slope over ten points by 0.02
    assert slope(bits, rms) == pytest.approx(-1.0, abs=0.08)


def test_the_error_stops_falling_when_another_cause_dominates() -> None:
    coarse_table = {"method": "table", "entries": 16}
    rms = [lesson_rms({"position": {"frac_bits": one}, "trig": coarse_table}) for one in (20, 32)]
    assert rms[0] == pytest.approx(rms[1], rel=0.01)


def test_each_bit_of_the_heading_halves_the_error() -> None:
    bits = list(range(8, 19))
    rms = [lesson_rms({"heading": {"frac_bits": one}}) for one in bits]
    assert slope(bits, rms) == pytest.approx(-1.0, abs=0.1)


def test_floor_without_carry_drifts_like_a_bias_and_half_up_like_noise() -> None:
    """Ends of the runs: floor loses half a unit each step; to nearest, variance N/12."""
    runs, steps = 400, 3_000
    ends = {}
    for rounding in ("floor", "half_up"):
        position = {"frac_bits": 16, "rounding": rounding, "carry_remainder": False}
        ends[rounding] = random_arithmetic(position, runs)[:, -1].ravel() * 2**16
    sigma = math.sqrt(steps / 12)
    four_sigma_of_the_mean = 4 * sigma / math.sqrt(2 * runs)
    assert ends["floor"].mean() == pytest.approx(-steps / 2, abs=four_sigma_of_the_mean)
    assert ends["half_up"].mean() == pytest.approx(0.0, abs=four_sigma_of_the_mean)
    four_sigma_of_the_spread = 4 / math.sqrt(2 * 2 * runs)
    for end in ends.values():
        assert end.std() / sigma == pytest.approx(1.0, abs=four_sigma_of_the_spread)


# The twin against an independent estimator, and through every decision --------------------------


def plain_float(data: Lesson, mode: str, share: float) -> npt.NDArray[np.float64]:
    """Return the textbook estimator in plain Python floats."""
    x = y = heading = 0.0
    poses = [(x, y, heading)]
    for k in range(1, 6_000):
        left = (int(data.left_count[k]) - int(data.left_count[k - 1]) + 32_768) % 65_536 - 32_768
        right = (int(data.right_count[k]) - int(data.right_count[k - 1]) + 32_768) % 65_536 - 32_768
        left_m, right_m = (2 * math.pi * ROBOT.wheel_radius_m / 2048 * one for one in (left, right))
        wheels = (right_m - left_m) / ROBOT.wheelbase_m
        gyro = (int(data.gyro_code[k]) - ZERO_CODE) * ROBOT.gyro_sensitivity_rad_s_per_lsb * 0.01
        turn = {"wheel": wheels, "gyro": gyro, "blend": 0.9 * gyro + 0.1 * wheels}[mode]
        along = heading + share * turn
        x += (left_m + right_m) / 2 * math.cos(along)
        y += (left_m + right_m) / 2 * math.sin(along)
        heading += turn
        poses.append((x, y, heading))
    return np.array(poses)


@pytest.mark.parametrize("mode", ["wheel", "gyro", "blend"])
@pytest.mark.parametrize(
    ("rule", "share"), [("euler_before", 0.0), ("midpoint", 0.5), ("euler_after", 1.0)]
)
def test_the_twin_is_the_textbook_estimator_in_double_precision(
    mode: str, rule: str, share: float
) -> None:
    data = lesson(ROBOT)
    config = config_of(mode=mode, integration=rule)
    runs = run_batch(config, data.left_count[None], data.right_count[None], data.gyro_code[None])
    assert runs.twin_pose is not None
    np.testing.assert_allclose(runs.twin_pose[0], plain_float(data, mode, share), atol=1e-11)


@pytest.mark.parametrize("mode", ["wheel", "gyro", "blend"])
@pytest.mark.parametrize("rule", ["euler_before", "midpoint", "euler_after"])
def test_the_twin_takes_every_decision_of_the_kernel(mode: str, rule: str) -> None:
    """Through gaps, losses, fallbacks and standstills the difference stays arithmetic."""
    config = config_of(mode=mode, integration=rule, trig={"method": "cordic"}, blend_weight=0.75)
    columns = random_ticks(config, seed=11, count=20_000).T[:, None, :]
    runs = run_batch(config, columns[0], columns[1], columns[3], columns[2], columns[4])
    assert runs.twin_pose is not None
    arithmetic = runs.pose_m_rad()[0] - runs.twin_pose[0]
    path_m = np.abs(np.diff(runs.twin_pose[0][:, :2], axis=0)).sum()
    assert path_m > 50
    # heading: 16 fraction bits of an estimated offset over 200 s; the rest is far below
    heading_rad = 2.0**-17 * ROBOT.gyro_sensitivity_rad_s_per_lsb * 200 + 1e-8
    assert np.abs(arithmetic[:, 2]).max() < heading_rad
    assert np.abs(arithmetic[:, :2]).max() < heading_rad * path_m + 1e-6


def test_the_twin_beside_a_single_kernel_is_the_twin_of_the_batch() -> None:
    config = config_of(mode="blend", integration="midpoint")
    ticks = random_ticks(config, seed=3, count=2_000)
    columns = ticks.T[:, None, :]
    runs = run_batch(config, columns[0], columns[1], columns[3], columns[2], columns[4])
    assert runs.twin_pose is not None
    for implementation in ("python", "compiled"):
        kernel, twin = Kernel(config, implementation), FloatTwin(config)
        for tick in ticks.tolist():
            kernel.step(*tick)
            twin.step(kernel)
        np.testing.assert_allclose(twin.pose, runs.twin_pose[0, -1], rtol=0, atol=1e-12)
