"""Is something wrong by a sign or a factor? Only then are mistakes of the set-up tried."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.stats import chi2

from gap_diagnosis.bends import noise_by_bends
from gap_diagnosis.explanations.standstill import dead_ticks
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.offset import turns_of
from gap_diagnosis.motion.seen import is_seen
from gap_diagnosis.prediction import Motion
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats, Recording, Reference
from hil_harness.effects.model import Value
from hil_harness.robot import Robot

_LOW: Final = 0.7
_HIGH: Final = 1.4
_BLOCK_S: Final = 0.5
_STILL: Final = 1e-4
_MOVES: Final = 1e-3
"""Squares of ways [m] or turns [rad] in blocks, added up: less is rest, more is none."""
_STEPS_S: Final = (2.0, 1.0, 0.5)
"""Over which, on average, a course without headings is compared: between two clocks half a second
matters little. Over a shorter time where that says nothing: a small robot turns round in two
seconds, and of a turn by more than half a circle no step tells to which side it was."""
_LEAST_STEPS: Final = 8
_SHORT_M: Final = 0.01
_SMALL: Final = 1e-9
_SURE: Final = 2.0
_SURELY: Final = 4.0
"""Standard deviations of what one wheel adds: what a turn leaves is not white."""
_ALIKE: Final = 1e4
"""Condition of both wheels' ways above which neither is told by itself."""
_BY_NOISE: Final = 0.999
"""In so many logs noise adds up to no more than is taken off for it."""
_SHAKES_S: Final = 3.0
"""Over so long a gyro trembles as much."""
_LITTLE: Final = 0.05
"""Share of noise in the wheels' turn up to which one wheel is asked for."""
_LITTLE_OF_ONE: Final = 0.1
"""Of counts that were rounded once more by so little it shows that they were whole."""
_TOGETHER: Final = 0.3
_LOUD: Final = 3.0
"""Correlation over blocks: three times what chance makes in a minute. Where noise has three times
the energy, half is left of it, and beyond that it is not asked for."""


_TOLD: Final = 3.0
"""Standard deviations from none, or from what is usual, at which a ratio is told."""


def looks_gross(recording: Recording, robot: Robot) -> bool:
    """Tell whether turns or ways of two sources differ by more than any effect makes likely, or
    what one wheel adds to the turn does."""
    sources = _sources(recording, robot)
    return any(one.is_gross or one.is_of_one_wheel for one in sources)


class Order(IntEnum):
    """Whether turns and ways of all sources go together, in size and in time; or would, if the
    wheels stood far apart: a skid-steer's turn it as if they stood at twice their track."""

    WHOLE = 0
    FAR_APART = 1
    NONE = 2


def order_of(recording: Recording, robot: Robot) -> Order:
    """Tell whether the sources of a log go together.

    What is divided by a wrong factor may be as large as another source by chance, or so small that
    it has no slope.
    """
    return agreement_of(recording, robot).order


class Agreement(NamedTuple):
    """How the sources of a log go together: in what order, and by how much at least the ways of
    wheels and reference differ (the logarithm of their ratio; 0 where they may be alike)."""

    order: Order
    ways_apart: float


def agreement_of(recording: Recording, robot: Robot) -> Agreement:
    """Tell how the sources of a log go together; see `order_of`."""
    pairs = _sources(recording, robot)
    return Agreement(
        max(map(_order, pairs), default=Order.WHOLE),
        max((one.ways_apart for one in pairs), default=0.0),
    )


def _order(pair: _Pair) -> Order:
    moved, noise = _moved(pair.effect)
    # So many squares of noise scatter about their sum.
    moved -= pair.trembles * float(chi2.ppf(_BY_NOISE, len(pair.effect))) / len(pair.effect)
    if pair.slope is None:
        return Order.NONE if moved > max(_MOVES, noise) else Order.WHOLE
    goes_to_and_fro = not pair.is_length and noise < _LOUD * _power(pair.cause)
    if goes_to_and_fro and pair.correlation < _TOGETHER:
        return Order.NONE
    if not pair.is_gross:
        return Order.WHOLE
    return Order.FAR_APART if pair.is_of_wheels_far_apart else Order.NONE


