"""The kernel's integers for a command that needs a robot and no bus."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from firmware_model import KernelConfig
    from hil_harness.robot import Robot


def kernel_config(
    robot: Robot, dbc: Path | None, signals: Path | None, *, force: bool = False
) -> KernelConfig:
    """Return what the robot's firmware is built with: the tick of its [design], or the DBC's.

    Raises HarnessError for formats that do not fit, unless *force* takes those that overflow, and
    for a DBC that was named and has another tick than [design].
    """
    from hil_harness.assembly import load_wire
    from hil_harness.nodes.firmware import firmware_config

    wire = load_wire(dbc, signals)
    tick_period_us = robot.design.tick_period_us or wire.tick_period_us
    if dbc is not None:
        robot.require_tick(wire.tick_period_us, wire.database.path.name)
    return firmware_config(robot, wire.signal_map, tick_period_us, allow_overflow=force)


def wheel_rounding_ticks(robot: Robot, dbc: Path | None, signals: Path | None) -> float:
    """Return by how much the bus rounds a wheel's count; 0 where it carries counts."""
    from hil_harness.assembly import load_wire
    from hil_harness.wheel_counter import rounding_ticks

    wheels = [load_wire(dbc, signals).signal_map[name] for name in ("left_count", "right_count")]
    return max(rounding_ticks(one, robot.plant) for one in wheels)
