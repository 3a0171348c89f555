"""What the words in a signal's name say."""

from __future__ import annotations

import re
from typing import Final

from gap_diagnosis.reading.signals_found import FoundSignal

COMMAND_WORDS: Final = ("cmd", "command", "set", "target", "desired", "request", "ref_speed")
_AXES: Final = {
    "x": "x", "y": "y", "z": "z", "yaw": "z", "yawrate": "z",
    "long": "x", "lon": "x", "longitudinal": "x", "lat": "y", "lateral": "y",
}  # fmt: skip


def words_of(signal: FoundSignal) -> list[str]:
    """Return the words in a name: ``IMU.gyroZ_raw`` has imu, gyro, z, raw.

    Letters are those of any language, and what stands for one that could not be read: of ``für``
    an r by itself would be a right wheel.
    """
    return _words(signal.path)


def axes_of(signal: FoundSignal) -> set[str]:
    """Return the axes that a signal's own name says, or else its message's, which may name another
    signal's: a yaw rate of YAW_LAT is not lateral."""
    own = signal.path.rpartition(".")[2]
    said = ({_AXES[word] for word in _words(name) if word in _AXES} for name in (own, signal.path))
    return next((axes for axes in said if axes), set())


def is_named(signal: FoundSignal, words: tuple[str, ...]) -> bool:
    """Tell whether any of *words* of three letters and more is in a name, or in a word of it."""
    joined = " ".join(words_of(signal))
    return any(word in joined for word in words if len(word) > 2)


def _words(name: str) -> list[str]:
    spaced = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", name)
    return [word for word in re.split(r"(?:[\W\d_](?<!\ufffd))+", spaced.lower()) if word]
