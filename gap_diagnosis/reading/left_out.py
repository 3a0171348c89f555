"""What is left out, in words: of a proposed map what has a role's name but a unit that nobody
understands, of a DBC what cannot be right.

Without a word the diagnosis would do without a gyro that the log has.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from can_bus import Database
from gap_diagnosis.reading.evidence import Guess, is_whole
from gap_diagnosis.reading.signal_names import COMMAND_WORDS, axes_of, is_named, words_of
from gap_diagnosis.reading.signals_found import FoundSignal
from gap_diagnosis.reading.unit_names import unit_of_signal
from hil_harness.signal_roles import COUNT_UNITS, Role, unit_of, units_for

_YAW_RATE: Final = ("gyro", "yawrate", "yaw rate", "yaw vel", "omega", "angular", "turn rate")
_ANGLE_WORDS: Final = frozenset({"heading", "yaw", "angle", "theta", "psi"})
_SPEED: Final = frozenset({"speed", "velocity", "vel", "v", "vx", "linear"})
_EXAMPLE: Final[Mapping[Role, str]] = {"gyro": "deg/s", "v_command": "m/s", "w_command": "rad/s"}


def left_out(
    found: Mapping[str, FoundSignal], guesses: Mapping[str, Guess], *, is_table: bool = False
) -> dict[str, str]:
    """Return a sentence for each signal that only its unit keeps out of a map, by path.

    Of a table only for the angle of a gyro; what lacks a unit there is asked for in the map.
    """
    taken = {guess.signal.path for guess in guesses.values()}
    told = {}
    for path, signal in found.items():
        if path in taken or signal.is_constant:
            continue
        if "gyro" not in guesses and _is_angle_of_gyro(signal, is_table):
            told[path] = (
                f"{path} is left out: it is an angle, and no role takes a gyro's angle; expected "
                "its rate as gyro, in deg/s or rad/s, for example"
            )
            continue
        role = _role_by_name(signal)
        if is_table or role is None or role in guesses:
            continue
        if signal.unit.strip().lower() not in COUNT_UNITS:
            if unit_of(signal.unit) is None:
                told[path] = (
                    f"{path} is left out: its unit, {signal.unit}, is not understood; as {role} "
                    f"one of {units_for(role)} would be"
                )
        elif not is_whole(signal):
            told[path] = (
                f"{path} is left out: the DBC gives it no unit; expected one in the map, as in "
                f'{role} = {{ signal = "{path}", unit = "{_EXAMPLE[role]}" }}'
            )
    return told


def _is_angle_of_gyro(signal: FoundSignal, is_table: bool) -> bool:
    """Tell how far a gyro or an IMU has turned about the vertical: a rate already added up."""
    unit = unit_of(unit_of_signal(signal, is_table))
    words = set(words_of(signal))
    is_other = bool(axes_of(signal) - {"z"}) or bool(words & {"roll", "pitch"})
    is_turn = "gyro" in words or bool(words & _ANGLE_WORDS)
    return (
        unit is not None
        and unit.quantity == "angle"
        and is_named(signal, ("gyro", "imu"))
        and is_turn
        and not is_other
        and not is_named(signal, COMMAND_WORDS)
    )


def _role_by_name(signal: FoundSignal) -> Role | None:
    """Return what a name says in so many words: a yaw rate or a command; wheels are missed anyway.

    A yaw alone may be an angle.
    """
    words = set(words_of(signal))
    is_turn = is_named(signal, _YAW_RATE) or bool(words & {"wz", "gz"})
    if is_named(signal, COMMAND_WORDS):
        return "w_command" if is_turn else "v_command" if words & _SPEED else None
    is_other = is_named(signal, ("accel", "acc")) or bool(axes_of(signal) - {"z"})
    return "gyro" if is_turn and not is_other else None


def faulty_messages(database: Database) -> tuple[str, ...]:
    """Say which messages of a DBC cannot be right and were not read."""
    if not database.faulty:
        return ()
    first, *more = database.faulty.values()
    said = first.replace(str(database.path), database.path.name, 1)
    also = f"; and {len(more)} more" if more else ""
    return (f"Not read, as it cannot be right: {said.rstrip('.')}{also}.",)
