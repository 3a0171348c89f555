"""One case: draw, drive, fit by the right name; how far off, and how far off it may be."""

from __future__ import annotations

import math
import time
import zlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final, Literal

import numpy as np

from accuracy.sizes import (
    NOISY,
    STEPPED,
    Truth,
    again,
    as_coefficients,
    drawn_beyond_limit,
    drawn_from_prior,
    exactly,
    model_of,
    nearest,
    noise_levels,
)
from accuracy.worlds import World, draw_world
from gap_diagnosis.hypothesis import Estimate, Fit
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.edges import EDGES
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.noise import NOISES
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.recording import Floats

Study = Literal["limit", "exact", "prior"]
"""Sizes beyond the limit with constants within tolerance, the same with exact ones, the prior."""

ANGLES: Final = ("phase", "direction")
_STEP: Final = 0.1
_LOGS: Final = 8
"""So many other logs tell how sharply levels of noise are told."""


def run_case(
    study: Study, effect: str, number: int, *, duration_s: float | None = None
) -> dict[str, Any]:
    """Return the result of one case; its truth is None where the drive has no place for it.

    *duration_s* cuts the drive short.
    """
    draw = np.random.default_rng([zlib.crc32(f"{study} {effect}".encode()), number])
    exact = study == "exact"
    world = draw_world(effect, draw, exact=exact)
    if duration_s is not None:
        world = replace(world, scenario=replace(world.scenario, duration_s=duration_s))
    without = model_of(world, world.recording(None, {}), effect, exact=exact)
    times = math.nan
    if study == "prior":
        truth = drawn_from_prior(world, without, effect, draw)
    else:
        drawn = drawn_beyond_limit(world, without, effect, draw)
        truth, times = drawn if drawn is not None else (None, times)
    head = {"study": study, "effect": effect, "number": number}
    if truth is None:
        return {**head, "truth": None}
    started = time.perf_counter()
    model = model_of(world, world.recording(effect, truth), effect, exact=exact)
    block = MotionBlock(model)
    fit = _detail(block, effect)
    seconds = time.perf_counter() - started
    has_bound = study != "prior" and effect not in STEPPED
    bound = bounds(world, model, effect, truth) if has_bound else {}
    return {
        **head,
        "truth": truth,
        "times": times,
        "seconds": seconds,
        "found": {name: found(fit, effect, name, truth) for name in truth},
        "bound": bound,
        "levels": [float(one) for one in np.log(block.levels / world.levels)],
    }


def _detail(block: MotionBlock, effect: str) -> Fit:
    """Return the fit by one name; nothing where the block sees no place for the effect."""
    if effect not in block.effects:
        return Fit((effect,), 0.0, 0.0)
    return block.detail(frozenset({effect}))


def found(fit: Fit, effect: str, name: str, truth: Truth) -> dict[str, Any] | None:
    """Return what a fit says of a parameter: value, sd, and where the truth stands in it."""
    estimate = fit.parameters.get(f"{effect}.{name}")
    if estimate is None:
        return None
    if estimate.samples is None:
        right = (estimate.probabilities or {}).get(str(truth[name]), 0.0)
        return {"value": estimate.value, "right": right}
    samples = np.asarray(estimate.samples)
    error, rank = placed(estimate, name, float(truth[name]))
    low, high = np.percentile(samples, [2.5, 97.5])
    return {
        "value": float(estimate.value),
        "sd": estimate.sd,
        "error": error,
        "rank": rank,
        "width": float(high - low),
    }


def placed(estimate: Estimate, name: str, truth: float) -> tuple[float, float]:
    """Return estimate - truth and the share of samples below the truth (angles: the near way)."""
    error = float(estimate.value) - truth
    if name in ANGLES:
        error = math.remainder(error, math.tau)
    below = np.asarray(estimate.samples) < float(estimate.value) - error
    return error, float(below.mean())


