"""What a counter shows is undone exactly: where it wraps, and where its disc is off centre."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, nodes_of

from gap_diagnosis.explanations import EXPLAINED, predict
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

BITS = 12
AMPLITUDE_RAD, PHASE_RAD = 0.1, 0.7


def test_a_counter_that_wraps_is_followed_over_rows_that_are_lost_there() -> None:
    narrow = EffectSetting("encoder_wrap", (("bits", BITS),))
    wrapped, plain = (
        synthetic_recording(ROBOT, WIRE, scenario("calibration"), effects, 3, duration_s=60.0)
        for effects in ((narrow,), ())
    )
    jumps = np.flatnonzero(np.abs(np.diff(wrapped.left_ticks)) > 2 ** (BITS - 1))
    assert len(jumps) > 3
    lost = wrapped.left_ticks.copy()
    lost[jumps[::2] + 1] = np.nan
    motion = estimate_motion(replace(wrapped, left_ticks=lost), ROBOT)
    assert motion.wrap_bits == BITS
    turned = (plain.left_ticks[-1] - plain.left_ticks[0]) * motion.rad_per_count
    assert motion.left_angle_rad[-1] == pytest.approx(turned, abs=1e-9)


def test_a_disc_far_off_centre_is_undone_at_the_angle_that_the_wheel_has() -> None:
    """At the angle that was read instead, a quarter of a percent of a turn would remain."""
    log = synthetic_recording(ROBOT, WIRE, scenario("calibration"), (), 3, duration_s=30.0)
    motion = nodes_of(log).motion
    true = motion.left_angle_rad
    read = true + AMPLITUDE_RAD * np.sin(true + PHASE_RAD)
    steps = np.diff(read, prepend=read[0])
    measured = replace(motion, left_angle_rad=read, left_step_rad=steps)
    (variant, _) = EXPLAINED["encoder_eccentricity"].variants(motion)
    sizes = AMPLITUDE_RAD * np.cos(PHASE_RAD), AMPLITUDE_RAD * np.sin(PHASE_RAD)
    found = predict(measured, [(variant, sizes)]).left_rad
    assert np.cumsum(found) == pytest.approx(true - true[0], abs=5e-5)
