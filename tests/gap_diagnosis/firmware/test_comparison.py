"""How a replay is held against the record: what is likelier by chance is not much likelier."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t as student_t

from gap_diagnosis.firmware.comparison import (
    LOG_NO_EXCUSE,
    _to_digits,
    cut_windows,
    exact_scores,
    score,
)
from gap_diagnosis.firmware.inputs import Odometry

QUANTUM = 2.0**-30


def test_the_chance_of_a_last_digit_is_worth_less_than_a_nat() -> None:
    t_s = np.arange(1000) * 0.01
    pose = np.column_stack([0.3 * t_s, 0.1 * t_s, 0.2 * t_s])
    windows = cut_windows(Odometry(pose, QUANTUM, QUANTUM), t_s)
    # Each window misses by one digit more than the one before it.
    window = np.searchsorted(windows.first, np.arange(len(t_s)), side="right")
    scores = [
        score(windows, pose + digits * QUANTUM * window[:, None] * [0.0, 0.0, 1.0])
        for digits in np.arange(1.0, 20.0, 0.25)
    ]
    jumps = np.abs(np.diff(scores)) / windows.count
    assert np.max(jumps) < 1.0
    assert scores[0] > scores[-1]


def test_misfits_of_a_few_digits_are_as_likely_as_students_density_has_them() -> None:
    t_s = np.arange(1000) * 0.01
    pose = np.column_stack([0.3 * t_s, 0.1 * t_s, 0.2 * t_s])
    windows = cut_windows(Odometry(pose, QUANTUM, QUANTUM), t_s)
    off, log_density = _to_digits(windows, pose * (1.0 + 1e-8))
    digits = 3.0 * QUANTUM
    expected = student_t.logpdf(off / digits, 4.0) + np.log(windows.floor / digits) - math.log(2)
    wild = np.abs(off) > digits  # no window of these is equal
    assert wild.any()
    assert log_density[wild] == pytest.approx(expected[wild])


def test_a_kernel_that_ran_gives_the_record_or_was_changed() -> None:
    t_s = np.arange(1000) * 0.01
    pose = np.column_stack([0.3 * t_s, 0.1 * t_s, 0.2 * t_s])
    windows = replace(cut_windows(Odometry(pose, QUANTUM, QUANTUM), t_s), has_all_inputs=True)
    same, changed = exact_scores(windows, pose)
    assert same > changed + 1000.0 - 30.0
    other, changed = exact_scores(windows, pose + 40.0 * QUANTUM * t_s[:, None])
    assert other == changed + LOG_NO_EXCUSE
