"""Every kind of message a user can meet: what provokes it, the command, and the line.

The table in docs/reference/errors.md is written from these rows, and each row is a test:

    python tests/chiplog/error_rows.py > docs/reference/errors.md
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field

Content = str | bytes


@dataclass(frozen=True)
class Row:
    """One message: when it comes, files that provoke it, the command, the line on stderr."""

    when: str
    command: str
    line: str
    files: Mapping[str, Content] = field(default_factory=dict)

    @property
    def words(self) -> list[str]:
        """The command's words after `chiplog`."""
        return shlex.split(self.command)[1:]

    @property
    def slug(self) -> str:
        """A name for the test."""
        return self.when.replace(" ", "-")


SECTIONS: Mapping[str, tuple[Row, ...]] = {
    "Usage": (
        Row(
            "a command that does not exist",
            "chiplog rnu",
            "no such command 'rnu'; did you mean 'run'? (see chiplog --help)",
        ),
        Row(
            "an option that does not exist",
            "chiplog run --scenrio lesson",
            "no such option --scenrio; did you mean --scenario? (see chiplog run --help)",
        ),
        Row(
            "a word where a number belongs",
            "chiplog run --seed seven",
            "--seed 'seven': expected a whole number (see chiplog run --help)",
        ),
        Row(
            "a value that is not one of a few",
            "chiplog run --time fast",
            "--time 'fast': expected one of lockstep, real (see chiplog run --help)",
        ),
        Row(
            "an option without its value",
            "chiplog run --seed",
            "option '--seed' requires an argument (see chiplog --help)",
        ),
        Row(
            "an argument that is missing",
            "chiplog schema",
            "missing argument 'SUBJECT'; choose from: robot (see chiplog schema --help)",
        ),
        Row(
            "an argument too many",
            "chiplog run lesson",
            "unexpected argument (lesson) (see chiplog run --help)",
        ),
    ),
}

_HEAD = """# Error messages and exit statuses

| status | meaning |
|---|---|
| 0 | done; a verdict of any kind is an answer, not an error |
| 1 | done, and the answer to what was asked is no: a replay that differs, a law violated |
| 2 | bad usage or bad input: one line on standard error says what, where and what to do |
| 130 | interrupted by Ctrl-C: what was recorded so far is complete and readable |

Every message is one line that begins with `chiplog:`. `--debug`, anywhere on the command line, adds
the traceback. Each line below is printed by a test of this repository, word for word.
"""


def page() -> str:
    """Return docs/reference/errors.md."""
    parts = [_HEAD]
    for section, rows in SECTIONS.items():
        parts.append(f"## {section}\n\n| what is wrong | for example | message |\n|---|---|---|")
        parts += [
            f"| {_cell(row.when)} | `{_cell(row.command)}` | `chiplog: {_cell(row.line)}` |"
            for row in rows
        ]
        parts.append("")
    return "\n".join(parts).rstrip("\n") + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    print(page(), end="")
