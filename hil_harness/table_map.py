"""Which column of a table is what to the robot: the names that need no map, and maps for others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Final, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field

from hil_harness.errors import HarnessError
from hil_harness.nearest import did_you_mean
from hil_harness.signal_roles import (
    COUNT_UNITS,
    QUANTITIES,
    RAW_KIND,
    ROLES,
    Kind,
    Quantity,
    Role,
    unit_of,
    units_for,
)
from hil_harness.toml_source import TomlSource

TimeRole = Literal["time", "ecu_time"]
ColumnRole = Role | TimeRole
"""What a column can be: a signal's role, or a clock: the log's, and the ECU's own."""

COLUMN_ROLES: Final[tuple[str, ...]] = (*get_args(TimeRole), *ROLES)
_TIME_ROLES: Final[tuple[str, ...]] = get_args(TimeRole)

NAMED_COLUMNS: Final[Mapping[str, tuple[str, str]]] = MappingProxyType(
    {
        "t_s": ("time", "s"),
        "ecu_t_s": ("ecu_time", "s"),
        "left_ticks": ("left_count", ""),
        "right_ticks": ("right_count", ""),
        "gyro_code": ("gyro", ""),
        "temperature_code": ("temperature", ""),
        "supply_code": ("supply", ""),
        "v_command_m_s": ("v_command", "m/s"),
        "w_command_rad_s": ("w_command", "rad/s"),
        "odom_x_m": ("odom_x", "m"),
        "odom_y_m": ("odom_y", "m"),
        "odom_heading_rad": ("odom_heading", "rad"),
    }
)
"""Columns that need no map (docs/design.md, section 7): role and unit."""


