"""`chiplog export`: a log's trajectories as files that ROS 2, Foxglove and evo read."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chiplog.commands.options import DbcOption, RobotOption, SignalsOption
from chiplog.errors import CommandError

if TYPE_CHECKING:
    from hil_harness.export import Trajectory

SUFFIXES = (".mcap", ".tum")
_MOST_NOISE_MM = 1000


class TrajectoryName(StrEnum):
    """What can be exported."""

    ODOMETRY = "odometry"
    FLOAT = "float"
    TRUTH = "truth"


def command(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG",
            help="What the firmware received and sent (candump, .asc, .blf, .mf4), or the folder "
            "of a run.",
        ),
    ],
    to: Annotated[
        Path,
        typer.Option(
            "--to", metavar="FILE", help="out.mcap for ROS 2 and Foxglove, out.tum for evo."
        ),
    ],
    trajectory: Annotated[
        TrajectoryName,
        typer.Option(
            "--trajectory",
            help="Which one, for .tum: what the log's frames state, the float twin on its counts, "
            "or the truth. An .mcap file has them all.",
        ),
    ] = TrajectoryName.ODOMETRY,
    truth: Annotated[
        Path | None,
        typer.Option(
            "--truth",
            metavar="FILE",
            help="The truth or a reference (.tum, .mcap, rosbag2); default: that of the run's "
            "folder.",
        ),
    ] = None,
    contact_noise_mm: Annotated[
        float,
        typer.Option(
            "--contact-noise-mm",
            help="Random error of each wheel after one metre, mm, for the covariances.",
        ),
    ] = 1.0,
    robot: RobotOption = None,
    dbc: DbcOption = None,
    signals: SignalsOption = None,
) -> None:
    """Write a log's odometry, float twin and truth as MCAP (ROS 2, Foxglove) or TUM (evo)."""
    from chiplog.run_folder import BUS_LOG, REFERENCE
    from chiplog.terminal import show_line
    from hil_harness.assembly import load_wire
    from hil_harness.export import logged_trajectories, tum_text, write_mcap
    from hil_harness.robot import load_robot

    if to.suffix.lower() not in SUFFIXES:
        raise CommandError(f"--to {to}: expected a file that ends in {' or '.join(SUFFIXES)}")
    if not 0 <= contact_noise_mm <= _MOST_NOISE_MM:
        raise CommandError(
            f"--contact-noise-mm {contact_noise_mm:g}: expected 0 to {_MOST_NOISE_MM}"
        )
    if log.is_dir():
        found = log / REFERENCE
        truth = found if truth is None and found.is_file() else truth
        log = log / BUS_LOG
    described = load_robot(robot)
    ways = list(
        logged_trajectories(log, described, load_wire(dbc, signals), contact_noise_mm * 1e-3)
    )
    if truth is not None:
        ways.append(_truth(truth, described.plant.wheels.wheelbase_m))
    if to.suffix.lower() == ".mcap":
        write_mcap(to, ways)
        show_line(f"{to}: {', '.join(way.name for way in ways)}, {len(ways[0].time_s)} poses")
        return
    chosen = next((way for way in ways if way.name == trajectory.value), None)
    if chosen is None:
        raise CommandError(f"{log}: there is no truth with it: expected --truth FILE")
    to.write_text(tum_text(chosen.time_s, chosen.poses), encoding="utf-8")
    show_line(f"{to}: {chosen.name}, {len(chosen.time_s)} poses")


def _truth(path: Path, wheelbase_m: float) -> Trajectory:
    import numpy as np

    from gap_diagnosis.reading.reference_file import read_reference
    from hil_harness.export import with_truth

    measured = read_reference(path)
    if measured.heading_rad is None:
        raise CommandError(f"{path}: positions without orientation: expected both for an export")
    poses = np.column_stack([measured.x_m, measured.y_m, measured.heading_rad])
    return with_truth(measured.t_s, poses, wheelbase_m)
