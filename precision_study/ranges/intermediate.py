"""A value that the kernel forms: its proved range, and the width that it has in C."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal

from firmware_model.c99_layout import c_types

Word = Literal["register", "counter", "step", "turn_step", "position", "velocity"]


@dataclass(frozen=True)
class Intermediate:
    """A value that the kernel forms.

    Attributes:
        name: what it is.
        field: where its width is chosen, as ``firmware.step.word_bits``; the C type otherwise.
        unit: of 2^frac_bits of it.
        frac_bits: fraction bits.
        word_bits: width, with the sign if it has one.
        low, high: no input of the envelope takes it beyond them [2^-frac_bits unit].
        word: which overflow the kernel would report.
        holds: fields of the kernel's state that are such a value.
        is_signed: its word is two's complement.
        at_least_bits: a narrower word would not do, although it may hold the range: the range
            depends on the word, or no kernel is built with it.
    """

    name: str
    field: str
    unit: str
    frac_bits: int
    word_bits: int
    low: int
    high: int
    word: Word = "register"
    holds: tuple[str, ...] = ()
    is_signed: bool = True
    at_least_bits: int = 0

    @property
    def bound(self) -> int:
        """The largest magnitude [2^-frac_bits unit]."""
        return max(self.high, -self.low)

    @property
    def least_word_bits(self) -> int:
        """The narrowest word that would do."""
        return max(self.range_bits, self.at_least_bits)

    @property
    def range_bits(self) -> int:
        """The narrowest word that holds the range."""
        if not self.is_signed:
            return max(self.high.bit_length(), 1)
        return max(self.high.bit_length(), (-self.low - 1).bit_length()) + 1

    @property
    def is_proved(self) -> bool:
        """Whether overflow is impossible."""
        return self.range_bits <= self.word_bits and (self.is_signed or self.low >= 0)


def in_c(
    name: str, c_type: str, unit: str, frac_bits: int, low: int, high: int, *holds: str
) -> Intermediate:
    """Return a value in a C type of fixed width, such as ``uint32_t``."""
    kind = re.fullmatch(r"(u?)int(\d+)_t", c_type)
    assert kind is not None, c_type
    return Intermediate(
        name, c_type, unit, frac_bits, int(kind[2]), low, high, holds=holds, is_signed=not kind[1]
    )


def register(name: str, unit: str, frac_bits: int, bound: int, *holds: str) -> Intermediate:
    """Return a value of either sign in 64 bits."""
    return in_c(name, "int64_t", unit, frac_bits, -bound, bound, *holds)


def kept(name: str, unit: str, frac_bits: int, low: int, high: int, *holds: str) -> Intermediate:
    """Return a value that the state holds, in the width that the C header gives its fields."""
    types = {c_types("chiplog_state")[field] for field in holds}
    assert len(types) == 1, holds
    return in_c(name, types.pop(), unit, frac_bits, low, high, *holds)
