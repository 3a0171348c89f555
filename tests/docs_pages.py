"""Runs the documentation: every command and code block of a page, in order, in a fresh folder.

What the language of a fence means:

- ``console``: lines after ``$ `` are run by bash, one after another, and must succeed; where one
  is meant to fail, the next command is ``echo $?``. The lines that follow are the expected output:
  ``…`` stands for anything within a line, alone on a line for any number of lines.
- ``python``, ``toml``, ``c``: a first-line comment that names a file puts the block there; without
  one, Python is executed. A file must be named again by a later block, so that it is used.
- ``console hardware``: needs root, a network or hardware. Not run; options are looked up in
  ``--help``, and ``ip link`` lines must be the ones that the tool itself gives.
- ``sh``: commands of a checkout, as scripts/demo.sh.
- ``yaml``: its ``run:`` lines are looked at as ``console hardware``.
- ``text FILE`` puts the block there as well, for formats without comments.
- ``text`` or nothing: drawings and formulas.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from forked import folder_of_programs

ROOT = Path(__file__).parent.parent
LANGUAGES = ("console", "console hardware", "python", "toml", "c", "sh", "yaml", "text", "")
_FENCE = re.compile(r"^```(.*)$")
_FILE_NAME = re.compile(r"^(?:#|//|/\*) ?([\w./-]+\.(?:py|toml|c|h))\b")
_COMMAND_TIMEOUT_S = 300
"""Ends a command that hangs; no test waits for it otherwise."""


class PageError(AssertionError):
    """A page says something that is not so; the text names page and line."""


@dataclass(frozen=True)
class Block:
    """One fenced block: where it stands, its language, its lines."""

    page: Path
    line: int
    language: str
    lines: tuple[str, ...]

    @property
    def file_name(self) -> str | None:
        """Return the file that the first line names, or None."""
        if self.language.startswith("text "):
            return self.language.removeprefix("text ")
        found = _FILE_NAME.match(self.lines[0]) if self.lines else None
        return found[1] if found else None

    @property
    def text(self) -> str:
        """Return the content, ending in a newline."""
        return "\n".join(self.lines) + "\n"

    def error(self, what: str) -> PageError:
        """Return an error that names this block."""
        return PageError(f"{self.page.name}:{self.line}: {what}")


@dataclass(frozen=True)
class Command:
    """A command of a console block, and the output that the page promises."""

    line: int
    text: str
    expected: tuple[str, ...]


def blocks_of(page: Path) -> list[Block]:
    """Return every fenced block of *page*; raises PageError for an unknown or open fence."""
    blocks = []
    content: list[str] = []
    opened: tuple[int, str] | None = None
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        fence = _FENCE.match(line)
        if opened is None and fence:
            opened, content = (number, fence[1].strip()), []
            if opened[1] not in LANGUAGES and not opened[1].startswith("text "):
                raise PageError(f"{page.name}:{number}: fence {opened[1]!r}: none of {LANGUAGES}")
        elif opened is not None and line == "```":
            blocks.append(Block(page, *opened, tuple(content)))
            opened = None
        elif opened is not None:
            content.append(line)
    if opened is not None:
        raise PageError(f"{page.name}:{opened[0]}: the fence is not closed")
    return blocks


def commands_of(block: Block) -> list[Command]:
    """Return the commands of a console block; a trailing backslash joins the next line."""
    commands: list[Command] = []
    joined = False
    for number, line in enumerate(block.lines, block.line + 1):
        if line.startswith("$ ") and not joined:
            commands.append(Command(number, line[2:], ()))
        elif not commands:
            raise block.error(f"expected a line that begins with '$ ', not {line!r}")
        elif joined:
            last = commands[-1]
            commands[-1] = Command(last.line, f"{last.text}\n{line.removeprefix('> ')}", ())
        else:
            last = commands[-1]
            commands[-1] = Command(last.line, last.text, (*last.expected, line))
        joined = commands[-1].text.endswith("\\") and not commands[-1].expected
    return commands


def matches(expected: tuple[str, ...], printed: list[str]) -> bool:
    """Say whether the printed lines are the expected ones; ``…`` is the wildcard."""
    if not expected:
        return not printed
    if expected[0].strip() == "…":
        return any(matches(expected[1:], printed[skip:]) for skip in range(len(printed) + 1))
    if not printed or not _line_matches(expected[0], printed[0]):
        return False
    return matches(expected[1:], printed[1:])


def _line_matches(expected: str, printed: str) -> bool:
    # Columns move with the widths of numbers: any run of blanks equals any other.
    parts = [
        r"\s+".join(map(re.escape, part.split(" "))) for part in _squeezed(expected).split("…")
    ]
    return re.fullmatch(".*".join(parts), _squeezed(printed)) is not None


def _squeezed(line: str) -> str:
    return re.sub(r"\s+", " ", line.rstrip())


class Session:
    """The folder and shell in which one page runs."""

    def __init__(self, folder: Path, *, forks: bool = True) -> None:
        """Start in *folder*, with forked programs first on the path, or this Python's."""
        programs = [Path(sys.executable).parent, os.environ["PATH"]]
        if forks:
            programs.insert(0, folder_of_programs())
        self.start = folder
        self.folder = folder
        self.status = 0
        self.environment = {
            **os.environ,
            "PATH": os.pathsep.join(map(str, programs)),
            "COLUMNS": "100",
            "NO_COLOR": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYTHONPATH": str(Path(__file__).parent),
            "PYTEST_ADDOPTS": "-p lean -p no:cacheprovider -p no:randomly",
        }
        # A pytest of a page is not a worker of ours.
        for name in ("PYTEST_XDIST_WORKER", "PYTEST_CURRENT_TEST", "CHIPLOG_DOCS"):
            self.environment.pop(name, None)

    def run(self, command: str) -> tuple[int, str]:
        """Run a line of bash where the last one ended; return status and all it printed."""
        where = self.start / ".where"
        script = f'(exit {self.status})\n{command}\nstatus=$?\npwd > "{where}"\nexit $status\n'
        done = subprocess.run(
            ["bash", "-c", script],
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=_COMMAND_TIMEOUT_S,
            check=False,
        )
        if where.exists():
            self.folder = Path(where.read_text().strip())
        self.status = done.returncode
        return done.returncode, done.stdout


