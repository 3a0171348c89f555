"""What a log tells exactly is not sought: a flat top's limit, a disc's phase, a warming gyro."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import EXACT, LEVELS, ROBOT, WIRE, nodes_of, setting_of, without_noise
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.explanations.reference import rounded_off, turn_rate_with_details
from gap_diagnosis.explanations.registry import EXPLAINED, predict
from gap_diagnosis.explanations.variant import Value
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.columns import MOVES_IN_TIME, Term
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.whitening import CONTACT
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.trials import drives
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import Segment, SegmentProfile, scenario

DRIVE = replace(scenario("calibration"), seed=3)
WAY = ((0.6, 0.45, 4.0), (-0.2, 0.55, 3.0), (0.6, 0.45, 4.0), (-0.3, -0.5, 4.0))
"""Speed [m/s], turn rate [rad/s] and time [s] of arcs, each begun within half a second."""
ARCS = replace(DRIVE, profile=SegmentProfile([Segment(*one) for one in 3 * WAY]), duration_s=45.0)


def test_the_limit_of_a_saturated_gyro_is_known_to_the_code_that_it_never_exceeds() -> None:
    limit = 0.3735
    log = synthetic_recording(
        ROBOT,
        WIRE,
        DRIVE,
        [EffectSetting("gyro_saturation", (("limit", limit),))],
        5,
        reference=ReferenceNoise(),
        duration_s=40.0,
    )
    model = MotionModel(log, ROBOT, default_prior())
    own = tuple(one for one in model.columns.terms if one.variant.effect == "gyro_saturation")
    model.columns = replace(model.columns, terms=own)
    block = MotionBlock(model)
    found = block.detail(frozenset({"gyro_saturation"}))
    told = np.asarray(found.parameters["gyro_saturation.limit"].samples)
    code_rad_s = 1 / ROBOT.plant.gyro.sensitivity_lsb_per_rad_s
    assert told.min() < limit < told.max()
    assert told.max() - told.min() < 1.001 * code_rad_s
    assert told.std() == pytest.approx(code_rad_s / 12**0.5, rel=0.05)
    # The fit seeks its own: held to the code, what it rounds off at the limit would be gyro_scale.
    assert "limit" in block.scan.spans["gyro_saturation"]


def test_a_large_slip_outward_costs_no_more_in_detail_than_along_a_smooth_way() -> None:
    """It was an unlisted cause on a figure eight (0.999): the details that it acted on were an
    estimate's, whose noise it made larger by its own size."""
    log = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("figure8"), effects=()),
        [EffectSetting("lateral_slip", (("compliance", 0.15),))],
        324,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
    )
    model = MotionModel(log, ROBOT, default_prior())
    term, *_ = (one for one in model.columns.terms if one.variant.effect == "lateral_slip")
    smooth = replace(term, variant=replace(term.variant, exact=None))
    exactly, smoothly = (
        model.refit([one], model.level_prior.median).log_evidence for one in (term, smooth)
    )
    assert exactly > smoothly - 3.0


@pytest.mark.parametrize("phase", [0.0, 1.6, -2.5])
def test_an_eccentric_disc_is_undone_wherever_it_stood_when_the_log_began(phase: float) -> None:
    """Steps are left with the rounding of two counts, and not with a share of the amplitude."""
    values: dict[str, Value] = {"side": "left", "amplitude": 0.08, "phase": phase}
    robot = without_noise(ROBOT)
    log, plain = (
        synthetic_recording(robot, WIRE, DRIVE, settings, 3, reference=EXACT, duration_s=30.0)
        for settings in ([EffectSetting("encoder_eccentricity", tuple(values.items()))], [])
    )
    motion = nodes_of(log, robot).motion
    turned = np.cumsum(predict(motion, setting_of(motion, "encoder_eccentricity", values)).left_rad)
    true = np.cumsum(predict(nodes_of(plain, robot).motion).left_rad)
    # Counts are rounded here and there, and by up to 1 / (1 - amplitude) more where undone.
    assert np.abs(turned - true).max() < (1.0 + 1.0 / 0.92) * motion.rad_per_count


