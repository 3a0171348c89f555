"""Quiet drives with one effect, and the effect as the diagnosis explains it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations.registry import EXPLAINED, predict
from gap_diagnosis.explanations.variant import Setting, Value
from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.blocks import course_of
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.levels import level_prior
from gap_diagnosis.motion.missing import filled
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import Nodes, make_nodes, residuals
from gap_diagnosis.motion.offset import coarse_delay_s
from gap_diagnosis.motion.whitening import LEVELS as NAMES
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.prediction import Motion
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness import load_robot, load_wire
from hil_harness.effects import EffectSetting, catalogue
from hil_harness.robot import Robot
from hil_harness.scenarios import scenario

Floats = NDArray[np.float64]
Case = TypeVar("Case")

ROBOT = load_robot()
WIRE = load_wire()
_PRIOR = level_prior(ROBOT)
LEVELS = np.where(np.array(NAMES) == "slip_wander", _PRIOR.low, _PRIOR.median)
"""The usual noise of wheels that do not slip: none here does."""
UNTOLD: Mapping[str, Any] = {
    **dict.fromkeys(
        (
            "temperature_k", "supply_v", "v_command_m_s", "w_command_rad_s",
            "odometry_x_m", "odometry_y_m", "odometry_heading_rad",
        )
    ),
    "frames": {},
}  # fmt: skip
"""What a table of counts and a gyro does not hold."""
EXACT = ReferenceNoise(0.0, 0.0, 0.0, 0.0)
SLIP_AND_BASE = (
    EffectSetting("lateral_slip", (("compliance", 0.02),)),
    EffectSetting("wheelbase_scale", (("scale", 0.01),)),
)


def some_of(size: str, cases: Sequence[Case], count: int = 1) -> Sequence[Case]:
    """Return the first *count* cases of one and the same claim; at the full size all."""
    return cases if size == "full" else cases[:count]


def without_others(size: str, named: Set[str]) -> frozenset[str]:
    """Return what a library lacks of which these alone are asked; at the full size it is whole."""
    return frozenset() if size == "full" else frozenset(catalogue()) - named


def without_noise(robot: Robot) -> Robot:
    """Return the robot with nothing random in it but the rounding of counts and codes."""
    plant = robot.plant
    still = {"noise_density_rad_per_sqrt_s": 0.0, "bias_walk_density_rad_s_per_sqrt_s": 0.0}
    quiet = {
        "gyro": plant.gyro.model_copy(update=still),
        "encoder": plant.encoder.model_copy(update={"noise_ticks": 0.0}),
        "contact": plant.contact.model_copy(update={"noise_m_per_sqrt_m": 0.0}),
    }
    return replace(robot, plant=plant.model_copy(update=quiet))


def coarse_table(
    drive: str,
    ticks_a_row: int,
    *,
    late_rows: int = 0,
    of_the_moment: bool = False,
    **effects: Mapping[str, float],
) -> Recording:
    """Return a drive as a table has it whose rows last some ticks, its gyro standing rows too late:
    means since the row before, or of the row's own last tick alone."""
    whole = synthetic_recording(
        ROBOT,
        WIRE,
        scenario(drive),
        [EffectSetting(name, tuple(values.items())) for name, values in effects.items()],
        seed=3,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=3e-4,
        duration_s=60.0,
    )
    rows = len(whole.t_s) // ticks_a_row
    ticks = rows * ticks_a_row
    assert whole.gyro_rate_rad_s is not None
    rates = filled(whole.gyro_rate_rad_s, whole.t_s)[:ticks].reshape(rows, ticks_a_row)
    rate = rates[:, -1] if of_the_moment else rates.mean(axis=1)
    rate = np.concatenate([np.repeat(rate[:1], late_rows), rate[: rows - late_rows]])
    told = ("t_s", "stamp_s", "left_ticks", "right_ticks")
    said = {name: getattr(whole, name)[ticks_a_row - 1 : ticks : ticks_a_row] for name in told}
    return replace(
        whole,
        **said,
        **UNTOLD,
        gyro_code=None,
        tick=np.arange(rows),
        tick_period_s=0.01 * ticks_a_row,
        gyro_rate_rad_s=rate,
    )


def nodes_of(recording: Recording, robot: Robot = ROBOT) -> Nodes:
    """Return a recording in blocks, about its estimated motion."""
    delay_s = coarse_delay_s(recording, robot)
    motion = estimate_motion(recording, robot, reference_delay_s=delay_s)
    return make_nodes(motion, recording.reference, np.ones(len(motion.t_s), dtype=np.bool_))


def model_of(log: Recording, *listed: str, robot: Robot = ROBOT) -> MotionModel:
    """Return the model of a log by a library of these effects alone.

    What lies within tolerance is free in it all the same, and causes without a name are weighed as
    beside any other.
    """
    return MotionModel(log, robot, default_prior(), without=frozenset(EXPLAINED).difference(listed))


def nothing_of(model: MotionModel, levels: Floats | None = None) -> Found:
    """Return the account of no effect, at the noise levels that suit it or at others."""
    levels = model.no_effect_levels if levels is None else levels
    evidence = model.evidence_at((), levels) + model.level_prior.log_density(np.log(levels))
    return Found(frozenset(), (), evidence, evidence, levels)


def moved_only(log: Recording) -> Recording:
    """Return a log without what the robot was told and what it said of itself: what the drive and
    the firmware leave over takes as long as a search, and is not asked for."""
    return replace(
        log,
        v_command_m_s=None,
        w_command_rad_s=None,
        odometry_x_m=None,
        odometry_y_m=None,
        odometry_heading_rad=None,
    )


def misfit(
    recording: Recording,
    explain: Callable[[Motion], Sequence[Setting]] = lambda motion: (),
    robot: Robot = ROBOT,
) -> Floats:
    """Return the whitened residual of a recording with effects explained."""
    nodes = nodes_of(recording, robot)
    left = residuals(nodes, predict(nodes.motion, explain(nodes.motion)))
    columns = np.ascontiguousarray(left[..., np.newaxis])
    return whiten(columns, course_of(nodes, 0.0), LEVELS, nodes.ticks)[0][:, 0]


def setting_of(motion: Motion, effect: str, values: Mapping[str, Value]) -> list[Setting]:
    """Return an effect with the catalogue's parameters as a variant with coefficients."""
    choices = ("side", "bit", "value", "signal", "factor")
    variant = next(
        one
        for one in EXPLAINED[effect].variants(motion)
        if all(one.report.get(name, values.get(name)) == values.get(name) for name in choices)
    )
    fixed = {name: float(values.get(name, known)) for name, known in variant.fixed.items()}
    if variant.effect == "adc_stuck_bit":
        fixed = dict(variant.fixed)
    variant = replace(variant, fixed=fixed)
    if variant.polar is None:
        return [(variant, tuple(float(values[name]) for name in variant.coefficients))]
    size, angle = (float(values[name]) for name in variant.polar)
    turned = np.array([variant.polar_turn(1.0, 0.0), variant.polar_turn(0.0, 1.0)]).T
    wanted = size * np.array([math.cos(angle), math.sin(angle)])
    return [(variant, tuple(float(one) for one in np.linalg.solve(turned, wanted)))]


def calibration_drive(seed: int, *effects: EffectSetting) -> Recording:
    """Return the log of a calibration drive with an ordinary reference."""
    return synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), effects, seed, reference=ReferenceNoise()
    )