class ColumnTable(BaseModel):
    """One role of a table: ``{ column = "yaw_rate", unit = "deg/s" }``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    column: str = Field(
        min_length=1, max_length=200, description="name of a column", examples=["wheel_left"]
    )
    kind: Kind | None = Field(default=None, description="as the unit says, unless given")
    unit: str | None = Field(
        default=None, max_length=20, description="of its values", examples=["deg/s"]
    )
    invert: bool = Field(
        default=False, description="true where it counts the other way", examples=[True]
    )
    wrap: float | None = Field(
        default=None,
        gt=0,
        allow_inf_nan=False,
        description="in its own unit: where its values begin again",
        examples=[65536.0],
    )


_ColumnName = Annotated[
    str, Field(min_length=1, max_length=200, description="name of a column", examples=["t_s"])
]
ColumnEntry = _ColumnName | ColumnTable


@dataclass(frozen=True)
class MappedColumn:
    """One column and what it is to the robot.

    Attributes:
        role: what it is.
        column: its name in the table.
        kind: counts, converter codes, or a physical quantity.
        quantity: what a physical column measures; None for counts and codes.
        si_factor: SI per unit of the column; negative where it counts the other way.
        si_offset: added after it (degrees Celsius).
        wrap: where its values begin again, in the column's own unit; None: not said.
    """

    role: ColumnRole
    column: str
    kind: Kind
    quantity: Quantity | None = None
    si_factor: float = 1.0
    si_offset: float = 0.0
    wrap: float | None = None


@dataclass(frozen=True)
class TableMap:
    """The columns of one table by what they are to the robot."""

    name: str
    columns: Mapping[ColumnRole, MappedColumn]

    def get(self, role: ColumnRole) -> MappedColumn | None:
        """Return the column of *role*, None where the table has none."""
        return self.columns.get(role)


def named_table_map(name: str, header: Sequence[str]) -> TableMap:
    """Return the map of a table whose columns have the names that need none.

    Columns with other names are left alone. Raises HarnessError where wheels or clocks are missing.
    """
    found = {}
    for column in header:
        if column in NAMED_COLUMNS:
            role, unit = NAMED_COLUMNS[column]
            mapped = _mapped(role, ColumnTable(column=column, unit=unit))
            found[mapped.role] = mapped
    return _complete(name, found, header)


def mapped_table(
    source: TomlSource, entries: Mapping[str, ColumnEntry], header: Sequence[str]
) -> TableMap:
    """Return the map that the ``[columns]`` of a map.toml describe for a table.

    Raises HarnessError in one line: an unknown role or column with the nearest known name, a unit
    that does not fit its role, a column mapped twice, wheels or clocks that are missing.
    """
    found: dict[ColumnRole, MappedColumn] = {}
    used: dict[str, str] = {}
    for name, entry in entries.items():
        at = ("columns", name)
        if name not in COLUMN_ROLES:
            near = did_you_mean(name, COLUMN_ROLES, limit=len(COLUMN_ROLES))
            raise source.error(at, f"columns.{name}: no such role: {near}")
        details = ColumnTable(column=entry) if isinstance(entry, str) else entry
        if details.column not in header:
            near = did_you_mean(details.column, header)
            raise source.error(
                at, f'{name} = "{details.column}": the table has no such column: {near}'
            )
        if details.column in used:
            already = used[details.column]
            raise source.error(at, f"{name} = {details.column}: already mapped as {already}")
        used[details.column] = name
        if details.unit is None and details.column in NAMED_COLUMNS:
            details = details.model_copy(update={"unit": NAMED_COLUMNS[details.column][1]})
        try:
            mapped = _mapped(name, details)
        except HarnessError as error:
            raise source.error(at, f"{name}: {error}") from None
        found[mapped.role] = mapped
    return _complete(source.name, found, header)


def _mapped(name: str, details: ColumnTable) -> MappedColumn:
    text = (details.unit or "").strip()
    sign = -1.0 if details.invert else 1.0
    role = next((role for role in ROLES if role == name), None)
    if role is None:
        return _clock(name, details, text)
    raw_kind = RAW_KIND.get(role)
    if details.kind not in (None, "physical", raw_kind):
        raise HarnessError(f'kind = "{details.kind}": expected "physical" or "{raw_kind}"')
    is_raw = text.lower() in COUNT_UNITS if details.kind is None else details.kind != "physical"
    if is_raw and raw_kind is not None:
        if details.invert and raw_kind == "adc_code":
            raise HarnessError(
                f"invert = true: {details.column} is a converter code: expected counts or a "
                "quantity"
            )
        return MappedColumn(role, details.column, raw_kind, si_factor=sign, wrap=details.wrap)
    unit = unit_of(text)
    if unit is None or unit.quantity not in QUANTITIES[role]:
        raise HarnessError(f"{details.column} has {_shown(text)}: expected {units_for(role)}")
    return MappedColumn(
        role,
        details.column,
        "physical",
        unit.quantity,
        sign * unit.factor,
        sign * unit.offset,
        details.wrap,
    )


def _clock(name: str, details: ColumnTable, text: str) -> MappedColumn:
    unit = unit_of(text)
    if unit is None or unit.quantity != "time":
        raise HarnessError(f"{details.column} has {_shown(text)}: expected s, ms, us or ns")
    role: TimeRole = "time" if name == "time" else "ecu_time"
    return MappedColumn(role, details.column, "physical", "time", unit.factor, wrap=details.wrap)


def _shown(unit: str) -> str:
    return f"unit {unit}" if unit else "no unit"


def _complete(
    name: str, found: Mapping[ColumnRole, MappedColumn], header: Sequence[str]
) -> TableMap:
    shown = ", ".join(header[:12]) + (", …" if len(header) > 12 else "")
    for role, plain in (("left_count", "left_ticks"), ("right_count", "right_ticks")):
        if role not in found:
            raise HarnessError(
                f"{name}: no column {plain}: the table has {shown}: expected that name, or "
                f'--signals map.toml with {role} = "COLUMN" under [columns]'
            )
    if not any(role in found for role in _TIME_ROLES):
        raise HarnessError(
            f"{name}: no column t_s or ecu_t_s: the table has {shown}: expected one of them, or "
            '--signals map.toml with time = { column = "COLUMN", unit = "s" } under [columns]'
        )
    return TableMap(name, MappingProxyType(dict(found)))
