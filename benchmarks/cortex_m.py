"""What the C99 kernel costs on an emulated Cortex-M3: instructions a tick, bytes of code and data.

    .venv/bin/python benchmarks/cortex_m.py

Instructions, not cycles: QEMU counts what the core executes, not how long flash and bus make it
wait; a real core takes more cycles than instructions. The drive turns, stops and reverses for
10,000 ticks; `worst` is the tick that took most, each counted exactly.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from firmware_model import FirmwareDescription, build_config
from firmware_model.cortex_m import FLAGS, Job, measure
from hil_harness.assembly import load_wire
from hil_harness.nodes.firmware import firmware_config
from hil_harness.robot import load_robot

TICKS: Final = 10_000
COLUMNS: Final = ("mean", "worst", "code", "table", "state", "const")
CONFIGURATIONS: Final[dict[str, dict[str, Any]]] = {
    "default": {},
    "mode wheel": {"mode": "wheel"},
    "mode blend": {"mode": "blend"},
    "midpoint": {"integration": "midpoint"},
    "table of 64, interpolated": {"trig": {"entries": 64}},
    "table of 1024, nearest entry": {"trig": {"interpolated": False}},
    "cordic, 30 rotations": {"trig": {"method": "cordic"}},
    "cordic, 16 rotations": {"trig": {"method": "cordic", "iterations": 16}},
    "position of 32 bits": {"position": {"word_bits": 32, "frac_bits": 16}},
    "half-even everywhere": {
        name: {"rounding": "half_even"}
        for name in ("position", "step", "heading", "turn_step", "trig", "gyro")
    },
}


def drive(max_step_ticks: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return int64[TICKS, 5]: speed and turn swing, with a standstill in every fourth part."""
    tick = np.arange(TICKS)
    moves = (tick // 250) % 4 != 3
    speed = 0.6 * max_step_ticks * np.sin(tick / 300.0) * moves
    turn = 0.3 * max_step_ticks * np.sin(tick / 70.0) * moves
    inputs = np.zeros((TICKS, 5), dtype=np.int64)
    inputs[:, 0] = np.cumsum(np.rint(speed - turn).astype(np.int64))
    inputs[:, 1] = np.cumsum(np.rint(speed + turn).astype(np.int64))
    inputs[:, 3] = 32768 + np.rint(60.0 * turn).astype(np.int64) + (tick * 7919) % 5 - 2
    return inputs


def straight(max_step_ticks: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return int64[TICKS, 5]: on and on without a standstill, hardly turning."""
    tick = np.arange(TICKS)
    speed = 0.5 * max_step_ticks * (1.0 + 0.2 * np.sin(tick / 300.0))
    turn = 0.005 * max_step_ticks * np.sin(tick / 500.0)
    inputs = np.zeros((TICKS, 5), dtype=np.int64)
    inputs[:, 0] = np.floor(np.cumsum(speed - turn))
    inputs[:, 1] = np.floor(np.cumsum(speed + turn))
    inputs[:, 3] = 32768 + np.rint(60.0 * turn).astype(np.int64) + (tick * 7919) % 5 - 2
    return inputs


def main() -> None:
    """Print one table per level of optimisation."""
    robot, wire = load_robot(None), load_wire()
    described = firmware_config(robot, wire.signal_map, wire.tick_period_us)
    for level in ("-O2", "-Os"):
        flags = [level if flag.startswith("-O") else flag for flag in FLAGS]
        print(f"{level:30}" + "".join(f"{column:>7}" for column in COLUMNS))
        for name, table in CONFIGURATIONS.items():
            description = FirmwareDescription.from_table(robot.firmware.model_dump() | table)
            config = build_config(description, described.constants)
            cost = measure(Job(config, drive(config.max_step_ticks)), flags)
            values = (
                round(cost.instructions),
                cost.worst_instructions,
                cost.code_bytes,
                cost.table_bytes,
                cost.state_bytes,
                cost.config_bytes,
            )
            print(f"{name:30}" + "".join(f"{value:7}" for value in values))


if __name__ == "__main__":
    main()
