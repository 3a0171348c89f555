"""Cases of the other engine on disk, as a lab would have them: nulls and physical causes.

`python -m gap_diagnosis.trials.mujoco_cases OUT [CAUSE]… [--seed N] [--drive KIND]` writes
OUT/CAUSE-N/ with `bus.log`, `robot.toml`, `reference.tum`, and beside them `truth/CAUSE-N.json`:
what the engine did, measured from its state.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.signal import lfilter

from gap_diagnosis.trials.drives import FAMILIAR, NEW, drive
from gap_diagnosis.trials.layout import LOG, REFERENCE, ROBOT
from gap_diagnosis.trials.logs import measured, tum_lines, write_log
from gap_diagnosis.trials.mujoco_engine import drive_through, hold_share
from gap_diagnosis.trials.mujoco_sensors import Engine
from gap_diagnosis.trials.mujoco_truth import Calibrated, calibrated, truth_of
from gap_diagnosis.trials.mujoco_world import Patch, World
from gap_diagnosis.trials.reference_noise import draw_levels
from hil_harness.assembly import Wire, commands_on_the_wire, load_wire
from hil_harness.effect_runs import run_with_effects
from hil_harness.robot import Robot, load_robot
from hil_harness.scenarios.model import Scenario
from sim_plant import PlantDescription

_FASTEST_M_S: Final = 0.4
_HOLD_SHARE: Final = 0.09
"""No command asks for more of what the floor gives: so much creeps and does not slide."""
_TYRES_M_PER_N: Final = 1.2e-5
MOST_SCRUB_M: Final = 0.0002
"""Of a healthy robot: with more its wheels hop as it spins."""
_WIDE_TYRES_S: Final = 0.08
"""Soft enough for wheels that scrub by 15 mm to stay on the floor as they turn."""

_ROBOT_TEXT: Final = """\
schema = 1

[robot]
name = "mujoco"

[wheels]
radius_m = {radius_m:.9f}
wheelbase_m = {wheelbase_m:.9f}
"""

CAUSES: Final[Mapping[str, Mapping[str, Any]]] = {
    "null": {},
    "small_wheels": {"radius_left_m": 0.0492, "radius_right_m": 0.0492},
    "small_right_wheel": {"radius_right_m": 0.0495},
    "wide_track": {"track_m": 0.306},
    "icy_patch": {"patch": Patch("left", 0.1, 0.35, 0.01)},
    "load_on_the_left": {"load_kg": 4.0, "load_at_m": (0.0, 0.1, 0.1)},
    "soft_tyres": {"soft_s": 0.03},
    "tilted_floor": {"slope_rad": 0.05, "downhill_rad": 0.7, "soft_s": 0.02},
    "weak_motors": {"torque_nm": 0.1},
    "scrubbing_tyres": {"scrub_m": 0.015},
}
"""By cause, what is different from the robot that was calibrated."""


def nominal_world(seed: int) -> World:
    """Return a robot: mass, balance, scrub, floor and caster are its own; its wheels are alike."""
    draw = np.random.default_rng([seed, 1])
    return World(
        mass_kg=float(draw.uniform(5, 12)),
        middle_x_m=float(draw.uniform(-0.08, -0.03)),
        scrub_m=float(draw.uniform(0.0, MOST_SCRUB_M)),
        trail_m=float(draw.uniform(0.01, 0.025)),
        caster_friction=float(draw.uniform(0.4, 0.8)),
    )


def world_with(cause: str, seed: int) -> tuple[World, World]:
    """Return the robot as it was calibrated, and as it is with a cause."""
    nominal = nominal_world(seed)
    if cause == "load_on_the_left":
        nominal = replace(nominal, tyre_m_per_n=_TYRES_M_PER_N)
    if cause == "tilted_floor":
        nominal = replace(nominal, soft_s=0.02)
    if cause == "scrubbing_tyres":
        nominal = replace(nominal, soft_s=_WIDE_TYRES_S)
    return nominal, replace(nominal, **CAUSES[cause])


def gentle_drive(
    kind: str, seed: Sequence[int], world: World, plant: PlantDescription, wire: Wire
) -> Scenario:
    """Return a drive of a kind, at so slow a pace that the wheels hold.

    What either wheel is asked to gain goes with the pace, turning's part in it too, and what its
    arc takes with the square of the pace.
    """
    scenario = drive(kind, np.random.default_rng(list(seed)), _FASTEST_M_S)
    pace = _HOLD_SHARE / asked_hold_share(scenario, world, plant, wire)
    if pace >= 1.0:
        return scenario
    return drive(kind, np.random.default_rng(list(seed)), _FASTEST_M_S, pace=pace)


def asked_hold_share(
    scenario: Scenario, world: World, plant: PlantDescription, wire: Wire
) -> float:
    """Return the largest acceleration that a drive asks of either wheel over µ·g.

    Commands come in steps, and the motors follow each with their lag: that asks for more than the
    drive's own ramps.
    """
    step_s = wire.tick_period_us * 1e-6
    commands = commands_on_the_wire(scenario, scenario.tick_count(wire.tick_period_us), wire)
    kept = math.exp(-step_s / plant.drive.time_constant_s)
    ahead, turn = lfilter([0.0, 1.0 - kept], [1.0, -kept], commands, axis=0).T
    return hold_share(ahead, np.zeros(len(ahead)), turn, step_s, world)


def calibrate(
    world: World, plant: PlantDescription, wire: Wire, seconds: float = 40.0
) -> Calibrated:
    """Return what a lab's calibration drive in this engine gives."""
    scenario = gentle_drive("calibration", [7], world, plant, wire)
    ticks = min(
        scenario.tick_count(wire.tick_period_us), round(seconds * 1e6) // wire.tick_period_us
    )
    commands = commands_on_the_wire(scenario, ticks, wire)
    return calibrated(drive_through(world, plant, commands, wire.tick_period_us))


