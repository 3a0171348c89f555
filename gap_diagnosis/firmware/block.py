"""The firmware's part of the likelihood: recorded odometry against replays of possible programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.firmware.arrived import as_arrived, came_in_time
from gap_diagnosis.firmware.candidates import EFFECTS
from gap_diagnosis.firmware.comparison import cut_windows, misfit, turn_score
from gap_diagnosis.firmware.foreign import best_lag, float_steps
from gap_diagnosis.firmware.inputs import (
    ReplayInputs,
    lacks_the_gyro,
    recorded_odometry,
    replay_inputs,
)
from gap_diagnosis.firmware.leftover import Leftover, describe, size_of
from gap_diagnosis.firmware.limits import replay_limits
from gap_diagnosis.firmware.pairs import Pairs
from gap_diagnosis.firmware.replay import Program, Start, find_start, replay, resolution
from gap_diagnosis.firmware.scored import Scored, estimates_of, log_sum
from gap_diagnosis.firmware.singles import Singles
from gap_diagnosis.firmware.stand_in import stand_in
from gap_diagnosis.firmware.workbench import Workbench
from gap_diagnosis.hypothesis import REPLAYED_TOGETHER, Fit
from gap_diagnosis.recording import Floats, Ints, Recording
from hil_harness.assembly import Wire
from hil_harness.robot import Robot

_LIMIT: Final = 1e4
_GYRO_LATE: Final = (1, 2, -1)
_LATE_NATS: Final = 30.0
_SAME: Final = 1e-6
"""Programs whose log likelihoods differ by less give the same record."""


class FirmwareBlock:
    """Residual r6: the odometry frames against replays. A `Block` (see `hypothesis`).

    Log evidence is relative to no effect, with the same programs that may have run (`singles`).
    """

    name = "firmware"

    def __init__(self, bench: Workbench, without: frozenset[str] = frozenset()) -> None:
        """Prepare one log's block; use `firmware_block`."""
        # Without a blend its weight means nothing.
        blends = bench.config.description.mode == "blend"
        none = frozenset() if blends else frozenset({"blend_weight"})
        self.effects = frozenset(EFFECTS) - none - without
        self._bench = bench
        self._singles = Singles(bench)
        self._pairs = Pairs(self._singles, self.effects)
        self._fits: dict[frozenset[str], Fit] = {}

    @property
    def knows_arrivals(self) -> bool:
        """Whether replays were handed what had come by each tick, as the ECU was."""
        return self._bench.knows_arrivals

    @property
    def is_exact(self) -> bool:
        """Whether the log has all that went into the program: a kernel that ran must give it."""
        return self._bench.windows.is_exact

    @property
    def is_equal(self) -> bool:
        """Whether the record is the described program's output to its last digit."""
        return self._singles.is_equal

    def fit(self, effects: frozenset[str]) -> Fit:
        """Fit up to two of the block's effects; the empty set is no effect.

        Raises ValueError for an effect of another block, and for more than two.
        """
        unknown = effects - self.effects
        if unknown or len(effects) > REPLAYED_TOGETHER:
            known = sorted(self.effects)
            raise ValueError(f"effects {sorted(effects)}: expected up to two of {known}")
        if effects not in self._fits:
            self._fits[effects] = self._fit(effects)
        return self._fits[effects]

    def limits(self) -> dict[str, float | None]:
        """Return the smallest size of each effect that this log's replay shows."""
        return replay_limits(self._bench)

    def leftover(self) -> Leftover:
        """Return what the described program, or the nearest float program, leaves."""
        bench = self._bench
        none = log_sum(one.total for one in self._singles.no_effect)
        off = misfit(bench.windows, bench.described)
        for pose in self._singles.best_poses:
            other = misfit(bench.windows, pose)
            if size_of(other, bench.windows) < size_of(off, bench.windows):
                off = other
        unlisted = max(self._singles.other, self._singles.changed(self.effects))
        return describe(bench.windows, off, bench.t_s, unlisted - none)

    def stand_in(self, replayed: Floats, variable: str, kept: NDArray[np.bool_]) -> Floats | None:
        """Return the path, float64[n, 3], of a program that does to *replayed* what the leftover
        goes with, fitted on the ticks *kept* (bool[n]); None where that cannot be fitted."""
        return stand_in(self._bench.windows, replayed, self._bench.t_s, variable, kept)

    def explained(
        self, effects: frozenset[str], there: FirmwareBlock | None = None
    ) -> Floats | None:
        """Return the odometry of the likeliest program with up to two effects, float64[n, 3].

        *there* is the block of another log, on which what was found here then runs; None: this one.
        None where no kernel has the effects, or for what happened at its own ticks in this log.
        """
        names = tuple(sorted(effects))
        found = self._scored(names)
        if not found:
            return None
        best = max(found, key=lambda one: one.total).candidate
        if there is not None and best.timing:
            return None
        bench = self._bench if there is None else there._bench
        program = bench.program(best.changes, **best.timing)
        return None if program is None else bench.poses(program)

    def _scored(self, names: tuple[str, ...]) -> list[Scored]:
        if len(names) == 1:
            return self._singles.single(names[0])
        return self._pairs.pair(*names)

    def _fit(self, effects: frozenset[str]) -> Fit:
        singles = self._singles
        names = tuple(sorted(effects))
        if not names:
            return Fit((), 0.0, 0.0)
        found = self._scored(names)
        none = log_sum([*(one.total for one in singles.no_effect), singles.other])
        most = max(singles.other, *(one.log_likelihood for one in singles.no_effect))
        total = log_sum([*(one.total for one in found), singles.other])
        best = max([singles.other, *(one.log_likelihood for one in found)])
        alike = [one.log_likelihood for one in singles.no_effect]
        silent = [
            one.total for one in found if min(abs(one.log_likelihood - a) for a in alike) < _SAME
        ]
        return Fit(
            names,
            float(np.clip(total - none, -_LIMIT, _LIMIT)),
            float(np.clip(best - most, -_LIMIT, _LIMIT)),
            estimates_of(found) if found else {},
            log_silent=log_sum([*silent, singles.other]) - none if len(names) == 1 else -math.inf,
        )


