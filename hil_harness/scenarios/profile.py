"""What a drive commands over time: speed and turn rate, and exactly how far and how much.

Every profile knows the integrals of its rates in closed form. A command that is sent seldom and
held in between can therefore be the *mean* over its hold: the robot then travels the distance and
turns the angle that the profile says, however rarely it is commanded.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from hil_harness.errors import HarnessError

FloatArray = NDArray[np.float64]

J0_FIRST_ZERO: Final = 2.404825557695773
"""First zero of the Bessel function J₀ (Abramowitz and Stegun, table 9.5)."""

_STEP_S: Final = 1e-6
"""A ramp shorter than this is a step."""


class Profile(Protocol):
    """Speed and turn rate over time; times are seconds from the start, shape (n,)."""

    @property
    def duration_s(self) -> float:
        """Time after which the profile is at rest or repeats itself."""

    def rates(self, time_s: FloatArray) -> FloatArray:
        """Return v_m_s and w_rad_s at each time, float64[n, 2]."""

    def travel(self, time_s: FloatArray) -> FloatArray:
        """Return the path in metres and the turn in radians up to each time, float64[n, 2]."""


@dataclass(frozen=True)
class Segment:
    """A stretch of constant speed and turn rate, reached by a smooth ramp at its beginning.

    Attributes:
        v_m_s: speed forward.
        w_rad_s: turn rate, anticlockwise.
        duration_s: length of the segment in time, its ramp included.
        ramp_s: how long the change from the segment before takes; 0 is a step.
    """

    v_m_s: float
    w_rad_s: float
    duration_s: float
    ramp_s: float = 0.5

    def __post_init__(self) -> None:
        """Raise HarnessError for a duration or a ramp that cannot be."""
        if not math.isfinite(self.v_m_s) or not math.isfinite(self.w_rad_s):
            raise HarnessError(f"segment: {self.v_m_s} m/s and {self.w_rad_s} rad/s: not finite")
        if not 0 <= self.ramp_s <= self.duration_s < math.inf:
            raise HarnessError(
                f"segment: ramp of {self.ramp_s} s in {self.duration_s} s: "
                "expected a ramp that is over before the segment is"
            )


class SegmentProfile:
    """Segments one after another, from rest and back to rest.

    A ramp is a cubic, s(u) = 3u² − 2u³, so the acceleration is continuous and at most 1.5 times
    its mean. With equal ramps on both sides a segment covers v_m_s·duration_s and turns by
    w_rad_s·duration_s exactly, the second ramp being that of the segment after it.
    """

    def __init__(self, segments: Sequence[Segment], *, final_ramp_s: float = 0.5) -> None:
        """Follow *segments*; after the last one come to rest within *final_ramp_s*."""
        self.segments = tuple(segments)
        durations = [segment.duration_s for segment in self.segments]
        self._start_s = np.concatenate([[0.0], np.cumsum(durations)])
        ramps_s = np.array([*(segment.ramp_s for segment in self.segments), final_ramp_s])
        self._ramp_s = np.where(ramps_s < _STEP_S, 0.0, ramps_s)
        target = [(segment.v_m_s, segment.w_rad_s) for segment in self.segments]
        self._to = np.array([*target, (0.0, 0.0)])
        self._from = np.concatenate([[(0.0, 0.0)], self._to[:-1]])
        ends = self._segment_travel(np.arange(len(durations)), np.array(durations))
        self._travelled = np.concatenate([np.zeros((1, 2)), np.cumsum(ends, axis=0)])

    @property
    def duration_s(self) -> float:
        """Sum of the segments' durations."""
        return float(self._start_s[-1])

    def rates(self, time_s: FloatArray) -> FloatArray:
        """Return v_m_s and w_rad_s at each time, float64[n, 2]."""
        index, since_s = self._locate(time_s)
        u = _ramp_fraction(since_s, self._ramp_s[index])[:, np.newaxis]
        change = self._to[index] - self._from[index]
        rates: FloatArray = self._from[index] + change * (u * u * (3.0 - 2.0 * u))
        return rates

    def travel(self, time_s: FloatArray) -> FloatArray:
        """Return path and turn up to each time, float64[n, 2]."""
        index, since_s = self._locate(time_s)
        travelled: FloatArray = self._travelled[index] + self._segment_travel(index, since_s)
        return travelled

    def _locate(self, time_s: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
        index = np.searchsorted(self._start_s, time_s, side="right") - 1
        return index, time_s - self._start_s[index]

    def _segment_travel(self, index: NDArray[np.intp], since_s: FloatArray) -> FloatArray:
        ramp_s = self._ramp_s[index]
        u = _ramp_fraction(since_s, ramp_s)
        on_the_ramp_s = ramp_s * (u**3 - 0.5 * u**4)
        after_the_ramp_s = np.maximum(since_s - ramp_s, 0.0)
        change = self._to[index] - self._from[index]
        travel: FloatArray = (
            self._from[index] * since_s[:, np.newaxis]
            + change * (on_the_ramp_s + after_the_ramp_s)[:, np.newaxis]
        )
        return travel


def _ramp_fraction(since_s: FloatArray, ramp_s: FloatArray) -> FloatArray:
    """Return how much of the ramp is over, 0 to 1; a step is over at once."""
    whole = np.ones_like(since_s)
    return np.minimum(np.divide(since_s, ramp_s, out=whole, where=ramp_s > 0.0), 1.0)


@dataclass(frozen=True)
class LessonProfile:
    """Constant speed and a sinusoidal turn rate, from the first tick on: the textbook lesson.

    The rates are the lesson's expression as printed, operation by operation.
    """

    speed_m_s: float = 0.6
    turn_amplitude_rad_s: float = 0.10
    turn_period_s: float = 20.0
    duration_s: float = 60.0

    def rates(self, time_s: FloatArray) -> FloatArray:
        """Return v_m_s and w_rad_s at each time, float64[n, 2]."""
        turn = self.turn_amplitude_rad_s * np.sin(2 * np.pi * time_s / self.turn_period_s)
        return np.column_stack([np.full_like(turn, self.speed_m_s), turn])

    def travel(self, time_s: FloatArray) -> FloatArray:
        """Return path and turn up to each time, float64[n, 2]."""
        rate_rad_s = 2 * math.pi / self.turn_period_s
        turn = self.turn_amplitude_rad_s / rate_rad_s * (1.0 - np.cos(rate_rad_s * time_s))
        return np.column_stack([self.speed_m_s * time_s, turn])


@dataclass(frozen=True)
class FigureEight:
    """Laps of a figure of eight that closes exactly, driven at constant speed between two ramps.

    Along the lap p = 0…1 the heading is z·sin(2πp). Over a whole lap the mean of its cosine is
    J₀(z) and that of its sine is 0, so the path closes when z is a zero of J₀; the first zero
    gives the eight. Ramps stretch time and leave the path as it is.
    """

    speed_m_s: float
    lap_s: float
    laps: int
    rest_s: float
    ramp_s: float

    @property
    def duration_s(self) -> float:
        """Rest, all laps with half a ramp more on either side, rest."""
        return 2 * self.rest_s + self.laps * self.lap_s + self.ramp_s

    def rates(self, time_s: FloatArray) -> FloatArray:
        """Return v_m_s and w_rad_s at each time, float64[n, 2]."""
        driving = self._driving()
        stretch = driving.rates(time_s)[:, 0]
        phase_rad = 2 * math.pi / self.lap_s * driving.travel(time_s)[:, 0]
        turn = J0_FIRST_ZERO * 2 * math.pi / self.lap_s * np.cos(phase_rad)
        return stretch[:, np.newaxis] * np.column_stack([np.full_like(turn, self.speed_m_s), turn])

    def travel(self, time_s: FloatArray) -> FloatArray:
        """Return path and turn up to each time, float64[n, 2]."""
        driven_s = self._driving().travel(time_s)[:, 0]
        turn = J0_FIRST_ZERO * np.sin(2 * math.pi / self.lap_s * driven_s)
        return np.column_stack([self.speed_m_s * driven_s, turn])

    def _driving(self) -> SegmentProfile:
        """Return the profile whose "path" is the time driven at full speed."""
        lap = Segment(1.0, 0.0, self.laps * self.lap_s, self.ramp_s)
        rest = Segment(0.0, 0.0, self.rest_s, ramp_s=0.0)
        stop = Segment(0.0, 0.0, self.ramp_s + self.rest_s, self.ramp_s)
        return SegmentProfile([rest, lap, stop])
