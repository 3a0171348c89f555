"""Before any fit: what a drive can show, how small, and what looks alike in it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from fake_blocks import FakeBlock
from structure_cases import PRIOR, ROBOT, analysis_of, drive, groups, model_of, seen, sights

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.drive.limits import BOUNDS, limits_of_bounds
from gap_diagnosis.explanations.registry import predict
from gap_diagnosis.imitation import merged
from gap_diagnosis.limits_elsewhere import limits_elsewhere
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import FrameTimes
from gap_diagnosis.structure import sights_of, structure_of, twins_on, visible
from hil_harness.effects import EffectSetting, catalogue

SCALE = EffectSetting("gyro_scale", (("scale", 0.03),))


@cache
def analysed(name: str, *effects: EffectSetting) -> Analysis:
    """Return the analysis of a drive with these effects; made once."""
    return analysis_of(drive(name, *effects))


def together(found, *effects):
    return any(set(effects) <= group for group in found)


def test_a_square_with_pure_spins_cannot_see_lateral_slip():
    """v·ω is zero all along."""
    assert seen("square")["lateral_slip"] is None
    assert seen("calibration")["lateral_slip"] is not None


def test_the_lessons_run_cannot_tell_a_forward_lever_arm_from_lateral_slip():
    """At constant speed v a slip c leaves what a lever arm of -c·v does."""
    assert together(groups("lesson"), "reference_lever_arm", "lateral_slip")


def test_a_heading_from_outside_tells_a_lever_arm_from_a_time_offset_positions_alone_do_not():
    """A point -v·τ ahead is where the robot was τ earlier; only the heading is late as well."""
    rows = {}
    for heading in (True, False):
        here = sights("lesson", heading=heading).logs[0]
        place = {key: row for row, key in enumerate(here.keys)}
        names = ("reference_lever_arm", "reference_time_offset", "lateral_slip")
        rows[heading] = here.inner[np.ix_(*[[place[name, 0, 0] for name in names]] * 2)]
    explained = {}
    for heading, inner in rows.items():
        pull = np.linalg.solve(inner[1:2, 1:2], inner[1:2, :1])
        explained[heading] = float((inner[:1, 1:2] @ pull)[0, 0] / inner[0, 0])
    assert explained[False] > 1.4 * explained[True]


def test_positions_alone_do_not_tell_a_time_offset_from_a_lever_arm_or_slip_on_the_lessons_run():
    """At constant speed v a point L ahead is where the robot will be in L/v, all along the run: at
    its ends too, where the log sees no further."""
    found = groups("lesson", heading=False)
    assert together(found, "reference_lever_arm", "lateral_slip", "reference_time_offset")
    with_headings = groups("lesson")
    assert not together(with_headings, "reference_lever_arm", "reference_time_offset")


def test_arcs_at_several_speeds_tell_a_lever_arm_from_lateral_slip():
    assert not together(groups("calibration"), "reference_lever_arm", "lateral_slip")


def test_without_a_reference_wheelbase_and_gyro_scale_are_one_group():
    assert together(groups("calibration", reference=False), "wheelbase_scale", "gyro_scale")
    assert not together(groups("calibration"), "wheelbase_scale", "gyro_scale")


def test_spins_and_straights_do_not_tell_scrub_from_a_wider_axle():
    assert together(groups("square"), "turn_scrub", "wheelbase_scale")
    assert not together(groups("calibration"), "turn_scrub", "wheelbase_scale")


def test_straight_ahead_the_axle_does_not_show():
    assert seen("straight")["wheelbase_scale"] is None
    assert seen("straight")["radius_mismatch"] is not None


def test_twins_stand_in_a_group_whatever_is_driven():
    for names in (
        ("radius_scale", "ticks_per_rev"),
        ("gyro_bias", "adc_offset"),
        (
            "gyro_scale",
            "adc_gain",
        ),
    ):
        assert together(groups("calibration"), *names)


def test_a_reference_that_is_too_long_is_larger_wheels_on_a_wider_axle():
    assert together(groups("calibration"), "reference_scale", "radius_scale", "wheelbase_scale")


def test_two_logs_see_at_least_what_each_sees():
    both = seen("square", "lesson")
    for one in (seen("square"), seen("lesson")):
        for effect, own in one.items():
            # A gyro that clips shows the sooner, the lower its limit is.
            if own is not None and effect != "gyro_saturation":
                assert both[effect].limit <= own.limit * 1.3


def test_a_second_drive_tells_apart_what_the_first_could_not():
    assert not together(groups("lesson", "calibration"), "reference_lever_arm", "lateral_slip")


@pytest.mark.parametrize("effect", ["turn_scrub", "longitudinal_slip", "adc_inl"])
def test_at_the_limit_the_separation_is_29(effect):
    """By least squares on whitened residuals, the other tolerances free.

    A column is the effect of its usual size, so at the limit it holds to a tenth.
    """
    model = model_of("square")
    levels = model.no_effect_levels
    limit = seen("square")[effect].limit
    terms = [one for one in model.columns.terms if one.variant.effect == effect]
    # Of two forms the one that shows more sets the limit.
    most = max(_separation(model, levels, term, limit) for term in terms)
    assert most == pytest.approx(THRESHOLD, rel=0.15)


def _separation(model, levels, term, size):
    moved = residuals(model.nodes, predict(model.nodes.motion, [(term.variant, (size,))]))
    nominal = model.columns.values[..., 0]
    own = {index for weight in term.weights for index, _ in weight}
    free = [(index, sd) for index, sd in model.columns.nuisances if index not in own]
    stack = [nominal - moved, *(model.columns.values[..., index + 1] for index, _ in free)]
    columns = np.ascontiguousarray(np.stack(stack, axis=-1))
    columns[..., 0] = np.where(np.isnan(nominal), np.nan, columns[..., 0])
    white, _ = whiten(columns, model.course, levels, model.nodes.ticks)
    others = np.vstack([white[:, 1:], np.diag([1 / sd for _, sd in free])])
    target = np.concatenate([white[:, 0], np.zeros(len(free))])
    left = target - others @ np.linalg.lstsq(others, target, rcond=None)[0]
    return float(left @ left)


def test_no_limit_lies_below_its_tolerance_or_beyond_what_is_believed():
    for effect, own in seen("calibration").items():
        known = PRIOR.parameters.get(effect, {}).get("all")
        if own is not None and known is not None:
            assert own.limit <= known.high


def test_the_answer_lists_every_effect_once_with_its_limit():
    structure = structure_of([analysed("square", SCALE)])
    assert set(structure.detectable) <= set(catalogue())
    assert structure.detectable["lateral_slip"] is None
    assert structure.detectable["ticks_per_rev"] == structure.detectable["radius_scale"]
    assert structure.detectable["firmware_truncation"] is None
    assert structure.detectable["gyro_noise"] == pytest.approx(
        2 * ROBOT.plant.gyro.noise_density_rad_per_sqrt_s
    )
    assert all(list(group) == sorted(set(group)) for group in structure.groups)
    assert not any(set(one) < set(other) for one, other in combinations(structure.groups, 2))


def test_what_is_foreseen_is_of_the_drive_and_the_description_alone():
    """No fit has a say in it: a model that was never fitted says the same."""
    fitted = analysed("square", SCALE)
    unfitted = MotionModel(fitted.recording, ROBOT, PRIOR)
    told = visible(sights_of([(unfitted, unfitted.level_prior.median)]))
    foreseen = structure_of([fitted]).foreseen
    assert foreseen is not None
    shown = {name: one.limit for name, one in told.items() if one is not None}
    assert {name: foreseen.detectable[name] for name in shown} == shown
    assert foreseen.detectable["lateral_slip"] is None


def test_what_is_foreseen_is_told_of_every_effect_that_is_told_of_at_all():
    """What frames, codes and odometry show has no noise that a fit would find."""
    motion = analysed("square")
    owned = ("frame_loss", "adc_stuck_bit", "drive_saturation", "encoder_dead")
    log = replace(motion, blocks=(*motion.blocks, FakeBlock(dict.fromkeys(owned, 0.0))))
    structure = structure_of([log])
    assert structure.foreseen is not None
    foreseen, found = structure.foreseen.detectable, structure.detectable
    assert set(foreseen) == set(found)
    assert {name: foreseen[name] for name in owned} == {name: found[name] for name in owned}
    assert foreseen["ticks_per_rev"] == foreseen["radius_scale"] is not None


def test_louder_noise_than_described_shows_less_than_was_foreseen():
    loud = drive("calibration", EffectSetting("gyro_noise", (("density", 1e-2),)))
    asked = ("gyro_nonlinearity", "gyro_vibration")
    structure = structure_of([analysis_of(loud, *asked, "gyro_bias", "gyro_scale")])
    assert structure.foreseen is not None
    for effect in asked:
        foreseen, found = structure.foreseen.detectable[effect], structure.detectable[effect]
        assert foreseen is not None
        assert found is None or found > foreseen


def test_bounds_of_the_drive_are_seen_as_far_as_commands_reach():
    motion = analysed("square")
    commanded = replace(
        motion, blocks=(*motion.blocks, FakeBlock(dict.fromkeys(BOUNDS, 0.0), name="drive"))
    )
    assert structure_of([motion]).detectable["drive_saturation"] is None
    found = structure_of([commanded]).detectable
    assert {name: found[name] for name in BOUNDS} == limits_of_bounds([motion.recording], ROBOT)


def frames(count):
    """Return so many frames, a hundred per second."""
    counter = np.arange(count)
    return FrameTimes(counter * 0.01, counter, 256, 0.01, counter.astype(np.uint64))


def test_what_happens_by_chance_shows_the_sooner_the_more_frames_there_are():
    """Twice the expected log of (so often) to (as often as it may anyway) is 29."""
    drives = [drive("straight"), drive("square")]
    logs = [
        replace(one, frames={"ENCODER": frames(count)})
        for one, count in zip(drives, (1000, 12000), strict=True)
    ]
    block = FakeBlock(
        dict.fromkeys(("frame_loss", "frame_jitter", "frame_latency"), 0.0), name="bus"
    )
    few, many = (limits_elsewhere([one], [block]) for one in logs)
    usual = PRIOR.ranges["frame_loss"]["usual"][1]
    for found, count in ((few, 1000), (many, 12000)):
        rate = found["frame_loss"]
        lost, kept = rate * count, (1 - rate) * count
        told = lost * np.log(rate / usual) + kept * np.log((1 - rate) / (1 - usual))
        assert 2 * told == pytest.approx(THRESHOLD)
    assert many["frame_loss"] < few["frame_loss"] / 4
    assert many["frame_jitter"] > PRIOR.ranges["frame_jitter"]["usual"][1]
    assert limits_elsewhere(logs, [block])["frame_latency"] < many["frame_latency"]
    assert few["stale_producer"] is None


def test_a_mistake_of_the_setup_shows_wherever_anything_does():
    assert limits_elsewhere([drive("straight")], [FakeBlock({"gyro_bias": 0.0})])["setup_sign"] == 0
    assert limits_elsewhere([drive("straight")], [])["setup_sign"] is None


def test_temperature_and_supply_that_stay_are_twins_of_bias_and_scale():
    found = twins_on([drive("straight")])
    assert {"gyro_temperature_bias", "gyro_bias"} in found
    warm = EffectSetting("warm_up", (("offset", 0.0), ("rise", 20.0), ("time_constant", 5.0)))
    assert {"gyro_temperature_bias", "gyro_bias"} not in twins_on([drive("straight", warm)])


def test_a_group_holds_single_imitators_or_else_the_best_pair():
    found = {
        "a": [frozenset({"b"}), frozenset({"c"})],
        "d": [frozenset({"a", "e"}), frozenset({"b", "e"})],
        "b": [frozenset({"a"})],
    }
    assert merged(found, [frozenset({"c", "t"})]) == [
        frozenset({"a", "b", "c", "t"}),
        frozenset({"a", "d", "e"}),
    ]
