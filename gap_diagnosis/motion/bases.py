"""Functions of what a leftover may depend on: smooth ones of a variable, and the plainest."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.explanations.gyro import rounded_off
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats

_HATS: Final = 5
_HARMONICS: Final = 2
_LEAST_RANGE: Final = {
    "speed": 0.05,
    "acceleration": 0.1,
    "turn_rate": 0.1,
    "lateral_acceleration": 0.05,
}
"""A variable that varies less [SI] is noise: a function of it would fit the noise."""
_STRAIGHT_RAD_S: Final = 0.05
"""So fast a robot on a straight may seem to turn."""
_STRAIGHT_OVER_S: Final = 0.3
"""Over which a gyro is asked for it: its noise is none."""
_STILL_RAD_S: Final = 0.1
"""Wheels that are slower turn neither tightly nor widely."""
_DRIVING_M_S: Final = 0.02
"""A robot that is slower drives neither forward nor back."""
_TURNING_RAD_S: Final = 0.1
"""A wheel that is slower turns neither way."""
PLAY_RAD: Final = 0.05
"""A wheel's way after its reversal on which counts may be lost; it may be less, or some more."""
_PLAYS_RAD: Final = (0.0, 0.005, 0.015, PLAY_RAD)
_AFTER_M: Final = (0.0, 0.05, 0.1, 0.2)
"""Ways after a reversal on which a caster turns over."""


@dataclass(frozen=True)
class Basis:
    """Functions of a variable, and the simplest combinations of them.

    Attributes:
        functions: float64[n] each, or float64[2, n] of both wheels, or both directions of a room.
        simple: float64[functions, k] each.
        is_even: the functions add up to one everywhere.
        listed: of `simple`, those that do as a listed effect does where it is in the library.
        within_per_s: how large each is for a second that a sensor is ahead of the wheels: a gyro
            says more of a body that turns faster and faster. A healthy one may be ahead by little.
    """

    functions: list[Floats]
    simple: list[Floats] = field(default_factory=list)
    is_even: bool = False
    listed: Mapping[int, str] = field(default_factory=dict)
    within_per_s: list[float] = field(default_factory=list)


_LEAST_ANGLE_RAD: Final = 0.3
"""What goes with an angle is told where that changes by more than its noise, which on a straight is
all that a heading does."""
_REVERSES: Final = 0.01
"""Of the way, what goes either way where a robot reverses."""


def basis(motion: Motion, stage: str, variable: str) -> Basis:
    """Return functions of a variable for a stage; none where it does not vary."""
    own = _OWN_BASIS.get((stage, variable))
    base = _of_the_body(motion, variable) if own is None else own(motion)
    if stage in {"wheel", "encoder"} and base.is_even:
        # A wheel that is off by as much everywhere; of a gyro, a list knows every such cause.
        base.simple.append(np.ones((len(base.functions), 1)))
    return base


def _of_the_body(motion: Motion, variable: str) -> Basis:
    """Return functions of a variable; none where it does not vary."""
    if variable in {"heading", "wheel_angle_left", "wheel_angle_right"}:
        angle = {
            "heading": motion.heading_rad,
            "wheel_angle_left": motion.left_angle_rad,
            "wheel_angle_right": motion.right_angle_rad,
        }[variable]
        if np.ptp(angle) < _LEAST_ANGLE_RAD:
            return Basis([])
        return Basis(
            [
                function(order * angle)
                for order in range(1, _HARMONICS + 1)
                for function in (np.cos, np.sin)
            ],
            [np.eye(2 * _HARMONICS)[:, 2 * order : 2 * order + 2] for order in range(_HARMONICS)],
        )
    if variable == "direction":
        ways_m = motion.speed_m_s * motion.dt_s
        back_m, forth_m = np.maximum(-ways_m, 0.0).sum(), np.maximum(ways_m, 0.0).sum()
        # At rest a noisy reference trembles to and fro: no robot has reversed by that.
        reverses = min(back_m, forth_m) > _REVERSES * (back_m + forth_m)
        return Basis([np.tanh(motion.speed_m_s / 0.02)] if reverses else [])
    value = _variable(motion, variable)
    return Basis([]) if value is None else _of_varying(value, _LEAST_RANGE.get(variable, 0.0))


