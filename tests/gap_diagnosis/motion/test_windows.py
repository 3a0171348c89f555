"""When a window began and ended is told as the log tells it: plateaus, peaks and all."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, model_of

from gap_diagnosis.explanations.choices import LEFT_OUT
from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.edges import Edged, best_edges
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.windows import SHORTEST_S, Windows, windows_of
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

FEW = ("gyro_bias", "one_sided_slip", "radius_mismatch", "radius_scale", "wheelbase_scale")
"""The effects that are asked for, but where what others cost is the question."""
RATIO = 0.02
SHARP_S = (20.303, 27.794)


def slipping(start_s: float, stop_s: float, listed: Iterable[str] = FEW) -> MotionModel:
    """Return the log of a drive on which the left wheel slips in a window."""
    window = (("start_s", start_s), ("stop_s", stop_s))
    slip = EffectSetting("one_sided_slip", (("side", "left"), ("ratio", RATIO), *window))
    return driven(slip, listed)


def told_to_the_tick() -> tuple[MotionModel, Windows]:
    """Return the log of a slip so large that both ends are known to the tick, and its windows."""
    start_s, stop_s = SHARP_S
    window = (("start_s", start_s), ("stop_s", stop_s))
    model = driven(EffectSetting("one_sided_slip", (("side", "left"), ("ratio", 0.5), *window)))
    term = nearest(model, start_s, stop_s)
    return model, windows_of(model, (term,), 0, ((0.5,),), model.level_prior.median)


def driven(effect: EffectSetting, listed: Iterable[str] = FEW) -> MotionModel:
    """Return the log of a drive with an effect."""
    recording = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("calibration"),
        [effect],
        5,
        reference=ReferenceNoise(),
        duration_s=40.0,
    )
    return model_of(recording, *listed)


def nearest(model: MotionModel, start_s: float, stop_s: float) -> Term:
    """Return the slip of the left wheel whose window on the grid is the nearest."""
    return min(
        (
            one
            for one in model.columns.terms
            if one.variant.effect == "one_sided_slip" and one.variant.report["side"] == "left"
        ),
        key=lambda one: (
            abs(one.variant.fixed["start_s"] - start_s) + abs(one.variant.fixed["stop_s"] - stop_s)
        ),
    )


def test_a_window_is_found_wherever_the_search_begins() -> None:
    """A walk uphill from a window far off ended between two manoeuvres."""
    model = slipping(20.3, 27.7)
    for begin_s in ((20.3, 27.7), (10.0, 20.0), (30.0, 40.0)):
        term = nearest(model, *begin_s)
        edged = best_edges(model, (term,), 0, ((0.5 * RATIO,),), model.level_prior.median)
        for name, true_s in (("start_s", 20.3), ("stop_s", 27.7)):
            assert edged.spans[name] < 0.5
            assert abs(edged.term.variant.fixed[name] - true_s) < 4 * edged.spans[name]


def test_where_a_wheel_stands_each_moment_of_it_may_be_the_end() -> None:
    """For its first eight seconds this robot stands."""
    model = slipping(4.0, 20.0)
    term = nearest(model, 4.0, 20.0)
    span_s = best_edges(model, (term,), 0, ((RATIO,),), model.level_prior.median).spans["start_s"]
    assert abs(span_s / (8.0 / math.sqrt(12.0)) - 1.0) < 0.1


@pytest.mark.full_size
def test_a_window_is_sought_again_where_its_effect_is_fitted() -> None:
    """At the levels of noise that it was first sought at, it ended two ticks late: 15 nats, and as
    much noise as a tick of a quarter of a wheel's way makes, for another effect to take up."""
    stop_s = 31.81
    window = (("start_s", 21.59), ("stop_s", stop_s))
    slip = EffectSetting("one_sided_slip", (("side", "left"), ("ratio", 0.25), *window))
    recording = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), [slip], 7, reference=ReferenceNoise(), duration_s=40.0
    )
    scan = Scan(model_of(recording, *FEW))
    (term,) = scan.account(frozenset({"one_sided_slip"})).terms
    assert abs(term.variant.fixed["stop_s"] - stop_s) < recording.tick_s


