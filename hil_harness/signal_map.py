"""Which signal of a DBC is what to the robot: the shipped DBC's map, and maps for foreign ones."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Final, get_args

from pydantic import BaseModel, ConfigDict, Field

from can_bus import Database, MessageSpec, SignalSpec
from can_bus.signals import Raw
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
from hil_harness.table_map import ColumnEntry, TableMap, mapped_table
from hil_harness.toml_model import validate
from hil_harness.toml_source import TomlSource, load_toml

REQUIRED: Final[tuple[Role, ...]] = ("left_count", "right_count")
"""Roles without which there is no dead reckoning."""

SHIPPED: Final[Mapping[Role, tuple[str, str]]] = MappingProxyType(
    {
        "left_count": ("ENCODER", "left_count"),
        "right_count": ("ENCODER", "right_count"),
        "gyro": ("IMU", "gyro_z_raw"),
        "accel_x": ("IMU", "accel_x_raw"),
        "accel_y": ("IMU", "accel_y_raw"),
        "temperature": ("ENVIRONMENT", "temperature_raw"),
        "supply": ("ENVIRONMENT", "supply_raw"),
        "v_command": ("COMMAND", "v_m_s"),
        "w_command": ("COMMAND", "w_rad_s"),
        "odom_x": ("ODOMETRY_X", "x_m"),
        "odom_y": ("ODOMETRY_Y", "y_m"),
        "odom_heading": ("ODOMETRY_HEADING", "heading_turn"),
        "reference_x": ("REFERENCE_POSE", "x_m"),
        "reference_y": ("REFERENCE_POSE", "y_m"),
        "reference_heading": ("REFERENCE_POSE", "heading_turn"),
    }
)
"""The names of docs/design.md, section 7."""


@dataclass(frozen=True)
class MappedSignal:
    """One signal and what it is to the robot.

    Attributes:
        role: what it is.
        message: the message it lies in.
        signal: its layout and scale.
        kind: counts, converter codes, or a physical quantity.
        quantity: what a physical signal measures; None for counts and codes.
        si_factor: SI per unit of the signal, 1 for counts and codes; negative where the signal
            counts the other way (``invert`` in a map).
        si_offset: added after it (degrees Celsius).
    """

    role: Role
    message: MessageSpec
    signal: SignalSpec
    kind: Kind
    quantity: Quantity | None = None
    si_factor: float = 1.0
    si_offset: float = 0.0

    @property
    def path(self) -> str:
        """Return ``MESSAGE.signal``."""
        return self.signal.path

    @property
    def si_per_lsb(self) -> float:
        """Return how much SI one step of the raw value is."""
        return self.signal.factor * self.si_factor

    def to_si(self, raw: Raw) -> float:
        """Return a physical signal's value in SI: m, rad, m/s, rad/s, m/s², K or V."""
        return self.signal.to_scaled(raw) * self.si_factor + self.si_offset

    def to_raw(self, value_si: float) -> Raw:
        """Return the nearest raw value of a physical quantity in SI (ties to even).

        Raises CanBusError outside the signal's range: nothing is clipped.
        """
        return self.signal.to_raw((value_si - self.si_offset) / self.si_factor)


@dataclass(frozen=True)
class SignalMap:
    """The signals of one DBC by what they are to the robot.

    Attributes:
        name: the file it was read from, or how messages call it.
        signals: role to signal, in the order of ROLES.
    """

    name: str
    signals: Mapping[Role, MappedSignal]

    def get(self, role: Role) -> MappedSignal | None:
        """Return the signal of *role*, None where the map has none."""
        return self.signals.get(role)

    def __getitem__(self, role: Role) -> MappedSignal:
        """Return the signal of *role*; raise HarnessError where the map has none."""
        self.require([role], "this")
        return self.signals[role]

    def require(self, roles: Iterable[Role], purpose: str) -> None:
        """Raise HarnessError unless every role is mapped; *purpose* says who needs them."""
        missing = [role for role in roles if role not in self.signals]
        if missing:
            raise HarnessError(
                f"{self.name}: {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} "
                f'missing: {purpose} needs {missing[0]} = "MESSAGE.signal" under [signals]'
            )

    def messages(self, roles: Iterable[Role]) -> tuple[MessageSpec, ...]:
        """Return the messages that carry any of *roles*, each once; unmapped roles have none."""
        found = (self.signals[role].message for role in roles if role in self.signals)
        return tuple({message.name: message for message in found}.values())

    @property
    def tick_period_us(self) -> int:
        """Return the tick period: the cycle time of the message with the left wheel.

        Raises HarnessError when the DBC gives that message no cycle time.
        """
        message = self["left_count"].message
        if message.cycle_time_us is None:
            raise HarnessError(
                f"{message.name} has no GenMsgCycleTime: expected one, for example 10 ms, "
                "as the left wheel's message sets the tick period"
            )
        return message.cycle_time_us


