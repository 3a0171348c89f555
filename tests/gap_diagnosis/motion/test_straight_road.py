"""A car that hardly turns has no wheelbase to be told, whatever its wheels tremble."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from car_cases import read_car
from full_size import at_full_size
from motion_cases import ROBOT, WIRE
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from gap_diagnosis.motion.far_apart import BORNE_OUT
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness import Robot
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

TRACK_M, LONGER = 1.56, 0.009
OWN_LEVELS = 5.0
"""Levels are sought until a step gains less than this [nat]."""
STEP_S, FIX_S, LASTS_S = 0.012, 0.05, 60.0
HOP_M, HOP_HZ, HOP_LASTS_S, TOGETHER = 0.6e-3, 12.5, 0.05, 0.6
"""An axle that hops: how far a wheel is off its way meanwhile, and the share of both wheels."""
FIX_M, WANDER_M, WANDER_S = 0.011, 0.05, 19.0


class Gyro(NamedTuple):
    """What a gyro reads of a turn.

    Attributes:
        bias_rad_s, noise_rad_per_sqrt_s: as everywhere.
        step_rad_s: what its rate is told in multiples of; none at 0.
    """

    bias_rad_s: float
    noise_rad_per_sqrt_s: float
    step_rad_s: float = 0.0


PHONES = Gyro(-0.068, 3.5e-4)
OWN = Gyro(-0.007, 1e-4, math.radians(0.244))


def minute(
    home: Path, seed: int, gyro: Gyro = PHONES, contact_m_per_sqrt_m: float = 4e-4
) -> tuple[Recording, Robot]:
    """Return a minute on a motorway as it is read, and the car as it is described.

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
        slips = contact_m_per_sqrt_m * np.sqrt(speed / STEP_S) * rng.standard_normal(count)
        rolled = speed + side * TRACK_M * turn_rate
        wheels.append(rolled / (1.0 + LONGER) + np.gradient(trembles_m, STEP_S) + slips)
    noise = gyro.noise_rad_per_sqrt_s / math.sqrt(STEP_S) * rng.standard_normal(count)
    rate = turn_rate + gyro.bias_rad_s + noise
    if gyro.step_rad_s > 0:
        rate = np.round(rate / gyro.step_rad_s) * gyro.step_rad_s
    fixes_s = np.arange(0.0037, t_s[-1], FIX_S)
    stays = math.exp(-FIX_S / WANDER_S)
    fresh = WANDER_M * math.sqrt(1 - stays**2) * rng.standard_normal((2, len(fixes_s)))
    way = np.array([np.interp(fixes_s, t_s, one) for one in (x_m, y_m)])
    way += FIX_M * rng.standard_normal(way.shape) + lfilter([1.0], [1.0, -stays], fresh)
    rows, fixes = np.column_stack([t_s, *wheels, rate]), np.column_stack([fixes_s, *way])
    return read_car(home, TRACK_M, rows, fixes)


@pytest.mark.parametrize("seed", [1, 4])
def test_a_car_on_a_straight_road_has_no_wheelbase_to_be_told(tmp_path: Path, seed: int) -> None:
    """Wheels farther apart make all that they tremble turn it by less. Where they tremble more than
    is said, as those of a real car did, they stood 27 % farther apart, by 240 nats, and these by
    292 and 127."""
    recording, robot = minute(tmp_path, seed)
    # What turns do not bear out is less than that, at one set of levels; each fit has its own.
    assert gained_by_wheelbase(recording, robot) < BORNE_OUT + OWN_LEVELS


@pytest.mark.parametrize("seed", [1, *at_full_size(2, 3)])
def test_a_gyro_in_coarse_steps_bears_out_no_wheels_that_turn_as_it_does(
    tmp_path: Path, seed: int
) -> None:
    """A car's own yaw rate is told in steps as large as it turned. What it reads of turns by wheels
    that tremble is too little: they stood 75 % farther apart (90 %), and these 97 %, by 370."""
    recording, robot = minute(tmp_path, seed, OWN, contact_m_per_sqrt_m=1.2e-3)
    assert gained_by_wheelbase(recording, robot) < BORNE_OUT + OWN_LEVELS


@pytest.mark.full_size
def test_without_a_gyro_headings_bear_out_no_wheels_that_turn_as_they_do() -> None:
    """Along the lesson's straight wheels slip by a hundredth, now more and now less; without its
    gyro they stood 75 % farther apart beside a slope, by 269 nats."""
    log = synthetic_recording(
        ROBOT, WIRE, replace(scenario("lesson"), effects=()), (), 3,
        reference=ReferenceNoise(), contact_noise_m_per_sqrt_m=5e-4, duration_s=90.0,
    )  # fmt: skip
    blind = replace(log, gyro_code=None, gyro_rate_rad_s=None)
    scan = Scan(MotionModel(blind, ROBOT, default_prior()))
    nothing = scan.account(frozenset()).log_evidence
    for effects in (frozenset({"wheelbase_scale"}), frozenset({"wheelbase_scale", "grade_slip"})):
        assert scan.account(effects).log_evidence < nothing + OWN_LEVELS


@pytest.mark.parametrize("has_heading", [True, False])
@pytest.mark.parametrize("gyro_scale", [0.08, *at_full_size(0.0)])
@pytest.mark.parametrize("scale", [-0.2, 0.3, *at_full_size(0.15)])
def test_wheels_that_stand_far_apart_beside_a_reference_are_told_to(
    scale: float, gyro_scale: float, *, has_heading: bool
) -> None:
    """What wheels turn is what they count: the motion's turns are bent onto the reference, and by
    those no wheels stood apart (−117,917 nats for wheels 30 % wider). Nor did they beside a gyro
    that reads 8 % more (−636): what counts round off was magnified by how little of its reading
    they change."""
    effects = [EffectSetting("wheelbase_scale", (("scale", scale),))]
    effects += [EffectSetting("gyro_scale", (("scale", gyro_scale),))] * (gyro_scale > 0)
    drive = replace(scenario("figure8"), effects=())
    log = synthetic_recording(
        ROBOT, WIRE, drive, effects, 1, reference=ReferenceNoise(), duration_s=20.0
    )
    assert log.reference is not None
    if not has_heading:
        log = replace(log, reference=replace(log.reference, heading_rad=None))
    model = MotionModel(log, ROBOT, default_prior())
    by_effect = {term.variant.effect: term for term in model.columns.terms}
    wheelbase, *others = (by_effect[one.effect] for one in effects)
    as_described = model.refit(others, model.level_prior.median)
    wider = model.refit([wheelbase, *others], model.level_prior.median)
    assert wider.log_likelihood > as_described.log_likelihood + 100.0
    assert wider.coefficients[0][0] == pytest.approx(scale, abs=0.01)


def gained_by_wheelbase(recording: Recording, robot: Robot) -> float:
    """Return what wheels at another distance gain [nat], surer of their counts than they are."""
    assert recording.unsure_ticks2 is not None
    surer = replace(recording, unsure_ticks2=0.1 * recording.unsure_ticks2)
    model = MotionModel(surer, robot, default_prior())
    by_effect = {term.variant.effect: term for term in model.columns.terms}
    constants = [by_effect["gyro_bias"], by_effect["radius_scale"]]
    as_described = model.refit(constants, model.level_prior.median)
    wider = model.refit([*constants, by_effect["wheelbase_scale"]], model.level_prior.median)
    return wider.log_likelihood - as_described.log_likelihood
