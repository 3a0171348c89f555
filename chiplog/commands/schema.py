"""`chiplog schema`: the JSON schema of a file we read or write."""

from __future__ import annotations

import json
from enum import StrEnum
from typing import Annotated

import typer


class Subject(StrEnum):
    """What there is a schema of."""

    ROBOT = "robot"


def command(
    subject: Annotated[
        Subject, typer.Argument(metavar="SUBJECT", help="robot: the tables of robot.toml.")
    ],
) -> None:
    """Print the JSON schema of robot.toml, for editors and checkers."""
    from hil_harness.robot import robot_schema

    schemas = {Subject.ROBOT: robot_schema}
    typer.echo(json.dumps(schemas[subject](), indent=2, ensure_ascii=False))