def test_an_end_that_is_told_to_the_tick_may_be_anywhere_in_it() -> None:
    """From the middle of its own to that of the next, all ends leave the same log; between ends
    that were compared within the tick, one in four true ends was left out."""
    model, windows = told_to_the_tick()
    start_s, stop_s, _ = windows.draw(4000, 1.0, np.random.default_rng(1))
    t_s = model.nodes.motion.t_s
    middles_s = 0.5 * (t_s[1:] + t_s[:-1])
    for drawn_s, true_s in zip((start_s, stop_s), SHARP_S, strict=True):
        above = int(np.searchsorted(middles_s, true_s))
        ends_s = middles_s[above - 1], middles_s[above]
        hundredth_s = 0.01 * model.recording.tick_s
        assert abs(drawn_s.min() - ends_s[0]) < hundredth_s
        assert abs(drawn_s.max() - ends_s[1]) < hundredth_s


def test_a_window_told_to_the_tick_is_one_of_as_many_as_there_may_be() -> None:
    """It counted as one of the grid's hundred, however narrow it was."""
    model, windows = told_to_the_tick()
    ticks = model.nodes.smooth.t_s
    way = np.cumsum(np.abs(model.nodes.smooth.left_step_rad))
    ends_s, step_s = np.linspace(ticks[0], ticks[-1], 801, retstep=True)
    until = np.interp(ends_s, ticks[-len(way) :], way)
    leaves_out = way[-1] - np.subtract.outer(until, until).T > LEFT_OUT * way[-1]
    admitted = leaves_out & (np.subtract.outer(ends_s, ends_s).T >= SHORTEST_S)
    expected = math.log(model.recording.tick_s**2 / (admitted.sum() * step_s**2))
    # Along the border of what is admitted cells are whole or none, and the likeliest tick is not
    # all there is.
    assert abs(windows.log_width - expected) < 0.1


def test_a_slip_is_worth_what_all_its_windows_are_on_average() -> None:
    """A healthy robot slipped (0.80): of 67 windows the best one gained ten nats, and half a second
    is not one in 67 of its drive."""
    scan = Scan(slipping(20.3, 27.7))
    found = scan.account(frozenset({"one_sided_slip"}))
    assert found.refitted is not None
    about = found.refitted.coefficients, found.refitted.levels
    windows = windows_of(scan.model, found.terms, 0, *about)
    either_side = math.log(2)
    expected = found.refitted.log_evidence + windows.log_width - either_side
    assert abs(found.log_evidence - expected) < 0.1


@pytest.mark.parametrize(
    ("effect", "parameter"), [("radius_mismatch", "mismatch"), ("radius_scale", "scale")]
)
def test_what_began_on_the_way_is_worth_one_in_ten_of_all_its_windows(
    effect: str, parameter: str
) -> None:
    """One wheel may change for good: then one end of its window is that of the drive. What may also
    do so for a while does either as likely."""
    at_half = EffectSetting(effect, ((parameter, 0.01), ("start_s", 20.3)))
    scan = Scan(driven(at_half))
    found = scan.account(frozenset({effect}))
    assert found.refitted is not None
    assert found.terms[0].variant.fixed["start_s"] == pytest.approx(20.3, abs=1.0)
    about = found.refitted.coefficients, found.refitted.levels
    windows = windows_of(scan.model, found.terms, 0, *about)
    expected = found.refitted.log_evidence + windows.log_width + math.log(0.1)
    assert abs(found.log_evidence - expected) < 0.1
    ends_s = windows.ends_s
    width_s = np.diff(np.concatenate([[ends_s[0]], 0.5 * (ends_s[1:] + ends_s[:-1]), ends_s[-1:]]))
    share = windows.areas / windows.areas.sum()
    is_long = np.subtract.outer(ends_s, ends_s).T >= 0.5
    for_good = np.zeros_like(share)
    for_good[:, -1] = width_s
    for_good[0] = width_s
    for_good[~is_long] = 0.0
    expected_share = for_good / for_good.sum()
    if effect == "radius_scale":
        for_a_while = np.where(is_long, np.outer(width_s, width_s), 0.0)
        expected_share = 0.5 * (expected_share + for_a_while / for_a_while.sum())
    assert share == pytest.approx(expected_share)


