"""What a signal can be to a robot, and which units it can be in."""

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal, TypeAlias, get_args

Role: TypeAlias = Literal[
    "left_count",
    "right_count",
    "gyro",
    "accel_x",
    "accel_y",
    "temperature",
    "supply",
    "v_command",
    "w_command",
    "odom_x",
    "odom_y",
    "odom_heading",
    "reference_x",
    "reference_y",
    "reference_heading",
]
"""What a signal is to the robot: sensors, commands, odometry, and a reference trajectory."""

ROLES: Final[tuple[Role, ...]] = get_args(Role)

Kind: TypeAlias = Literal["counts", "adc_code", "physical"]
"""How a signal says it: wheel counts, converter codes, or a quantity in a unit."""

KINDS: Final[tuple[Kind, ...]] = get_args(Kind)

Quantity: TypeAlias = Literal[
    "length", "angle", "speed", "turn rate", "acceleration", "temperature", "voltage", "time"
]


@dataclass(frozen=True)
class Unit:
    """A unit: a value in it times ``factor`` plus ``offset`` is the value in SI."""

    quantity: Quantity
    factor: float
    offset: float = 0.0


_TURN_RAD: Final = 2 * math.pi
_DEGREE_RAD: Final = math.pi / 180
_GRAVITY_M_S2: Final = 9.80665
_MILE_M: Final = 1609.344

_SPELLINGS: Final[dict[str, Unit]] = {
    "m": Unit("length", 1.0),
    "cm": Unit("length", 0.01),
    "mm": Unit("length", 0.001),
    "rad": Unit("angle", 1.0),
    "mrad": Unit("angle", 0.001),
    "deg degree degrees °": Unit("angle", _DEGREE_RAD),
    "turn turns rev": Unit("angle", _TURN_RAD),
    "m/s m/sec mps meter/s meters/s metre/s metres/s": Unit("speed", 1.0),
    "cm/s": Unit("speed", 0.01),
    "mm/s": Unit("speed", 0.001),
    "km/h km/hr km/hour km^h kmh kmph kph": Unit("speed", 1 / 3.6),
    "mph mi/h mile/h miles/h": Unit("speed", _MILE_M / 3600),
    "rad/s rad/sec radian/s radians/s radian/sec radians/sec radian/second radians/second": Unit(
        "turn rate", 1.0
    ),
    "mrad/s": Unit("turn rate", 0.001),
    "deg/s deg/sec degree/s degrees/s degree/sec degrees/sec degree/second degrees/second "
    "°/s °/sec dps": Unit("turn rate", _DEGREE_RAD),
    "turn/s rev/s": Unit("turn rate", _TURN_RAD),
    "rpm 1/min": Unit("turn rate", _TURN_RAD / 60),
    "m/s^2 m/s² m/s2 m/ss m/s/s m/sec^2 m/sec² m/sec2": Unit("acceleration", 1.0),
    "g": Unit("acceleration", _GRAVITY_M_S2),
    "mg": Unit("acceleration", _GRAVITY_M_S2 / 1000),
    "K kelvin": Unit("temperature", 1.0),
    "degC °C C": Unit("temperature", 1.0, 273.15),
    "V": Unit("voltage", 1.0),
    "mV": Unit("voltage", 0.001),
    "s": Unit("time", 1.0),
    "ms": Unit("time", 1e-3),
    "us µs": Unit("time", 1e-6),
    "ns": Unit("time", 1e-9),
}

UNITS: Final = MappingProxyType(
    {word: unit for spellings, unit in _SPELLINGS.items() for word in spellings.split()}
)
"""Every unit that is understood, by its spellings; upper and lower case are the same."""

_BY_LOWER_CASE: Final = {word.lower(): unit for word, unit in UNITS.items()}

COUNT_UNITS: Final = frozenset(
    {"", "1", "-", "lsb", "tick", "ticks", "count", "counts", "pulse", "pulses", "inc", "raw"}
)
"""Spellings of "no unit": the raw value itself is a count or a code."""

_WHEEL: Final[tuple[Quantity, ...]] = ("angle", "length", "turn rate", "speed")

QUANTITIES: Final[dict[Role, tuple[Quantity, ...]]] = {
    "left_count": _WHEEL,
    "right_count": _WHEEL,
    "gyro": ("turn rate",),
    "accel_x": ("acceleration",),
    "accel_y": ("acceleration",),
    "temperature": ("temperature",),
    "supply": ("voltage",),
    "v_command": ("speed",),
    "w_command": ("turn rate",),
    "odom_x": ("length",),
    "odom_y": ("length",),
    "odom_heading": ("angle",),
    "reference_x": ("length", "angle"),
    "reference_y": ("length", "angle"),
    "reference_heading": ("angle",),
}
"""What a physical signal of each role can measure; a reference's angles are a longitude (x) and a
latitude (y)."""

RAW_KIND: Final[dict[Role, Kind]] = {
    "left_count": "counts",
    "right_count": "counts",
    "gyro": "adc_code",
    "accel_x": "adc_code",
    "accel_y": "adc_code",
    "temperature": "adc_code",
    "supply": "adc_code",
}
"""The kind that a signal without unit has, for the roles that can be raw."""


def unit_of(text: str) -> Unit | None:
    """Return the unit that *text* spells, blanks or none in it; None for one that is not known."""
    return _BY_LOWER_CASE.get("".join(text.lower().split()))


def units_for(role: Role) -> str:
    """Return in words which units a signal of *role* can have: ``no unit (counts), rad or m``."""
    fitting = [
        spellings.split()[0]
        for spellings, unit in _SPELLINGS.items()
        if unit.quantity in QUANTITIES[role]
    ]
    raw = [f"none ({RAW_KIND[role]})"] if role in RAW_KIND else []
    return ", ".join(raw + fitting)
