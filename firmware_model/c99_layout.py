"""The C structs as NumPy records: the header is the one place that states their fields."""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from firmware_model import c99
from firmware_model.config import KernelConfig
from firmware_model.errors import FirmwareError
from firmware_model.tables import cordic_table, quarter_sine_table

Records: TypeAlias = npt.NDArray[np.void]
Int64Array: TypeAlias = npt.NDArray[np.int64]
Int32Array: TypeAlias = npt.NDArray[np.int32]

_FIELD: Final = re.compile(r"^ +(?:const )?u?int(?P<bits>\d+)_t (?P<star>\*?)(?P<name>\w+);")
_POINTERS: Final = ("sine_table", "cordic_table")


@lru_cache(maxsize=8)
def struct_dtype(struct: str, *, pointer_bytes: int = 8) -> np.dtype[Any]:
    """Return a struct of the header as a record type, aligned as C aligns it.

    A 64-bit PC (pointers of 8 bytes) and an Arm Cortex-M (of 4) lay the rest out alike.
    """
    members: list[tuple[str, str]] = []
    for match, is_signed in _fields(struct):
        if match["star"]:
            members.append((match["name"], f"u{pointer_bytes}"))
        else:
            kind = "i" if is_signed else "u"
            members.append((match["name"], f"{kind}{int(match['bits']) // 8}"))
    return np.dtype(members, align=True)


def c_types(struct: str) -> dict[str, str]:
    """Return the type of each field of a struct, as in ``{"tick": "int64_t"}``, in its order."""
    return {
        match["name"]: f"{'' if is_signed else 'u'}int{match['bits']}_t{match['star']}"
        for match, is_signed in _fields(struct)
    }


def _fields(struct: str) -> list[tuple[re.Match[str], bool]]:
    body = re.search(
        rf"typedef struct {struct} {{\n(.*?)^}} {struct};", c99.text(c99.HEADER), re.S | re.M
    )
    assert body is not None, f"{c99.HEADER} has no struct {struct}"
    matches = (_FIELD.match(line) for line in body[1].splitlines())
    return [(one, " uint" not in one[0]) for one in matches if one is not None]


def config_values(config: KernelConfig) -> dict[str, int]:
    """Return what each field of the C configuration holds, but for the two table pointers."""
    return {
        name: getattr(config, name) for name in c_types("chiplog_config") if name not in _POINTERS
    }


def config_tables(config: KernelConfig) -> tuple[Int32Array, Int64Array]:
    """Return the sine table and the CORDIC table as C holds them; the one not used is empty."""
    trig = config.description.trig
    sines: tuple[int, ...] = ()
    angles: tuple[int, ...] = ()
    if trig.method == "cordic":
        angles = cordic_table(trig.iterations, trig.frac_bits)
    else:
        sines = quarter_sine_table(trig.entries, trig.frac_bits)
    return np.array(sines, dtype=np.int32), np.array(angles, dtype=np.int64)


def table_bytes(config: KernelConfig) -> int:
    """Return the bytes of the table that C holds: of `config_tables` the one that is used."""
    is_cordic = config.description.trig.method == "cordic"
    return len(config.table) * table_entry_bytes("cordic_table" if is_cordic else "sine_table")


@lru_cache(maxsize=2)
def table_entry_bytes(name: str) -> int:
    """Return the bytes of an entry of ``sine_table`` or ``cordic_table``."""
    return np.dtype(c_types("chiplog_config")[name].removesuffix("_t*")).itemsize


def config_record(
    config: KernelConfig, sine_table: int, cordic_table: int, *, pointer_bytes: int = 8
) -> Records:
    """Return one record of the C configuration, its tables at these addresses.

    Raises:
        FirmwareError: a value that its C field cannot hold.
    """
    record = np.zeros(1, struct_dtype("chiplog_config", pointer_bytes=pointer_bytes))
    for name, value in config_values(config).items():
        put(record, name, value)
    record["sine_table"] = sine_table
    record["cordic_table"] = cordic_table
    return record


def put(record: Records, name: str, value: int) -> None:
    """Set a field of a record.

    Raises:
        FirmwareError: the field cannot hold the value.
    """
    limits = np.iinfo(record.dtype[name])
    if not limits.min <= value <= limits.max:
        raise FirmwareError(
            f"{name} = {value}: expected {limits.min} to {limits.max}, what the field of "
            f"{c99.HEADER} holds"
        )
    record[name] = value
