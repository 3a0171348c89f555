"""A message late by more than its counter tells keeps its ticks by what the gyro turned."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from drives import Drive, drive, encoded, read_lines, write_lines
from hypothesis import given, settings
from hypothesis import strategies as st

from can_bus import COUNTER_MODULO
from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.whole_rounds import MOST_ROUNDS, rounds_late
from hil_harness import load_robot

ENCODER, IMU = "0C1", "0C7"
ROBOT = load_robot()


def turning(ticks: int, seed: int) -> Drive:
    """Return a drive whose gyro turns as its wheels do."""
    table = drive(ticks, seed=seed)
    random = np.random.default_rng(seed)
    turn = np.repeat(random.normal(0, 1, ticks // 80 + 1), 80)[:ticks]
    smooth = np.convolve(turn, np.full(30, 1 / 30), mode="same")
    speed = 40.0 + 10 * np.sin(np.arange(ticks) / 90)
    table.columns["left_ticks"] = np.rint(np.cumsum(speed - 6 * smooth))
    table.columns["right_ticks"] = np.rint(np.cumsum(speed + 6 * smooth))
    table.columns["gyro_code"] = np.rint(32768 + 1500 * smooth + random.normal(0, 20, ticks))
    return table


@pytest.mark.parametrize("message", [ENCODER, IMU])
@pytest.mark.parametrize("delay_s", [0.012, 0.1, 0.314, 0.85])
def test_gyro_and_wheels_keep_their_rows_however_late_the_frames_of_one_are(
    message: str, delay_s: float, tmp_path: Path
) -> None:
    """A counter counts 150 ms: 314 were taken for 14, with the gyro 30 ticks late in every row."""
    table = turning(4000, seed=1)
    lines = [
        replace(one, stamp_s=one.stamp_s + delay_s) if one.message == message else one
        for one in read_lines(encoded(table, tmp_path))
    ]
    log = write_lines(tmp_path / "late.log", sorted(lines, key=lambda one: one.stamp_s))
    found = read_recording(log, robot=ROBOT)
    assert found.gyro_code is not None
    both = np.isfinite(found.gyro_code) & np.isfinite(found.left_ticks)
    assert both.sum() > 3800
    steps = found.left_ticks[both] - found.left_ticks[both][0]
    codes = found.gyro_code[both]
    first = int(np.flatnonzero(table.columns["gyro_code"] == codes[0])[0])
    start = next(
        k
        for k in range(max(first - 3, 0), first + 4)
        if np.array_equal(table.columns["gyro_code"][k : k + len(codes)], codes)
    )
    want = table.columns["left_ticks"][start : start + len(codes)]
    assert np.array_equal(steps, want - want[0])


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 1000), rounds=st.integers(-MOST_ROUNDS, MOST_ROUNDS))
def test_the_rounds_by_which_one_turn_follows_another_are_counted(seed: int, rounds: int) -> None:
    table = turning(4000, seed)
    wheels = np.diff(table.columns["right_ticks"] - table.columns["left_ticks"], prepend=np.nan)
    gyro = np.roll(table.columns["gyro_code"], rounds * COUNTER_MODULO)
    assert rounds_late(wheels, -gyro, COUNTER_MODULO) == rounds


@pytest.mark.parametrize("lag_ticks", [3, 7, 11, 20])
def test_a_gyro_that_lags_by_itself_is_late_by_no_round(lag_ticks: int) -> None:
    table = turning(4000, seed=2)
    wheels = np.diff(table.columns["right_ticks"] - table.columns["left_ticks"], prepend=np.nan)
    gyro = np.roll(table.columns["gyro_code"], lag_ticks)
    assert rounds_late(wheels, gyro, COUNTER_MODULO) == 0


def test_what_does_not_turn_is_late_by_no_round() -> None:
    random = np.random.default_rng(3)
    still, noise = np.zeros(4000), random.normal(0, 1, 4000)
    assert rounds_late(still, noise, COUNTER_MODULO) == 0
    assert rounds_late(noise, random.normal(0, 1, 4000), COUNTER_MODULO) == 0
    assert rounds_late(np.full(4000, np.nan), noise, COUNTER_MODULO) == 0
    assert rounds_late(noise[:100], noise[:100], COUNTER_MODULO) == 0