def default_map(database: Database) -> SignalMap:
    """Return the map of a DBC whose messages are named as those of the shipped one.

    Roles whose message it lacks are left out. Raises HarnessError where the wheels' signals are
    missing (a foreign DBC needs a map.toml), a message of theirs is faulty, or a signal's unit does
    not fit.
    """
    found: dict[Role, MappedSignal] = {}
    for role, (message_name, signal_name) in SHIPPED.items():
        message = database.messages.get(message_name)
        if message is None and message_name in database.faulty:
            raise HarnessError(database.faulty[message_name])
        if message is None or signal_name not in message.signals:
            continue
        details = SignalTable(signal=f"{message_name}.{signal_name}")
        found[role] = _mapped(role, message, message.signals[signal_name], details)
    result = SignalMap(database.path.name, MappingProxyType(found))
    for message in result.messages(SHIPPED):
        if message.e2e is None and {"crc", "tick_counter"} <= set(message.signals):
            raise HarnessError(
                f"{database.path.name}: {message.name} has crc and tick_counter, but no E2E "
                "attributes: expected E2EProfile and E2EDataId, as in the shipped DBC"
            )
    missing = [role for role in REQUIRED if role not in found]
    if missing:
        raise HarnessError(
            f"{database.path.name} has no {'.'.join(SHIPPED[missing[0]])}: a DBC with names of its "
            "own needs --signals map.toml, which says what its signals mean"
        )
    return result


class SignalTable(BaseModel):
    """One role that needs more than a name: ``{ signal = "IMU.yaw", unit = "deg/s" }``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    signal: str = Field(
        max_length=200,
        pattern=r"^[^.]+\.[^.]+$",
        description='"MESSAGE.signal" of the DBC',
        examples=["WHEELS.left"],
    )
    kind: Kind | None = Field(default=None, description="as the unit says, unless given")
    unit: str | None = Field(
        default=None, max_length=20, description="where the DBC gives none", examples=["deg/s"]
    )
    invert: bool = Field(
        default=False,
        description="true where it counts the other way: clockwise, or backwards",
        examples=[True],
    )


_Name = Annotated[
    str,
    Field(
        max_length=200,
        pattern=r"^[^.]+\.[^.]+$",
        description='"MESSAGE.signal" of the DBC',
        examples=["WHEELS.left"],
    ),
]


class MapTable(BaseModel):
    """A whole map.toml."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_: int = Field(default=1, ge=1, le=1, alias="schema", description="version", examples=[1])
    signals: dict[str, _Name | SignalTable] = Field(
        default_factory=dict, description="role to signal of a DBC"
    )
    columns: dict[str, ColumnEntry] = Field(
        default_factory=dict, description="role to column of a table"
    )


def load_map(path: str | Path, database: Database) -> SignalMap:
    """Read a map.toml that says what the signals of *database* are.

    Raises HarnessError in one line: an unknown role, message or signal with the nearest known
    name, a missing wheel, a unit that does not fit its role, a signal mapped twice.
    """
    source = load_toml(path)
    table = validate(source, MapTable)
    found: dict[Role, MappedSignal] = {}
    used: dict[str, str] = {}
    for name, entry in table.signals.items():
        at = ("signals", name)
        role = _role(source, name)
        details = SignalTable(signal=entry) if isinstance(entry, str) else entry
        message, signal = _find(source, at, details.signal, database)
        if signal.path in used:
            raise source.error(at, f"{name} = {signal.path}: already mapped as {used[signal.path]}")
        used[signal.path] = name
        try:
            found[role] = _mapped(role, message, signal, details)
        except HarnessError as error:
            raise source.error(at, f"{name}: {error}") from None
    result = SignalMap(
        source.name, MappingProxyType({role: found[role] for role in ROLES if role in found})
    )
    result.require(REQUIRED, "dead reckoning")
    return result


