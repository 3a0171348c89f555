"""Wheels that come apart to and fro, which no effect does."""

from dataclasses import replace

import numpy as np

from gap_diagnosis.recording import Recording

PERIOD_S = 40.0


def wandering_by(log: Recording, size: float) -> Recording:
    """Return a log whose wheels come apart by *size*, a part of their way, to and fro in 40 s."""
    share = 0.5 * size * np.sin(2 * np.pi * log.t_s / PERIOD_S)

    def rolled(ticks: np.ndarray, more: np.ndarray) -> np.ndarray:
        return ticks[0] + np.cumsum(np.diff(ticks, prepend=ticks[0]) * (1 + more))

    return replace(
        log,
        left_ticks=rolled(log.left_ticks, -share),
        right_ticks=rolled(log.right_ticks, share),
    )
