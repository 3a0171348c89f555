"""The truth of a case: from the published prior, or so many times the detection limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from accuracy.worlds import CONSTANTS, TIME_MAP, Draw, World, tolerances
from gap_diagnosis.explanations import EXPLAINED
from gap_diagnosis.explanations.choices import leaves_out
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.motion.columns import GROSS, Term
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.noise import NOISES
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.prediction import Motion, Prediction
from gap_diagnosis.priors import default_prior
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.scoring import EVEN_OVER
from gap_diagnosis.visibility import sight_of
from hil_harness.effects import catalogue
from hil_harness.effects.model import Value

Truth = dict[str, Value]

TOLD_AS: Final = {"ticks_per_rev": "radius_scale", "frame_latency": "reference_time_offset"}
"""Effects that the motion of a log with counters tells under another's name."""

SMOOTH: Final = tuple(
    sorted(
        EXPLAINED.keys()
        - GROSS
        - {"gyro_saturation", "gyro_frozen", "encoder_dead", "encoder_wrap", "adc_stuck_bit"}
    )
)
"""Effects with sizes in which the likelihood is smooth."""

NOISY: Final = tuple(sorted(NOISES))
"""Effects that are levels of noise."""

STEPPED: Final = ("adc_stuck_bit", "encoder_dead", "encoder_wrap", "gyro_frozen", "gyro_saturation")
"""Effects that are thresholds, whole numbers or windows and nothing else."""

_MIXTURE: Final = 5
_TRIES: Final = 1000
_WINDOWS: Final = 12
_LEAST_TIMES: Final = 2.0
_TOLERATED_NOISE: Final = 2.0
"""A level within twice the described one is no news."""
_LOG_NOISE: Final = (math.log(_TOLERATED_NOISE), math.log(_TOLERATED_NOISE * EVEN_OVER))
_COARSELY: Final = 2.0
_LOGS: Final = 4


def model_of(
    world: World, recording: Recording, effect: str, *, exact: bool = False
) -> MotionModel:
    """Return the prepared log with the columns of one effect and of the constants."""
    own = TOLD_AS.get(effect, effect)
    unused = EXPLAINED.keys() - set(CONSTANTS) - {own}
    model = MotionModel(recording, world.described, default_prior(), without=frozenset(unused))
    columns = model.columns
    owner = {i: t.variant.effect for t in columns.terms for w in t.weights for i, _ in w}
    free = [one for one in columns.nuisances if not exact or owner.get(one[0]) in TIME_MAP]
    terms = tuple(term for term in columns.terms if term.variant.effect == own)
    model.columns = replace(columns, terms=terms, nuisances=tuple(free))
    return model


def drawn_from_prior(world: World, model: MotionModel, effect: str, draw: Draw) -> Truth | None:
    """Return a truth as the published prior has it; *model* is of the drive without the effect.

    None: this drive gives the effect no place (no turn fast enough to saturate, for example).
    """
    if effect in NOISES:
        return {
            name: world_level(model, name_of_level) * math.exp(draw.uniform(*_LOG_NOISE))
            for name, name_of_level in NOISES[effect].parameters
        }
    if effect in STEPPED:
        return _stepped(model, effect, draw)
    names = coefficients_of(effect)
    low = np.array([tolerances(world.described, effect, name) for name in names])
    high = np.array([default_prior().of(effect, name).high for name in names])
    low_scale = np.maximum(low, 1e-3 * high)
    step = int(draw.integers(_MIXTURE)) / (_MIXTURE - 1)
    scales = low_scale * (high / low_scale) ** step
    for _ in range(_TRIES):
        sizes = scales * draw.standard_normal(len(names))
        if is_positive(effect):
            sizes = np.abs(sizes)
        truth = {**_choices(model, effect, draw), **_named(effect, sizes)}
        if np.any(np.abs(sizes) > low) and _is_admitted(effect, truth):
            return truth
    raise AssertionError(f"{effect}: no truth within its bounds")


