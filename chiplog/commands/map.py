"""`chiplog map`: what is in a log or table, and a proposal of what it is to the robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from chiplog.commands.options import DbcOption
from chiplog.errors import CommandError

if TYPE_CHECKING:
    from gap_diagnosis.reading.evidence import Guess
    from gap_diagnosis.reading.signals_found import FoundSignal


def command(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A log, or a table (.csv, .parquet).")],
    dbc: DbcOption = None,
    out: Annotated[
        Path | None, typer.Option("--out", help="Write the proposed map (TOML) to this file.")
    ] = None,
    known: Annotated[
        list[str] | None,
        typer.Option(
            "--is",
            metavar="ROLE=SIGNAL",
            help="What you know, as in left_count=WHEELS.a (repeatable).",
        ),
    ] = None,
) -> None:
    """List a log's signals with rate, range and unit, and propose which of them are what.

    Each guess is marked in the map. Where two signals could be the same thing with equal right, it
    says which two, and stops: --is decides.
    """
    from can_bus import load_database
    from chiplog.terminal import show_line, show_table
    from gap_diagnosis.errors import DiagnosisError
    from gap_diagnosis.reading.left_out import faulty_messages, left_out
    from gap_diagnosis.reading.map_text import propose_map, signals_of
    from gap_diagnosis.reading.table_file import is_table

    given = parse_known(known or [])
    if out is not None and out.exists():
        raise CommandError(f"{out} exists: expected a new file, or remove it first")
    database = None if is_table(log) else load_database(dbc, leave_out_faulty=True)
    try:
        found, guesses, text = propose_map(log, database, given)
    except DiagnosisError:
        # What there is to choose from; a log that cannot be read says so again here.
        show_table(HEAD, [_row(signal, {}) for signal in signals_of(log, database).values()])
        raise
    roles = {guess.signal.path: guess for guess in guesses.values()}
    show_table(HEAD, [_row(signal, roles) for signal in found.values()])
    for sentence in faulty_messages(database) if database is not None else ():
        show_line(sentence)
    if out is not None:
        out.write_text(text, encoding="utf-8")
        guessed = sum(not (guess.is_certain or guess.lacks_unit) for guess in guesses.values())
        check = f"; check the {guessed} marked GUESS" if guessed else ""
        bare = [guess.signal.path for guess in guesses.values() if guess.lacks_unit]
        units = f"; say the unit of {', '.join(bare)}" if bare else ""
        show_line(f"{out}: {len(guesses) - len(bare)} roles{check}{units}")
        for sentence in left_out(found, guesses, is_table=is_table(log)).values():
            show_line(sentence)
        for guess in guesses.values():
            if guess.invert:
                show_line(
                    f"{guess.signal.path} turns against the wheels: the map inverts it; without "
                    "invert = true the diagnosis calls it a wrong sign"
                )
    else:
        show_line("")
        for line in text.splitlines():
            show_line(line)


HEAD = ("signal", "is", "per s", "least", "most", "unit")


def parse_known(pairs: list[str]) -> dict[str, str]:
    """Return `ROLE=SIGNAL` words as a mapping; raises CommandError for any other form."""
    parsed = {}
    for pair in pairs:
        role, equals, signal = pair.partition("=")
        if not (equals and role and signal):
            raise CommandError(
                f"--is {pair!r}: expected ROLE=SIGNAL, for example left_count=WHEELS.a"
            )
        parsed[role] = signal
    return parsed


def _row(signal: FoundSignal, roles: dict[str, Guess]) -> tuple[str, ...]:
    guess = roles.get(signal.path)
    role = "" if guess is None else guess.role if guess.is_certain else f"{guess.role}?"
    return (
        signal.path,
        role,
        f"{signal.rate_hz:.4g}",
        f"{signal.low:.6g}",
        f"{signal.high:.6g}",
        signal.unit,
    )
