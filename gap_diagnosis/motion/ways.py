"""In which ways each stage can err: what a function of a variable adds, and usual sizes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.explanations.gyro import rate_of_columns
from gap_diagnosis.motion.bases import PLAY_RAD, turns
from gap_diagnosis.prediction import Prediction
from gap_diagnosis.recording import Floats


@dataclass(frozen=True)
class Way:
    """One way in which a stage can err: what a unit function adds, and usual sizes.

    Up to about *within*, half of what a description may be off by, it is no gap. What it changes is
    taken over *chord*, if that is given, or else over the middle of its sizes. *evenly*: the effect
    that it is where it is the same everywhere; *for_a_while*: where it is so in a window.
    *words*: what it does, with a place for its `size` and one for its `sense`, of which there are
    two.
    """

    stage: str
    act: Callable[[Prediction, Floats], None]
    low: float
    high: float
    within: float
    needs_reference: bool = False
    needs_gyro: bool = False
    chord: float | None = None
    evenly: str = ""
    for_a_while: str = ""
    words: str = ""
    senses: tuple[str, str] = ("farther", "less far")

    @property
    def step(self) -> float:
        """The size over which its change is taken."""
        return math.sqrt(self.low * self.high) if self.chord is None else self.chord

    def told(self, size: float) -> str:
        """Return what so much of it does."""
        return self.words.format(size=abs(size), sense=self.senses[size < 0])


def _steadied(p: Prediction) -> tuple[Floats, Floats]:
    """Return the wheels' ways in each tick [m] without what they say of a turn on a straight: that
    is their noise, which a function would take away where nothing else tells the way."""
    ahead = 0.5 * (p.left_m + p.right_m)
    aside = 0.5 * turns(p.motion) * (p.right_m - p.left_m)
    return ahead - aside, ahead + aside


def _forward(p: Prediction, f: Floats) -> None:
    left, right = _steadied(p)
    p.left_m = p.left_m + f * left
    p.right_m = p.right_m + f * right


def _each_wheel(p: Prediction, f: Floats) -> None:
    left, right = _steadied(p)
    p.left_m = p.left_m + f[0] * left
    p.right_m = p.right_m + f[1] * right


def _downhill(p: Prediction, f: Floats) -> None:
    left, right = _steadied(p)
    p.left_m = p.left_m + f * np.abs(left)
    p.right_m = p.right_m + f * np.abs(right)


def _turn(p: Prediction, f: Floats) -> None:
    p.yaw_rad = p.yaw_rad + f * 0.5 * (np.abs(p.left_m) + np.abs(p.right_m)) / p.wheelbase_m


def _turn_gain(p: Prediction, f: Floats) -> None:
    p.yaw_rad = p.yaw_rad + f * turns(p.motion) * (p.right_m - p.left_m) / p.wheelbase_m


def _lateral(p: Prediction, f: Floats) -> None:
    p.lateral_m = p.lateral_m + f * 0.5 * (np.abs(p.left_m) + np.abs(p.right_m))


def _aslant(p: Prediction, f: Floats) -> None:
    p.lateral_m = p.lateral_m + np.abs(p.forward_m) * f


def _left(p: Prediction, f: Floats) -> None:
    p.left_m = p.left_m * (1 + f)


def _right(p: Prediction, f: Floats) -> None:
    p.right_m = p.right_m * (1 + f)


def _left_as_time_goes(p: Prediction, f: Floats) -> None:
    p.left_m = p.left_m + f * p.motion.dt_s


def _right_as_time_goes(p: Prediction, f: Floats) -> None:
    p.right_m = p.right_m + f * p.motion.dt_s


def _gyro(p: Prediction, f: Floats) -> None:
    p.gyro_rad_s = p.gyro_rad_s + f


def _gyro_gain(p: Prediction, f: Floats) -> None:
    p.gyro_rad_s = p.gyro_rad_s + f * rate_of_columns(p)


def _reference_along(p: Prediction, f: Floats) -> None:
    p.reference_forward_m = p.reference_forward_m + f


def _reference_across(p: Prediction, f: Floats) -> None:
    p.reference_left_m = p.reference_left_m + f


def _reference_delay(p: Prediction, f: Floats) -> None:
    p.reference_delay_s = p.reference_delay_s + f


def _reference_place(p: Prediction, f: Floats) -> None:
    cosine, sine = np.cos(p.motion.heading_rad), np.sin(p.motion.heading_rad)
    p.reference_forward_m = p.reference_forward_m + f[0] * cosine + f[1] * sine
    p.reference_left_m = p.reference_left_m - f[0] * sine + f[1] * cosine


def _reference_heading(p: Prediction, f: Floats) -> None:
    p.reference_heading_rad = p.reference_heading_rad + f


_GYRO: Final = (
    Way(
        "gyro", _gyro, 1e-3, 0.1, 1.7e-4,
        needs_gyro=True, for_a_while="gyro_bias",
        words="the gyro says about {size:.2g} rad/s {sense}", senses=("too much", "too little"),
    ),
)  # fmt: skip
# A scale may be off by more than it may drift by: of its own tolerance every explanation has some.
_DRIFTING: Final = (*_GYRO, Way("gyro", _gyro_gain, 1e-3, 0.1, 5e-4, needs_gyro=True))


def _of_reference(act: Callable[[Prediction, Floats], None], high: float, evenly: str) -> Way:
    """Return a way in which a reference is shifted or turned about the body."""
    return Way("reference", act, 1e-3, high, 5e-4, needs_reference=True, evenly=evenly)


WAYS: Final[Mapping[str, tuple[Way, ...]]] = {
    "wheel": (
        Way(
            "wheel",
            _forward,
            1e-3,
            0.1,
            1e-3,
            for_a_while="radius_scale",
            words="the wheels roll about {size:.1%} {sense} than they count",
        ),
        Way(
            "wheel",
            _turn,
            1e-3,
            0.1,
            2.5e-4,
            for_a_while="radius_mismatch",
            words="the body turns to the {sense} by about {size:.1%} of its way over its track",
            senses=("left", "right"),
        ),
        Way(
            "wheel",
            _turn_gain,
            1e-3,
            0.1,
            1.5e-3,
            for_a_while="wheelbase_scale",
            words="the body turns about {size:.1%} {sense} than the wheels say",
        ),
        Way(
            "wheel",
            _lateral,
            1e-3,
            0.1,
            5e-4,
            needs_reference=True,
            words="the body goes to the {sense} by about {size:.1%} of its way",
            senses=("left", "right"),
        ),
    ),
    "encoder": (
        Way(
            "encoder",
            _left,
            1e-3,
            0.1,
            2.5e-4,
            for_a_while="one_sided_slip",
            words="the left wheel goes about {size:.1%} {sense} than it counts",
        ),
        Way(
            "encoder",
            _right,
            1e-3,
            0.1,
            2.5e-4,
            for_a_while="one_sided_slip",
            words="the right wheel goes about {size:.1%} {sense} than it counts",
        ),
    ),
    # From three tolerances of the bias on: every gyro's bias wanders by less.
    "gyro": _GYRO,
    "reference": (
        _of_reference(_reference_along, 0.2, "reference_lever_arm"),
        _of_reference(_reference_across, 0.2, "reference_lever_arm"),
        _of_reference(_reference_heading, 0.1, "reference_yaw"),
    ),
}
# Wheels may be off by a tolerance of their size, and drift by half of what wear in 100 s is none.
_WEARING: Final = (Way("wheel", _forward, 1e-3, 0.1, 2.5e-4), *WAYS["wheel"][1:])
OWN_WAYS: Final[Mapping[tuple[str, str], tuple[Way, ...]]] = {
    ("wheel", "time"): _WEARING,
    ("wheel", "distance"): _WEARING,
    # Backing uphill, wheels go too far as they go forward downhill; and what slides down a slope
    # as it drives across does not while it spins on the spot.
    ("wheel", "heading"): (
        Way("wheel", _downhill, 1e-3, 0.1, 5e-4),
        *WAYS["wheel"][1:3],
        Way("wheel", _aslant, 1e-3, 0.1, 5e-4, needs_reference=True),
    ),
    # Tyres slide outward: half a tolerance of that slip, in a turn of 1 rad/s.
    ("wheel", "lateral_acceleration"): (
        *WAYS["wheel"][:3],
        Way("wheel", _lateral, 1e-3, 0.1, 1e-3, needs_reference=True),
    ),
    # A caster turns the body over, and pulls it no way. Half a tolerance of its kick, on 0.1 m.
    ("wheel", "reversal"): (Way("wheel", _turn, 1e-3, 0.1, 1e-3),),
    # On each wheel's own motion, not on the body's.
    ("wheel", "acceleration"): (Way("wheel", _each_wheel, 1e-3, 0.1, 2.5e-4),),
    # Counted, and not followed by the wheel: half a tolerance of play.
    ("encoder", "reversal"): (
        Way("encoder", _each_wheel, 1e-3 / PLAY_RAD, 0.1 / PLAY_RAD, 1e-3 / PLAY_RAD),
    ),
    ("encoder", "speed"): (Way("encoder", _each_wheel, 1e-3, 0.1, 2.5e-4),),
    # Counts that come whether or not a wheel turns.
    ("encoder", "time"): (
        Way("encoder", _left_as_time_goes, 1e-4, 0.05, 2e-5),
        Way("encoder", _right_as_time_goes, 1e-4, 0.05, 2e-5),
    ),
    # In the room's directions, not the body's.
    ("reference", "place"): (
        Way("reference", _reference_place, 1e-3, 0.2, 5e-4, needs_reference=True),
    ),
    ("reference", "time"): (
        # As near as a description's own delay: chords of two lengths differ by the way's bends.
        Way("reference", _reference_delay, 1e-3, 0.2, 1e-3, needs_reference=True, chord=1e-3),
    ),
    # What drifts with its surroundings may be the scale as well as the bias.
    ("gyro", "temperature"): _DRIFTING,
    ("gyro", "supply"): _DRIFTING,
    ("gyro", "time"): _DRIFTING,
}
"""Ways in which a variable acts where they are not the stage's."""
