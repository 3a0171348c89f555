"""A gyro that repeats its code: the longest run, against how often codes repeat on this log."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.codes.data import CodeData, stretches
from gap_diagnosis.codes.saturation import FlatTop
from gap_diagnosis.trembling import trembles

_LEAST_S: Final = 0.3
"""What repeats for less is a stale producer: the bus tells."""
_CLUSTERED: Final = 0.7
"""Repeats come in clusters: a run says less than as many repeats on their own."""
_CONTRADICTION_NATS: Final = 4.0
_BLOCK: Final = 10
_A_CODE: Final = 0.6


@dataclass(frozen=True)
class Frozen:
    """The run that looks most like a frozen gyro: its window and log likelihood ratio."""

    start_s: float
    stop_s: float
    log_ratio: float


def frozen_run(data: CodeData, flat: FlatTop | None = None) -> Frozen | None:
    """Return the most suspicious run of equal codes; None where no code repeats for long.

    How likely a code repeats once it has is counted on the rest of the log, at rest and in turns
    apart: a noiseless sensor of a robot that rests repeats for ever and is not frozen. Of a sensor
    that does not tremble elsewhere, only wheels that turn meanwhile say that it is. Runs at a
    *flat* top are none.
    """
    same = (data.code[1:] == data.code[:-1]) & (np.diff(data.tick) == 1)
    again = same[1:] & same[:-1]
    turning = data.turns[2:]
    best: Frozen | None = None
    runs = [one for one in stretches(same) if data.t_s[one[1]] - data.t_s[one[0]] >= _LEAST_S]
    extremes = {data.code.min(), data.code.max()}
    for start, stop in sorted(runs, key=lambda one: one[0] - one[1])[:20]:
        if data.code[start] in extremes or (flat is not None and _is_of(flat, data, start, stop)):
            continue  # a flat top, not a frozen sensor
        inside = np.zeros(len(again), dtype=np.bool_)
        inside[max(start - 1, 0) : stop - 1] = True
        ratio = 0.0
        elsewhere = np.delete(data.code, slice(start, stop + 1))
        for state in (turning, ~turning) if trembles(elsewhere) else ():
            held = int(np.count_nonzero(inside & state))
            rest = state & ~inside & same[:-1]
            repeated = int(np.count_nonzero(again & rest))
            known = int(np.count_nonzero(rest))
            ratio -= _CLUSTERED * held * math.log((repeated + 1) / (known + 2))
        ratio += _contradicted(data, start, stop + 1)
        found = Frozen(float(data.t_s[start]), float(data.t_s[stop]), ratio)
        if best is None or found.log_ratio > best.log_ratio:
            best = found
    return best


def _is_of(flat: FlatTop, data: CodeData, start: int, stop: int) -> bool:
    """Tell whether a run is at a flat top of a part of the log."""
    if flat.rows is None or flat.log_ratio <= 0.0:
        return False
    away = abs(float(data.code[start]) - data.zero_code) / data.per_rad_s
    inside = flat.rows[0] <= start and stop <= flat.rows[1]
    return inside and away > flat.limit_rad_s - _A_CODE / data.per_rad_s


def _contradicted(data: CodeData, start: int, stop: int) -> float:
    """Return the evidence of blocks in which the wheels turn and the code does not follow."""
    away = np.abs(data.code[start:stop] - data.expected[start:stop])
    moved = np.abs(data.expected[start:stop] - data.expected[start])
    apart = max(8 * data.spread, 20.0, data.step)
    unlike = (away > apart) & (moved > apart)
    return _CONTRADICTION_NATS * (int(np.count_nonzero(unlike)) // _BLOCK)


def frozen_prior(data: CodeData) -> float:
    """Return the log prior density of a window's start and length, both even in the log."""
    return -2 * math.log(len(data.code))
