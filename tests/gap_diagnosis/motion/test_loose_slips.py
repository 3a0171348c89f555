"""A wheel on ice slips by more and by less all the time, and is told to slip all the same."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, moved_only, without_others

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.slips import SLIP, is_a_slip, loose
from gap_diagnosis.motion.windows import at_window
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.result_parts import NumberEstimate
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.scenarios import scenario

LASTS_S = 0.3
"""Correlation time of the slip."""
SOUGHT = {
    "longitudinal_slip",
    "one_sided_slip",
    "radius_mismatch",
    "turn_scrub",
    "wheelbase_scale",
}
"""What is asked of wheels that slip, and what might be told beside it."""


def slipping_loosely(
    name: str, start_s: float, stop_s: float, ratio: float, spread: float, seed: int
) -> tuple[Recording, float]:
    """Return a drive whose left wheel counts what it slips by, a share of its way that wanders, and
    by what share it slipped in all."""
    recording = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario(name), effects=()),
        [],
        seed,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
        duration_s=36.0,
    )
    random = np.random.default_rng(seed)
    away = np.zeros(len(recording.t_s))
    keep = np.exp(-0.01 / LASTS_S)
    for k in range(1, len(away)):
        away[k] = keep * away[k - 1] + np.sqrt(1 - keep**2) * random.standard_normal()
    inside = (recording.t_s > start_s) & (recording.t_s <= stop_s)
    share = np.where(inside, np.clip(ratio + spread * away, -0.5, 0.9), 0.0)
    steps = np.diff(recording.left_ticks, prepend=recording.left_ticks[0])
    slipped = np.rint(np.cumsum(steps * share / (1 - share)))
    log = replace(recording, left_ticks=recording.left_ticks + slipped)
    went = float(steps[inside].sum())
    return log, 1.0 - went / (went + float(slipped[-1]))


@pytest.mark.full_size
def test_a_wheel_that_slips_now_more_and_now_less_is_told_to_slip_and_when(size: str) -> None:
    """A third more or less each third of a second: contact that is rough at times was told, without
    a name (> 0.99)."""
    start_s, stop_s = 18.9, 23.4
    log, slipped = slipping_loosely("figure8", start_s, stop_s, 0.3, 0.1, seed=2)
    others = without_others(size, SOUGHT)
    found = diagnose_recordings([moved_only(log)], ROBOT, WIRE, without=others).diagnosis
    assert found.verdict == "one_sided_slip"
    told = {key.split(".")[1]: one for key, one in found.which[0].parameters.items()}
    assert told["side"].estimate == "left"
    for key, true in (("start_s", start_s), ("stop_s", stop_s), ("ratio", slipped)):
        one = told[key]
        assert isinstance(one, NumberEstimate)
        # Three intervals of 95 % would miss in one log of seven; so wide ones in one of a hundred.
        half = 0.5 * (one.ci95[1] - one.ci95[0])
        assert abs(one.estimate - true) < 1.5 * half


def fit_of(began: float, mean: float, sd: float) -> Refitted:
    scored = SimpleNamespace(
        weights=np.array([0.25, 0.75]),
        means=np.full((2, 1), mean),
        covariances=np.full((2, 1, 1), sd**2),
    )
    return cast(Refitted, SimpleNamespace(scored=scored, coefficients=((began,),)))


def test_a_loose_slip_goes_one_way_by_where_its_fit_ends_and_as_surely_as_the_log_lets() -> None:
    """A lawnmower's wheel slipped by -3 % (-83 to 66) for 8 s, 91 %."""
    assert is_a_slip(fit_of(0.3, 0.3, 0.1), 0)
    assert is_a_slip(fit_of(-0.3, -0.3, 0.1), 0)
    assert not is_a_slip(fit_of(0.47, -0.02, 0.05), 0), "the fit went on to no slip at all"
    assert not is_a_slip(fit_of(0.47, 0.47, 0.1), 0, dispersion=20.0)


def test_a_slip_that_goes_to_and_fro_as_the_log_scatters_is_as_steady_as_before() -> None:
    log, _ = slipping_loosely("calibration", 15.2, 19.7, 0.25, 0.1, seed=2)
    model = MotionModel(log, ROBOT, default_prior())
    steady = next(one for one in model.columns.terms if one.variant.effect == SLIP)
    other = next(one for one in model.columns.terms if one.variant.effect == "radius_mismatch")
    (shaky, *_) = loose(at_window(steady, 15.0, 19.7))

    def found(evidence: float, *terms: Term, fit: Refitted | None = None) -> Found:
        effects = frozenset(term.variant.effect for term in terms)
        return Found(effects, terms, evidence, evidence, np.ones(9), fit)

    alone, beside = frozenset({SLIP}), frozenset({SLIP, "radius_mismatch"})
    scan = Scan.__new__(Scan)
    scan.dispersion = 20.0
    scan._weighed, scan._steady = {}, {alone: found(184.0, steady)}
    scan.found = {
        frozenset(): found(0.0),
        alone: found(947.0, shaky, fit=fit_of(0.47, 0.47, 0.1)),
        beside: found(950.0, shaky, other),
    }
    scan._held_to_one_way()
    assert scan.found[alone].log_evidence == 184.0
    assert beside not in scan.found, "on lines of a slip that is none"
    scan.dispersion = 2.0
    scan.found[alone] = found(947.0, shaky, fit=fit_of(0.47, 0.47, 0.1))
    scan._held_to_one_way()
    assert scan.found[alone].log_evidence == 947.0


def test_a_second_is_too_short_to_slip_now_more_and_now_less() -> None:
    """A push that turned the robot was a gyro that vibrates and half a second of slip (> 0.99)."""
    log, _ = slipping_loosely("calibration", 15.2, 19.7, 0.25, 0.1, seed=2)
    model = MotionModel(log, ROBOT, default_prior())
    term = next(one for one in model.columns.terms if one.variant.effect == SLIP)
    assert len(loose(at_window(term, 15.0, 16.0))) == 0
    assert len(loose(at_window(term, 15.0, 17.0))) > 0
