"""The table [firmware] of `robot.toml`: every choice a firmware engineer makes, with a default."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
)

from firmware_model.errors import FirmwareError

Rounding = Literal["floor", "half_up", "half_even", "toward_zero"]
Overflow = Literal["wrap", "saturate"]
Mode = Literal["wheel", "gyro", "blend"]
Integration = Literal["euler_before", "midpoint", "euler_after"]

_ROUNDING = "what happens to the bits that are dropped; half_up: ties toward +∞"
_OVERFLOW = "what happens beyond the word"
_CARRY = "add what rounding drops to the next value, so that nothing is lost over time"


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def _whole(meaning: str, default: int, low: int, high: int) -> Any:
    return Field(default=default, ge=low, le=high, description=meaning, examples=[default])


def _number(meaning: str, default: float, low: float, high: float) -> Any:
    return Field(default=default, ge=low, le=high, description=meaning, examples=[default])


def _bits(meaning: str, default: int, low: int, in_c: int, most: int = 128) -> Any:
    """Return a number of bits of which C has so many, and the kernel in Python more."""
    return _whole(f"{meaning}; beyond {in_c} only in Python, by --force", default, low, most)


def _constant_frac_bits(of_what: str) -> Any:
    return Field(
        default=None,
        ge=0,
        le=60,
        description=f"fraction bits of the constant {of_what}; left out: as many as 64 bits bear",
        examples=[44],
    )


class PositionFormat(_Table):
    """Table [firmware.position]: the accumulators of x and y [m]."""

    word_bits: int = _bits("width of each accumulator [bit]", 64, 8, in_c=64)
    frac_bits: int = _whole("fraction bits: one unit is 2^-frac_bits m", 32, 0, 48)
    rounding: Rounding = Field(default="floor", description=_ROUNDING)
    overflow: Overflow = Field(default="wrap", description=_OVERFLOW)
    carry_remainder: bool = Field(default=True, description=_CARRY)


class StepFormat(_Table):
    """Table [firmware.step]: the distance of one tick [m]."""

    word_bits: int = _bits("width of the step [bit]", 32, 8, in_c=32)
    frac_bits: int = _whole("fraction bits: one unit is 2^-frac_bits m", 28, 0, 40)
    constant_frac_bits: int | None = _constant_frac_bits("half a tick's distance [m]")
    rounding: Rounding = Field(default="floor", description=_ROUNDING)
    overflow: Overflow = Field(default="saturate", description=_OVERFLOW)
    carry_remainder: bool = Field(default=True, description=_CARRY)


class HeadingFormat(_Table):
    """Table [firmware.heading]: the heading as a binary angle; it wraps at one turn, always."""

    frac_bits: int = _whole("fraction bits: one unit is 2^-frac_bits turn", 32, 4, 32)
    rounding: Rounding = Field(default="floor", description=_ROUNDING)
    carry_remainder: bool = Field(default=True, description=_CARRY)


class TurnStepFormat(_Table):
    """Table [firmware.turn_step]: the rotation of one tick [turn]."""

    word_bits: int = _bits("width of the step [bit]", 64, 8, in_c=64)
    frac_bits: int = _whole("fraction bits: one unit is 2^-frac_bits turn", 48, 4, 52)
    constant_frac_bits: int | None = _constant_frac_bits("one tick's rotation [turn]")
    rounding: Rounding = Field(default="half_up", description=_ROUNDING)
    overflow: Overflow = Field(default="wrap", description=_OVERFLOW)
    carry_remainder: bool = Field(default=True, description=_CARRY)


class Trig(_Table):
    """Table [firmware.trig]: how sine and cosine of the heading are found."""

    method: Literal["table", "cordic"] = Field(
        default="table", description="a quarter-wave table, or shift-and-add rotations"
    )
    entries: int = _whole("table: steps per quarter wave, a power of two", 1024, 1, 65536)
    interpolated: bool = Field(
        default=True, description="table: straight line between entries; false: the nearest entry"
    )
    iterations: int = _whole("cordic: number of rotations", 30, 1, 34)
    frac_bits: int = _bits("fraction bits of sine and cosine", 30, 2, in_c=30, most=48)
    rounding: Rounding = Field(default="half_up", description=_ROUNDING)

    @field_validator("entries")
    @classmethod
    def _power_of_two(cls, entries: int) -> int:
        if entries & (entries - 1):
            below = 1 << (entries.bit_length() - 1)
            raise ValueError(f"expected a power of two, for example {below} or {2 * below}")
        return entries


class GyroFormat(_Table):
    """Table [firmware.gyro]: the gyro's constants in the firmware."""

    offset_frac_bits: int = _whole("fraction bits of the zero-rate offset [LSB]", 16, 0, 16)
    sensitivity_frac_bits: int | None = _constant_frac_bits("rotation per LSB and tick [turn]")
    rounding: Rounding = Field(default="half_up", description=_ROUNDING + " (of the offset)")
    auto_zero_rad_s: float = _number("slower turns are taken for rest [rad/s]", 0.0, 0.0, 100.0)


