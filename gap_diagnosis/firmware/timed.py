"""Programs that differ at certain times: turns zeroed, an offset averaged in motion, ticks lost."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta

from firmware_model import FRESH
from gap_diagnosis.firmware.candidates import Candidate, altered_config
from gap_diagnosis.firmware.cells import cell_about
from gap_diagnosis.firmware.replay import Program
from gap_diagnosis.firmware.workbench import NOTHING_LEARNT, Workbench
from gap_diagnosis.recording import Floats

_QUANTA: Final = 4.0
_MOST_WINDOW_S: Final = 30.0
_MOST_STARTS: Final = 8
_TRIED_LSB: Final = 1000.0
_MOST_ENDS: Final = 500
_PARTS: Final = (
    0.0001, 0.001, 0.005, 0.025, 0.1, 0.25, 0.4, 0.6, 0.75, 0.9, 0.975, 0.995, 0.999, 0.9999,
)  # fmt: skip
"""Ends of the parts in which a probability's distribution is told: its tails make an interval."""
_THRESHOLDS_RAD_S: Final = (1e-4, 0.3)
_THRESHOLD_POINTS: Final = 24
_CLOSINGS: Final = 6


def auto_zero_candidates(bench: Workbench) -> list[Candidate]:
    """Return thresholds that the turns allow which are 0 in the record and not in the replay.

    All thresholds between the largest turn that was zeroed and the smallest that was not leave
    the same log.
    """
    rows = bench.windows.rows
    step_ticks = np.diff(bench.places[rows])
    period_s = bench.steps.period_s
    turned = np.diff(bench.windows.pose[:, 2])
    replayed = np.diff(bench.described[rows, 2])
    floor = _QUANTA * float(bench.windows.quantum[2])
    usable = (step_ticks == 1) & (np.abs(replayed) > floor)
    zeroed = usable & (np.abs(turned) < 0.5 * float(bench.windows.quantum[2]))
    passed = usable & ~zeroed
    if np.count_nonzero(zeroed) < 3:
        return []
    rate = np.abs(replayed) / period_s
    thresholds = []
    for share in (1.0, 0.99, 0.9):
        low = float(np.quantile(rate[zeroed], share))
        above = rate[passed & (rate > low)]
        high = float(np.min(above)) if len(above) else 2.0 * low
        thresholds.append((0.5 * (low + high), 0.5 * (high - low)))
    return [
        Candidate(
            {"auto_zero.threshold": value},
            {"auto_zero_rad_s": value},
            math.log(max(min(0.2 * 2 * width / value, 1.0), 1e-12)),
            {"auto_zero.threshold": width},
        )
        for value, width in dict(thresholds).items()
    ]