def test_between_two_frames_of_a_slow_sensor_a_gyro_warms_on() -> None:
    """A reading held till the next frame is half a frame late on average."""
    warm = (("offset", -5.0), ("rise", 15.0), ("time_constant", 20.0))
    log = synthetic_recording(
        ROBOT, WIRE, DRIVE, [EffectSetting("warm_up", warm)], 3, reference=EXACT, duration_s=30.0
    )
    read = estimate_motion(log, ROBOT).warm_k
    assert read is not None
    true = -5.0 - 15.0 * np.expm1(-log.t_s / 20.0)
    inside = slice(200, -200)
    code_k = 1 / ROBOT.plant.temperature.sensitivity_lsb_per_k
    assert abs(float(np.mean((read - true)[inside]))) < 0.5 * code_k


def test_a_slow_sensor_that_stood_still_for_long_changes_within_the_time_of_one_frame() -> None:
    log = synthetic_recording(ROBOT, WIRE, DRIVE, [], 3, reference=EXACT, duration_s=10.0)
    held = np.full(len(log.t_s), 290.0)
    held[500:] = 291.0
    held[510:] = 292.0
    read = estimate_motion(replace(log, temperature_k=held), ROBOT).warm_k
    assert read is not None
    middle = read + 298.15
    assert np.allclose(middle[:490], 290.0)
    assert middle[495] == pytest.approx(290.5)
    assert np.allclose(middle[510:], 292.0)


def test_the_rate_with_details_begins_its_turns_as_sharply_as_the_true_one() -> None:
    """A Gaussian of a twentieth of a second, twice, takes 4 % off: a lag would read longer by it.

    Along the smooth rate, which is what a lag is fitted along; the true one is a gyro's without
    noise. A hundredth and a half may be left where a detail is no more than the rounding of counts.
    """
    quiet = without_noise(ROBOT)
    log = synthetic_recording(quiet, WIRE, DRIVE, [], 3, reference=EXACT, duration_s=40.0)
    assert log.gyro_rate_rad_s is not None
    motion = nodes_of(log, ROBOT).smooth
    true, smooth, detailed = (
        np.gradient(rate)
        for rate in (log.gyro_rate_rad_s, motion.turn_rate_rad_s, turn_rate_with_details(motion))
    )
    assert smooth @ true > 1.03 * (smooth @ smooth)
    assert smooth @ true == pytest.approx(smooth @ detailed, rel=0.015)


def test_what_a_gaussian_rounds_off_a_rate_is_put_back() -> None:
    """Of a turn that begins within three widths a fiftieth is left of what was missing."""
    width = 7.0
    t = np.arange(400.0)
    turn = np.exp(-0.5 * ((t - 200.0) / (3.0 * width)) ** 2)
    smooth = gaussian_filter1d(turn, width)
    missing = np.abs(turn - smooth).max()
    assert np.abs(turn - smooth - sum(rounded_off(smooth, width))).max() < missing / 20.0


def test_an_edge_that_smoothing_itself_has_made_is_no_detail_of_a_turn() -> None:
    """Sharpened to fourth order a step of 0.01 rad/s in a smooth rate was one of 2 rad/s."""
    log = synthetic_recording(ROBOT, WIRE, DRIVE, [], 3, reference=EXACT, duration_s=20.0)
    motion = nodes_of(log, ROBOT).smooth
    rate = 0.3 * np.sin(motion.t_s)
    rate[1000:] += 0.01
    wide = replace(
        motion, turn_rate_rad_s=rate, even_turn_rate_rad_s=rate, turning_s=0.08, sharp_s=0.039
    )
    assert np.abs(turn_rate_with_details(wide) - rate).max() < 0.01