class Standstill(_Table):
    """Table [firmware.standstill]: when the robot counts as standing, and what is learnt then."""

    ticks: int = _whole("the wheels rest this long before it is a standstill [ticks]", 20, 1, 65535)
    tolerance_ticks: int = _whole(
        "wheel movement that still counts as rest: jitter about an edge [encoder ticks]", 1, 0, 100
    )
    max_rate_rad_s: float = _number(
        "a gyro that reads more than this from its nominal zero says the robot moves [rad/s]",
        0.2,
        0.0,
        100.0,
    )
    settle_ticks: int = _whole(
        "gyro samples left out after the standstill begins and before it ends [ticks]", 20, 0, 65535
    )
    block_log2: int = _whole("the first estimate averages 2^block_log2 samples", 7, 0, 16)
    max_log2: int = _whole("a long standstill averages up to 2^max_log2 samples", 14, 0, 16)


class Plausibility(_Table):
    """Table [firmware.plausibility]: which encoder samples are believed."""

    rate_margin: float = _number("fastest believed wheel over the described one", 1.25, 1.0, 100.0)
    extra_ticks: int = _whole("believed beyond that in one tick [encoder ticks]", 2, 0, 1000)
    jump_confirm_samples: int = _whole(
        "refused samples that agree with each other before they are a new baseline", 5, 1, 1000
    )


class Stuck(_Table):
    """Table [firmware.stuck]: when a gyro that repeats its code is taken for dead."""

    ticks: int = _whole("the code has repeated this long [ticks]", 100, 2, 1_000_000)
    block_log2: int = _whole("the wheels' turning is compared in blocks of 2^block_log2", 5, 0, 12)
    span_ticks: int = _whole(
        "right minus left count of a block has varied by more than this, "
        "and by more than two LSB of the gyro [encoder ticks]",
        16,
        1,
        65535,
    )


class Velocity(_Table):
    """Table [firmware.velocity]: the velocity outputs; 32 bits, rounded to nearest, saturating."""

    frac_bits: int = _whole("fraction bits: one unit is 2^-frac_bits m/s and rad/s", 20, 0, 24)
    filter_log2: int = _whole("low-pass over about 2^filter_log2 ticks; 0: none", 3, 0, 8)


class FirmwareDescription(_Table):
    """Table [firmware] of `robot.toml`; everything may be left out.

    Raises:
        pydantic.ValidationError: a value of the wrong type or out of its range
            (`from_table` says the first of them in one line).
    """

    mode: Mode = Field(
        default="gyro",
        description="heading from the wheels, from the gyro, or from both in proportion",
    )
    blend_weight: float = _number("mode blend: the gyro's weight in each turn", 0.9, 0.0, 1.0)
    integration: Integration = Field(
        default="euler_before",
        description="which heading of a tick the step is taken along: before, middle, after",
    )
    stale_heading_ticks: int = _whole(
        "the position uses the heading of so many ticks ago; 0: as integration says", 0, 0, 4
    )
    position: PositionFormat = PositionFormat()
    step: StepFormat = StepFormat()
    heading: HeadingFormat = HeadingFormat()
    turn_step: TurnStepFormat = TurnStepFormat()
    trig: Trig = Trig()
    gyro: GyroFormat = GyroFormat()
    standstill: Standstill = Standstill()
    plausibility: Plausibility = Plausibility()
    stuck: Stuck = Stuck()
    velocity: Velocity = Velocity()

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """Return the description read from a plain table, as a TOML parser gives it.

        Raises:
            FirmwareError: one line naming the field, its value and what would be right.
        """
        try:
            return cls.model_validate(dict(table))
        except ValidationError as error:
            raise FirmwareError(_first_line(error)) from error


def _first_line(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    name = ".".join(("firmware", *(str(part) for part in first["loc"])))
    if first["type"] == "extra_forbidden":
        known = ", ".join(_keys_beside(first["loc"]))
        return f"{name}: unknown key: expected one of {known}"
    message = str(first["msg"]).removeprefix("Value error, ").removeprefix("Input should be ")
    expected = message if message.startswith("expected ") else f"expected {_lower(message)}"
    return f"{name} = {first['input']!r}: {expected}"


def _keys_beside(location: tuple[int | str, ...]) -> list[str]:
    table: type[BaseModel] = FirmwareDescription
    for part in location[:-1]:
        annotation = table.model_fields[str(part)].annotation
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            table = annotation
    return list(table.model_fields)


def _lower(text: str) -> str:
    return text[:1].lower() + text[1:]
