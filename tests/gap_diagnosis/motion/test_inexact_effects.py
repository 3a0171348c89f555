"""Tyres are not exact: what they do otherwise in every turn is told all the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, Floats, moved_only, without_others

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.whitening import INEXACT, LEVELS
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.result_parts import NumberEstimate
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.scenarios import scenario

WANDER = LEVELS.index("slip_wander")
LASTS_S = 1.0
"""How long a wheel scrubs more, or less, than on average."""
SOUGHT = {
    "gyro_scale",
    "lateral_slip",
    "one_sided_slip",
    "radius_mismatch",
    "turn_scrub",
    "wheelbase_scale",
}
"""What is asked of such a track, and what might be told of it, or beside it."""


def scrubbing(name: str, scale: float, spread: float, seed: int) -> Recording:
    """Return a drive of a robot whose track is wider by *scale* on average, which each wheel by
    itself makes larger or smaller for a second or so, by a share of it of standard deviation
    *spread*."""
    recording = synthetic_recording(
        ROBOT, WIRE, replace(scenario(name), effects=()), [], seed, reference=ReferenceNoise()
    )
    random = np.random.default_rng(seed)
    steps = [
        np.diff(ticks, prepend=ticks[0]) for ticks in (recording.left_ticks, recording.right_ticks)
    ]
    turning = 0.5 * (steps[1] - steps[0])
    left, right = (
        ticks + np.rint(np.cumsum(side * turning * scale * (1 + spread * wandering(random, ticks))))
        for side, ticks in ((-1, recording.left_ticks), (1, recording.right_ticks))
    )
    return replace(recording, left_ticks=left, right_ticks=right)


def wandering(random: np.random.Generator, like: Floats) -> Floats:
    """Return unit noise that lasts for LASTS_S, as long as *like* is."""
    away = np.zeros(len(like))
    keep = np.exp(-0.01 / LASTS_S)
    for k in range(1, len(away)):
        away[k] = keep * away[k - 1] + np.sqrt(1 - keep**2) * random.standard_normal()
    return away


@pytest.mark.full_size
def test_a_track_that_each_turn_makes_wider_by_another_share_is_told_alone(size: str) -> None:
    """A slip on one side was told beside it (> 0.99)."""
    log = scrubbing("figure8", 0.03, 0.4, seed=1)
    others = without_others(size, SOUGHT)
    found = diagnose_recordings([moved_only(log)], ROBOT, WIRE, without=others).diagnosis
    assert found.verdict == "wheelbase_scale"
    (told,) = found.which[0].parameters.values()
    assert isinstance(told, NumberEstimate)
    assert told.ci95[0] < 0.03 < told.ci95[1]


def test_an_effect_that_does_not_vary_is_told_as_sharply_as_if_none_could() -> None:
    log = scrubbing("figure8", 0.03, 0.0, seed=1)
    model = MotionModel(log, ROBOT, default_prior())
    (track,) = (one for one in model.columns.terms if one.variant.effect == "wheelbase_scale")
    free = model.refit((track,), model.no_effect_levels)
    exact = free.levels.copy()
    exact[INEXACT] = 1e-6
    fixed = model.refit((track,), exact, free_levels=False)
    sds = [np.sqrt(one.scored.covariances[0, 0, 0]) for one in (free, fixed)]
    assert sds[0] < 1.05 * sds[1]


def astray_m(log: Recording, scale: float) -> float:
    """Return how far a track wider by *scale* is taken to lead a wheel astray, RMS of a block."""
    model = MotionModel(log, ROBOT, default_prior())
    (track,) = (one for one in model.columns.terms if one.variant.effect == "wheelbase_scale")
    course = model.scattered((track,), ((scale,),), model.level_prior.median)
    return float(np.sqrt(np.mean(course.left_astray_m**2)))


def test_effects_vary_by_no_more_than_the_log_shows_of_them() -> None:
    """A Kobuki's track was wider by 23 %, its gyro's scale off by 41 %, for the noise that this
    bought where both were off by 3.5 %."""
    shown, hidden = (scrubbing("figure8", scale, 0.0, seed=1) for scale in (0.03, 0.0))
    assert astray_m(shown, 0.3) < 1.2 * astray_m(shown, 0.03)
    assert astray_m(hidden, 0.3) < 0.3 * astray_m(shown, 0.03)


@pytest.mark.parametrize("effect", ["longitudinal_slip", "turn_scrub", "wheelbase_scale"])
def test_next_to_nothing_of_an_effect_is_as_likely_as_nothing(effect: str) -> None:
    """A slip of the wheels' own went with the sign of the effect, however little that was: what
    wheels creep between one stop and the next told healthy robots of a slip while speeding up (29
    nats of a millionth of it, 0.97)."""
    model = MotionModel(scrubbing("square", 0.0, 0.0, seed=1), ROBOT, default_prior())
    term = next(one for one in model.columns.terms if one.variant.effect == effect)
    levels = model.level_prior.median.copy()
    levels[WANDER] = 0.003

    def likelihood(size: float) -> float:
        terms, sizes = (term,), ((size,),)
        return model.likelihood(terms, sizes, levels, model.scattered(terms, sizes, levels))

    assert likelihood(1e-6) == pytest.approx(likelihood(0.0), abs=0.1)
    assert likelihood(-1e-6) == pytest.approx(likelihood(0.0), abs=0.1)


def test_a_gyro_alone_does_not_show_that_effects_of_wheels_vary() -> None:
    log = scrubbing("figure8", 0.03, 0.4, seed=1)
    assert astray_m(log, 0.03) > 0.0
    assert astray_m(replace(log, reference=None), 0.03) == 0.0
