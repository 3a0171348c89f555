"""A proposed map.toml as text, each guess marked."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import cast

import numpy as np

from can_bus import Database
from gap_diagnosis.reading.clock_names import by_name, is_controllers, time_unit
from gap_diagnosis.reading.evidence import Guess
from gap_diagnosis.reading.left_out import left_out
from gap_diagnosis.reading.propose import propose
from gap_diagnosis.reading.signals_found import FoundSignal, signals_of_log, signals_of_table
from gap_diagnosis.reading.table_file import is_table
from hil_harness.signal_roles import Role, unit_of, units_for
from hil_harness.table_map import NAMED_COLUMNS


def signals_of(path: Path, database: Database | None) -> dict[str, FoundSignal]:
    """Return the signals of a log (which needs its *database*) or the columns of a table.

    Raises DiagnosisError or CanBusError in one line.
    """
    if is_table(path):
        return signals_of_table(path)
    assert database is not None  # a log's command has one
    return signals_of_log(path, database)


def propose_map(
    path: Path, database: Database | None, given: Mapping[str, str] | None = None
) -> tuple[dict[str, FoundSignal], dict[str, Guess], str]:
    """Return the signals of a log or table, what each is taken to be, and that as a map.toml.

    Raises DiagnosisError in one line: two signals with equal evidence for one role (both named), no
    wheels, a log or table that cannot be read.
    """
    found = signals_of(path, database)
    guesses = propose(found, is_table=is_table(path), given=given)
    dbc = None if database is None or is_table(path) else database.path.name
    return found, guesses, _text(path.name, dbc, found, guesses)


def _text(
    name: str, dbc: str | None, found: Mapping[str, FoundSignal], guesses: Mapping[str, Guess]
) -> str:
    of_what = f"columns of {name}" if dbc is None else f"signals of {dbc} (seen in {name})"
    lines = [
        f"# What the {of_what} are to the robot, proposed by chiplog map.",
        "# Lines marked GUESS rest on names, units and values: check them, then remove the mark.",
        "",
        "[columns]" if dbc is None else "[signals]",
    ]
    clocks = _clocks(found) if dbc is None else {}
    lines += clocks.values()
    lines += [_line(role, guess, dbc is None) for role, guess in guesses.items()]
    if any(guess.lacks_unit for guess in guesses.values()):
        lines.insert(2, "# A line without a unit is commented out: say the unit, and remove the #.")
    taken = {guess.signal.path for guess in guesses.values()} | set(clocks)
    rest = [signal for path, signal in found.items() if path not in taken]
    if told := left_out(found, guesses, is_table=dbc is None):
        lines += ["", *(f"# {sentence}" for sentence in told.values())]
    if rest:
        lines += ["", "# Not mapped:"]
        lines += [f"#   {signal.path}{_unit(signal)}" for signal in rest]
    return "\n".join(lines) + "\n"


def _clocks(found: Mapping[str, FoundSignal]) -> dict[str, str]:
    """Return the lines of a table's clocks, by column."""
    plain = {name: role for name, (role, _) in NAMED_COLUMNS.items() if role.endswith("time")}
    lines = {
        name: f'{role} = {{ column = "{name}", unit = "s" }}'
        for name, role in plain.items()
        if name in found
    }
    if lines:
        return lines
    running, wrapping = _running_clocks(found), _wrapping_clocks(found)
    for name in running[:1]:
        entry = _clock_entry(name, time_unit(found[name].value, name)[0])
        lines[name] = f"time = {{ {entry} }}  # GUESS: a time's name, ascending"
    for name in wrapping[:1]:
        signal = found[name]
        entry = _clock_entry(name, time_unit(signal.unwrapped(), name)[0])
        lines[name] = (
            f"ecu_time = {{ {entry}, wrap = {signal.wrap!r} }}"
            f"  # GUESS: a time's name, wraps at {signal.wrap:g}"
        )
    for name in [] if wrapping else [one for one in running[1:] if is_controllers(one)][:1]:
        entry = _clock_entry(name, time_unit(found[name].value, name)[0])
        lines[name] = f"ecu_time = {{ {entry} }}  # GUESS: a controller's clock by its name"
    return lines


def _running_clocks(found: Mapping[str, FoundSignal]) -> list[str]:
    """Return the columns of a table that sound like a time and ascend throughout."""
    return [
        name
        for name in by_name(found)
        if not found[name].is_constant and np.all(np.diff(found[name].value) >= 0)
    ]


def _wrapping_clocks(found: Mapping[str, FoundSignal]) -> list[str]:
    """Return the columns of a table that sound like a time and ascend but for their wraps."""
    return [
        name
        for name in by_name(found)
        if found[name].wraps and np.all(np.diff(found[name].unwrapped()) >= 0)
    ]


def _clock_entry(name: str, unit: str) -> str:
    return f'column = {json.dumps(name)}, unit = "{unit}"'


def _line(role: str, guess: Guess, is_table: bool) -> str:
    name = json.dumps(guess.signal.path)
    parts = [f"{'column' if is_table else 'signal'} = {name}"]
    is_plain = is_table and guess.signal.path in NAMED_COLUMNS
    if guess.unit is not None and not is_plain and unit_of(guess.unit) is not None:
        parts.append(f"unit = {json.dumps(guess.unit)}")
    if guess.invert:
        parts.append("invert = true")
    if guess.wrap is not None:
        parts.append(f"wrap = {guess.wrap!r}")
    if guess.lacks_unit:
        parts.insert(1, 'unit = "?"')
    entry = name if len(parts) == 1 else f"{{ {', '.join(parts)} }}"
    mark = "" if guess.is_certain else f"  # GUESS: {', '.join(guess.reasons)}"
    if guess.lacks_unit:
        units = units_for(cast(Role, guess.role))
        return f"# {role} = {entry}{mark or '  # as you said'}; its unit is one of {units}"
    return f"{role} = {entry}{mark}"


def _unit(signal: FoundSignal) -> str:
    return f" [{signal.unit}]" if signal.unit else ""
