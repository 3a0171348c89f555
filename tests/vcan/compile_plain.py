"""Compile what the nodes run, into numba's cache as the environment names it."""

import lean  # noqa: F401  # first

from hil_harness import load_robot
from hil_harness.assembly import load_wire
from sim_plant import Plant

plant = Plant(load_robot(None).plant, tick_period_us=load_wire().tick_period_us, seed=1)
plant.step(0.5, 0.1)
_ = plant.counts
