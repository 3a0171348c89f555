"""Effects that are levels of noise: present when the level is more than twice the described one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import PchipInterpolator
from scipy.stats import kurtosis

from gap_diagnosis.hypothesis import Estimate, Fit
from gap_diagnosis.motion.accounts import Found
from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.drawing import DRAWS
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.whitening import IS_OF_ROBOT, LEVELS, whiten
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import EVEN_OVER, LevelPrior

_ABSENT: Final = -6.0
"""Log evidence of a noise that turns out to be as described."""
_STEP: Final = 0.1
_BURSTY: Final = 6.0
"""Excess kurtosis beyond which a larger level is no noise but something that comes and goes; the
mean of a block of samples with Student's five degrees of freedom has half of that."""
_DRAWN_OVER: Final = 4.0
_DRAWN_AT: Final = 15
_FINELY: Final = 400
"""A level is drawn over so many standard deviations, from a curve through so many of its values,
as finely as this."""
_FACTORS: Final = (4.0, 16.0, 64.0)
_LARGER: Final = 2.0
"""A level so many times the described one is an effect,"""
_LABS: Final = _LARGER * EVEN_OVER
"""over the factor that its prior has. A reference noisier than that beside a lab's usual one
is none of a lab, but a GPS: how well it measures is known, and no gap."""
_ROUGHLY: Final = frozenset({"adc_stuck_bit"})
"""Causes whose own jumps are known in the mean only: beside them a gyro's noise is not told, as it
would stand for what is left of them."""
_SUSPECT: Final = 1.4
"""A level that the prior has not kept below this many described ones is looked at again."""


@dataclass(frozen=True)
class Noise:
    """A noise effect: its stage, the level behind each of its parameters, where it shows."""

    stage: str
    parameters: tuple[tuple[str, str], ...]
    channels: tuple[int, ...]

    @property
    def places(self) -> tuple[int, ...]:
        """Where the levels stand in the vector of levels."""
        return tuple(LEVELS.index(level) for _, level in self.parameters)


_REFERENCE: Final = "reference_noise"
NOISES: Final[Mapping[str, Noise]] = {
    "gyro_noise": Noise("gyro", (("density", "gyro_noise_rad_per_sqrt_s"),), (3,)),
    "gyro_bias_walk": Noise("gyro", (("density", "gyro_bias_walk_rad_s_per_sqrt_s"),), (3,)),
    _REFERENCE: Noise(
        "reference",
        (("position", "reference_position_m"), ("heading", "reference_heading_rad")),
        (0, 1, 2),
    ),
}


def fit_noise(
    model: MotionModel, quiet: Found, nothing: Found, name: str, names: Sequence[str]
) -> Fit:
    """Fit a set of effects with the levels of one noise free."""
    measured = [
        (parameter, LEVELS.index(level))
        for parameter, level in NOISES[name].parameters
        if level != "reference_heading_rad" or model.nodes.has_heading
    ]
    places = [place for _, place in measured]
    described = model.level_prior.median
    course = model.course
    if quiet.refitted is not None:
        fitted = quiet.refitted
        course = model.scattered(quiet.terms, fitted.coefficients, fitted.levels)

    def plain(at: Floats, free: Sequence[int] = ()) -> float:
        density = model.level_prior.log_density(np.log(at), free)
        return model.evidence_at(quiet.terms, at, course) + density

    def value(at: Floats) -> float:
        return plain(at, places)

    levels = _start(quiet.levels, described, places, value)
    if any(levels[place] > _SUSPECT * described[place] for place in places):
        levels = model.levels_for(quiet.terms, levels, free=places, course=course)
    larger = (levels / described)[places]
    is_noise = larger.max() > _LARGER and not (name == _REFERENCE and larger.max() > _LABS)
    is_noise &= not (NOISES[name].stage == "gyro" and bool(quiet.effects & _ROUGHLY))
    if not is_noise or _is_bursty(model, quiet.terms, levels, course, NOISES[name].channels):
        alone = quiet.log_evidence - nothing.log_evidence
        likelihood = quiet.log_likelihood - nothing.log_likelihood
        return Fit(tuple(names), alone + _ABSENT, likelihood)

    best = value(levels)
    # The search for a noise may end at levels that suit the quiet set better than its own.
    gain = best - max(plain(levels), plain(quiet.levels))
    parameters = {}
    for parameter, place in measured:
        # Of several levels one may be as described; a single one is larger, or there is no effect.
        least = _LARGER * described[place] if len(measured) == 1 else 0.0
        # What a log shows beyond the prior's end is told as it is.
        end = _LABS * described[place]
        most = end if levels[place] < end else math.inf
        way = model.levels_along(quiet.terms, levels, place, places, course)
        sizes = least, float(levels[place]), float(most)
        samples = _drawn(value, levels, way, place, sizes, model.level_prior)
        parameters[f"{name}.{parameter}"] = Estimate(
            float(samples.mean()), float(samples.std()), samples
        )
    return Fit(
        tuple(names),
        quiet.log_evidence - nothing.log_evidence + gain,
        quiet.log_likelihood - nothing.log_likelihood + gain,
        parameters,
    )


