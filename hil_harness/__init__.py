"""The loop: robot description, scenarios, effects, nodes, lockstep, real time, batch.

Names are loaded when they are first used: a command that lists effects should not wait for numba.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hil_harness.assembly import RunConfig, Wire, load_wire
    from hil_harness.batch import BatchResult, run_scenario_batch, simulate_batch
    from hil_harness.effects import (
        EffectSetting,
        apply_effects,
        catalogue,
        load_effects,
        parse_effect,
    )
    from hil_harness.errors import HarnessError
    from hil_harness.lockstep import Lockstep
    from hil_harness.nodes import FirmwareNode, Node, PlantNode
    from hil_harness.replaying import ReplayResult, replay
    from hil_harness.restbus import RestBus
    from hil_harness.results import RunResult
    from hil_harness.rig import Rig
    from hil_harness.robot import Robot, load_robot
    from hil_harness.running import run
    from hil_harness.scenarios import Scenario, load_scenario, scenario
    from hil_harness.signal_map import SignalMap, default_map, load_map
    from hil_harness.standalone import run_firmware_alone, run_plant_alone

_HOMES = {
    "assembly": ("RunConfig", "Wire", "load_wire"),
    "batch": ("BatchResult", "run_scenario_batch", "simulate_batch"),
    "effects": ("EffectSetting", "apply_effects", "catalogue", "load_effects", "parse_effect"),
    "errors": ("HarnessError",),
    "lockstep": ("Lockstep",),
    "nodes": ("FirmwareNode", "Node", "PlantNode"),
    "replaying": ("ReplayResult", "replay"),
    "restbus": ("RestBus",),
    "results": ("RunResult",),
    "rig": ("Rig",),
    "robot": ("Robot", "load_robot"),
    "running": ("run",),
    "scenarios": ("Scenario", "load_scenario", "scenario"),
    "signal_map": ("SignalMap", "default_map", "load_map"),
    "standalone": ("run_firmware_alone", "run_plant_alone"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "BatchResult",
    "EffectSetting",
    "FirmwareNode",
    "HarnessError",
    "Lockstep",
    "Node",
    "PlantNode",
    "ReplayResult",
    "RestBus",
    "Rig",
    "Robot",
    "RunConfig",
    "RunResult",
    "Scenario",
    "SignalMap",
    "Wire",
    "apply_effects",
    "catalogue",
    "default_map",
    "load_effects",
    "load_map",
    "load_robot",
    "load_scenario",
    "load_wire",
    "parse_effect",
    "replay",
    "run",
    "run_firmware_alone",
    "run_plant_alone",
    "run_scenario_batch",
    "scenario",
    "simulate_batch",
]


def __getattr__(name: str) -> object:
    """Load a public name from its module."""
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{home}"), name)
