"""One signal of a message: where its bits lie and what they mean."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from can_bus.errors import CanBusError

ByteOrder = Literal["little_endian", "big_endian"]

Raw = int | float
"""A raw value: an integer, or a float where the signal is one on the wire."""

_FLOAT_FORMATS = {16: "<e", 32: "<f", 64: "<d"}

# A quotient (limit - offset) / factor this close to a whole number, relative to its size, is that
# number: decimal factors are not exact in binary. 2^-50 is four roundings of a double.
_QUOTIENT_TOLERANCE = 2.0**-50
_QUOTIENT_TOLERANCE_SMALL = 1e-6


@dataclass(frozen=True, slots=True)
class SignalSpec:
    """A signal as the database describes it; nothing here is repeated anywhere else.

    *Raw* is the number in the frame, *scaled* = raw · `factor` + `offset` in `unit`.

    Attributes:
        message: name of the message it belongs to, for error texts.
        start_bit: as in the DBC: least significant bit (little endian) or most significant bit
            (big endian), bit 0 being the least significant bit of byte 0.
        minimum, maximum: allowed scaled range, inclusive; None where the database gives none.
        initial_raw: `GenSigStartValue`, sent where a sender gives nothing else.
        invalid_raw: the raw value whose value-table entry is `SNA` (signal not available).
        choices: raw value to name, the value table.
        multiplexer: name of the signal that selects this one, None if always present.
        multiplexer_values: values of it under which this signal is present.
    """

    message: str
    name: str
    start_bit: int
    length_bits: int
    byte_order: ByteOrder = "little_endian"
    is_signed: bool = False
    is_float: bool = False
    factor: float = 1.0
    offset: float = 0.0
    minimum: float | None = None
    maximum: float | None = None
    unit: str = ""
    comment: str = ""
    initial_raw: Raw = 0
    invalid_raw: int | None = None
    choices: Mapping[int, str] = field(default_factory=dict)
    receivers: tuple[str, ...] = ()
    multiplexer: str | None = None
    multiplexer_values: frozenset[int] = frozenset()

    low_code: int = field(init=False, default=0)
    """Smallest raw integer that the bits can hold."""
    high_code: int = field(init=False, default=0)
    """Largest raw integer that the bits can hold."""
    low_raw: int = field(init=False, default=0)
    """Smallest raw integer inside the described range."""
    high_raw: int = field(init=False, default=0)
    """Largest raw integer inside the described range."""

    def __post_init__(self) -> None:
        """Derive the raw limits. Raises CanBusError for a signal that no frame can carry."""
        if self.is_float and self.length_bits not in _FLOAT_FORMATS:
            raise CanBusError(
                f"{self.path}: a float of {self.length_bits} bits does not exist: 16, 32 or 64"
            )
        if self.factor == 0 or not math.isfinite(self.factor) or not math.isfinite(self.offset):
            raise CanBusError(
                f"{self.path}: factor {self.factor} and offset {self.offset}: "
                "both must be finite and the factor not 0"
            )
        low = -(1 << (self.length_bits - 1)) if self.is_signed else 0
        high = (1 << (self.length_bits - int(self.is_signed))) - 1
        limits = [
            self._quotient(limit) for limit in (self.minimum, self.maximum) if limit is not None
        ]
        derive = object.__setattr__
        derive(self, "low_code", low)
        derive(self, "high_code", high)
        derive(self, "low_raw", low)
        derive(self, "high_raw", high)
        if self.minimum is not None and self.maximum is not None:
            derive(self, "low_raw", max(low, _ceil(min(limits))))
            derive(self, "high_raw", min(high, _floor(max(limits))))

    @property
    def path(self) -> str:
        """Return `MESSAGE.signal`, as error texts name it."""
        return f"{self.message}.{self.name}"

    def to_scaled(self, raw: Raw) -> float:
        """Return the scaled value of a raw one, in `unit`."""
        return raw * self.factor + self.offset

    def to_raw(self, scaled: float) -> Raw:
        """Return the nearest raw value (ties to even); a float signal keeps its float.

        Raises CanBusError outside the described range: a value is never clipped.
        """
        if not math.isfinite(scaled):
            raise self._out_of_range(scaled)
        quotient = self._quotient(scaled)
        raw = quotient if self.is_float else round(quotient)
        if not self.in_range(raw):
            raise self._out_of_range(scaled)
        return raw

    def in_range(self, raw: Raw) -> bool:
        """Tell whether a raw value lies inside the described range; NaN and infinity never do."""
        if not self.is_float:
            return self.low_raw <= raw <= self.high_raw
        if not math.isfinite(raw):
            return False
        scaled = self.to_scaled(raw)
        return (self.minimum is None or self.minimum <= scaled) and (
            self.maximum is None or scaled <= self.maximum
        )

    def raw_of_choice(self, name: str) -> int:
        """Return the raw value that the value table calls `name`.

        Raises CanBusError with the names there are.
        """
        for raw, known in self.choices.items():
            if known == name:
                return raw
        known_names = ", ".join(self.choices.values()) or "none: it has no value table"
        raise CanBusError(f"{self.path} = {name!r}: its named values are {known_names}")

    def to_bits(self, raw: Raw) -> int:
        """Return the bit field of a raw value. Raises CanBusError when the bits cannot hold it."""
        if self.is_float:
            try:
                packed = struct.pack(_FLOAT_FORMATS[self.length_bits], raw)
            except (OverflowError, struct.error) as error:
                raise CanBusError(
                    f"{self.path} = {raw!r}: not a float of {self.length_bits} bits"
                ) from error
            return int.from_bytes(packed, "little")
        if not isinstance(raw, int):
            raise CanBusError(f"{self.path} = {raw!r}: expected a raw whole number")
        if not self.low_code <= raw <= self.high_code:
            raise CanBusError(
                f"{self.path} = {raw}: its {self.length_bits} bits hold raw values "
                f"from {self.low_code} to {self.high_code}"
            )
        return raw & ((1 << self.length_bits) - 1)

    def from_bits(self, bits: int) -> Raw:
        """Return the raw value of a bit field."""
        if self.is_float:
            packed = bits.to_bytes(self.length_bits // 8, "little")
            value: float = struct.unpack(_FLOAT_FORMATS[self.length_bits], packed)[0]
            return value
        sign = self.sign_bit
        return (bits ^ sign) - sign

    @property
    def sign_bit(self) -> int:
        """Return the weight of the sign bit, 0 for an unsigned signal."""
        return 1 << (self.length_bits - 1) if self.is_signed else 0

    def shift_in(self, length_bytes: int) -> int:
        """Return the position of the least significant bit in the frame read as one integer.

        The frame is read little endian for a little-endian signal and big endian for the other.
        """
        if self.byte_order == "little_endian":
            return self.start_bit
        from_first = 8 * (self.start_bit // 8) + 7 - self.start_bit % 8
        return 8 * length_bytes - from_first - self.length_bits

    def _quotient(self, scaled: float) -> float:
        return (scaled - self.offset) / self.factor

    def _out_of_range(self, scaled: float) -> CanBusError:
        minimum = self.minimum if self.minimum is not None else self.to_scaled(self.low_code)
        maximum = self.maximum if self.maximum is not None else self.to_scaled(self.high_code)
        unit = f" {self.unit}" if self.unit not in ("", "1") else ""
        return CanBusError(
            f"{self.path} = {scaled!r}{unit}: expected {minimum!r} to {maximum!r}{unit}"
        )


def _is_whole(quotient: float) -> bool:
    tolerance = max(_QUOTIENT_TOLERANCE_SMALL, abs(quotient) * _QUOTIENT_TOLERANCE)
    return abs(quotient - round(quotient)) <= tolerance


def _ceil(quotient: float) -> int:
    return round(quotient) if _is_whole(quotient) else math.ceil(quotient)


def _floor(quotient: float) -> int:
    return round(quotient) if _is_whole(quotient) else math.floor(quotient)
