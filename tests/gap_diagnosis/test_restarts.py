"""A controller that restarts while its robot drives counts from nought, and no wheel leapt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.restarts import with_restarts
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness import load_robot, load_wire, scenario
from hil_harness.effects import parse_effect

ROBOT = load_robot(None)
WIRE = load_wire()
WHOLE = synthetic_recording(
    ROBOT,
    WIRE,
    replace(scenario("random"), effects=()),
    (),
    1,
    reference=ReferenceNoise(),
    duration_s=60.0,
)


def leaping(whole: Recording, row: int, left: float, right: float) -> Recording:
    """Return a recording whose counts leap before a row."""
    after = np.arange(len(whole.t_s)) >= row
    return replace(
        whole,
        left_ticks=whole.left_ticks + left * after,
        right_ticks=whole.right_ticks + right * after,
    )


def off(found: Recording) -> Floats:
    return np.array([found.left_ticks - WHOLE.left_ticks, found.right_ticks - WHOLE.right_ticks])


@given(
    row=st.integers(2, len(WHOLE.t_s) - 2),
    left=st.integers(9_000, 32_000),
    right=st.integers(-32_000, 32_000),
)
def test_counts_go_on_as_the_wheel_did_before(row: int, left: int, right: int) -> None:
    mended, found = with_restarts(leaping(WHOLE, row, left, right), ROBOT)
    assert found.t_s == (WHOLE.t_s[row],)
    assert abs(off(mended)[0]).max() <= 2.0, "a wheel's step differs from the one before by so much"
    assert found.left[0] == pytest.approx(left, abs=2.0)


@pytest.mark.parametrize(
    "effect",
    [
        "encoder_wrap.bits=12",
        "stale_producer.probability=0.01",
        "missed_ticks.probability=0.05",
        "encoder_dead.side=left",
        "ticks_per_rev.scale=0.5",
    ],
)
def test_what_an_effect_does_to_counts_is_no_restart(effect: str) -> None:
    seen = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("random"), effects=()),
        (parse_effect(effect),),
        1,
        reference=ReferenceNoise(),
        duration_s=60.0,
    )
    assert with_restarts(seen, ROBOT)[0] is seen


def test_counts_that_leap_all_the_time_are_left_to_others() -> None:
    wild = WHOLE
    for row in range(100, 5_000, 500):
        wild = leaping(wild, row, 20_000.0, 0.0)
    assert with_restarts(wild, ROBOT)[0] is wild


def test_a_restart_is_told_as_what_no_effect_explains() -> None:
    """It was eccentric wheels, a slope and a gyro at its end together (0.74)."""
    restarted = leaping(WHOLE, 3_000, -4_935.0, -9_317.0)
    restarted = leaping(restarted, 3_000, -10_000.0, -10_000.0)
    told = diagnose_recordings([restarted], ROBOT, WIRE).diagnosis
    assert (told.verdict, told.stage) == ("unknown", "encoder")
    (note,) = [one for one in told.notes if "leap" in one]
    assert "at 30.00 s" in note
