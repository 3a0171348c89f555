"""`chiplog encode`: a table of anyone's simulator as a log of valid frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from chiplog.commands.options import DbcOption, RobotOption, SignalsOption


def command(
    table: Annotated[
        Path,
        typer.Argument(
            metavar="TABLE", help="Rows of ticks: .csv or .parquet with the columns' plain names."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", help="Log to write: .log, .asc or .blf.")],
    robot: RobotOption = None,
    dbc: DbcOption = None,
    signals: SignalsOption = None,
) -> None:
    """Write the frames that a table's rows would have been on the bus, with counters and CRCs.

    Columns: t_s and ecu_t_s (one of them), left_ticks, right_ticks, and any of gyro_code,
    temperature_code, supply_code, v_command_m_s, w_command_rad_s, odom_x_m, odom_y_m,
    odom_heading_rad. An empty cell is sent as not available (SNA).
    """
    from chiplog.pages import quantities as q
    from chiplog.terminal import show_line
    from gap_diagnosis.reading.encode import encode_table
    from hil_harness.assembly import load_wire
    from hil_harness.robot import load_robot

    encoded = encode_table(table, out, load_robot(robot), load_wire(dbc, signals))
    frames = sum(encoded.frames.values())
    show_line(f"{out}: {q.count(frames)} frames of {q.count(encoded.ticks)} ticks")
    if encoded.left_out:
        show_line(f"left out, without a column: {', '.join(encoded.left_out)}")
    if encoded.not_available:
        show_line(f"sent as not available, without a column: {', '.join(encoded.not_available)}")
    for message, changes in encoded.untold.items():
        show_line(
            f"{message} goes out at its cycle: {q.count(changes)} changes between its frames are "
            "not in the log; a robot that was told them does otherwise"
        )
