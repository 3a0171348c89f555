"""The pages of what a user programs against: the pytest plugin and the C header."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

from chiplog import pytest_plugin
from generator.tables import table
from hil_harness.devices import include_dir
from hil_harness.rig import Rig

_NOT_OF_A_TEST = ("`interface, channel, bitrate, bus_args`", "`log`", "`folder`")
"""Arguments of a rig that the plugin gives it, from the command line."""


class _Options:
    """Stands in for pytest's parser and remembers what is added."""

    def __init__(self) -> None:
        self.rows: list[list[str]] = []

    def getgroup(self, *_: str) -> _Options:
        return self

    def addoption(self, name: str, **details: Any) -> None:
        shown = f"`{name} {details['metavar']}`" if "metavar" in details else f"`{name}`"
        self.rows.append([shown, details["help"]])


def pytest_page() -> str:
    """Return the page of the pytest plugin, from the plugin and the rig."""
    options: Any = _Options()
    pytest_plugin.pytest_addoption(options)
    parts = [
        "# pytest plugin",
        "Installing Chiplog makes it known to pytest; nothing heavy is imported before a test asks "
        "for a fixture. Recipes: [Write my test](../how-to/my-test.md).",
        "## Fixtures",
        table(
            ["fixture", "what"],
            [
                ["`chiplog_rig`", "a robot on a bus of its own; methods below"],
                ["`chiplog_bus`", "a python-can bus on the rig's channel, for frames of any kind"],
                [
                    "`chiplog_settings`",
                    "override it in a `conftest.py`: returns a dict of settings for all rigs",
                ],
            ],
        ),
        "A test that leaves a python-can bus open fails. A failing test shows the "
        "decoded frames before the failure and keeps its bus log.",
        "## Settings",
        "`@pytest.mark.chiplog(…)` configures the rig of one test, `chiplog_settings` those of a "
        "project, the command line those of a run; the marker wins over the command line, which "
        "wins over the project. Relative paths start at the test's file.",
        table(["setting", "what"], _settings()),
        "## Options",
        table(["option", "what"], options.rows),
        "## The rig",
    ]
    for name, member in vars(Rig).items():
        if not name.startswith("_"):
            parts += [f"### {name}", f"```text\n{_signature(name, member)}\n```", _text(member)]
    return "\n\n".join(part.strip() for part in parts)


def _settings() -> list[list[str]]:
    """Return the settings that tests may give, as the rig's docstring explains them."""
    rows: list[list[str]] = []
    arguments = inspect.getdoc(Rig) or ""
    for line in arguments.partition("Args:")[2].partition("\n\n")[0].splitlines():
        name, colon, meaning = line.strip().partition(": ")
        if colon and line.startswith("    ") and not line.startswith("     "):
            rows.append([f"`{name}`", meaning])
        elif rows:
            rows[-1][1] += f" {line.strip()}"
    return [[name, text.replace("``", "`")] for name, text in rows if name not in _NOT_OF_A_TEST]


def _signature(name: str, member: Any) -> str:
    if isinstance(member, property):
        return f"rig.{name}"
    words = str(inspect.signature(member)).replace("(self, ", "(").replace("(self)", "()")
    return f"rig.{name}{words}".replace("'", "").removesuffix(" -> None")


def _text(member: Any) -> str:
    return (inspect.getdoc(member) or "").replace("``", "`")


def c_abi() -> str:
    """Return the page of the C interface: the header itself."""
    header = (Path(include_dir()) / "chiplog_device.h").read_text(encoding="utf-8").strip()
    return "\n\n".join(
        (
            "# The C interface",
            "A firmware under test that is a shared library exports three functions. This is "
            "`chiplog_device.h`; `python -m hil_harness.devices` prints the folder it is in. A "
            "page on how to use it: [My firmware](../how-to/my-firmware.md#a-c-library).",
            f"```text\n{header}\n```",
        )
    )
