"""Counts are lost above a speed of the wheel's own, which the counts that are left do not show."""

from __future__ import annotations

import math

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, nodes_of, setting_of

from gap_diagnosis.explanations.encoder import own_speed
from gap_diagnosis.explanations.registry import EXPLAINED, predict
from gap_diagnosis.explanations.variant import Value
from gap_diagnosis.motion.edges import best_edges
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.onset import windowed
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.thresholds import at_threshold, thresholds_of
from gap_diagnosis.motion.windows import windows_of
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

PROBABILITY = 0.12
CRUISES_RAD_S = 4.98


def test_a_wheel_that_counts_slower_than_the_threshold_may_be_faster() -> None:
    """At 5 % above the threshold 12 % were lost, and what was counted lay below it: of a whole
    drive none was put back."""

    def driven(*effects: EffectSetting) -> tuple[float, float, float]:
        motion = nodes_of(losing(*effects, duration_s=16.0)).smooth
        settings = setting_of(motion, "missed_ticks", values) if effects else []
        put_back = predict(motion, settings).left_rad.sum()
        return float(put_back), float(motion.left_step_rad.sum()), motion.rad_per_count

    values: dict[str, Value] = {
        "side": "left",
        "probability": PROBABILITY,
        "threshold": CRUISES_RAD_S / 1.05,
    }
    true_rad, _, per_count_rad = driven()
    put_back_rad, counted_rad, _ = driven(EffectSetting("missed_ticks", tuple(values.items())))
    lost = (true_rad - counted_rad) / per_count_rad
    assert lost > 0.8 * PROBABILITY * true_rad / per_count_rad
    by_chance_rad = math.sqrt(lost / (1.0 - PROBABILITY)) * per_count_rad
    assert abs(put_back_rad - true_rad) < 4 * by_chance_rad


def test_a_threshold_is_found_wherever_the_search_begins() -> None:
    """This log drives at 1.5 and at 5 rad/s; from above the walk uphill ended where it began."""
    values = (("side", "left"), ("probability", 0.05), ("threshold", 3.0))
    model = only_missed(losing(EffectSetting("missed_ticks", values)))
    left = [one for one in model.columns.terms if one.variant.report.get("side") == "left"]
    for term in (left[0], left[-1]):
        edged = best_edges(model, (term,), 0, ((0.02,),), model.level_prior.median)
        assert 1.5 < edged.term.variant.fixed["threshold"] < 5.0


def test_along_its_probability_counts_are_lost_where_they_were() -> None:
    """Where a little more loses them elsewhere too, a slope is as steep as the step is small: of
    0.002 it said 0.00005 as standard deviation."""
    threshold_rad_s = CRUISES_RAD_S / 1.05
    values = (("side", "left"), ("probability", PROBABILITY), ("threshold", threshold_rad_s))
    log = losing(EffectSetting("missed_ticks", values))
    motion = nodes_of(log).smooth
    ((variant, _),) = setting_of(motion, "missed_ticks", dict(values))
    about = variant.smooth_about((PROBABILITY,))
    here, near = (
        predict(motion, [(about, (size,))]).left_rad for size in (PROBABILITY, PROBABILITY + 0.01)
    )
    share = own_speed(motion, "left", PROBABILITY, threshold_rad_s).share_above
    assert share.min() == 0.0 < share.max() == 1.0
    assert here * (1 - share * PROBABILITY) == pytest.approx(
        near * (1 - share * (PROBABILITY + 0.01))
    )


def losing(*effects: EffectSetting, duration_s: float = 34.0) -> Recording:
    """Return a log that drives at 1.5 and at 5 rad/s."""
    return synthetic_recording(
        ROBOT,
        WIRE,
        scenario("calibration"),
        effects,
        3,
        reference=ReferenceNoise(),
        duration_s=duration_s,
    )


def test_lost_counts_are_worth_what_all_their_thresholds_are_on_average() -> None:
    """Told to a hundredth of a rate, the best one counted as one of the grid's seven."""
    values = (("side", "left"), ("probability", 0.05), ("threshold", 3.0))
    scan = Scan(only_missed(losing(EffectSetting("missed_ticks", values))))
    found = scan.account(frozenset({"missed_ticks"}))
    assert found.refitted is not None
    about = found.refitted.coefficients, found.refitted.levels
    known = thresholds_of(scan.model, found.terms, 0, *about)
    logs = known.log_evidence
    steps = np.diff(known.rates_rad_s)
    widths = 0.5 * (np.append(steps, 0.0) + np.append(0.0, steps))
    worth = np.exp(logs - logs.max())
    at_any_speed, from_some_on = worth[0], np.average(worth, weights=widths)
    mean = 0.5 * (at_any_speed + from_some_on)
    either_side = math.log(2)
    expected = found.refitted.log_evidence + math.log(mean) - either_side
    assert math.log(mean) < -math.log(7) - 0.6
    assert found.log_evidence == pytest.approx(expected, abs=0.5)