def test_a_turn_that_changes_sides_has_no_detail_larger_than_the_turn() -> None:
    """Where smoothing leaves a bump of 0.05 rad/s in two ticks, 7.8 rad/s of details were seen in a
    turn of half a radian per second, and neither gyro_nonlinearity nor gyro_lag fitted any more."""
    log = synthetic_recording(ROBOT, WIRE, DRIVE, [], 3, reference=EXACT, duration_s=20.0)
    motion = nodes_of(log, ROBOT).smooth
    rate = -0.25 * np.tanh((motion.t_s - 10.0) / 0.1)
    rate[1000:1002] += 0.05
    swung = replace(
        motion, turn_rate_rad_s=rate, even_turn_rate_rad_s=rate, turning_s=0.05, sharp_s=0.015
    )
    assert np.abs(turn_rate_with_details(swung) - rate).max() < 0.5


LARGE: dict[str, dict[str, Value]] = {
    "gyro_scale": {"scale": 0.06},
    "gyro_temperature_scale": {"slope": 0.01},
    "supply_ratio": {"coefficient": 2.0},
    "lateral_slip": {"compliance": 0.2},
    "turn_scrub": {"scrub": 0.3},
    "longitudinal_slip": {"compliance": 0.08},
    "reference_yaw": {"angle": -0.1},
}
WITHIN_SD = {"longitudinal_slip": 1.0}
"""Of kinks in a speed counters tell less than a gyro without noise: they are 0.7 of a standard
deviation."""
AROUND = (
    EffectSetting("warm_up", (("offset", -5.0), ("rise", 20.0), ("time_constant", 20.0))),
    EffectSetting("supply_change", (("offset", -0.2), ("rate", -0.02))),
)


@pytest.mark.parametrize("effect", LARGE)
def test_a_large_effect_is_fitted_within_half_a_standard_deviation(effect: str) -> None:
    """There is no noise: what is left is how far the explanation is from the simulator.

    Of a smooth rate, 1.7 to 10 standard deviations were left at these sizes, and about a heading
    that held the yaw 3.
    """
    around = AROUND if effect in ("gyro_temperature_scale", "supply_ratio") else ()
    setting = EffectSetting(effect, tuple(LARGE[effect].items()))
    log = synthetic_recording(
        without_noise(ROBOT), WIRE, DRIVE, (*around, setting), 3, reference=EXACT
    )
    model = MotionModel(log, ROBOT, default_prior())
    term, *_ = (one for one in model.columns.terms if one.variant.effect == effect)
    (size,) = (float(one) for one in LARGE[effect].values())
    levels = LEVELS.copy()
    levels[:2] = 1e-4
    model.columns = replace(model.columns, nuisances=())
    fit = model.refit([term], levels, free_levels=False, start=[(size,)])
    likeliest = int(np.argmax(fit.scored.weights))
    sd = float(np.sqrt(fit.scored.covariances[likeliest][0, 0]))
    assert abs(fit.coefficients[0][0] - size) < WITHIN_SD.get(effect, 0.5) * sd


@pytest.mark.parametrize("seed", [1, 2])
def test_tyres_that_creep_do_so_by_speeds_which_counters_tell(seed: int) -> None:
    """By accelerations, of which counters say little, 1,000 of 3,900 nats were lost about the steps
    of a command, surprises were twice what they should be, and on one robot a stretch of rough
    floor was likelier (unlisted, 1.0)."""
    creep = EffectSetting("longitudinal_slip", (("compliance", 0.12),))
    driven = drives.drive("one_way", np.random.default_rng(seed), 1.0)
    log = synthetic_recording(
        ROBOT, WIRE, driven, (creep,), 3, reference=ReferenceNoise(position_m=1e-4)
    )
    rest = frozenset(EXPLAINED) - {"longitudinal_slip"}
    scan = Scan(MotionModel(log, ROBOT, default_prior(), without=rest))
    assert scan.dispersion < 1.5
    assert scan.found[frozenset({"longitudinal_slip"})].levels[CONTACT] < 3e-4


