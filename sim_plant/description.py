"""The physical robot as its owner describes it: the plant's tables of `robot.toml`.

Every default is the lesson's robot as its odometry describes it: r̂ = 1.005 · 0.05 m and
b̂ = 0.995 · 0.30 m. How the *real* robot differs from this page is `sim_plant.mechanisms`.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from typing import Annotated, Any, Final, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from sim_plant.errors import PlantError

STANDARD_GRAVITY_M_S2 = 9.80665
_WIDEST_COUNTER_BITS: Final = 32
_MOST_TICKS: Final = 10_000_000
"""A motor's encoder of 17 bits behind a gear of 76; the firmware takes up to 2^24."""


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def _number(
    meaning: str,
    example: float,
    *,
    ge: float | None = None,
    gt: float | None = None,
    le: float | None = None,
) -> Any:
    return Field(default=example, ge=ge, gt=gt, le=le, description=meaning, examples=[example])


_Sensitivity = Annotated[float, Field(gt=0, le=1e7)]
_Code = Annotated[int, Field(ge=0, le=65535)]


class Wheels(_Table):
    """Table [wheels]: the rolling geometry."""

    radius_m: float = _number(
        "mean rolling radius of the drive wheels [m]", 0.05025, ge=1e-3, le=10
    )
    wheelbase_m: float = _number(
        "distance between the wheels' contact points [m]", 0.2985, ge=1e-2, le=10
    )


class Encoder(_Table):
    """Table [encoder]: one counter on each wheel."""

    ticks_per_rev: int = _number(
        "counts per wheel turn, all edges counted", 2048, ge=1, le=_MOST_TICKS
    )
    counter_bits: int = _number(
        "width of the wrapping counter [bit]", 16, ge=8, le=_WIDEST_COUNTER_BITS
    )
    noise_ticks: float = _number(
        "white noise of one reading about the true count, standard deviation [ticks]",
        0.2,
        ge=0,
        le=1000,
    )


class Drive(_Table):
    """Table [drive]: from commanded wheel rate to wheel rate."""

    delay_s: float = _number("pure delay of a command [s]", 0.0, ge=0, le=1)
    time_constant_s: float = _number("first-order lag of the wheel rate [s]", 0.05, ge=0, le=10)
    max_wheel_rate_rad_s: float = _number("largest wheel rate reached [rad/s]", 30.0, gt=0, le=1e4)
    max_wheel_acceleration_rad_s2: float = _number(
        "largest wheel acceleration [rad/s²]", 60.0, gt=0, le=1e6
    )


class Contact(_Table):
    """Table [contact]: wheel on floor."""

    noise_m_per_sqrt_m: float = _number(
        "micro-slip of each wheel, a random walk over distance [m/√m]", 0.0, ge=0, le=1
    )


class Gyro(_Table):
    """Table [gyro]: yaw rate to ADC code."""

    sensitivity_lsb_per_rad_s: _Sensitivity = Field(
        default=131 * 180 / math.pi,
        description="codes per rad/s; 7505.747 is 131 LSB per °/s",
        examples=[7505.747],
    )
    zero_rate_code: _Code = Field(default=32768, description="code at rest [LSB]", examples=[32768])
    range_rad_s: float = _number(
        "the sensor clips the rate here [rad/s]; 4.363323 is 250 °/s", 4.363323, gt=0, le=1000
    )
    noise_density_rad_per_sqrt_s: float = _number(
        "angle random walk [rad/√s]; one sample has standard deviation density·√(sample rate)",
        0.0002,
        ge=0,
        le=10,
    )
    bias_walk_density_rad_s_per_sqrt_s: float = _number(
        "random walk of the bias [rad/s/√s]", 0.0, ge=0, le=1
    )


class Accelerometer(_Table):
    """Table [accelerometer]: body x and y specific force to ADC code."""

    sensitivity_lsb_per_m_s2: _Sensitivity = Field(
        default=16384 / STANDARD_GRAVITY_M_S2,
        description="codes per m/s²; 1670.703 is 16384 LSB per g",
        examples=[1670.703],
    )
    zero_code: _Code = Field(default=32768, description="code at 0 m/s² [LSB]", examples=[32768])
    range_m_s2: float = _number(
        "the sensor clips here [m/s²]; 19.6133 is 2 g", 19.6133, gt=0, le=1e4
    )
    noise_density_m_s2_per_sqrt_hz: float = _number(
        "white noise [m/s²/√Hz]; one sample has standard deviation density·√(sample rate)",
        0.004,
        ge=0,
        le=100,
    )


