"""`chiplog schema`: the JSON schema of a file we read or write."""

from __future__ import annotations

import json
from enum import StrEnum
from typing import Annotated, Any

import typer


class Subject(StrEnum):
    """What there is a schema of."""

    ROBOT = "robot"
    DIAGNOSIS = "diagnosis"


def command(
    subject: Annotated[
        Subject,
        typer.Argument(
            metavar="SUBJECT",
            help="robot: the tables of robot.toml; diagnosis: OUT.json of `chiplog diagnose`.",
        ),
    ],
) -> None:
    """Print the JSON schema of a file that Chiplog reads or writes, for editors and checkers."""
    typer.echo(json.dumps(_schema(subject), indent=2, ensure_ascii=False))


def _schema(subject: Subject) -> dict[str, Any]:
    if subject == Subject.ROBOT:
        from hil_harness.robot import robot_schema

        return robot_schema()
    from gap_diagnosis.result import diagnosis_schema

    return diagnosis_schema()
