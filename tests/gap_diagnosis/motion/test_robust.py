"""An effect that stretches of the log contradict is not as sure as its fit says."""

import math
from copy import copy
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from motion_cases import SLIP_AND_BASE, calibration_drive, model_of, some_of

from gap_diagnosis.motion import scan
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.robust import excess
from gap_diagnosis.recording import Recording


def excess_of(log: Recording, quiet: Recording, *effects: str) -> dict[str, float]:
    """Return the excess at the noise levels of a quiet log."""
    model = model_of(log, *effects)
    levels = model_of(quiet, *effects).no_effect_levels
    terms = [
        next(one for one in model.columns.terms if one.variant.effect == effect)
        for effect in effects
    ]
    return dict(excess(model, terms, model.refit(terms, levels, free_levels=False)))


@cache
def searched_once() -> scan.Scan:
    """Return the search for what slips and stands wider, and for its twin in this log."""
    log = calibration_drive(1, *SLIP_AND_BASE)
    return scan.Scan(model_of(log, "lateral_slip", "turn_scrub", "wheelbase_scale"))


def searched() -> scan.Scan:
    """Return that search with accounts of its own, which a test may change."""
    own = copy(searched_once())
    own.found, own._weighed = dict(own.found), {}
    return own


def test_effects_that_are_there_scatter_as_noise_does(size: str) -> None:
    for seed in some_of(size, (1, 2, 3), 2):
        found = excess_of(
            calibration_drive(seed, *SLIP_AND_BASE),
            calibration_drive(seed),
            "lateral_slip",
            "wheelbase_scale",
        )
        assert found == {"lateral_slip": 1.0, "wheelbase_scale": 1.0}


def test_what_a_single_place_of_the_log_says_is_said_by_no_other() -> None:
    """The reference leaps aside by a decimetre: a wider wheelbase explains a little of it."""
    log = calibration_drive(1)
    assert log.reference is not None
    late = log.reference.t_s > float(np.median(log.reference.t_s))
    leapt = replace(log.reference, y_m=log.reference.y_m + 0.1 * late)
    found = excess_of(replace(log, reference=leapt), log, "wheelbase_scale")
    assert found["wheelbase_scale"] > 2.0


def test_of_two_effects_that_are_one_in_this_log_neither_is_contradicted() -> None:
    """Their inner products have no inverse (a traceback in a trial)."""
    found = excess_of(
        calibration_drive(1, *SLIP_AND_BASE),
        calibration_drive(1),
        "lateral_slip",
        "wheelbase_scale",
        "lateral_slip",
    )
    assert found == {"lateral_slip": 1.0, "wheelbase_scale": 1.0}


def test_what_is_contradicted_is_so_in_every_fit_of_a_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """A set had all of it where a part was known along straight lines only, and again where it was
    fitted again: beside counts too many a wheelbase was 7.6 % wider (> 0.99)."""
    search = searched()
    both, base = frozenset({"lateral_slip", "wheelbase_scale"}), frozenset({"wheelbase_scale"})
    sure = search.account(both)
    assert sure.refitted is not None
    monkeypatch.setattr(scan, "excess", lambda model, terms, fit: {"lateral_slip": 1e9})
    monkeypatch.setattr(scan, "_CLEAR", math.inf)
    search.found[base] = replace(search.account(base), refitted=None, log_likelihood=-1e9)
    for _ in range(2):
        search._doubted(search.account(both))
        lacks = sure.log_likelihood - search.account(base).log_likelihood
        assert lacks > 100.0
        assert search.account(both).log_evidence == pytest.approx(sure.log_evidence - lacks)
        search._take(sure.terms, sure.refitted, sure.log_evidence - sure.refitted.log_evidence)


@pytest.mark.parametrize("is_first", [True, False])
def test_of_sets_that_explain_as_much_stretches_contradict_none_more_than_another(
    monkeypatch: pytest.MonkeyPatch, *, is_first: bool
) -> None:
    """A car's wheels larger by 0.9 % lost 14 nats of 32, and a slip uphill, which along its one
    street is the same, none of 34: it alone was told."""
    search = searched()
    both = frozenset({"lateral_slip", "wheelbase_scale"})
    twin = frozenset({"turn_scrub", "wheelbase_scale"})
    sure = search.account(both)
    search.found[twin] = replace(sure, effects=twin)
    for effects in (both, twin) if is_first else (twin, both):
        times = 1e9 if effects == both else 1.0
        monkeypatch.setattr(scan, "excess", lambda *_, times=times: {"wheelbase_scale": times})
        monkeypatch.setattr(scan, "_CLEAR", math.inf)
        search._doubted(search.found[effects])
    assert search.found[both].log_evidence == pytest.approx(sure.log_evidence)
    assert search.found[twin].log_evidence == pytest.approx(sure.log_evidence)


def test_an_effect_of_which_no_stretch_tells_is_contradicted_by_none() -> None:
    """A crash in 1 of 1,234 sealed cases."""
    data, columns = np.ones(80), np.zeros((80, 1))
    told = (data, columns, np.ones(1), {"gyro_lag": [0]})
    model = cast(MotionModel, SimpleNamespace(at_fit=lambda terms, fit: told))
    assert excess(model, [], cast(Refitted, None)) == {"gyro_lag": 1.0}