def bounds(world: World, model: MotionModel, effect: str, truth: Truth) -> dict[str, float]:
    """Return the Cramér-Rao bound of each size of an effect at the truth.

    Start pose, time map and (unless they are exact) constants within tolerance are free; noise
    levels are those of the world: the mean and the noise of a Gaussian model do not share
    information, so that free ones would give the same (Kay 1993, section 3.9).
    """
    if effect in NOISY:
        return noise_bounds(world, model, effect, truth)
    term = exactly(nearest(model.columns.terms, truth), truth)
    values = dict(truth)
    if effect == "ticks_per_rev":
        smaller = 1 / (1 + float(truth["scale"])) - 1
        values = {"scale": smaller}
    if effect == "frame_latency":
        values = {"offset": -float(truth["delay"])}
    coefficients = as_coefficients(term.variant, values)
    scored = model.evidence_about([term], [coefficients], world.levels).scored
    names = term.variant.coefficients
    high = np.array([model.prior.of(term.variant.effect, one).high for one in names])
    widest = int(np.argmax(scored.covariances[:, 0, 0]))
    information = np.linalg.inv(scored.covariances[widest]) - np.diag(high**-2.0)
    covariance = np.linalg.inv(information)
    if term.variant.polar is None:
        sds = np.sqrt(np.diag(covariance))
        sizes = dict(zip(_parameters(effect, names), (float(sd) for sd in sds), strict=True))
        if effect == "ticks_per_rev":
            sizes["scale"] /= (1 + float(values["scale"])) ** 2
        return sizes
    a, b = coefficients
    size = math.hypot(a, b)
    along = np.array([a, b]) / size
    across = np.array([-b, a]) / size**2
    return {
        term.variant.polar[0]: math.sqrt(float(along @ covariance @ along)),
        term.variant.polar[1]: math.sqrt(float(across @ covariance @ across)),
    }


def _parameters(effect: str, names: tuple[str, ...]) -> tuple[str, ...]:
    return ("delay",) if effect == "frame_latency" else names


def noise_bounds(world: World, model: MotionModel, effect: str, truth: Truth) -> dict[str, float]:
    """Return the bound of levels of noise: from the curvature at the true levels in the mean over
    other logs with the same noise. Other levels are free.

    Of the log itself the curvature goes with the error: a walk that happened to be wide is told too
    large, and curves more.
    """
    levels = noise_levels(world, effect, truth)
    logs = [model_of(one, one.recording(effect, truth), effect) for one in again(world, _LOGS)]
    curvatures = [noise_curvature(one, levels) for one in logs]
    # A level that does not show (no skid sideways) is held by no more than its prior, but nothing
    # is known of the noise's own.
    known = model.level_prior.spread**-2.0
    known[list(NOISES[effect].places)] = 0.0
    information = sum(curvatures) / len(curvatures) + np.diag(known)
    # Of what no log tells, their mean curvature is as often below nothing as above.
    is_told = np.linalg.eigvalsh(information)[0] > 0
    covariance = np.linalg.inv(information) if is_told else np.full_like(information, math.inf)
    return {
        name: float(truth[name]) * math.sqrt(covariance[p, p])
        for name, level in NOISES[effect].parameters
        for p in (LEVELS.index(level),)
    }


def noise_curvature(model: MotionModel, levels: Floats) -> Floats:
    """Return minus the second derivative of a log's evidence, float64[levels, levels], by the
    logarithms of its levels."""
    places = range(len(LEVELS))

    def height(*moves: tuple[int, float]) -> float:
        at = np.log(levels)
        for place, by in moves:
            at[place] += by
        return model.evidence_at((), np.exp(at))

    middle = height()
    single = {(i, s): height((i, s * _STEP)) for i in places for s in (-1, 1)}
    curvature = np.zeros((len(LEVELS), len(LEVELS)))
    for i in places:
        curvature[i, i] = (2 * middle - single[i, 1] - single[i, -1]) / _STEP**2
        for j in range(i):
            both = height((i, _STEP), (j, _STEP)) + height((i, -_STEP), (j, -_STEP))
            cross = both - single[i, 1] - single[i, -1] - single[j, 1] - single[j, -1] + 2 * middle
            curvature[i, j] = curvature[j, i] = -cross / (2 * _STEP**2)
    return curvature


def is_edge(name: str) -> bool:
    """Tell whether a parameter is a border of a window, a threshold or a limit."""
    return name in EDGES


Result = Mapping[str, Any]
