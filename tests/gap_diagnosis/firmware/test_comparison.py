"""How a replay is held against the record: what is likelier by chance is not much likelier."""

import numpy as np

from gap_diagnosis.firmware.comparison import cut_windows, score
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
