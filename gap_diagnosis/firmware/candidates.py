"""The values that a firmware effect may have, as changes of the described program.

Choices and whole numbers are listed here, each with its share of the effect's prior. Real numbers
are estimated from the log (`estimates`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from firmware_model import FirmwareChanges, FirmwareError, KernelConfig
from firmware_model.changes import (
    CONSTANTS,
    CUT_ROUNDINGS,
    EULER_HEADINGS,
    LIMITED_VARIABLES,
    RESOLVED_VARIABLES,
)
from gap_diagnosis.priors import default_prior

EFFECTS: Final = (
    "firmware_truncation",
    "firmware_resolution",
    "coarse_trig_table",
    "euler_integration",
    "stale_heading",
    "firmware_constant",
    "firmware_overflow",
    "moving_calibration",
    "auto_zero",
    "fixed_tick_period",
    "blend_weight",
    "missed_deadline",
)
"""The effects of stage firmware, in the order of the catalogue."""

_MOST_BITS_FEWER: Final = 24
_MOST_LOG2_ENTRIES: Final = 12
_MOST_CYCLES: Final = 4
_LEAST_WORD_BITS: Final = 8
_MOST_BITS_SHORT: Final = 8

Value = float | int | str


@dataclass(frozen=True)
class Candidate:
    """One value of each parameter of a set of effects.

    Attributes:
        values: by ``effect.parameter``.
        changes: fields of `FirmwareChanges`.
        log_prior: logarithm of its share of the effects' prior.
        widths: for real parameters, the half width within which the data are explained alike.
        timing: fields of `Program` that act in time.
    """

    values: Mapping[str, Value]
    changes: Mapping[str, Any]
    log_prior: float
    widths: Mapping[str, float]
    timing: Mapping[str, Any] = field(default_factory=dict)

    def beside(self, other: Candidate) -> Candidate:
        """Return both together."""
        return Candidate(
            {**self.values, **other.values},
            {**self.changes, **other.changes},
            self.log_prior + other.log_prior,
            {**self.widths, **other.widths},
            {**self.timing, **other.timing},
        )


def altered_config(described: KernelConfig, changes: Mapping[str, Any]) -> KernelConfig | None:
    """Return the program with *changes*; None where no firmware can have them."""
    try:
        program = FirmwareChanges(**changes)
        return program.config(described.description, described.constants)
    except FirmwareError:
        return None


def listed(effect: str, described: KernelConfig) -> list[Candidate]:
    """Return the values of an effect without real parameters; nothing for the others."""
    one = described.description
    found: list[tuple[dict[str, Value], dict[str, Any]]] = []
    match effect:
        case "firmware_truncation":
            found = [({"rounding": r}, {"rounding": r}) for r in CUT_ROUNDINGS[1:]]
        case "firmware_resolution":
            found = [
                (
                    {"variable": variable, "bits": bits},
                    {"resolution_variable": variable, "resolution_bits": bits},
                )
                for variable in RESOLVED_VARIABLES
                for bits in range(1, min(_MOST_BITS_FEWER, getattr(one, variable).frac_bits) + 1)
            ]
        case "coarse_trig_table":
            found = [
                (
                    {"entries": 1 << log2, "interpolated": interpolated},
                    {"trig_entries": 1 << log2, "trig_interpolated": interpolated},
                )
                for log2 in range(_MOST_LOG2_ENTRIES + 1)
                for interpolated in (0, 1)
            ]
        case "euler_integration":
            found = [
                ({"heading": heading}, {"euler": heading})
                for heading in EULER_HEADINGS[1:]
                if one.integration != f"euler_{heading}"
            ]
        case "stale_heading":
            found = [
                ({"cycles": cycles}, {"stale_heading_cycles": cycles})
                for cycles in range(1, _MOST_CYCLES + 1)
            ]
    share = -math.log(max(len(found), 1))
    return [
        Candidate({f"{effect}.{name}": value for name, value in values.items()}, changes, share, {})
        for values, changes in found
    ]


def overflow_candidates(described: KernelConfig, used_bits: Mapping[str, int]) -> list[Candidate]:
    """Return words that the log may overflow, and one for each variable that it surely does not.

    *used_bits* is the width that the described program needed, by variable. Wider words by two
    bits or more leave the same log; narrower ones by many would have overflowed at once.
    """
    found = []
    one = described.description
    for variable in LIMITED_VARIABLES:
        all_bits = range(_LEAST_WORD_BITS, getattr(one, variable).word_bits)
        share = -math.log(len(LIMITED_VARIABLES) * max(len(all_bits), 1) * 2)
        used = used_bits[variable]
        tight = [bits for bits in all_bits if used - _MOST_BITS_SHORT <= bits <= used + 1]
        roomy = [bits for bits in all_bits if bits > used + 1]
        choices = [(bits, mode, share) for bits in tight for mode in ("wrap", "saturate")]
        if roomy:
            choices.append((roomy[-1], "wrap", share + math.log(2 * len(roomy))))
        for bits, mode, log_prior in choices:
            found.append(
                Candidate(
                    {
                        "firmware_overflow.variable": variable,
                        "firmware_overflow.bits": bits,
                        "firmware_overflow.mode": mode,
                    },
                    {
                        "overflow_variable": variable,
                        "overflow_bits": bits,
                        "overflow_mode": mode,
                    },
                    log_prior,
                    {},
                )
            )
    return found


@dataclass(frozen=True)
class RealParameter:
    """A real parameter that the odometry depends on smoothly.

    Attributes:
        values: the effect's other values, by ``effect.parameter``.
        name: ``effect.parameter``.
        field: of `FirmwareChanges`.
        fixed: the other fields.
        low, high: range; beyond it the effect has another name.
        log_prior: share of the other values.
        small, large: sizes between which the prior is even in logarithm.
    """

    values: Mapping[str, Value]
    name: str
    field: str
    fixed: Mapping[str, Any]
    low: float
    high: float
    log_prior: float
    small: float
    large: float

    def at(self, value: float, width: float) -> Candidate:
        """Return the candidate at *value*, standing for the values within *width* of it."""
        span = 2.0 * math.log(self.large / self.small)
        density = 1.0 / (span * max(abs(value), self.small))
        return Candidate(
            {**self.values, self.name: value},
            {**self.fixed, self.field: value},
            self.log_prior + math.log(min(1.0, density * 2.0 * width)),
            {self.name: width},
        )

    def unseen(self) -> Candidate:
        """Return the candidate that stands for values too small for any log, with their share."""
        return Candidate(
            {**self.values, self.name: 0.0},
            {},
            self.log_prior + math.log(0.1),
            {self.name: self.small},
        )


def smooth(effect: str, described: KernelConfig) -> list[RealParameter]:
    """Return the smooth parameters of an effect, one for each value of its choices."""
    ranges = default_prior().ranges.get(effect, {})
    match effect:
        case "firmware_constant":
            return [
                RealParameter(
                    values={"firmware_constant.constant": constant},
                    name="firmware_constant.scale",
                    field="constant_scale",
                    fixed={"constant": constant},
                    low=-0.9,
                    high=9.0,
                    log_prior=-math.log(len(CONSTANTS)),
                    small=ranges["scale"][0],
                    large=ranges["scale"][1],
                )
                for constant in CONSTANTS
            ]
        case "fixed_tick_period":
            return [
                RealParameter(
                    {},
                    "fixed_tick_period.scale",
                    "tick_period_scale",
                    {},
                    -0.5,
                    1.0,
                    0.0,
                    *ranges["scale"],
                )
            ]
        case "blend_weight" if described.description.mode == "blend":
            weight = described.description.blend_weight
            return [
                RealParameter(
                    {},
                    "blend_weight.weight",
                    "blend_weight",
                    {},
                    -weight,
                    1.0 - weight,
                    0.0,
                    *ranges["weight"],
                )
            ]
    return []
