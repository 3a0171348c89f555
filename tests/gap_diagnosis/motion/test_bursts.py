"""A wheel that loses its hold now and then is told with its windows, as an unlisted cause."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE, nothing_of

from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.bursts import Burst, find_burst
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.scenarios import scenario

ICE = ((12.0, 14.0, 0.4), (27.0, 28.5, 0.25), (43.0, 46.0, 0.6))
"""Start and stop [s], and what share of the way the left wheel slips."""
STILL = replace(scenario("figure8"), effects=())
QUIET = synthetic_recording(ROBOT, WIRE, STILL, (), 5, reference=ReferenceNoise(), duration_s=60.0)


def on_ice(recording: Recording) -> Recording:
    """Return the recording with a left wheel that turns more than it moves, again and again."""
    slip = np.zeros(len(recording.t_s))
    for start_s, stop_s, ratio in ICE:
        slip[(recording.t_s > start_s) & (recording.t_s <= stop_s)] = ratio
    steps = np.diff(recording.left_ticks, prepend=recording.left_ticks[0])
    extra = np.rint(np.cumsum(steps * slip / (1 - slip)))
    return replace(recording, left_ticks=recording.left_ticks + extra)


def burst_of(recording: Recording) -> tuple[Burst | None, Found]:
    """Return what is found beside no effect, and the account of no effect."""
    model = MotionModel(recording, ROBOT, default_prior())
    nothing = nothing_of(model)
    return find_burst(model, nothing, nothing), nothing


def covered(windows: tuple[tuple[float, float], ...], t_s: Floats) -> Floats:
    return np.array([any(start <= t <= stop for start, stop in windows) for t in t_s])


def test_a_slip_that_comes_back_is_told_with_its_side_and_windows() -> None:
    burst, nothing = burst_of(on_ice(QUIET))
    assert burst is not None
    assert burst.side == "left"
    assert burst.log_evidence > nothing.log_evidence + 500
    assert burst.contact_m_per_sqrt_m > 0.01
    middles = np.array([0.5 * (start + stop) for start, stop, _ in ICE])
    assert covered(burst.windows, middles).all()
    assert sum(stop - start for start, stop in burst.windows) < 12.0


def test_wheels_that_hold_have_no_such_windows() -> None:
    assert burst_of(QUIET)[0] is None


@pytest.mark.parametrize("seed", range(3))
def test_a_reference_that_measures_worse_for_a_while_takes_no_wheels_hold(seed: int) -> None:
    """A camera fewer saw a healthy robot for half a second: its wheel lost its hold, 0.96."""
    reference = QUIET.reference
    assert reference is not None
    assert reference.heading_rad is not None
    draw = np.random.default_rng(seed)
    noise = np.where((reference.t_s > 31.2) & (reference.t_s < 31.9), 4e-3, 0.0)
    x_m, y_m = (
        one + noise * draw.standard_normal(len(noise)) for one in (reference.x_m, reference.y_m)
    )
    seen = replace(reference, x_m=x_m, y_m=y_m)
    assert burst_of(replace(QUIET, reference=seen))[0] is None
