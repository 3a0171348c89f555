"""What a proposed map leaves out though its name says a role: for a unit that nobody understands.

Without a word the diagnosis would do without a gyro that the log has.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from gap_diagnosis.reading.propose import Guess, is_whole
from gap_diagnosis.reading.signal_names import AXES, COMMAND_WORDS, is_named, words_of
from gap_diagnosis.reading.signals_found import FoundSignal
from hil_harness.signal_roles import COUNT_UNITS, Role, unit_of, units_for

_YAW_RATE: Final = ("gyro", "yawrate", "yaw rate", "yaw vel", "omega", "angular", "turn rate")
_SPEED: Final = frozenset({"speed", "velocity", "vel", "v", "vx", "linear"})
_EXAMPLE: Final[Mapping[Role, str]] = {"gyro": "deg/s", "v_command": "m/s", "w_command": "rad/s"}


def left_out(found: Mapping[str, FoundSignal], guesses: Mapping[str, Guess]) -> dict[str, str]:
    """Return a sentence for each signal of a bus that only its unit keeps out of a map, by path."""
    taken = {guess.signal.path for guess in guesses.values()}
    told = {}
    for path, signal in found.items():
        role = _role_by_name(signal)
        if role is None or role in guesses or path in taken or signal.is_constant:
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


def _role_by_name(signal: FoundSignal) -> Role | None:
    """Return what a name says in so many words: a yaw rate or a command; wheels are missed anyway.

    A yaw alone may be an angle.
    """
    words = set(words_of(signal))
    is_turn = is_named(signal, _YAW_RATE) or bool(words & {"wz", "gz"})
    if is_named(signal, COMMAND_WORDS):
        return "w_command" if is_turn else "v_command" if words & _SPEED else None
    axes = {AXES[word] for word in words & AXES.keys()}
    is_other = is_named(signal, ("accel", "acc")) or bool(axes - {"z"})
    return "gyro" if is_turn and not is_other else None
