"""Proposing what the signals of a log or table are: by unit, name, wraps and correlation.

Every role is given to the signal with the most evidence for it. Two signals with the same evidence
are not decided by a coin: that is an error which names both. Sides without a name are told apart by
a gyro, which turns with right minus left.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.clock_names import sounds_like_time
from gap_diagnosis.reading.following import STEP_S, correlation, is_followed
from gap_diagnosis.reading.signal_names import AXES, COMMAND_WORDS, is_named, words_of
from gap_diagnosis.reading.signals_found import FoundSignal
from gap_diagnosis.reading.unit_names import unit_of_signal
from hil_harness.nearest import did_you_mean
from hil_harness.signal_map import SHIPPED
from hil_harness.signal_roles import (
    COUNT_UNITS,
    QUANTITIES,
    RAW_KIND,
    ROLES,
    Role,
    unit_of,
    units_for,
)
from hil_harness.table_map import NAMED_COLUMNS

Floats = NDArray[np.float64]

_GRID_S: Final = 0.1
_ENOUGH: Final = 3.0
_SAME: Final = 0.25
_CLEAR: Final = 0.6
_HEARD: Final = 0.4
"""A wheel follows its command late, and may slip: less likeness than between two sensors tells."""
_COMMANDS: Final[tuple[Role, ...]] = ("v_command", "w_command")
_REFERENCES: Final[tuple[Role, ...]] = ("reference_x", "reference_y", "reference_heading")
_ODOMETRY: Final[tuple[Role, ...]] = ("odom_heading", "odom_x", "odom_y")
_SENSORS: Final[tuple[Role, ...]] = ("accel_x", "accel_y", "temperature", "supply")
_REFERENCE_WORDS: Final = (
    "reference",
    "mocap",
    "truth",
    "ground",
    "rtk",
    "gps",
    "gnss",
    "optitrack",
)
_PLACES: Final[Mapping[Role, tuple[frozenset[str], float]]] = {
    "reference_x": (frozenset({"lon", "lng", "long", "longitude"}), 360.0),
    "reference_y": (frozenset({"lat", "latitude"}), 90.0),
}
"""Words of a receiver's fixes, and the largest of them [deg]."""
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

