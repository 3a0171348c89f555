"""A size is told with the side that it is of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario


def test_where_either_side_may_count_wrongly_both_of_their_rates_are_likely() -> None:
    """The gyro alone hardly tells counts too many on the left from as many too few on the right."""
    stray = EffectSetting("extra_ticks", (("side", "left"), ("rate", 1.5)))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("figure8"), (stray,), 4, reference=None, duration_s=20.0
    )
    model = MotionModel(log, ROBOT, default_prior())
    own = tuple(one for one in model.columns.terms if one.variant.effect == "extra_ticks")
    model.columns = replace(model.columns, terms=own)
    found = MotionBlock(model).detail(frozenset({"extra_ticks"})).parameters
    sides = found["extra_ticks.side"].probabilities
    assert sides is not None
    assert min(sides.values()) > 0.1
    rates = np.asarray(found["extra_ticks.rate"].samples)
    assert np.mean(rates > 0.0) == pytest.approx(sides["left"], abs=0.1)
