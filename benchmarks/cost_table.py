"""Measures what each choice costs on the emulated Cortex-M3, and writes the study's cost table.

    .venv/bin/python benchmarks/cost_table.py            print it
    .venv/bin/python benchmarks/cost_table.py --write    and write precision_study/data/

Each choice is measured alone against the default configuration, over 10,000 ticks of a drive that
turns, stops and reverses. The study adds them up; whole configurations that differ in many choices
are measured too, and the largest error of the sum stands in the table.
"""

from __future__ import annotations

import json
import random
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

from cortex_m import drive

from firmware_model import FirmwareDescription, build_config
from firmware_model.cortex_m import COMPILER, CORE, FLAGS, Job, measure
from hil_harness.assembly import load_wire
from hil_harness.nodes.firmware import firmware_config
from hil_harness.robot import load_robot
from precision_study.study.cost import CHOICES, CostTable

PATH: Final = Path(__file__).parent.parent / "precision_study" / "data" / "cost_table.json"
WHOLE: Final = 8
SEED: Final = 1


def main() -> None:
    """Measure, check the sum on whole configurations, and print or write the table."""
    robot, wire = load_robot(None), load_wire()
    described = firmware_config(robot, wire.signal_map, wire.tick_period_us)

    def cost(firmware: dict[str, Any]) -> dict[str, float]:
        whole = FirmwareDescription().model_dump()
        for name, given in firmware.items():
            whole[name] = whole[name] | given if isinstance(given, dict) else given
        config = build_config(FirmwareDescription.from_table(whole), described.constants)
        found = measure(Job(config, drive(config.max_step_ticks)))
        print(f"{found.instructions:8.1f}  {found.worst_instructions:6}  {firmware}", flush=True)
        return {
            "instructions": found.instructions,
            "code_bytes": found.code_bytes,
            "state_bytes": found.state_bytes,
            "config_bytes": found.config_bytes,
        }

    base = cost({})
    added = {
        name: cost(firmware)["instructions"] - base["instructions"]
        for name, firmware in CHOICES.items()
    }
    table = {
        "core": " ".join((*CORE, *FLAGS)),
        "compiler": _version(),
        "base": base,
        "added_instructions": {name: round(value, 2) for name, value in added.items()},
        "largest_error": 0.0,
    }
    generator = random.Random(SEED)
    worst = 0.0
    for _ in range(WHOLE):
        firmware = _random(generator)
        description = FirmwareDescription.from_table(firmware)
        said = CostTable.from_json(table).instructions(description)
        measured = cost(firmware)["instructions"]
        worst = max(worst, abs(said / measured - 1.0))
        print(f"{said:8.1f}  by the table", flush=True)
    table["largest_error"] = round(worst, 4)
    text = json.dumps(table, indent=2) + "\n"
    print(text)
    if "--write" in sys.argv[1:]:
        PATH.write_text(text, encoding="utf-8")


def _version() -> str:
    lines = subprocess.run([COMPILER, "--version"], capture_output=True, check=True).stdout
    return lines.decode().splitlines()[0]


def _random(generator: random.Random) -> dict[str, Any]:
    pick = generator.choice
    roundings = ("floor", "half_up", "half_even", "toward_zero")
    firmware: dict[str, Any] = {
        name: {"rounding": pick(roundings), "carry_remainder": pick((True, False))}
        for name in ("position", "step", "heading", "turn_step")
    }
    firmware["trig"] = {
        "method": pick(("table", "table", "cordic")),
        "entries": pick((64, 1024)),
        "interpolated": pick((True, False)),
        "iterations": pick((12, 20, 28)),
        "rounding": pick(roundings),
    }
    firmware["mode"] = pick(("wheel", "gyro", "blend"))
    firmware["integration"] = pick(("euler_before", "midpoint", "euler_after"))
    return firmware


if __name__ == "__main__":
    main()
