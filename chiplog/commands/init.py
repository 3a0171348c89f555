"""`chiplog init`: a folder to start from, whose test passes as it is."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Annotated

import typer

from chiplog.errors import CommandError

# The commented default robot is the harness's own: one text, one place.
_SOURCES = {
    "robot.toml": ("hil_harness", "data/robot.toml"),
    "map.toml": ("chiplog", "templates/map.toml"),
    "two_arcs.toml": ("chiplog", "templates/two_arcs.toml"),
    "test_robot.py": ("chiplog", "templates/test_robot.py.txt"),
}


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder to write to.")],
) -> None:
    """Write a commented robot.toml, map.toml, a scenario and a test that pass as they are."""
    write_start(folder)
    typer.echo(f"wrote {', '.join(_SOURCES)} to {folder}")
    typer.echo(
        f"run them:  chiplog run --scenario {folder / 'two_arcs.toml'} "
        f"--robot {folder / 'robot.toml'} --out {folder / 'out'}"
    )
    typer.echo(f"test them: pytest {folder}")


def write_start(folder: Path) -> tuple[Path, ...]:
    """Write the files to *folder*, made if need be; return their paths.

    Raises CommandError, and writes nothing, if one of them is there already.
    """
    targets = {folder / name: source for name, source in _SOURCES.items()}
    for target in targets:
        if target.exists() or target.is_symlink():
            raise CommandError(
                f"{target}: exists already and nothing is overwritten; "
                "choose another folder or move it away"
            )
    if folder.exists() and not folder.is_dir():
        raise CommandError(f"{folder}: is a file; expected a folder, which may not exist yet")
    folder.mkdir(parents=True, exist_ok=True)
    for target, (package, path) in targets.items():
        text = files(package).joinpath(path).read_text(encoding="utf-8")
        with target.open("x", encoding="utf-8", newline="\n") as file:
            file.write(text)
    return tuple(targets)
