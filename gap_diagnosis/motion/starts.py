"""Where else the search for noise levels may begin than at the described ones.

A reference that is off by decimetres and wanders (GPS) lies so far from a motion capture room that
no path downhill leads there: the wander ends up in the contact of the wheels, and effects with it.
So does what a robot goes on by while a stamp is off by hundredths of a second.
"""

from __future__ import annotations

import math
from itertools import product
from typing import Final

import numpy as np

from gap_diagnosis.motion.levels import FLOORS
from gap_diagnosis.motion.nodes import Nodes
from gap_diagnosis.motion.whitening import CONTACT, LATERAL, LEVELS, SLIP_WANDER, SLOW, STAMP
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import LevelPrior

_OF_A_ROOM_M: Final = 0.02
_WANDERS: Final = (0.3, 3.0)
"""Slow noise over white noise,"""
_MEMORIES_S: Final = (1.0, 15.0)
"""and how long it lasts."""
_STAMPS_S: Final = (5e-3, 5e-2)
"""By how much stamps that came over a network may be off."""
_ROUGH_M_PER_SQRT_M: Final = 3e-3
_LONG_S: Final = 5.0
"""Wheels rougher than these, or a reference that wanders more than described and for longer, may be
wheels that slip:"""
_SLIPS: Final = 0.1
_SKIDS_M_PER_SQRT_M: Final = 0.03
"""on grass by as much, along and across. A search comes down from too much of every noise: from too
little of two it buys the one for the other."""


def is_of_a_room(nodes: Nodes) -> bool:
    """Tell whether a reference measures to a centimetre or two, as in a room, if there is one."""
    x_m, y_m, _ = nodes.reference_noise if len(nodes.sample_t_s) >= 3 else (0.0, 0.0, 0.0)
    return math.hypot(x_m, y_m) / math.sqrt(2.0) < _OF_A_ROOM_M


def starts(nodes: Nodes, prior: LevelPrior) -> list[Floats]:
    """Return levels float64[levels] for a few wanders of the reference about its white noise."""
    if len(nodes.sample_t_s) < 3:
        return []
    x_m, y_m, heading_rad = nodes.reference_noise
    noises = {"position_m": math.hypot(x_m, y_m) / math.sqrt(2.0)}
    if nodes.has_heading:
        noises["heading_rad"] = heading_rad
    found = []
    for wander, memory_s in product(_WANDERS, _MEMORIES_S):
        levels = prior.median.copy()
        for name, white in noises.items():
            levels[LEVELS.index(f"reference_{name}")] = white
            levels[LEVELS.index(f"reference_slow_{name}")] = wander * white
        levels[LEVELS.index("reference_slow_s")] = memory_s
        found.append(np.maximum(levels, FLOORS))
    return found


def with_slip(levels: Floats, prior: LevelPrior) -> Floats | None:
    """Return the same levels with wheels that slip along and across beside a reference that does
    not wander, float64[levels]; None unless they tell of wheels that are rough or of a wander that
    lasts for long and is more than described."""
    wanders = [LEVELS.index(f"reference_slow_{name}") for name in ("position_m", "heading_rad")]
    told = [one for one in wanders if one not in prior.silent]
    is_more = bool(np.any(levels[told] > prior.median[told]))
    if levels[CONTACT] < _ROUGH_M_PER_SQRT_M and not (is_more and levels[SLOW] > _LONG_S):
        return None
    slips = levels.copy()
    slips[SLIP_WANDER] = max(levels[SLIP_WANDER], _SLIPS)
    slips[LATERAL] = max(levels[LATERAL], _SKIDS_M_PER_SQRT_M)
    slips[wanders] = prior.low[wanders]
    slips[SLOW] = prior.median[SLOW]
    return slips


def with_stamps_off(levels: Floats) -> list[Floats]:
    """Return the same levels with stamps that are off by more, as far as they are not already.

    Hardly anything depends on how little they are off: no slope leads away from there.
    """
    found = []
    for off_s in _STAMPS_S:
        if levels[STAMP] < off_s:
            more = levels.copy()
            more[STAMP] = off_s
            found.append(more)
    return found