_WORDS: Final[Mapping[Role, tuple[str, ...]]] = {
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
_WHOLE_WORDS: Final = frozenset({"lin", "ang"})
"""Short for linear and angular; as parts of words they mean nothing."""
_WHEEL_WORDS: Final = ("wheel", "encoder", "enc", "tick", "count", "pulse", "odo", "wheels")
_WAY_WORDS: Final = frozenset({"dist", "distance", "travel", "way"})
"""With a side, these are a wheel's; without, a range finder may say them."""
_REAR_AND_FRONT: Final[Mapping[Role, tuple[str, ...]]] = {
    "left_count": ("rl", "fl", "lr", "lf", "hl", "vl", "links"),
    "right_count": ("rr", "fr", "rf", "hr", "vr", "rechts"),
}
"""How cars spell the sides: rear left, front left, also in German."""
_REAR_WORDS: Final = frozenset({"rear", "back", "rl", "lr", "hl", "rr", "hr", "hinten"})


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
class _Search:
    """Roles given so far, and what may still be given."""

    found: Mapping[str, FoundSignal]
    is_table: bool
    is_reference: bool = False
    guesses: dict[str, Guess] = field(default_factory=dict)

    @property
    def free(self) -> list[FoundSignal]:
        taken = {guess.signal.path for guess in self.guesses.values()}
        return [
            signal
            for signal in self.found.values()
            if signal.path not in taken and not (self.is_table and sounds_like_time(signal.path))
        ]


def propose(
    found: Mapping[str, FoundSignal], *, is_table: bool, given: Mapping[str, str] | None = None
) -> dict[str, Guess]:
    """Return a guess for each role that has enough evidence, by role.

    *given* says signals of roles that are known. Raises DiagnosisError for a role or signal that
    does not exist in it.

    Raises DiagnosisError where two signals have the same evidence for one role, naming both, and
    where no wheels are found.
    """
    search = _Search(found, is_table)
    _take_given(search, given or {})
    _take_plain_names(search)
    for role in _COMMANDS:
        _choose(search, role, lambda s: is_named(s, COMMAND_WORDS))
    _choose_fixes(search)
    for role in _REFERENCES:
        _choose(search, role, lambda s: is_named(s, _REFERENCE_WORDS))
    _choose_wheels(search)
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
    search = _Search(found, is_table=True, is_reference=True)
    _choose_fixes(search)
    for role in _REFERENCES:
        _choose(search, role, _is_pose)
    return search.guesses


def _is_pose(signal: FoundSignal) -> bool:
    """Tell what is neither another sensor's nor how sure a pose is, of a table of poses."""
    return not is_named(signal, COMMAND_WORDS + _SENSOR_WORDS) and not (
        _NO_PLACES & set(words_of(signal))
    )


def _choose_fixes(search: _Search) -> None:
    """Give the reference to a receiver's longitude and latitude, where the names say both.

    A table's columns are taken to be degrees, as long as no name says otherwise.
    """
    chosen: dict[str, Guess] = {}
    for role, (words, most_deg) in _PLACES.items():
        fitting = [one for one in search.free if _is_place(search, one, words, most_deg)]
        if role in search.guesses or len(fitting) != 1:
            return
        (signal,) = fitting
        unit = (unit_of_signal(signal, True) or "deg") if search.is_table else None
        chosen[role] = Guess(role, signal, unit, reasons=("a receiver's fixes by their name",))
    search.guesses |= chosen


def _hear_the_receiver(search: _Search) -> None:
    """Give a heading that stands beside a receiver's fixes, and beside no other place, to them."""
    guesses = search.guesses
    has_places = {"odom_x", "odom_y", "reference_heading"} & set(guesses)
    if _PLACES.keys() <= guesses.keys() and "odom_heading" in guesses and not has_places:
        guesses["reference_heading"] = replace(
            guesses.pop("odom_heading"), role="reference_heading"
        )


def _is_place(search: _Search, signal: FoundSignal, words: frozenset[str], most_deg: float) -> bool:
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


def _choose_followed(search: _Search) -> None:
    """Give the commands to the one pair of a speed and a turn rate of a message that wheels follow,
    where no name tells of any: a robot's own message of what it measured comes after them."""
    if search.is_table or set(_COMMANDS) & set(search.guesses):
        return
    wheels = [search.guesses[role].signal for role in ("left_count", "right_count")]
    grid, left, right = _rates(search, wheels[0], wheels[1], STEP_S)
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


def _hear_the_command(search: _Search, turn: tuple[Floats, Floats]) -> None:
    """Leave a gyro's sign as it is where the commanded turn is against the wheels as well.

    Then it is the wheels that are wrong, by swapped sides or a sign, which the diagnosis is to say;
    a gyro turned round to match them would leave the commands as the only ones that differ.
    """
    gyro, command = search.guesses.get("gyro"), search.guesses.get("w_command")
    if gyro is None or command is None or not gyro.invert:
        return
    likeness = _likeness(command.signal, turn, is_rate=True)
    if likeness < -_HEARD:
        told = f"turns against the wheels, and so does the command ({likeness:+.2f}): left as it is"
        search.guesses["gyro"] = replace(gyro, invert=False, reasons=(*gyro.reasons[:-1], told))


def _take_given(search: _Search, given: Mapping[str, str]) -> None:
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
            lacks_unit=_lacks_unit(search, role, signal),
        )  # fmt: skip


def _take_plain_names(search: _Search) -> None:
    plain: list[tuple[str, str]] = [(".".join(path), role) for role, path in SHIPPED.items()]
    if search.is_table:
        plain = [(column, role) for column, (role, _) in NAMED_COLUMNS.items() if role in ROLES]
    for column, role in plain:
        signal = search.found.get(column)
        if signal is not None and role not in search.guesses:
            search.guesses[role] = Guess(role, signal, reasons=("its plain name",), is_certain=True)


def is_whole(signal: FoundSignal) -> bool:
    """Tell whether its values are whole numbers, as counts and codes are."""
    return bool(np.all(signal.value[:1000] == np.rint(signal.value[:1000])))


def _lacks_unit(search: _Search, role: Role, signal: FoundSignal) -> bool:
    """Tell a quantity of a table whose column does not say its unit: no counts, no codes."""
    said = unit_of_signal(signal, search.is_table).strip().lower() not in COUNT_UNITS
    return search.is_table and not said and not (role in RAW_KIND and is_whole(signal))


def _is_odometry(signal: FoundSignal) -> bool:
    return not is_named(signal, COMMAND_WORDS + _REFERENCE_WORDS + _SENSOR_WORDS)


def _unit_score(signal: FoundSignal, role: Role, is_table: bool) -> tuple[float, str | None]:
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
    if role in _PLACES and known.quantity == "angle":
        return -9.0, None  # by its name alone, and only beside the other one
    return 2.0, f"unit {unit}"


