"""An effect beyond tolerance is told beside what a healthy robot is off by within it."""

from pathlib import Path

import pytest
from car_cases import driven
from wandering import wandering_by

from gap_diagnosis.analysis import _beside_slack
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.unknown import within_tolerance
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.effects import parse_effect
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

ROBOT = load_robot()
TYRE = {"left_larger": 0.02, "wander": 8e-4}
CLEARLY = 3.0
"""So much likelier [nat] is twenty times likelier."""


def block_of(*effects: str) -> MotionBlock:
    """Return the block of a drive with effects whose wheels wander by nearly a tolerance."""
    log = synthetic_recording(
        ROBOT,
        load_wire(),
        scenario("calibration"),
        tuple(parse_effect(one) for one in effects),
        3,
        reference=ReferenceNoise(2e-4, 2e-4, 1e-4, 1e-4),
        contact_noise_m_per_sqrt_m=1e-4,
    )
    wandering = wandering_by(log, 0.8 * ROBOT.tolerance.radius_mismatch)
    return MotionBlock(MotionModel(wandering, ROBOT, default_prior()))


def test_a_wheelbase_beyond_tolerance_is_told_beside_wheels_that_wander_within_it() -> None:
    """Of 32 nats that the wandering explains the wheelbase's 10 were taken, as if it were a rival:
    a robot in another engine with 0.8 % of scrub was no gap at 92 %, and turned 0.2 degrees off
    where noise leaves 0.04. Eight nats are odds of 3,000, against prior odds of 1 in 60."""
    motion = block_of("wheelbase_scale.scale=0.009")
    beside, unlisted = _beside_slack(motion, gross=False)
    singles = [one for one in beside.scan.found.values() if len(one.effects) == 1]
    best = max(singles, key=lambda one: one.log_evidence)
    assert best.effects == {"wheelbase_scale"}
    assert beside.explained > 8
    assert within_tolerance(unlisted) < 0.5 * beside.explained
    assert best.refitted is not None
    assert best.refitted.coefficients[0][0] == pytest.approx(0.009, abs=0.002)


def test_wheels_that_only_wander_within_tolerance_stay_no_gap() -> None:
    motion = block_of()
    beside, _ = _beside_slack(motion, gross=False)
    assert beside.explained < 3


@pytest.mark.full_size
def test_a_larger_tyre_of_a_car_is_told_beside_wheels_that_wander_within_tolerance(
    tmp_path: Path,
) -> None:
    """A wheel that errs by some smooth function of its way errs by as much everywhere, too, so that
    an unlisted cause was likelier than the tyre by 22 nats: it explained that and the rest."""
    beside, unlisted = _beside_slack(MotionBlock(driven(tmp_path, 1, **TYRE)), gross=False)
    assert beside.scan.likeliest.effects == {"radius_mismatch", "radius_scale"}
    assert max(one.log_evidence for one in unlisted) < beside.explained - CLEARLY
