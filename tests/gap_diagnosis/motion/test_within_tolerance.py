"""What lies within the description's tolerance is free in every answer, whoever may be named."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from full_size import at_full_size
from motion_cases import model_of
from scipy.ndimage import uniform_filter1d
from wandering import wandering_by

from gap_diagnosis import analysis
from gap_diagnosis.analysis import _alternatives, _at
from gap_diagnosis.hypothesis import Fit
from gap_diagnosis.motion import spells, unknown
from gap_diagnosis.motion.block import beyond
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.spells import lay_out_ways
from gap_diagnosis.motion.unknown import alternatives, beyond_tolerance, lay_out
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.scoring import best_levels
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.effects import EffectSetting, parse_effect
from hil_harness.robot import Robot, load_robot
from hil_harness.scenarios import scenario

ROBOT = load_robot()
FOR_A_WHILE = ("one_sided_slip", "radius_mismatch", "radius_scale", "wheelbase_scale")
"""What is listed of what may act for a while: an unlisted cause is none of these."""
PRECISE = ReferenceNoise(2e-4, 2e-4, 1e-4, 1e-4)


def drive_with(effect: str | EffectSetting) -> Recording:
    return synthetic_recording(
        ROBOT,
        load_wire(),
        scenario("calibration"),
        (parse_effect(effect) if isinstance(effect, str) else effect,),
        seed=5,
        reference=PRECISE,
        contact_noise_m_per_sqrt_m=3e-4,
    )


def gain_of(effect: str, model: MotionModel) -> float:
    """Return by how many nats a fitted effect explains a drive better than no effect does."""
    levels = model.levels_for((), model.level_prior.median)
    term = next(one for one in model.columns.terms if one.variant.effect == effect)
    fitted = model.refit((term,), levels, free_levels=False)
    return fitted.log_evidence - (
        model.gram(levels).log_nothing + model.level_prior.log_density(np.log(levels))
    )


def test_a_stamp_late_by_its_tolerance_is_no_news_to_a_precise_reference() -> None:
    """Where the speed changes, a delay bends the way: what is small is compared at its own size.

    Three nats are odds of 20, against prior odds of 1 in 60."""
    tolerance_s = ROBOT.tolerance.time_offset_s
    recording = drive_with(f"reference_time_offset.offset={tolerance_s}")
    assert gain_of("reference_time_offset", model_of(recording, "reference_time_offset")) < 3.0


def test_a_wheel_within_tolerance_is_no_news_though_it_may_not_be_named() -> None:
    """Else the next best name, here the reference's scale, would take it over."""
    recording = drive_with(f"radius_scale.scale={0.9 * ROBOT.tolerance.radius_scale}")
    model = model_of(recording, "reference_scale")
    assert all(one.variant.effect != "radius_scale" for one in model.columns.terms)
    assert gain_of("reference_scale", model) < 3.0


def test_a_disc_within_tolerance_is_no_unlisted_cause() -> None:
    """Of either side: an encoder a little off centre fitted a function of its angle (13 nats)."""
    tolerance = default_prior().of("encoder_eccentricity", "amplitude").tolerance
    values = (("amplitude", 0.7 * tolerance), ("phase", 2.8), ("side", "right"))
    recording = drive_with(EffectSetting("encoder_eccentricity", values))
    model = model_of(recording)
    best = alternatives(model, model.no_effect_levels)[0]
    assert best.log_evidence < 3.0


def wandering(size: float) -> Recording:
    """Return a drive whose wheels come apart by *size*, to and fro in 40 s; no effect does that."""
    log = synthetic_recording(
        ROBOT, load_wire(), scenario("calibration"), (), 3, reference=ReferenceNoise()
    )
    return wandering_by(log, size)


def levels_of_wheels_that_hold(model: MotionModel) -> np.ndarray:
    """Return levels of wheels that slip less than on any floor: else the wandering is theirs."""
    prior = model.level_prior
    is_slip = np.array(LEVELS) == "slip_wander"
    low, high = (np.where(is_slip, 1e-6, one) for one in (prior.low, prior.high))
    holding = replace(prior, low=low, high=high)
    start = np.minimum(prior.median, high)
    return best_levels(model._of_levels(()), holding, start)


def unlisted_beyond_tolerance(size: float) -> tuple[float, float]:
    """Return the best unlisted cause's evidence as it is, and beyond what may be off anyway."""
    model = model_of(wandering(size))
    found = alternatives(model, levels_of_wheels_that_hold(model))
    beyond = beyond_tolerance(found)
    return found[0].log_evidence, beyond[0].log_evidence


def test_what_wanders_within_tolerance_is_no_gap_though_it_has_no_name() -> None:
    """Three nats are odds of 20, against prior odds of 1 in 60."""
    seen, beyond = unlisted_beyond_tolerance(0.8 * ROBOT.tolerance.radius_mismatch)
    assert seen > 10
    assert beyond < 3


