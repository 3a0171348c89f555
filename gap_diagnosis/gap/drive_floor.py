"""The gap that a drive's own noise leaves between commands and wheels, where nothing else is wrong.

No drive follows its commands exactly: the levels are those that the drive's likelihood has found.
Errors are small against the path, so the error of a path is linear in those of the wheels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gap_diagnosis.drive.data import DriveData
from gap_diagnosis.drive.noise import Levels, activity
from gap_diagnosis.gap.floor import DRAWS
from gap_diagnosis.gap.metrics import Path
from gap_diagnosis.gap.windows import Window
from gap_diagnosis.recording import Floats

_NODE_S: Final = 0.05
_SEED: Final = 50_201


@dataclass(frozen=True)
class DriveNoise:
    """How a drive errs.

    Attributes:
        levels: as estimated under the winning effects.
        time_s: float64[m], log times of
        activity: float64[2, m], with which the errors grow [rad/s].
        row_s: time from row to row, each with a white error of its own.
    """

    levels: Levels
    time_s: Floats
    activity: Floats
    row_s: float

    @classmethod
    def of(cls, data: DriveData, levels: Levels) -> DriveNoise:
        """Return the noise of a recording's drive."""
        return cls(levels, data.time_s, activity(data, levels), data.dt_s)


def drive_floor(
    path: Path,
    noise: DriveNoise,
    windows: Sequence[Window],
    *,
    radius_m: float,
    wheelbase_m: float,
    draws: int = DRAWS,
) -> Floats:
    """Return mean squares of position errors on noise alone, float64[draws, w] [m²].

    *path* is the one that the commands lead to, with headings. The same input gives the same draws.
    """
    generator = np.random.default_rng(_SEED)
    columns = [
        _window(generator, path, noise, window, radius_m, wheelbase_m, draws) for window in windows
    ]
    return np.array(columns).reshape(len(windows), draws).T


def _window(
    generator: np.random.Generator,
    path: Path,
    noise: DriveNoise,
    window: Window,
    radius_m: float,
    wheelbase_m: float,
    draws: int,
) -> Floats:
    if path.heading_rad is None:
        raise ValueError("a commanded path has headings")
    count = max(int((window.stop_s - window.start_s) / _NODE_S) + 1, 8)
    at_s = np.linspace(window.start_s, window.stop_s, count)
    node_s = float(at_s[1] - at_s[0])
    # A node stands for all rows until the next one: their white errors average out.
    rows = max(node_s / noise.row_s, 1.0)
    levels = replace(noise.levels, white=noise.levels.white / math.sqrt(rows))
    left, right = (
        radius_m * _wheel_errors_rad(generator, activity, node_s, levels, draws)
        for activity in (np.interp(at_s, noise.time_s, one) for one in noise.activity)
    )
    place = np.interp(at_s, path.t_s, path.x_m) + 1j * np.interp(at_s, path.t_s, path.y_m)
    course = np.exp(1j * np.interp(at_s, path.t_s, path.heading_rad))
    heading_rad = (right - left) / wheelbase_m
    forward = np.diff(0.5 * (left + right), axis=1, prepend=0.0)
    steps = np.diff(place, prepend=place[0])
    off = np.cumsum(1j * heading_rad * steps + forward * course, axis=1)
    known = max(int(np.searchsorted(at_s, window.align_s, side="right")), 1)
    away = place - place[:known].mean()
    start, start_rad = off[:, :known].mean(1), heading_rad[:, :known].mean(1)
    left_over = off - start[:, np.newaxis] - 1j * start_rad[:, np.newaxis] * away
    averaged_m2 = 0.5 * (radius_m * noise.levels.white) ** 2 * (1 - 1 / rows)
    return np.asarray((np.abs(left_over[:, known:]) ** 2).mean(1) + averaged_m2)


def _wheel_errors_rad(
    generator: np.random.Generator, activity: Floats, node_s: float, levels: Levels, draws: int
) -> Floats:
    """Return errors of a wheel's angle at the nodes, float64[draws, count].

    White, a random walk, and the integral of a rate error with a memory, as the likelihood has it.
    """
    count = len(activity)
    keep = math.exp(-node_s / levels.memory_s)
    rate = levels.spread * generator.standard_normal((count, draws))
    rate[1:] *= math.sqrt(1 - keep * keep)
    for k in range(1, count):
        rate[k] += keep * rate[k - 1]
    steps = levels.walk * math.sqrt(node_s) * generator.standard_normal((count, draws))
    steps += rate * node_s
    steps *= activity[:, np.newaxis]
    steps[0] = 0.0
    angle = np.cumsum(steps, axis=0) + levels.white * generator.standard_normal((count, draws))
    return np.asarray(angle.T)