@dataclass(frozen=True)
class _Pair:
    """What two sources say of the same turns or ways, by blocks.

    Attributes:
        cause, effect: float64[n].
        unsure: how much of the sum of the cause's squares is noise, at most; None: not known.
        wheels: float64[2, n], what either wheel adds to the cause, where it is the wheels' turn.
        is_turn_of_wheels: the cause is what wheels turn about the described track.
        is_length: noise makes the effect longer, never shorter.
        trembles: how much of the sum of the effect's squares its samples' own noise makes.
    """

    cause: Floats
    effect: Floats
    unsure: float | None = 0.0
    wheels: Floats | None = None
    is_turn_of_wheels: bool = False
    is_length: bool = False
    trembles: float = 0.0

    @property
    def slope(self) -> float | None:
        """Of a regression through deviations; None where the cause hardly varies."""
        power = _power(self.cause)
        if power < _STILL:
            return None
        away = self.cause - np.median(self.cause)
        return float(away @ (self.effect - np.median(self.effect))) / power

    @property
    def is_gross(self) -> bool:
        """The ratio is far from one, with and without what noise of the cause takes from it: a car
        that hardly turned had a gyro of half the turns that its noisy wheel speeds made.

        Where nothing is known of that noise, all that is left may be it: then the ratio lies
        between the slope and the inverse of that of the cause on the effect (Fuller 1987,
        Measurement Error Models, section 1.1).
        """
        slope = self.slope
        if slope is None:
            return False
        if self.is_length:
            return self._is_length_gross(slope)
        most, least = self._between(slope)
        return most < _LOW or least > _HIGH

    @property
    def is_of_wheels_far_apart(self) -> bool:
        """The wheels turn by more than the other source, by no more than the widest track that is
        believed makes."""
        if self.slope is None or not self.is_turn_of_wheels:
            return False
        most, least = self._between(self.slope)
        widest = default_prior().of("wheelbase_scale", "scale").most
        return most > 1.0 / (1.0 + widest) and least < _LOW

    def _between(self, slope: float) -> tuple[float, float]:
        """Return the largest and the smallest ratio of effect to cause; both 1 where noise may be
        all."""
        if self.unsure is not None:
            without_noise = slope / (1.0 - self.unsure / _power(self.cause))
        elif self.correlation**2 * len(self.cause) < _TOLD**2:
            return 1.0, 1.0
        else:
            without_noise = slope / self.correlation**2
        return max(slope, without_noise), min(slope, without_noise)

    def _is_length_gross(self, slope: float) -> bool:
        """Fixes that are off by more than a robot goes between them leave no slope, but their steps
        are no shorter than the robot's."""
        at_most = math.sqrt(float(self.effect @ self.effect) / float(self.cause @ self.cause))
        left = _power(self.effect) - slope**2 * _power(self.cause)
        sd = math.sqrt(max(left, 0.0) / (len(self.cause) - 2) / _power(self.cause))
        return at_most < _LOW or slope - _TOLD * sd > _HIGH

    @property
    def ways_apart(self) -> float:
        """The logarithm of the ratio of two lengths, at least: 0 where they may be alike, or where
        these are none. Noise of the effect adds to its steps and hides what goes with the cause."""
        if not self.is_length or self.slope is None:
            return 0.0
        at_most = math.sqrt(float(self.effect @ self.effect) / float(self.cause @ self.cause))
        low, high = sorted((max(self.slope, _SMALL), max(at_most, _SMALL)))
        return max(math.log(low), -math.log(high), 0.0)

    @property
    def correlation(self) -> float:
        """Of the two, about their medians; where the cause varies."""
        slope, power = self.slope, _power(self.effect)
        return (
            0.0 if slope is None or power == 0.0 else slope * math.sqrt(_power(self.cause) / power)
        )

    @property
    def is_of_one_wheel(self) -> bool:
        """What one wheel adds is surely far from what it should: counts of half the size on one
        side leave a turn that is three quarters of it."""
        if self.wheels is None or (self.unsure or 0.0) > _LITTLE * _power(self.cause):
            return False
        rows = self.wheels - self.wheels.mean(axis=1, keepdims=True)
        away = self.effect - self.effect.mean()
        inner = rows @ rows.T
        # Wheels that only ever go together say nothing of one.
        if np.linalg.cond(inner) > _ALIKE:
            return False
        found = np.linalg.solve(inner, rows @ away)
        left = away - found @ rows
        sd = np.sqrt(np.diag(np.linalg.inv(inner)) * (left @ left) / (len(away) - 2))
        return bool(np.any((found + _SURELY * sd < _LOW) | (found - _SURELY * sd > _HIGH)))

    @property
    def is_clear(self) -> bool:
        """No more than half of the cause is known to be noise."""
        return 2.0 * (self.unsure or 0.0) <= _power(self.cause)


