"""`chiplog node`: plant or firmware alone, in real time, on a bus that connects processes."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chiplog.commands.options import (
    BitrateOption,
    BusArgOption,
    ChannelOption,
    DbcOption,
    EffectLibraryOption,
    EffectOption,
    EffectsFileOption,
    JsonFileOption,
    KernelOption,
    RobotOption,
    SeedOption,
    SignalsOption,
    parse_bus_args,
)
from chiplog.errors import CommandError
from chiplog.pages import quantities as q
from chiplog.pages.outage_words import outage_clause

if TYPE_CHECKING:
    from hil_harness.assembly import RunConfig
    from hil_harness.standalone import NodeOutcome


_DEFAULT_SCENARIO = "lesson"


class Role(StrEnum):
    """Which of the two nodes."""

    PLANT = "plant"
    FIRMWARE = "firmware"


def command(
    role: Annotated[Role, typer.Argument(metavar="ROLE", help="plant or firmware.")],
    *,
    interface: Annotated[
        str,
        typer.Option(
            "--interface",
            help="python-can interface that connects processes: socketcan, udp_multicast or any "
            "hardware it knows.",
        ),
    ],
    channel: ChannelOption = None,
    bitrate: BitrateOption = None,
    bus_arg: BusArgOption = None,
    robot: RobotOption = None,
    dbc: DbcOption = None,
    signals: SignalsOption = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            "--scenario",
            help="What drives the plant, until a command frame takes over; default: lesson.",
        ),
    ] = None,
    effect: EffectOption = None,
    effects: EffectsFileOption = None,
    effect_library: EffectLibraryOption = None,
    seed: SeedOption = None,
    duration_s: Annotated[
        float | None,
        typer.Option(
            "--duration-s",
            help="Real time, s; default: the plant's scenario, the firmware until Ctrl-C.",
        ),
    ] = None,
    kernel: KernelOption = None,
    log: Annotated[
        Path | None,
        typer.Option("--log", help="Record what the node receives and sends (.log, .asc, .blf)."),
    ] = None,
    json: JsonFileOption = None,
) -> None:
    """Run the plant or the firmware as a process of its own, in real time.

    Start one of each on the same channel. The plant runs as long as its scenario; the firmware
    waits for the first sensor frame and runs until --duration-s or Ctrl-C. Scenario, effects and
    seed are the plant's. When the other one falls silent (killed, restarted, without power) that is
    said on standard error, and again when it is back.
    """
    if role is Role.FIRMWARE:
        _refuse_plant_options(
            {
                "--scenario": scenario,
                "--effect": effect,
                "--effects": effects,
                "--effect-library": effect_library,
                "--seed": seed,
            }
        )
    from chiplog.commands.output import write_json
    from chiplog.terminal import show_error, show_line
    from hil_harness.assembly import RunConfig
    from hil_harness.effects import load_effect_library, read_effects
    from hil_harness.robot import load_robot
    from hil_harness.scenarios import scenario as find_scenario
    from hil_harness.stopping import stoppable

    known = None if effect_library is None else load_effect_library(effect_library)
    config = RunConfig(
        scenario=find_scenario(scenario or _DEFAULT_SCENARIO, seed=seed),
        robot=load_robot(robot),
        effects=read_effects(effect or (), () if effects is None else (effects,), known),
        known=known,
        seed=seed,
        duration_s=duration_s,
        time="real",
        interface=interface,
        channel=channel,
        bitrate=bitrate,
        bus_args=parse_bus_args(bus_arg),
        dbc=dbc,
        signals=signals,
        log=log,
        kernel=None if kernel is None else kernel.value,
    )
    with stoppable():
        outcome = run_node(role, config)
    show_line(sentence(role, outcome))
    if json is not None:
        write_json(json, outcome.summary(role.value))
    if outcome.interrupted:
        show_error(f"interrupted after {outcome.ticks} ticks")
        raise typer.Exit(130)


def _refuse_plant_options(options: Mapping[str, object]) -> None:
    given = [name for name, value in options.items() if value is not None and value != []]
    if given:
        raise CommandError(
            f"node firmware {given[0]}: scenario, effects and seed are the plant's; "
            "give them to chiplog node plant"
        )


def run_node(role: Role, config: RunConfig) -> NodeOutcome:
    """Run one node until its time is up or somebody stops it."""
    from chiplog.terminal import show_error, show_line
    from hil_harness.assembly import load_wire
    from hil_harness.standalone import run_firmware_alone, run_plant_alone

    if role is Role.PLANT:
        return run_plant_alone(config, show_error)
    ticks = None
    show_line(f"firmware: waiting for the first sensor frame on {config.interface}")
    if config.duration_s is not None:
        ticks = config.tick_count(load_wire(config.dbc, config.signals).tick_period_us)
    return run_firmware_alone(config, ticks=ticks, tell=show_error)


def sentence(role: Role, outcome: NodeOutcome) -> str:
    """Return how the node's life went: punctual or not, fed or not, and who was away."""
    timing = outcome.timing
    missed = f"{q.count(timing.missed_deadlines)} missed deadlines"
    done = f"{role}: {q.count(outcome.ticks)} ticks, {missed}"
    away = outage_clause(timing)
    if role is Role.PLANT:
        return (
            f"{done}, ticks started {timing.jitter_p50_us:.0f} µs late (median), "
            f"{timing.jitter_p99_us:.0f} µs (99 %), {timing.jitter_max_us:.0f} µs at most{away}"
        )
    refused = [
        f"{frames} {why.replace('_', ' ')}" for why, frames in outcome.rejected.items() if frames
    ]
    return (
        f"{done}, cycle {timing.jitter_p50_us:.0f} µs off (median), {timing.jitter_p99_us:.0f} µs "
        f"(99 %), {timing.jitter_max_us:.0f} µs at most; {q.count(outcome.starved_ticks)} ticks "
        f"without all sensor frames, {', '.join(refused) or 'none'} refused{away}"
        + (f"; {q.overflows(outcome.overflows)}" if outcome.overflows else "")
    )