def late_reference(effect: str, offset_s: float, skew: float) -> tuple[MotionModel, Term]:
    """Return a log without noise whose reference is late and runs fast, with nothing but these two
    free, and the term of the effect."""
    settings = [
        EffectSetting("reference_time_offset", (("offset", offset_s),)),
        EffectSetting("reference_clock_skew", (("skew", skew),)),
    ]
    log = synthetic_recording(without_noise(ROBOT), WIRE, DRIVE, settings, 3, reference=EXACT)
    model = MotionModel(log, ROBOT, default_prior())
    term, *_ = (one for one in model.columns.terms if one.variant.effect == effect)
    free = tuple(
        (index, sd)
        for index, sd in model.columns.nuisances
        if model.columns.little[index][0].effect in MOVES_IN_TIME
        and model.columns.little[index][0].coefficients != ("spread",)
    )
    assert len(free) == 2
    model.columns = replace(model.columns, nuisances=free)
    return model, term


@pytest.mark.parametrize("effect", ["reference_time_offset", "reference_clock_skew"])
def test_how_late_a_reference_is_and_how_its_clock_runs_are_told_apart_where_both_are_off(
    effect: str,
) -> None:
    """Each is free beside the other, along the way at the time that the reference speaks of: along
    that at its stamps 0.7 ms of 300 were told of the other (10 standard deviations)."""
    offset_s, skew = (0.3, 2e-5) if effect == "reference_time_offset" else (1e-3, 1e-3)
    model, term = late_reference(effect, offset_s, skew)
    levels = LEVELS.copy()
    levels[:2] = 1e-4
    size = offset_s if effect == "reference_time_offset" else skew
    fit = model.refit([term], levels, free_levels=False, start=[(size,)])
    likeliest = int(np.argmax(fit.scored.weights))
    sd = float(np.sqrt(fit.scored.covariances[likeliest][0, 0]))
    assert abs(fit.coefficients[0][0] - size) < 0.5 * sd


def test_a_large_skew_is_found_from_where_a_straight_line_led() -> None:
    """A step is judged along the way at the reference's own time as well: by that at its stamps it
    was cut short, 3.6 standard deviations from where it led to."""
    model, term = late_reference("reference_clock_skew", 1e-3, 3e-3)
    levels = LEVELS.copy()
    levels[:2] = 1e-4
    fit = model.refit([term], levels, free_levels=False)
    likeliest = int(np.argmax(fit.scored.weights))
    sd = float(np.sqrt(fit.scored.covariances[likeliest][0, 0]))
    assert abs(fit.coefficients[0][0] - 3e-3) < sd


@pytest.mark.parametrize("skew", [-9e-3, 9e-3])
def test_a_skew_by_which_a_log_ends_half_a_second_late_is_told_without_bias(skew: float) -> None:
    """The motion is bent onto the reference at the times that it speaks of; bent by one delay for
    all of the log, a skew of 0.9 % was told 2 to 13 standard deviations off."""
    model, term = late_reference("reference_clock_skew", 1e-3, skew)
    levels = LEVELS.copy()
    levels[:2] = 1e-4
    fit = model.refit([term], levels, free_levels=False)
    likeliest = int(np.argmax(fit.scored.weights))
    sd = float(np.sqrt(fit.scored.covariances[likeliest][0, 0]))
    assert abs(fit.coefficients[0][0] - skew) < 0.5 * sd


def test_a_scrub_that_doubles_every_turn_is_found_from_where_a_straight_line_led() -> None:
    """The line led beyond -1, where a robot turns the other way: the fit ended at -0.13, a search
    at -2.9. Within a hundredth: what is tested is where it ends."""
    scrub = -0.54
    setting = EffectSetting("turn_scrub", (("scrub", scrub),))
    log = synthetic_recording(without_noise(ROBOT), WIRE, DRIVE, (setting,), 3, reference=EXACT)
    model = MotionModel(log, ROBOT, default_prior())
    (term,) = (one for one in model.columns.terms if one.variant.effect == "turn_scrub")
    fit = model.refit([term], LEVELS, free_levels=False)
    assert fit.coefficients[0][0] == pytest.approx(scrub, abs=0.01)


def on_arcs(scrub: float) -> tuple[MotionModel, Term]:
    """Return a log without noise of a robot that turns and goes from back to forth, with nothing
    but its scrub free, and the scrub's term."""
    setting = EffectSetting("turn_scrub", (("scrub", scrub),))
    log = synthetic_recording(without_noise(ROBOT), WIRE, ARCS, (setting,), 3, reference=EXACT)
    model = MotionModel(log, ROBOT, default_prior())
    (term,) = (one for one in model.columns.terms if one.variant.effect == "turn_scrub")
    model.columns = replace(model.columns, nuisances=())
    return model, term