def _sources(recording: Recording, robot: Robot) -> list[_Pair]:
    """Return what pairs of sources say of the same turns and ways, where noise lets them."""
    # Each source is looked at by itself: nothing is bent onto the reference.
    motion = estimate_motion(replace(recording, reference=None), robot)
    t_s = np.arange(motion.t_s[0], motion.t_s[-1], _BLOCK_S)
    if len(t_s) < 8:
        return []
    # A wheel that is no longer counted is off by no sign or factor.
    counted = np.diff(np.interp(t_s, motion.t_s, np.cumsum(dead_ticks(motion)))) == 0.0
    turn, *gyro = (np.diff(np.interp(t_s, motion.t_s, one)) for one in turns_of(motion))
    trembles = _noise_of_turns(motion)
    unsure = float(motion.wheel_unsure_rad2.sum()) * (motion.radius_m / motion.wheelbase_m) ** 2
    per_rad = motion.radius_m / motion.wheelbase_m
    wheels = np.array(
        [
            sign * per_rad * np.diff(np.interp(t_s, motion.t_s, angle))
            for sign, angle in ((-1.0, motion.left_angle_rad), (1.0, motion.right_angle_rad))
        ]
    )
    pairs = [
        _Pair(
            turn[counted],
            one[counted],
            counted.mean() * unsure,
            wheels[:, counted],
            is_turn_of_wheels=True,
            trembles=counted.mean() * trembles,
        )
        for one in gyro
        if np.count_nonzero(counted) >= _LEAST_STEPS
    ]
    reference = recording.reference
    if reference is not None and len(reference.t_s) > 8:
        seen = is_seen(t_s, reference.t_s, _BLOCK_S) & counted
        if np.count_nonzero(seen) < _LEAST_STEPS:
            return [one for one in pairs if one.is_clear]
        if reference.heading_rad is not None:
            heading = np.diff(np.interp(t_s, reference.t_s, reference.heading_rad))[seen]
            share = np.count_nonzero(seen) / len(seen)
            pairs.append(_Pair(turn[seen], heading, share * unsure, wheels[:, seen], True))
            pairs += [_Pair(one[seen], heading, share * trembles) for one in gyro]
        way = 0.5 * motion.radius_m * (motion.left_angle_rad + motion.right_angle_rad)
        forward = np.diff(_averaged(t_s, motion.t_s, way))
        # A reference's noise goes nowhere, but adds to every length.
        moved = np.hypot(
            np.diff(_averaged(t_s, reference.t_s, reference.x_m)),
            np.diff(_averaged(t_s, reference.t_s, reference.y_m)),
        )
        pairs.append(_Pair(np.abs(forward[seen]), moved[seen], is_length=True))
        if reference.heading_rad is None and counted.all():
            pairs += next(filter(None, (_bends(motion, reference, s) for s in _STEPS_S)), [])
    return [one for one in pairs if one.is_clear]


def _noise_of_turns(motion: Motion) -> float:
    """Return how much noise of the gyro's samples adds to the squares of its turns over all blocks:
    on a straight that is all there is, and goes with no turn of another source. A robot that drives
    shakes it more than one that stands."""
    if motion.gyro_turn_rad is None:
        return 0.0
    steps = np.diff(motion.gyro_turn_rad)
    parts = np.array_split(np.diff(steps, 2), max(round(len(steps) * motion.tick_s / _SHAKES_S), 1))
    return len(steps) * float(np.mean([noise_by_bends(one) ** 2 for one in parts if len(one)]))


def _bends(motion: Motion, reference: Reference, step_s: float) -> list[_Pair]:
    """Return how far each step of the way, *step_s* on average, leads to the left of the one
    before, as wheels and as a reference without headings have it; nothing where its noise hides by
    which factor they differ.
    """
    first, last = (f(motion.t_s[end], reference.t_s[end]) for f, end in ((max, 0), (min, -1)))
    angle = 0.5 * (motion.left_angle_rad + motion.right_angle_rad)
    way_m = motion.radius_m * np.cumsum(np.abs(np.diff(angle, prepend=angle[0])))
    here = (motion.t_s >= first) & (motion.t_s <= last)
    count = int((last - first) / step_s)
    if count < _LEAST_STEPS or not here.any():
        return []
    # Steps of one length: a turn on the spot is the bend between two of them.
    ends_m = np.linspace(way_m[here][0], way_m[here][-1], count)
    t_s = np.interp(ends_m, way_m[here], motion.t_s[here])
    ours, theirs = (
        np.diff(np.interp(t_s, one.t_s, one.x_m) + 1j * np.interp(t_s, one.t_s, one.y_m))
        for one in (motion, reference)
    )
    # By our own lengths: in metres aside a reference's noise is the same at any speed.
    longer_m = np.maximum(np.maximum(np.abs(ours[1:]), np.abs(ours[:-1])), _SHORT_M)
    seen = is_seen(t_s, reference.t_s, _BLOCK_S)
    seen = seen[1:] & seen[:-1]
    if np.count_nonzero(seen) < _LEAST_STEPS:
        return []
    cause, effect = (
        ((steps[1:] * np.conj(steps[:-1])).imag / longer_m)[seen] for steps in (ours, theirs)
    )
    pair = _Pair(cause, effect, unsure=None, is_turn_of_wheels=True)
    if pair.slope is None:
        return []
    left = (effect - np.median(effect)) - pair.slope * (cause - np.median(cause))
    sd = math.sqrt(float(left @ left) / (len(left) - 2) / _power(cause))
    return [pair] if _SURE * sd < min(1.0 - _LOW, _HIGH - 1.0) else []


