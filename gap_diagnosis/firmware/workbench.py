"""Everything about one log that each hypothesis needs: inputs, record, windows, start, lag."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from firmware_model import KernelConfig
from gap_diagnosis.firmware.candidates import altered_config
from gap_diagnosis.firmware.comparison import (
    Windows,
    exact_scores,
    is_equal,
    misfit,
    score,
)
from gap_diagnosis.firmware.foreign import Steps, recorded_path
from gap_diagnosis.firmware.inputs import ReplayInputs
from gap_diagnosis.firmware.replay import Program, Start, replay
from gap_diagnosis.recording import Floats, Ints

PoseAt = Callable[[float], Floats | None]
"""The pose on the recording's rows under a value; None where no firmware has it."""

NOTHING_LEARNT: Final[Mapping[str, float]] = {
    "calibration_start_s": 0.0,
    "calibration_stop_s": 1.0,
}
"""Changes of a program that never learns an offset at rest."""

_ODD_LSB: Final = 0.3717
_GRID: Final = np.array([-1.0, -0.75, -0.5, -0.25, 0.25, 0.5, 0.75, 1.0])
_FINEST: Final = 1e-15
_NEWTON_STEPS: Final = 12
_FIRST_STEP: Final = 1e-3
_LEAST_CHANGE: Final = 1e-6
_NEAR_QUANTA: Final = 50.0