def test_a_scrub_is_as_sharp_as_a_robot_that_turns_goes_from_back_to_forth() -> None:
    """There its turning share passes one within a ramp: of smoothed rates 6 standard deviations
    were left."""
    scrub = -0.16
    model, term = on_arcs(scrub)
    levels = LEVELS.copy()
    levels[:2] = 1e-4
    fit = model.refit([term], levels, free_levels=False, start=[(scrub,)])
    sd = float(np.sqrt(fit.scored.covariances[int(np.argmax(fit.scored.weights))][0, 0]))
    assert abs(fit.coefficients[0][0] - scrub) < sd


def test_a_scrub_follows_a_wheel_that_sticks_where_it_turns_back() -> None:
    """It sticks for less time than rates are averaged over: by their first details the heading was
    six counts off over twelve such turns, some to one side and some to the other."""
    scrub = -0.4
    model, term = on_arcs(scrub)
    sharp = model.nodes.sharp
    change = residuals(model.nodes, predict(sharp, [(term.variant.in_detail, (scrub,))]))
    change -= residuals(model.nodes, predict(sharp))
    left = (model.columns.values[..., 0] + change)[2]
    motion = model.nodes.motion
    count_rad = motion.rad_per_count * motion.radius_m / motion.wheelbase_m
    assert np.ptp(left[np.isfinite(left)]) < 4.0 * count_rad


def test_a_turn_that_changes_sides_is_no_straight() -> None:
    """Its rate is low for a moment, and nothing is averaged there: a mean over what is calm around
    stood out of the turn, sharpened it was 9 rad/s where the wheels had 1."""
    model, _ = on_arcs(0.1)
    sharp, motion = model.nodes.sharp, model.nodes.motion
    apart = sharp.right_step_rad - sharp.left_step_rad
    counted = motion.right_step_rad - motion.left_step_rad
    around = gaussian_filter1d(counted, 0.05 / motion.tick_s)
    assert np.abs(apart - around).max() < 3.0 * motion.rad_per_count


def test_a_lag_within_tolerance_is_no_slip_of_wheels_that_speed_up() -> None:
    """It is free beside the slip, as sharply as turns begin: along a smooth rate, three
    milliseconds of it were told as 1.2 standard deviations of slip. They are 0.7 yet."""
    size = 0.02
    settings = (
        EffectSetting("gyro_lag", (("time_constant", 0.003),)),
        EffectSetting("longitudinal_slip", (("compliance", size),)),
    )
    robot = without_noise(ROBOT)
    trembling = replace(
        robot, plant=robot.plant.model_copy(update={"encoder": ROBOT.plant.encoder})
    )
    squares = drives.drive("squares", np.random.default_rng(2), 0.5)
    log = synthetic_recording(trembling, WIRE, squares, settings, 3, reference=EXACT)
    model = MotionModel(log, ROBOT, default_prior())
    term, _ = (one for one in model.columns.terms if one.variant.effect == "longitudinal_slip")
    levels = LEVELS.copy()
    levels[:2] = 3e-4
    fit = model.refit([term], levels, free_levels=False, start=[(size,)])
    sd = float(np.sqrt(fit.scored.covariances[int(np.argmax(fit.scored.weights))][0, 0]))
    assert abs(fit.coefficients[0][0] - size) < sd


def test_the_scale_of_a_gyro_is_told_exactly_where_the_reference_is_exact() -> None:
    """Details of the turn taken from headings bent onto the reference cost 10 to 60 nats, and what
    goes with the turn rate, unlisted, was likelier than the scale (> 0.999)."""
    scale = EffectSetting("gyro_scale", (("scale", 0.03),))
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (scale,), seed=1, reference=EXACT
    )
    found = Scan(MotionModel(log, ROBOT, default_prior())).found[frozenset({"gyro_scale"})]
    assert found.fell < 3.0
