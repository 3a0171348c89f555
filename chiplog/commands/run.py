"""`chiplog run`: one scenario through plant, bus and firmware, and what came of it in a folder."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chiplog.commands.options import (
    BitrateOption,
    BusArgOption,
    ChannelOption,
    DbcOption,
    DeviceOption,
    DurationOption,
    EffectLibraryOption,
    EffectOption,
    EffectsFileOption,
    ForceOption,
    InterfaceOption,
    KernelOption,
    ReferenceFramesOption,
    RobotOption,
    SeedOption,
    SignalsOption,
    parse_bus_args,
)

if TYPE_CHECKING:
    from chiplog.run_folder import RunFolder
    from hil_harness.assembly import RunConfig
    from hil_harness.results import RunResult

QUIET = ("INITIALISED", "STANDSTILL", "OFFSET_VALID")
"""Status bits of normal operation: alone they make no timeline."""


class Time(StrEnum):
    """Who moves the clock."""

    LOCKSTEP = "lockstep"
    REAL = "real"


def command(
    *,
    scenario: Annotated[
        str,
        typer.Option(
            "--scenario",
            help="lesson, straight, square, square_cw, square_ccw, figure8, spin, stop_and_go, "
            "calibration, random, or a file (TOML).",
        ),
    ] = "lesson",
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="DIR", help="Where the files go; default: out/SCENARIO."),
    ] = None,
    robot: RobotOption = None,
    effect: EffectOption = None,
    effects: EffectsFileOption = None,
    effect_library: EffectLibraryOption = None,
    seed: SeedOption = None,
    duration_s: DurationOption = None,
    time: Annotated[
        Time | None,
        typer.Option(
            "--time",
            help="lockstep: simulated time, as fast as it goes (default on virtual); "
            "real: paced (default on the rest).",
        ),
    ] = None,
    interface: InterfaceOption = "virtual",
    channel: ChannelOption = None,
    bitrate: BitrateOption = None,
    bus_arg: BusArgOption = None,
    dbc: DbcOption = None,
    signals: SignalsOption = None,
    device: DeviceOption = None,
    kernel: KernelOption = None,
    force: ForceOption = False,
    reference_frames: ReferenceFramesOption = False,
) -> None:
    """Run a scenario: simulated robot, CAN bus and fixed-point firmware in one loop.

    Writes bus.log, reference.tum, state.json, summary.json and report.html to a folder.
    """
    from chiplog.run_folder import BUS_LOG, RunFolder
    from hil_harness.assembly import RunConfig
    from hil_harness.effects import load_effect_library, read_effects
    from hil_harness.robot import load_robot
    from hil_harness.scenarios import scenario as find_scenario

    found = find_scenario(scenario, seed=seed)
    known = None if effect_library is None else load_effect_library(effect_library)
    folder = RunFolder(out if out is not None else Path("out") / found.name)
    config = RunConfig(
        scenario=found,
        robot=load_robot(robot),
        effects=read_effects(effect or (), () if effects is None else (effects,), known),
        known=known,
        seed=seed,
        duration_s=duration_s,
        time=None if time is None else time.value,
        interface=interface,
        channel=channel,
        bitrate=bitrate,
        bus_args=parse_bus_args(bus_arg),
        dbc=dbc,
        signals=signals,
        device=device,
        kernel=None if kernel is None else kernel.value,
        force=force,
        send_reference=reference_frames,
        log=folder.file(BUS_LOG),
    )
    if execute(config, folder).interrupted:
        raise typer.Exit(130)


def execute(config: RunConfig, folder: RunFolder) -> RunResult:
    """Run, write the folder, print the outcome; a run cut short by Ctrl-C is written as well."""
    from chiplog.run_table import show_run
    from chiplog.terminal import progress, show_error
    from hil_harness.running import run
    from hil_harness.stopping import stoppable

    with (
        folder.recording(config.scenario.name, config.seed_in_use),
        stoppable(),
        progress(config.scenario.name, then="comparing") as report_progress,
    ):
        result = run(config, report_progress, show_error)
    folder.write(result)
    if result.interrupted:
        show_error(f"interrupted after {result.ticks} ticks; {folder.path} holds what ran")

    from chiplog.pages.report import report_page

    page = folder.write_report(report_page(result, status_bits=status_bits(), quiet=QUIET))
    show_run(result, page)
    return result


def status_bits() -> dict[str, int]:
    """Return the masks of the status word by name, in the order of the bits."""
    from firmware_model import StatusBit

    return {bit.name or str(bit.value): bit.value for bit in StatusBit}
