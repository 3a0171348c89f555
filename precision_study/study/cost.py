"""What a configuration costs: instructions on an emulated Cortex-M3, and bytes.

Instructions, not cycles: a real core takes more cycles than instructions. The table is measured by
``benchmarks/cost_table.py``, choice by choice; the cost of a configuration is their sum.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any, Final, TypeAlias

from firmware_model import FirmwareDescription, KernelConfig
from firmware_model.c99_layout import table_bytes

_ONCE: Final = ("position", "step", "heading")
_MODES: Final = ("wheel", "gyro", "blend")
_FEW_ROTATIONS: Final = 16
_MANY_ROTATIONS: Final = 30
_NARROWING: Final[dict[str, dict[str, Any]]] = {
    "rounding = half_even": {"rounding": "half_even"},
    "rounding = toward_zero": {"rounding": "toward_zero"},
    "carry_remainder = false": {"carry_remainder": False},
}
_NO_BITS: Final = "no bits between the entries"

Change: TypeAlias = dict[str, Any]

CHOICES: Final[dict[str, tuple[Change, Change]]] = {
    "mode = wheel": ({}, {"mode": "wheel"}),
    "mode = blend": ({}, {"mode": "blend"}),
    "integration = midpoint": ({}, {"integration": "midpoint"}),
    "integration = euler_after": ({}, {"integration": "euler_after"}),
    "stale_heading_ticks > 0": ({}, {"stale_heading_ticks": 1}),
    "trig.interpolated = false": ({}, {"trig": {"interpolated": False}}),
    _NO_BITS: ({}, {"trig": {"entries": 1024}, "heading": {"frac_bits": 12}}),
    **{
        f"trig.method = cordic, {iterations}": (
            {},
            {"trig": {"method": "cordic", "iterations": iterations}},
        )
        for iterations in (_FEW_ROTATIONS, _MANY_ROTATIONS)
    },
    **{
        f"{table}.{name}": ({}, {table: change})
        for table in _ONCE
        for name, change in _NARROWING.items()
    },
    **{
        f"{mode}: turn_step.{name}": ({"mode": mode}, {"turn_step": change})
        for mode in _MODES
        for name, change in _NARROWING.items()
    },
    **{
        f"{method}: trig.rounding = {rounding}": (
            {"trig": {"method": method}},
            {"trig": {"method": method, "rounding": rounding}},
        )
        for method in ("table", "cordic")
        for rounding in ("half_even", "toward_zero")
    },
}
"""What is measured: a change, against the default configuration or against it with a first change.

