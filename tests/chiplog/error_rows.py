"""The table in docs/reference/errors.md: every kind of message a user can meet, each row a test.

python tests/chiplog/error_rows.py > docs/reference/errors.md
"""

from __future__ import annotations

from collections.abc import Mapping

from error_tables import buses, devices, files, logs, usage, wire
from error_tables.row import Row

SECTIONS: Mapping[str, tuple[Row, ...]] = {
    "Usage": usage.USAGE,
    "Robot description": files.ROBOT_DESCRIPTION,
    "Scenario": files.SCENARIO,
    "Effects": files.EFFECTS,
    "DBC and signal map": wire.WIRE,
    "Firmware under test": devices.FIRMWARE_UNDER_TEST,
    "Bus": buses.BUS,
    "Logs": logs.LOGS,
    "Output": logs.OUTPUT,
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
            f"| {_cell(row.when)} | `{_cell(row.command)}` | {_messages(row)} |" for row in rows
        ]
        parts.append("")
    return "\n".join(parts).rstrip("\n") + "\n"


def _messages(row: Row) -> str:
    lines = filter(None, (row.line, row.or_line))
    return "<br>or ".join(f"`chiplog: {_cell(line)}`" for line in lines)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    print(page(), end="")
