"""How a rig's parts come about: map, tick period, channel and plant."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from numbers import Integral, Real
from pathlib import Path
from typing import Final, NamedTuple

import can

from can_bus import IN_PROCESS_INTERFACES, Database
from firmware_model import KernelConfig
from hil_harness.assembly import Wire, commands_on_the_wire
from hil_harness.effects import (
    Settings,
    apply_effects,
    combine_effects,
    load_effect_library,
    read_effects,
)
from hil_harness.errors import HarnessError
from hil_harness.lockstep import unique_channel
from hil_harness.nodes import Node, PlantNode
from hil_harness.reach import require_drive_fits
from hil_harness.robot import Robot
from hil_harness.scenarios import scenario as find_scenario
from hil_harness.sensor_frames import SENSOR_ROLES
from hil_harness.signal_map import SignalMap, default_map, load_map
from hil_harness.signal_roles import Role
from sim_plant import Plant

COMMAND_ROLES: Final[tuple[Role, ...]] = ("v_command", "w_command")

_group_numbers = itertools.count()


@dataclass(frozen=True)
class RigPlant:
    """The robot of a rig.

    Attributes:
        node: what takes its turn on the bus.
        pose: returns the true (x_m, y_m, heading_rad); raises HarnessError if there is no robot.
        message_names: what the node sends, so that a rest bus leaves it alone.
        settings: what its effects add up to, those of bus and firmware included.
        require_fits: raises HarnessError for a firmware whose position does not hold the scenario;
            how far a test's own commands go is not known beforehand.
    """

    node: Node
    pose: Callable[[], tuple[float, float, float]]
    message_names: frozenset[str]
    settings: Settings = field(default_factory=Settings)
    require_fits: Callable[[KernelConfig], None] = lambda kernel: None


def no_plant() -> RigPlant:
    """Return the place of a plant, empty."""
    return RigPlant(_Silent(), _no_truth, frozenset())


def simulated_plant(
    robot: Robot,
    database: Database,
    signal_map: SignalMap,
    *,
    tick_period_us: int,
    scenario: str | Path | None,
    effects: GivenEffects,
    effect_library: str | Path | None = None,
    seed: int,
) -> RigPlant:
    """Return a simulated robot: driven by a scenario, or by the command frames of the test.

    Raises HarnessError or PlantError for a scenario, an effect, a library or a seed that does not
    exist.
    """
    drive = None if scenario is None else find_scenario(scenario, seed=seed)
    known = None if effect_library is None else load_effect_library(effect_library)
    settings = read_effects(effects.texts, effects.files, known)
    roles: tuple[Role, ...] = SENSOR_ROLES
    wire = Wire(database, signal_map)
    commands = None
    if drive is not None:
        settings = combine_effects(drive.effects, settings, known=known)
        roles += COMMAND_ROLES
        commands = commands_on_the_wire(drive, drive.tick_count(tick_period_us), wire)
    applied = apply_effects(settings, known)
    plant = Plant(
        robot.plant,
        applied.plant_over_time,
        tick_period_us=tick_period_us,
        seed=seed,
        encoder_model="counter" if drive is None else drive.encoder_model,
        noise="streams" if drive is None else drive.noise,
        drive="motor" if drive is None else drive.drive,
    )
    node = PlantNode(
        plant,
        robot.plant,
        database=database,
        signal_map=signal_map,
        tick_period_us=tick_period_us,
        commands=commands,
        mistakes=applied.setup,
    )
    names = frozenset(spec.name for spec in signal_map.messages(roles))

    def require_fits(kernel: KernelConfig) -> None:
        if drive is not None:
            ticks = drive.tick_count(tick_period_us)
            require_drive_fits(drive, robot, wire, kernel, ticks=ticks, settings=applied, seed=seed)

    return RigPlant(node, lambda: plant.pose, names, applied, require_fits)


class _Silent:
    def step(self, now_us: int, frames: Sequence[can.Message], /) -> Sequence[can.Message]:
        return ()


def _no_truth() -> tuple[float, float, float]:
    raise HarnessError("this rig has no plant (plant=False), so there is no truth")


def signal_map_of(
    signals: SignalMap | str | Path | None, database: Database, *, needed: bool
) -> SignalMap | None:
    """Return the map given, or that of the shipped names; None if there is none and none is needed.

    Raises HarnessError for a map that does not fit the DBC, or none where one is needed.
    """
    if isinstance(signals, SignalMap):
        return signals
    if signals is not None:
        return load_map(signals, database)
    try:
        return default_map(database)
    except HarnessError:
        if needed:
            raise
        return None


def tick_period_us_of(database: Database, signal_map: SignalMap | None) -> int:
    """Return the tick period: the map's, or without a map the shortest cycle time of the DBC.

    Raises HarnessError if the DBC has no cycle time at all.
    """
    if signal_map is not None:
        return signal_map.tick_period_us
    cycles_us = [spec.cycle_time_us for spec in database.messages.values() if spec.cycle_time_us]
    if not cycles_us:
        raise HarnessError(
            f"{database.path.name}: no message has a cycle time (GenMsgCycleTime), "
            "so there is nothing to step by"
        )
    return min(cycles_us)


def checked_seed(seed: object) -> int:
    """Return the seed. Raises HarnessError if it is no whole number from 0 on."""
    if isinstance(seed, bool) or not isinstance(seed, Integral) or seed < 0:
        raise HarnessError(f"seed = {seed!r}: expected a whole number, 0 or more")
    return int(seed)


class GivenEffects(NamedTuple):
    """The effects of a rig as they are given: texts as ``--effect`` takes them, and files."""

    texts: tuple[str, ...]
    files: tuple[Path, ...]


def given_effects(effects: object) -> GivenEffects:
    """Return the effects; a path, or a text that ends in ``.toml``, is a file.

    One alone need not stand in a list. Raises HarnessError for what is neither text nor path.
    """
    given = (effects,) if isinstance(effects, str | Path) else effects
    texts: list[str] = []
    files: list[Path] = []
    for one in given if isinstance(given, Iterable) else (None,):
        if isinstance(one, Path) or (isinstance(one, str) and one.endswith(".toml")):
            files.append(Path(one))
        elif isinstance(one, str):
            texts.append(one)
        else:
            raise HarnessError(
                f'effects = {effects!r}: expected texts such as "gyro_bias.bias=0.005", or files '
                'such as "explained.toml"'
            )
    return GivenEffects(tuple(texts), tuple(files))


def check_kind(name: str, value: object, kinds: tuple[type, ...], expected: str) -> None:
    """Raise HarnessError if a setting is of none of these kinds."""
    if not isinstance(value, kinds):
        raise HarnessError(f"{name} = {value!r}: expected {expected}")


def microseconds(duration_s: float, name: str) -> int:
    """Return a duration in whole microseconds. Raises HarnessError if it is none."""
    if isinstance(duration_s, bool) or not isinstance(duration_s, Real):
        raise HarnessError(f"{name} = {duration_s!r}: expected a number of seconds")
    if not (math.isfinite(duration_s) and duration_s >= 0):
        raise HarnessError(f"{name} = {duration_s}: expected seconds, 0 or more")
    return round(duration_s * 1e6)


def channel_for(interface: str, channel: str | None) -> str:
    """Return the channel given, or one that no other rig on this machine uses.

    Raises HarnessError for an interface whose channel only the user can know.
    """
    if channel is not None:
        return channel
    if interface in IN_PROCESS_INTERFACES:
        return unique_channel()
    if interface == "udp_multicast":
        # A group of local scope, from the numbers of this process and of the rig in it.
        process = os.getpid()
        return f"239.{192 + next(_group_numbers) % 64}.{process >> 8 & 0xFF}.{process & 0xFF}"
    raise HarnessError(f"interface {interface!r} needs a channel, for example vcan0 or can0")
