"""What a run leaves behind: three trajectories, the exact split of every error, and how it went."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil_harness.peers import Outage, outages_as_json

Poses = NDArray[np.float64]

SUMMARY_SCHEMA = 1
_POSE_FIELDS = ("x_m", "y_m", "heading_rad")
_NAMED_LIBRARIES = ("chiplog", "numpy", "numba", "python-can", "cantools")


@dataclass(frozen=True)
class ErrorSplit:
    """`total = arithmetic + model`, component by component; each float64[n, 3] (m, m, rad).

    `arithmetic` is firmware − float: what fixed point costs. `model` is float − truth: what any
    firmware would get wrong on the same counts. Headings are unwrapped, so that the parts add up.
    """

    total: Poses
    arithmetic: Poses
    model: Poses

    @classmethod
    def of(cls, truth: Poses, float_twin: Poses, firmware: Poses) -> ErrorSplit:
        """Split the error of `firmware` against `truth`; all float64[n, 3]."""
        return cls(firmware - truth, firmware - float_twin, float_twin - truth)

    def parts(self) -> Mapping[str, Poses]:
        """Return the three parts by name."""
        return {"total": self.total, "arithmetic": self.arithmetic, "model": self.model}


@dataclass(frozen=True)
class Estimate:
    """One estimator on a run's accepted counts: fixed point and float64 twin, float64[n, 3]."""

    firmware: Poses
    float_twin: Poses


@dataclass(frozen=True)
class BusStatistics:
    """What crossed the bus. `load` is the share of bit times in use, stuff bits included."""

    frames: int
    load: float | None
    rejected: Mapping[str, int]
    frames_by_message: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Reception:
    """What came of one message: how many frames, and how many of them were refused, by reason."""

    frames: int = 0
    refused: Mapping[str, int] = field(default_factory=dict)

    @property
    def refused_frames(self) -> int:
        """Number of frames refused, whatever the reason."""
        return sum(self.refused.values())


@dataclass(frozen=True)
class Timing:
    """Real time only: lateness of each tick's start against its due time, and overruns.

    `outages` are the times without another node, or without a bus that takes frames; frames that it
    did not take are `unsent_frames`.
    """

    missed_deadlines: int = 0
    jitter_p50_us: float = 0.0
    jitter_p99_us: float = 0.0
    jitter_max_us: float = 0.0
    outages: tuple[Outage, ...] = ()
    unsent_frames: int = 0

    def summary(self) -> dict[str, Any]:
        """Return the part `timing` of a summary."""
        return {
            "missed_deadlines": self.missed_deadlines,
            "jitter_us": {
                "p50": self.jitter_p50_us,
                "p99": self.jitter_p99_us,
                "max": self.jitter_max_us,
            },
            "outages": outages_as_json(self.outages),
            "unsent_frames": self.unsent_frames,
        }


@dataclass(frozen=True)
class RunResult:
    """A finished (or interrupted) run.

    `time_s` is float64[n], from 0; `stamp_us` is int64[n], the same ticks on the clock of the log:
    simulated time, or in real time the wall clock. The poses are float64[n, 3]: x_m, y_m,
    heading_rad (unwrapped), one row per tick. `estimators` holds the lesson's two, wheel only and
    gyro heading, on the same accepted counts. `kernel_state` is the integer firmware's full final
    state. `odometry` says of each odometry message what came from a firmware under test; it is
    empty for Chiplog's own, whose poses need no frames. `reference` is what a measuring system with
    errors reports: stamps in seconds on the clock of the log, float64[m], and poses float64[m, 3];
    None where it reports the truth at each tick.
    """

    scenario: str
    seed: int
    time: str
    tick_period_us: int
    time_s: NDArray[np.float64]
    stamp_us: NDArray[np.int64]
    truth: Poses
    float_twin: Poses
    firmware: Poses
    estimators: Mapping[str, Estimate]
    status: NDArray[np.int64]
    kernel_state: Mapping[str, int]
    bus: BusStatistics
    timing: Timing
    wall_s: float
    interrupted: bool = False
    configuration: Mapping[str, Any] = field(default_factory=dict)
    odometry: Mapping[str, Reception] = field(default_factory=dict)
    reference: tuple[NDArray[np.float64], Poses] | None = None

    @property
    def ticks(self) -> int:
        """Number of ticks that ran."""
        return int(self.time_s.size)

    @property
    def duration_s(self) -> float:
        """Simulated time covered, one tick period per tick."""
        return self.ticks * self.tick_period_us * 1e-6

    @property
    def errors(self) -> ErrorSplit:
        """The error of the firmware, split."""
        return ErrorSplit.of(self.truth, self.float_twin, self.firmware)

    def summary(self) -> dict[str, Any]:
        """Return the content of `summary.json` (design, section 7)."""
        poses = {"truth": self.truth, "float": self.float_twin, "firmware": self.firmware}
        return {
            "schema": SUMMARY_SCHEMA,
            "scenario": self.scenario,
            "seed": self.seed,
            "time": self.time,
            "ticks": self.ticks,
            "duration_s": self.duration_s,
            "interrupted": self.interrupted,
            "realtime_factor": self.duration_s / self.wall_s if self.wall_s > 0 else None,
            "versions": library_versions(),
            "final": {name: _final_pose(pose) for name, pose in poses.items()},
            "error": {name: _final_error(part) for name, part in self.errors.parts().items()},
            "bus": {
                "frames": self.bus.frames,
                "load": self.bus.load,
                "rejected": dict(self.bus.rejected),
            },
            "timing": self.timing.summary(),
            "configuration": dict(self.configuration),
        }


def library_versions() -> dict[str, str]:
    """Return the versions that the plant's floats are equal for, and the architecture."""
    versions = {name: version(name) for name in _NAMED_LIBRARIES}
    versions["python"] = ".".join(map(str, sys.version_info[:3]))
    versions["machine"] = platform.machine()
    return versions


def _final_pose(poses: Poses) -> dict[str, float | None]:
    if len(poses) == 0:
        return dict.fromkeys(_POSE_FIELDS)
    return {name: _finite(value) for name, value in zip(_POSE_FIELDS, poses[-1], strict=True)}


def _final_error(part: Poses) -> dict[str, float | None]:
    error = _final_pose(part)
    x_m, y_m = error["x_m"], error["y_m"]
    position_m = None if x_m is None or y_m is None else float(np.hypot(x_m, y_m))
    return {**error, "position_m": position_m}


def _finite(value: np.float64) -> float | None:
    """JSON has no NaN: a pose that never arrived (a foreign node that kept silent) is null."""
    return float(value) if np.isfinite(value) else None
