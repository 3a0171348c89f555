"""The page of commands and options, from the program's own help."""

from __future__ import annotations

from typing import Any

import typer

from chiplog.cli import app
from generator.tables import table


def command_line() -> str:
    """Return the page of commands and options, from the program's own help."""
    program = typer.main.get_command(app)
    context = program.make_context("chiplog", [], resilient_parsing=True)
    commands = {name: program.get_command(context, name) for name in program.list_commands(context)}
    parts = [
        "# Command line",
        table(
            ["command", "what it does"],
            [[f"[`{n}`](#chiplog-{n})", c.get_short_help_str(120)] for n, c in commands.items()],
        ),
        "`chiplog --version` prints the version. `--debug`, anywhere, adds the traceback to an "
        "error.",
        "## Exit status",
        table(
            ["status", "meaning"],
            [
                [0, "done"],
                [1, "done, and the answer is no: a replay that differs, a law violated"],
                [2, "bad usage or bad input: one line on stderr says what, where and what to do"],
                [130, "interrupted by Ctrl-C; what was recorded so far is complete and readable"],
            ],
        ),
        "The lines of status 2 are listed under [errors](errors.md).",
    ]
    for name, command in _leaves(commands, context).items():
        parts += [f"## chiplog {name}", _plain(command.help or "")]
        rows = [_option(parameter, context) for parameter in command.params]
        parts.append(table(["argument", "meaning", "default"], [row for row in rows if row]))
    return "\n\n".join(part.strip() for part in parts)


def _leaves(commands: dict[str, Any], context: Any) -> dict[str, Any]:
    """Return the commands with those of a group in the group's place."""
    found: dict[str, Any] = {}
    for name, command in commands.items():
        found[name] = command
        for inner in getattr(command, "commands", {}):
            found[f"{name} {inner}"] = command.get_command(context, inner)
    return found


def _option(parameter: Any, context: Any) -> list[str] | None:
    if parameter.name == "help":
        return None
    record = parameter.get_help_record(context)
    if record is None:
        words = getattr(parameter, "help", "") or ""
        return [f"`{parameter.make_metavar(context)}`", _plain(words), ""]
    return [
        f"`{record[0]}`",
        _plain(getattr(parameter, "help", "") or ""),
        f"`{parameter.default}`" if isinstance(parameter.default, str | int | float) else "",
    ]


def _plain(text: str) -> str:
    return " ".join(text.split())
