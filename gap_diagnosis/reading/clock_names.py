"""Which columns of a table are clocks by their names, and in what unit they count."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_UNITS: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_SPELT: Final = {
    "msec": "ms", "millis": "ms", "usec": "us", "micros": "us", "nsec": "ns", "nanos": "ns",
    "sec": "s", "secs": "s", "seconds": "s",
}  # fmt: skip
_AT_END: Final = re.compile(r"(?:^|[_ .])(ms|us|ns|msec|millis|usec|micros|nsec|nanos)$")
_IN_BRACKETS: Final = re.compile(r"[\[(]\s*(s|ms|us|ns|[mun]?sec|secs|seconds)\s*[\])]$")
_OF_A_TIME: Final = re.compile(r"(?:time|stamp|^t|elapsed)[_ .](s|secs?|seconds)$")
_CONTROLLER: Final = re.compile(
    r"(?:^|[\W_])(?:ecu|mcu|millis|micros|board|device|firmware|arduino|teensy|stm32|esp32)"
    r"(?:[\W_]|$)"
)
_STEPS_S: Final = (1e-5, 10.0)
"""Rows of a drive are no nearer together and no farther apart."""


def sounds_like_time(name: str) -> bool:
    """Tell whether a column's name is that of a clock: it has a word for it, or a unit of time."""
    return has_times_word(name) or _said_unit(name) is not None


def has_times_word(name: str) -> bool:
    """Tell whether a column's name has a word for a time; what counts ms may be a delay."""
    word = name.lower()
    return word in {"t", "t_s", "ecu_t_s"} or "time" in word or "stamp" in word


def is_controllers(name: str) -> bool:
    """Tell whether a clock is, by its name, that of the robot's controller."""
    return _CONTROLLER.search(name.lower()) is not None


def by_name(names: Iterable[str]) -> list[str]:
    """Return those that sound like a time, likeliest first to be the log's: with a word for it, and
    not the controller's."""
    clocks = [name for name in names if sounds_like_time(name)]
    return sorted(clocks, key=lambda name: (not has_times_word(name), is_controllers(name)))


def reference_time_unit(values: Floats, name: str) -> float:
    """Return what the unit of a reference's clock is in seconds: of a receiver of 1 Hz, or of a
    camera of 400."""
    return time_unit(values, name, usual_hz=20.0)[1]


def time_unit(values: Floats, name: str = "", usual_hz: float = 100.0) -> tuple[str, float]:
    """Return the unit of a clock's values and what it is in seconds.

    Its name says it where its steps allow that; else it is the one whose steps are nearest to
    *usual_hz* rows a second.
    """
    steps = np.diff(values)
    step = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.01
    said = _said_unit(name)
    if said is not None and _STEPS_S[0] <= step * _UNITS[said] <= _STEPS_S[1]:
        return said, _UNITS[said]
    return min(_UNITS.items(), key=lambda unit: abs(math.log10(step * unit[1] * usual_hz)))


def _said_unit(name: str) -> str | None:
    """Return the unit of time that ends a name; a bare s may belong to a speed's m_s."""
    word = name.lower().strip()
    for form in (_AT_END, _IN_BRACKETS, _OF_A_TIME):
        if (found := form.search(word)) is not None:
            return _SPELT.get(found[1], found[1])
    return None
