"""What the robot of a case is told to drive: drawn anew for each."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from hil_harness.scenarios.model import Scenario
from hil_harness.scenarios.profile import Segment, SegmentProfile

Draw = np.random.Generator

FAMILIAR: Final = ("calibration", "tour", "squares")
FRESH: Final = ("mowing", "eights", "docking")
"""Nothing but a trial diagnoses these, no test does (a test sees to it): what was wrong in one is
mended, and then it is none of these any more."""
ONCE_FRESH: Final = ("weave", "delivery", "one_way")
"""Which came up in tests once mistakes of the first trials were read."""
NEW: Final = (*ONCE_FRESH, *FRESH)
"""Not used while the diagnosis was developed: scored apart."""

SHORT: Final = "short"
"""A third of a minute: enough for what shows in every motion, and for trials in a hurry."""

_RAMP_S: Final = 0.8


def drive(kind: str, draw: Draw, fastest_m_s: float, *, pace: float = 1.0) -> Scenario:
    """Return a drive of about a minute: *kind* of `FAMILIAR` or `NEW`, or `SHORT`.

    *pace*: by which all its speeds and turn rates are multiplied; it takes as long.
    """
    segments = [_rest(draw.uniform(3, 6)), *_KINDS[kind](draw, fastest_m_s), _rest(3.0)]
    segments = [
        replace(one, v_m_s=pace * one.v_m_s, w_rad_s=pace * one.w_rad_s) for one in segments
    ]
    profile = SegmentProfile(segments, final_ramp_s=_RAMP_S)
    return Scenario(
        name="drive",
        description="the drive of a blind trial",
        profile=profile,
        duration_s=math.ceil(profile.duration_s) + 1.0,
    )


def _rest(duration_s: float = 1.5) -> Segment:
    return Segment(0.0, 0.0, duration_s, _RAMP_S)


def _go(v_m_s: float, w_rad_s: float, duration_s: float) -> Segment:
    return Segment(v_m_s, w_rad_s, duration_s, _RAMP_S)


def _speed(draw: Draw, fastest_m_s: float) -> float:
    return float(fastest_m_s * draw.uniform(0.5, 1.0))


def _turn(draw: Draw) -> float:
    return float(draw.uniform(0.6, 1.6))


def _calibration(draw: Draw, fastest_m_s: float) -> list[Segment]:
    """Return lines at two speeds, spins and arcs both ways and a reverse, in any order."""
    v, w = _speed(draw, fastest_m_s), _turn(draw)
    parts = [
        [_go(v, 0.0, draw.uniform(4, 7))],
        [_go(0.4 * v, 0.0, draw.uniform(4, 7))],
        [_go(-0.5 * v, 0.0, draw.uniform(3, 6))],
        [_go(0.0, w, draw.uniform(4, 7))],
        [_go(0.0, -w, draw.uniform(4, 7))],
        [_go(0.6 * v, 0.5 * w, draw.uniform(4, 7))],
        [_go(0.8 * v, -0.5 * w, draw.uniform(4, 7))],
    ]
    order = draw.permutation(len(parts))
    return [one for place in order for one in (*parts[place], _rest())]


def _tour(draw: Draw, fastest_m_s: float) -> list[Segment]:
    """Return a chain of arcs and lines with few stops."""
    found = []
    for _ in range(9):
        v = _speed(draw, fastest_m_s) * float(draw.choice([1.0, 1.0, 1.0, -0.6]))
        w = float(draw.choice([0.0, 1.0, -1.0])) * _turn(draw) * 0.6
        found.append(_go(v, w, draw.uniform(4, 7)))
        if draw.random() < 0.3:
            found.append(_rest())
    return found


def _squares(draw: Draw, fastest_m_s: float) -> list[Segment]:
    """Return a square one way and one the other, stopping to turn at each corner."""
    v, w = _speed(draw, fastest_m_s), _turn(draw)
    side_s, corner_s = draw.uniform(4, 6), math.pi / 2 / w
    found = []
    for sign in (1.0, -1.0):
        for _ in range(4):
            found += [_go(v, 0.0, side_s), _rest(1.0), _go(0.0, sign * w, max(corner_s, 1.0))]
            found.append(_rest(1.0))
    return found


def _weave(draw: Draw, fastest_m_s: float) -> list[Segment]:
    """Return weaving ahead, left and right in turn."""
    v, w, sign = _speed(draw, fastest_m_s), 0.4 * _turn(draw), 1.0
    found = []
    for _ in range(14):
        found.append(_go(v, sign * w * draw.uniform(0.6, 1.0), draw.uniform(3, 5)))
        sign = -sign
    return found


def _delivery(draw: Draw, fastest_m_s: float) -> list[Segment]:
    """Return starts and stops with turns of any angle between them."""
    found = []
    for _ in range(8):
        found += [
            _go(_speed(draw, fastest_m_s), 0.0, draw.uniform(2, 5)),
            _rest(draw.uniform(1, 3)),
        ]
        found.append(_go(0.0, float(draw.choice([-1.0, 1.0])) * _turn(draw), draw.uniform(1, 3)))
    return found


def _one_way(draw: Draw, fastest_m_s: float) -> list[Segment]:
    """Return a spiral: turns to one side only."""
    v, sign = _speed(draw, fastest_m_s), float(draw.choice([-1.0, 1.0]))
    found = []
    for step in range(9):
        found.append(_go(v, sign * _turn(draw) * (1 - step / 12), draw.uniform(4, 7)))
        if step % 3 == 2:
            found.append(_rest())
    return found


def _mowing(draw: Draw, fastest_m_s: float) -> list[Segment]:
    """Return rows side by side, with a half turn to either side in turn at their ends."""
    v, w = _speed(draw, fastest_m_s), _turn(draw)
    row_s, side = draw.uniform(5, 7), float(draw.choice([-1.0, 1.0]))
    found = []
    for _ in range(6):
        found += [_go(v, 0.0, row_s), _go(0.5 * v, side * w, math.pi / w)]
        side = -side
    return found


def _eights(draw: Draw, fastest_m_s: float) -> list[Segment]:
    """Return circles to the left and to the right in turn, each at a speed of its own."""
    found = []
    for step in range(8):
        w = 0.5 * (1.0 + _turn(draw))
        found.append(_go(_speed(draw, fastest_m_s), w if step % 2 else -w, math.tau / w))
    return found


def _docking(draw: Draw, fastest_m_s: float) -> list[Segment]:
    """Return creeping up to something and back again, with long waits and small corrections."""
    found = []
    for _ in range(6):
        creep = 0.3 * _speed(draw, fastest_m_s)
        found += [
            _go(creep, 0.0, draw.uniform(2, 4)),
            _rest(draw.uniform(2, 4)),
            _go(0.0, float(draw.choice([-0.3, 0.3])) * _turn(draw), draw.uniform(1, 2)),
            _go(-creep, 0.1 * float(draw.choice([-1.0, 1.0])) * _turn(draw), draw.uniform(2, 4)),
        ]
    return found


def _short(draw: Draw, fastest_m_s: float) -> list[Segment]:
    """Return a line, a spin, an arc the other way and a reverse."""
    v, w = _speed(draw, fastest_m_s), _turn(draw)
    return [
        _go(v, 0.0, draw.uniform(3, 4)),
        _go(0.0, w, draw.uniform(2, 3)),
        _go(0.8 * v, -0.4 * w, draw.uniform(3, 4)),
        _go(-0.6 * v, 0.0, draw.uniform(2, 3)),
    ]


_KINDS: Final[Mapping[str, Callable[[Draw, float], list[Segment]]]] = {
    "calibration": _calibration,
    "tour": _tour,
    "squares": _squares,
    "weave": _weave,
    "delivery": _delivery,
    "one_way": _one_way,
    "mowing": _mowing,
    "eights": _eights,
    "docking": _docking,
    SHORT: _short,
}
