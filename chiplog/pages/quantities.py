"""Numbers as people read them: three to six digits and the unit prefix that fits."""

from __future__ import annotations

import math

_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))
MINUS = "−"
UNKNOWN = "–"
SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def length(value_m: float | None, digits: int = 4) -> str:
    """Return a length in m, mm, µm, nm or pm with `digits` significant digits."""
    return prefixed(value_m, "m", digits)


def angle(value_rad: float | None, digits: int = 4) -> str:
    """Return an angle in degrees down to a thousandth, below that in µrad, nrad or prad."""
    if value_rad is None or not math.isfinite(value_rad):
        return UNKNOWN
    degrees = math.degrees(value_rad)
    if value_rad == 0 or abs(degrees) >= 1e-3:
        return f"{_significant(degrees, digits)}°"
    return prefixed(value_rad, "rad", digits)


def prefixed(value: float | None, unit: str, digits: int = 4) -> str:
    """Return `value` [unit] with the prefix that leaves one to three digits before the point."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    if value == 0:
        return f"0 {unit}"
    value = float(f"{value:.{digits - 1}e}")
    smallest, prefix = _PREFIXES[-1]
    if abs(value) < smallest:
        return f"{value / smallest:.3f} {prefix}{unit}".replace("-", MINUS)
    factor, prefix = next((f, p) for f, p in _PREFIXES if abs(value) >= f)
    return f"{_significant(value / factor, digits)} {prefix}{unit}"


def count(value: int) -> str:
    """Return a whole number with thousands set apart by commas."""
    return f"{value:,}".replace("-", MINUS)


def overflows(number: int) -> str:
    """Return how often words overflowed."""
    return f"{count(number)} {'overflow' if number == 1 else 'overflows'} of a word"


def share(value: float | None) -> str:
    """Return a ratio as a percentage."""
    return UNKNOWN if value is None else f"{_significant(100 * value, 3)} %"


def duration(value_s: float) -> str:
    """Return a time span in the unit a person would say it in."""
    if value_s >= 120:
        minutes, seconds = divmod(round(value_s), 60)
        return f"{minutes} min {seconds} s" if seconds else f"{minutes} min"
    if value_s >= 1 or value_s == 0:
        return f"{value_s:.4g} s"
    return f"{value_s * 1e3:.4g} ms" if value_s >= 1e-3 else f"{value_s * 1e6:.4g} µs"


def factor(value: float | None) -> str:
    """Return a speed ratio such as `146×`."""
    return UNKNOWN if value is None else f"{_significant(value, 3)}×"


def fixed(value: float | None, decimals: int) -> str:
    """Return `value` with a fixed number of decimals, so that a column lines up."""
    if value is None or not math.isfinite(value):
        return UNKNOWN
    text = f"{value:.{decimals}f}"
    if float(text) == 0:
        text = text.lstrip("-")
    return text.replace("-", MINUS)


def _significant(value: float, digits: int) -> str:
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{decimals}f}".replace("-", MINUS)
