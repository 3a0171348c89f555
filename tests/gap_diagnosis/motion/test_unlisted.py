"""What a cause without a name depends on is found among the variables that it can depend on."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from full_size import at_full_size
from motion_cases import ROBOT, WIRE, model_of, nodes_of

from gap_diagnosis.motion.bases import basis, turns
from gap_diagnosis.motion.evidence import score
from gap_diagnosis.motion.unknown import alternatives, beyond_tolerance, levels_beside
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.trials.drives import drive as trial_drive
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

STAGES = 7
NO_GAP_OVER_STAGE = math.log(default_prior().effects[0] / (default_prior().unknown / STAGES))
"""Log of the odds beforehand of no gap to an unlisted cause in one stage."""


def test_each_wheels_slip_when_speeding_up_is_a_function_of_its_own_acceleration() -> None:
    """In a turn the wheels speed up against each other: of the body there is nothing to see."""
    slip = EffectSetting("longitudinal_slip", (("compliance", 0.03),))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (slip,), 3, reference=ReferenceNoise()
    )
    model = model_of(log)
    best, second = alternatives(model, model.no_effect_levels)[:2]
    assert (best.stage, best.variable) == ("wheel", "acceleration")
    assert best.log_evidence > 50
    assert best.log_evidence > second.log_evidence + 20


def test_a_caster_that_turns_over_is_a_function_of_the_way_after_a_reversal() -> None:
    """Kicks of a degree passed for a rough floor: 0 nats, and no gap was told."""
    kick = EffectSetting("caster_kick", (("angle", 0.015), ("length", 0.1)))
    model = model_of(drive(kick))
    best = alternatives(model, model.no_effect_levels)[0]
    assert (best.stage, best.variable) == ("wheel", "reversal")
    assert best.log_evidence > 50


@pytest.mark.parametrize(
    ("side", "width_rad"), [("left", 0.005), *at_full_size(("left", 0.014), ("right", 0.014))]
)
def test_play_without_its_name_is_a_function_of_the_way_after_a_wheels_reversal(
    side: str, width_rad: float
) -> None:
    """Two steps of a degree passed for counts that came in half a second (extra_ticks, 0.97); a
    third of a degree, laid over ten times its way, for nothing (no gap, 0.93)."""
    play = EffectSetting("backlash", (("side", side), ("width", width_rad)))
    model = model_of(drive(play))
    best, second = alternatives(model, model.no_effect_levels)[:2]
    assert (best.stage, best.variable) == ("encoder", "reversal")
    assert best.log_evidence > 50
    assert best.log_evidence > second.log_evidence + 20


def test_what_drifts_with_the_supply_may_be_the_gyros_scale() -> None:
    ratio = EffectSetting("supply_ratio", (("coefficient", -0.16),))
    sagging = EffectSetting("supply_change", (("offset", -0.1), ("rate", -0.004)))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (sagging, ratio), 3, reference=ReferenceNoise()
    )
    model = model_of(log)
    best = alternatives(model, model.no_effect_levels)[0]
    assert best.stage == "gyro"
    assert best.variable in {"supply", "time"}
    assert best.log_evidence > 50


def test_a_scale_that_drifts_by_several_tolerances_is_no_healthy_robots() -> None:
    """A gyro's scale may be 0.3 % off; that it drifts by as much was taken for no gap as well, and
    five tolerances of a supply's share won 3.6 nats: less than the odds against them."""
    prior = default_prior()
    share = 5 * prior.of("supply_ratio", "coefficient").tolerance
    ratio = EffectSetting("supply_ratio", (("coefficient", -share),))
    log = drive(EffectSetting("supply_change", (("offset", -0.1), ("rate", -0.004))), ratio)
    model = model_of(log)
    best = beyond_tolerance(alternatives(model, model.no_effect_levels))[0]
    assert best.stage == "gyro"
    assert best.log_evidence > NO_GAP_OVER_STAGE + math.log(4.0)


