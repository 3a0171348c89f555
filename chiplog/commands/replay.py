"""`chiplog replay`: the firmware model over a recorded log, against its odometry, bit for bit."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chiplog.commands.options import (
    DbcOption,
    ForceOption,
    JsonFileOption,
    RobotOption,
    SignalsOption,
)
from chiplog.commands.output import STANDARD_OUTPUT, write_json
from chiplog.pages import quantities as q

if TYPE_CHECKING:
    from hil_harness.replaying import ReplayResult

REPLAY_SCHEMA = 1


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
    force: ForceOption = False,
    json_file: JsonFileOption = None,
) -> None:
    """Run the firmware model over a recorded log and compare its odometry bit for bit.

    Exit status 1 if a field differs: tick, field and both raw values are printed.
    """
    from chiplog.terminal import show_line
    from hil_harness.assembly import load_wire
    from hil_harness.replaying import replay
    from hil_harness.robot import load_robot

    result = replay(log, load_robot(robot), load_wire(dbc, signals), force=force)
    if json_file is not None:
        write_json(json_file, as_json(result))
    if json_file != STANDARD_OUTPUT:
        show_line(sentence(result))
    if not result.is_equal:
        raise typer.Exit(1)


def sentence(result: ReplayResult) -> str:
    """Return the outcome in words."""
    difference = result.first_difference
    overflows = result.state["overflow_count"]
    more = f"; {q.overflows(overflows)}" if overflows else ""
    if result.missing:
        names = ", ".join(result.missing)
        more += f"; nothing of {names} to compare: the log has no such frames"
    if difference is None:
        return (
            f"equal, bit for bit: {q.count(result.fields)} raw values in "
            f"{q.count(result.ticks)} ticks{more}"
        )
    logged, computed = map(_raw, (difference.logged_raw, difference.computed_raw))
    return (
        f"differs at tick {difference.tick}: {difference.field} is {logged} in the log, "
        f"{computed} in the replay{more}"
    )


def as_json(result: ReplayResult) -> dict[str, Any]:
    """Return the outcome as `--json` writes it."""
    content = asdict(result)
    content["log"] = str(result.log)
    return {"schema": REPLAY_SCHEMA, "equal": result.is_equal, **content}


def _raw(value: float | None) -> str:
    return "missing" if value is None else str(value)
