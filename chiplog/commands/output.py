"""`--json`: the result as a file, or on standard output where the file is `-`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

STANDARD_OUTPUT = Path("-")


def write_json(path: Path, content: Any) -> None:
    """Write `content` as indented JSON to `path`, or print it where `path` is `-`."""
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    if path == STANDARD_OUTPUT:
        sys.stdout.write(text)
    else:
        path.write_text(text, encoding="utf-8")
