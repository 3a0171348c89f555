"""From what a user asks for to the parts of a run: the wire, the commands, the plant node."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from can.interfaces.udp_multicast import UdpMulticastBus
from numpy.typing import NDArray

from can_bus import CanBusError, Database, MessageSpec, check_interface, load_database
from firmware_model.kernel import Implementation
from hil_harness.effects import Effect, EffectSetting, Settings, apply_effects, combine_effects
from hil_harness.errors import HarnessError
from hil_harness.lockstep import LOCKSTEP_INTERFACES, unique_channel
from hil_harness.nodes import PlantNode
from hil_harness.nodes.schedule import cycle_of
from hil_harness.robot import Robot
from hil_harness.scenarios import Scenario
from hil_harness.signal_map import SignalMap, default_map, load_map
from sim_plant import Plant

TimeBase = Literal["lockstep", "real"]

MAX_TICKS = 10_000_000
"""Longest run held in memory: 24 h at 100 Hz is 8.64 million ticks."""


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """One run, as a user asks for it. Raises HarnessError for what does not fit together.

    Attributes:
        scenario, robot: what is driven, and what drives.
        effects: on top of those that belong to the scenario; the later value wins.
        seed, duration_s: None takes the scenario's.
        time: None takes lockstep on interfaces with a simulated clock, real time on the rest.
        dbc, signals: a DBC other than the shipped one, and its map.
        device: firmware under test as `--device` takes it; None is the shipped firmware.
        log: file for what the firmware received and sent (.log, .asc or .blf by its name).
        send_reference: also send the truth as REFERENCE_POSE.
        known: the catalogue with a user's effects in it; None is Chiplog's.
        kernel: which of the equal kernels Chiplog's own firmware runs; None: compiled, or python
            for what C cannot hold.
        force: run formats whose words overflow in normal use, and count, and those that C cannot
            hold.
    """

    scenario: Scenario
    robot: Robot
    effects: tuple[EffectSetting, ...] = ()
    seed: int | None = None
    duration_s: float | None = None
    time: TimeBase | None = None
    interface: str = "virtual"
    channel: str | None = None
    bitrate: int | None = None
    bus_args: Mapping[str, str] = field(default_factory=dict)
    dbc: Path | None = None
    signals: Path | None = None
    device: str | None = None
    log: Path | None = None
    send_reference: bool = False
    known: Mapping[str, Effect] | None = None
    kernel: Implementation | None = None
    force: bool = False

    def __post_init__(self) -> None:
        """Check what belongs together."""
        if self.duration_s is not None and not 0 < self.duration_s < float("inf"):
            raise HarnessError(
                f"--duration-s {self.duration_s:g}: expected a positive number of seconds"
            )
        if self.time == "lockstep" and self.interface not in LOCKSTEP_INTERFACES:
            raise HarnessError(
                f"--time lockstep --interface {self.interface}: that bus has no simulated clock; "
                f"expected --interface {' or '.join(LOCKSTEP_INTERFACES)}, or --time real"
            )

        if self.time == "real" and self.interface == "chiplog":
            raise HarnessError(
                "--time real --interface chiplog: that bus has a clock of its own; expected "
                "--time lockstep, or another --interface"
            )

    @property
    def time_base(self) -> TimeBase:
        """Who moves the clock."""
        if self.time is not None:
            return self.time
        return "lockstep" if self.interface in LOCKSTEP_INTERFACES else "real"

    @property
    def seed_in_use(self) -> int:
        """The seed asked for, or the scenario's."""
        return self.scenario.seed if self.seed is None else self.seed

    @property
    def effects_in_use(self) -> tuple[EffectSetting, ...]:
        """The scenario's effects, overridden by those asked for."""
        return combine_effects(self.scenario.effects, self.effects, known=self.known)

    def settings(self) -> Settings:
        """Return what the effects add up to."""
        return apply_effects(self.effects_in_use, self.known)

    def tick_count(self, tick_period_us: int) -> int:
        """Return how many ticks the run lasts.

        Raises HarnessError for a run of no tick or of more than fit in memory.
        """
        if self.duration_s is None:
            ticks = self.scenario.tick_count(tick_period_us)
        else:
            ticks = round(self.duration_s * 1e6) // tick_period_us
        if not 1 <= ticks <= MAX_TICKS:
            raise HarnessError(
                f"a run of {ticks} ticks of {tick_period_us} µs: expected 1 to {MAX_TICKS}"
            )
        return ticks