Where a choice costs more under another one (a blend turns by both sources), it stands under each.
Floor and half_up cost the same, and so does every width.
"""


@dataclass(frozen=True)
class Cost:
    """What one configuration takes.

    Attributes:
        instructions: a tick, mean [instructions, not cycles].
        instructions_per_s: at its tick rate.
        table_bytes: of the sine or CORDIC table as the kernel in C has it.
        state_bytes: of pose, remainders and the words of a tick, as wide as configured.
        code_bytes: of the kernel in C, the same for every configuration.
    """

    instructions: float
    instructions_per_s: float
    table_bytes: int
    state_bytes: int
    code_bytes: int

    @property
    def memory_bytes(self) -> int:
        """Table and state: what the configuration changes."""
        return self.table_bytes + self.state_bytes


@dataclass(frozen=True)
class CostTable:
    """The measured table.

    Attributes:
        base: instructions of the default configuration.
        added: instructions that each of `CHOICES` adds to it.
        code_bytes: of the kernel.
        checked: whole random configurations that were measured beside the sum.
        median_error: of the sum for these, relative.
        high_error: what 95 % of them stay below.
        largest_error: of the worst of them.
        core: compiler flags it was measured with.
        compiler: that was used.
    """

    base: float
    added: Mapping[str, float]
    code_bytes: int
    checked: int
    median_error: float
    high_error: float
    largest_error: float
    core: str
    compiler: str

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> CostTable:
        """Return the table as ``benchmarks/cost_table.py`` writes it."""
        return cls(
            base=table["base"]["instructions"],
            added=table["added_instructions"],
            code_bytes=table["base"]["code_bytes"],
            checked=table["error"]["configurations"],
            median_error=table["error"]["median"],
            high_error=table["error"]["percentile_95"],
            largest_error=table["error"]["largest"],
            core=table["core"],
            compiler=table["compiler"],
        )

    @property
    def about_equal(self) -> float:
        """The ratio of two costs up to which the dearer by the table may be the cheaper."""
        return (1.0 + self.largest_error) / (1.0 - self.largest_error)

    def instructions(self, firmware: FirmwareDescription) -> float:
        """Return the mean instructions of a tick."""
        trig = firmware.trig
        chosen = [f"mode = {firmware.mode}", f"integration = {firmware.integration}"]
        if firmware.stale_heading_ticks > 0:
            chosen.append("stale_heading_ticks > 0")
        for name in _ONCE:
            chosen += _narrowing(name, getattr(firmware, name))
        chosen += _narrowing(f"{firmware.mode}: turn_step", firmware.turn_step)
        total = self.base + sum(self.added.get(name, 0.0) for name in chosen)
        rounding = self.added.get(f"{trig.method}: trig.rounding = {trig.rounding}", 0.0)
        if trig.method == "cordic":
            few, many = (
                self.added[f"trig.method = cordic, {rotations}"]
                for rotations in (_FEW_ROTATIONS, _MANY_ROTATIONS)
            )
            each = (many - few) / (_MANY_ROTATIONS - _FEW_ROTATIONS)
            return total + few + (trig.iterations - _FEW_ROTATIONS) * each + rounding
        if not trig.interpolated:
            return total + self.added["trig.interpolated = false"]
        # Of 2^n headings between two entries one is an entry, with nothing to interpolate or round.
        between = firmware.heading.frac_bits - 2 - (trig.entries.bit_length() - 1)
        share = 2.0 ** -max(between, 0)
        return total + share * self.added[_NO_BITS] + (1.0 - share) * rounding

    def cost(self, config: KernelConfig) -> Cost:
        """Return the cost of a configuration."""
        instructions = self.instructions(config.description)
        return Cost(
            instructions=instructions,
            instructions_per_s=instructions / config.constants.tick_period_s,
            table_bytes=table_bytes(config),
            state_bytes=state_bytes(config),
            code_bytes=self.code_bytes,
        )


def _narrowing(name: str, format_: Any) -> list[str]:
    """Return the choices of a format, under the name of its word."""
    carried = str(format_.carry_remainder).lower()
    return [f"{name}.rounding = {format_.rounding}", f"{name}.carry_remainder = {carried}"]


def state_bytes(config: KernelConfig) -> int:
    """Return the bytes of pose, carried remainders and words of a tick, as wide as configured.

    Words are 1, 2, 4 or 8 bytes, or 16 where C has none. The kernel in C takes its formats at run
    time and has the widest always; firmware written for one configuration needs no more than this.
    """
    one = config.description
    heading = _bytes(one.heading.frac_bits)
    total = 2 * _bytes(one.position.word_bits) + heading
    total += heading * max(one.stale_heading_ticks - 1, 0)
    total += _bytes(one.step.word_bits) + _bytes(one.turn_step.word_bits)
    if one.position.carry_remainder:
        total += 2 * _remainder_bytes(config.position_shift)
    if one.heading.carry_remainder:
        total += _remainder_bytes(config.heading_shift)
    if one.step.carry_remainder:
        total += _remainder_bytes(config.step_shift)
    if one.turn_step.carry_remainder:
        total += _remainder_bytes(config.wheel_turn_shift)
        if one.mode != "wheel":  # the wheels stand in where the gyro is not believed
            total += _remainder_bytes(config.gyro_turn_shift)
    return total


def _remainder_bytes(dropped_bits: int) -> int:
    return _bytes(dropped_bits + 1) if dropped_bits > 0 else 0


def _bytes(bits: int) -> int:
    return next(size for size in (1, 2, 4, 8, 16) if bits <= 8 * size)


@lru_cache(maxsize=1)
def cost_table() -> CostTable:
    """Return the shipped table."""
    text = (files("precision_study") / "data" / "cost_table.json").read_text(encoding="utf-8")
    return CostTable.from_json(json.loads(text))
