"""The textbook lesson in plain float: one drive, two estimators, and what each choice moves.

A differential-drive robot follows v = 0.6 m/s and w = 0.10·sin(2πt/20) rad/s for 60 s. Its
estimator believes a wheel 0.5 % too large and an axle 0.5 % too short, its wheels differ by
0.4 %, its encoders and its gyro are noisy and the gyro is biased. Two estimators run on the same
data: *wheel only* (midpoint) and *gyro heading with wheel distance* (Euler).

The lesson adds its tick noise to each step's *rounded* increment, so its increments are not
whole numbers and no counter could carry them. Three encoders therefore share the same draws:

- ``lesson``: the increments as printed, floats, never on a bus;
- ``lesson_counter``: a counter of the running sum of those increments, rounded half to even;
- ``counter``: a real one, ``floor(true cumulative ticks + n_k)`` with n_k white on the count.

Sources: the lesson's own are Borenstein, Everett and Feng, "Where am I?" (1996), and Kelly,
"Linearized error propagation in odometry", IJRR 23(2) (2004).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from hil_harness.errors import HarnessError

FloatArray = NDArray[np.float64]
Encoder = Literal["lesson", "lesson_counter", "counter"]
Rounding = Literal["round", "floor", "none"]
Heading = Literal["before", "midpoint", "after"]

ENCODERS: Final[tuple[Encoder, ...]] = ("lesson", "lesson_counter", "counter")
ROUNDINGS: Final[tuple[Rounding, ...]] = ("round", "floor", "none")
HEADINGS: Final[tuple[Heading, ...]] = ("before", "midpoint", "after")
OWN_ROUNDING: Final[dict[Encoder, Rounding]] = {
    "lesson": "round",
    "lesson_counter": "round",
    "counter": "floor",
}

_ROUND: Final[dict[Rounding, Callable[[FloatArray], FloatArray]]] = {
    "round": np.round,
    "floor": np.floor,
    "none": np.copy,
}


@dataclass(frozen=True)
class LessonParameters:
    """The lesson's numbers, as printed.

    Attributes carry their units; the ratios are the lesson's: ``believed_*_ratio`` is believed
    over true, ``wheel_error_*`` is ε in r(1 + ε).
    """

    sample_count: int = 6000
    tick_period_s: float = 0.01
    speed_m_s: float = 0.6
    turn_amplitude_rad_s: float = 0.10
    turn_period_s: float = 20.0
    wheel_radius_m: float = 0.05
    wheelbase_m: float = 0.30
    ticks_per_rev: int = 2048
    believed_radius_ratio: float = 1.005
    believed_wheelbase_ratio: float = 0.995
    wheel_error_left: float = 0.002
    wheel_error_right: float = -0.002
    tick_noise_ticks: float = 0.2
    gyro_bias_rad_s: float = 0.005
    gyro_noise_rad_s: float = 0.002

    @property
    def step_count(self) -> int:
        """Pose updates: one fewer than samples."""
        return self.sample_count - 1

    @property
    def time_s(self) -> FloatArray:
        """Sample times, shape (samples,)."""
        return np.arange(self.sample_count, dtype=np.float64) * self.tick_period_s

    @property
    def turn_rate_rad_s(self) -> FloatArray:
        """Turn rate at the start of each step, shape (steps,)."""
        phase_rad = 2 * np.pi * self.time_s[:-1] / self.turn_period_s
        return self.turn_amplitude_rad_s * np.sin(phase_rad)


@dataclass(frozen=True)
class LessonRun:
    """One run of the lesson: three trajectories, each (samples, 3) of x_m, y_m, heading_rad."""

    truth: FloatArray
    wheel: FloatArray
    gyro: FloatArray

    @property
    def wheel_position_error_m(self) -> FloatArray:
        """Norm of the wheel-only position error over time, shape (samples,)."""
        return _position_error_m(self.wheel, self.truth)

    @property
    def gyro_position_error_m(self) -> FloatArray:
        """Norm of the gyro-heading position error over time, shape (samples,)."""
        return _position_error_m(self.gyro, self.truth)

    @property
    def wheel_heading_error_rad(self) -> FloatArray:
        """Wheel-only heading error over time, not wrapped, shape (samples,)."""
        return self.wheel[:, 2] - self.truth[:, 2]

    @property
    def gyro_heading_error_rad(self) -> FloatArray:
        """Gyro heading error over time, not wrapped, shape (samples,)."""
        return self.gyro[:, 2] - self.truth[:, 2]


@dataclass(frozen=True)
class LessonChoice:
    """Final errors of the lesson under one choice of encoder, rounding and headings."""

    encoder: Encoder
    rounding: Rounding
    heading: Heading
    wheel_position_m: float
    wheel_heading_deg: float
    gyro_position_m: float
    gyro_heading_deg: float


def run_lesson(
    *,
    encoder: Encoder = "lesson",
    rounding: Rounding | None = None,
    wheel_heading: Heading = "midpoint",
    gyro_heading: Heading = "before",
    seed: int = 7,
    parameters: LessonParameters | None = None,
) -> LessonRun:
    """Run the lesson once and return truth, wheel-only and gyro-heading trajectories.

    The defaults are the lesson as printed; its final position errors are 6.850364433010 m
    (wheel only) and 5.280131440064 m (gyro heading).

    Args:
        encoder: how ticks are counted, see the module's docstring.
        rounding: how a real number of ticks becomes whole: each step's increment in ``lesson``
            and ``lesson_counter``, the cumulative count in ``counter``. None is the encoder's
            own: "round" for the first two, "floor" for the last.
        wheel_heading: heading by which the wheel-only step moves x and y.
        gyro_heading: the same for the gyro-heading estimator.
        seed: of ``numpy.random.default_rng``; draws per step are right tick, left tick, gyro.
        parameters: the lesson's numbers; None means as printed.

    Raises:
        HarnessError: an encoder, rounding or heading has no such name.
    """
    _require("encoder", encoder, ENCODERS)
    rounding = rounding or OWN_ROUNDING[encoder]
    _require("rounding", rounding, ROUNDINGS)
    _require("wheel_heading", wheel_heading, HEADINGS)
    _require("gyro_heading", gyro_heading, HEADINGS)
    p = parameters or LessonParameters()
    draws = np.random.default_rng(seed).standard_normal((p.step_count, 3))
    rate_rad_s = p.turn_rate_rad_s
    step_m = np.full(p.step_count, p.speed_m_s * p.tick_period_s)
    truth = integrate(step_m, rate_rad_s * p.tick_period_s, "midpoint")

    counts = [
        _counted(true_ticks, p.tick_noise_ticks * noise, encoder, _ROUND[rounding])
        for true_ticks, noise in zip(_true_ticks(p), draws.T[:2], strict=True)
    ]
    believed_m_per_tick = p.believed_radius_ratio * p.wheel_radius_m * 2 * np.pi / p.ticks_per_rev
    right_m, left_m = (believed_m_per_tick * count for count in counts)
    distance_m = (right_m + left_m) / 2
    turn_rad = (right_m - left_m) / (p.believed_wheelbase_ratio * p.wheelbase_m)
    measured_rad_s = rate_rad_s + p.gyro_bias_rad_s + p.gyro_noise_rad_s * draws[:, 2]
    return LessonRun(
        truth=truth,
        wheel=integrate(distance_m, turn_rad, wheel_heading),
        gyro=integrate(distance_m, measured_rad_s * p.tick_period_s, gyro_heading),
    )


def integrate(distance_m: FloatArray, turn_rad: FloatArray, heading: Heading) -> FloatArray:
    """Return the poses (steps + 1, 3) of x_m, y_m, heading_rad from (0, 0, 0).

    Args:
        distance_m: body steps Δs, shape (steps,).
        turn_rad: heading steps Δθ, shape (steps,).
        heading: x and y move along the heading before the step, θ + Δθ/2, or after it.
    """
    heading_rad = np.concatenate([[0.0], np.cumsum(turn_rad)])
    fraction = {"before": 0.0, "midpoint": 0.5, "after": 1.0}[heading]
    along_rad = heading_rad[:-1] + fraction * turn_rad
    steps = np.stack([distance_m * np.cos(along_rad), distance_m * np.sin(along_rad)], axis=1)
    pose = np.zeros((len(distance_m) + 1, 3))
    pose[1:, :2] = np.cumsum(steps, axis=0)
    pose[:, 2] = heading_rad
    return pose


def lesson_choices() -> Iterator[LessonChoice]:
    """Yield the lesson's final errors for every encoder, rounding and heading."""
    for encoder, rounding, heading in product(ENCODERS, ROUNDINGS, HEADINGS):
        run = run_lesson(
            encoder=encoder, rounding=rounding, wheel_heading=heading, gyro_heading=heading
        )
        yield LessonChoice(
            encoder,
            rounding,
            heading,
            wheel_position_m=float(run.wheel_position_error_m[-1]),
            wheel_heading_deg=math.degrees(run.wheel_heading_error_rad[-1]),
            gyro_position_m=float(run.gyro_position_error_m[-1]),
            gyro_heading_deg=math.degrees(run.gyro_heading_error_rad[-1]),
        )