def write_case(
    cause: str, seed: int, folder: Path, *, kind: str = "calibration", noise: str = "white"
) -> dict[str, Any]:
    """Write one case; return the truth, measured from the engine's state."""
    folder.mkdir(parents=True)
    wire, plant = load_wire(), load_robot(None).plant
    nominal, world = world_with(cause, seed)
    described = calibrate(nominal, plant, wire)
    text = _ROBOT_TEXT.format(radius_m=described.radius_m, wheelbase_m=described.wheelbase_m)
    (folder / ROBOT).write_text(text, encoding="ascii")
    robot: Robot = load_robot(folder / ROBOT)
    draw = np.random.default_rng([seed, 2])
    scenario = gentle_drive(kind, [seed, 3], nominal, robot.plant, wire)
    engine = Engine(world)
    (run,) = run_with_effects(scenario, robot, wire, [((), seed)], simulator=engine)
    write_log(folder / LOG, run, robot, wire)
    reference = measured(run, draw_levels(noise, draw), draw, seed)
    (folder / REFERENCE).write_text("".join(tum_lines(reference)), encoding="ascii")
    assert engine.driven is not None  # it was driven just now
    return {"cause": cause, "seed": seed, "drive": kind, "noise": noise} | {
        "truth": truth_of(engine.driven, world, described)
    }


def main(arguments: Sequence[str]) -> int:
    """Write the cases that are asked for; all causes by default."""
    parser = argparse.ArgumentParser(prog="mujoco_cases", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("causes", nargs="*", metavar="CAUSE", default=list(CAUSES))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--drive", choices=(*FAMILIAR, *NEW), default="calibration")
    given = parser.parse_args(arguments)
    for cause in given.causes:
        name = f"{cause}-{given.seed}"
        truth = write_case(cause, given.seed, given.out / name, kind=given.drive)
        (given.out / "truth").mkdir(exist_ok=True)
        text = json.dumps(truth, indent=1) + "\n"
        (given.out / "truth" / f"{name}.json").write_text(text, encoding="ascii")
        print(name, {key: round(value, 6) for key, value in truth["truth"].items()}, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
