"""The firmware's part of the likelihood: recorded odometry against replays of possible programs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from gap_diagnosis.firmware.candidates import (
    EFFECTS,
    Candidate,
    RealParameter,
    Value,
    listed,
    overflow_candidates,
    smooth,
)
from gap_diagnosis.firmware.comparison import (
    catch_all_score,
    cut_windows,
    misfit,
    turn_scores,
)
from gap_diagnosis.firmware.foreign import (
    FOREIGN,
    Foreign,
    best_lag,
    float_steps,
    foreign_replay,
)
from gap_diagnosis.firmware.inputs import recorded_odometry, replay_inputs
from gap_diagnosis.firmware.leftover import Leftover, describe, flexible
from gap_diagnosis.firmware.offsets import offset_programs
from gap_diagnosis.firmware.replay import Program, Start, find_start, replay
from gap_diagnosis.firmware.timed import (
    auto_zero_candidates,
    calibration_programs,
    missed_deadline,
)
from gap_diagnosis.firmware.workbench import Workbench
from gap_diagnosis.hypothesis import Estimate, Fit
from gap_diagnosis.recording import Floats, Recording
from hil_harness.assembly import Wire
from hil_harness.robot import Robot

_LIMIT: Final = 1e4
_DRAWS: Final = 400
_ALIKE_NATS: Final = 1e-3

_P_DESCRIBED: Final = math.log(0.9)
_P_OFFSET: Final = math.log(0.03)
_P_FOREIGN: Final = math.log(0.04)
_P_OTHER: Final = math.log(0.03)
_P_SILENT: Final = math.log(0.3)

_BEST_FOREIGN: Final = 3
_SCREENED_TICKS: Final = 2_500
_KEPT_AFTER_SCREEN: Final = 16
_SCREEN_NATS: Final = 200.0
_KEPT_FOR_PAIRS: Final = 5
_WORTH_PAIRING: Final = 25.0
_LEAST_WIDTH: Final = 2.0**-46
_NEIGHBOURS: Final = tuple(s * 2.0**-k for k in (46, 45, 44, 36, 30, 29) for s in (1, -1))


@dataclass(frozen=True)
class Scored:
    """A candidate with its logarithms of prior (with that of its program) and likelihood."""

    candidate: Candidate
    log_prior: float
    log_likelihood: float

    @property
    def total(self) -> float:
        """The logarithm of prior times likelihood."""
        return self.log_prior + self.log_likelihood


class FirmwareBlock:
    """Residual r6: the odometry frames against replays. A `Block` (see `hypothesis`).

    The programs that may have run are: the described kernel; the same with an offset that it had
    learnt before the log began; a float program of another author; and some other arithmetic, of
    which nothing is known. Each effect alters the first three. Log evidence is relative to no
    effect, with the same programs.
    """

    name = "firmware"
    effects = frozenset(EFFECTS)

    def __init__(self, bench: Workbench) -> None:
        """Prepare one log's block; use `firmware_block`."""
        self._bench = bench
        self._singles: dict[str, list[Scored]] = {}
        self._fits: dict[frozenset[str], Fit] = {}

    @cached_property
    def is_equal(self) -> bool:
        """Whether the record is the described program's output to its last digit."""
        return self._bench.is_equal(self._bench.described)

    def fit(self, effects: frozenset[str]) -> Fit:
        """Fit up to two of the block's effects; the empty set is no effect.

        Raises ValueError for an effect of another block, and for more than two.
        """
        unknown = effects - self.effects
        if unknown or len(effects) > 2:
            raise ValueError(f"effects {sorted(effects)}: expected up to two of {EFFECTS}")
        if effects not in self._fits:
            self._fits[effects] = self._fit(effects)
        return self._fits[effects]

    def leftover(self) -> Leftover:
        """Return what the best program with at most one effect leaves unexplained."""
        bench = self._bench
        none = _log_sum(one.total for one in self._no_effect)
        off = misfit(bench.windows, bench.described)
        for pose in self._best_poses:
            other = misfit(bench.windows, pose)
            if _size(other, bench) < _size(off, bench):
                off = other
        return describe(bench.windows, off, bench.t_s, self._other - none)

    # Evidence -----------------------------------------------------------------------------

    def _fit(self, effects: frozenset[str]) -> Fit:
        names = tuple(sorted(effects))
        if not names:
            return Fit((), 0.0, 0.0)
        found = self._single(names[0]) if len(names) == 1 else self._pair(*names)
        none = _log_sum([*(one.total for one in self._no_effect), self._other])
        most = max(one.log_likelihood for one in self._no_effect)
        most = max(most, self._other)
        if not found:
            return Fit(names, 0.0, 0.0)
        total = _log_sum([*(one.total for one in found), self._other])
        best = max(self._other, *(one.log_likelihood for one in found))
        return Fit(
            names,
            float(np.clip(total - none, -_LIMIT, _LIMIT)),
            float(np.clip(best - most, -_LIMIT, _LIMIT)),
            _estimates(found),
        )

    @cached_property
    def _other(self) -> float:
        """Prior times likelihood of some other arithmetic, in logarithm: blind to all effects."""
        bench = self._bench
        off = misfit(bench.windows, bench.described)
        best = catch_all_score(bench.windows, flexible(bench.windows, off, bench.t_s))
        return _P_OTHER + max(best, catch_all_score(bench.windows, off))

    @cached_property
    def _no_effect(self) -> list[Scored]:
        bench = self._bench
        nothing = Candidate({}, {}, 0.0, {})
        found = [Scored(nothing, _P_DESCRIBED, bench.score(bench.described))]
        if self.is_equal:
            return found
        found += [
            Scored(nothing, _P_OFFSET, bench.score(bench.poses(program)))
            for program in self._offsets
        ]
        share = _P_FOREIGN - math.log(len(FOREIGN))
        return found + [
            Scored(nothing, share, bench.score(self._foreign_pose(program))) for program in FOREIGN
        ]

    @cached_property
    def _offsets(self) -> list[Program]:
        return offset_programs(self._bench)

    @cached_property
    def _offset(self) -> float | None:
        """The offset learnt before the log began; None where power-on's serves as well."""
        if self.is_equal or not self._offsets:
            return None
        bench = self._bench
        turns = [
            float(np.sum(turn_scores(bench.windows, bench.poses(program))))
            for program in self._offsets
        ]
        at = int(np.argmax(turns))
        if turns[at] < float(np.sum(turn_scores(bench.windows, bench.described))) + 5.0:
            return None
        return self._offsets[at].offset_lsb

    @cached_property
    def _best_foreign(self) -> tuple[Foreign, ...]:
        """The float programs nearest to the record when their constants are free."""

        def distance(program: Foreign) -> float:
            own = "tick_period" if program.source == "gyro" else "wheelbase"
            pose = self._foreign_pose(program, scaled=own)
            return _size(misfit(self._bench.windows, pose), self._bench)

        return tuple(sorted(FOREIGN, key=distance)[:_BEST_FOREIGN])

    @cached_property
    def _best_poses(self) -> list[Floats]:
        return [self._foreign_pose(program) for program in self._best_foreign]

    def _foreign_pose(self, program: Foreign, **more: Any) -> Floats:
        bench = self._bench
        return foreign_replay(program, bench.steps, bench.windows, bench.places, **more)[0]

    # One effect ---------------------------------------------------------------------------

    def _single(self, effect: str) -> list[Scored]:
        if effect not in self._singles:
            found = self._kernel_scores(effect)
            if not self.is_equal:
                found += self._foreign_scores(effect)
            self._singles[effect] = found
        return self._singles[effect]

    def _kernel_scores(self, effect: str) -> list[Scored]:
        bench = self._bench
        candidates = listed(effect, bench.config)
        for parameter in smooth(effect, bench.config):
            candidates += self._around(parameter, {})
        if effect == "auto_zero":
            candidates += auto_zero_candidates(bench)
            candidates.append(_without_trace("auto_zero.threshold", "auto_zero_rad_s"))
        if effect == "firmware_overflow":
            candidates += overflow_candidates(bench.config, bench.used_bits())
        pairs = self._programs(candidates)
        if effect == "moving_calibration":
            pairs += calibration_programs(bench)
        if effect == "missed_deadline":
            missed = missed_deadline(bench)
            pairs += self._programs([_no_tick_missed(bench.inputs.ticks)])
            pairs += [] if missed is None else [missed]
        return self._scored(pairs)

    def _scored(self, pairs: list[tuple[Candidate, Program]]) -> list[Scored]:
        """Return the likelihood of each; of a long log only of those that fit its beginning."""
        bench = self._bench
        rows = int(np.searchsorted(bench.places, self._screen_tick))
        head = replace(bench, windows=bench.windows.head(rows))
        if len(pairs) > _KEPT_AFTER_SCREEN and rows < len(bench.places) and head.windows.count:
            scores = [head.score(bench.poses(program, rows)) for _, program in pairs]
            order = sorted(range(len(pairs)), key=lambda at: -scores[at] - pairs[at][0].log_prior)
            worst = scores[order[0]] - _SCREEN_NATS
            pairs = [pairs[at] for at in order[:_KEPT_AFTER_SCREEN] if scores[at] >= worst]
        found = [
            Scored(one, _P_DESCRIBED + one.log_prior, bench.score(bench.poses(program)))
            for one, program in pairs
        ]
        if self._offset is None:
            return found
        return found + [
            Scored(
                one,
                _P_OFFSET + one.log_prior,
                bench.score(bench.poses(replace(program, offset_lsb=self._offset))),
            )
            for one, program in pairs
            if program.offset_lsb is None
        ]

    @cached_property
    def _screen_tick(self) -> int:
        """So far a candidate is looked at first: a while beyond the first difference."""
        bench = self._bench
        rows = bench.windows.rows
        away = np.abs(bench.windows.pose - bench.described[rows]) > bench.windows.quantum
        first = np.flatnonzero(np.any(away, axis=1))
        begin = int(bench.places[rows[first[0]]]) if len(first) else 0
        return begin + _SCREENED_TICKS

    def _around(self, parameter: RealParameter, beside: dict[str, Any]) -> list[Candidate]:
        """Return the best value of a real parameter, and its neighbours to the last bit."""
        bench = self._bench

        def pose_at(value: float) -> Floats | None:
            program = bench.program({**beside, **parameter.fixed, parameter.field: value})
            return None if program is None else bench.poses(program)

        if self.is_equal:
            return [parameter.at(parameter.small, parameter.small)]
        best = bench.solve(pose_at, parameter.low, parameter.high)
        values = [best]
        if (pose := pose_at(best)) is not None and bench.is_near(pose):
            spread = max(abs(best), 1.0)
            values += [best + step * spread for step in _NEIGHBOURS]
            values += [round(best, digits) for digits in range(3, 12)]
        width = max(_LEAST_WIDTH, 0.5 * self._resolution(parameter))
        kept = {value for value in values if parameter.low <= value <= parameter.high and value}
        return [parameter.at(value, width) for value in sorted(kept)]

    def _resolution(self, parameter: RealParameter) -> float:
        """Return about how finely the record tells a constant: a digit over path and turn."""
        windows = self._bench.windows
        path_m = float(np.sum(np.hypot(*np.diff(windows.pose[:, :2], axis=0).T))) + 1e-9
        turn_rad = float(np.sum(np.abs(np.diff(windows.pose[:, 2])))) + 1e-9
        return float(min(windows.quantum[0] / path_m, windows.quantum[2] / turn_rad))

    def _foreign_scores(self, effect: str) -> list[Scored]:
        bench = self._bench
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
                found.append(Scored(one, share + one.log_prior, bench.score(pose)))
            others = listed(effect, bench.config) if effect == "stale_heading" else []
            if effect == "auto_zero":
                others = auto_zero_candidates(bench)
            alone = bench.score(self._foreign_pose(program))
            silent = self._silent_candidate(effect)
            if silent is not None:
                found.append(Scored(silent, share + _P_SILENT, alone))
            for one in others:
                pose = self._foreign_pose(program, changes=one.changes)
                found.append(Scored(one, share + one.log_prior, bench.score(pose)))
        return found

    def _silent_candidate(self, effect: str) -> Candidate | None:
        """Return values for an effect that a float program may have without a known trace."""
        if smooth(effect, self._bench.config):
            return None
        if effect == "auto_zero":
            return _without_trace("auto_zero.threshold", "auto_zero_rad_s")
        if effect == "missed_deadline":
            return _no_tick_missed(self._bench.inputs.ticks)
        if effect == "firmware_overflow":
            return overflow_candidates(self._bench.config, self._bench.used_bits())[-1]
        found = listed(effect, self._bench.config)
        return found[0] if found else None

    # Two effects --------------------------------------------------------------------------

    def _pair(self, first: str, second: str) -> list[Scored]:
        """Return both together: replayed where it may matter, else the better one alone.

        Where one effect alone explains the record, the other may be there without a trace; its
        prior then counts only as far as its values leave none.
        """
        alone = {name: self._single(name) for name in (first, second)}
        found = [
            Scored(
                one.candidate.beside(silent),
                one.log_prior + silent.log_prior,
                one.log_likelihood,
            )
            for name, other in ((first, second), (second, first))
            for one in alone[name]
            if (silent := self._silent(other)) is not None
        ]
        if self._is_explained or not self._looks_like_kernel:
            return found
        return found + self._product(first, second)

    def _silent(self, effect: str) -> Candidate | None:
        """Return the values of an effect that leave the described program's output as it is."""
        described = self._bench.score(self._bench.described)
        same = [
            one
            for one in self._single(effect)
            if one.log_prior >= _P_DESCRIBED - 60.0 and abs(one.log_likelihood - described) < 1e-6
        ]
        if not same:
            return None
        best = max(same, key=lambda one: one.log_prior)
        return replace(
            best.candidate, log_prior=_log_sum(one.log_prior for one in same) - _P_DESCRIBED
        )

    @cached_property
    def _is_explained(self) -> bool:
        """Whether no effect or one effect reproduces the record to its last digit."""
        best = max(
            [one.log_likelihood for one in self._no_effect]
            + [one.log_likelihood for name in EFFECTS for one in self._single(name)]
        )
        return best >= self._bench.highest_score - _WORTH_PAIRING

    @cached_property
    def _looks_like_kernel(self) -> bool:
        """Whether some program of the kernel comes nearer than all other arithmetic."""
        best = max(
            (one.log_likelihood for name in EFFECTS for one in self._single(name)),
            default=-math.inf,
        )
        return best > self._other - 0.25 * abs(self._other)

    def _product(self, first: str, second: str) -> list[Scored]:
        bench = self._bench
        smooth_names = [name for name in (first, second) if smooth(name, bench.config)]
        pairs: list[tuple[Candidate, Program]] = []
        if smooth_names:
            name = smooth_names[0]
            other = second if name == first else first
            rest = _best(self._single(other), _KEPT_FOR_PAIRS)
            if other in smooth_names:
                rest = _best(self._single(other), 2)
            for one in rest:
                for parameter in smooth(name, bench.config):
                    pairs += self._programs(
                        candidate.beside(one)
                        for candidate in self._around(parameter, dict(one.changes))
                    )
        else:
            pairs = self._programs(
                a.beside(b)
                for a in _best(self._single(first), _KEPT_FOR_PAIRS)
                for b in _best(self._single(second), _KEPT_FOR_PAIRS)
            )
        return self._scored(pairs)

    def _programs(self, candidates: Iterable[Candidate]) -> list[tuple[Candidate, Program]]:
        return [
            (one, program)
            for one in candidates
            if (program := self._bench.program(one.changes)) is not None
        ]