def exact_auto_zero(bench: Workbench) -> list[Candidate]:
    """Return the thresholds whose replay is the record to its last digit; nothing where none is.

    The nearer a threshold is to the right one, the later the first turn that it treats wrongly, so
    that the search closes in on the replay that holds longest.
    """
    tried = np.geomspace(*_THRESHOLDS_RAD_S, _THRESHOLD_POINTS)
    for _ in range(_CLOSINGS):
        at_most = len(tried) - 1
        held = [_held_rows(bench, float(one)) for one in tried]
        at = int(np.argmax(held))
        if held[at] == len(bench.windows.rows):
            low, high = cell_about(
                float(tried[at]),
                lambda value: _held_rows(bench, value) == len(bench.windows.rows),
                *_THRESHOLDS_RAD_S,
            )
            value, width = 0.5 * (low + high), 0.5 * (high - low)
            return [
                Candidate(
                    {"auto_zero.threshold": value},
                    {"auto_zero_rad_s": value},
                    math.log(max(min(0.2 * 2 * width / value, 1.0), 1e-12)),
                    {"auto_zero.threshold": width},
                )
            ]
        # All that hold equally long fail at the same turn, on one side of the right one: it lies
        # just below the first of them or just above the last.
        best = np.flatnonzero(np.array(held) == held[at])
        first, last = best[0], best[-1]
        below = np.linspace(tried[max(first - 1, 0)], tried[first], _THRESHOLD_POINTS // 2)
        above = np.linspace(tried[last], tried[min(last + 1, at_most)], _THRESHOLD_POINTS // 2)
        tried = np.concatenate([below, above])
    return []


def _held_rows(bench: Workbench, threshold: float) -> int:
    """Return with how many rows of the record, from the start, a replay with it agrees."""
    program = bench.program({"auto_zero_rad_s": threshold})
    if program is None:
        return 0
    rows = bench.windows.rows
    away = np.abs(bench.windows.pose - bench.poses(program)[rows])
    wrong = np.flatnonzero(np.any(away > 0.51 * bench.windows.quantum, axis=1))
    return int(wrong[0]) if len(wrong) else len(rows)


def calibration_candidates(bench: Workbench) -> list[Candidate]:
    """Return windows in whose codes' mean the heading's drift is found.

    Before the window's end the offset is the nominal one; after it, and for good, the mean. The
    first tick whose turn differs from the nominal replay's is the end; from the drift after it
    follows the offset, and every start with that mean is a candidate.
    """
    base = altered_config(bench.config, NOTHING_LEARNT)
    if base is None:
        return []
    rows = bench.windows.rows
    nominal = bench.poses(Program(base))[rows, 2]
    drift = (bench.windows.pose[:, 2] - bench.windows.pose[0, 2]) - (nominal - nominal[0])
    quantum = float(bench.windows.quantum[2])
    away = np.flatnonzero(np.abs(drift) > _QUANTA * quantum)
    if len(away) == 0 or len(rows) - away[0] < 100:
        return []
    first_row = int(away[0])
    codes = bench.inputs.gyro_code.astype(np.float64)
    fresh = bench.inputs.gyro_validity == FRESH
    turns = bench.turning()
    active = np.cumsum(turns)
    last = int(bench.places[rows[first_row]])
    zero = bench.config.constants.gyro_zero_rate_code
    told = bench.poses(Program(base, offset_lsb=zero + _TRIED_LSB, offset_tick=last))[rows, 2]
    later = np.arange(len(rows)) >= first_row
    A = np.column_stack([active[later], np.ones(np.count_nonzero(later))])
    # How much of the gyro the heading takes over is the program's: its weight, its way of turning.
    both = np.column_stack([drift, told - nominal])[later]
    slope, slope_tried = np.linalg.lstsq(A, both, rcond=None)[0][0]
    if slope_tried == 0.0:
        return []
    offset = zero + _TRIED_LSB * float(slope / slope_tried)
    # While the heading is held an offset leaves no trace: the window may have ended there.
    before = np.flatnonzero(turns[:first_row])
    earliest = bench.places[rows[before[-1]]] if len(before) else 0
    ends = range(max(int(earliest) - 1, last - _MOST_ENDS, 1), min(last + 2, bench.inputs.ticks))
    return _windows_with_mean(bench, codes, fresh, ends, offset)


def _windows_with_mean(
    bench: Workbench,
    codes: Floats,
    fresh: NDArray[np.bool_],
    ends: range,
    mean: float,
) -> list[Candidate]:
    period_s = bench.steps.period_s
    found: list[tuple[float, int, int, float]] = []
    total = np.concatenate([[0.0], np.cumsum(np.where(fresh, codes, 0.0))])
    count = np.concatenate([[0], np.cumsum(fresh)])
    for end in ends:
        begin = np.arange(max(0, end - round(_MOST_WINDOW_S / period_s)), end)
        samples = np.maximum(count[end] - count[begin], 1)
        means = (total[end] - total[begin]) / samples
        for one in np.argsort(np.abs(means - mean))[:_MOST_STARTS]:
            found.append((abs(float(means[one]) - mean), int(begin[one]), end, float(means[one])))
    found.sort()
    share = 2.0 * math.log(period_s / max(bench.inputs.ticks * period_s, 1.0))
    results = []
    for _, begin_tick, end, value in found[: 2 * _MOST_STARTS]:
        start_s = float(bench.inputs.t_s[begin_tick])
        stop_s = float(bench.inputs.t_s[min(end, bench.inputs.ticks - 1)])
        one = Candidate(
            {"moving_calibration.start_s": start_s, "moving_calibration.stop_s": stop_s},
            {"calibration_start_s": start_s, "calibration_stop_s": stop_s},
            share,
            {"moving_calibration.start_s": period_s, "moving_calibration.stop_s": period_s},
            {"offset_lsb": value, "offset_tick": end},
        )
        results.append(one)
    return results


def skipped_ticks(bench: Workbench) -> tuple[int, ...]:
    """Return the ticks that seem not to have been executed.

    No odometry came in them although it comes in nearly every tick, or the one before was repeated
    while the replay moved on.
    """
    seen = np.zeros(bench.inputs.ticks, np.bool_)
    rows = bench.windows.rows
    places = bench.places[rows]
    seen[places] = True
    seen[bench.repeats] = True
    inside = np.zeros_like(seen)
    inside[places[0] : places[-1] + 1] = True
    if np.count_nonzero(seen) < 0.5 * np.count_nonzero(inside):
        return ()
    missing = np.flatnonzero(inside & ~seen)
    still = np.all(np.diff(bench.windows.pose, axis=0) == 0.0, axis=1)
    quanta = _QUANTA * bench.windows.quantum
    moved = np.any(np.abs(np.diff(bench.described[rows], axis=0)) > quanta, axis=1)
    repeated = places[1:][still & moved & (np.diff(places) == 1)]
    return tuple(sorted({*missing.tolist(), *repeated.tolist()}))


def missed_deadlines(bench: Workbench) -> list[Candidate]:
    """Return the program that did not execute some ticks; nothing where each seems to have been."""
    skipped = skipped_ticks(bench)
    if not skipped or len(skipped) > bench.inputs.ticks // 2:
        return []
    ticks = bench.inputs.ticks
    share = (len(skipped) + 1) / (ticks + 2)
    # Which ticks were lost is as good as a message of this length, at this rate.
    message = ticks * (share * math.log(share) + (1.0 - share) * math.log1p(-share))
    # The probability's own distribution, the prior being even in logarithm.
    edges = beta.ppf(_PARTS, len(skipped), ticks - len(skipped) + 1)
    return [
        Candidate(
            {"missed_deadline.probability": float(0.5 * (one + other))},
            {"missed_deadline": share},
            message + math.log(part),
            {"missed_deadline.probability": float(0.5 * (other - one))},
            {"skipped": skipped},
        )
        for one, other, part in zip(edges[:-1], edges[1:], np.diff(_PARTS), strict=True)
    ]


def no_tick_missed(ticks: int) -> Candidate:
    """Return a probability so small that no tick of the log was missed, with its share."""
    name = "missed_deadline.probability"
    return Candidate({name: 0.3 / ticks}, {}, math.log(0.25), {name: 0.3 / ticks})


def no_turn_zeroed() -> Candidate:
    """Return a threshold so small that it can leave no trace, with a tenth of the prior."""
    name = "auto_zero.threshold"
    return Candidate({name: 1e-9}, {"auto_zero_rad_s": 1e-9}, math.log(0.1), {name: 1e-9})


def no_calibration() -> Candidate:
    """Return a window of no length, for programs whose offset is free anyway."""
    start, stop = "moving_calibration.start_s", "moving_calibration.stop_s"
    return Candidate({start: 0.0, stop: 0.0}, {}, 0.0, {})
