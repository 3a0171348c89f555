"""Wrong samples of a reference are left out and counted; noise, however heavy-tailed, stays."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from diagnosed import ROBOT, WIRE

from gap_diagnosis.outliers import without_outliers
from gap_diagnosis.recording import Floats, Recording, Reference
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.scenarios import scenario

WRONG = (200, 201, 202, 700, 1500, 2100)


@cache
def drive() -> Recording:
    still = replace(scenario("figure8"), effects=())
    return synthetic_recording(
        ROBOT, WIRE, still, (), 3, reference=ReferenceNoise(), duration_s=30.0
    )


def reference() -> Reference:
    known = drive().reference
    assert known is not None
    return known


def with_x(x_m: Floats) -> Recording:
    return replace(drive(), reference=replace(reference(), x_m=x_m))


@pytest.mark.parametrize("jump_m", [0.05, -0.3, 5.0])
def test_samples_of_a_lost_marker_are_left_out_and_no_others(jump_m: float) -> None:
    x_m = reference().x_m.copy()
    x_m[list(WRONG)] += jump_m
    cleaned, count = without_outliers(with_x(x_m), ROBOT)
    assert cleaned.reference is not None
    assert count == len(WRONG)
    np.testing.assert_array_equal(cleaned.reference.t_s, np.delete(reference().t_s, list(WRONG)))


def test_a_good_reference_is_left_as_it_is() -> None:
    cleaned, count = without_outliers(drive(), ROBOT)
    assert count == 0
    assert cleaned is drive()


@pytest.mark.parametrize("scale_m", [0.001, 0.02, 1.0])
def test_heavy_tails_are_noise(scale_m: float) -> None:
    """Student's t of five degrees of freedom, as a motion capture room may have it."""
    noise = np.random.default_rng(1).standard_t(5, len(reference().x_m))
    _, count = without_outliers(with_x(reference().x_m + scale_m * noise), ROBOT)
    assert count <= 3


def test_a_reference_that_is_often_far_off_is_taken_as_it_is() -> None:
    x_m = reference().x_m.copy()
    x_m[::7] += 1.0
    cleaned, count = without_outliers(with_x(x_m), ROBOT)
    assert count == 0
    assert cleaned.reference is not None
    assert len(cleaned.reference.t_s) == len(x_m)


def test_good_neighbours_of_a_wrong_fix_are_kept() -> None:
    """A wrong fix bends the motion that its neighbours are held against, most at a few a second."""
    slow = reference().only(np.arange(len(reference().t_s)) % 20 == 0)
    wrong = np.arange(5, len(slow.t_s), 33)
    x_m = slow.x_m.copy()
    x_m[wrong] += 1.5
    blind = replace(slow, x_m=x_m, heading_rad=None)
    cleaned, count = without_outliers(replace(drive(), reference=blind), ROBOT)
    assert count == len(wrong)
    assert cleaned.reference is not None
    np.testing.assert_array_equal(cleaned.reference.t_s, np.delete(slow.t_s, wrong))
