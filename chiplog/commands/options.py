"""Options that several commands share: one wording, one meaning."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from chiplog.errors import CommandError

IN_PROCESS_INTERFACES = ("virtual", "chiplog")

HIGHEST_BITRATE = 1_000_000
"""Of classic CAN (ISO 11898-1), bit/s."""


class KernelName(StrEnum):
    """The firmware's kernels, equal to the bit."""

    COMPILED = "compiled"
    PYTHON = "python"
    C99 = "c99"


def _check_bitrate(bitrate: int | None) -> int | None:
    if bitrate is not None and not 1 <= bitrate <= HIGHEST_BITRATE:
        raise CommandError(
            f"--bitrate {bitrate}: expected a whole number from 1 to {HIGHEST_BITRATE} [bit/s]"
        )
    return bitrate


RobotOption = Annotated[
    Path | None,
    typer.Option("--robot", help="Robot description (TOML); default: the lesson's robot."),
]
DbcOption = Annotated[
    Path | None,
    typer.Option("--dbc", help="Messages on the wire (DBC); default: chiplog.dbc."),
]
SignalsOption = Annotated[
    Path | None,
    typer.Option(
        "--signals", help="Which signal of your DBC plays which part (TOML); needed with --dbc."
    ),
]
EffectOption = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="NAME.PARAM=VALUE",
        help="Switch an effect on, as in gyro_bias.bias=0.005 (repeatable; `chiplog effects`).",
    ),
]
EffectsFileOption = Annotated[
    Path | None, typer.Option("--effects", help="Switch on the effects of a file (TOML).")
]
EffectLibraryOption = Annotated[
    Path | None,
    typer.Option(
        "--effect-library",
        metavar="FILE.py",
        help="Effects of your own beside Chiplog's (the file is run as Python).",
    ),
]
SeedOption = Annotated[
    int | None, typer.Option("--seed", help="Seed of all noise; default: the scenario's.")
]
DurationOption = Annotated[
    float | None,
    typer.Option("--duration-s", help="Simulated time, s; default: the scenario's."),
]
InterfaceOption = Annotated[
    str,
    typer.Option(
        "--interface",
        help="python-can interface: virtual, chiplog (simulated bit by bit), socketcan, "
        "udp_multicast or any other it knows.",
    ),
]
ChannelOption = Annotated[
    str | None,
    typer.Option("--channel", help="Channel of the interface, as in vcan0 or 239.74.163.2."),
]
BitrateOption = Annotated[
    int | None,
    typer.Option(
        "--bitrate",
        help=f"Bit rate, 1 to {HIGHEST_BITRATE} bit/s; default: the DBC's.",
        callback=_check_bitrate,
    ),
]
BusArgOption = Annotated[
    list[str] | None,
    typer.Option(
        "--bus-arg", metavar="KEY=VALUE", help="Further argument of the interface (repeatable)."
    ),
]
DeviceOption = Annotated[
    str | None,
    typer.Option(
        "--device",
        help="Firmware under test instead of ours: python:FILE.py:NAME, lib:FILE.so, "
        "process:COMMAND, or none (the ECU is on the bus already).",
    ),
]
ReferenceFramesOption = Annotated[
    bool,
    typer.Option(
        "--reference-frames", help="Put the truth on the bus too, as REFERENCE_POSE frames."
    ),
]
KernelOption = Annotated[
    KernelName | None,
    typer.Option(
        "--kernel",
        help="Which kernel Chiplog's firmware runs: machine code, the readable Python, or the C99 "
        "twin (needs a C compiler); all give the same bytes. Default: machine code, or Python for "
        "what C cannot hold.",
    ),
]
ForceOption = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Take firmware formats that overflow in normal use, that C cannot hold (these run in "
        "Python), and constants that round to zero; overflows are counted.",
    ),
]
JsonFileOption = Annotated[
    Path | None, typer.Option("--json", help="Write the result to this file as well.")
]


def parse_bus_args(pairs: Sequence[str] | None) -> dict[str, str]:
    """Return `KEY=VALUE` words as a mapping; raises CommandError for any other form."""
    parsed = {}
    for pair in pairs or ():
        key, equals, value = pair.partition("=")
        if not equals or not key.isidentifier():
            raise CommandError(
                f"--bus-arg {pair!r}: expected KEY=VALUE, for example interface_ip=127.0.0.1"
            )
        parsed[key] = value
    return parsed
