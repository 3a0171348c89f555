"""Stamps of a reference that are off: a noise that only shows under way, and no gap."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.lost_tracking import with_tracking
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.whitening import CONTACT, LEVELS, STAMP
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario


def with_stamps_off(log: Recording, off_s: float, seed: int = 3) -> Recording:
    """Return the log with a reference whose samples came over a network, in the order of their
    stamps."""
    reference = log.reference
    assert reference is not None
    assert reference.heading_rad is not None
    noise = np.random.default_rng(seed).normal(0.0, off_s, len(reference.t_s))
    stamps = reference.t_s + noise
    order = np.argsort(stamps)
    return replace(
        log,
        reference=replace(
            reference,
            t_s=stamps[order],
            x_m=reference.x_m[order],
            y_m=reference.y_m[order],
            heading_rad=reference.heading_rad[order],
        ),
    )


def drive(rate_hz: float, *effects: EffectSetting) -> Recording:
    noise = ReferenceNoise(rate_hz=rate_hz)
    return synthetic_recording(ROBOT, WIRE, scenario("calibration"), effects, 5, reference=noise)


@pytest.mark.parametrize("off_s", [0.005, 0.03])
def test_by_how_much_stamps_are_off_is_found_and_is_nobody_elses_noise(off_s: float) -> None:
    model = MotionModel(with_stamps_off(drive(10.0), off_s), ROBOT, default_prior())
    found = dict(zip(LEVELS, model.no_effect_levels, strict=True))
    # A standard deviation by a thousand samples is known to 1 / sqrt(2000); in a quarter of them
    # the robot stands.
    assert found["reference_stamp_s"] == pytest.approx(off_s, rel=4 / math.sqrt(1500))
    assert found["reference_position_m"] == pytest.approx(0.0005, rel=0.3)
    assert found["contact_m_per_sqrt_m"] < 3e-4


def test_a_search_that_took_them_for_rough_contact_goes_on_from_stamps_that_are_off() -> None:
    """A robot whose camera's stamps were off by 40 ms had wheels that slip by 5 cm per root metre:
    from stamps that are hardly off no slope leads away."""
    model = MotionModel(with_stamps_off(drive(4.0), 0.04), ROBOT, default_prior())
    stuck = np.array(model.no_effect_levels)
    stuck[STAMP], stuck[CONTACT] = 3e-4, 0.02
    better = model.better_start((), stuck)
    assert better is not None
    settled = model.levels_for((), better)
    assert settled[STAMP] == pytest.approx(0.04, rel=0.2)
    assert settled[CONTACT] < 1e-3


def test_steps_that_stamps_make_under_way_are_no_leaps_of_the_reference() -> None:
    """Of 20 ms at 0.6 m/s it was said to leap by 22 to 32 mm, five times in two minutes."""
    log = with_stamps_off(drive(100.0), 0.02)
    assert with_tracking(log, ROBOT)[1].leaps == ()


def test_a_healthy_robot_whose_references_stamps_are_off_has_no_gap() -> None:
    """It was an unlisted cause, 1.00: wheels that roll 20 % too far for a quarter of a second."""
    log = with_stamps_off(drive(100.0), 0.02)
    found = diagnose_recordings([log], ROBOT, WIRE).diagnosis
    assert found.verdict == "no_gap"
    assert found.which[0].probability > 0.8
    (told,) = (note for note in found.notes if "stamp of the reference" in note)
    off_ms = float(told.split("about ")[1].split(" ms")[0])
    assert off_ms == pytest.approx(20.0, rel=0.1)


@pytest.mark.full_size
def test_of_stamps_that_are_right_nothing_is_said() -> None:
    found = diagnose_recordings([drive(100.0)], ROBOT, WIRE).diagnosis
    assert not any("stamp of the reference" in note for note in found.notes)


@pytest.mark.full_size
def test_a_cause_is_told_as_surely_beside_stamps_that_are_off() -> None:
    """0.87 where they were taken for noise of positions and headings."""
    wider = EffectSetting("wheelbase_scale", (("scale", 0.03),))
    log = with_stamps_off(drive(100.0, wider), 0.02)
    found = diagnose_recordings([log], ROBOT, WIRE).diagnosis
    assert found.verdict == "wheelbase_scale"
    assert found.which[0].probability > 0.95
