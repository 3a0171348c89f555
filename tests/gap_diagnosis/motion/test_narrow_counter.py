"""Beside a counter narrower than described other effects look as beside a wide one."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.explanations.registry import predict
from gap_diagnosis.motion.astray import astray
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

NARROW = EffectSetting("encoder_wrap", (("bits", 12),))


BETWEEN_TICKS = ReferenceNoise(rate_hz=70.0)


@cache
def model_of(*settings: EffectSetting, reference: ReferenceNoise | None = None) -> MotionModel:
    log = synthetic_recording(
        ROBOT, WIRE, scenario("figure8"), settings, 5, reference=reference, duration_s=20.0
    )
    return MotionModel(log, ROBOT, default_prior())


@pytest.mark.parametrize("effect", ["missed_ticks", "radius_mismatch", "wheelbase_scale"])
def test_no_effect_scales_what_a_counter_jumps(effect: str) -> None:
    """Of 4,096 counts a part in a thousand is more than an effect of that size ever shows."""
    wide, narrow = model_of(), model_of(NARROW)
    for model in (wide, narrow):
        assert (model.nodes.motion.wrap_bits > 0) == (model is narrow)
    columns = []
    for model in (wide, narrow):
        term = next(one for one in model.columns.terms if one.variant.effect == effect)
        (((index, _), *_),) = term.weights
        columns.append(model.columns.values[..., index + 1])
    np.testing.assert_allclose(columns[1], columns[0], atol=1e-9 * np.nanmax(np.abs(columns[0])))


def test_no_effect_varies_by_what_a_counter_jumps() -> None:
    """A track 0.3 % too wide, within tolerance, bought as much noise as 8,192 counts are large: it
    was named beside the wrap, 0.999."""
    made = []
    for model in (model_of(), model_of(NARROW)):
        wider = next(
            t.variant for t in model.columns.terms if t.variant.effect == "wheelbase_scale"
        )
        made.append(astray(model.nodes, [(wider, (0.003,))], np.inf))
    np.testing.assert_allclose(made[1], made[0], atol=1e-9)


def test_counts_are_lost_before_the_counter_wraps() -> None:
    wide, narrow = model_of(), model_of(NARROW)
    (wrap,) = (t.variant for t in narrow.columns.terms if t.variant.effect == "encoder_wrap")
    lost = next(t.variant for t in narrow.columns.terms if t.variant.effect == "missed_ticks")
    both = predict(narrow.nodes.motion, [(lost, (0.01,)), (wrap, ())])
    alone = predict(wide.nodes.motion, [(lost, (0.01,))])
    np.testing.assert_allclose(both.left_rad, alone.left_rad, atol=1e-9)


def test_a_sample_between_two_ticks_is_moved_along_no_jump() -> None:
    """A wheel that jumps by 4,096 counts between them was laid there half a turn farther."""
    wide, narrow = (model_of(*has, reference=BETWEEN_TICKS) for has in ((), (NARROW,)))
    for seen, wanted in zip(
        narrow.nodes.described_at_samples, wide.nodes.described_at_samples, strict=True
    ):
        np.testing.assert_allclose(seen, wanted, atol=1e-9)
