"""What speaks for a signal being what: unit, name, and how like the wheels' turning it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.clock_names import sounds_like_time
from gap_diagnosis.reading.following import correlation
from gap_diagnosis.reading.signals_found import FoundSignal
from gap_diagnosis.reading.unit_names import unit_of_signal
from gap_diagnosis.recording import Floats
from hil_harness.signal_roles import COUNT_UNITS, QUANTITIES, RAW_KIND, Role, unit_of

_GRID_S: Final = 0.1
ENOUGH: Final = 3.0
SAME: Final = 0.25
CLEAR: Final = 0.6
REFERENCE_WORDS: Final = (
    "reference",
    "mocap",
    "truth",
    "ground",
    "rtk",
    "gps",
    "gnss",
    "optitrack",
)
PLACES: Final[Mapping[Role, tuple[frozenset[str], float]]] = {
    "reference_x": (frozenset({"lon", "lng", "long", "longitude"}), 360.0),
    "reference_y": (frozenset({"lat", "latitude"}), 90.0),
}
"""Words of a receiver's fixes, and the largest of them [deg]."""
WORDS: Final[Mapping[Role, tuple[str, ...]]] = {
    "left_count": ("left", "lft", "wl", "l"),
    "right_count": ("right", "rgt", "wr", "r"),
    "gyro": ("gyro", "yawrate", "yaw", "omega", "wz", "gz", "angular"),
    "accel_x": ("accel", "acc", "ax"),
    "accel_y": ("accel", "acc", "ay"),
    "temperature": ("temperature", "temp"),
    "supply": ("supply", "battery", "voltage", "vbat", "volt"),
    "v_command": ("v", "speed", "linear", "lin", "velocity", "vx"),
    "w_command": ("w", "turn", "angular", "ang", "omega", "yaw", "wz"),
    "odom_x": ("x", "px"),
    "odom_y": ("y", "py"),
    "odom_heading": ("heading", "yaw", "theta", "angle", "psi"),
    "reference_x": ("x", "px", "east", "easting"),
    "reference_y": ("y", "py", "north", "northing"),
    "reference_heading": ("heading", "yaw", "theta", "angle", "psi"),
}


@dataclass(frozen=True)
class Guess:
    """One line of a proposed map.

    Attributes:
        role: what the signal is taken to be.
        signal: the signal.
        unit: what the map must say, None where the DBC or the column's plain name says it.
        invert: it counts the other way.
        wrap: of a table's column: where it begins again.
        reasons: why, for people.
        is_certain: the name is the contract's own.
        lacks_unit: a quantity, of which nobody says in what.
    """

    role: str
    signal: FoundSignal
    unit: str | None = None
    invert: bool = False
    wrap: float | None = None
    reasons: tuple[str, ...] = ()
    is_certain: bool = False
    lacks_unit: bool = False


@dataclass
class Search:
    """Roles given so far, and what may still be given."""

    found: Mapping[str, FoundSignal]
    is_table: bool
    is_reference: bool = False
    guesses: dict[str, Guess] = field(default_factory=dict)

    @property
    def free(self) -> list[FoundSignal]:
        """The signals without a role, but a table's times."""
        taken = {guess.signal.path for guess in self.guesses.values()}
        return [
            signal
            for signal in self.found.values()
            if signal.path not in taken and not (self.is_table and sounds_like_time(signal.path))
        ]


def is_whole(signal: FoundSignal) -> bool:
    """Tell whether its values are whole numbers, as counts and codes are."""
    return bool(np.all(signal.value[:1000] == np.rint(signal.value[:1000])))


def lacks_unit(search: Search, role: Role, signal: FoundSignal) -> bool:
    """Tell a quantity of a table whose column does not say its unit: no counts, no codes."""
    said = unit_of_signal(signal, search.is_table).strip().lower() not in COUNT_UNITS
    return search.is_table and not said and not (role in RAW_KIND and is_whole(signal))


def unit_score(signal: FoundSignal, role: Role, is_table: bool) -> tuple[float, str | None]:
    """Return how well the unit fits, and what is said for it; None where it cannot be."""
    unit = unit_of_signal(signal, is_table)
    if unit.strip().lower() in COUNT_UNITS:
        if role in RAW_KIND:
            whole = is_whole(signal)
            rate = is_table and role == "gyro"
            return (1.0 if whole else 0.0 if rate else -9.0), "whole numbers" if whole else None
        return (0.0 if is_table else -9.0), None
    known = unit_of(unit)
    if known is None or known.quantity not in QUANTITIES[role]:
        return -9.0, None
    if role in PLACES and known.quantity == "angle":
        return -9.0, None  # by its name alone, and only beside the other one
    return 2.0, f"unit {unit}"


def best_of(
    scored: list[tuple[float, Guess]], role: str, *, is_reference: bool = False
) -> Guess | None:
    """Return the guess with the most evidence, None where none has enough; raise DiagnosisError
    where two have the same."""
    ranked = sorted(scored, key=lambda entry: -entry[0])
    if not ranked or ranked[0][0] < ENOUGH:
        return None
    if len(ranked) > 1 and ranked[0][0] - ranked[1][0] < SAME:
        one, other = ranked[0][1].signal.path, ranked[1][1].signal.path
        expected = f"--is {role}={one} or --is {role}={other}"
        raise DiagnosisError(
            f"{role} could be {one} as well as {other}: nothing in names, units or values tells "
            f"them apart: expected {'one of them only' if is_reference else expected}"
        )
    return ranked[0][1]


def difference(search: Search, left: FoundSignal, right: FoundSignal) -> tuple[Floats, Floats]:
    """Return a grid of times and how fast the right wheel turns beyond the left one on it."""
    grid, left_rate, right_rate = rates(search, left, right, _GRID_S)
    return grid, right_rate - left_rate


def rates(
    search: Search, left: FoundSignal, right: FoundSignal, step_s: float
) -> tuple[Floats, Floats, Floats]:
    """Return a grid of times and how fast either wheel turns on it."""
    start = max(left.time_s[0], right.time_s[0])
    stop = min(left.time_s[-1], right.time_s[-1])
    grid = np.arange(start, stop, step_s)[:1_000_000]
    if len(grid) < 3:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    unit = unit_of(unit_of_signal(left, search.is_table))
    is_rate = unit is not None and unit.quantity in ("speed", "turn rate")
    ways = (np.interp(grid, one.time_s, one.unwrapped()) for one in (left, right))
    left_rate, right_rate = (way[1:] if is_rate else np.diff(way) for way in ways)
    return grid[1:], left_rate, right_rate


def likeness_of(signal: FoundSignal, turn: tuple[Floats, Floats], *, is_rate: bool) -> float:
    """Return the correlation of a signal with the wheels' turning, -1 to 1."""
    grid, growth = turn
    if len(grid) < 10:
        return 0.0
    values = signal.value if is_rate else signal.unwrapped()
    seen = np.interp(grid, signal.time_s, values)
    if not is_rate:
        seen, growth = np.diff(seen), growth[1:]
    return correlation(seen, growth)
