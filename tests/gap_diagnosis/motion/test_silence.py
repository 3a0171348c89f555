"""While no frame comes the counts go on, and what the gyro said is lost."""

import numpy as np

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.effects import EffectSetting
from hil_harness.robot import load_robot
from hil_harness.scenarios.named import square

START_S, STOP_S = 13.1, 13.7
"""The robot begins to turn in between."""


def test_a_silence_in_a_turn_neither_bends_the_way_nor_turns_the_gyro_from_the_wheels() -> None:
    robot, wire = load_robot(), load_wire()
    gap = EffectSetting("bus_gap", (("start_s", START_S), ("stop_s", STOP_S)))
    recording = synthetic_recording(
        robot, wire, square(), (gap,), 1, duration_s=16.0, reference=ReferenceNoise()
    )
    model = MotionModel(recording, robot, default_prior())
    t_s = model.nodes.motion.t_s[model.nodes.starts]
    off = model.columns.values[..., 0]
    inside = (t_s > START_S + 0.06) & (t_s < STOP_S - 0.06)
    before = (t_s > START_S - 1.0) & (t_s < START_S - 0.1)
    after = (t_s > STOP_S + 0.1) & (t_s < STOP_S + 1.0)
    assert np.isnan(off[:, inside]).all()
    steps = np.abs(np.nanmean(off[:, after], axis=1) - np.nanmean(off[:, before], axis=1))
    assert steps.max() < 0.005, steps