def load_table_map(path: str | Path, header: Sequence[str]) -> TableMap:
    """Read a map.toml that says what the columns of a table with this *header* are.

    Raises HarnessError in one line, as `load_map` does.
    """
    source = load_toml(path)
    table = validate(source, MapTable)
    if not table.columns:
        raise HarnessError(
            f"{source.name}: no [columns]: a table needs them, for example "
            'left_count = "wheel_left"'
        )
    return mapped_table(source, table.columns, header)


def _role(source: TomlSource, name: str) -> Role:
    for role in get_args(Role):
        if role == name:
            known: Role = role
            return known
    raise source.error(
        ("signals", name), f"signals.{name}: no such role: {did_you_mean(name, ROLES, limit=15)}"
    )


def _find(
    source: TomlSource, at: tuple[str, str], name: str, database: Database
) -> tuple[MessageSpec, SignalSpec]:
    message_name, signal_name = name.split(".")
    dbc = database.path.name
    message = database.messages.get(message_name)
    if message is None and message_name in database.faulty:
        raise source.error(at, f'{at[1]} = "{name}": {database.faulty[message_name]}')
    if message is None:
        near = did_you_mean(message_name, database.messages)
        raise source.error(at, f'{at[1]} = "{name}": {dbc} has no such message: {near}')
    signal = message.signals.get(signal_name)
    if signal is None:
        near = did_you_mean(signal_name, message.signals)
        raise source.error(at, f'{at[1]} = "{name}": {message_name} has no such signal: {near}')
    return message, signal


def _mapped(
    role: Role, message: MessageSpec, signal: SignalSpec, details: SignalTable
) -> MappedSignal:
    """Return the mapped signal; raise HarnessError where unit, kind and role do not fit."""
    kind, unit = details.kind, details.unit
    sign = -1.0 if details.invert else 1.0
    if unit is not None and signal.unit.strip().lower() not in COUNT_UNITS:
        raise HarnessError(
            f'unit = "{unit}": the DBC gives {signal.path} the unit {signal.unit}: '
            "expected no unit here"
        )
    text = signal.unit if unit is None else unit
    raw_kind = RAW_KIND.get(role)
    if kind not in (None, "physical", raw_kind):
        raise HarnessError(f'kind = "{kind}": expected {_kinds(role)}')
    is_raw = text.strip().lower() in COUNT_UNITS if kind is None else kind != "physical"
    if is_raw and raw_kind is not None:
        if signal.factor != 1 or signal.offset != 0 or signal.is_float:
            raise HarnessError(
                f"{signal.path} has factor {signal.factor:g} and offset {signal.offset:g}: "
                f'{raw_kind} need a whole number with factor 1; a quantity needs unit = "…", '
                f"one of {units_for(role)}"
            )
        if details.invert and raw_kind == "adc_code":
            raise HarnessError(
                f"invert = true: {signal.path} is a converter code: expected counts or a quantity"
            )
        return MappedSignal(role, message, signal, raw_kind, si_factor=sign)
    found = unit_of(text)
    if found is None or found.quantity not in QUANTITIES[role]:
        shown = f"unit {text}" if text else "no unit"
        raise HarnessError(f"{signal.path} has {shown}: expected {units_for(role)}")
    return MappedSignal(
        role,
        message,
        signal,
        "physical",
        found.quantity,
        sign * found.factor,
        sign * found.offset,
    )


def _kinds(role: Role) -> str:
    raw_kind = RAW_KIND.get(role)
    return '"physical"' if raw_kind is None else f'one of "{raw_kind}", "physical"'
