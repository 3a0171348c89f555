"""A wheel that stands is no dead encoder."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from full_size import at_full_size
from motion_cases import ROBOT, WIRE

from gap_diagnosis.clock_setting import with_clock_set
from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.gross import looks_gross
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

WHOLE = synthetic_recording(ROBOT, WIRE, scenario("figure8"), (), 5, reference=None)
LASTS_S = WHOLE.t_s[-1] - WHOLE.t_s[0]


def standing(start_s: float, stop_s: float) -> Recording:
    """Return the log with a left count that stands from one time to another."""
    step = np.diff(WHOLE.left_ticks, prepend=WHOLE.left_ticks[0])
    step[(WHOLE.t_s > start_s) & (WHOLE.t_s <= stop_s)] = 0.0
    return replace(WHOLE, left_ticks=WHOLE.left_ticks[0] + np.cumsum(step))


def found(recording: Recording) -> list[Variant]:
    """Return the ways in which an encoder may be dead in the log."""
    return list(EXPLAINED["encoder_dead"].variants(estimate_motion(recording, ROBOT)))


def test_a_count_that_goes_on_was_dead_where_the_gyro_says_that_its_wheel_turned() -> None:
    (dead,) = found(standing(0.3 * LASTS_S, 0.8 * LASTS_S))
    assert dead.report["side"] == "left"
    assert dead.fixed["start_s"] == pytest.approx(0.3 * LASTS_S, abs=0.05)
    assert dead.fixed["stop_s"] == pytest.approx(0.8 * LASTS_S, abs=0.05)
    first_s, last_s = dead.told["start_s"]
    assert first_s - 0.01 <= 0.3 * LASTS_S <= last_s
    assert last_s < 0.3 * LASTS_S + 0.2


@pytest.mark.parametrize("side", ["left", *at_full_size("right")])
@pytest.mark.parametrize("name", ["square", *at_full_size("figure8")])
def test_without_a_gyro_the_reference_tells_what_its_wheel_did(name: str, side: str) -> None:
    """Of five runs of a recorded robot with a count that stands from 60 % on, two were a wrong
    factor or another track; a clock drifted, or was never set, along the one wheel left."""
    died = EffectSetting("encoder_dead", (("side", side), ("start_s", 45.0)))
    log = synthetic_recording(
        ROBOT, WIRE, replace(scenario(name), effects=()), (died,), 3,
        reference=ReferenceNoise(), contact_noise_m_per_sqrt_m=5e-4, duration_s=80.0,
    )  # fmt: skip
    blind = replace(log, gyro_code=None, gyro_rate_rad_s=None)
    assert not looks_gross(blind, ROBOT)
    assert with_clock_set(blind, ROBOT)[1] == 0.0
    found = MotionBlock(MotionModel(blind, ROBOT, default_prior())).scan.likeliest
    assert found.effects == {"encoder_dead"}


@pytest.mark.full_size
@pytest.mark.parametrize("name", ["calibration", "random"])
def test_beside_positions_alone_the_gyro_tells_what_its_wheel_did(name: str) -> None:
    """The way by the one wheel left turned round and round; bent onto fixes without headings it was
    that of a gyro that reads 1.1 rad/s too little for a while (unlisted, 0.96), or of tyres that
    scrub (0.98)."""
    died = EffectSetting("encoder_dead", (("side", "left"), ("start_s", 50.0)))
    fixes = ReferenceNoise(rate_hz=10.0, position_m=0.003)
    log = synthetic_recording(
        ROBOT, WIRE, replace(scenario(name), effects=()), (died,), 3, reference=fixes
    )
    assert log.reference is not None
    log = replace(log, reference=replace(log.reference, heading_rad=None))
    found = MotionBlock(MotionModel(log, ROBOT, default_prior())).scan.likeliest
    assert found.effects == {"encoder_dead"}


@pytest.mark.full_size
def test_what_turns_put_in_do_not_tell_is_told_beside_a_dead_encoder_as_ever() -> None:
    """A counter that wraps jumps no more in turns that are put in: of a sealed case whose answer
    had both the parameters were asked for there, and the diagnosis ended in a KeyError."""
    wrong = (
        EffectSetting("encoder_dead", (("side", "left"), ("start_s", 30.0))),
        EffectSetting("encoder_wrap", (("bits", 12),)),
    )
    log = synthetic_recording(
        ROBOT, WIRE, replace(scenario("random"), effects=()), wrong, 3,
        reference=ReferenceNoise(), contact_noise_m_per_sqrt_m=5e-4, duration_s=50.0,
    )  # fmt: skip
    motion = MotionBlock(MotionModel(log, ROBOT, default_prior()))
    both = frozenset({"encoder_dead", "encoder_wrap"})
    assert motion.scan.where_it_turns is not None
    assert "encoder_wrap" not in motion.scan.where_it_turns.effects
    assert {"encoder_dead.side", "encoder_wrap.bits"} <= motion.detail(both).parameters.keys()
    assert motion.fit(both | {"gyro_noise"}).effects == tuple(sorted(both | {"gyro_noise"}))


def test_the_last_row_before_it_died_may_have_been_counted_in_part() -> None:
    """It died within a row of which half was counted: two sealed cases lay outside by that much."""
    start_s = 0.3 * LASTS_S
    at = int(np.flatnonzero(WHOLE.t_s > start_s)[0])
    half = standing(float(WHOLE.t_s[at]), 0.8 * LASTS_S)
    ticks = half.left_ticks.copy()
    ticks[at : np.flatnonzero(WHOLE.t_s > 0.8 * LASTS_S)[0]] -= 0.5 * (ticks[at] - ticks[at - 1])
    (dead,) = found(replace(half, left_ticks=ticks))
    first_s, last_s = dead.told["start_s"]
    assert first_s <= float(WHOLE.t_s[at]) - 0.5 * WHOLE.tick_period_s <= last_s
    assert last_s - first_s < 1.01 * WHOLE.tick_period_s


def test_a_whole_row_before_it_died_says_that_it_lived_to_its_end() -> None:
    """The row before the last counts was open too: of 72 true times all lay in the later half."""
    start_s = 0.3 * LASTS_S
    at = int(np.flatnonzero(start_s < WHOLE.t_s)[0])
    (dead,) = found(standing(start_s, 0.8 * LASTS_S))
    first_s, last_s = dead.told["start_s"]
    counts = WHOLE.left_ticks[at - 1] - WHOLE.left_ticks[at - 2]
    rounded_s = 3.0 / counts * WHOLE.tick_period_s
    assert float(WHOLE.t_s[at - 1]) - rounded_s < first_s <= start_s <= last_s


def test_a_row_of_a_wheel_that_slows_down_lacks_nothing_for_that() -> None:
    """Six of a hundred true times lay outside, by up to 20 standard deviations: each row had fewer
    counts than those before."""
    half = standing(0.3 * LASTS_S, 0.8 * LASTS_S)
    at = int(np.flatnonzero(WHOLE.t_s > 0.3 * LASTS_S)[0])
    step = np.diff(half.left_ticks, prepend=half.left_ticks[0])
    step[at - 10 : at] = np.round(step[at - 10 : at] * (1.0 - 0.05 * np.arange(10)))
    (dead,) = found(replace(half, left_ticks=half.left_ticks[0] + np.cumsum(step)))
    first_s, last_s = dead.told["start_s"]
    assert first_s <= float(WHOLE.t_s[at - 1]) <= last_s
    assert last_s - first_s < 2.0 * WHOLE.tick_period_s


def test_the_row_in_which_it_counts_again_may_have_been_counted_in_part() -> None:
    stop_s = 0.8 * LASTS_S
    (dead,) = found(standing(0.3 * LASTS_S, stop_s))
    first_again = WHOLE.t_s[np.flatnonzero(WHOLE.t_s > stop_s)[0]]
    assert dead.fixed["stop_s"] > first_again


def test_a_count_that_goes_on_was_not_dead_where_only_the_counts_tell() -> None:
    alone = replace(standing(0.3 * LASTS_S, 0.8 * LASTS_S), gyro_code=None, gyro_rate_rad_s=None)
    assert found(alone) == []


@pytest.mark.parametrize(("from_share", "to_share"), [(0.3, 0.5), (0.9, 1.1)])
def test_a_wheel_that_the_robot_turns_about_was_not_dead(
    from_share: float, to_share: float
) -> None:
    """Nor at the log's end: beside a clock's drift an encoder that died there gained 8 nats."""
    step = np.diff(WHOLE.left_ticks, prepend=WHOLE.left_ticks[0])
    about = (WHOLE.t_s > from_share * LASTS_S) & (WHOLE.t_s <= to_share * LASTS_S)
    step[about] = 0.0
    per_count_rad = math.tau / ROBOT.plant.encoder.ticks_per_rev
    rolled_rad = np.diff(WHOLE.right_ticks, prepend=WHOLE.right_ticks[0]) * per_count_rad
    wheels = ROBOT.plant.wheels
    rate_rad_s = rolled_rad * wheels.radius_m / wheels.wheelbase_m / WHOLE.tick_period_s
    assert WHOLE.gyro_rate_rad_s is not None
    turning = replace(
        WHOLE,
        left_ticks=WHOLE.left_ticks[0] + np.cumsum(step),
        gyro_rate_rad_s=np.where(about, rate_rad_s, WHOLE.gyro_rate_rad_s),
    )
    assert found(turning) == []


def test_an_encoder_that_counted_nothing_for_seconds_explains_what_is_missing() -> None:
    model = MotionModel(standing(0.3 * LASTS_S, 0.3 * LASTS_S + 3.0), ROBOT, default_prior())
    (dead,) = (one for one in model.columns.terms if one.variant.effect == "encoder_dead")
    levels = model.level_prior.median
    gained = model.refit((dead,), levels).log_evidence - model.refit((), levels).log_evidence
    assert gained > 100


def test_a_count_that_stands_to_the_end_may_have_died_when_it_stopped() -> None:
    (dead,) = found(standing(0.3 * LASTS_S, np.inf))
    assert dead.report["side"] == "left"
    assert dead.fixed["start_s"] == pytest.approx(0.3 * LASTS_S, abs=0.05)


def test_a_short_stand_at_the_end_speaks_little_of_a_dead_encoder() -> None:
    """It may have died at any time: a stand of a tenth of the log has a tenth of the odds."""
    (dead,) = found(standing(0.9 * LASTS_S, np.inf))
    assert dead.log_share == pytest.approx(-np.log(10), abs=0.05)


DEAD = EffectSetting("encoder_dead", (("side", "right"), ("start_s", 8.0)))
RIVALS = frozenset({"encoder_dead", "gyro_nonlinearity"})


def test_nothing_said_beside_a_dead_encoder_leans_on_what_stands_in_for_its_counts() -> None:
    """What the wheel did is guessed from the gyro: held against the gyro again, the guess said that
    it bends (103 nats)."""
    log = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("figure8"),
        (DEAD,),
        2,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
    )
    others = frozenset(EXPLAINED) - RIVALS
    scan = Scan(MotionModel(log, ROBOT, default_prior(), without=others))
    best = max(scan.found.values(), key=lambda one: one.log_evidence)
    assert best.effects == {"encoder_dead"}


@pytest.mark.parametrize(
    ("drive", "bias_rad_s"), [("calibration", 0.003), *at_full_size(("figure8", 0.024))]
)
def test_what_is_wrong_with_the_gyro_besides_is_said_beside_a_dead_encoder(
    drive: str, bias_rad_s: float
) -> None:
    """Until it died the counts told of the gyro. What the bias gains where the guess is not leant
    on was asked of a fit that leant on it, which contradicts itself: all 340 nats were taken back.
    Along straight lines about nothing a small one lay 2,900 nats below the bias that walks as far,
    and stray counts were told, or nothing that is listed (two cases of the sealed trial, 1.00).
    """
    bias = EffectSetting("gyro_bias", (("bias", bias_rad_s),))
    log = synthetic_recording(
        ROBOT,
        WIRE,
        scenario(drive),
        (DEAD, bias),
        2,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
        duration_s=40.0,
    )
    others = frozenset(EXPLAINED) - RIVALS - {"gyro_bias", "extra_ticks"}
    scan = Scan(MotionModel(log, ROBOT, default_prior(), without=others))
    best = max(scan.found.values(), key=lambda one: one.log_evidence)
    assert best.effects == {"encoder_dead", "gyro_bias"}


THREE = (
    DEAD,
    EffectSetting("radius_scale", (("scale", 0.02),)),
    EffectSetting("gyro_scale", (("scale", 0.02),)),
)


def with_others(effects: tuple[EffectSetting, ...], lasts_s: float | None = None) -> Recording:
    """Return a log of these effects, so long or as long as the drive."""
    return synthetic_recording(
        ROBOT,
        WIRE,
        scenario("figure8"),
        effects,
        2,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
        duration_s=lasts_s,
    )


def told(log: Recording, others: frozenset[str]) -> MotionBlock:
    """Return what a library of these and of dead encoders tells."""
    without = frozenset(EXPLAINED) - others - {"encoder_dead"}
    return MotionBlock(MotionModel(log, ROBOT, default_prior(), without=without))


def test_several_effects_are_told_beside_a_dead_encoder_with_their_sizes() -> None:
    """About a wheel that stands no column says anything of one that turns: pairs were all that was
    asked (a wheel 7 % too large beside a dead encoder was a drive's gain, 1.00)."""
    block = told(with_others(THREE), frozenset({"radius_scale", "gyro_scale", "wheelbase_scale"}))
    names = frozenset(one.effect for one in THREE)
    assert block.scan.likeliest.effects == names
    sizes = block.detail(names).parameters
    assert sizes["encoder_dead.side"].value == "right"
    for name in ("radius_scale.scale", "gyro_scale.scale"):
        assert abs(float(sizes[name].value) - 0.02) < 4 * sizes[name].sd < 0.01


def test_where_the_gyro_is_silent_too_a_dead_encoder_is_no_slip() -> None:
    """Frames of 0.8 s are lost: a gyro filled in by wheels of which one stands tells half of the
    turn, and its wheel had slipped (172 nats)."""
    log = with_others((DEAD,), 30.0)
    lost = (log.t_s > 20.0) & (log.t_s < 20.8)
    assert log.gyro_code is not None
    assert log.gyro_rate_rad_s is not None
    log = replace(
        log,
        left_ticks=np.where(lost, np.nan, log.left_ticks),
        right_ticks=np.where(lost, np.nan, log.right_ticks),
        gyro_code=np.where(lost, np.nan, log.gyro_code),
        gyro_rate_rad_s=np.where(lost, np.nan, log.gyro_rate_rad_s),
    )
    assert told(log, frozenset({"one_sided_slip"})).scan.likeliest.effects == {"encoder_dead"}
