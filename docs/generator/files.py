"""The pages of the files that a user writes, from the models that validate them."""

from __future__ import annotations

from collections.abc import Iterator

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from firmware_model import FirmwareDescription
from generator.tables import number, table
from hil_harness.robot import RobotFile
from hil_harness.scenarios.named import NAMED
from hil_harness.scenarios.scenario_file import ScenarioTable, SegmentTable
from hil_harness.signal_map import REQUIRED, SHIPPED
from hil_harness.signal_roles import (
    COUNT_UNITS,
    QUANTITIES,
    RAW_KIND,
    ROLES,
    UNITS,
    Role,
)
from hil_harness.table_map import NAMED_COLUMNS, ColumnTable


def robot() -> str:
    """Return the page of robot.toml, from the models that validate it."""
    parts = [
        "# robot.toml",
        "Everything that is true of the robot and not of the wire. Every table and every key may "
        "be left out; what is not there is the lesson's robot, which `chiplog init` writes with "
        "comments. `chiplog schema robot` prints the JSON schema. How to fill it in: "
        "[Describe my robot](../how-to/my-robot.md).",
        "A file may begin with `schema = 1`, the version of this format.",
        "## The robot as its owner describes it",
    ]
    parts += list(_tables(RobotFile, without="firmware"))
    parts += ["## The firmware", "How the kernel computes.", *_tables_of_firmware()]
    return "\n\n".join(part.strip() for part in parts)


def _tables(model: type[BaseModel], *, without: str) -> Iterator[str]:
    """Yield a heading and a table for each table of the file."""
    for name, field in model.model_fields.items():
        if name != without and _is_table(field):
            yield f"### [{name}]"
            yield _fields(_model_of(field))


def _tables_of_firmware() -> Iterator[str]:
    plain = {n: f for n, f in FirmwareDescription.model_fields.items() if not _is_table(f)}
    yield "### [firmware]"
    yield _rows(plain)
    for name, field in FirmwareDescription.model_fields.items():
        if _is_table(field):
            yield f"### [firmware.{name}]"
            yield _fields(_model_of(field), field.default)


def _is_table(field: FieldInfo) -> bool:
    return isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)


def _model_of(field: FieldInfo) -> type[BaseModel]:
    assert isinstance(field.annotation, type)
    assert issubclass(field.annotation, BaseModel)
    return field.annotation


def _fields(model: type[BaseModel], defaults: BaseModel | None = None) -> str:
    return _rows(model.model_fields, defaults)


def _rows(fields: dict[str, FieldInfo], defaults: BaseModel | None = None) -> str:
    rows = []
    for name, field in fields.items():
        default = getattr(defaults, name) if isinstance(defaults, BaseModel) else field.default
        shown = "required" if field.is_required() else _toml(default)
        rows.append([f"`{name}`", field.description or "", _allowed(field), shown])
    return table(["key", "meaning", "allowed", "default"], rows)


def _toml(value: object) -> str:
    if value is None:
        return "left out"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, float):
        return f"`{number(value) if value == int(value) else format(value, '.7g')}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value}`"


def _allowed(field: FieldInfo) -> str:
    choices = getattr(field.annotation, "__args__", ())
    if choices and all(isinstance(choice, str) for choice in choices):
        return ", ".join(f'`"{choice}"`' for choice in choices)
    if field.annotation is bool:
        return "`true`, `false`"
    words = (("ge", "from"), ("gt", "above"), ("le", "to"), ("lt", "below"))
    return " ".join(
        f"{word} {getattr(rule, key):g}"
        for key, word in words
        for rule in field.metadata
        if getattr(rule, key, None) is not None
    )


def scenarios() -> str:
    """Return the page of scenarios and scenario files."""
    shipped = [make() for make in NAMED.values()]
    own_effects = ", ".join(f"`{effect}`" for effect in NAMED["lesson"]().effects)
    return "\n\n".join(
        (
            "# Scenarios",
            "`--scenario` takes one of these names or a file.",
            table(
                ["name", "drive", "duration [s]"],
                [[f"`{s.name}`", s.description, number(round(s.duration_s, 2))] for s in shipped],
            ),
            "Every one but `lesson` has motor dynamics and a real counter. `lesson` switches its "
            f"own effects on: {own_effects}. Its counter rounds each tick's increment, as the "
            "lesson has it and no real one does: what it rounds off is lost, and a diagnosis takes "
            "that for listed effects (with seed 7 a wheelbase 16.7 % off, where 0.5 % is true). "
            "For a log to diagnose, give the same effects to `calibration` by `--effect`: it has "
            "a real counter (with seed 7 the gyro's bias is 0.00498 rad/s, where 0.005 is true, "
            "and the gap closes by 100 %).",
            "## Scenario files",
            _fields(ScenarioTable),
            "One table `[[segments]]` for each stretch, from rest:",
            _fields(SegmentTable),
            "Effects of the scenario stand in tables named after them, as in "
            "`[effects.gyro_bias]`. `chiplog init` writes a scenario file with comments.",
        )
    )


def _units(role: Role) -> list[str]:
    """Return one spelling of each unit that a role may have."""
    first = {unit: word for word, unit in reversed(UNITS.items())}
    return [word for unit, word in reversed(first.items()) if unit.quantity in QUANTITIES[role]]


def signal_map() -> str:
    """Return the page of map.toml."""
    rows = []
    for role in ROLES:
        raw = {"counts": "whole counts", "adc_code": "converter codes"}.get(RAW_KIND.get(role, ""))
        units = _units(role)
        shipped = ".".join(SHIPPED[role])
        needed = "yes" if role in REQUIRED else ""
        rows.append(
            [f"`{role}`", needed, "; ".join(filter(None, (raw, ", ".join(units)))), shipped]
        )
    return "\n\n".join(
        (
            "# map.toml",
            "Says which signal of a DBC plays which part; layout, scale, range and unit stay in "
            "the DBC. Needed with `--dbc` where the DBC has names of its own. How to write one: "
            "[Use my DBC](../how-to/my-dbc.md).",
            'The table `[signals]` has one line a role, `role = "MESSAGE.signal"`. The cycle time '
            "of "
            "the message with `left_count` is the tick period.",
            table(["role", "required", "may be", "in chiplog.dbc"], rows),
            "The unit is the DBC's, in upper or lower case. A signal without unit ("
            + ", ".join(f"`{unit}`" for unit in sorted(COUNT_UNITS) if unit)
            + ", or nothing) is a count or a code. Where the DBC leaves out the unit of a "
            "quantity, say "
            'it here: `gyro = { signal = "IMU.yaw_rate", unit = "deg/s" }`. A signal that '
            "counts the other way, clockwise or backwards, is turned round by `invert = true` in "
            "the same place. A wheel's speed can be read from a log; a simulated loop needs "
            "counts, an angle or a distance. A reference's angles are a receiver's fixes: "
            "`reference_x` is the longitude, `reference_y` the latitude.",
            "## Tables",
            "For a table (`.csv`, `.parquet`) the table `[columns]` has one line a role, "
            '`role = "COLUMN"`. The roles are those above, and two clocks: `time`, the log\'s, and '
            "`ecu_time`, the ECU's own, one of which must be there. How to: "
            "[Read my logs](../how-to/my-log.md). Columns with these names need no map:",
            table(
                ["column", "role", "unit"],
                [[f"`{c}`", f"`{role}`", unit] for c, (role, unit) in NAMED_COLUMNS.items()],
            ),
            "More than a name is said in a table of its own, as in "
            '`left_count = { column = "wl", unit = "deg", wrap = 360 }`:',
            _fields(ColumnTable),
        )
    )
