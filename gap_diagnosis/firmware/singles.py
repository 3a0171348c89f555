"""One effect at a time: its candidates replayed, beside the programs without an effect.

The programs that may have run are: the described kernel; the same with an offset that it had learnt
before the log began; a float program of another author; and some other arithmetic, of which nothing
is known. An effect alters the first three.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from gap_diagnosis.firmware.candidates import (
    Candidate,
    RealParameter,
    listed,
    overflow_candidates,
    smooth,
)
from gap_diagnosis.firmware.comparison import (
    catch_all_scores,
    component_scores,
    misfit,
    turn_score,
)
from gap_diagnosis.firmware.foreign import FOREIGN, Foreign, foreign_replay
from gap_diagnosis.firmware.leftover import flexible, size_of
from gap_diagnosis.firmware.offsets import offset_programs
from gap_diagnosis.firmware.replay import Program
from gap_diagnosis.firmware.scored import Scored, log_sum
from gap_diagnosis.firmware.sought import Sought, sought_together
from gap_diagnosis.firmware.timed import (
    auto_zero_candidates,
    calibration_candidates,
    exact_auto_zero,
    missed_deadlines,
    no_calibration,
    no_tick_missed,
    no_turn_zeroed,
)
from gap_diagnosis.firmware.workbench import Workbench
from gap_diagnosis.recording import Floats

P_DESCRIBED: Final = math.log(0.9)
_P_OFFSET: Final = math.log(0.03)
_P_FOREIGN: Final = math.log(0.04)
P_OTHER: Final = math.log(0.03)
_P_SILENT: Final = math.log(0.3)

_BEST_FOREIGN: Final = 3
_SCREENED_TICKS: Final = 2_500
_KEPT_AFTER_SCREEN: Final = 16
_SCREEN_NATS: Final = 200.0
_ANY_SIZE: Final = 0.01


class Singles:
    """All single effects of one log; each is looked at once, when it is first asked for."""

    def __init__(self, bench: Workbench) -> None:
        """Prepare; nothing is replayed yet."""
        self.bench = bench
        self._known: dict[str, list[Scored]] = {}
        self._kernels: dict[str, list[Scored]] = {}

    @cached_property
    def is_equal(self) -> bool:
        """Whether the record is the described program's output to its last digit."""
        return self.bench.is_equal(self.bench.described)

    @cached_property
    def other(self) -> float:
        """Prior times likelihood of some other arithmetic, in logarithm: blind to all effects."""
        if self.bench.windows.is_exact:
            return -math.inf
        poses = [self.bench.described] + ([] if self.is_equal else self.best_poses)
        return P_OTHER + max(self._wild_score(pose) for pose in poses)

    def changed(self, effects: Collection[str]) -> float:
        """The same of a kernel with a change that nobody listed: near the described one in a part
        of the windows, or near one with a listed effect."""
        if self.is_equal:
            return -math.inf
        near = [self._without_effect, *map(self._kernel, sorted(effects))]
        known = [one.log_prior + one.log_changed for several in near for one in several]
        return log_sum(known) - math.log(len(near))

    def _wild_score(self, pose: Floats) -> float:
        """Return the log likelihood of arithmetic that is another's in one component at least."""
        windows = self.bench.windows
        off = misfit(windows, pose)
        left = flexible(windows, off, self.bench.t_s)
        wild = np.maximum(catch_all_scores(windows, left), catch_all_scores(windows, off))
        named = component_scores(windows, pose)
        gain = wild - named
        taken = np.sum(np.maximum(gain, 0.0)) if np.max(gain) > 0.0 else np.max(gain)
        return float(np.sum(named) + taken) - len(gain) * math.log(2.0)

    @cached_property
    def no_effect(self) -> list[Scored]:
        """What the programs without an effect say; some other arithmetic is not among them."""
        bench, nothing = self.bench, Candidate({}, {}, 0.0, {})
        if self.is_equal:
            return self._without_effect
        share = _P_FOREIGN - math.log(len(FOREIGN))
        return self._without_effect + [
            Scored(nothing, share, bench.foreign_score(self._foreign_pose(program)))
            for program in FOREIGN
        ]

    @cached_property
    def _without_effect(self) -> list[Scored]:
        """What the kernels without an effect say."""
        nothing = Candidate({}, {}, 0.0, {})
        found = [self._scored(nothing, P_DESCRIBED, self.bench.described)]
        if self.is_equal:
            return found
        return found + [
            self._scored(nothing, _P_OFFSET, self.bench.poses(program)) for program in self._offsets
        ]

    def _scored(self, one: Candidate, log_prior: float, pose: Floats) -> Scored:
        return Scored(one, log_prior, *self.bench.scores(pose))

    @cached_property
    def _offsets(self) -> list[Program]:
        return offset_programs(self.bench)

    @cached_property
    def _offset(self) -> float | None:
        """The offset learnt before the log began; None where power-on's serves as well."""
        if self.is_equal or not self._offsets:
            return None
        bench = self.bench
        turns = [turn_score(bench.windows, bench.poses(program)) for program in self._offsets]
        at = int(np.argmax(turns))
        if turns[at] < turn_score(bench.windows, bench.described) + 5.0:
            return None
        return self._offsets[at].offset_lsb

    @cached_property
    def _best_foreign(self) -> tuple[Foreign, ...]:
        """The float programs nearest to the record when their constants are free."""

        def distance(program: Foreign) -> float:
            own = "tick_period" if program.source == "gyro" else "wheelbase"
            pose = self._foreign_pose(program, scaled=own)
            return size_of(misfit(self.bench.windows, pose), self.bench.windows)

        return tuple(sorted(FOREIGN, key=distance)[:_BEST_FOREIGN])

    @cached_property
    def best_poses(self) -> list[Floats]:
        """Poses of the nearest float programs."""
        return [self._foreign_pose(program) for program in self._best_foreign]

    def _foreign_pose(self, program: Foreign, **more: Any) -> Floats:
        bench = self.bench
        return foreign_replay(program, bench.steps, bench.windows, bench.places, **more)[0]

    def single(self, effect: str) -> list[Scored]:
        """Return the scored candidates of one effect, under every kind of program."""
        if effect not in self._known:
            found = self._kernel(effect)
            if not self.is_equal:
                found = found + self._foreign_scores(effect)
            self._known[effect] = found
        return self._known[effect]

    def _kernel(self, effect: str) -> list[Scored]:
        if effect not in self._kernels:
            self._kernels[effect] = self._kernel_scores(effect)
        return self._kernels[effect]

    def _kernel_scores(self, effect: str) -> list[Scored]:
        bench = self.bench
        candidates = listed(effect, bench.config)
        for parameter in smooth(effect, bench.config):
            candidates += self.around(parameter)
        if effect == "auto_zero":
            exact = [] if self.is_equal else exact_auto_zero(bench)
            candidates += exact or auto_zero_candidates(bench)
            candidates.append(no_turn_zeroed())
        if effect == "firmware_overflow":
            candidates += overflow_candidates(bench.config, bench.used_bits())
        if effect == "moving_calibration":
            candidates += calibration_candidates(bench)
        if effect == "missed_deadline":
            candidates += [no_tick_missed(bench.inputs.ticks), *missed_deadlines(bench)]
        return self.scored(self.programs(candidates))

    def scored(self, pairs: list[tuple[Candidate, Program]]) -> list[Scored]:
        """Return the likelihood of each; of a long log only of those that fit its beginning."""
        bench = self.bench
        rows = int(np.searchsorted(bench.places, self._screen_tick))
        head = replace(bench, windows=bench.windows.head(rows))
        if len(pairs) > _KEPT_AFTER_SCREEN and rows < len(bench.places) and head.windows.count:
            scores = [head.score(bench.poses(program, rows)) for _, program in pairs]
            order = sorted(range(len(pairs)), key=lambda at: -scores[at] - pairs[at][0].log_prior)
            worst = scores[order[0]] - _SCREEN_NATS
            kept = [at for at in order[:_KEPT_AFTER_SCREEN] if scores[at] >= worst]
            pairs = [pairs[at] for at in sorted(kept)]
        found = [
            self._scored(one, P_DESCRIBED + one.log_prior, bench.poses(program))
            for one, program in pairs
        ]
        if self._offset is None:
            return found
        return found + [
            self._scored(
                one,
                _P_OFFSET + one.log_prior,
                bench.poses(replace(program, offset_lsb=self._offset)),
            )
            for one, program in pairs
            if program.offset_lsb is None
        ]

    @cached_property
    def _screen_tick(self) -> int:
        """So far a candidate is looked at first: a while beyond the first difference."""
        bench = self.bench
        rows = bench.windows.rows
        away = np.abs(bench.windows.pose - bench.described[rows]) > bench.windows.quantum
        first = np.flatnonzero(np.any(away, axis=1))
        begin = int(bench.places[rows[first[0]]]) if len(first) else 0
        return begin + _SCREENED_TICKS

    def around(self, parameter: RealParameter, beside: Candidate | None = None) -> list[Candidate]:
        """Return the best value of a real parameter, and its neighbours to the last bit.

        With the offset that seems to have been learnt, unless without it a value gives the record's
        bits: what a parameter bends may have looked like an offset.
        """
        if self.is_equal:
            # One value speaks for all: either the log shows each of them, or none.
            return [parameter.at(_ANY_SIZE, parameter.large)]
        changes: Mapping[str, Any] = {} if beside is None else beside.changes
        timing: Mapping[str, Any] = {} if beside is None else beside.timing
        found, is_whole = Sought(self.bench, parameter, changes, timing).found()
        if self._offset is not None and not is_whole:
            learnt = {"offset_lsb": self._offset, **timing}
            found, _ = Sought(self.bench, parameter, changes, learnt).found()
        return found

    def around_both(self, first: RealParameter, second: RealParameter) -> list[Candidate]:
        """Return the best values of two real parameters together, with their neighbours."""
        found = []
        for one, near, other in sought_together(self.bench, first, second):
            beside = self.around(other, near)[0]
            found += [again.beside(beside) for again in self.around(one, beside)]
        return found

    def _foreign_scores(self, effect: str) -> list[Scored]:
        bench = self.bench
        share = _P_FOREIGN - math.log(len(FOREIGN))
        found = []
        for program in self._best_foreign:
            for parameter in smooth(effect, bench.config):
                constant = parameter.fixed.get("constant", "tick_period")
                if effect == "blend_weight":
                    continue
                pose, scale = foreign_replay(
                    program, bench.steps, bench.windows, bench.places, scaled=str(constant)
                )
                one = parameter.at(scale, 3e-5)
                found.append(Scored(one, share + one.log_prior, bench.foreign_score(pose)))
            others = listed(effect, bench.config) if effect == "stale_heading" else []
            if effect == "auto_zero":
                others = auto_zero_candidates(bench)
            alone = bench.foreign_score(self._foreign_pose(program))
            silent = self._silent_candidate(effect)
            if silent is not None:
                found.append(Scored(silent, share + _P_SILENT, alone))
            for one in others:
                pose = self._foreign_pose(program, changes=one.changes)
                found.append(Scored(one, share + one.log_prior, bench.foreign_score(pose)))
        return found

    def _silent_candidate(self, effect: str) -> Candidate | None:
        """Return values for an effect that a float program may have without a known trace."""
        if smooth(effect, self.bench.config):
            return None
        if effect == "auto_zero":
            return no_turn_zeroed()
        if effect == "missed_deadline":
            return no_tick_missed(self.bench.inputs.ticks)
        if effect == "moving_calibration":
            return no_calibration()
        if effect == "firmware_overflow":
            return overflow_candidates(self.bench.config, self.bench.used_bits())[-1]
        found = listed(effect, self.bench.config)
        return found[0] if found else None

    def programs(self, candidates: Iterable[Candidate]) -> list[tuple[Candidate, Program]]:
        """Return each candidate with its program; those that no firmware can have are left out."""
        return [
            (one, program)
            for one in candidates
            if (program := self.bench.program(one.changes, **one.timing)) is not None
        ]
