"""An edge that is told faintly has an interval as wide as its grid, not of no width."""

from __future__ import annotations

from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.effects import combine_effects, parse_effect
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario


def test_a_threshold_too_faint_to_be_sought_is_known_to_a_step_of_the_grid_at_best() -> None:
    robot = load_robot()
    faint = [
        parse_effect(f"missed_ticks.{value}")
        for value in ("side=left", "probability=0.0003", "threshold=2")
    ]
    log = synthetic_recording(
        robot,
        load_wire(),
        scenario("calibration"),
        combine_effects(tuple(faint)),
        7,
        reference=ReferenceNoise(),
        duration_s=40.0,
    )
    model = MotionModel(log, robot, default_prior())
    model.columns = type(model.columns)(
        model.columns.values,
        tuple(one for one in model.columns.terms if one.variant.effect == "missed_ticks"),
        model.columns.nuisances,
    )
    block = MotionBlock(model)
    grid = sorted({one.variant.fixed["threshold"] for one in block.scan.by_effect["missed_ticks"]})
    found = block.detail(frozenset({"missed_ticks"})).parameters["missed_ticks.threshold"]
    assert "missed_ticks" not in block.scan.spans
    assert found.sd > (grid[1] - grid[0]) / 12**0.5