def _of_varying(value: Floats, least: float) -> Basis:
    """Return functions of a variable that varies by more than its noise: usually, or three times as
    much for a hundredth of the time, as a robot does that speeds up once and brakes once."""
    if np.subtract(*np.percentile(value, [95, 5])) >= least:
        return _hats(value)
    if np.subtract(*np.percentile(value, [99.5, 0.5])) >= 3.0 * least:
        return _hats(value, _SELDOM)
    return Basis([])


def _joined(first: Basis, second: Basis) -> Basis:
    """Return the functions of both, and of either of them by itself."""
    count = len(first.functions)
    whole = np.eye(count + len(second.functions))
    simple = [whole[:, :count], *(whole[:, :count] @ one for one in first.simple)]
    simple += [whole[:, count:], *(whole[:, count:] @ one for one in second.simple)]
    return Basis([*first.functions, *second.functions], [one for one in simple if one.size])


def _by_speeding_up(motion: Motion) -> Basis:
    """Return functions of the robot's speeding up, and of its turning faster."""
    turning = np.gradient(motion.turn_rate_rad_s, motion.elapsed_s)
    of_the_body = _of_the_body(motion, "acceleration")
    of_turns = _of_varying(turning, _LEAST_RANGE["acceleration"])
    largest = float(np.abs(np.percentile(turning, [1, 99])).max())
    within_per_s = [0.0] * len(of_the_body.functions) + [largest] * len(of_turns.functions)
    return replace(_joined(of_the_body, of_turns), within_per_s=within_per_s)


def _by_forces(motion: Motion) -> Basis:
    """Return functions of what pulls across, and of what pulls along with it; the plainest is one
    force in whatever direction of the body."""
    across = _of_the_body(motion, "lateral_acceleration")
    along = _of_the_body(motion, "acceleration")
    if not across.functions or not along.functions:
        return across
    first = len(across.functions)
    both = np.zeros((first + len(along.functions), 2))
    both[:first, :1], both[first:, 1:] = across.simple[0], along.simple[0]
    alone = np.eye(len(both))[:, :first]
    return Basis([*across.functions, *along.functions], [alone, both[:, :1], both])


def _by_rate(motion: Motion) -> Basis:
    """Return functions of the turn rate: hats, and a scale that bends with the rate's size or
    differs between the sides. Hats follow a bend by straight lines, which a gyro tells from it."""
    motion = replace(motion, turn_rate_rad_s=motion.turn_rate_rad_s + rounded_off(motion))
    by_rate = _of_the_body(motion, "turn_rate")
    if not by_rate.functions:
        return by_rate
    rate = motion.turn_rate_rad_s / float(np.abs(motion.turn_rate_rad_s).max())
    size = np.abs(rate)
    hats = len(by_rate.functions)
    whole = np.eye(hats + 3)
    plain = whole[:, :hats] @ by_rate.simple[0]
    uneven, bent = whole[:, hats : hats + 1], np.hstack([plain, whole[:, hats + 1 :]])
    functions = [*by_rate.functions, size, rate * size, rate**3]
    return Basis(functions, [plain, whole[:, :hats], uneven, bent])


def _by_place(motion: Motion) -> Basis:
    """Return shifts in either direction, float64[2, n] each, by where the robot is; the plainest is
    a scale of the room."""
    by_x, by_y = _hats(motion.x_m), _hats(motion.y_m)
    functions = []
    scale: list[float] = []
    for direction, (base, way) in enumerate(((by_x, motion.x_m), (by_y, motion.y_m))):
        extent = float(np.abs(way).max())
        for place, hat in enumerate(base.functions):
            for shifted in (0, 1):
                shift = np.zeros((2, len(hat)))
                shift[shifted] = hat
                functions.append(shift)
                along = float(base.simple[0][place, 0]) * extent
                scale.append(along if shifted == direction else 0.0)
    if not functions:
        return Basis([])
    column = np.array(scale)[:, np.newaxis]
    return Basis(functions, [column / np.abs(column).max()])


def _by_heading(motion: Motion) -> Basis:
    """Return functions of the heading about the body: what is off evenly there turns with it."""
    turning = _of_the_body(motion, "heading")
    if not turning.functions:
        return turning
    even = Basis([np.ones(len(motion.t_s))])
    return _joined(turning, even)


