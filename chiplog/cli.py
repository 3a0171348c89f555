"""The command line: one module per subcommand, every known error one line, exit status a contract.

Exit status: 0 done; 1 done and the answer to what was asked is no; 2 bad usage or bad input, one
line on stderr; 130 on Ctrl-C.
"""

from __future__ import annotations

import io
import os
import sys
import traceback
from collections.abc import Sequence
from enum import IntEnum
from functools import cache
from typing import Annotated

import typer

from chiplog.commands import (
    blind,
    busload,
    demo,
    diagnose,
    doctor,
    effects,
    encode,
    export,
    export_c,
    init,
    laws,
    node,
    ranges,
    replay,
    run,
    schema,
    study,
)
from chiplog.commands import map as map_command
from chiplog.errors import CommandError, describe, one_line


class Status(IntEnum):
    """What the shell gets; scripts rely on it."""

    DONE = 0
    ANSWER_IS_NO = 1
    BAD_INPUT = 2
    INTERRUPTED = 130


app = typer.Typer(
    name="chiplog",
    help="Dead reckoning without hardware: fixed-point odometry firmware, a simulated robot, "
    "and the CAN bus between them.",
    # Plain help: aligned, greppable, and without the import of rich.
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)


@app.callback(invoke_without_command=True)
def _chiplog(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
    debug: Annotated[
        bool,
        typer.Option("--debug", help="On an error, print the traceback too (works anywhere)."),
    ] = False,
) -> None:
    del debug  # main() takes it out of the arguments, so that it works after a command as well
    if version:
        from importlib.metadata import version as installed

        typer.echo(f"chiplog {installed('chiplog')}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


for name, function, summary in (
    ("run", run.command, "Run a scenario: robot, CAN bus and firmware."),
    ("init", init.command, "Write a robot, a map, a scenario and a test to start from."),
    ("node", node.command, "Run plant or firmware as a process of its own."),
    ("replay", replay.command, "Compare a log's odometry with the firmware model's, bit for bit."),
    ("diagnose", diagnose.command, "Say where real differs from simulated, and why."),
    ("demo", demo.command, "Diagnose a robot with a sealed effect, then open the seal."),
    ("map", map_command.command, "List a log's signals and propose which of them are what."),
    ("encode", encode.command, "Write a table's rows as a log of valid frames."),
    ("export", export.command, "Write a log's trajectories for ROS 2, Foxglove and evo."),
    ("export-c", export_c.command, "Write the firmware's kernel as C99, for a real controller."),
    ("ranges", ranges.command, "Say which of the firmware's words can overflow, with proof."),
    ("study", study.command, "Say what each bit buys: sweep formats, tables and rates."),
    ("busload", busload.command, "Say how busy the bus is, and how late a frame can be."),
    ("laws", laws.command, "Check the laws of dead reckoning, with pictures."),
    ("effects", effects.command, "List what can make a real robot differ."),
    ("schema", schema.command, "Print the JSON schema of a file we read or write."),
    ("doctor", doctor.command, "Say what this machine has, and what is missing."),
):
    app.command(name, short_help=summary)(function)
app.add_typer(blind.app, name="blind", short_help="Trials on data whose effect is sealed.")

_parser_of = cache(typer.main.get_command)
"""Takes longer than most commands that fail: a process that runs several makes it once."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line on `arguments` (default: the process's own); return the exit status."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without µ shows ?, and goes on
    try:
        _run([word for word in given if word != "--debug"])
        sys.stdout.flush()
    except typer.Exit as stop:
        return stop.exit_code
    except BrokenPipeError:
        return _reader_went_away()
    except (KeyboardInterrupt, typer.Abort):
        _say("interrupted")
        return Status.INTERRUPTED
    except Exception as error:
        if debug:
            traceback.print_exc()
        line = describe(error)
        if line is None:
            line = f"internal error, please report it: {type(error).__name__}: {error}"
            line += "" if debug else " (--debug shows where)"
        _say(line)
        return Status.BAD_INPUT
    return Status.DONE


def _run(arguments: list[str]) -> None:
    """Parse and run one command; whatever goes wrong is raised, nothing is printed about it."""
    if "_CHIPLOG_COMPLETE" in os.environ:
        app(prog_name="chiplog")  # the shell asks for completions: answers, and exits
    _refuse_empty_words(arguments)
    parser = _parser_of(app)
    with parser.make_context("chiplog", arguments) as context:
        parser.invoke(context)


def _refuse_empty_words(arguments: Sequence[str]) -> None:
    """An unset shell variable leaves an empty word, which as a path would mean this folder."""
    for place, word in enumerate(arguments):
        option, equals, value = word.partition("=")
        if not word:
            before = f" after {arguments[place - 1]}" if place else ""
            raise CommandError(f"empty word ''{before}: expected a name or a value")
        if option.startswith("--") and equals and not value:
            raise CommandError(f"empty word '' after {option}: expected a name or a value")


def _say(line: str) -> None:
    print(f"chiplog: {one_line(line)}", file=sys.stderr)


def _reader_went_away() -> int:
    """`chiplog effects | head` is no error: keep Python from complaining when it closes stdout."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return Status.DONE
