"""Proposing what the signals of a log or table are: by unit, name, wraps and correlation.

Every role is given to the signal with the most evidence for it. Two signals with the same evidence
are not decided by a coin: that is an error which names both. Sides without a name are told apart by
a gyro, which turns with right minus left.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.evidence import (
    CLEAR,
    PLACES,
    REFERENCE_WORDS,
    WORDS,
    Guess,
    Search,
    best_of,
    difference,
    is_whole,
    lacks_unit,
    likeness_of,
    rates,
    unit_score,
)
from gap_diagnosis.reading.following import STEP_S, is_followed
from gap_diagnosis.reading.signal_names import COMMAND_WORDS, axes_of, is_named, words_of
from gap_diagnosis.reading.signals_found import FoundSignal
from gap_diagnosis.reading.unit_names import unit_of_signal
from gap_diagnosis.reading.wheel_choice import choose_wheels
from gap_diagnosis.recording import Floats
from hil_harness.nearest import did_you_mean
from hil_harness.signal_map import SHIPPED
from hil_harness.signal_roles import QUANTITIES, ROLES, Role, unit_of
from hil_harness.table_map import NAMED_COLUMNS

_HEARD: Final = 0.4
"""A wheel follows its command late, and may slip: less likeness than between two sensors tells."""
_COMMANDS: Final[tuple[Role, ...]] = ("v_command", "w_command")
_REFERENCES: Final[tuple[Role, ...]] = ("reference_x", "reference_y", "reference_heading")
_ODOMETRY: Final[tuple[Role, ...]] = ("odom_heading", "odom_x", "odom_y")
_SENSORS: Final[tuple[Role, ...]] = ("accel_x", "accel_y", "temperature", "supply")
_NO_PLACES: Final = frozenset(
    {"acc", "accel", "acceleration", "accuracy", "std", "sd", "cov", "err"}
)
"""What is longitudinal and lateral too, or how sure a fix is."""
_FARTHEST_DEG: Final = 5.0
"""No log leads farther over the globe."""
_FLAG_WORDS: Final = frozenset({"fault", "faulted", "error", "valid", "invalid", "status", "flag"})
"""What ends in one says how a sensor is, not what it measures (TEMP_ACC_FAULTED)."""
_SENSOR_WORDS: Final = ("gyro", "imu", "acc", "mag")
"""An axis of these is no coordinate."""

_WHOLE_WORDS: Final = frozenset({"lin", "ang"})
"""Short for linear and angular; as parts of words they mean nothing."""


def propose(
    found: Mapping[str, FoundSignal], *, is_table: bool, given: Mapping[str, str] | None = None
) -> dict[str, Guess]:
    """Return a guess for each role that has enough evidence, by role.

    *given* says signals of roles that are known. Raises DiagnosisError for a role or signal that
    does not exist in it.

    Raises DiagnosisError where two signals have the same evidence for one role, naming both, and
    where no wheels are found.
    """
    search = Search(found, is_table)
    _take_given(search, given or {})
    _take_plain_names(search)
    for role in _COMMANDS:
        _choose(search, role, lambda s: is_named(s, COMMAND_WORDS))
    _choose_fixes(search)
    for role in _REFERENCES:
        _choose(search, role, lambda s: is_named(s, REFERENCE_WORDS))
    choose_wheels(search)
    turn = _turn(search)
    _choose(search, "gyro", None, turn)
    _choose_followed(search)
    _hear_the_command(search, turn)
    for role in _ODOMETRY:
        _choose(search, role, _is_odometry, turn if role == "odom_heading" else None)
    _hear_the_receiver(search)
    for role in _SENSORS:
        _choose(search, role, None)
    return {role: search.guesses[role] for role in ROLES if role in search.guesses}


def propose_reference(found: Mapping[str, FoundSignal]) -> dict[str, Guess]:
    """Return a guess for the positions and the heading of a table that is nothing but a reference.

    Raises DiagnosisError where two columns have the same evidence for one of them, naming both.
    """
    search = Search(found, is_table=True, is_reference=True)
    _choose_fixes(search)
    for role in _REFERENCES:
        _choose(search, role, _is_pose)
    return search.guesses


def _is_pose(signal: FoundSignal) -> bool:
    """Tell what is neither another sensor's nor how sure a pose is, of a table of poses."""
    return not is_named(signal, COMMAND_WORDS + _SENSOR_WORDS) and not (
        _NO_PLACES & set(words_of(signal))
    )


