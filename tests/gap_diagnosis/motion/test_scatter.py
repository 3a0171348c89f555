"""Counts that are lost or come at random scatter by their own law, and are no rougher contact."""

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE

from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

CONTACT_M_PER_SQRT_M = 3e-4
SETTINGS = {
    "extra_ticks": (("side", "right"), ("rate", 12.0)),
    "missed_ticks": (("side", "right"), ("probability", 0.03), ("threshold", 0.0)),
}


@pytest.mark.parametrize("effect", SETTINGS)
def test_the_contact_is_as_smooth_as_it_is_beside_counts_at_random(effect: str) -> None:
    """Of some 60 m in blocks a level is known to about a tenth; 1.5 is five times that."""
    log = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("calibration"),
        (EffectSetting(effect, SETTINGS[effect]),),
        5,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=CONTACT_M_PER_SQRT_M,
    )
    model = MotionModel(log, ROBOT, default_prior())
    term = next(
        one
        for one in model.columns.terms
        if one.variant.effect == effect
        and one.variant.report["side"] == "right"
        and not one.variant.fixed.get("threshold")
    )
    found = model.refit((term,), model.level_prior.median)
    assert np.exp(abs(np.log(found.levels[0] / CONTACT_M_PER_SQRT_M))) < 1.5
    ((size,),) = found.coefficients
    likeliest = int(np.argmax(found.scored.weights))
    sd = float(np.sqrt(found.scored.covariances[likeliest][0, 0]))
    assert size == pytest.approx(float(SETTINGS[effect][1][1]), abs=4 * sd)


def test_no_slip_is_sought_where_a_wheel_stands_however_its_counter_trembles() -> None:
    """A slip of more than all takes a counter's noise at rest away with itself: 10 nats."""
    rests_s = 8.0
    log = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("calibration"),
        (EffectSetting("extra_ticks", SETTINGS["extra_ticks"]),),
        5,
        reference=ReferenceNoise(),
        duration_s=40.0,
    )
    assert (
        np.ptp(log.left_ticks[log.t_s < rests_s]) < 5 < np.ptp(log.right_ticks[log.t_s < rests_s])
    )
    columns = MotionModel(log, ROBOT, default_prior()).columns
    windows = [one.variant.fixed for one in columns.terms if one.variant.effect == "one_sided_slip"]
    assert min(one["stop_s"] for one in windows) > rests_s
    assert min(one["start_s"] for one in windows) < rests_s