@dataclass(frozen=True)
class Wire:
    """A DBC and what its signals mean."""

    database: Database
    signal_map: SignalMap

    @property
    def tick_period_us(self) -> int:
        """The tick period: the cycle of the left wheel's message."""
        return self.signal_map.tick_period_us

    def with_messages(self, specs: Mapping[str, MessageSpec]) -> Wire:
        """Return the wire with other *specs* of some messages, by name."""
        signals = {
            role: replace(one, message=specs.get(one.message.name, one.message))
            for role, one in self.signal_map.signals.items()
        }
        messages = {
            name: specs.get(name, message) for name, message in self.database.messages.items()
        }
        return Wire(
            replace(self.database, messages=MappingProxyType(messages)),
            replace(self.signal_map, signals=MappingProxyType(signals)),
        )


def load_wire(
    dbc: Path | None = None, signals: Path | None = None, *, leave_out_faulty: bool = False
) -> Wire:
    """Load a DBC (None: the shipped one) and its map (None: names as in the shipped one).

    *leave_out_faulty* as in `load_database`.
    """
    database = load_database(dbc, leave_out_faulty=leave_out_faulty)
    return Wire(database, default_map(database) if signals is None else load_map(signals, database))


def commands_on_the_wire(scenario: Scenario, tick_count: int, wire: Wire) -> NDArray[np.float64]:
    """Return the command that drives the plant in each tick: float64[n, 2], v_m_s and w_rad_s.

    A command is what a command frame can carry, held until the next one; before the first the
    robot rests. A scenario with `per_tick_commands` drives with the rate at the start of each
    tick, at full precision; its command frames are samples of it.

    Raises HarnessError for a command that the frame cannot carry.
    """
    period_us = wire.tick_period_us
    v_signal, w_signal = wire.signal_map.get("v_command"), wire.signal_map.get("w_command")
    if scenario.per_tick_commands or v_signal is None or w_signal is None:
        return scenario.commands(tick_count, period_us)
    cycle = cycle_of(v_signal.message, period_us)
    phase = min(cycle.phase, tick_count)
    commands = np.zeros((tick_count, 2))
    commands[phase:] = scenario.commands(tick_count - phase, period_us, hold_ticks=cycle.every)
    for column, signal in ((0, v_signal), (1, w_signal)):
        values, index = np.unique(commands[:, column], return_inverse=True)
        try:
            carried = [signal.to_si(signal.to_raw(value)) for value in values.tolist()]
        except CanBusError as error:
            raise HarnessError(f"scenario {scenario.name}: {error}") from None
        commands[:, column] = np.array(carried)[index]
    return commands


def build_plant_node(
    config: RunConfig, wire: Wire, tick_count: int, *, keep_truth: bool = True
) -> PlantNode:
    """Return the plant of a run, driven by its scenario."""
    scenario, settings = config.scenario, config.settings()
    plant = Plant(
        config.robot.plant,
        settings.plant_over_time,
        tick_period_us=wire.tick_period_us,
        seed=config.seed_in_use,
        encoder_model=scenario.encoder_model,
        noise=scenario.noise,
        drive=scenario.drive,
    )
    return PlantNode(
        plant,
        config.robot.plant,
        database=wire.database,
        signal_map=wire.signal_map,
        tick_period_us=wire.tick_period_us,
        commands=commands_on_the_wire(scenario, tick_count, wire),
        send_reference=config.send_reference,
        keep_truth=keep_truth,
        mistakes=settings.setup,
    )


def default_channel(interface: str) -> str:
    """Return the channel where the user names none: one of our own, or python-can's own group.

    Raises HarnessError for an interface that has no such thing, CanBusError for an unknown one.
    """
    if interface in LOCKSTEP_INTERFACES:
        return unique_channel()
    if interface == "udp_multicast":
        return UdpMulticastBus.DEFAULT_GROUP_IPv4
    check_interface(interface)
    example = "vcan0" if interface == "socketcan" else "the name of your adapter's channel"
    raise HarnessError(f"--interface {interface} needs a channel: expected --channel {example}")