def test_tyres_that_wear_by_several_tolerances_are_no_healthy_robots() -> None:
    """A wheel may be 0.2 % off; that it drifts by as much in a drive was taken for no gap as well,
    and won 4.5 nats of 29: less than the odds against them."""
    prior = default_prior()
    rate = 5 * prior.of("tyre_drift", "rate").tolerance
    log = drive(EffectSetting("tyre_drift", (("rate", rate),)))
    model = model_of(log)
    best = beyond_tolerance(alternatives(model, model.no_effect_levels))[0]
    assert (best.stage, best.variable) == ("wheel", "time")
    assert best.log_evidence > NO_GAP_OVER_STAGE + math.log(4.0)


def test_tyres_that_wear_by_a_tolerance_are() -> None:
    prior = default_prior()
    rate = prior.of("tyre_drift", "rate").tolerance
    log = drive(EffectSetting("tyre_drift", (("rate", rate),)))
    model = model_of(log)
    best = beyond_tolerance(alternatives(model, model.no_effect_levels))[0]
    assert best.log_evidence < NO_GAP_OVER_STAGE - math.log(4.0)


@pytest.mark.parametrize("threshold_rad_s", [0.0, 4.0])
def test_counts_that_are_lost_without_a_name_depend_on_how_fast_their_own_wheel_turns(
    threshold_rad_s: float,
) -> None:
    """A wheel that lost 0.7 % above 4 rad/s was a smaller one and a wrong scale, 0.99."""
    lost = (("side", "right"), ("probability", 0.007), ("threshold", threshold_rad_s))
    log = drive(EffectSetting("missed_ticks", lost))
    model = model_of(log)
    best, second = alternatives(model, model.no_effect_levels)[:2]
    assert (best.stage, best.variable) == ("encoder", "speed")
    assert best.log_evidence > second.log_evidence + 3


def test_a_robot_that_speeds_up_once_and_brakes_once_shows_what_goes_with_that() -> None:
    """It does for 3 % of a minute: its accelerations were noise, and a gyro that feels them had
    nothing to go with (no gap, 0.93, where its name had 67 nats)."""
    feels = EffectSetting("gyro_g_sensitivity", (("x", 0.004), ("y", 0.006)))
    driven = trial_drive("weave", np.random.default_rng(3), 0.6)
    log = synthetic_recording(ROBOT, WIRE, driven, (feels,), 3, reference=ReferenceNoise())
    model = model_of(log)
    speeding_up = np.abs(model.nodes.smooth.acceleration_m_s2) > 0.05
    assert 0.005 < speeding_up.mean() < 0.05
    best = alternatives(model, model.no_effect_levels)[0]
    assert best.stage == "gyro"
    assert best.variable in {"acceleration", "lateral_acceleration"}
    assert best.log_evidence > 20


@pytest.mark.parametrize("name", ["straight", "square", "stop_and_go"])
@pytest.mark.parametrize("seed", range(2))
def test_a_counts_own_noise_is_no_function_of_the_speed_that_they_say(name: str, seed: int) -> None:
    """Without a reference a healthy robot's encoder had an unlisted cause, by 10 to 293 nats."""
    log = synthetic_recording(ROBOT, WIRE, scenario(name), (), seed, reference=None)
    model = model_of(log, "missed_ticks")
    found = alternatives(model, model.no_effect_levels)
    by_speed = [one for one in found if (one.stage, one.variable) == ("encoder", "speed")]
    assert all(one.log_evidence < 2.0 for one in by_speed)


def test_one_wheel_that_counts_too_little_everywhere_is_listed() -> None:
    """With its name in the library the same shape is not weighed again."""
    log = drive(EffectSetting("missed_ticks", (("side", "right"), ("probability", 0.01))))

    def evidence(*listed: str) -> float:
        model = model_of(log, *listed)
        found = alternatives(model, model.no_effect_levels)
        return next(
            one.log_evidence for one in found if (one.stage, one.variable) == ("encoder", "speed")
        )

    assert evidence("missed_ticks") < evidence() - 3


def drive(*effects: EffectSetting, name: str = "calibration") -> Recording:
    return synthetic_recording(ROBOT, WIRE, scenario(name), effects, 3, reference=ReferenceNoise())


def test_a_gyro_that_lags_depends_on_how_fast_the_turning_changes() -> None:
    lag = EffectSetting("gyro_lag", (("time_constant", 0.02),))
    model = model_of(drive(lag))
    best, second = alternatives(model, model.no_effect_levels)[:2]
    assert (best.stage, best.variable) == ("gyro", "acceleration")
    assert best.log_evidence > second.log_evidence + 20


