"""The configurations of a study: a base description and the values that each axis takes."""

from __future__ import annotations

import itertools
import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from typing import Any, Final

from firmware_model import FirmwareDescription, FirmwareError, KernelConfig, build_config
from firmware_model.c99_layout import table_bytes as bytes_of_table
from firmware_model.c99_layout import table_entry_bytes
from hil_harness.robot import Robot
from precision_study.errors import StudyError
from precision_study.ranges import Envelope
from precision_study.ranges.reach import require_mission_fits
from sim_plant import PlantDescription, PlantError

TICK_RATE: Final = "tick_rate_hz"
ADC_BITS: Final = "adc.bits"
TOGETHER: Final[dict[str, tuple[str, ...]]] = {
    "rounding": ("position", "step", "heading", "turn_step", "trig", "gyro"),
    "overflow": ("position", "step", "turn_step"),
    "carry_remainder": ("position", "step", "heading", "turn_step"),
}
"""Axes that set one field in several tables of [firmware]."""

DEFAULT_AXES: Final[dict[str, tuple[Any, ...]]] = {
    "position.frac_bits": (12, 16, 20, 24),
    "heading.frac_bits": (16, 20, 24, 32),
    "rounding": ("floor", "half_up"),
    "trig.entries": (64, 256, 1024),
    "trig.interpolated": (True, False),
    "carry_remainder": (True, False),
}
MAX_POINTS: Final = 100_000
MAX_TABLE_BYTES: Final = 65_536
"""Largest sine table that is taken unless the user says what his flash holds."""


@dataclass(frozen=True)
class Point:
    """One configuration of a study.

    Attributes:
        values: (axis, value) in the order of the axes.
        firmware: the table [firmware].
        plant: the robot, with its ADC and what its codes mean.
        tick_period_us: of the firmware's tick.
    """

    values: tuple[tuple[str, Any], ...]
    firmware: FirmwareDescription
    plant: PlantDescription
    tick_period_us: int

    @cached_property
    def key(self) -> str:
        """A name that two points share only when their firmware, robot and tick are the same."""
        whole = {
            "firmware": self.firmware.model_dump(),
            "plant": self.plant.model_dump(),
            "tick_period_us": self.tick_period_us,
        }
        return sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def words(self) -> str:
        """Return the values of the axes as a person reads them."""
        return ", ".join(f"{axis} = {_said(value)}" for axis, value in self.values)


def parse_axis(text: str) -> tuple[str, tuple[Any, ...]]:
    """Return axis and values of ``position.frac_bits=12,16`` or ``trig.entries=64..1024``.

    ``a..b`` doubles from a to b for trig.entries and counts by one for anything else.

    Raises:
        StudyError: another form, an unknown axis, or a value twice.
    """
    name, equals, listed = text.partition("=")
    name = name.strip().removeprefix("firmware.")
    words = [word.strip() for word in listed.split(",")]
    if not equals or not all(words):
        raise StudyError(
            f"--sweep {text!r}: expected FIELD=VALUE,VALUE,… as in position.frac_bits=12,16,20"
        )
    if name not in known_axes():
        raise StudyError(f"--sweep {text!r}: no axis {name!r}: expected one of {_axes_said()}")
    values = [value for word in words for value in _values(name, word)]
    if len(set(map(repr, values))) != len(values):
        raise StudyError(f"--sweep {text!r}: a value stands twice: expected each once")
    return name, tuple(values)


def known_axes() -> tuple[str, ...]:
    """Return the name of everything that can be swept."""
    fields: list[str] = []
    for name, field in FirmwareDescription.model_fields.items():
        inner = getattr(field.annotation, "model_fields", None)
        fields += [name] if inner is None else [f"{name}.{one}" for one in inner]
    return (TICK_RATE, ADC_BITS, *TOGETHER, *fields)


def _axes_said() -> str:
    return f"{TICK_RATE}, {ADC_BITS}, {', '.join(TOGETHER)}, or a field of [firmware]"


def _values(name: str, word: str) -> list[Any]:
    first, dots, last = word.partition("..")
    if dots and first.isdigit() and last.isdigit():
        if name == "trig.entries":
            low, high = int(first).bit_length() - 1, int(last).bit_length()
            return [1 << n for n in range(low, high) if int(first) <= 1 << n <= int(last)]
        return list(range(int(first), min(int(last), int(first) + MAX_POINTS) + 1))
    try:
        return [tomllib.loads(f"x = {word}")["x"]]
    except tomllib.TOMLDecodeError:
        return [word]


def build_points(
    robot: Robot, axes: Mapping[str, Sequence[Any]], tick_period_us: int
) -> list[Point]:
    """Return every combination of the values, in the order of the axes.

    Raises:
        StudyError: a value that its field does not take, no values, or too many combinations.
    """
    count = math.prod(len(values) for values in axes.values())
    if not 1 <= count <= MAX_POINTS:
        raise StudyError(f"--sweep: {count} configurations: expected 1 to {MAX_POINTS}")
    return [
        _point(robot, tuple(zip(axes, values, strict=True)), tick_period_us)
        for values in itertools.product(*axes.values())
    ]


