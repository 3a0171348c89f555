"""The unit of a signal: the DBC's, or what a column's name says of it."""

from __future__ import annotations

import re
from typing import Final

from gap_diagnosis.reading.signals_found import FoundSignal
from hil_harness.signal_roles import unit_of

_IN_BRACKETS: Final = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$")
_ENDS: Final = {
    "rad/s": ("rad_s", "rad_per_s", "rad_sec", "rad_per_sec", "radps"),
    "deg/s": ("deg_s", "deg_per_s", "deg_sec", "deg_per_sec", "degps", "dps"),
    "m/s": ("m_s", "m_sec", "m_per_s", "mps"),
    "mm/s": ("mm_s", "mm_per_s"),
    "cm/s": ("cm_s", "cm_per_s"),
    "m/s^2": ("m_s2", "m_per_s2", "mps2"),
    "km/h": ("kmh", "km_h", "kph", "kmph"),
    "mph": ("mph",),
    "rpm": ("rpm",),
    "rad": ("rad",),
    "deg": ("deg", "degrees"),
    "mm": ("mm",),
    "cm": ("cm",),
    "m": ("m",),
    "V": ("v",),
    "K": ("k",),
    "degC": ("degc", "celsius"),
    "": ("tick", "ticks", "count", "counts", "code", "codes", "raw"),
}
_OF_MOTION: Final = ("cmd", "command", "set", "target", "desired", "odom")
"""What ends in v there is a speed, no voltage."""
_UNIT_OF_END: Final = {end: unit for unit, ends in _ENDS.items() for end in ends}
_AT_END: Final = re.compile(
    rf"(?:^|[_ .])({'|'.join(sorted(_UNIT_OF_END, key=len, reverse=True))})$"
)


def unit_of_signal(signal: FoundSignal, is_table: bool) -> str:
    """Return a signal's unit: the DBC's, or what the end of a column's name says.

    ``yaw_deg_s``, ``speed_kmh`` and ``yaw rate [deg/s]`` say it; empty where nothing is said.
    """
    if not is_table:
        return signal.unit
    bracketed = _IN_BRACKETS.search(signal.path)
    if bracketed is not None and unit_of(bracketed[1]) is not None:
        return bracketed[1]
    name = signal.path.lower()
    end = _AT_END.search(name)
    if end is None or (end[1] == "v" and any(word in name for word in _OF_MOTION)):
        return ""
    return _UNIT_OF_END[end[1]]
