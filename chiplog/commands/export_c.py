"""`chiplog export-c`: the firmware's kernel as C99, configured for a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from chiplog.commands.options import DbcOption, ForceOption, RobotOption, SignalsOption
from chiplog.errors import CommandError


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
    C99 compiler they give the same integers, bit for bit, as the firmware in `chiplog run`.
    """
    from chiplog.terminal import show_line
    from firmware_model.c99_export import export_files
    from hil_harness.assembly import load_wire
    from hil_harness.errors import HarnessError
    from hil_harness.nodes.firmware import firmware_config
    from hil_harness.robot import load_robot

    described, wire = load_robot(robot), load_wire(dbc, signals)
    given = described, wire.signal_map, wire.tick_period_us
    forced = ""
    try:
        config = firmware_config(*given)
    except HarnessError as error:
        if not force:
            raise
        config, forced = firmware_config(*given, allow_overflow=True), str(error)
    texts = export_files(config, described.name)
    write_files(out, texts)
    show_line(f"wrote {', '.join(texts)} to {out}")
    if forced:
        show_line(f"by force, although {forced}; the state's overflow_count counts overflows")


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
