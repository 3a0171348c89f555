"""The smallest size of each effect of the program that a log's replay shows.

A replay is exact: one digit of one row that is another tells. Where the remainders that the ECU
carried into the log are unknown, its last digits prove nothing, and a row must differ by more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np

from firmware_model.changes import CONSTANTS
from gap_diagnosis.firmware.candidates import Candidate, listed, overflow_candidates
from gap_diagnosis.firmware.comparison import CARRIED_QUANTA
from gap_diagnosis.firmware.workbench import Workbench
from gap_diagnosis.priors import default_prior

UP_TO: Final = frozenset({"coarse_trig_table", "firmware_overflow"})
"""Effects that are the larger, the smaller their number is: the limit is the largest that shows."""
_SCREENED_ROWS: Final = 2_500
_FINEST: Final = 1e-13
_STEP: Final = 4.0
_SIZED: Final[Mapping[str, tuple[str, str]]] = {
    "firmware_constant": ("constant_scale", "scale"),
    "fixed_tick_period": ("tick_period_scale", "scale"),
    "blend_weight": ("blend_weight", "weight"),
}
"""Field of `FirmwareChanges` and parameter of the effects that have a size."""
_THRESHOLDS_RAD_S: Final = (1e-5, 1.0)


def replay_limits(bench: Workbench) -> dict[str, float | None]:
    """Return the limit of each effect; 0: it shows whenever it acts, None: nothing of it does.

    A size is found to a factor of four, a probability is that of one event in the log.
    """

    def shows(changes: Mapping[str, Any]) -> bool:
        return _shows(bench, changes)

    def shows_any(programs: Sequence[Mapping[str, Any]]) -> bool:
        return any(shows(one) for one in programs)

    def least(name: str) -> float | None:
        """Return the least of a whole number, or the largest, or 0 of a choice."""
        found = listed(name, bench.config)
        if name == "coarse_trig_table":
            found = found[::-1]
        for one in found:
            if shows(one.changes):
                numbers = [value for value in one.values.values() if not isinstance(value, str)]
                return float(numbers[0]) if numbers else 0.0
        return None

    limits = {
        name: least(name)
        for name in ("firmware_truncation", "coarse_trig_table", "euler_integration")
    }
    limits["stale_heading"] = least("stale_heading")
    fewer = sorted(listed("firmware_resolution", bench.config), key=_bits)
    limits["firmware_resolution"] = next((_bits(one) for one in fewer if shows(one.changes)), None)
    words = overflow_candidates(bench.config, bench.used_bits())
    wrapping = [one for one in words if one.changes["overflow_mode"] == "wrap"]
    wide = sorted(wrapping, key=_bits, reverse=True)
    limits["firmware_overflow"] = next((_bits(one) for one in wide if shows(one.changes)), None)
    for name, (field, parameter) in _SIZED.items():
        high = default_prior().ranges[name][parameter][1]
        choices = [{"constant": one} for one in CONSTANTS] if name == "firmware_constant" else [{}]
        if name != "blend_weight" or bench.config.description.mode == "blend":
            programs = partial(_sized, choices, field)
            limits[name] = _size(shows_any, programs, _FINEST, high)
    limits["auto_zero"] = _size(
        shows_any, partial(_sized, [{}], "auto_zero_rad_s"), *_THRESHOLDS_RAD_S
    )
    moves = limits["auto_zero"] is not None
    limits["moving_calibration"] = 0.0 if moves else None
    limits["missed_deadline"] = 1.0 / bench.inputs.ticks if moves else None
    return limits


def _bits(one: Candidate) -> float:
    (bits,) = (value for name, value in one.changes.items() if name.endswith("_bits"))
    return float(bits)


def _shows(bench: Workbench, changes: Mapping[str, Any]) -> bool:
    """Tell whether a program of these changes says another digit in some row."""
    program = bench.program(changes)
    if program is None or program.config == bench.config:
        return False
    windows = bench.windows
    least = windows.quantum * (0.5 if windows.is_exact else CARRIED_QUANTA)
    for rows in (_SCREENED_ROWS, None):
        pose = bench.poses(program, rows)[windows.rows]
        off = np.abs(pose - bench.described[windows.rows])
        if np.any(off > least):
            return True
    return False


def _sized(
    choices: Sequence[Mapping[str, Any]], field: str, size: float
) -> list[Mapping[str, Any]]:
    return [{**choice, field: size} for choice in choices]


def _size(
    shows: Callable[[Sequence[Mapping[str, Any]]], bool],
    programs: Callable[[float], Sequence[Mapping[str, Any]]],
    low: float,
    high: float,
) -> float | None:
    """Return the first size, each four times the one before, of which some program shows."""
    size = low
    while size <= high:
        if shows(programs(size)):
            return size
        size *= _STEP
    return None
