"""A reference that smooths, as an estimator does, is no gap of the robot: late, if it is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from full_size import at_full_size
from motion_cases import ROBOT, WIRE
from scipy.ndimage import uniform_filter1d
from scipy.signal import lfilter

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.recording import Floats
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.scenarios import scenario

RATE_HZ = 50.0
KEPT = 0.82
"""Of what a filter said before, in what it says."""
MEAN_S = 0.3


def lagging(values: Floats) -> Floats:
    """Return values behind a filter of first order, settled as they begin."""
    return np.asarray(lfilter([1.0 - KEPT], [1.0, -KEPT], values - values[0]) + values[0])


def averaged(values: Floats) -> Floats:
    """Return means about each value."""
    return np.asarray(uniform_filter1d(values, round(MEAN_S * RATE_HZ), mode="nearest"))


def likeliest(smooth: Callable[[Floats], Floats], seed: int) -> tuple[frozenset[str], float, float]:
    """Return what is told of a healthy robot beside a reference that smooths, how surely, and how
    late that is."""
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (), seed, reference=ReferenceNoise(rate_hz=RATE_HZ)
    )
    reference = log.reference
    assert reference is not None
    assert reference.heading_rad is not None
    smoothed = replace(
        reference,
        x_m=smooth(reference.x_m),
        y_m=smooth(reference.y_m),
        heading_rad=smooth(reference.heading_rad),
    )
    told = diagnose_recordings([replace(log, reference=smoothed)], ROBOT, WIRE).diagnosis.which[0]
    late = told.parameters.get("reference_time_offset.offset")
    return frozenset(told.effects), told.probability, 0.0 if late is None else late.estimate


@pytest.mark.parametrize("seed", [1, *at_full_size(2)])
def test_a_reference_that_averages_over_three_tenths_of_a_second_is_no_gap(seed: int) -> None:
    """Where it turns and speeds up it cuts corners: an unlisted cause, 0.96."""
    effects, probability, _ = likeliest(averaged, seed)
    assert effects == {"no_gap"}
    assert probability > 0.8


@pytest.mark.full_size
@pytest.mark.parametrize("seed", [2, *at_full_size(1)])
def test_a_reference_behind_a_filter_is_late_and_nothing_else(seed: int) -> None:
    """Wheels lost their hold in eleven windows, which took 200 s to tell."""
    effects, probability, late_s = likeliest(lagging, seed)
    assert effects == {"reference_time_offset"}
    assert probability > 0.8
    # On average what it says is so old; by no more than half a sample is that unsure.
    assert late_s == pytest.approx(KEPT / (1.0 - KEPT) / RATE_HZ, abs=0.5 / RATE_HZ)