def test_what_wanders_by_far_more_is_a_gap() -> None:
    _, beyond = unlisted_beyond_tolerance(5 * ROBOT.tolerance.radius_mismatch)
    assert beyond > 20


def early_by(lead_s: float, robot: Robot = ROBOT) -> float:
    """Return what speaks for an unlisted cause where a gyro leads wheels that turn faster."""
    log = synthetic_recording(
        ROBOT, load_wire(), scenario("calibration"), (), 3, reference=ReferenceNoise()
    )
    wheels, tick_rad = ROBOT.plant.wheels, math.tau / ROBOT.plant.encoder.ticks_per_rev
    way_m = (log.right_ticks - log.left_ticks) * tick_rad * wheels.radius_m
    rate = uniform_filter1d(np.gradient(way_m), 15) / (wheels.wheelbase_m * log.tick_s)
    lead = lead_s * np.gradient(rate) / log.tick_s
    ahead = replace(log, gyro_rate_rad_s=log.gyro_rate_rad_s + lead)
    model = model_of(ahead, robot=robot)
    return beyond_tolerance(alternatives(model, model.no_effect_levels))[0].log_evidence


def test_a_gyro_ahead_of_the_wheels_by_the_tolerance_of_time_is_no_gap() -> None:
    """Of another engine's contact a body takes its own time: a healthy robot there was an unlisted
    gyro, .98. Three nats are odds of 20, against prior odds of 1 in 60."""
    assert early_by(ROBOT.tolerance.time_offset_s) < 3
    assert early_by(6 * ROBOT.tolerance.time_offset_s) > 20


def test_of_clocks_that_differ_more_a_gyro_may_be_further_ahead() -> None:
    loose = ROBOT.tolerance.model_copy(update={"time_offset_s": 4 * ROBOT.tolerance.time_offset_s})
    robot = replace(ROBOT, tolerance=loose)
    assert early_by(loose.time_offset_s, robot) < 3


def test_a_slope_of_four_tolerances_is_a_gap_though_it_has_no_name() -> None:
    """By as much as wheels may be off evenly, slopes may not: the half of their own tolerance is
    within it. Eight nats are odds of 3,000, against prior odds of 1 in 60."""
    tolerance = default_prior().of("grade_slip", "ratio").tolerance
    slope = EffectSetting("grade_slip", (("ratio", 4 * tolerance), ("direction", 1.0)))
    model = model_of(drive_with(slope))
    best = beyond_tolerance(alternatives(model, model.no_effect_levels))[0]
    assert best.variable == "heading"
    assert best.log_evidence > 8


def test_what_is_tolerated_wins_over_an_effect_that_explains_less() -> None:
    """Another engine's healthy robot was an unlisted wheel (125 nats of 2 mm/s that a caster's drag
    makes its tyres creep), as a scrub of one tolerance explained 28 of them."""
    model = model_of(wandering(0.8 * ROBOT.tolerance.radius_mismatch), *FOR_A_WHILE)
    motion = SimpleNamespace(
        model=model,
        levels=levels_of_wheels_that_hold(model),
        levels_of_nothing=model.level_prior.median,
        explained=5.0,
        tolerated=0.0,
        log_evidence_of_levels=lambda _: 0.0,
        dispersed=lambda *as_they_are: as_they_are,
    )
    assert _alternatives(motion, gross=False)[0].log_evidence < 3
    assert motion.tolerated > 10
    motion.explained, motion.tolerated = motion.tolerated + 10, 0.0
    assert _alternatives(motion, gross=False)[0].log_evidence > 10
    assert motion.tolerated == 0.0


def test_an_unlisted_cause_is_sought_from_the_described_levels_too() -> None:
    """Levels beside the best account had a reference wander for minutes in the place of a toe: it
    was no gap, or lost by 860 nats. From wherever a search begins, a nat is what it ends beside."""
    toe = EffectSetting("wheel_toe", (("angle", 0.002),))
    log = synthetic_recording(
        ROBOT, load_wire(), scenario("calibration"), (toe,), 3, reference=ReferenceNoise()
    )
    model = model_of(log, *FOR_A_WHILE)
    suiting = model.no_effect_levels
    wandering = suiting.copy()
    wandering[-3:] *= 2.0, 20.0, 90.0

    def height(levels: np.ndarray) -> float:
        return model.evidence_at((), levels) + model.level_prior.log_density(np.log(levels))

    def best_from(levels: np.ndarray) -> float:
        motion = SimpleNamespace(
            model=model,
            levels=levels,
            levels_of_nothing=suiting,
            explained=0.0,
            tolerated=0.0,
            log_evidence_of_levels=lambda one: height(one) - height(suiting),
            dispersed=lambda *as_they_are: as_they_are,
        )
        return _alternatives(motion, gross=False)[0].log_evidence

    assert best_from(wandering) > best_from(suiting) - 1.0


