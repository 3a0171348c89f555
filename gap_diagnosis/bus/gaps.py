"""Windows in which no frame came at all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from gap_diagnosis.bus.events import Message

_LEAST_S: Final = 0.03
_LEAST_CYCLES: Final = 4
_BUSY_MESSAGES: Final = 2
_MOST_WINDOWS: Final = 20


def silent_windows(messages: Sequence[Message]) -> list[tuple[float, float]]:
    """Return the (start, stop) in which all sensors were silent that should have spoken.

    What the ECU itself sends may still be in its own log.

    Between the last frame before and the first one after, the longest windows first.
    """
    sensors = [one for one in messages if one.is_sensor]
    telling = [one for one in sensors if one.tells_losses]
    if not telling:
        return []
    stamps = np.sort(np.concatenate([one.t_s for one in sensors]))
    gaps = np.diff(stamps)
    shortest = min(one.cycle_s for one in telling)
    least = max(_LEAST_S, _LEAST_CYCLES * shortest)
    found = []
    for place in np.argsort(-gaps)[:_MOST_WINDOWS]:
        if gaps[place] < least:
            break
        start, stop = float(stamps[place]), float(stamps[place + 1])
        speaks = [one for one in telling if one.cycle_s < gaps[place] / 2]
        silent = [one for one in speaks if _lost_within(one, start, stop) > 0]
        if len(silent) == len(speaks) and len(silent) >= min(_BUSY_MESSAGES, len(telling)):
            found.append((start, stop))
    return found


def _lost_within(message: Message, start: float, stop: float) -> int:
    outside = message.runs(((start, stop),)).lost
    return message.runs().lost - outside