def _choose(
    search: _Search,
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
        score, said = _unit_score(signal, role, search.is_table)
        reasons = [] if said is None else [said]
        words = words_of(signal)
        hits = [
            word
            for word in _WORDS[role]
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
            axes = {AXES[word] for word in words if word in AXES}
            if axes and axis not in axes:
                continue
            score += 1.0 if axes else 0.0
        invert = False
        if turn is not None and hits:
            likeness = _likeness(signal, turn, is_rate=role == "gyro")
            if role == "odom_heading" and abs(likeness) < _CLEAR:
                continue  # a steering wheel's angle is no heading
            score += 3.0 * abs(likeness)
            invert = likeness < -_CLEAR
            reasons.append(
                f"turns against the wheels ({likeness:+.2f}), so it is inverted here"
                if invert
                else f"turns with the wheels ({likeness:+.2f})"
            )
        unit = unit_of_signal(signal, True) if search.is_table else None
        guess = Guess(
            role, signal, unit or None, invert, None, tuple(reasons),
            lacks_unit=_lacks_unit(search, role, signal),
        )  # fmt: skip
        scored.append((score, guess))
    best = _best(scored, role, is_reference=search.is_reference)
    if best is not None:
        search.guesses[role] = best


def _best(
    scored: list[tuple[float, Guess]], role: str, *, is_reference: bool = False
) -> Guess | None:
    ranked = sorted(scored, key=lambda entry: -entry[0])
    if not ranked or ranked[0][0] < _ENOUGH:
        return None
    if len(ranked) > 1 and ranked[0][0] - ranked[1][0] < _SAME:
        one, other = ranked[0][1].signal.path, ranked[1][1].signal.path
        expected = f"--is {role}={one} or --is {role}={other}"
        raise DiagnosisError(
            f"{role} could be {one} as well as {other}: nothing in names, units or values tells "
            f"them apart: expected {'one of them only' if is_reference else expected}"
        )
    return ranked[0][1]


def _choose_wheels(search: _Search) -> None:
    if "left_count" in search.guesses and "right_count" in search.guesses:
        return
    by_side: dict[Role, list[tuple[float, Guess]]] = {"left_count": [], "right_count": []}
    unnamed: list[tuple[float, Guess]] = []
    for signal in search.free:
        score, guess = _wheel_evidence(search, signal)
        if score < _ENOUGH:
            continue
        words = set(words_of(signal))
        sides = [side for side in by_side if words & {*_WORDS[side], *_REAR_AND_FRONT[side]}]
        if len(sides) == 1:
            named = Guess(
                sides[0], signal, guess.unit, wrap=guess.wrap, reasons=("name", *guess.reasons)
            )
            by_side[sides[0]].append((score, named))
        else:
            unnamed.append((score, guess))
    _prefer_rear(by_side)
    for role, scored in by_side.items():
        if role not in search.guesses and (best := _best(scored, role)) is not None:
            search.guesses[role] = best
    missing = [role for role in by_side if role not in search.guesses]
    if len(missing) == 2 and len(unnamed) >= 2:
        _sides_by_gyro(search, unnamed)
    elif missing:
        bare = next((one for one in search.free if _is_bare_wheel(search, one)), None)
        if bare is not None:
            key = "column" if search.is_table else "signal"
            raise DiagnosisError(
                f"{bare.path} has the name of a wheel, and no unit: expected it in a map.toml, "
                f'below [{key}s], as in {missing[0]} = {{ {key} = "{bare.path}", unit = "km/h" }}'
            )
        odd = next((one for one in search.free if _is_odd_wheel(search, one, missing)), None)
        if odd is not None:
            raise DiagnosisError(
                f"{odd.path} has the name of a wheel, and its unit, {odd.unit}, is not understood: "
                f"expected {units_for(missing[0])}"
            )
        still = next((one for one in search.free if _is_still_wheel(one, missing)), None)
        if still is not None:
            raise DiagnosisError(
                f"{still.path} has the name of a wheel, and never changes ({still.low:g}): "
                "expected a log in which the robot drives"
            )
        seen = ", ".join(search.found) if len(search.found) < 30 else f"{len(search.found)} signals"
        raise DiagnosisError(
            f"no signal looks like {' or '.join(missing)}: expected a wheel's counts, angle, "
            f"distance or speed among {seen}; --is {missing[0]}=SIGNAL says which"
        )


def _prefer_rear(by_side: dict[Role, list[tuple[float, Guess]]]) -> None:
    """Raise the evidence of a whole rear axle beside other wheels: a car's front ones are steered,
    and run farther in a turn than wheels that stay behind each other."""
    rear = {
        role: [bool(_REAR_WORDS & set(words_of(guess.signal))) for _, guess in scored]
        for role, scored in by_side.items()
    }
    is_axle = all(any(flags) for flags in rear.values())
    if not is_axle or all(all(flags) for flags in rear.values()):
        return
    for role, scored in by_side.items():
        for place, (score, guess) in enumerate(scored):
            if rear[role][place]:
                reasons = (*guess.reasons, "the rear wheels, as the front ones may be steered")
                scored[place] = (score + 2 * _SAME, replace(guess, reasons=reasons))


def _is_bare_wheel(search: _Search, signal: FoundSignal) -> bool:
    """Tell a wheel by its name whose values are no counts and whose unit nobody says."""
    return (
        is_named(signal, _WHEEL_WORDS)
        and unit_of_signal(signal, search.is_table).strip().lower() in COUNT_UNITS
        and not signal.is_constant
        and not is_whole(signal)
    )


def _is_still_wheel(signal: FoundSignal, missing: list[Role]) -> bool:
    """Tell a wheel, by its name and side, that did not turn in this log."""
    sides = {word for role in missing for word in (*_WORDS[role], *_REAR_AND_FRONT[role])}
    return (
        signal.is_constant
        and is_named(signal, _WHEEL_WORDS)
        and not is_named(signal, COMMAND_WORDS)
        and bool(sides & set(words_of(signal)))
    )


def _is_odd_wheel(search: _Search, signal: FoundSignal, missing: list[Role]) -> bool:
    """Tell a wheel, by its name and side, whose unit nobody understands; steering has no side."""
    unit = unit_of_signal(signal, search.is_table).strip()
    if unit.lower() in COUNT_UNITS or unit_of(unit) is not None or signal.is_constant:
        return False
    sides = {word for role in missing for word in (*_WORDS[role], *_REAR_AND_FRONT[role])}
    return is_named(signal, _WHEEL_WORDS) and bool(sides & set(words_of(signal)))


def _wheel_evidence(search: _Search, signal: FoundSignal) -> tuple[float, Guess]:
    guess = Guess("left_count", signal)
    if signal.is_constant or is_named(signal, COMMAND_WORDS + _REFERENCE_WORDS):
        return -9.0, guess
    score, said = _unit_score(signal, "left_count", search.is_table)
    reasons = [] if said is None else [said]
    words = words_of(signal)
    sides = {word for role in _REAR_AND_FRONT for word in (*_WORDS[role], *_REAR_AND_FRONT[role])}
    if any(hint in word for word in words for hint in _WHEEL_WORDS) or (
        _WAY_WORDS & set(words) and sides & set(words)
    ):
        score += 2.0
        reasons.append("name of a wheel")
    elif {"left", "right", *_REAR_AND_FRONT["left_count"], *_REAR_AND_FRONT["right_count"]} & set(
        words
    ):
        score += 1.0
    if signal.wraps:
        score += 1.0
        reasons.append(f"wraps at {signal.wrap:g}")
    if "pwm" in words or "current" in words or "cliff" in words:
        score -= 4.0
    unit = unit_of_signal(signal, True) if search.is_table else None
    wrap = signal.wrap if search.is_table and signal.wraps else None
    return score, Guess("left_count", signal, unit or None, wrap=wrap, reasons=tuple(reasons))


def _sides_by_gyro(search: _Search, unnamed: list[tuple[float, Guess]]) -> None:
    """Tell two wheels without sides in their names apart by a gyro."""
    (_, one), (_, other) = sorted(unnamed, key=lambda entry: -entry[0])[:2]
    gyros = [s for s in search.free if is_named(s, _WORDS["gyro"]) and not s.is_constant]
    for gyro in gyros:
        turn = _difference(search, one.signal, other.signal)
        likeness = _likeness(gyro, turn, is_rate=True)
        if abs(likeness) > _CLEAR:
            left, right = (one, other) if likeness > 0 else (other, one)
            why = f"sides by {gyro.path} ({abs(likeness):.2f})"
            for role, guess in (("left_count", left), ("right_count", right)):
                search.guesses[role] = Guess(
                    role, guess.signal, guess.unit, wrap=guess.wrap, reasons=(*guess.reasons, why)
                )
            return
    raise DiagnosisError(
        f"left_count could be {one.signal.path} as well as {other.signal.path}: neither name says "
        f"left or right: expected --is left_count={one.signal.path} or "
        f"--is left_count={other.signal.path}"
    )


def _turn(search: _Search) -> tuple[Floats, Floats]:
    left, right = (search.guesses[role].signal for role in ("left_count", "right_count"))
    return _difference(search, left, right)


def _difference(search: _Search, left: FoundSignal, right: FoundSignal) -> tuple[Floats, Floats]:
    """Return a grid of times and how fast the right wheel turns beyond the left one on it."""
    grid, left_rate, right_rate = _rates(search, left, right, _GRID_S)
    return grid, right_rate - left_rate


def _rates(
    search: _Search, left: FoundSignal, right: FoundSignal, step_s: float
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


def _likeness(signal: FoundSignal, turn: tuple[Floats, Floats], *, is_rate: bool) -> float:
    """Return the correlation of a signal with the wheels' turning, -1 to 1."""
    grid, growth = turn
    if len(grid) < 10:
        return 0.0
    values = signal.value if is_rate else signal.unwrapped()
    seen = np.interp(grid, signal.time_s, values)
    if not is_rate:
        seen, growth = np.diff(seen), growth[1:]
    return correlation(seen, growth)
