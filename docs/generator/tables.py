"""Tables and numbers in Markdown."""

from __future__ import annotations

import math
from collections.abc import Iterable


def table(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a Markdown table; bars inside cells are escaped."""
    header = list(header)
    lines = [header, ["---"] * len(header)]
    lines += [[str(cell).replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def number(value: float) -> str:
    """Return a number as short as it is exact; powers of two as such."""
    if value != 0 and math.isfinite(value):
        mantissa, exponent = math.frexp(abs(value))
        if mantissa == 0.5 and exponent - 1 <= -4:
            return f"2^{exponent - 1}"
    return "∞" if value == math.inf else f"{value:.10g}"