def drawn_beyond_limit(
    world: World, model: MotionModel, effect: str, draw: Draw
) -> tuple[Truth, float] | None:
    """Return a truth 2 to 10 times its detection limit, and how many times; None: out of reach.

    The limit is that of `blind score`: 29 in expected separation at the true noise, or the
    tolerance if that is larger.
    """
    times = math.exp(draw.uniform(math.log(2.0), math.log(10.0)))
    if effect in NOISES:
        factor = faintest_noise(world, model, effect) * times
        return noise_of(model, effect, factor), times
    if effect in STEPPED:
        truth = _stepped(model, effect, draw)
        return None if truth is None else (truth, math.nan)
    chosen = _choices(model, effect, draw)
    if not model.columns.terms:
        return None  # this drive gives the effect no place
    term = nearest(model.columns.terms, chosen)
    sight = sight_of(model.columns, model.gram(world.levels), model.prior)
    told = TOLD_AS.get(effect, effect)
    inner = sight.beside(told)
    place = {key: row for row, key in enumerate(sight.keys)}
    index = model.columns.terms.index(term)
    rows = [place[told, index, coefficient] for coefficient in range(len(term.weights))]
    joint = inner[np.ix_(rows, rows)]
    power = np.diag(joint).copy()
    if term.variant.polar is not None:
        power[:] = power.mean()
    names = coefficients_of(effect)
    least = np.array([tolerances(world.described, effect, name) for name in names])
    high = np.array([default_prior().of(effect, name).high for name in names])
    limit = np.maximum(np.sqrt(THRESHOLD / np.maximum(power, 1e-300)), least)
    seen = 2.0 * limit <= high
    if not seen.any():
        return None
    limit = np.where(seen, limit, high / 2.0)
    times = min(times, float((high / limit).min()))
    if term.variant.polar is not None:
        angle = draw.uniform(-math.pi, math.pi)
        sizes = times * limit * np.array([math.cos(angle), math.sin(angle)])
    else:
        along = limit * draw.choice([-1.0, 1.0], size=len(names))
        if is_positive(effect):
            along = np.abs(along)
        # What two sizes do may nearly cancel: the limit is of the effect, not of each size.
        along *= max(1.0, math.sqrt(THRESHOLD / max(float(along @ joint @ along), 1e-300)))
        times = min(times, float((high / np.abs(along)).min()))
        if times < _LEAST_TIMES:
            return None
        sizes = times * along
    if is_positive(effect):
        sizes = np.abs(sizes)
    truth = {**chosen, **_named(effect, sizes)}
    return (truth, times) if _is_admitted(effect, truth) else None


def noise_of(model: MotionModel, effect: str, factor: float) -> Truth:
    """Return a noise so many times as large as described."""
    return {name: world_level(model, level) * factor for name, level in NOISES[effect].parameters}


def faintest_noise(world: World, model: MotionModel, effect: str) -> float:
    """Return how many times the described noise the detection limit is: two, or more where that is
    less than 29 in expected separation from it (the mean of a few logs with that noise)."""
    described = noise_levels(world, effect, noise_of(model, effect, 1.0))
    before = 0.0, 1.0
    factor = _TOLERATED_NOISE
    while True:
        truth = noise_of(model, effect, factor)
        levels = noise_levels(world, effect, truth)
        models = (
            model_of(one, one.recording(effect, truth), effect) for one in again(world, _LOGS)
        )
        gains = [one.evidence_at((), levels) - one.evidence_at((), described) for one in models]
        separation = 2.0 * sum(gains) / _LOGS
        if separation >= THRESHOLD:
            break
        before, factor = (max(separation, 0.0), factor), factor * _COARSELY
    if factor == _TOLERATED_NOISE:
        return factor
    share = (THRESHOLD - before[0]) / (separation - before[0])
    return float(before[1] * (factor / before[1]) ** share)


def noise_levels(world: World, effect: str, truth: Truth) -> Floats:
    """Return the true noise levels of a world with a noise."""
    levels = world.levels.copy()
    for name, level in NOISES[effect].parameters:
        levels[LEVELS.index(level)] = float(truth[name])
    return levels


def again(world: World, count: int) -> list[World]:
    """Return the same drive with noise drawn anew."""
    return [replace(world, seed=(world.seed + 1 + one) % (1 << 62)) for one in range(count)]


def nearest(terms: Sequence[Term], chosen: Truth) -> Term:
    """Return the term on the truth's side whose window or threshold is the nearest."""

    def away(term: Term) -> tuple[bool, float]:
        variant = term.variant
        unlike = any(variant.report.get(k, chosen.get(k)) != chosen.get(k) for k in ("side",))
        far = sum(abs(v - float(chosen[k])) for k, v in variant.fixed.items() if k in chosen)
        return (unlike, far)

    return min(terms, key=away)


def exactly(term: Term, truth: Truth) -> Term:
    """Return the term with the truth's own window or threshold."""
    fixed = {key: float(truth.get(key, value)) for key, value in term.variant.fixed.items()}
    return replace(term, variant=replace(term.variant, fixed=fixed))