def _by_turning(motion: Motion) -> Basis:
    """Return functions of how fast the robot turns, and of how tightly."""
    by_rate = _of_the_body(motion, "turn_rate")
    if not by_rate.functions:
        return by_rate
    across = motion.wheelbase_m * np.abs(motion.turn_rate_rad_s)
    along = 2.0 * np.abs(motion.speed_m_s)
    tightness = across / np.maximum(across + along, motion.radius_m * _STILL_RAD_S)
    return _joined(by_rate, _hats(turns(motion) * tightness))


def turns(motion: Motion) -> Floats:
    """Tell from 0 to 1, float64[n], whether the robot turns at all: what the wheels say of a turn
    on a straight is their noise, which a function of it would take away.

    Without a reference the gyro must say so as well: one wheel that loses counts seems to turn.
    """
    rate2 = motion.turn_rate_rad_s**2
    if motion.gyro_turn_rad is not None and not motion.bent.any():
        width = _STRAIGHT_OVER_S / motion.tick_s
        seen = gaussian_filter1d(np.gradient(motion.gyro_turn_rad, motion.t_s), width)
        rate2 = np.minimum(rate2, seen**2)
    return np.asarray(rate2 / (rate2 + _STRAIGHT_RAD_S**2))


def _by_reversal(motion: Motion) -> Basis:
    """Return stretches of the way after each reversal, in the sense in which the robot turned last
    before it, and in that of its driving: a caster that turns over pushes aslant. The plainest is
    one push over any of these ways."""
    drives = _last_sign(motion.speed_m_s, _DRIVING_M_S)
    turned = np.flatnonzero((drives[1:] != drives[:-1]) & (drives[:-1] != 0)) + 1
    if len(turned) == 0:
        return Basis([])
    last = np.searchsorted(turned, np.arange(len(drives)), side="right") - 1
    way_m = np.cumsum(np.abs(motion.speed_m_s) * motion.dt_s)
    since_m = np.where(last >= 0, way_m - way_m[turned[last]], math.inf)
    before = _last_sign(motion.turn_rate_rad_s, _STRAIGHT_RAD_S)[turned[last] - 1]
    ends = list(pairwise(_AFTER_M))
    functions = [
        sense * ((since_m >= start) & (since_m < stop))
        for sense in (before, drives)
        for start, stop in ends
    ]
    whole = np.eye(len(functions))
    simple = [
        whole[:, first : first + length].sum(axis=1, keepdims=True)
        for first in (0, len(ends))
        for length in range(1, len(ends) + 1)
    ]
    return Basis(functions, simple)


def _by_each_wheels_reversal(motion: Motion) -> Basis:
    """Return stretches of the way after each of a wheel's own reversals, float64[2, n] for each
    wheel: behind a play it is counted before the wheel follows. The plainest is the play of one
    wheel, of any of these ways."""
    functions: list[Floats] = []
    simple: list[tuple[int, int]] = []
    for wheel, rate in enumerate((motion.left_rate_rad_s, motion.right_rate_rad_s)):
        goes = _last_sign(rate, _TURNING_RAD_S)
        turned = np.flatnonzero((goes[1:] != goes[:-1]) & (goes[:-1] != 0)) + 1
        if len(turned) == 0:
            continue
        last = np.searchsorted(turned, np.arange(len(goes)), side="right") - 1
        way_rad = np.cumsum(np.abs(rate) * motion.dt_s)
        since_rad = np.where(last >= 0, way_rad - way_rad[turned[last]], math.inf)
        first = len(functions)
        for start_rad, stop_rad in pairwise(_PLAYS_RAD):
            after = np.zeros((2, len(goes)))
            after[wheel] = (since_rad >= start_rad) & (since_rad < stop_rad)
            functions.append(after)
            simple.append((first, len(functions)))
    whole = np.eye(len(functions))
    return Basis(
        functions, [whole[:, first:end].sum(axis=1, keepdims=True) for first, end in simple]
    )