class Adc(_Table):
    """Table [adc]: the converter all analogue sensors share; it rounds to the nearest code."""

    bits: int = _number("codes run from 0 to 2^bits − 1", 16, ge=8, le=16)

    @property
    def max_code(self) -> int:
        """The upper rail [LSB]."""
        return (1 << self.bits) - 1


class Temperature(_Table):
    """Table [temperature]: the thermometer beside the gyro."""

    sensitivity_lsb_per_k: _Sensitivity = Field(
        default=340.0, description="codes per kelvin", examples=[340.0]
    )
    code_at_298_k: _Code = Field(
        default=32768, description="code at 298.15 K [LSB]", examples=[32768]
    )
    ambient_k: float = _number("temperature at the start [K]", 298.15, ge=200, le=500)
    noise_k: float = _number("white noise of one reading [K]", 0.0, ge=0, le=100)


class Supply(_Table):
    """Table [supply]: the voltmeter on the battery."""

    sensitivity_lsb_per_v: _Sensitivity = Field(
        default=4096.0, description="codes per volt; code 0 is 0 V", examples=[4096.0]
    )
    nominal_v: float = _number("described supply voltage [V]", 12.0, ge=0.1, le=1000)
    noise_v: float = _number("white noise of one reading [V]", 0.0, ge=0, le=100)


class PlantDescription(_Table):
    """The described robot; each attribute is one table of `robot.toml`, each may be left out.

    Raises:
        pydantic.ValidationError: a value of the wrong type or out of its range
            (`from_tables` says the first of them in one line).
    """

    wheels: Wheels = Wheels()
    encoder: Encoder = Encoder()
    drive: Drive = Drive()
    contact: Contact = Contact()
    gyro: Gyro = Gyro()
    accelerometer: Accelerometer = Accelerometer()
    adc: Adc = Adc()
    temperature: Temperature = Temperature()
    supply: Supply = Supply()

    @model_validator(mode="after")
    def _zero_codes_fit_the_adc(self) -> Self:
        for name, code in (
            ("gyro.zero_rate_code", self.gyro.zero_rate_code),
            ("accelerometer.zero_code", self.accelerometer.zero_code),
            ("temperature.code_at_298_k", self.temperature.code_at_298_k),
        ):
            if code > self.adc.max_code:
                raise ValueError(
                    f"{name} = {code}: expected at most {self.adc.max_code}, "
                    f"the largest code of adc.bits = {self.adc.bits}"
                )
        return self

    @classmethod
    def from_tables(cls, tables: Mapping[str, Any]) -> Self:
        """Return the description read from plain tables, as a TOML parser gives them.

        Raises:
            PlantError: one line naming the field, its value and what would be right.
        """
        try:
            return cls.model_validate(dict(tables))
        except ValidationError as error:
            raise PlantError(_first_line(error)) from error

    @property
    def gyro_code_limits(self) -> tuple[int, int]:
        """The lowest and highest code the described gyro can give [LSB]: range and ADC rails."""
        swing_lsb = self.gyro.range_rad_s * self.gyro.sensitivity_lsb_per_rad_s
        low = math.floor(self.gyro.zero_rate_code - swing_lsb + 0.5)
        high = math.floor(self.gyro.zero_rate_code + swing_lsb + 0.5)
        return max(low, 0), min(high, self.adc.max_code)


def _first_line(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    if not first["loc"]:
        return str(first["msg"]).removeprefix("Value error, ")
    table, *rest = (str(part) for part in first["loc"])
    name = ".".join((table, *rest))
    value = reprlib.repr(first["input"])
    if table not in PlantDescription.model_fields:
        return (
            f"{table!r}: no such table; expected one of {', '.join(PlantDescription.model_fields)}"
        )
    schema = PlantDescription.model_json_schema()["$defs"][table.capitalize()]["properties"]
    if not rest:
        return f"{name} = {value}: expected a table with {', '.join(schema)}"
    if rest[0] not in schema:
        return f"{rest[0]!r} in table {table}: no such field; expected one of {', '.join(schema)}"
    return f"{name} = {value}: expected {_expected(schema[rest[0]])}"


def _expected(field: dict[str, Any]) -> str:
    kind = "a whole number" if field["type"] == "integer" else "a number"
    low = f"above {field['exclusiveMinimum']:g}" if "exclusiveMinimum" in field else None
    bounds = f"{low} up to" if low else f"from {field['minimum']:g} to"
    return f"{kind} {bounds} {field['maximum']:g}, for example {field['examples'][0]:g}"
