"""Measures what each choice costs on the emulated Cortex-M3, and writes the study's cost table.

    .venv/bin/python benchmarks/cost_table.py            print it
    .venv/bin/python benchmarks/cost_table.py --write    and write precision_study/data/

Each choice is measured against the default configuration over 10,000 ticks of two drives: one that
turns, stops and reverses, and one that goes on and on and hardly turns. Their mean stands in the
table, and the study adds it up. Random whole configurations, of any width, are measured on both
drives too: how far the sum is from them, on either drive, stands in the table.
"""

from __future__ import annotations

import json
import random
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

import numpy as np
from cortex_m import drive, straight

from firmware_model import FirmwareDescription, FirmwareError, KernelConfig, build_config
from firmware_model.cortex_m import COMPILER, CORE, FLAGS, Cost, Job, measure
from hil_harness.assembly import load_wire
from hil_harness.nodes.firmware import firmware_config
from hil_harness.robot import load_robot
from precision_study.study import cores
from precision_study.study.cost import CHOICES, Change, CostTable

PATH: Final = Path(__file__).parent.parent / "precision_study" / "data" / "cost_table.json"
WHOLE: Final = 120
SEED: Final = 1
DRIVES: Final = {"turning": drive, "straight": straight}
ROUNDINGS: Final = ("floor", "half_up", "half_even", "toward_zero")


def main() -> None:
    """Measure, check the sum on whole configurations, and print or write the table."""
    robot, wire = load_robot(None), load_wire()
    constants = firmware_config(robot, wire.signal_map, wire.tick_period_us).constants

    def built(*changes: Change) -> KernelConfig:
        return build_config(FirmwareDescription.from_table(_changed(*changes)), constants)

    def cost(config: KernelConfig) -> list[Cost]:
        return [measure(Job(config, one(config.max_step_ticks))) for one in DRIVES.values()]

    generator = random.Random(SEED)
    wholes: list[KernelConfig] = []
    while len(wholes) < WHOLE:
        try:
            wholes.append(built(_random(generator)))
        except FirmwareError:
            continue  # formats that do not go together
    firsts = {json.dumps(first): first for first, _ in CHOICES.values()}
    # Each waits for an emulator of its own.
    with ThreadPoolExecutor(cores()) as pool:
        befores = dict(zip(firsts, pool.map(cost, map(built, firsts.values())), strict=True))
        afters = pool.map(cost, [built(*changes) for changes in CHOICES.values()])
        added = {
            name: _mean(after) - _mean(befores[json.dumps(first)])
            for (name, (first, _)), after in zip(CHOICES.items(), afters, strict=True)
        }
        defaults = befores[json.dumps({})]
        base = defaults[0]
        table: dict[str, Any] = {
            "core": " ".join((*CORE, *FLAGS)),
            "compiler": _version(),
            "base": {
                "instructions": _mean(defaults),
                "code_bytes": base.code_bytes,
                "state_bytes": base.state_bytes,
                "config_bytes": base.config_bytes,
            },
            "added_instructions": {name: round(value, 2) for name, value in added.items()},
            "error": {"configurations": WHOLE, "median": 0, "percentile_95": 0, "largest": 0},
            "by_drive": {name: dict[str, float]() for name in DRIVES},
        }
        by_table = CostTable.from_json(table)
        errors: dict[str, list[float]] = {name: [] for name in DRIVES}
        for config, measured in zip(wholes, pool.map(cost, wholes), strict=True):
            said = by_table.instructions(config.description)
            print(f"{said:8.1f} by the table", end="")
            for name, on_it in zip(DRIVES, measured, strict=True):
                errors[name].append(abs(said / on_it.instructions - 1.0))
                print(
                    f", {on_it.instructions:8.1f} {name}: {100 * errors[name][-1]:5.2f} %", end=""
                )
            print(f"  {config.description}", flush=True)
    for name, found in errors.items():
        table["by_drive"][name] = {"default": defaults[list(DRIVES).index(name)].instructions}
        table["by_drive"][name] |= _quantiles(found)
    table["error"] |= _quantiles([one for found in errors.values() for one in found])
    text = json.dumps(table, indent=2) + "\n"
    print(text)
    if "--write" in sys.argv[1:]:
        PATH.write_text(text, encoding="utf-8")


def _mean(costs: list[Cost]) -> float:
    """Return the mean instructions over the drives."""
    return round(sum(one.instructions for one in costs) / len(costs), 2)


def _quantiles(errors: list[float]) -> dict[str, float]:
    """Return the errors that half, 95 % and all of them stay within."""
    shares = {"median": 0.5, "percentile_95": 0.95, "largest": 1.0}
    return {
        name: round(float(np.quantile(errors, share, method="higher")), 4)
        for name, share in shares.items()
    }


def _changed(*changes: Change) -> dict[str, Any]:
    """Return the default description with changes, one after the other."""
    whole = FirmwareDescription().model_dump()
    for change in changes:
        for name, given in change.items():
            whole[name] = whole[name] | given if isinstance(given, dict) else given
    return whole


def _version() -> str:
    lines = subprocess.run([COMPILER, "--version"], capture_output=True, check=True).stdout
    return lines.decode().splitlines()[0]


def _random(generator: random.Random) -> Change:
    """Return a configuration of any mode, rule, width, table and rounding."""
    pick, draw = generator.choice, generator.randint
    step, trig, heading = draw(20, 28), draw(12, 30), draw(12, 32)

    def narrowing(bits: int) -> Change:
        return {
            "frac_bits": bits,
            "rounding": pick(ROUNDINGS),
            "carry_remainder": pick((True, False)),
        }

    return {
        "mode": pick(("wheel", "gyro", "blend")),
        "integration": pick(("euler_before", "midpoint", "euler_after")),
        "stale_heading_ticks": pick((0, 0, 0, 1, 4)),
        "position": narrowing(draw(10, min(40, step + trig))),
        "step": narrowing(step),
        "heading": narrowing(heading),
        "turn_step": narrowing(draw(max(heading, 24), 48)),
        "trig": {
            "method": pick(("table", "table", "cordic")),
            "entries": 1 << draw(4, 12),
            "interpolated": pick((True, False)),
            "iterations": draw(8, 30),
            "frac_bits": trig,
            "rounding": pick(ROUNDINGS),
        },
    }


if __name__ == "__main__":
    main()