@dataclass(frozen=True)
class Workbench:
    """One log, ready to be replayed under any program.

    Attributes:
        inputs: what the kernel was handed.
        windows: the recorded odometry.
        start: where a replay begins.
        places: int64[n], the tick whose odometry each row of the recording shows.
        steps: path and turn of each tick as floats.
        described: float64[n, 3], the described program's pose on the rows.
        t_s: float64[n], time of the rows.
        repeats: ticks that answered though no row shows it: its counter had been said before.
        knows_arrivals: each tick is given what had come by then, not what belongs to it.
    """

    inputs: ReplayInputs
    windows: Windows
    start: Start
    places: Ints
    steps: Steps
    described: Floats
    t_s: Floats
    repeats: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    knows_arrivals: bool = False

    @property
    def config(self) -> KernelConfig:
        """The described kernel."""
        return self.inputs.config

    def poses(self, program: Program, rows: int | None = None) -> Floats:
        """Return a program's pose on the recording's rows (the first *rows* of them; NaN after)."""
        places = self.places if rows is None else self.places[:rows]
        pose = replay(self.inputs, program, self.start, int(np.max(places)) + 1)[places]
        if rows is None:
            return pose
        whole = np.full((len(self.places), 3), np.nan)
        whole[:rows] = pose
        return whole

    def program(self, changes: Mapping[str, Any], **more: Any) -> Program | None:
        """Return the described program with *changes*; None where no firmware has them."""
        config = altered_config(self.config, changes)
        return None if config is None else Program(config, **more)

    def turning(self) -> NDArray[np.bool_]:
        """Tell for each row with odometry whether the gyro turned the heading since the last.

        A replay with an offset that no code equals moves in every tick in which it is not held.
        """
        config = altered_config(self.config, NOTHING_LEARNT)
        if config is None:
            return np.zeros(len(self.windows.rows), np.bool_)
        odd = self.config.constants.gyro_zero_rate_code + _ODD_LSB
        heading = self.poses(Program(config, offset_lsb=odd))[self.windows.rows, 2]
        return np.asarray(np.abs(np.diff(heading, prepend=heading[0])) > 0.0)

    def score(self, pose: Floats) -> float:
        """Return the log likelihood of a kernel's pose."""
        return self.scores(pose)[0]

    def scores(self, pose: Floats) -> tuple[float, float]:
        """Return the log likelihoods of a kernel's pose, and of that kernel with a change that
        nobody listed.

        The latter only where the log has all that the ECU had: elsewhere no window says what should
        have been.
        """
        if self.windows.is_exact:
            return exact_scores(self.windows, pose)
        return score(self.windows, pose), -math.inf

    def foreign_score(self, pose: Floats) -> float:
        """Return the log likelihood of a float program's pose: it need not give the digits."""
        return score(self.windows, pose)

    @property
    def highest_score(self) -> float:
        """The log likelihood of a replay that is equal to the record."""
        recorded = np.zeros((len(self.places), 3))
        recorded[self.windows.rows] = self.windows.pose
        return self.score(recorded)

    def is_near(self, pose: Floats) -> bool:
        """Tell whether a pose differs from the record by a few digits at most."""
        off = np.abs(misfit(self.windows, pose))
        return bool(np.all(off <= _NEAR_QUANTA * self.windows.quantum))

    def used_bits(self) -> dict[str, int]:
        """Return how many bits the described program's words needed, by variable of a word."""
        one = self.config.description
        known = self.described[np.isfinite(self.described[:, 0])]
        turns = np.diff(known[:, 2], prepend=0.0)
        largest = {
            "position": (float(np.max(np.abs(known[:, :2]))), one.position.frac_bits),
            "step": (float(np.max(np.abs(self.steps.path_m))), one.step.frac_bits),
            "turn_step": (float(np.max(np.abs(turns))) / math.tau, one.turn_step.frac_bits),
        }
        return {
            name: math.ceil(value * 2.0**bits).bit_length() + 1
            for name, (value, bits) in largest.items()
        }

    def is_equal(self, pose: Floats) -> bool:
        """Tell whether a pose is the recorded one to the last digit."""
        return is_equal(self.windows, pose)

    def signals(self, pose: Floats) -> Floats:
        """Return signed path and heading from the first row, in units of the record: float64[2r].

        They depend smoothly on the constants, whatever way the path takes.
        """
        known = pose[self.windows.rows]
        quantum_m, _, quantum_rad = self.windows.quantum
        return np.concatenate(
            [recorded_path(known) / quantum_m, (known[:, 2] - known[0, 2]) / quantum_rad]
        )

    @cached_property
    def wanted(self) -> Floats:
        """What the record says, as `signals`."""
        recorded = np.zeros((len(self.places), 3))
        recorded[self.windows.rows] = self.windows.pose
        return self.signals(recorded)

    @cached_property
    def resolution(self) -> float:
        """About how finely the record tells a constant: a digit over path and turn."""
        windows = self.windows
        path_m = float(np.sum(np.hypot(*np.diff(windows.pose[:, :2], axis=0).T))) + 1e-9
        turn_rad = float(np.sum(np.abs(np.diff(windows.pose[:, 2])))) + 1e-9
        return float(min(windows.quantum[0] / path_m, windows.quantum[2] / turn_rad))

    def distance(self, pose_at: PoseAt, value: float) -> float:
        """Return the root mean square of what a value leaves, in units of the record."""
        pose = pose_at(value)
        if pose is None:
            return math.inf
        return float(np.sqrt(np.mean((self.wanted - self.signals(pose)) ** 2)))

    def nearest(self, pose_at: PoseAt, low: float, high: float) -> float:
        """Return about where a value leaves least, by a search over its range."""
        found = minimize_scalar(
            lambda value: min(self.distance(pose_at, float(value)), 1e300),
            bounds=(low, min(high, 1.0)),
            method="bounded",
            options={"xatol": 1e-6},
        )
        return float(found.x)

    def looseness(self, pose_at: PoseAt, value: float) -> float:
        """Return by how much a value may be off for what it leaves, as if that lasted."""
        step = 1e-4 * max(abs(value), 1e-3)
        there, beside = pose_at(value), pose_at(value + step)
        if there is None or beside is None:
            return 0.0
        slope = (self.signals(beside) - self.signals(there)) / step
        steep = float(np.sqrt(np.mean(slope**2)))
        left = np.abs(self.wanted - self.signals(there)) <= 1.0
        return 0.0 if left.all() or steep <= 0.0 else self.distance(pose_at, value) / steep

    def solve(self, pose_at: PoseAt, low: float, high: float, begin: float = 0.0) -> float:
        """Return the value whose pose comes closest to the record in path and heading.

        Gauss-Newton from *begin*, where it stays if the record says nothing of the value.
        """
        found = self.solve_together(
            lambda values: pose_at(float(values[0])),
            np.array([low]),
            np.array([high]),
            np.array([begin]),
        )
        return float(found[0])

    def solve_together(
        self,
        pose_at: Callable[[Floats], Floats | None],
        low: Floats,
        high: Floats,
        begin: Floats,
    ) -> Floats:
        """Return the same of several values at once; slopes are kept up by Broyden's secants."""
        wanted = self.wanted
        steps = np.where(high >= begin + _FIRST_STEP, _FIRST_STEP, -_FIRST_STEP)
        beside = [pose_at(begin + step) for step in np.diag(steps)]
        neutral = pose_at(begin)
        ours = self.signals(self.described if neutral is None else neutral)
        known = [self.signals(one) for one in beside if one is not None]
        if len(known) < len(begin):
            return begin
        slopes = np.column_stack([one - ours for one in known]) / steps
        values = begin
        for _ in range(_NEWTON_STEPS):
            power = slopes.T @ slopes
            if not np.all(np.isfinite(power)) or np.any(np.diag(power) <= 0.0):
                break
            change = np.linalg.lstsq(power, slopes.T @ (wanted - ours))[0]
            before, values = values, np.clip(values + change, low, high)
            moved = values - before
            if np.max(np.abs(moved)) < 1e-13 or (pose := pose_at(values)) is None:
                break
            was, ours = ours, self.signals(pose)
            if np.max(np.abs(moved)) > _LEAST_CHANGE:
                missed = ours - was - slopes @ moved
                slopes = slopes + np.outer(missed, moved) / float(moved @ moved)
        return values

    def turns_of(self, pose_at: PoseAt) -> PoseAt:
        """Return the same poses in the places of the record: only their headings are told."""

        def turned(value: float) -> Floats | None:
            if (pose := pose_at(value)) is None:
                return None
            pose = pose.copy()
            pose[self.windows.rows, :2] = self.windows.pose[:, :2]
            return pose

        return turned

    def polish(self, pose_at: PoseAt, value: float, width: float) -> float:
        """Return the value within *width* whose pose has the fewest other digits than the record.

        A kernel's rounding scatters poses by more than its constants are fine, but the ticks that
        round to another digit are the fewer the nearer a value is: a search on ever finer grids.
        """

        def others(at: float) -> int:
            pose = pose_at(at)
            if pose is None:
                return 3 * len(self.windows.rows)
            off = np.abs(self.windows.pose - pose[self.windows.rows])
            return int(np.count_nonzero(off > 0.5 * self.windows.quantum))

        fewest = others(value)
        while fewest and width > _FINEST:
            for at in value + width * _GRID:
                if (count := others(float(at))) < fewest:
                    value, fewest = float(at), count
            width *= 0.4
        return value
