"""Tyres creep with the force on them: what turns a car is none along its wheels, and one to the
side."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from car_cases import driven
from full_size import at_full_size
from motion_cases import calibration_drive, model_of

from gap_diagnosis.motion.evidence import score
from hil_harness.effects import EffectSetting

NO_NEWS = 5.0
"""Less evidence than this [nat] is none: a pair's prior is smaller by as much."""


@pytest.mark.parametrize("seed", [1, *at_full_size(3, 4)])
def test_a_car_that_creeps_within_tolerance_has_no_gap(tmp_path: Path, seed: int) -> None:
    """Only its speeding up makes its tyres creep, in turns and on straights alike. Where the outer
    wheel had to creep more than the inner one as a turn begins, the antenna lay 8 cm farther ahead
    (8 to 14 nats), and beside it an unlisted cause was told."""
    model = driven(tmp_path, seed)
    gram = model.gram(model.no_effect_levels)
    for term in model.columns.terms:
        if term.variant.effect in {"reference_lever_arm", "lateral_slip", "longitudinal_slip"}:
            assert score(gram, [term], model.prior).log_evidence < NO_NEWS


@pytest.mark.parametrize("seed", [1, *at_full_size(3)])
def test_a_car_whose_tyres_yield_to_the_side_has_no_gap(tmp_path: Path, seed: int) -> None:
    """By 0.2 degrees per m/s² sideways, 2 degrees per g, as rear axles do. It was a lateral slip
    (56 nats), or, as it grows with the square of the speed, an unlisted cause (0.96)."""
    model = driven(tmp_path, seed, slip_angle_s2_per_m=math.radians(0.2))
    gram = model.gram(model.no_effect_levels)
    for term in model.columns.terms:
        if term.variant.effect in {"reference_lever_arm", "lateral_slip", "cross_slope_drift"}:
            assert score(gram, [term], model.prior).log_evidence < NO_NEWS


@pytest.mark.parametrize("seed", [1, *at_full_size(3)])
def test_a_car_whose_outer_tyre_is_pressed_in_turns_has_no_gap(tmp_path: Path, seed: int) -> None:
    """By 0.02 % of its radius per m/s² sideways, as load goes from the inner wheel to it: on a
    motorway as much as a track 20 % wider, at 5 m/s as one 0.6 % wider."""
    model = driven(tmp_path, seed, pressed_s2_per_m=2e-4)
    gram = model.gram(model.no_effect_levels)
    for term in model.columns.terms:
        if term.variant.effect in {"wheelbase_scale", "turn_scrub", "gyro_scale"}:
            assert score(gram, [term], model.prior).log_evidence < NO_NEWS


@pytest.mark.parametrize("seed", [1, *at_full_size(3)])
def test_a_car_with_one_larger_tyre_leads_where_its_gps_says(tmp_path: Path, seed: int) -> None:
    """Its wheels turn by 0.2 rad/s too much at 15 m/s. Where courses were told over 1.5 s headings
    were off by as much as it sped up, and about those a tyre of 2 % was an unlisted cause."""
    larger, plain = (driven(tmp_path, seed, left_larger=one).nodes.motion for one in (0.02, 0.0))
    moves = plain.speed_m_s > 1.0
    # What may be left of the noise, in either of both, and a margin for its largest of 240 s.
    assert np.abs(larger.heading_rad - plain.heading_rad)[moves].max() < 3 * 0.02


@pytest.mark.full_size
def test_wheels_that_slip_as_they_speed_up_are_told_as_large_as_that_beside_a_gyros_lag() -> None:
    """A lag within tolerance that trailed the turns as counted, and not as slipped, took a
    hundredth of the slip: one standard deviation, each time."""
    slip = EffectSetting("longitudinal_slip", (("compliance", 0.06),))
    off = []
    for seed in range(1, 7):
        model = model_of(calibration_drive(seed, slip), "longitudinal_slip")
        (term,) = model.columns.terms
        fit = model.refit((term,), model.level_prior.median)
        (sd,) = np.sqrt(np.diag(fit.scored.covariances[-1]))
        off.append((fit.coefficients[0][0] - 0.06) / sd)
    assert abs(np.mean(off)) < 2.0 / math.sqrt(len(off))
