"""The table in docs/reference/errors.md: every kind of message a user can meet, each row a test.

python tests/chiplog/error_rows.py > docs/reference/errors.md
"""

from __future__ import annotations

from collections.abc import Mapping

from error_tables import (
    buses,
    devices,
    diagnosis,
    drives,
    effect_libraries,
    files,
    formats,
    logs,
    recordings,
    rig,
    simulated,
    studies,
    tables,
    trials,
    usage,
    wire,
)
from error_tables.row import Row

from hil_harness.devices import include_dir

SECTIONS: Mapping[str, tuple[Row, ...]] = {
    "Usage": usage.USAGE,
    "Robot description": files.ROBOT_DESCRIPTION,
    "Firmware formats": formats.FORMATS,
    "Scenario": files.SCENARIO,
    "Effects": (*files.EFFECTS, *effect_libraries.EFFECT_LIBRARIES),
    "DBC and signal map": wire.WIRE,
    "Firmware under test": devices.FIRMWARE_UNDER_TEST,
    "Bus": buses.BUS,
    "Simulated bus and its load": simulated.SIMULATED,
    "Logs": logs.LOGS,
    "Recordings": recordings.RECORDINGS,
    "Logs and references to diagnose": drives.DRIVES,
    "Tables": tables.TABLES,
    "Diagnosis": diagnosis.DIAGNOSIS,
    "Blind trials": trials.TRIALS,
    "Study": studies.STUDIES,
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


_SETTINGS = """In a test's report, where the rig could not be made. What is said above of robots,
DBCs, devices and buses is said there too.
"""
_STATEMENTS = """Exceptions at the line of the test: `HarnessError` or `CanBusError`, both a
`ValueError`.
"""


def page() -> str:
    """Return docs/reference/errors.md."""
    parts = [_HEAD]
    for section, rows in SECTIONS.items():
        parts += _section(section, rows)
    parts += _section("In a test: making the rig", rig.SETTINGS, _SETTINGS)
    parts += _section("In a test: using the rig", rig.STATEMENTS, _STATEMENTS, prefix="")
    return "\n".join(parts).rstrip("\n") + "\n"


def _section(
    title: str, rows: tuple[Row, ...], said: str = "", prefix: str = "chiplog: "
) -> list[str]:
    lines = [f"## {title}", "", *filter(None, [said]), "| what is wrong | for example | message |"]
    lines.append("|---|---|---|")
    for row in rows:
        messages = "<br>or ".join(
            _code(prefix + _cell(line)) for line in filter(None, (row.line, row.or_line))
        )
        lines.append(f"| {_cell(row.when)} | {_code(_cell(row.command))} | {messages} |")
    return [*lines, ""]


def _code(text: str) -> str:
    return f"`` {text} ``" if "`" in text else f"`{text}`"


def _cell(text: str) -> str:
    # Where the header lies differs from machine to machine.
    shown = text.replace(str(include_dir()), "…/hil_harness/devices/include")
    return shown.replace("|", "\\|")


if __name__ == "__main__":
    print(page(), end="")
