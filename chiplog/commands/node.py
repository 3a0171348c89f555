"""`chiplog node`: plant or firmware alone, in real time, on a bus that connects processes."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from chiplog.commands.options import (
    ChannelOption,
)


class Role(StrEnum):
    """Which of the two nodes."""

    PLANT = "plant"
    FIRMWARE = "firmware"


def command(
    role: Annotated[Role, typer.Argument(metavar="ROLE", help="plant or firmware.")],
    interface: Annotated[str, typer.Option("--interface", help="python-can interface.")],
    channel: ChannelOption = None,
) -> None:
    """Run the plant or the firmware as a process of its own, in real time."""
