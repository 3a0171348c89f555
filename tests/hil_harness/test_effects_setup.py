"""Mistakes of the set-up exchange, mirror or multiply what is recorded, not how it drives."""

import math

import numpy as np
import pytest
from array_runs import drive_once
from numpy.typing import NDArray

from hil_harness.effects.setup_mistakes import SetupMistakes, SignSignal

FACTORS = (2.0, 0.5, 4.0, 0.25, 10.0, math.pi / 180, 180 / math.pi)


def unwrapped(count: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.cumsum((np.diff(count, prepend=count[:1]) + 32768) % 65536 - 32768)


def test_swapped_wheels_are_each_others_counts() -> None:
    plain = drive_once(scenario="random")
    swapped = drive_once("setup_wheels_swapped", scenario="random")
    np.testing.assert_array_equal(swapped.left_count, plain.right_count)
    np.testing.assert_array_equal(swapped.right_count, plain.left_count)
    np.testing.assert_array_equal(swapped.truth, plain.truth)


def test_a_flipped_wheel_counts_backwards() -> None:
    plain = drive_once(scenario="random")
    flipped = drive_once("setup_sign.signal=left_ticks", scenario="random")
    np.testing.assert_array_equal(unwrapped(flipped.left_count), -unwrapped(plain.left_count))
    np.testing.assert_array_equal(flipped.right_count, plain.right_count)


def test_a_flipped_gyro_reads_clockwise() -> None:
    plain = drive_once(scenario="random")
    flipped = drive_once("setup_sign.signal=gyro", scenario="random")
    np.testing.assert_array_equal(flipped.gyro_code - 32768, 32768 - plain.gyro_code)


@pytest.mark.parametrize("factor", FACTORS)
def test_a_unit_multiplies_both_wheels(factor: float) -> None:
    plain = drive_once(ticks=300)
    wrong = drive_once("setup_unit.signal=ticks", f"setup_unit.factor={factor}", ticks=300)
    for side in ("left_count", "right_count"):
        expected = unwrapped(getattr(plain, side)) * factor
        np.testing.assert_allclose(unwrapped(getattr(wrong, side)), expected, atol=1.0)


def test_a_flipped_turn_command_is_what_the_log_says_not_what_the_robot_does() -> None:
    plain = drive_once(scenario="random")
    flipped = drive_once("setup_sign.signal=command_turn", scenario="random")
    np.testing.assert_array_equal(flipped.commands[:, 1], -plain.commands[:, 1])
    np.testing.assert_array_equal(flipped.commands[:, 0], plain.commands[:, 0])
    np.testing.assert_array_equal(flipped.truth, plain.truth)


@pytest.mark.parametrize(
    ("flipped", "factors"),
    [
        ("reference_position", (1.0, -1.0, 1.0)),
        ("reference_heading", (1.0, 1.0, -1.0)),
        ("reference", (1.0, -1.0, -1.0)),
    ],
)
def test_a_flipped_reference_is_of_the_other_hand_and_no_half_turn(
    flipped: SignSignal, factors: tuple[float, float, float]
) -> None:
    poses = np.array([[0.3, -0.2, 0.7], [1.0, 2.0, -3.0]])
    found = SetupMistakes(flipped=flipped).reference(poses)
    np.testing.assert_array_equal(found, poses * np.array(factors))
