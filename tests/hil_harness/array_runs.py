"""The shortest way to a run over arrays with some effects on."""

from dataclasses import replace
from functools import cache

from firmware_model import FirmwareDescription
from hil_harness.assembly import Wire, load_wire
from hil_harness.effect_runs import EffectRun, run_with_effects
from hil_harness.effects import combine_effects, parse_effect
from hil_harness.robot import Robot, load_robot
from hil_harness.scenarios import scenario as find_scenario

TICK_S = 0.01


@cache
def wire() -> Wire:
    return load_wire()


def robot(**firmware: object) -> Robot:
    """Return the shipped robot, some of its firmware's fields replaced."""
    shipped = load_robot()
    tables = shipped.firmware.model_dump()
    for name, value in firmware.items():
        tables[name] = tables[name] | value if isinstance(value, dict) else value
    return replace(shipped, firmware=FirmwareDescription.from_table(tables))


def drive_once(
    *effects: str,
    scenario: str = "stop_and_go",
    ticks: int = 800,
    seed: int = 3,
    of: Robot | None = None,
) -> EffectRun:
    """Run a scenario with effects as the command line takes them."""
    settings = combine_effects(parse_effect(text) for text in effects)
    cases = [(settings, seed)]
    return run_with_effects(find_scenario(scenario), of or robot(), wire(), cases, ticks=ticks)[0]