def test_what_may_as_well_go_on_to_the_end_of_a_log_is_told_to() -> None:
    """A track of another size from 25 s on ended at 50.7 s, where the robot came to rest."""
    onset = EffectSetting("wheelbase_scale", (("scale", -0.03), ("start_s", 25.0)))
    recording = synthetic_recording(
        ROBOT, WIRE, scenario("figure8"), [onset], 21, reference=ReferenceNoise(), duration_s=65.0
    )
    scan = Scan(model_of(recording, *FEW))
    found = scan.account(frozenset({"wheelbase_scale"}))
    assert found.refitted is not None
    end_s = float(recording.t_s[-1])
    assert found.terms[0].variant.fixed["stop_s"] == end_s
    about = found.refitted.coefficients, found.refitted.levels
    windows = windows_of(scan.model, found.terms, 0, *about)
    start_s, stop_s, _ = windows.draw(4000, 1.0, np.random.default_rng(1))
    assert start_s == pytest.approx(25.0, abs=0.2)
    # Sixty-five seconds for good are one in 130; of those it may have ended in the last 15.
    rest_s = end_s - 50.0
    odds = end_s / (4.0 * rest_s)
    assert np.mean(stop_s == end_s) == pytest.approx(odds / (1.0 + odds), abs=0.1)


def test_no_edges_are_sought_of_an_effect_that_gains_nothing_beside_a_better_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Thirty thresholds of lost counts were fitted to a slip that explains a hundred times more."""
    asked = []

    def asking(model: MotionModel, terms: tuple[Term, ...], place: int, *about: Any) -> Edged:
        asked.append(terms[place].variant.effect)
        return best_edges(model, terms, place, *about)

    monkeypatch.setattr("gap_diagnosis.motion.off_the_grid.best_edges", asking)
    monkeypatch.setattr("gap_diagnosis.motion.scan.thresholds_of", asking)
    scan = Scan(slipping(20.3, 27.7, EXPLAINED))
    singles = sorted(
        (one for one in scan.found.values() if len(one.effects) == 1),
        key=lambda one: -one.log_evidence,
    )
    ahead = [next(iter(one.effects)) for one in singles[:16]]
    assert "missed_ticks" in ahead
    assert set(asked) <= {"one_sided_slip"}


def test_of_an_unlikely_set_windows_are_told_roughly_and_never_within_a_tick() -> None:
    model = slipping(20.3, 27.7)
    block = MotionBlock(model)
    names = frozenset({"one_sided_slip"})
    close, rough = (block.detail(names, closely=one) for one in (True, False))
    for end in ("start_s", "stop_s"):
        sought, known = (one.parameters[f"one_sided_slip.{end}"] for one in (close, rough))
        assert abs(float(known.value) - float(sought.value)) < 4 * max(known.sd, sought.sd)
        assert known.sd > 0.28 * model.nodes.motion.tick_s


def test_where_no_window_promises_enough_none_is_sought_more_closely() -> None:
    """Most logs have no slip: a quarter of a diagnosis went into where it would have been."""
    model = slipping(20.3, 20.9)
    levels = model.level_prior.median
    away = nearest(model, 5.0, 10.0)
    right = next(
        one
        for one in model.columns.terms
        if one.variant.effect == "one_sided_slip" and one.variant.report["side"] == "right"
    )
    thorough = windows_of(model, (away,), 0, ((0.0,),), levels)
    quick = windows_of(model, (away,), 0, ((0.0,),), levels, worth=20.0)
    assert np.array_equal(quick.log_evidence, thorough.log_evidence)
    hopeless = windows_of(model, (right,), 0, ((0.0,),), levels, worth=1e6)
    assert len(hopeless.ends_s) < 0.5 * len(thorough.ends_s)


def test_no_slip_lasts_for_nearly_all_of_a_drive() -> None:
    """Counts lost on one side all the time were told as a slip for 95 % of the way (0.98)."""
    model = slipping(9.0, 39.0)
    term = nearest(model, 9.0, 39.0)
    windows = windows_of(model, (term,), 0, ((RATIO,),), model.level_prior.median)
    motion = model.nodes.smooth
    way = np.abs(motion.left_step_rad)
    start_s, stop_s = windows.best_s
    inside = (motion.t_s > start_s) & (motion.t_s <= stop_s)
    assert way[inside].sum() < 0.75 * way.sum()


def test_where_all_ends_are_about_as_likely_none_are_sought_without_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a reference that never turned 3261 ends were compared with each other: 34 s."""
    model = slipping(20.3, 27.7)
    term = nearest(model, 20.3, 27.7)
    all_ends = windows_of(model, (term,), 0, ((RATIO,),), model.level_prior.median).ends_s
    few = len(all_ends) // 2
    monkeypatch.setattr("gap_diagnosis.motion.windows._MOST_ENDS", few)
    windows = windows_of(model, (term,), 0, ((RATIO,),), model.level_prior.median)
    assert len(windows.ends_s) <= few
