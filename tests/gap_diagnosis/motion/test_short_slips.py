"""A wheel that slips for less than a second in a long log is told when and which it was."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from full_size import at_full_size
from motion_cases import ROBOT, WIRE

from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.slips import SLIP, windows_beside
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario
from hil_harness.scenarios.model import Scenario
from hil_harness.scenarios.profile import Segment, SegmentProfile

BASE = EffectSetting("wheelbase_scale", (("scale", 0.02),))
APART_S = 0.2
CLEAR = 20.0
NO_NEWS = 5.0
"""Less evidence than this [nat] is none: a pair's prior is smaller by as much."""


def slipping(
    side: str, start_s: float, stop_s: float, *others: EffectSetting, ratio: float, seed: int
) -> MotionModel:
    """Return the log of a calibration drive on which a wheel slips in a window."""
    window = (("start_s", start_s), ("stop_s", stop_s))
    slip = EffectSetting(SLIP, (("side", side), ("ratio", ratio), *window))
    recording = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("calibration"), effects=()),
        [slip, *others],
        seed,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
    )
    return MotionModel(recording, ROBOT, default_prior())


def told(term: Term) -> tuple[str, float, float]:
    fixed = term.variant.fixed
    return str(term.variant.report["side"]), fixed["start_s"], fixed["stop_s"]


@pytest.mark.parametrize(
    ("start_s", "stop_s", "ratio", "seed"),
    [(95.075, 95.775, 0.15, 630234), *at_full_size((97.314, 100.314, 0.04, 628030))],
    ids=["a fraction of a second", "as the robot spins"],
)
def test_a_short_slip_is_told_of_its_own_wheel_and_alone(
    start_s: float, stop_s: float, ratio: float, seed: int
) -> None:
    """A window of 0.7 s weighs a fourteenth in each of the grid's: counts too many from 87 to 93 s
    were told for it (0.99). Of a slip in a spin the grid's best window was the other wheel's, and
    that one alone was sought more closely, half as large, and a scrub beside it (> 0.99)."""
    scan = Scan(slipping("right", start_s, stop_s, ratio=ratio, seed=seed))
    found = scan.account(frozenset({SLIP}))
    side, first_s, last_s = told(found.terms[0])
    assert side == "right"
    assert abs(first_s - start_s) < APART_S
    assert abs(last_s - stop_s) < APART_S
    rivals = [one for effects, one in scan.found.items() if SLIP not in effects]
    assert all(one.log_evidence < found.log_evidence - CLEAR for one in rivals)
    assert all(one.log_evidence < found.log_evidence + NO_NEWS for one in scan.found.values())


def test_a_wheel_that_spins_is_no_gyro_at_the_end_of_its_range() -> None:
    """While a robot turned on the spot one of its wheels lost its hold and spun half as fast again
    for 2 s. A gyro that saturated led; beside it the slip was worth nothing, and by itself nobody
    sought its window (of a Create an unlisted cause, 0.96)."""
    turns = [Segment(0.0, *one, 0.5) for one in ((-0.7, 6.0), (-0.75, 8.0), (-0.8, 5.0))]
    ahead = Segment(0.2, 0.0, 6.0, 0.5)
    profile = SegmentProfile([Segment(0.0, 0.0, 4.0, 0.5), ahead, *turns, ahead], final_ramp_s=0.5)
    spot = Scenario("spot", "", profile, duration_s=profile.duration_s + 6.0)
    log = synthetic_recording(
        ROBOT, WIRE, spot, (), 1, reference=None, contact_noise_m_per_sqrt_m=5e-4
    )
    spins = (log.t_s > 18.0) & (log.t_s <= 20.0)
    more = np.cumsum(np.where(spins, 0.5 * np.diff(log.left_ticks, prepend=0.0), 0.0))
    log = replace(log, left_ticks=log.left_ticks + np.rint(more))
    found = Scan(MotionModel(log, ROBOT, default_prior())).likeliest
    # Of a turn on the spot alone nothing tells whose wheel it was.
    assert found.effects == {SLIP}
    assert told(found.terms[0])[1:] == pytest.approx((18.0, 20.0), abs=APART_S)


def test_a_short_slip_is_found_beside_an_effect_that_leads() -> None:
    model = slipping("left", 95.075, 96.075, BASE, ratio=0.15, seed=11)
    slips = [term for term in model.columns.terms if term.variant.effect == SLIP]
    base = [term for term in model.columns.terms if term.variant.effect == "wheelbase_scale"]
    found = windows_beside(model, [*base, *slips[:1]], slips, model.level_prior.median)
    windows = [told(edged.term) for edged, _ in found]
    (left,) = [one for one in windows if one[0] == "left"]
    assert left[1:] == pytest.approx((95.075, 96.075), abs=APART_S)


def test_wheels_that_never_slip_get_no_window() -> None:
    recording = synthetic_recording(
        ROBOT, WIRE, replace(scenario("calibration"), effects=()), [BASE], 3,
        reference=ReferenceNoise(), contact_noise_m_per_sqrt_m=5e-4,
    )  # fmt: skip
    model = MotionModel(recording, ROBOT, default_prior())
    slips = [term for term in model.columns.terms if term.variant.effect == SLIP]
    base = [term for term in model.columns.terms if term.variant.effect == "wheelbase_scale"]
    assert windows_beside(model, base, slips, model.level_prior.median) == []
