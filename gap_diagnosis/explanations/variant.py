"""One way in which an effect can act on a prediction.

A variant has everything but its linear coefficients decided: a side, a window, a threshold, a bit.
Its coefficients are amplitudes about neutral; for an effect that is either there or not it has
none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gap_diagnosis.prediction import Motion, Prediction
from gap_diagnosis.recording import Floats

Value = float | int | str
Action = Callable[..., None]
Scatter = Callable[..., tuple[Floats, Floats]]


@dataclass(frozen=True)
class Variant:
    """One way in which an effect acts.

    Attributes:
        effect: its name in the catalogue.
        act: changes a prediction; takes the coefficients and the fixed values by name.
        coefficients: names of the amplitudes, empty for an effect that is there or not.
        fixed: values decided for this variant, handed to `act`.
        report: values decided for this variant, as the catalogue names them.
        told: of a fixed value that the log itself tells, the least and the largest that it may be;
            the fit may move it where the effect acts not quite so, unless it `is_held`.
        is_held: the log tells its window: a fit does not move it.
        polar: catalogue names (amplitude, phase) that two coefficients a, b stand for, with
            a = A cos(phase), b = A sin(phase); None where coefficients are parameters.
        is_positive: coefficients are sizes that cannot be negative.
        stage_rank: order of acting, for effects of a user's library: as of an `Explanation`.
        unbent: the size whose effect is about that of a straight line of another size, where lines
            lead far astray; a fit starts there.
        exact: how it acts in every detail, if `act` makes it smooth so that its column is free of
            the data's noise: what is compared is exact, what it is compared along is smooth.
        log_share: log of the share of all the times at which it could have begun that looks like
            this one.
        scatter: for a coefficient that is a rate or a probability, by how much the counts of the
            left and the right wheel vary by chance, counts² per tick, float64[n] each; takes the
            motion, the coefficient and the fixed values by name.
        unsure: of what puts a guess in the place of counts that were not there, by how much the
            guess may be off, counts² per tick of the left and the right wheel, float64[n] each:
            nothing that is said beside it may lean on the guess.
        jumps: of what makes codes jump, by how much a tick's turn by the gyro varies by chance
            beyond its noise, rad², float64[n].
        little: how small amounts act, where a share of a large one would look otherwise.
        rectifies: its exact action makes noise of the contact positive, and takes the contact's
            level as `contact_m_per_sqrt_m`.
        about: for an effect that goes with its size in where it acts, further fixed values with
            which it acts where it does at this size: along them it is smooth in its size.
        varies: it is of tyres on a floor, which do now more and now less; the size of a wheel, or
            what is counted, is one number.
        widens: its coefficient is by how much farther apart the wheels turn the robot: what their
            counts round off turns it by less.
        most: the largest size, with either sign, that this log allows.
        large: how amounts act that show in every detail of the motion, where small ones would be
            taken for the rounding of counts.
    """

    effect: str
    act: Action
    coefficients: tuple[str, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)
    report: Mapping[str, Value] = field(default_factory=dict)
    told: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    is_held: bool = False
    polar: tuple[str, str] | None = None
    polar_turn: Callable[[Any, Any], tuple[Any, Any]] = lambda a, b: (a, b)
    is_positive: bool = False
    stage_rank: int = 3
    jumps: Callable[[Motion], Floats] | None = None
    little: Action | None = None
    large: Action | None = None
    unbent: Callable[[float], float] | None = None
    exact: Action | None = None
    log_share: float = 0.0
    scatter: Scatter | None = None
    unsure: Callable[[Motion], tuple[Floats, Floats]] | None = None
    rectifies: bool = False
    about: Callable[[float], Mapping[str, float]] | None = None
    varies: bool = False
    widens: bool = False
    most: float = math.inf

    def apply(self, prediction: Prediction, coefficients: Sequence[float]) -> None:
        """Change *prediction* as the effect with these coefficients does."""
        named = dict(zip(self.coefficients, coefficients, strict=True))
        self.act(prediction, **named, **self.fixed)

    def smooth_about(self, coefficients: Sequence[float]) -> Variant:
        """Return the same, acting where it does with these coefficients."""
        if self.about is None:
            return self
        return replace(self, fixed={**self.fixed, **self.about(coefficients[0])})

    @property
    def in_detail(self) -> Variant:
        """The same, acting in every detail."""
        return self if self.exact is None else replace(self, act=self.exact)

    def in_noise(self, contact_m_per_sqrt_m: float) -> Variant:
        """Return the same, acting in every detail, with so much noise of the contact."""
        if not self.rectifies:
            return self.in_detail
        fixed = {**self.fixed, "contact_m_per_sqrt_m": contact_m_per_sqrt_m}
        return replace(self.in_detail, fixed=fixed)

    def parameters(self, draws: Any) -> dict[str, Any]:
        """Return the catalogue's parameters for coefficients *draws*, float64[..., k]."""
        values: dict[str, Any] = {}
        if self.polar is not None:
            a, b = self.polar_turn(draws[..., 0], draws[..., 1])
            values[self.polar[0]] = np.hypot(a, b)
            values[self.polar[1]] = np.arctan2(b, a)
        else:
            for index, name in enumerate(self.coefficients):
                values[name] = draws[..., index]
        return values


@dataclass(frozen=True)
class Explanation:
    """An effect that the motion can speak of.

    Attributes:
        effect: its name.
        stage_rank: order of acting: 0 encoder, 1 wheel, 2 gyro, 3 reference.
        variants: the ways in which it can act on this log.
    """

    effect: str
    stage_rank: int
    variants: Callable[[Motion], Iterable[Variant]]


Setting = tuple[Variant, Sequence[float]]
"""A variant with its coefficients."""