def test_columns_of_unlisted_causes_are_laid_out_once_for_all_levels(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each takes a prediction of the whole log, and levels of noise change none."""
    model = model_of(drive_with("wheel_toe.angle=0.002"), *FOR_A_WHILE)
    calls: list[int] = []

    def counted(*given: Any) -> Any:
        calls.append(1)
        return residuals(*given)

    monkeypatch.setattr(unknown, "residuals", counted)
    monkeypatch.setattr(spells, "residuals", counted)
    laid_out = [lay_out(model).values, lay_out_ways(model).values]
    free = 1 + len(model.columns.nuisances)
    columns = sum(one.shape[-1] - free for one in laid_out)
    once = len(calls)
    motion = SimpleNamespace(
        model=model,
        levels=2.0 * model.level_prior.median,
        levels_of_nothing=model.level_prior.median,
        explained=1e6,
        tolerated=0.0,
        log_evidence_of_levels=lambda _: 0.0,
        dispersed=lambda *as_they_are: as_they_are,
    )
    _alternatives(motion, gross=False)
    assert once == len(laid_out) + columns
    assert len(calls) == 2 * once


@pytest.mark.parametrize(
    ("changed", "searches"),
    [((), 1), ((0,), 2), *at_full_size(((6,), 2), ((7, 8), 2))],
    ids=["quiet", "rough floor", "moving reference", "slowly turning reference"],
)
def test_levels_are_sought_anew_only_where_some_noise_is_louder_than_described(
    monkeypatch: pytest.MonkeyPatch, changed: tuple[int, ...], searches: int
) -> None:
    """Where none is, none can stand in the place of an unlisted cause; a search from the described
    levels took a seventh of a diagnosis and ended beside the first one's end."""
    model = model_of(drive_with("wheel_toe.angle=0.002"), *FOR_A_WHILE)
    levels = 0.5 * model.level_prior.median
    levels[list(changed)] *= 5.0
    sought: list[np.ndarray] = []
    monkeypatch.setattr(
        analysis, "levels_beside", lambda _model, _one, start, _laid, **_: sought.append(start)
    )
    motion = SimpleNamespace(
        model=model,
        levels=levels,
        levels_of_nothing=model.level_prior.median,
        explained=1e6,
        tolerated=0.0,
        log_evidence_of_levels=lambda _: 0.0,
        dispersed=lambda *as_they_are: as_they_are,
    )
    _alternatives(motion, gross=False)
    assert len(sought) == searches


def test_effects_must_explain_more_than_what_is_tolerated() -> None:
    found = [beyond(125.0, Fit((), one, one)).log_evidence for one in (300.0, 28.0, -2.0)]
    assert found == [175.0, 0.0, -2.0]


def test_no_effect_takes_the_levels_that_were_found_beside_an_unlisted_cause() -> None:
    """A search for its own may have ended early: 28 nats short on a car's log."""
    model = model_of(drive_with("radius_scale.scale=0"))
    levels = model.level_prior.median
    motion = SimpleNamespace(model=model, log_evidence_of_levels=lambda _: 28.0)
    plain = alternatives(model, levels)
    better = _at(motion, levels, plain)
    assert [one.log_evidence for one in better] == [one.log_evidence for one in plain]


LATE = (
    "frame_latency",
    "gyro_lag",
    "lateral_slip",
    "reference_clock_skew",
    "reference_lever_arm",
    "reference_scale",
    "reference_time_offset",
)
"""What a late reference may pass for."""


@pytest.mark.parametrize("offset_s", [-0.011, *at_full_size(-0.008)])
def test_what_no_gap_takes_beyond_tolerance_is_fitted_whatever_a_straight_line_says(
    offset_s: float,
) -> None:
    """Four and five tolerances of a delay, on a smooth floor beside a reference of 0.03 mm: along
    the chord of 20 ms they lacked 20 to 30 nats, and were no gap; as they act they gain 44 and
    133."""
    room = ReferenceNoise(3e-5, 3e-5, 3e-5, 4e-5, 1.5, 100.0)
    late = EffectSetting("reference_time_offset", (("offset", offset_s),))
    log = synthetic_recording(
        ROBOT,
        load_wire(),
        scenario("calibration"),
        [late],
        2,
        reference=room,
        contact_noise_m_per_sqrt_m=1e-4,
        duration_s=65.0,
    )
    scan = Scan(model_of(log, *LATE))
    best = max(scan.found.values(), key=lambda one: one.log_evidence)
    assert best.effects == {"reference_time_offset"}
    assert best.log_evidence > scan.account(frozenset()).log_evidence + 20.0