def _best(scored: list[Scored], count: int) -> list[Candidate]:
    ranked = sorted(scored, key=lambda one: -one.total)
    return [one.candidate for one in ranked[:count]]


def _without_trace(name: str, field: str) -> Candidate:
    """Return a value so small that it can leave no trace, with a tenth of the prior."""
    return Candidate({name: 1e-9}, {field: 1e-9}, math.log(0.1), {name: 1e-9})


def _no_tick_missed(ticks: int) -> Candidate:
    """Return a probability so small that no tick of the log was missed, with its share."""
    name = "missed_deadline.probability"
    return Candidate({name: 0.3 / ticks}, {}, math.log(0.25), {name: 0.3 / ticks})


def _size(off: Floats, bench: Workbench) -> float:
    z = np.clip(np.nan_to_num(off, nan=1e30) / bench.windows.floor, -1e6, 1e6)
    return float(np.sum(np.log1p(z**2)))


def _log_sum(terms: Iterable[float]) -> float:
    known = list(terms)
    return float(np.logaddexp.reduce(np.array(known))) if known else -math.inf


def _estimates(found: list[Scored]) -> dict[str, Estimate]:
    """Return what the candidates say of each parameter, weighted by their probabilities."""
    totals = np.array([one.total for one in found])
    weights = np.exp(totals - np.max(totals))
    weights /= np.sum(weights)
    # Of values that serve alike the first listed is shown.
    best = found[int(np.argmax(totals >= np.max(totals) - _ALIKE_NATS))].candidate
    rng = np.random.default_rng(np.random.Philox(key=len(found)))
    # Numbers speak of the most probable choice: a scale of another constant is another number.
    choices = {name: value for name, value in best.values.items() if isinstance(value, str)}
    alike = np.array(
        [all(one.candidate.values.get(n) == v for n, v in choices.items()) for one in found]
    )
    drawn = rng.choice(len(found), _DRAWS, p=weights * alike / np.sum(weights * alike))
    estimates: dict[str, Estimate] = {}
    for name, value in best.values.items():
        values: list[Value] = [one.candidate.values[name] for one in found]
        if isinstance(value, str):
            shares: dict[str, float] = {}
            for one, weight in zip(values, weights.tolist(), strict=True):
                shares[str(one)] = shares.get(str(one), 0.0) + weight
            estimates[name] = Estimate(value, probabilities=shares)
            continue
        numbers = np.array([float(one) for one in values])
        widths = np.array([one.candidate.widths.get(name, 0.0) for one in found])
        samples = numbers[drawn] + widths[drawn] * rng.uniform(-1.0, 1.0, _DRAWS)
        middle = value if isinstance(value, int) else float(np.mean(samples))
        estimates[name] = Estimate(middle, float(np.std(samples)), samples)
    return estimates


def firmware_block(recording: Recording, robot: Robot, wire: Wire) -> FirmwareBlock | None:
    """Return the firmware's block of a log; None without odometry or without wheel counts.

    Raises HarnessError for a description that no kernel can be built from.
    """
    odometry = recorded_odometry(recording, wire)
    if odometry is None or np.count_nonzero(np.isfinite(recording.left_ticks)) < 3:
        return None
    inputs = replay_inputs(recording, robot, wire)
    windows = cut_windows(odometry, recording.t_s)
    if windows.count == 0:
        return None
    steps = float_steps(inputs)
    lag = best_lag(steps, windows, inputs.at_row)
    places = np.clip(inputs.at_row - lag, 0, inputs.ticks - 1)
    described = replay(inputs, Program(inputs.config), Start())[places]
    start = find_start(inputs, odometry, described)
    if start.pose is not None:
        start = replace(start, tick=max(start.tick - lag, 0))
        described = replay(inputs, Program(inputs.config), start)[places]
    bench = Workbench(inputs, windows, start, places, steps, described, recording.t_s)
    return FirmwareBlock(bench)