def as_coefficients(variant: Variant, truth: Truth) -> tuple[float, ...]:
    """Return a variant's coefficients for the catalogue's parameters."""
    if variant.effect == "radius_scale" and "scale" in truth:
        return (float(truth["scale"]),)
    if variant.polar is None:
        return tuple(float(truth[name]) for name in variant.coefficients)
    size, angle = (float(truth[name]) for name in variant.polar)
    turned = np.array([variant.polar_turn(1.0, 0.0), variant.polar_turn(0.0, 1.0)]).T
    wanted = size * np.array([math.cos(angle), math.sin(angle)])
    return tuple(float(one) for one in np.linalg.solve(turned, wanted))


def coefficients_of(effect: str) -> tuple[str, ...]:
    """Return the names of an effect's sizes; a phase or direction makes two of one."""
    known = catalogue()[effect].parameters
    if _angle(effect) is not None:
        return ("first", "second")
    skipped = {"speed", "start_s", "stop_s", "threshold"}
    return tuple(p.name for p in known if p.kind == "real" and p.name not in skipped)


def is_positive(effect: str) -> bool:
    """Tell whether an effect's sizes cannot be negative (of a pair for an angle they can)."""
    known = catalogue()[effect]
    return _angle(effect) is None and known.parameter(coefficients_of(effect)[0]).minimum >= 0


def world_level(model: MotionModel, level: str) -> float:
    """Return the described level of a noise."""
    return float(model.level_prior.median[LEVELS.index(level)])


def _angle(effect: str) -> str | None:
    names = [one.name for one in catalogue()[effect].parameters]
    return next((name for name in ("phase", "direction") if name in names), None)


def _named(effect: str, sizes: Floats) -> Truth:
    angle = _angle(effect)
    if angle is not None:
        size = "amplitude" if angle == "phase" else "ratio"
        return {size: math.hypot(*sizes), angle: math.atan2(sizes[1], sizes[0])}
    return dict(zip(coefficients_of(effect), (float(one) for one in sizes), strict=True))


def _is_admitted(effect: str, truth: Truth) -> bool:
    known = catalogue()[effect]
    return all(
        known.parameter(name).minimum <= value <= known.parameter(name).maximum
        for name, value in truth.items()
        if isinstance(value, float)
    )


def _choices(model: MotionModel, effect: str, draw: Draw) -> Truth:
    """Return what of a smooth effect is no size: side, window, threshold, frame, form."""
    found: Truth = {}
    motion = model.nodes.motion
    names = [one.name for one in catalogue()[effect].parameters]
    if "side" in names:
        found["side"] = str(draw.choice(["left", "right"]))
    if "frame" in names:
        found["frame"] = "sensors"
    if "threshold" in names:
        found["threshold"] = float(draw.uniform(0.0, 0.9) * motion.fastest_rad_s)
    if "speed" in names:
        found["speed"] = int(draw.integers(2))
    if "stop_s" in names:
        window = _window(motion, draw)
        while not leaves_out(motion, Variant(effect, _unused, (), window, found)):
            window = _window(motion, draw)
        found.update(window)
    return found


def _window(motion: Motion, draw: Draw) -> dict[str, float]:
    """Return a window of the log; an end is nowhere likelier than about it."""
    first, last = sorted(draw.choice(_WINDOWS + 1, size=2, replace=False))
    part = float(motion.t_s[-1] - motion.t_s[0]) / _WINDOWS
    start, stop = (one + draw.uniform(-0.25, 0.25) for one in (float(first), float(last)))
    return {"start_s": abs(start) * part, "stop_s": (_WINDOWS - abs(_WINDOWS - stop)) * part}


def _unused(prediction: Prediction, **values: float) -> None:
    """Act not at all: only the window is asked for."""


def _stepped(model: MotionModel, effect: str, draw: Draw) -> Truth | None:
    motion = model.nodes.motion
    length_s = float(motion.t_s[-1])
    match effect:
        case "adc_stuck_bit":
            return {"bit": int(draw.integers(2, 12)), "value": int(draw.integers(2))}
        case "encoder_dead":
            side = str(draw.choice(["left", "right"]))
            return {"side": side, "start_s": draw.uniform(0.2, 0.6) * length_s}
        case "encoder_wrap":
            return {"bits": int(draw.integers(10, 15))}
        case "gyro_frozen":
            start_s = draw.uniform(0.2, 0.6) * length_s
            return {"start_s": start_s, "stop_s": start_s + draw.uniform(0.5, 3.0)}
        case "gyro_saturation":
            fastest = float(np.abs(motion.turn_rate_rad_s).max())
            return {"limit": draw.uniform(0.3, 0.95) * fastest} if fastest > 0.1 else None
    raise AssertionError(effect)
