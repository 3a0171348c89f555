"""The picture of the README, made by the command that the README shows."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from importlib.resources import files
from pathlib import Path

_FONTS = "system-ui, 'Segoe UI', Roboto, 'Noto Sans', 'Liberation Sans', sans-serif"


def draw_lesson(target: Path) -> None:
    """Run the lesson and write the first picture of its report to `target`."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "chiplog", "run", "--scenario", "lesson", "--out", folder]
        subprocess.run(command, check=True)
        page = (Path(folder) / "report.html").read_text(encoding="utf-8")
    start = page.index("<svg")
    picture = page[start : page.index("</svg>", start) + len("</svg>")]
    target.write_text(_standalone(picture) + "\n", encoding="utf-8")


def _standalone(picture: str) -> str:
    """Return a picture that needs no page around it: the page's colours, fonts and paper."""
    css = files("chiplog.pages").joinpath("templates/page.css").read_text(encoding="utf-8")
    colours = dict(re.findall(r"--(\w+): (#\w+);", css.partition("@media")[0]))
    coloured = re.sub(r"var\(--(\w+)\)", lambda name: colours[name[1]], picture)
    box = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', coloured)
    assert box is not None
    style = (
        f"<style>text {{ font-family: {_FONTS}; paint-order: stroke; stroke: {colours['paper']}; "
        "stroke-width: 3px; stroke-linejoin: round; }</style>"
        f'<rect width="{box[1]}" height="{box[2]}" fill="{colours["paper"]}"/>'
    )
    head_end = coloured.index(">", coloured.index("<svg")) + 1
    return coloured[:head_end] + style + coloured[head_end:]
