"""Errors are for people: every known error as one line, and nothing else hidden."""

from __future__ import annotations

import re
from difflib import get_close_matches

import typer

_KNOWN = (
    "can_bus",
    "firmware_model",
    "sim_plant",
    "hil_harness",
    "gap_diagnosis",
    "precision_study",
)
_ERROR_BASES = (
    *("CanBusError", "FirmwareError", "PlantError", "HarnessError", "DiagnosisError"),
    "StudyError",
)


class CommandError(ValueError):
    """Bad usage or bad input found by a command itself; `str(error)` is the one line."""


def describe(error: BaseException) -> str | None:
    """Return the one line that tells a user about `error`, or None if it is a bug of ours.

    Known are usage errors, the errors of the rooms, and operating system errors that name a
    file or an address.
    """
    if isinstance(error, typer.TyperException):
        return _usage_line(error)
    if isinstance(error, CommandError) or _is_from_a_room(error):
        return one_line(str(error))
    if isinstance(error, OSError) and error.strerror:
        named = f"{error.filename}: " if error.filename is not None else ""
        return one_line(f"{named}{error.strerror[:1].lower()}{error.strerror[1:]}")
    return None


def one_line(text: str) -> str:
    """Return `text` with every run of white space, line ends included, as one space.

    Control characters from a stranger's file would speak to the terminal: they are shown escaped.
    """
    collapsed = " ".join(text.split())
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in collapsed)


def suggestion(word: str, known: list[str]) -> str:
    """Return `; did you mean …?` for the nearest of `known`, or an empty string."""
    near = get_close_matches(word, known, n=1, cutoff=0.5)
    return f"; did you mean {near[0]}?" if near else ""


def _is_from_a_room(error: BaseException) -> bool:
    """Whether `error` derives from the base class of a room.

    Asked by name: importing a room to ask its class would load what the command never needed.
    """
    return any(
        base.__name__ in _ERROR_BASES and base.__module__.partition(".")[0] in _KNOWN
        for base in type(error).__mro__
    )


_EXPECTED = {"int_parsing": "a whole number", "float_parsing": "a number"}


def _usage_line(error: typer.TyperException) -> str:
    """Rewrite the parser's message in our form: what was wrong, what would be right."""
    context = getattr(error, "ctx", None)
    command = context.command_path if context is not None else "chiplog"
    message = _unknown_option(error) or _bad_value(error) or _other_usage(error)
    return one_line(f"{message} (see {command} --help)")


def _unknown_option(error: typer.TyperException) -> str | None:
    option, near = getattr(error, "option_name", None), getattr(error, "possibilities", None)
    if option is None or near is None:
        return None
    return f"no such option {option}" + (f"; did you mean {near[0]}?" if near else "")


def _bad_value(error: typer.TyperException) -> str | None:
    """Say which value of which option is wrong: the parser's validator knows both."""
    findings = getattr(error.__cause__, "errors", None)
    if findings is None or not isinstance(error, typer.BadParameter) or error.param is None:
        return None
    finding = findings()[0]
    options = (word for word in error.param.opts if word.startswith("--"))
    name = next(options, error.param.metavar or error.param.name)
    choices = re.search(r"is not one of (.+)$", finding["msg"])
    if choices is not None:
        expected = "one of " + choices[1].rstrip(".").replace("'", "")
    else:
        expected = _EXPECTED.get(finding["type"], finding["msg"])
    return f"{name} {finding['input']!r}: expected {expected}"


def _other_usage(error: typer.TyperException) -> str:
    message = one_line(error.format_message()).rstrip(".")
    message = message.replace(". Did you mean", "; did you mean").replace(". Choose", "; choose")
    message = re.sub(r"Got unexpected extra arguments? ?\(?s?\)? ", "unexpected argument ", message)
    return message[:1].lower() + message[1:]