def test_counts_that_get_lost_from_a_moment_on_pay_for_their_threshold_and_their_window() -> None:
    """One in ten begins on the way, at any moment; whose side and which of seven thresholds it is
    costs as much as on the whole log."""
    values = (("side", "left"), ("probability", 0.2), ("threshold", 0.0), ("start_s", 20.0))
    scan = Scan(only_missed(losing(EffectSetting("missed_ticks", values))))
    found = scan.account(frozenset({"missed_ticks"}))
    assert found.refitted is not None
    assert found.terms[0].variant.fixed["start_s"] == pytest.approx(20.0, abs=0.5)
    windows = windows_of(
        scan.model, found.terms, 0, found.refitted.coefficients, found.refitted.levels
    )
    one_of = math.log(2 * 7)
    expected = found.refitted.log_evidence + windows.log_width + math.log(0.1) - one_of
    assert found.log_evidence == pytest.approx(expected, abs=0.5)


def test_counts_that_get_lost_at_any_speed_have_no_threshold_half_of_the_time_beforehand() -> None:
    """Slow speeds at which a log hardly drives were as likely: 3 of 7 intervals left out the
    threshold that was none."""
    values = (("side", "left"), ("probability", 0.01), ("threshold", 0.0))
    model = only_missed(losing(EffectSetting("missed_ticks", values)))
    term = next(one for one in model.columns.terms if one.variant.report["side"] == "left")
    start = (at_threshold(term, 0.0),), 0, ((0.01,),)
    known = thresholds_of(model, *start, model.level_prior.median)
    _, drawn = known.draw(4000, 1.0, np.random.default_rng(1))
    assert np.mean(drawn == 0.0) > 0.3
    assert drawn.max() > 0.0


def only_missed(log: Recording) -> MotionModel:
    others = frozenset(EXPLAINED) - {"missed_ticks"}
    return MotionModel(log, ROBOT, default_prior(), without=others)


def test_counts_scatter_by_chance_where_they_are_lost_and_nowhere_else() -> None:
    """A threshold that was sought off its grid kept the scatter of the grid's own: at true speeds
    a true threshold stood 9 and 12 nats below another, with its own scatter 2 and 4."""
    model = only_missed(losing())
    motion = model.nodes.motion
    for term in (one for one in model.columns.terms if one.variant.report["side"] == "left"):
        moved = at_threshold(term, 3.0)
        assert moved.variant.scatter is not None
        left, right = moved.variant.scatter(motion, 0.01, **moved.variant.fixed)
        slow = np.abs(motion.left_rate_rad_s) < 2.0
        fast = np.abs(motion.left_rate_rad_s) > 4.0
        assert not right.any()
        assert left[slow].max() < 1e-6 < left[fast & (motion.left_step_rad != 0)].min()
        window = windowed(moved.variant, 0.0, 10.0)
        assert window.scatter is not None
        inside, _ = window.scatter(motion, 0.01, **window.fixed)
        assert np.array_equal(inside[motion.t_s < 10.0], left[motion.t_s < 10.0])
        assert not inside[motion.t_s >= 10.0].any()


def test_a_threshold_may_be_anywhere_between_two_speeds_at_which_a_log_drives() -> None:
    """Between 1.5 and 5 rad/s there are ramps only, in which a few counts are lost: half a nat
    below the top was 0.02 rad/s, of a threshold that may be 2 rad/s off."""
    values = (("side", "left"), ("probability", 0.004), ("threshold", 3.0))
    model = only_missed(losing(EffectSetting("missed_ticks", values)))
    term = next(one for one in model.columns.terms if one.variant.report["side"] == "left")
    known = thresholds_of(
        model, (at_threshold(term, 3.0),), 0, ((0.004,),), model.level_prior.median
    )
    picked, drawn = known.draw(4000, 1.0, np.random.default_rng(1))
    low, high = np.quantile(drawn, [0.025, 0.975])
    assert 1.2 < low < 3.0 < high < 5.3
    assert high - low > 1.0
    sizes = [known.fits[one].coefficients[0][0] for one in np.unique(picked)]
    assert 0.003 < min(sizes) <= max(sizes) < 0.005
