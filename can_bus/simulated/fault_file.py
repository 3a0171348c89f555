"""Faults of a simulated bus from a TOML file: one `[[fault]]` table for each."""

from __future__ import annotations

import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

from can_bus.errors import CanBusError
from can_bus.simulated.faults import BusFault

_FIELDS: Final = {one.name: one for one in fields(BusFault)}
_KINDS: Final[dict[str, tuple[type, ...]]] = {
    "kind": (str,),
    "node": (str,),
    "arbitration_id": (int,),
    "count": (int,),
    "start_s": (int, float),
    "stop_s": (int, float),
    "probability": (int, float),
    "delay_s": (int, float),
    "is_extended": (bool,),
}
_LISTS: Final[dict[str, type]] = {"receivers": str, "turns": int, "bits": int}


def load_faults(path: str | Path) -> list[BusFault]:
    """Return the faults of a file.

    Raises CanBusError, with the file and the number of the fault, for anything that is not one.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        table = tomllib.loads(text)
    except OSError as error:
        raise CanBusError(f"{path}: cannot read these faults: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise CanBusError(f"{path}: this is no TOML file: {error}") from error
    entries = table.get("fault")
    if set(table) != {"fault"} or not isinstance(entries, list):
        raise CanBusError(f"{path}: expected [[fault]] tables and nothing else")
    return [_fault(f"{path}: fault {number}", entry) for number, entry in enumerate(entries, 1)]


def _fault(where: str, entry: object) -> BusFault:
    if not isinstance(entry, dict):
        raise CanBusError(f"{where}: expected a [[fault]] table")
    arguments: dict[str, Any] = {}
    for name, value in entry.items():
        if name not in _FIELDS:
            raise CanBusError(f"{where}: no field {name!r}: there are {', '.join(_FIELDS)}")
        arguments[name] = _value(f"{where}: {name}", name, value)
    if "kind" not in arguments:
        raise CanBusError(f"{where}: kind is missing")
    try:
        return BusFault(**arguments)
    except CanBusError as error:
        raise CanBusError(f"{where}: {error}") from error


def _value(where: str, name: str, value: object) -> object:
    if name == "data":
        try:
            return bytes.fromhex(value if isinstance(value, str) else "?")
        except ValueError:
            raise CanBusError(f'{where}: expected bytes as hex, as in "01ff"') from None
    if name in _LISTS:
        kind = _LISTS[name]
        if not isinstance(value, list) or any(type(one) is not kind for one in value):
            raise CanBusError(f"{where}: expected a list of {kind.__name__}")
        return tuple(value)
    kinds = _KINDS[name]
    if type(value) not in kinds:
        names = " or ".join(kind.__name__ for kind in kinds)
        raise CanBusError(f"{where} = {value!r}: expected {names}")
    return value