def firmware_block(
    recording: Recording, robot: Robot, wire: Wire, without: frozenset[str] = frozenset()
) -> FirmwareBlock | None:
    """Return the firmware's block of a log; None without odometry, without wheel counts, or where
    the firmware turned by a gyro that nobody recorded.

    *without* are effects that are not to be tried.

    Raises HarnessError for a description that no kernel can be built from.
    """
    odometry = recorded_odometry(recording, wire)
    if odometry is None or np.count_nonzero(np.isfinite(recording.left_ticks)) < 3:
        return None
    inputs = replay_inputs(recording, robot, wire)
    windows = cut_windows(odometry, recording.t_s)
    if windows.count == 0:
        return None
    windows = replace(windows, has_all_inputs=came_in_time(inputs, recording, wire))
    lag = best_lag(float_steps(inputs), windows, inputs.at_row)
    places = np.clip(inputs.at_row - lag, 0, inputs.ticks - 1)

    def bench(handed: ReplayInputs, places: Ints, lag: int) -> Workbench:
        described = replay(handed, Program(handed.config), Start())[places]
        start = find_start(handed, odometry, described)
        if start.pose is not None:
            start = replace(start, tick=max(start.tick - lag, 0))
            described = replay(handed, Program(handed.config), start)[places]
        whole = windows
        if start.pose is not None:
            # What it carried into the log may be one of its own digits, however many were written.
            quantum = np.maximum(windows.quantum, resolution(handed.config))
            whole = replace(windows, from_power_on=False, quantum=quantum)
        steps = float_steps(handed)
        return Workbench(handed, whole, start, places, steps, described, recording.t_s)

    plain = bench(inputs, places, lag)
    if plain.is_equal(plain.described):
        return FirmwareBlock(plain, without)
    if lacks_the_gyro(recording, robot):
        return None
    others = []
    for arrived in as_arrived(inputs, recording, wire):
        known = bench(arrived.inputs, arrived.places, 0)
        others.append(replace(known, repeats=arrived.repeats, knows_arrivals=True))
        if known.is_equal(known.described):
            break
    others += [bench(inputs.with_gyro_late(late), places, lag) for late in _GYRO_LATE]
    return FirmwareBlock(_in_step(plain, others), without)


def _in_step(plain: Workbench, others: Sequence[Workbench]) -> Workbench:
    """Return the bench whose samples are used in the ticks that explain the record best.

    A frame that comes later on the bus is used in a later tick: nothing that the firmware does. It
    takes a clear improvement to assume it.
    """
    best, most = plain, plain.score(plain.described) + _LATE_NATS
    for one in others:
        score = one.score(one.described)
        turns = turn_score(one.windows, one.described) - turn_score(plain.windows, plain.described)
        if score > most or (best is plain and turns > _LATE_NATS):
            best, most = one, max(score, most)
    return best
