"""The pictures, made by the commands that the pages show."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path


def draw_lesson(target: Path) -> None:
    """Run the lesson and take the picture of its three trajectories from the report."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "chiplog", "run", "--scenario", "lesson", "--out", folder]
        subprocess.run(command, check=True)
        page = (Path(folder) / "report.html").read_text(encoding="utf-8")
    start = page.index("<svg")
    target.write_text(page[start : page.index("</svg>") + len("</svg>")] + "\n")