def _true_ticks(p: LessonParameters) -> tuple[FloatArray, FloatArray]:
    """Return the true ticks per step, right then left: φ = (v ± w·b/2)·T/(r(1 + ε))."""
    half_base_m_s = p.turn_rate_rad_s * p.wheelbase_m / 2
    ticks_per_m_at_radius = p.ticks_per_rev / (2 * np.pi)
    right_rad = (p.speed_m_s + half_base_m_s) * p.tick_period_s
    left_rad = (p.speed_m_s - half_base_m_s) * p.tick_period_s
    return (
        right_rad / (p.wheel_radius_m * (1 + p.wheel_error_right)) * ticks_per_m_at_radius,
        left_rad / (p.wheel_radius_m * (1 + p.wheel_error_left)) * ticks_per_m_at_radius,
    )


def _counted(
    true_ticks: FloatArray,
    noise_ticks: FloatArray,
    encoder: Encoder,
    rounding: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """Return the increments that the estimator sees, shape (steps,)."""
    if encoder == "counter":
        return np.diff(rounding(np.cumsum(true_ticks) + noise_ticks), prepend=0.0)
    increments = rounding(true_ticks) + noise_ticks
    if encoder == "lesson":
        return increments
    return np.diff(np.rint(np.cumsum(increments)), prepend=0.0)


def _position_error_m(pose: FloatArray, truth: FloatArray) -> FloatArray:
    error: FloatArray = np.hypot(pose[:, 0] - truth[:, 0], pose[:, 1] - truth[:, 1])
    return error


def _require(name: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise HarnessError(f'{name} = "{value}": expected one of {", ".join(allowed)}')
