"""A push that no wheel makes is told with its moment, as an unlisted cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, model_of, moved_only, some_of

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.pushes import Pushes, _Log, find_pushes
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting, catalogue
from hil_harness.robot import Robot
from hil_harness.scenarios import scenario

AT_S, YAW_RAD, FORWARD_M = 23.4, -0.01, 0.004
PUSH = EffectSetting("floor_bump", (("time", AT_S), ("yaw", YAW_RAD), ("forward", FORWARD_M)))


COARSE = replace(
    ROBOT,
    plant=ROBOT.plant.model_copy(
        update={"encoder": ROBOT.plant.encoder.model_copy(update={"ticks_per_rev": 512})}
    ),
)
"""A count of which turns the body by 2.1 mrad."""


def push(yaw_rad: float) -> EffectSetting:
    """Return a push on the spot."""
    return EffectSetting("floor_bump", (("time", AT_S), ("yaw", yaw_rad), ("forward", 0.0)))


def driven(
    seed: int,
    *effects: EffectSetting,
    robot: Robot = ROBOT,
    duration_s: float | None = 60.0,
) -> Recording:
    """Return a drive with what acts in it, of a minute or of its whole length."""
    return synthetic_recording(
        robot,
        WIRE,
        scenario("calibration"),
        effects,
        seed,
        reference=ReferenceNoise(),
        duration_s=duration_s,
    )


def pushes_of(log: Recording, robot: Robot = ROBOT) -> Pushes | None:
    """Return what is found beside no effect."""
    model = model_of(log, robot=robot)
    nothing = Found(frozenset(), (), 0.0, 0.0, model.no_effect_levels)
    return find_pushes(model, nothing, nothing)


def test_a_push_is_found_at_its_moment_and_as_far_as_it_went() -> None:
    found = pushes_of(driven(3, PUSH))
    assert found is not None
    (at_s,) = found.at_s
    # A tick is 10 ms, and of a block of five ticks only the mean is compared.
    assert at_s == pytest.approx(AT_S, abs=0.05)
    # One reading of heading and place before and after it is off by 0.5 mrad and 0.5 mm at most.
    turned_rad, forward_m, left_m = found.steps[0]
    assert turned_rad == pytest.approx(YAW_RAD, abs=1.5e-3)
    assert forward_m == pytest.approx(FORWARD_M, abs=1.5e-3)
    assert left_m == pytest.approx(0.0, abs=1.5e-3)
    assert found.log_evidence > 100


def test_a_healthy_robot_is_pushed_by_nothing(size: str) -> None:
    for seed in some_of(size, range(6), 3):
        assert pushes_of(driven(seed, duration_s=None)) is None


@pytest.mark.parametrize(
    ("robot", "yaw_rad", "is_one"),
    [(ROBOT, 2e-3, False), (ROBOT, 4e-3, True), (COARSE, 3.7e-3, False)],
)
def test_a_push_of_less_than_two_counts_or_three_milliradians_is_no_gap(
    robot: Robot, yaw_rad: float, is_one: bool
) -> None:
    """How far a wheel rolled on after its last count, only the gyro saw: 0.8 mrad were a push."""
    assert (pushes_of(driven(3, push(yaw_rad), robot=robot), robot) is not None) == is_one


def test_a_camera_that_is_pushed_is_no_pushed_robot() -> None:
    """The reference's heading leaps by as much; the gyro knows of nothing."""
    log = driven(3)
    assert log.reference is not None
    assert log.reference.heading_rad is not None
    after = log.reference.t_s > AT_S
    pushed = replace(
        log.reference,
        x_m=log.reference.x_m + np.where(after, FORWARD_M, 0.0),
        heading_rad=log.reference.heading_rad + np.where(after, YAW_RAD, 0.0),
    )
    assert pushes_of(replace(log, reference=pushed)) is None


RIVALS = frozenset(
    {
        "gyro_bias",
        "gyro_temperature_bias",
        "gyro_vibration",
        "one_sided_slip",
        "radius_mismatch",
        "reference_yaw",
        "wheelbase_scale",
    }
)
"""What a push passed for, and what it might pass for."""


def test_a_pushed_robot_is_told_when_and_how_far() -> None:
    """A push of 500 nats was no gap, or rough contact, or a gyro that drifts."""
    others = frozenset(catalogue()) - RIVALS
    log = moved_only(driven(4, PUSH, duration_s=40.0))
    found = diagnose_recordings([log], ROBOT, WIRE, without=others).diagnosis
    assert (found.verdict, found.stage) == ("unknown", "wheel")
    (note,) = [one for one in found.notes if "no wheel turns with it" in one]
    assert "at 23.4" in note
    assert found.unknown is not None
    (window,) = found.unknown.windows
    assert window[0] < AT_S < window[1]


def test_what_a_fit_explains_and_straight_lines_do_not_is_no_push() -> None:
    """A wheel that loses a fiftieth of its counts above 5 rad/s: a push was sought for 0.3 s."""
    lost = (("side", "left"), ("probability", 0.02), ("threshold", 5.0))
    log = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("random"),
        [EffectSetting("missed_ticks", lost)],
        5,
        reference=ReferenceNoise(),
        duration_s=40.0,
    )
    model = model_of(log, "missed_ticks")
    scan = Scan(model)
    best = max(scan.found.values(), key=lambda one: one.log_evidence)
    assert best.effects == {"missed_ticks"}
    assert best.refitted is not None
    log_of_model = _Log(model)
    assert log_of_model.stands_out_beside(replace(best, refitted=None))
    assert not log_of_model.stands_out_beside(best)
