"""When frames do what they ought not to: all along, or in a few windows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.bus.events import Message

Floats = NDArray[np.float64]
Windows = tuple[tuple[float, float], ...]

_MOST: Final = 3
_FEWEST: Final = 5
_EDGES: Final = 400
"""Of more events only so many are tried as ends of a window."""
_SURE: Final = 5.0
"""A window is worth so much more [nat] than the choice of its ends costs."""
_MOSTLY: Final = 0.8
"""What happens in windows happens no more than in a fifth elsewhere."""
_LATE: Final = 0.95
"""Of frames whose stamps spread, those beyond this quantile show when."""


def events_of(effect: str, message: Message) -> Floats:
    """Return when a message's frames did it, float64[k]; none of what acts on every frame alike.

    Frames that were lost in a row are one event.
    """
    if effect == "frame_loss":
        tick, first = np.unique(np.append(message.tick, message.not_sent), return_index=True)
        stamps = np.append(message.t_s, np.full(len(message.not_sent), np.nan))[first]
        found = stamps[:-1][np.diff(tick) > message.cycle]
    elif effect == "frame_duplication":
        found = message.t_s[message.repeated]
    elif effect == "frame_reordering":
        found = message.t_s[message.swapped]
    elif effect == "frame_jitter":
        steady = message.steady()
        late = message.late_s[steady]
        if not len(late):
            return np.zeros(0)
        found = message.t_s[steady][late > np.quantile(late, _LATE)]
    else:
        return np.zeros(0)
    return np.sort(found[np.isfinite(found)])


def crowds(events_s: Floats, start_s: float, stop_s: float, frames: int) -> tuple[Windows, float]:
    """Return the windows between start and stop in which events crowd, in time's order, and the
    share of the events that are there beyond what comes elsewhere; none where they come as evenly
    as chance has it, or mostly elsewhere.

    *frames* are those to which it could have happened: windows begin and end with any of them.
    """
    left, span_s = np.asarray(events_s), stop_s - start_s
    chosen: list[tuple[float, float]] = []
    price = 2 * math.log(max(frames, 2)) + _SURE
    while len(chosen) < _MOST and len(left) >= _FEWEST and span_s > 0:
        window, gained = _best(left, span_s)
        if gained < price:
            break
        chosen.append(window)
        left = left[(left < window[0]) | (left > window[1])]
        span_s -= window[1] - window[0]
    if not chosen or len(left) > (1 - _MOSTLY) * len(events_s):
        return (), 0.0
    usual = len(left) * (stop_s - start_s) / max(span_s, 1e-9)
    return tuple(sorted(chosen)), max(1 - usual / len(events_s), 0.0)


def happened(effect: str, messages: Sequence[Message]) -> tuple[Windows, float]:
    """Return the windows in which it happened to these messages' frames, none for all along, and
    the share of it that goes with them."""
    if not messages:
        return (), 0.0
    events = np.sort(np.concatenate([events_of(effect, one) for one in messages]))
    first = min(float(one.t_s.min()) for one in messages)
    last = max(float(one.t_s.max()) for one in messages)
    return crowds(events, first, last, sum(one.frames for one in messages))


def _best(events_s: Floats, span_s: float) -> tuple[tuple[float, float], float]:
    """Return the window from event to event whose rate differs most, and by how many nats."""
    count = len(events_s)
    places = np.unique(np.linspace(0, count - 1, min(count, _EDGES)).round().astype(np.int64))
    begins, ends = np.triu_indices(len(places), 1)
    first, last = places[begins], places[ends]
    inside = (last - first + 1).astype(np.float64)
    # From event to event there is one interval fewer than events: as many again at its ends.
    width_s = (events_s[last] - events_s[first]) * inside / (inside - 1)
    share = np.clip(width_s / span_s, 1e-9, 1 - 1e-9)
    gained = _nats(inside, count * share) + _nats(count - inside, count * (1 - share))
    gained[(inside < _FEWEST) | (inside < count * share)] = -math.inf
    best = int(np.argmax(gained))
    return (float(events_s[first[best]]), float(events_s[last[best]])), float(gained[best])


def _nats(seen: Floats, expected: Floats) -> Floats:
    return np.asarray(seen * np.log(np.maximum(seen, 1e-9) / expected))
