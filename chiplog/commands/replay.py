"""`chiplog replay`: the firmware model over a recorded log, against its odometry, bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from chiplog.commands.options import DbcOption, JsonFileOption, RobotOption, SignalsOption
from chiplog.commands.output import STANDARD_OUTPUT, write_json


def command(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG", help="What the firmware received and sent: candump, .asc or .blf."
        ),
    ],
    robot: RobotOption = None,
    dbc: DbcOption = None,
    signals: SignalsOption = None,
    json_file: JsonFileOption = None,
) -> None:
    """Run the firmware model over a recorded log and compare its odometry bit for bit.

    Exit status 1 if a field differs: tick, field and both raw values are printed.
    """
    from hil_harness.replay import replay

    from chiplog.terminal import show_line

    result = replay(log, robot_path=robot, database_path=dbc, signals_path=signals)
    if json_file is not None:
        write_json(json_file, result.as_json())
    if json_file != STANDARD_OUTPUT:
        show_line(result.sentence())
    if result.first_difference is not None:
        raise typer.Exit(1)
