"""A gyro that clips, or whose converter holds a bit: its constants act otherwise there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from full_size import at_full_size
from motion_cases import ROBOT, WIRE, model_of, nodes_of, without_noise

from gap_diagnosis.explanations.choices import adc_stuck_bit as variants_of_stuck_bit
from gap_diagnosis.explanations.gyro import adc_stuck_bit, chance_of_bit
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.prediction import Prediction
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.trials.drives import drive as trial_drive
from hil_harness.effects import EffectSetting
from hil_harness.robot import Robot
from hil_harness.scenarios import scenario

COMPANIONS = frozenset({"gyro_bias", "gyro_scale", "gyro_nonlinearity", "gyro_asymmetry"})


@pytest.mark.parametrize("value", [0, *at_full_size(1)])
def test_what_a_gyro_may_be_off_by_is_no_companion_of_a_stuck_bit(value: int) -> None:
    """About no effect a scale of 0.3 % bends nothing; where a bit is held it moves each step."""
    bias = 1e-4 if value == 0 else -1e-4
    effects = [
        EffectSetting("adc_stuck_bit", (("bit", 7), ("value", value))),
        EffectSetting("gyro_scale", (("scale", 0.003),)),
        EffectSetting("gyro_bias", (("bias", bias),)),
    ]
    log = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("calibration"), seed=3),
        effects,
        5,
        reference=ReferenceNoise(),
        duration_s=30.0,
    )
    block = MotionBlock(model_of(log, "adc_stuck_bit", *COMPANIONS))
    alone = block.fit(frozenset({"adc_stuck_bit"})).log_evidence
    for effect in sorted(COMPANIONS):
        both = block.fit(frozenset({"adc_stuck_bit", effect})).log_evidence
        assert both < alone + 1.0, effect


@pytest.mark.full_size
def test_wheels_that_roll_roughly_do_not_tell_which_code_a_held_bit_hides() -> None:
    """A tick's rate varies by the contact's noise of that tick: by 90 codes here, not by a few."""
    log = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("calibration"), seed=3),
        [EffectSetting("adc_stuck_bit", (("bit", 8), ("value", 1)))],
        5,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=1e-3,
        duration_s=40.0,
    )
    model = MotionModel(log, ROBOT, default_prior())
    held = [one for one in model.columns.terms if one.variant.effect == "adc_stuck_bit"]
    levels = model.no_effect_levels
    fits = {
        term.variant.fixed["contact_m_per_sqrt_m"]: model.refit([term], levels) for term in held
    }
    best = max(fits, key=lambda contact: fits[contact].log_evidence)
    assert best == 1e-3
    assert fits[best].log_evidence > fits[0.0].log_evidence + 50.0
    # With that, jumps are noise of their own: a held bit makes no noisy gyro.
    noise = LEVELS.index("gyro_noise_rad_per_sqrt_s")
    assert fits[best].levels[noise] < 0.7 * fits[0.0].levels[noise]


@pytest.mark.parametrize(("bit", "value"), [(7, 0), *at_full_size((8, 1))])
def test_a_stuck_bit_makes_no_noisy_gyro(bit: int, value: int) -> None:
    """How it makes codes jump is known in the mean only: what that leaves was a noise of seven
    times the described one, named beside the bit (9 nats, 1.0 in three of eleven sealed cases)."""
    stuck = EffectSetting("adc_stuck_bit", (("bit", bit), ("value", value)))
    model = MotionModel(squares(stuck), ROBOT, default_prior())
    some = tuple(one for one in model.columns.terms if one.variant.effect == "adc_stuck_bit")
    model.columns = replace(model.columns, terms=some)
    block = MotionBlock(model)
    alone = block.fit(frozenset({"adc_stuck_bit"})).log_evidence
    for noise in ("gyro_noise", "gyro_bias_walk"):
        assert block.fit(frozenset({"adc_stuck_bit", noise})).log_evidence < alone


@pytest.mark.parametrize(("bit", "value"), [(6, 0), (7, 1)])
def test_a_held_bit_hides_codes_as_sharp_as_the_counters_tell_them(bit: int, value: int) -> None:
    """While a robot begins to turn, a smooth rate has other codes than there are."""
    stuck = EffectSetting("adc_stuck_bit", (("bit", bit), ("value", value)))
    robot = without_noise(ROBOT)
    held, plain = (squares(*some, robot=robot) for some in ((stuck,), ()))
    assert held.gyro_code is not None
    assert plain.gyro_code is not None
    motion = nodes_of(held, robot).smooth
    told = Prediction(motion)
    adc_stuck_bit(told, bit=bit, value=value, contact_m_per_sqrt_m=0.0)
    per_rad_s = motion.gyro_sensitivity_lsb_per_rad_s
    added = held.gyro_code - plain.gyro_code
    sharp = (told.gyro_rad_s - motion.turn_rate_rad_s) * per_rad_s
    code = motion.gyro_zero_rate_code + per_rad_s * motion.turn_rate_rad_s
    chance = chance_of_bit(code, np.full(len(code), motion.gyro_noise_lsb), bit)
    smooth = (1 << bit) * ((1.0 - chance) if value else -chance)
    turning_in = np.abs(np.gradient(code)) > 30.0
    assert turning_in.sum() > 300
    left, smooth_left = ((added - one)[turning_in].std() for one in (sharp, smooth))
    assert left < 0.9 * smooth_left


def squares(*effects: EffectSetting, robot: Robot = ROBOT) -> Recording:
    driven = trial_drive("squares", np.random.default_rng(4), 0.6)
    return synthetic_recording(robot, WIRE, driven, effects, 5, reference=ReferenceNoise())


def test_what_stands_in_for_lost_codes_contradicts_no_held_bit() -> None:
    log = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("calibration"), seed=3),
        [EffectSetting("adc_stuck_bit", (("bit", 6), ("value", 1)))],
        5,
        reference=None,
        duration_s=20.0,
    )
    assert log.gyro_code is not None
    lost = np.arange(len(log.t_s)) % 17 == 9
    log = replace(log, gyro_code=np.where(lost, np.nan, log.gyro_code))
    terms = MotionModel(log, ROBOT, default_prior()).columns.terms
    held = {one.variant.fixed["bit"] for one in terms if one.variant.effect == "adc_stuck_bit"}
    assert 6 in held


@pytest.mark.parametrize("begins_s", [None, 12.0])
def test_frames_that_are_lost_do_not_tell_when_a_bit_was_stuck(begins_s: float | None) -> None:
    """What is put in between two codes need not have the bit that both have."""
    window = () if begins_s is None else (("start_s", begins_s),)
    stuck = EffectSetting("adc_stuck_bit", (("bit", 6), ("value", 1), *window))
    log = squares(stuck)
    assert log.gyro_code is not None
    lost = np.random.default_rng(1).random(len(log.t_s)) < 0.1
    lost &= (log.t_s > 14.0) & (log.t_s < 20.0)
    log = replace(log, gyro_code=np.where(lost, np.nan, log.gyro_code))
    told_s = [
        one.fixed.get("start_s", 0.0)
        for one in variants_of_stuck_bit(nodes_of(log).motion)
        if (one.fixed["bit"], one.fixed["value"]) == (6, 1)
    ]
    assert told_s == pytest.approx([begins_s or 0.0] * len(told_s), abs=0.1)
