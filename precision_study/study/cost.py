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
from typing import Any, Final

from firmware_model import FirmwareDescription

_ROUNDED: Final = ("position", "step", "heading", "turn_step", "trig")
_FEW_ROTATIONS: Final = 16
_MANY_ROTATIONS: Final = 30

CHOICES: Final[dict[str, dict[str, Any]]] = {
    "mode = wheel": {"mode": "wheel"},
    "mode = blend": {"mode": "blend"},
    "integration = midpoint": {"integration": "midpoint"},
    "integration = euler_after": {"integration": "euler_after"},
    "stale_heading_ticks > 0": {"stale_heading_ticks": 1},
    "trig.interpolated = false": {"trig": {"interpolated": False}},
    "trig.method = cordic, 16": {"trig": {"method": "cordic", "iterations": _FEW_ROTATIONS}},
    "trig.method = cordic, 30": {"trig": {"method": "cordic", "iterations": _MANY_ROTATIONS}},
    **{
        f"{table}.rounding = {rounding}": {table: {"rounding": rounding}}
        for table in _ROUNDED
        for rounding in ("half_even", "toward_zero")
    },
}
"""What is measured alone, each against the default; floor and half_up cost the same."""


@dataclass(frozen=True)
class Cost:
    """What one configuration takes.

    Attributes:
        instructions: a tick, mean [instructions, not cycles].
        instructions_per_s: at its tick rate.
        table_bytes: of the sine or CORDIC table, 4 bytes an entry.
        state_bytes: of the pose, its remainders and the words of a tick, as wide as configured.
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
        largest_error: of the sum for whole configurations, relative, as measured.
        core: compiler flags it was measured with.
        compiler: that was used.
    """

    base: float
    added: Mapping[str, float]
    code_bytes: int
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
            largest_error=table["largest_error"],
            core=table["core"],
            compiler=table["compiler"],
        )

    def instructions(self, firmware: FirmwareDescription) -> float:
        """Return the mean instructions of a tick."""
        chosen = [f"mode = {firmware.mode}", f"integration = {firmware.integration}"]
        if firmware.stale_heading_ticks > 0:
            chosen.append("stale_heading_ticks > 0")
        total = self.base
        if firmware.trig.method == "cordic":
            few, many = (
                self.added[f"trig.method = cordic, {rotations}"]
                for rotations in (_FEW_ROTATIONS, _MANY_ROTATIONS)
            )
            each = (many - few) / (_MANY_ROTATIONS - _FEW_ROTATIONS)
            total += few + (firmware.trig.iterations - _FEW_ROTATIONS) * each
        elif not firmware.trig.interpolated:
            chosen.append("trig.interpolated = false")
        for name in _ROUNDED:
            if name == "trig" and not (
                firmware.trig.method == "cordic" or firmware.trig.interpolated
            ):
                continue  # nothing is rounded
            chosen.append(f"{name}.rounding = {getattr(firmware, name).rounding}")
        return total + sum(self.added.get(name, 0.0) for name in chosen)

    def cost(self, firmware: FirmwareDescription, tick_period_us: int) -> Cost:
        """Return the cost of a configuration at a tick period."""
        instructions = self.instructions(firmware)
        trig = firmware.trig
        entries = trig.iterations + 1 if trig.method == "cordic" else trig.entries + 1
        return Cost(
            instructions=instructions,
            instructions_per_s=instructions * 1e6 / tick_period_us,
            table_bytes=4 * entries,
            state_bytes=state_bytes(firmware),
            code_bytes=self.code_bytes,
        )


def state_bytes(firmware: FirmwareDescription) -> int:
    """Return the bytes of pose, carried remainders and words of a tick, as wide as configured.

    Words are 1, 2, 4 or 8 bytes. The kernel in C takes its formats at run time and has the widest
    always; firmware written for one configuration needs no more than this.
    """
    one = firmware
    position = _bytes(one.position.word_bits)
    dropped = one.step.frac_bits + one.trig.frac_bits - one.position.frac_bits
    total = 2 * position + _bytes(one.heading.frac_bits)
    total += _bytes(one.step.word_bits) + _bytes(one.turn_step.word_bits)
    if one.position.carry_remainder:
        total += 2 * _bytes(max(dropped, 0) + 1)
    if one.heading.carry_remainder:
        total += _bytes(max(one.turn_step.frac_bits - one.heading.frac_bits, 0) + 1)
    return total


def _bytes(bits: int) -> int:
    return next(size for size in (1, 2, 4, 8) if bits <= 8 * size)


@lru_cache(maxsize=1)
def cost_table() -> CostTable:
    """Return the shipped table."""
    text = (files("precision_study") / "data" / "cost_table.json").read_text(encoding="utf-8")
    return CostTable.from_json(json.loads(text))