def _by_each_wheels_speed(motion: Motion) -> Basis:
    """Return functions of how fast each wheel turns, float64[2, n] each: an encoder that is too
    slow, or read too seldom. The plainest are of one wheel: evenly, or the more the faster.

    Averaged over all of a cruise, as the body's speed is: the counts' noise is none of it.
    """
    speeds = [motion.radius_m * np.abs(one.own_rad_s) for one in motion.wheel_speeds.both]
    bases = [_of_varying(one, _LEAST_RANGE["speed"]) for one in speeds]
    count = sum(len(base.functions) for base in bases)
    functions: list[Floats] = []
    simple: list[Floats] = []
    listed: dict[int, str] = {}
    for wheel, base in enumerate(bases):
        if not base.functions:
            continue
        own = np.eye(count)[:, len(functions) : len(functions) + len(base.functions)]
        plainest = [own.sum(axis=1, keepdims=True), own @ base.simple[0]]
        listed |= {len(simple) + place: "missed_ticks" for place in range(len(plainest))}
        simple += [*plainest, own]
        for hat in base.functions:
            both = np.zeros((2, len(hat)))
            both[wheel] = hat
            functions.append(both)
    return Basis(functions, simple, listed=listed)


def _last_sign(value: Floats, least: float) -> Floats:
    """Return the sign of a value, float64[n], where it is smaller the last before; 0 at first."""
    known = np.where(np.abs(value) > least, np.arange(len(value)), -1)
    last = np.maximum.accumulate(known)
    return np.where(last >= 0, np.sign(value[last]), 0.0)


def _by_each_wheels_acceleration(motion: Motion) -> Basis:
    """Return functions of each wheel's speeding up, float64[2, n] each."""
    rates = np.array([motion.left_rate_rad_s, motion.right_rate_rad_s])
    changes = np.array([motion.left_acceleration_rad_s2, motion.right_acceleration_rad_s2])
    value = motion.radius_m * changes * np.sign(rates)
    return _of_varying(value, _LEAST_RANGE["acceleration"])


def _steady_speed_m_s(motion: Motion) -> Floats:
    """Return the speed, float64[n], averaged over all of a cruise: what counts lose by chance is
    missing in the speed that they say, and a function of that would follow it."""
    left, right = (one.own_rad_s for one in motion.wheel_speeds.both)
    return np.asarray(0.5 * motion.radius_m * (left + right))


def _variable(motion: Motion, name: str) -> Floats | None:
    if name == "distance":
        return np.asarray(np.cumsum(np.abs(motion.speed_m_s) * motion.dt_s))
    known: dict[str, Floats | None] = {
        "speed": _steady_speed_m_s(motion),
        "acceleration": motion.acceleration_m_s2,
        "turn_rate": motion.turn_rate_rad_s,
        "lateral_acceleration": motion.speed_m_s * motion.turn_rate_rad_s,
        "temperature": motion.warm_k,
        "supply": motion.supply_error,
        "time": motion.elapsed_s,
    }
    return known[name]


_USUAL: Final = (1.0, 99.0)
_SELDOM: Final = (0.5, 99.5)


def _hats(value: Floats, ends: tuple[float, float] = _USUAL) -> Basis:
    """Return hats over the range between two percentiles, and what of them is proportional to the
    value."""
    low, high = np.percentile(value, ends)
    if not high - low > 1e-9 * max(abs(low), abs(high), 1.0):
        return Basis([])
    place = np.clip((value - low) / (high - low), 0, 1) * (_HATS - 1)
    middles = np.linspace(low, high, _HATS)[:, np.newaxis]
    return Basis(
        [np.maximum(0.0, 1 - np.abs(place - index)) for index in range(_HATS)],
        [middles / np.abs(middles).max()],
        is_even=True,
    )


_OWN_BASIS: Final[Mapping[tuple[str, str], Callable[[Motion], Basis]]] = {
    ("wheel", "acceleration"): _by_each_wheels_acceleration,
    ("wheel", "turn_rate"): _by_turning,
    ("wheel", "reversal"): _by_reversal,
    ("encoder", "speed"): _by_each_wheels_speed,
    ("encoder", "reversal"): _by_each_wheels_reversal,
    ("reference", "heading"): _by_heading,
    ("reference", "place"): _by_place,
    ("gyro", "acceleration"): _by_speeding_up,
    ("gyro", "lateral_acceleration"): _by_forces,
    ("gyro", "turn_rate"): _by_rate,
}
"""Functions of a variable where they are not the body's."""