def _point(robot: Robot, values: tuple[tuple[str, Any], ...], period_us: int) -> Point:
    firmware: dict[str, Any] = {}
    plant = robot.plant
    for axis, value in values:
        if axis == TICK_RATE:
            period_us = _period_us(value)
        elif axis == ADC_BITS:
            plant = with_adc_bits(plant, value)
        elif axis in TOGETHER:
            for table in TOGETHER[axis]:
                firmware.setdefault(table, {})[axis] = value
        else:
            table, _, field = axis.rpartition(".")
            (firmware.setdefault(table, {}) if table else firmware)[field] = value
    whole = robot.firmware.model_dump()
    for name, given in firmware.items():
        whole[name] = whole[name] | given if isinstance(given, dict) else given
    try:
        return Point(values, FirmwareDescription.from_table(whole), plant, period_us)
    except FirmwareError as error:
        raise StudyError(str(error)) from None


def _period_us(rate_hz: Any) -> int:
    is_number = isinstance(rate_hz, int | float) and not isinstance(rate_hz, bool)
    period_us = round(1e6 / rate_hz) if is_number and 1 <= rate_hz <= 1e4 else 0
    if period_us == 0 or abs(period_us * rate_hz - 1e6) > 1e-6:
        raise StudyError(
            f"{TICK_RATE} = {rate_hz!r}: expected 1 to 10000 whose period is a whole number of µs"
        )
    return period_us


def with_adc_bits(plant: PlantDescription, bits: Any) -> PlantDescription:
    """Return the robot with another converter: codes at rest and per unit scale with its range.

    A code at rest that is no longer whole is rounded.

    Raises:
        StudyError: bits, or a code that comes of them, that the description does not take.
    """
    limits = type(plant.adc).model_json_schema()["properties"]["bits"]
    low, high = limits["minimum"], limits["maximum"]
    if type(bits) is not int or not low <= bits <= high:
        raise StudyError(f"{ADC_BITS} = {bits!r}: expected a whole number from {low} to {high}")
    tables: dict[str, dict[str, Any]] = plant.model_dump()
    change = bits - plant.adc.bits
    for table in tables.values():
        for name, value in table.items():
            if name.startswith("sensitivity_lsb_per_"):
                table[name] = math.ldexp(value, change)
            elif name in ("zero_rate_code", "zero_code", "code_at_298_k"):
                table[name] = round(math.ldexp(value, change))
    tables["adc"]["bits"] = bits
    try:
        return PlantDescription.from_tables(tables)
    except PlantError as error:
        raise StudyError(str(error)) from None


def build(point: Point, robot: Robot, *, force: bool = False) -> KernelConfig:
    """Return the kernel's integers of a point. Raises FirmwareError for formats that do not fit."""
    known = replace(robot, plant=point.plant).firmware_constants(point.tick_period_us)
    return build_config(point.firmware, known, allow_overflow=force)


def refuse_unfit(
    points: Sequence[Point],
    robot: Robot,
    *,
    distance_m: float,
    mission_s: float,
    table_bytes: int = MAX_TABLE_BYTES,
    force: bool = False,
) -> frozenset[str]:
    """Refuse a study of which a configuration overflows, has no room or rounds a scale to zero.

    And one that C cannot hold. Return the keys of those that only *force* runs.

    Args:
        points: the configurations.
        robot: whose they are.
        distance_m: longest way of a drive.
        mission_s: longest time that it takes.
        table_bytes: largest table that fits.
        force: let them pass.

    Raises:
        StudyError: field, value and what would be right, for the first such configuration; with
            *force* for formats that do not belong together.
    """
    forced = set()
    for point in points:
        wrong = _unfit(point, robot, distance_m, mission_s, table_bytes)
        if wrong is not None and force:
            forced.add(point.key)
            wrong = _unbuilt(point, robot)
        if wrong is not None:
            where = f" (with {point.words})" if point.values else ""
            raise StudyError(f"{wrong}{where}")
    return frozenset(forced)


def _unbuilt(point: Point, robot: Robot) -> str | None:
    """Return why not even force runs a configuration."""
    try:
        build(point, robot, force=True)
    except FirmwareError as error:
        return str(error)
    return None


def _unfit(
    point: Point,
    robot: Robot,
    distance_m: float,
    mission_s: float,
    table_bytes: int,
) -> str | None:
    try:
        config = build(point, robot)
    except FirmwareError as error:
        return str(error)
    size = bytes_of_table(config)
    if size > table_bytes:
        trig = point.firmware.trig
        field = "iterations" if trig.method == "cordic" else "entries"
        value = getattr(trig, field)
        return (
            f"firmware.trig.{field} = {value}: a table of {size} bytes does not fit "
            f"--table-bytes {table_bytes}: expected at most {_fitting(trig.method, table_bytes)}"
        )
    try:
        envelope = Envelope.of(
            config,
            mission_s=mission_s,
            distance_m=distance_m,
            noise_ticks=point.plant.encoder.noise_ticks,
        )
        require_mission_fits(config, envelope, f"{distance_m:g} m")
    except FirmwareError as error:
        return str(error)
    return None


def _fitting(method: str, table_bytes: int) -> int:
    """Return the most rotations, or steps of a quarter turn (a power of two), that have room."""
    if method == "cordic":
        return max(table_bytes // table_entry_bytes("cordic_table") - 1, 1)
    steps = table_bytes // table_entry_bytes("sine_table") - 1
    return 1 << max(steps.bit_length() - 1, 0)


def _said(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