def run_page(page: Path, folder: Path, *, forks: bool = True) -> None:
    """Execute every block of *page* in *folder*; raises PageError at the first that is not so.

    Each `chiplog` is a process of its own, and begun anew unless it *forks*.
    """
    session = Session(folder, forks=forks)
    blocks = blocks_of(page)
    for number, block in enumerate(blocks):
        if block.language == "console":
            _run_console(block, session)
        elif block.language in ("python", "toml", "c") or block.language.startswith("text "):
            _place_or_run(block, blocks[number + 1 :], session)


def _run_console(block: Block, session: Session) -> None:
    commands = commands_of(block)
    for number, command in enumerate(commands):
        status, printed = session.run(command.text)
        following = commands[number + 1].text if number + 1 < len(commands) else ""
        said = f"{block.page.name}:{command.line}: $ {command.text}\n{printed}"
        if status != 0 and following != "echo $?":
            raise PageError(f"{said}ended with status {status}")
        if command.expected and not matches(command.expected, printed.splitlines()):
            expected = "\n".join(command.expected)
            raise PageError(f"{said}but the page promises:\n{expected}")


def _place_or_run(block: Block, later: list[Block], session: Session) -> None:
    name = block.file_name
    if name is not None:
        if not any(_mentions(name, other) for other in later):
            raise block.error(f"{name} is written but no later block uses it")
        path = session.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(block.text, encoding="utf-8")
    elif block.language == "python":
        script = session.start / ".block.py"
        script.write_text(block.text, encoding="utf-8")
        status, printed = session.run(f"'{sys.executable}' '{script}'")
        if status != 0:
            raise block.error(f"the Python block ended with status {status}:\n{printed}")
    else:
        raise block.error(f"a {block.language} block names its file in a comment on its first line")


def _mentions(name: str, block: Block) -> bool:
    # Python imports a module by its stem.
    return name in block.text or re.search(rf"\bimport {Path(name).stem}\b", block.text) is not None


def links_of(page: Path) -> Iterator[tuple[int, str]]:
    """Yield line and target of every link and picture of *page*, outside its blocks."""
    inside = False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if line.startswith("```"):
            inside = not inside
        if not inside:
            for found in re.finditer(r"\]\(([^)\s]+)\)", line):
                yield number, found[1]


def anchors_of(page: Path) -> set[str]:
    """Return the anchors that a page's headings make, as GitHub spells them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.strip().lower()).replace(" ", "-") for h in headings}