def _averaged(at_s: Floats, t_s: Floats, values: Floats) -> Floats:
    """Return values around some times, averaged over a block."""
    width = 0.5 * _BLOCK_S / float(np.median(np.diff(t_s)))
    averaged = gaussian_filter1d(values, width, mode="nearest")
    return np.asarray(np.interp(at_s, t_s, averaged))


def _swapped(recording: Recording) -> Recording:
    """Return the recording with what each wheel says told of the other one."""
    left_step, right_step = recording.counts_per_step
    unsure = recording.unsure_ticks2
    return replace(
        recording,
        left_ticks=recording.right_ticks,
        right_ticks=recording.left_ticks,
        counts_per_step=(right_step, left_step),
        unsure_ticks2=None if unsure is None else unsure[::-1],
    )


def put_right(
    recording: Recording, effect: str, values: Mapping[str, Value]
) -> tuple[Recording, float]:
    """Return the recording without this mistake, and the log of how much that narrows its rates.

    *values* are the mistake's parameters.
    """
    left, right = recording.left_ticks, recording.right_ticks
    if effect == "setup_wheels_swapped":
        return _swapped(recording), 0.0
    factor = -1.0 if effect == "setup_sign" else float(values["factor"])
    signal = values["signal"]
    if signal == "reference":
        reference = recording.reference
        mirrored = None if reference is None else reference.mirrored()
        return replace(recording, reference=mirrored), 0.0
    if signal != "gyro":
        wrong = {"left_ticks": (True, False), "right_ticks": (False, True)}.get(
            str(signal), (True, True)
        )
        left, right = (
            ticks / factor if is_wrong else ticks
            for ticks, is_wrong in zip((left, right), wrong, strict=True)
        )
        sides = (recording.left_ticks, recording.right_ticks)
        steps = [
            _step_of(ticks, factor, step) if is_wrong else step
            for ticks, step, is_wrong in zip(sides, recording.counts_per_step, wrong, strict=True)
        ]
        unsure = recording.unsure_ticks2
        if unsure is not None:
            unsure = unsure / np.where(wrong, factor**2, 1.0)[:, np.newaxis]
        undone = replace(
            recording,
            left_ticks=left,
            right_ticks=right,
            counts_per_step=(steps[0], steps[1]),
            unsure_ticks2=unsure,
        )
        return undone, 0.0
    rate = recording.gyro_rate_rad_s
    if rate is None:
        return recording, 0.0
    return replace(recording, gyro_rate_rad_s=rate / factor), -math.log(abs(factor))


def _step_of(ticks: Floats, factor: float, step: float) -> float:
    """Return by how many counts a reading of *ticks* steps once a wrong factor is undone.

    What read a tenth was rounded to counts as well, and then goes by tens; what read ten times as
    much goes by tenths, unless it was multiplied once it was counted.
    """
    times = abs(factor)
    counts = np.diff(ticks[np.isfinite(ticks)]) / times
    rounded = 0.0 if times == round(times) else 1.0 / times
    was_counted = times > 1 and np.all(np.abs(counts - np.rint(counts)) <= rounded + 1e-6)
    return step if was_counted and rounded < _LITTLE_OF_ONE else step / times


def _moved(steps: Floats) -> tuple[float, float]:
    """Return the squares of a source's steps, added up, without those of the noise of its samples,
    and the latter: what is off at one time is taken back by the next step (Roll 1984, J. Finance
    39:4)."""
    away = steps - np.median(steps)
    noise = max(-2.0 * float(away[1:] @ away[:-1]), 0.0)
    return max(_power(steps) - noise, 0.0), noise


def _power(values: Floats) -> float:
    away = values - np.median(values)
    return float(away @ away)