def _drawn(
    value: Callable[[Floats], float],
    levels: Floats,
    way: Floats,
    place: int,
    sizes: tuple[float, float, float],
    prior: LevelPrior,
) -> Floats:
    """Return draws of the level at *place*, float64[DRAWS]: *sizes* are the least, the best and the
    most.

    The others go along the *way* on which they are best, as far as they are believed at all.

    A level that is hardly there is told by a slope that falls off slowly on one side: no normal
    density, not in its logarithm either.
    """

    least, middle, most = (math.log(max(one, 1e-300)) for one in sizes)

    def at(log_level: float) -> float:
        moved = np.log(levels) + (log_level - middle) * way
        moved = np.clip(moved, np.log(prior.low), np.log(prior.high))
        moved[place] = log_level
        return value(np.exp(moved))

    best = at(middle)
    bend = (2 * best - at(middle - _STEP) - at(middle + _STEP)) / _STEP**2
    reach = _DRAWN_OVER / math.sqrt(max(bend, 1.0))
    low = max(middle - reach, least)
    high = max(min(middle + reach, most), low + _STEP)
    nodes = np.linspace(low, high, _DRAWN_AT)
    fine = np.linspace(low, high, _FINELY)
    heights = PchipInterpolator(nodes, [at(float(node)) for node in nodes])(fine)
    share = cumulative_trapezoid(np.exp(heights - heights.max()), fine, initial=0.0)
    even = np.random.default_rng(0).uniform(0.0, share[-1], DRAWS)
    return np.asarray(np.exp(np.interp(even, share, fine)))


def _start(
    levels: Floats, described: Floats, places: Sequence[int], value: Callable[[Floats], float]
) -> Floats:
    """Return the levels to start at: those found, or they or the described ones with a large noise.

    Once a smaller noise is taken for another one (a walking bias for rough contact), no path leads
    from there to it.
    """
    starts = [levels]
    for quiet in (levels, np.where(IS_OF_ROBOT, described, levels)):
        for factor in _FACTORS:
            one = quiet.copy()
            one[list(places)] = factor * described[list(places)]
            starts.append(one)
    return max(starts, key=value)


def _is_bursty(
    model: MotionModel,
    terms: Sequence[Term],
    levels: Floats,
    course: Course,
    channels: Sequence[int],
) -> bool:
    """Tell whether what is left of these channels is far from normal at its own level."""
    values = model.columns.values
    used = {index + 1 for term in terms for weight in term.weights for index, _ in weight}
    used |= {index + 1 for index, _ in model.columns.nuisances}
    chosen = np.take(values, [0, *sorted(used)], axis=-1)
    white, _ = whiten(chosen, course, levels, model.nodes.ticks)
    left = white[:, 0] - white[:, 1:] @ np.linalg.lstsq(white[:, 1:], white[:, 0])[0]
    _, channel = np.nonzero(~np.isnan(values[..., 0]).T)
    seen = left[np.isin(channel, channels)]
    return bool(kurtosis(seen) > _BURSTY)