@pytest.mark.parametrize(
    ("effect", "coefficient", "size", "variables"),
    [
        ("lateral_slip", "compliance", 0.01, {"lateral_acceleration"}),
        ("wheelbase_scale", "scale", 0.01, {"direction", "speed", "time", "distance"}),
        *at_full_size(("turn_scrub", "scrub", 0.02, {"turn_rate"})),
    ],
)
def test_a_plain_cause_without_a_name_does_not_pay_for_the_bends_it_could_have_had(
    effect: str, coefficient: str, size: float, variables: set[str]
) -> None:
    """Against its own name it loses the choice of a shape, of 25 at most, and of ten columns of
    hats and four ways nothing: no more than the prior's other steps make."""
    model = model_of(drive(EffectSetting(effect, ((coefficient, size),))), effect)
    levels = model.no_effect_levels
    term, *_ = (one for one in model.columns.terms if one.variant.effect == effect)
    named = score(model.gram(levels), [term], model.prior)
    best = alternatives(model, levels)[0]
    assert best.stage == "wheel"
    assert best.variable in variables
    assert best.log_evidence > named.log_evidence - np.log(25) - 6


@pytest.mark.parametrize(
    ("effect", "values", "variable"),
    [
        ("reference_lever_arm", (("x", 0.02), ("y", 0.0)), "heading"),
        ("reference_scale", (("scale", 0.01),), "place"),
        ("reference_clock_skew", (("skew", 0.001),), "time"),
    ],
)
def test_a_reference_without_the_name_of_its_fault_is_told_by_what_it_depends_on(
    effect: str, values: tuple[tuple[str, float], ...], variable: str
) -> None:
    """A point beside the middle turns with the robot, a room's scale goes with the place, a clock
    that runs off with time; hats that add up to the same pay for the bends that are not there."""
    model = model_of(drive(EffectSetting(effect, values)))
    best, second = alternatives(model, model.no_effect_levels)[:2]
    assert (best.stage, best.variable) == ("reference", variable)
    assert best.log_evidence > second.log_evidence + 10


@pytest.mark.parametrize(
    ("effect", "values", "variable"),
    [
        ("gyro_nonlinearity", (("quadratic", -0.02), ("cubic", 0.02)), "turn_rate"),
        ("extra_ticks", (("side", "right"), ("rate", 4.0)), "time"),
        *at_full_size(
            ("gyro_g_sensitivity", (("x", 0.002), ("y", -0.002)), "lateral_acceleration"),
            ("cross_slope_drift", (("ratio", 0.01), ("direction", 0.5)), "heading"),
        ),
    ],
)
def test_a_cause_with_a_way_of_its_own_loses_little_for_want_of_its_name(
    effect: str, values: tuple[tuple[str, float | str], ...], variable: str
) -> None:
    """Hats alone left a third of a gyro's bend to noise, a pull across three quarters of one
    aslant, slip half of what counts come with time, and sliding while a robot spins on the spot
    most of what slides as it drives across a slope: wrong names came before them."""
    model = model_of(drive(EffectSetting(effect, values)), effect)
    levels = model.no_effect_levels
    terms = [one for one in model.columns.terms if one.variant.effect == effect]
    gram = model.gram(levels)
    named = max(score(gram, [one], model.prior).log_evidence for one in terms)
    best = next(one for one in alternatives(model, levels) if one.variable == variable)
    assert named > 50
    assert best.log_evidence > named - np.log(5) - 6


def test_wheels_that_back_up_a_slope_go_as_far_as_forward_down_it() -> None:
    """A slip that turned its sign with the driving's left 4 nats of 16 to a slope without name."""
    log = drive(EffectSetting("grade_slip", (("ratio", 0.004), ("direction", 1.0))))
    assert log.v_command_m_s is not None
    assert np.mean(log.v_command_m_s < 0) > 0.1
    model = model_of(log, "grade_slip")
    levels = model.no_effect_levels
    (term,) = (one for one in model.columns.terms if one.variant.effect == "grade_slip")
    named = score(model.gram(levels), [term], model.prior)
    best = next(one for one in alternatives(model, levels) if one.variable == "heading")
    assert named.log_evidence > 20
    assert best.log_evidence > named.log_evidence - np.log(25) - 6