def _choose_fixes(search: Search) -> None:
    """Give the reference to a receiver's longitude and latitude, where the names say both.

    A table's columns are taken to be degrees, as long as no name says otherwise.
    """
    chosen: dict[str, Guess] = {}
    for role, (words, most_deg) in PLACES.items():
        fitting = [one for one in search.free if _is_place(search, one, words, most_deg)]
        if role in search.guesses or len(fitting) != 1:
            return
        (signal,) = fitting
        unit = (unit_of_signal(signal, True) or "deg") if search.is_table else None
        chosen[role] = Guess(role, signal, unit, reasons=("a receiver's fixes by their name",))
    search.guesses |= chosen


def _hear_the_receiver(search: Search) -> None:
    """Give a heading that stands beside a receiver's fixes, and beside no other place, to them."""
    guesses = search.guesses
    has_places = {"odom_x", "odom_y", "reference_heading"} & set(guesses)
    if PLACES.keys() <= guesses.keys() and "odom_heading" in guesses and not has_places:
        guesses["reference_heading"] = replace(
            guesses.pop("odom_heading"), role="reference_heading"
        )


def _is_place(search: Search, signal: FoundSignal, words: frozenset[str], most_deg: float) -> bool:
    said = unit_of(unit_of_signal(signal, search.is_table) or ("deg" if search.is_table else ""))
    if said is None or said.quantity != "angle" or signal.is_constant:
        return False
    own = set(words_of(signal))
    degrees = np.degrees(said.factor * signal.value[signal.value != 0.0])
    return (
        bool(own & words)
        and not own & _NO_PLACES
        and len(degrees) > 0
        and float(np.abs(degrees).max()) <= most_deg
        and float(np.ptp(degrees)) < _FARTHEST_DEG
        and not is_whole(signal)
    )


def _choose_followed(search: Search) -> None:
    """Give the commands to the one pair of a speed and a turn rate of a message that wheels follow,
    where no name tells of any: a robot's own message of what it measured comes after them."""
    if search.is_table or set(_COMMANDS) & set(search.guesses):
        return
    wheels = [search.guesses[role].signal for role in ("left_count", "right_count")]
    grid, left, right = rates(search, wheels[0], wheels[1], STEP_S)
    asked: dict[Role, Floats] = {"v_command": left + right, "w_command": right - left}
    followed: dict[str, dict[Role, list[FoundSignal]]] = {}
    for role in _COMMANDS:
        for signal in search.free:
            unit = unit_of(signal.unit)
            if unit is None or unit.quantity not in QUANTITIES[role]:
                continue
            if is_followed(signal, grid, asked[role]):
                message = signal.path.rpartition(".")[0]
                followed.setdefault(message, {}).setdefault(role, []).append(signal)
    pairs = [one for one in followed.values() if [len(some) for some in one.values()] == [1, 1]]
    if len(pairs) == 1:
        for given, (signal,) in pairs[0].items():
            reasons = (f"unit {signal.unit}", "wheels follow it")
            search.guesses[given] = Guess(given, signal, reasons=reasons)


def _hear_the_command(search: Search, turn: tuple[Floats, Floats]) -> None:
    """Leave a gyro's sign as it is where the commanded turn is against the wheels as well.

    Then it is the wheels that are wrong, by swapped sides or a sign, which the diagnosis is to say;
    a gyro turned round to match them would leave the commands as the only ones that differ.
    """
    gyro, command = search.guesses.get("gyro"), search.guesses.get("w_command")
    if gyro is None or command is None or not gyro.invert:
        return
    likeness = likeness_of(command.signal, turn, is_rate=True)
    if likeness < -_HEARD:
        told = f"turns against the wheels, and so does the command ({likeness:+.2f}): left as it is"
        search.guesses["gyro"] = replace(gyro, invert=False, reasons=(*gyro.reasons[:-1], told))


