"""Writes the reference pages that repeat what stands elsewhere, and the pictures.

    .venv/bin/python docs/generate.py              the pages
    .venv/bin/python docs/generate.py --pictures   the pictures too: lesson and diagnosis

A test holds the pages against `pages()`, so none can be out of date.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from generator import catalogue, command_line, files, interfaces, pictures, reasoning, wire

DOCS: Final = Path(__file__).parent
_NOTE: Final = "<!-- Written by docs/generate.py; edit what it reads, not this page. -->"


def pages() -> dict[Path, str]:
    """Return path and text of every generated page."""
    made = {
        "command-line.md": command_line.command_line(),
        "robot.md": files.robot(),
        "scenarios.md": files.scenarios(),
        "map.md": files.signal_map(),
        "effects.md": catalogue.effects(),
        "laws.md": catalogue.laws(),
        "dbc.md": wire.dbc(),
        "pytest.md": interfaces.pytest_page(),
        "c-abi.md": interfaces.c_abi(),
    }
    return {DOCS / "reference" / name: f"{_NOTE}\n\n{text}\n" for name, text in made.items()}


def main() -> None:
    """Write the pages, and with --pictures the pictures."""
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
    if "--pictures" in sys.argv[1:]:
        pictures.draw_lesson(DOCS / "images" / "lesson.svg")
        reasoning.draw_reasoning(DOCS / "images" / "reasoning.svg")


if __name__ == "__main__":
    main()
