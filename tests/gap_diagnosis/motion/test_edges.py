"""Edges of windows: an effect cannot begin before the log does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.explanations.gyro import gyro_saturation
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.edges import best_edges
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

SLIP = EffectSetting(
    "one_sided_slip", (("side", "left"), ("ratio", 0.05), ("start_s", 0.0), ("stop_s", 20.0))
)


def test_a_window_that_is_open_towards_the_start_ends_where_the_log_does() -> None:
    """Before the wheels turn nothing tells when a slip began, and nothing did before the log."""
    recording = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), [SLIP], 3, reference=ReferenceNoise()
    )
    model = MotionModel(recording, ROBOT, default_prior())
    t_s = model.nodes.motion.t_s
    term = next(
        one
        for one in model.columns.terms
        if one.variant.effect == "one_sided_slip"
        and one.variant.report["side"] == "left"
        and float(one.variant.fixed["start_s"]) < 3.0
    )
    levels = model.level_prior.median
    edged = best_edges(model, (term,), 0, ((0.05,),), levels)
    turns_s = float(t_s[np.flatnonzero(model.nodes.motion.left_steady_rad)[0]])
    assert t_s[0] <= edged.term.variant.fixed["start_s"] < turns_s + 0.1
    assert edged.spans["start_s"] < 5.0


def test_a_wheel_that_slips_all_the_way_is_no_slip_but_another_wheel() -> None:
    """A right wheel 0.8 % larger on another engine's robot was a slip of -0.8 % (0.79) from where
    it began to turn to where it stopped; it is two effects, its own and that of both alike."""
    larger = [
        EffectSetting("radius_mismatch", (("mismatch", 0.008),)),
        EffectSetting("radius_scale", (("scale", 0.004),)),
    ]
    recording = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), larger, 3, reference=ReferenceNoise(), duration_s=40.0
    )
    model = MotionModel(recording, ROBOT, default_prior())
    motion = model.nodes.motion
    slips = [one for one in model.columns.terms if one.variant.effect == "one_sided_slip"]
    widest = max(slips, key=lambda one: one.variant.fixed["stop_s"] - one.variant.fixed["start_s"])
    sizes = ((-0.008 if widest.variant.report["side"] == "right" else 0.008,),)
    edged = best_edges(model, (widest,), 0, sizes, model.level_prior.median)
    for term in (*slips, edged.term):
        fixed, is_left = term.variant.fixed, term.variant.report["side"] == "left"
        way = np.abs(motion.left_step_rad if is_left else motion.right_step_rad)
        inside = (motion.t_s > fixed["start_s"]) & (motion.t_s <= fixed["stop_s"])
        assert way[inside].sum() < 0.96 * way.sum()


@pytest.mark.parametrize(("below", "above"), [(0.02, 0.02), (0.01, 0.05)])
def test_a_limit_is_worth_what_all_up_to_the_fastest_turn_are_on_average(
    below: float, above: float
) -> None:
    """Where its likelihood falls like two halves of normal laws, of either side's deviation."""
    best, fastest = 1.3, 2.0

    def evidence_about(terms: Sequence[Term], *_: object) -> SimpleNamespace:
        away = float(terms[0].variant.fixed["limit"]) - best
        return SimpleNamespace(log_evidence=-0.5 * (away / (below if away < 0 else above)) ** 2)

    motion = SimpleNamespace(turn_rate_rad_s=np.array([0.0, -fastest, 1.0]))
    model: Any = SimpleNamespace(
        nodes=SimpleNamespace(motion=motion), evidence_about=evidence_about
    )
    variant = Variant("gyro_saturation", gyro_saturation, (), {"limit": 1.25}, {"limit": 1.25})
    edged = best_edges(model, (Term(variant, (), ()),), 0, ((),), np.ones(1))
    assert edged.term.variant.fixed["limit"] == pytest.approx(best, abs=0.1 * below)
    limits, step = np.linspace(0.0, fastest, 20001, retstep=True)
    sds = np.where(limits < best, below, above)
    mean = float(np.sum(np.exp(-0.5 * ((limits - best) / sds) ** 2)) * step / fastest)
    assert edged.log_width == pytest.approx(math.log(mean), abs=0.05)
    assert edged.spans["limit"] == pytest.approx(max(below, above), rel=0.05)
