"""The gyro's codes, and the codes that the wheels let expect."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.lattice import step_of_values
from gap_diagnosis.recording import Recording
from gap_diagnosis.trembling import tremble_lsb
from hil_harness.robot import Robot

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_SMOOTH_S: Final = 0.05
_LEAST: Final = 100
_SURELY: Final = 4.0
"""Standard deviations of a turn rate by counts: less is that of rest."""
_LEAST_LSB: Final = 20.0


@dataclass(frozen=True)
class CodeData:
    """Codes of the ticks that have one.

    Attributes:
        t_s: float64[n].
        tick: int64[n].
        code: float64[n], whole numbers where `is_whole`.
        expected: float64[n], code by the wheels' turning, smoothed, offset matched; NaN: no counts.
        spread: robust spread of code less expected [LSB].
        noise: standard deviation of a sample about its neighbours [LSB].
        step: by how many codes it steps: more than one where a rate is told coarsely [LSB].
        turns: bool[n], the wheels say that the turn rate is not that of rest.
        is_whole: codes are converter codes, not physical rates.
        zero_code, per_rad_s, low, high, bits: the described converter and sensor.
    """

    t_s: Floats
    tick: NDArray[np.int64]
    code: Floats
    expected: Floats
    spread: float
    noise: float
    step: float
    turns: Bools
    is_whole: bool
    zero_code: float
    per_rad_s: float
    low: float
    high: float
    bits: int

    def rows(self, first: int, last: int) -> CodeData:
        """Return the data of some rows, from the first to before the last."""
        return replace(
            self,
            **{
                name: getattr(self, name)[first:last]
                for name in ("t_s", "tick", "code", "expected", "turns")
            },
        )


def code_data(recording: Recording, robot: Robot) -> CodeData | None:
    """Return the data, or None where the log has no gyro."""
    if recording.gyro_code is None:
        return None
    known = np.isfinite(recording.gyro_code)
    if np.count_nonzero(known) < _LEAST:
        return None
    plant = robot.plant
    rate, rounded = _wheel_rate(recording, robot)
    code = recording.gyro_code[known]
    expected = plant.gyro.zero_rate_code + plant.gyro.sensitivity_lsb_per_rad_s * rate[known]
    away = code - expected
    seen = np.isfinite(away)
    offset = float(np.median(away[seen])) if seen.any() else 0.0
    spread = 1.4826 * float(np.median(np.abs(away[seen] - offset))) if seen.any() else math.inf
    low, high = plant.gyro_code_limits
    # Not against the spread: of a gyro that reads a tenth, every turn would be within it.
    per_rad_s = plant.gyro.sensitivity_lsb_per_rad_s
    turns = np.abs(np.nan_to_num(rate[known])) > max(_SURELY * rounded, _LEAST_LSB / per_rad_s)
    return CodeData(
        t_s=recording.t_s[known],
        tick=recording.tick[known],
        code=code,
        expected=expected + offset,
        spread=max(spread, 0.5),
        noise=tremble_lsb(code),
        step=max(step_of_values(code), 1.0),
        turns=turns,
        is_whole=bool(np.all(code == np.rint(code))),
        zero_code=float(plant.gyro.zero_rate_code),
        per_rad_s=per_rad_s,
        low=float(low),
        high=float(high),
        bits=plant.adc.bits,
    )


def _wheel_rate(recording: Recording, robot: Robot) -> tuple[Floats, float]:
    """Return the turn rate that the counts say, over a few ticks about each tick's middle, and its
    standard deviation by their rounding."""
    wheels = robot.plant.wheels
    per_tick = math.tau * wheels.radius_m / robot.plant.encoder.ticks_per_rev / wheels.wheelbase_m
    heading = (recording.right_ticks - recording.left_ticks) * per_tick
    there = np.isfinite(heading)
    if np.count_nonzero(there) < 2:
        return np.full(len(heading), np.nan), math.inf
    time_s = recording.tick * recording.tick_s
    half = max(recording.tick_s, 0.5 * _SMOOTH_S)
    middle = time_s - 0.5 * recording.tick_s
    sides = [np.interp(middle + way * half, time_s[there], heading[there]) for way in (-1, 1)]
    # Two counts at either end.
    rounded = per_tick * math.sqrt(4 / 12) / (2 * half)
    return np.asarray((sides[1] - sides[0]) / (2 * half), dtype=np.float64), rounded


def stretches(mask: Bools) -> list[tuple[int, int]]:
    """Return the (start, stop) of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
