"""Compile all sources to bytecode and, asked for `kernels`, what nodes run into numba's cache as
the environment names it: the machine, whose disk is read-only, would do so in each session."""

import sys
from compileall import compile_dir
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
for room in ("can_bus", "chiplog", "firmware_model", "hil_harness", "sim_plant"):
    compile_dir(ROOT / room, quiet=2)
compile_dir(ROOT / "tests", maxlevels=0, quiet=2)

if sys.argv[1:] == ["kernels"]:
    import lean  # noqa: F401  # first

    from hil_harness import load_robot
    from hil_harness.assembly import load_wire
    from sim_plant import Plant

    plant = Plant(load_robot(None).plant, tick_period_us=load_wire().tick_period_us, seed=1)
    plant.step(0.5, 0.1)
    _ = plant.counts