def test_wheels_that_tremble_on_a_straight_do_not_turn() -> None:
    """How tightly they seem to turn is as large as their noise: a function of that took the noise
    of lost counts away (2,000 nats). A rate's weight is its square over that and 0.05² rad²/s²."""
    lost = EffectSetting("missed_ticks", (("side", "right"), ("probability", 0.005)))
    log = drive(lost, name="square")
    motion = model_of(log).nodes.smooth
    assert log.v_command_m_s is not None
    assert log.w_command_rad_s is not None
    straight = (np.abs(log.v_command_m_s) > 0.1) & (log.w_command_rad_s == 0.0)
    told_s = log.t_s[np.flatnonzero(np.diff(log.w_command_rad_s))]
    settled = np.min(np.abs(log.t_s[:, np.newaxis] - told_s), axis=1) > 0.5
    assert np.mean(turns(motion)[straight & settled]) < 0.1
    assert np.min(turns(motion)[(np.abs(log.w_command_rad_s) > 0.5) & settled]) > 0.95


def test_a_slow_reference_does_not_keep_a_cause_from_its_levels() -> None:
    """No effect's levels wander for minutes instead: from there the way back is long."""
    toe = EffectSetting("reference_yaw", (("angle", 0.01),))
    model = model_of(drive(toe, name="random"))
    wandering = model.level_prior.median.copy()
    wandering[-2:] = 0.005, 100.0
    evenly = next(one for one in alternatives(model, wandering) if one.variable == "direction")
    levels = levels_beside(model, evenly, wandering)
    assert levels is not None
    assert levels[-1] < 20.0


def test_a_cause_without_a_name_gets_noise_levels_of_its_own() -> None:
    """At those of no effect, noise has taken most of what it explains."""
    slip = EffectSetting("lateral_slip", (("compliance", 0.1),))
    model = model_of(drive(slip))
    start = model.no_effect_levels
    best = alternatives(model, start)[0]
    levels = levels_beside(model, best, start)
    assert levels is not None
    again = next(one for one in alternatives(model, levels) if one.variable == best.variable)
    nothing = [model.evidence_at((), one) for one in (start, levels)]
    density = [model.level_prior.log_density(np.log(one)) for one in (start, levels)]
    gained = again.log_evidence + nothing[1] + density[1]
    assert gained > best.log_evidence + nothing[0] + density[0] + 100


def test_where_nothing_is_wrong_no_levels_are_sought() -> None:
    model = model_of(drive())
    start = model.no_effect_levels
    assert levels_beside(model, alternatives(model, start)[0], start) is None


@pytest.mark.parametrize("phase_s", [-0.0048, 0.0048])
def test_when_in_a_tick_a_reference_samples_makes_no_wheel_slip(phase_s: float) -> None:
    """From a tick to a sample the way led along raw counts: with 512 of them to a turn, and samples
    5 ms off all ticks, healthy wheels slipped by nine standard deviations."""
    encoder = ROBOT.plant.encoder.model_copy(update={"ticks_per_rev": 512})
    wheels = ROBOT.plant.wheels.model_copy(update={"wheelbase_m": 0.25})
    changed = {"encoder": encoder, "wheels": wheels}
    robot = replace(ROBOT, plant=ROBOT.plant.model_copy(update=changed))
    turning = trial_drive("one_way", np.random.default_rng(2), 0.8)
    exact = ReferenceNoise(0.0, 0.0, 0.0, 0.0)
    log = synthetic_recording(robot, WIRE, turning, (), 3, reference=exact)
    true = log.reference
    assert true is not None
    assert true.heading_rad is not None
    noise = np.random.default_rng(4).normal(0.0, 2.5e-4, (3, len(true.t_s) - 2))
    t_s = true.t_s[1:-1] + phase_s
    truth = np.array(
        [np.interp(t_s, true.t_s, one) for one in (true.x_m, true.y_m, true.heading_rad)]
    )
    x_m, y_m, heading_rad = truth + noise
    seen = replace(true, t_s=t_s, x_m=x_m, y_m=y_m, heading_rad=heading_rad)
    model = model_of(replace(log, reference=seen), robot=robot)
    found = alternatives(model, model.no_effect_levels)
    (slip,) = [one for one in found if (one.stage, one.variable) == ("wheel", "acceleration")]
    assert slip.log_evidence < 3.0


