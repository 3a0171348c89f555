"""Detection limits of what commands, frames, codes and odometry show: simple bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.bus import prior as bus
from gap_diagnosis.drive import prior as drive
from gap_diagnosis.explanations import EXPLAINED
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import Recording
from hil_harness.effects import catalogue

_FEW: Final = 2.0
"""So many frames amiss are no chance."""


def limits_elsewhere(analyses: Sequence[Analysis]) -> dict[str, float | None]:
    """Return a limit for every effect of the catalogue that the motion does not judge.

    None: these logs cannot show it. 0: any amount shows (a replay is exact to the last digit).
    """
    owned = {effect for one in analyses for block in one.blocks for effect in block.effects}
    recordings = [one.recording for one in analyses]
    return {
        name: _LIMITS.get(name, _any)(recordings) if name in owned else None
        for name, effect in catalogue().items()
        if name not in EXPLAINED and effect.stage in {"actuation", "encoder", "gyro", "bus", "firmware"}
    }


def _any(recordings: Sequence[Recording]) -> float:
    del recordings
    return 0.0


def _at(value: float) -> Callable[[Sequence[Recording]], float]:
    return lambda recordings: value


def _of_frames(least: float) -> Callable[[Sequence[Recording]], float]:
    def limit(recordings: Sequence[Recording]) -> float:
        frames = max((len(f.t_s) for one in recordings for f in one.frames.values()), default=0)
        return max(least, _FEW / max(frames, 1))

    return limit


def _clock_skew(recordings: Sequence[Recording]) -> float:
    weights = [
        one.clock_skew_sd**-2
        for one in recordings
        if math.isfinite(one.clock_skew_sd) and one.clock_skew_sd > 0
    ]
    sd = math.fsum(weights) ** -0.5 if weights else 0.0
    return max(bus.SKEW_TOLERANCE, math.sqrt(THRESHOLD) * sd)


_LIMITS: Final[Mapping[str, Callable[[Sequence[Recording]], float]]] = {
    "drive_gain": _at(drive.GAIN.tolerance),
    "drive_lag": _at(drive.LAG_S.tolerance),
    "drive_delay": _at(drive.DELAY_S.tolerance),
    "frame_loss": _of_frames(bus.LOSS_PRESENT[0]),
    "frame_duplication": _of_frames(bus.DUPLICATION_PRESENT[0]),
    "frame_reordering": _of_frames(bus.REORDERING_PRESENT[0]),
    "stale_producer": _of_frames(bus.STALE_PRESENT[0]),
    "frame_jitter": _at(bus.JITTER_PRESENT_S[0]),
    "frame_latency": _at(bus.LATENCY_TOLERANCE_S),
    "clock_skew": _clock_skew,
}
