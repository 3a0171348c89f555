"""Dead reckoning without hardware: what a program imports from Chiplog.

Names are looked up when first used: `import chiplog` itself loads nothing heavy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from can_bus import load_database, read_log
    from chiplog.regression import assert_gap_below
    from hil_harness.assembly import RunConfig
    from hil_harness.effects import catalogue, parse_effect
    from hil_harness.replaying import replay
    from hil_harness.results import RunResult
    from hil_harness.rig import Rig
    from hil_harness.robot import Robot, load_robot
    from hil_harness.running import run
    from hil_harness.scenarios import Scenario, scenario

__all__ = [
    "Rig",
    "Robot",
    "RunConfig",
    "RunResult",
    "Scenario",
    "assert_gap_below",
    "catalogue",
    "load_database",
    "load_robot",
    "parse_effect",
    "read_log",
    "replay",
    "run",
    "scenario",
]

_HOMES = {
    "Rig": "hil_harness.rig",
    "Robot": "hil_harness.robot",
    "RunConfig": "hil_harness.assembly",
    "RunResult": "hil_harness.results",
    "Scenario": "hil_harness.scenarios",
    "assert_gap_below": "chiplog.regression",
    "catalogue": "hil_harness.effects",
    "load_database": "can_bus",
    "load_robot": "hil_harness.robot",
    "parse_effect": "hil_harness.effects",
    "read_log": "can_bus",
    "replay": "hil_harness.replaying",
    "run": "hil_harness.running",
    "scenario": "hil_harness.scenarios",
}


def __getattr__(name: str) -> Any:
    """Import a public name from its home; raises AttributeError for any other."""
    if name not in _HOMES:
        raise AttributeError(f"module 'chiplog' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
