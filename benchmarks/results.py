"""Results of benchmarks that diagnose drives one after another: a line of JSON each, and a page."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def read_rows(rows: Path) -> list[dict[str, Any]]:
    """Return what has been measured so far; nothing where nothing has."""
    if not rows.exists():
        return []
    return [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()]


def sizes_of(gap: Mapping[str, Any] | None) -> str:
    """Return a gap before, after and its floor, in thousandths of its unit."""
    told = gap or {}
    sizes = ", ".join(
        "–" if told.get(key) is None else f"{1e3 * told[key]:.3g}"
        for key in ("before", "after", "floor")
    )
    unit = {"m": "mm", "rad": "mrad", "s": "ms"}.get(told.get("unit", ""), "")
    return f"{sizes} {unit}"


def put_page(text: str, out: Path | None) -> None:
    """Write a page, or print it where no file is named."""
    if out is None:
        print(text)
    else:
        out.write_text(text, encoding="utf-8")
