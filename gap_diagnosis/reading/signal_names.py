"""What the words in a signal's name say."""

from __future__ import annotations

import re
from typing import Final

from gap_diagnosis.reading.signals_found import FoundSignal

COMMAND_WORDS: Final = ("cmd", "command", "set", "target", "desired", "request", "ref_speed")
AXES: Final = {
    "x": "x", "y": "y", "z": "z",
    "long": "x", "lon": "x", "longitudinal": "x", "lat": "y", "lateral": "y",
}  # fmt: skip


def words_of(signal: FoundSignal) -> list[str]:
    """Return the words in a name: ``IMU.gyroZ_raw`` has imu, gyro, z, raw.

    Letters are those of any language, and what stands for one that could not be read: of ``für``
    an r by itself would be a right wheel.
    """
    spaced = re.sub(r"([a-z0-9])([A-Z])", r"\1 \2", signal.path)
    return [word for word in re.split(r"(?:[\W\d_](?<!\ufffd))+", spaced.lower()) if word]


def is_named(signal: FoundSignal, words: tuple[str, ...]) -> bool:
    """Tell whether any of *words* of three letters and more is in a name, or in a word of it."""
    joined = " ".join(words_of(signal))
    return any(word in joined for word in words if len(word) > 2)
