"""`chiplog export-c`: the firmware's kernel as C99, configured for a robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chiplog.commands.options import DbcOption, ForceOption, RobotOption, SignalsOption
from chiplog.errors import CommandError

if TYPE_CHECKING:
    from firmware_model import KernelConfig
    from hil_harness.robot import Robot


def command(
    robot: RobotOption = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where the files go.")] = Path(
        "firmware_c"
    ),
    dbc: DbcOption = None,
    signals: SignalsOption = None,
    force: ForceOption = False,
) -> None:
    """Write the dead-reckoning kernel as C99, with the robot's constants, formats and table.

    Writes chiplog_firmware.h, chiplog_firmware.c and chiplog_config.h to a folder. Built with any
    C99 compiler they give the same integers, bit for bit, as the firmware in `chiplog run`. Mission
    and tick are those of [design] in robot.toml; a position that does not hold the mission is
    refused.
    """
    from chiplog.commands.kernel_config import kernel_config, wheel_rounding_ticks
    from chiplog.terminal import show_line
    from firmware_model.c99_export import export_files
    from hil_harness.errors import HarnessError
    from hil_harness.robot import load_robot

    described = load_robot(robot)
    proved, forced = None, ""
    try:
        config = kernel_config(described, dbc, signals)
        rounding_ticks = wheel_rounding_ticks(described, dbc, signals)
        proved = proved_mission(described, config, rounding_ticks)
    except HarnessError as error:
        if not force:
            raise
        config, forced = kernel_config(described, dbc, signals, force=True), str(error)
        if config.beyond_c:
            raise  # no force makes C hold it
    texts = export_files(config, described.name, proved)
    write_files(out, texts)
    show_line(f"wrote {', '.join(texts)} to {out}")
    if forced:
        show_line(f"by force, although {forced}; the state's overflow_count counts overflows")


def proved_mission(robot: Robot, config: KernelConfig, rounding_ticks: float) -> str:
    """Return the mission of [design], in words; raises HarnessError where x and y do not hold it.

    What is held against the word is the bound of `chiplog ranges`.
    """
    from firmware_model import FirmwareError
    from hil_harness.errors import HarnessError
    from precision_study.ranges import envelope_of, trembling, way
    from precision_study.ranges.reach import require_mission_fits

    envelope = envelope_of(robot, config, rounding_ticks=rounding_ticks)
    mission = way(config, envelope)
    try:
        require_mission_fits(config, envelope, mission)
    except FirmwareError as error:
        message = f"{error}, or less in [design]"
        raise HarnessError(f"{robot.where(message)}: {message}") from error
    return f"{mission}, {trembling(robot, envelope)}"


def write_files(folder: Path, texts: dict[str, str]) -> None:
    """Write the files to *folder*, made if need be.

    Raises CommandError, and writes nothing, where a file differs that this command cannot have
    written as it is.
    """
    from firmware_model.c99_export import MARK

    if folder.exists() and not folder.is_dir():
        raise CommandError(f"{folder}: is a file; expected a folder, which may not exist yet")
    for name, text in texts.items():
        target = folder / name
        if not target.exists() and not target.is_symlink():
            continue
        found = target.read_bytes()
        if found != text.encode() and not found.startswith(MARK.encode()):
            raise CommandError(
                f"{target}: exists already and differs from what would be written; "
                "choose another folder or move it away"
            )
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