def _take_given(search: Search, given: Mapping[str, str]) -> None:
    for role, path in given.items():
        if role not in ROLES:
            raise DiagnosisError(f"{role}={path}: no such role: {did_you_mean(role, ROLES)}")
        signal = search.found.get(path)
        if signal is None:
            near = did_you_mean(path, search.found)
            raise DiagnosisError(f"{role}={path}: no such signal with values: {near}")
        wrap = signal.wrap if search.is_table and signal.wraps else None
        unit = unit_of_signal(signal, True) if search.is_table else None
        if unit == "" and role in ("left_count", "right_count") and not is_whole(signal):
            raise DiagnosisError(
                f"{role}={path}: its values are no whole counts and its name says no unit: "
                f"expected the unit in the column's name, as in {path}_m_s, or a map.toml that "
                "says it"
            )
        search.guesses[role] = Guess(
            role, signal, unit or None, False, wrap, ("as you said",), is_certain=True,
            lacks_unit=lacks_unit(search, role, signal),
        )  # fmt: skip


def _take_plain_names(search: Search) -> None:
    plain: list[tuple[str, str]] = [(".".join(path), role) for role, path in SHIPPED.items()]
    if search.is_table:
        plain = [(column, role) for column, (role, _) in NAMED_COLUMNS.items() if role in ROLES]
    for column, role in plain:
        signal = search.found.get(column)
        if signal is not None and role not in search.guesses:
            search.guesses[role] = Guess(role, signal, reasons=("its plain name",), is_certain=True)


def _is_odometry(signal: FoundSignal) -> bool:
    return not is_named(signal, COMMAND_WORDS + REFERENCE_WORDS + _SENSOR_WORDS)


def _choose(
    search: Search,
    role: Role,
    fits: Callable[[FoundSignal], bool] | None,
    turn: tuple[Floats, Floats] | None = None,
) -> None:
    """Give a role to the signal with the most evidence, if it has enough."""
    if role in search.guesses:
        return
    scored: list[tuple[float, Guess]] = []
    for signal in search.free:
        if (role == "gyro" and signal.is_constant) or (fits is not None and not fits(signal)):
            continue
        if role in (*_SENSORS, "gyro") and _FLAG_WORDS & set(words_of(signal)[-1:]):
            continue
        if fits is None and (
            is_named(signal, COMMAND_WORDS)
            or (role == "gyro" and is_named(signal, ("accel", "acc")))
        ):
            continue
        score, said = unit_score(signal, role, search.is_table)
        reasons = [] if said is None else [said]
        words = words_of(signal)
        hits = [
            word
            for word in WORDS[role]
            if word in words
            or (len(word) > 2 and word not in _WHOLE_WORDS and is_named(signal, (word,)))
        ]
        if hits:
            score += 2.0 + (1.0 if words[-1] in hits or words[-2:-1] == [hits[0]] else 0.0)
            reasons.append(f"name has {hits[0]}")
        if fits is not None and hits and role.startswith(("v_", "w_", "reference")):
            score += 1.0
        if role in ("accel_x", "accel_y", "gyro"):
            axis = role[-1] if role != "gyro" else "z"
            axes = axes_of(signal)
            if axes and axis not in axes:
                continue
            score += 1.0 if axes else 0.0
        invert = False
        if turn is not None and hits:
            likeness = likeness_of(signal, turn, is_rate=role == "gyro")
            if role == "odom_heading" and abs(likeness) < CLEAR:
                continue  # a steering wheel's angle is no heading
            score += 3.0 * abs(likeness)
            invert = likeness < -CLEAR
            reasons.append(
                f"turns against the wheels ({likeness:+.2f}), so it is inverted here"
                if invert
                else f"turns with the wheels ({likeness:+.2f})"
            )
        unit = unit_of_signal(signal, True) if search.is_table else None
        guess = Guess(
            role, signal, unit or None, invert, None, tuple(reasons),
            lacks_unit=lacks_unit(search, role, signal),
        )  # fmt: skip
        scored.append((score, guess))
    best = best_of(scored, role, is_reference=search.is_reference)
    if best is not None:
        search.guesses[role] = best


def _turn(search: Search) -> tuple[Floats, Floats]:
    left, right = (search.guesses[role].signal for role in ("left_count", "right_count"))
    return difference(search, left, right)