def test_a_robot_that_only_trembles_backwards_at_rest_has_no_direction_to_go_with() -> None:
    """A reference's noise at a stop was taken for reversing, and a function of it for a cause."""
    log = synthetic_recording(ROBOT, WIRE, scenario("figure8"), (), 3, duration_s=30.0)
    motion = nodes_of(log).motion
    trembling_m_s = 0.02 * np.sin(40.0 * motion.t_s)
    at_rest = np.abs(motion.speed_m_s) < 0.01
    assert at_rest.any()
    still = replace(motion, speed_m_s=np.where(at_rest, trembling_m_s, np.abs(motion.speed_m_s)))
    assert basis(still, "wheel", "direction").functions == []
    half = np.where(motion.t_s > np.median(motion.t_s), -1.0, 1.0)
    to_and_fro = replace(motion, speed_m_s=half * np.abs(motion.speed_m_s))
    assert len(basis(to_and_fro, "wheel", "direction").functions) == 1


def test_a_robot_that_only_drives_straight_has_no_heading_to_go_with() -> None:
    """The noise of its headings, 2 mrad, was an unlisted cause in the reference (0.96)."""
    log = synthetic_recording(
        ROBOT, WIRE, scenario("stop_and_go"), (), 3, reference=ReferenceNoise(), duration_s=30.0
    )
    assert basis(nodes_of(log).motion, "reference", "heading").functions == []


def test_a_wheel_that_loses_counts_on_a_straight_turns_no_robot() -> None:
    """One count in ten: wheels say 0.13 rad/s on the sides of a square, and the gyro says nothing.
    Taken for a turn, a function of speed took it away with its noise."""
    losing = (("side", "left"), ("probability", 0.1), ("threshold", 4.0))
    drive = replace(scenario("square"), effects=())
    log = synthetic_recording(ROBOT, WIRE, drive, [EffectSetting("missed_ticks", losing)], 3)
    motion = nodes_of(log).smooth
    is_straight = np.minimum(motion.left_rate_rad_s, motion.right_rate_rad_s) > 4.0
    assert np.median(np.abs(motion.turn_rate_rad_s[is_straight])) > 0.1
    assert np.median(turns(motion)[is_straight]) < 0.1


@pytest.mark.parametrize("is_listed", [True, False])
def test_an_arm_straight_ahead_is_an_unlisted_cause_only_where_no_arm_is_listed(
    is_listed: bool,
) -> None:
    """An arm of 50 mm, told to 0.02 mm, was an unlisted cause that goes with heading (0.98): the
    listed one may lie aside as well, and it paid for that."""
    effect = "reference_lever_arm"
    arm = EffectSetting(effect, (("x", 0.05), ("y", 0.0)))
    whole = model_of(drive(arm), effect)
    model = whole if is_listed else model_of(drive(arm))
    levels = model.no_effect_levels
    unlisted = alternatives(model, levels)[0]
    assert (unlisted.stage, unlisted.variable) == ("reference", "heading")
    (term,) = [one for one in whole.columns.terms if one.variant.effect == effect]
    listed = score(whole.gram(levels), [term], whole.prior)
    assert (listed.log_evidence > unlisted.log_evidence) == is_listed


@pytest.mark.parametrize("seed", [1, 2])
def test_a_good_reference_of_a_healthy_robot_has_no_delay_that_wanders(seed: int) -> None:
    """Beside the near chord of a tolerated delay, one over 14 ms had the way's bends: 6 nats spoke
    for a delay that wanders where there was none."""
    log = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("calibration"),
        (),
        seed,
        reference=ReferenceNoise(1e-4, 1e-4, 0.0, 0.0, rate_hz=120.0),
    )
    model = model_of(log)
    found = alternatives(model, model.no_effect_levels)
    (wandering,) = (one for one in found if (one.stage, one.variable) == ("reference", "time"))
    assert wandering.log_evidence < 0
