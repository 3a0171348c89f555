"""No set of effects wins on straight lines that nobody followed."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.scenarios import scenario


def found(evidence: float, *effects: str, fitted: bool = False) -> Found:
    again = cast(Any, SimpleNamespace()) if fitted else None
    return Found(frozenset(effects), (), evidence, evidence + 3.0, np.ones(9), again)


def scan_of(*sets: Found) -> Scan:
    scan = Scan.__new__(Scan)
    scan.model = cast(MotionModel, SimpleNamespace(prior=default_prior()))
    scan.by_effect = {f"effect {place}": [] for place in range(40)}
    scan.found = {one.effects: one for one in sets}
    return scan


def test_a_set_that_was_never_fitted_again_does_not_win() -> None:
    """A line beside which every other effect shines cannot be followed for all of them."""
    scan = scan_of(
        found(0.0),
        found(12.0, "radius_scale", fitted=True),
        found(58.0, "gyro_bias", "turn_scrub"),
        found(-1.0, "gyro_scale"),
    )
    scan._hold_back_the_unfitted()
    best = max(scan.found.values(), key=lambda one: one.log_evidence)
    assert best.effects == {"radius_scale"}
    held = scan.found[frozenset({"gyro_bias", "turn_scrub"})]
    assert held.log_likelihood - held.log_evidence == 3.0
    assert scan.found[frozenset({"gyro_scale"})].log_evidence == -1.0


def test_what_a_fit_took_from_an_effect_it_takes_from_all_that_stand_beside_it() -> None:
    """Counts that get lost scatter, a wheel of another size does not: missed_ticks fell by 507 nats
    when fitted, and frame_latency + missed_ticks, which never was, won (0.39)."""
    fell = replace(found(-1.0, "missed_ticks", fitted=True), fell=507.0)
    scan = scan_of(
        found(0.0),
        fell,
        found(502.0, "radius_mismatch", fitted=True),
        found(505.8, "frame_latency", "missed_ticks"),
        found(501.5, "gyro_bias", "radius_mismatch"),
    )
    scan._hold_back_the_unfitted()
    assert scan.found[frozenset({"frame_latency", "missed_ticks"})].log_evidence < 0
    assert scan.found[frozenset({"gyro_bias", "radius_mismatch"})].log_evidence == 501.5


def test_many_pairs_on_lines_do_not_share_out_the_probability_of_one_effect() -> None:
    """A late reference lost 7.3 nats to its fit; a dozen pairs with it kept them, and together left
    it 0.20."""
    fell = replace(found(72.7, "reference_time_offset", fitted=True), fell=7.3)
    scan = scan_of(
        found(0.0),
        fell,
        *(found(75.8, "reference_time_offset", f"effect {place}") for place in range(12)),
    )
    scan._hold_back_the_unfitted()
    pairs = [one for one in scan.found.values() if len(one.effects) == 2]
    assert all(one.log_evidence == pytest.approx(75.8 - 7.3) for one in pairs)


def test_a_few_effects_on_lines_do_not_beat_many_that_were_fitted_by_the_prior_of_few() -> None:
    """Six effects that were fitted gain more than four on lines; of four there are far fewer."""
    six = tuple("abcdef")
    scan = scan_of(found(0.0), found(1034.0, *six, fitted=True), found(1028.0, *"abgh"))
    scan._hold_back_the_unfitted()
    assert max(scan.found.values(), key=scan._belief).effects == frozenset(six)


def fallen(by: float, evidence: float, *effects: str) -> Found:
    return replace(found(evidence, *effects, fitted=True), fell=by)


FELL_TWICE = (
    found(0.0),
    found(30.0, "gyro_bias", fitted=True),
    fallen(1261.0, -60.0, "wheelbase_scale"),
    fallen(1195.0, 5.0, "wheelbase_scale", "gyro_bias"),
)
FELL_TOO = fallen(1194.0, 4.0, "wheelbase_scale", "payload")


def test_what_fell_by_itself_and_beside_others_is_expected_to_fall_beside_more() -> None:
    """Seventeen sets with wheels farther apart fell by 1,200 nats in the lesson, one after another,
    at two seconds each."""
    more = found(1190.0, "wheelbase_scale", "gyro_scale")
    scan = scan_of(*FELL_TWICE, more)
    assert scan._expected(more, scan._falls()) == scan._belief(more), (
        "two sets may have fallen by chance"
    )
    assert not scan._will_fall(more)
    scan.found[FELL_TOO.effects] = FELL_TOO
    assert scan._expected(more, scan._falls()) == pytest.approx(scan._belief(more) - 1194.0)
    assert scan._will_fall(more)


def test_the_likeliest_that_is_expected_to_fall_is_fitted_once_all_the_same() -> None:
    """All others may have fallen, and it alone keep its promise."""
    promising = found(1190.0, "wheelbase_scale", "gyro_scale")
    scan = scan_of(*FELL_TWICE, FELL_TOO, promising)
    scan._looked_behind = False
    assert scan._likeliest_expected.effects == {"gyro_bias"}
    assert scan._hidden() is promising
    assert scan._hidden() is None


@pytest.mark.parametrize("kept", ["the effect by itself", "a set of two"])
def test_what_kept_its_promise_once_is_fitted_beside_others(kept: str) -> None:
    by = {"the effect by itself": (3.0, 900.0), "a set of two": (900.0, 3.0)}[kept]
    more = found(1190.0, "backlash", "gyro_scale")
    scan = scan_of(
        found(0.0),
        fallen(by[0], 30.0, "backlash"),
        fallen(by[1], 40.0, "backlash", "gyro_bias"),
        fallen(900.0, 5.0, "backlash", "payload"),
        more,
    )
    assert scan._expected(more, scan._falls()) == scan._belief(more)


def sized(evidence: float, *sizes: tuple[str, float, float, float]) -> Found:
    """Return a fitted set of effects: names, sizes, standard deviations, tolerances."""
    names, means, sds, tolerances = zip(*sizes, strict=True)
    scored = SimpleNamespace(
        means=np.array([means]), covariances=np.diag(np.square(sds))[None], weights=np.ones(1)
    )
    terms = tuple(
        SimpleNamespace(
            variant=SimpleNamespace(effect=name),
            is_fixed=False,
            weights=(((place, 1.0),),),
            tolerances=(tolerance,),
        )
        for place, (name, tolerance) in enumerate(zip(names, tolerances, strict=True))
    )
    again = cast(Any, SimpleNamespace(scored=scored))
    return replace(found(evidence, *names), terms=cast(Any, terms), refitted=again)


SLIPS = ("longitudinal_slip", 0.043, 0.001, 0.003)


@pytest.mark.parametrize(
    ("late", "worth"), [(0.0004, 713.5), (-0.0004, 713.5), (0.0012, 724.5), (0.004, 724.5)]
)
def test_what_lies_within_its_tolerance_adds_nothing_to_a_set(late: float, worth: float) -> None:
    """A gyro that was late by 0.4 ms of 2 that are tolerated gained 11 nats beside a slip, and was
    named with it (0.49)."""
    both = sized(724.5, SLIPS, ("gyro_lag", late, 0.00036, 0.002))
    scan = scan_of(found(0.0), sized(713.5, SLIPS), both)
    scan._take_what_is_tolerated()
    assert scan.found[both.effects].log_evidence == pytest.approx(worth)
    assert scan.found[frozenset({"longitudinal_slip"})].log_evidence == 713.5


def test_what_is_tolerated_is_taken_from_larger_sets_too() -> None:
    late, tilted = ("gyro_lag", 0.0004, 0.0003, 0.002), ("gyro_tilt", 0.0, 0.001, 0.02)
    three = sized(728.0, SLIPS, late, tilted)
    scan = scan_of(sized(713.5, SLIPS), sized(724.5, SLIPS, late), three)
    scan._take_what_is_tolerated()
    assert scan.found[three.effects].log_evidence == pytest.approx(713.5)


def test_what_is_tolerated_adds_nothing_as_it_bends_either(monkeypatch: pytest.MonkeyPatch) -> None:
    """A set that was brought down to its part rose above it again where its bends were worth more
    than the part's."""
    both = sized(724.5, SLIPS, ("gyro_lag", 0.0004, 0.00036, 0.002))
    scan = scan_of(found(0.0), sized(713.5, SLIPS), both)

    def as_it_bends(one: Found) -> Found:
        return replace(one, log_evidence=one.log_evidence + 2.0 * len(one.effects))

    monkeypatch.setattr(scan, "_as_it_bends", as_it_bends)
    scan._take_what_is_tolerated()
    scan._take_in_bends()
    assert scan.found[both.effects].log_evidence == pytest.approx(715.5)


def test_a_set_is_not_measured_by_a_part_that_stands_on_straight_lines() -> None:
    both = sized(724.5, SLIPS, ("gyro_lag", 0.0004, 0.00036, 0.002))
    scan = scan_of(found(700.0, "longitudinal_slip"), both)
    scan._take_what_is_tolerated()
    assert scan.found[both.effects].log_evidence == 724.5


@pytest.mark.full_size
def test_no_effect_is_judged_at_levels_that_were_found_beside_one() -> None:
    """Or every effect gains what a longer search for the noise gains."""
    log = synthetic_recording(
        ROBOT, WIRE, scenario("figure8"), (), 3, reference=ReferenceNoise(), duration_s=40.0
    )
    scan = Scan(MotionModel(log, ROBOT, default_prior()))
    nothing = scan.found[frozenset()].log_evidence
    fitted = [one for one in scan.found.values() if one.refitted is not None]
    assert fitted
    assert all(nothing >= scan._nothing_at(one.levels).log_evidence - 1e-6 for one in fitted)
