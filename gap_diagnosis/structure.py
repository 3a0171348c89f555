"""What a log can tell, from its manoeuvres alone: what shows, how small, what looks alike."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.drive.block import DriveBlock
from gap_diagnosis.drive.limits import BOUNDS, limits_of_answers, limits_of_bounds
from gap_diagnosis.explanations import EXPLAINED
from gap_diagnosis.imitation import Effects, Imitators, Truth, merged
from gap_diagnosis.limits_elsewhere import limits_elsewhere, limits_of_twins
from gap_diagnosis.motion.columns import GROSS
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.noise import NOISES
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.result_parts import Foreseen, Structure
from gap_diagnosis.visibility import Sights, sight_of
from hil_harness.effects import catalogue
from hil_harness.robot import Robot

_TIMES: Final = 2.0
"""Effects are compared at so many times their detection limit."""

_OCCURRING: Final = frozenset({"encoder_dead", "encoder_wrap"})
"""Effects that have a column only where they occur: they show whenever they do."""


@dataclass(frozen=True)
class Visible:
    """An effect that shows.

    Attributes:
        limit: its detection limit, in its parameter's unit.
        truths: the effect at twice the limit, by parameter where it has several.
    """

    limit: float
    truths: tuple[Truth, ...]


def structure_of(analyses: Sequence[Analysis]) -> Structure:
    """Return the detection limit of each effect and the groups that these logs cannot tell apart.

    The limit is the size at which the expected separation from no effect is 29, other effects
    being free within their tolerances; never below the effect's own tolerance. For a phase or
    direction that may be any, separations are averaged; for a window, the median one counts.
    It is told twice: as it was foreseen before any fit, at the described noise, and at the noise
    that was found.
    """
    recordings = [one.recording for one in analyses]
    blocks = [block for one in analyses for block in one.blocks]
    elsewhere = limits_elsewhere(recordings, blocks)
    motions = [one.motion for one in analyses if one.motion is not None]
    if not motions:
        return Structure(detectable=dict(sorted(elsewhere.items())))
    robot = motions[0].model.robot
    bounds = limits_of_bounds(recordings, robot)
    elsewhere |= {name: bounds.get(name) for name in BOUNDS if elsewhere.get(name) is not None}
    can = frozenset[str]().union(*(one.effects for one in motions))
    elsewhere |= _limits_of_noise(motions[0].model, can)
    drives = [one for one in blocks if isinstance(one, DriveBlock)]
    usual = elsewhere | limits_of_answers(drives, typical=True)
    twins = twins_on(recordings)
    found = _told(sights_of([(one.model, one.levels) for one in motions]), elsewhere, twins, robot)
    foreseen = _told(Sights(tuple(one.scan.foreseen for one in motions)), usual, twins, robot)
    return Structure(detectable=found.detectable, groups=found.groups, foreseen=foreseen)


def _told(
    sights: Sights,
    elsewhere: Mapping[str, float | None],
    twins: Sequence[Effects],
    robot: Robot,
) -> Foreseen:
    """Return the limits, those of *elsewhere* where the motion has none, and the groups."""
    seen = visible(sights)
    limits = dict(elsewhere)
    for effect, one in seen.items():
        if one is not None or limits.get(effect) is None:
            limits[effect] = None if one is None else one.limit
    limits |= {effect: 0.0 for effect in _OCCURRING if limits.get(effect) is None}
    limits |= limits_of_twins(limits, robot)
    shown = frozenset(effect for effect, limit in limits.items() if limit is not None)
    pairs = [twin & shown for twin in twins if len(twin & shown) > 1]
    groups = alike(sights, seen, pairs)
    return Foreseen(
        detectable=dict(sorted(limits.items())),
        groups=tuple(tuple(sorted(group)) for group in groups),
    )


def _limits_of_noise(model: MotionModel, can: frozenset[str]) -> dict[str, float | None]:
    """Return twice the described level of each noise: more is an effect."""
    return {
        effect: 2 * float(model.level_prior.median[noise.places[0]]) if effect in can else None
        for effect, noise in NOISES.items()
    }


def sights_of(models: Sequence[tuple[MotionModel, Floats]]) -> Sights:
    """Return what the motion of logs can see, each at its noise levels float64[levels]."""
    return Sights(
        tuple(sight_of(one.columns, one.gram(levels), one.prior) for one, levels in models)
    )


def alike(
    sights: Sights, seen: Mapping[str, Visible | None], twins: Sequence[Effects]
) -> list[Effects]:
    """Return the groups of effects that cannot be told apart."""
    search = Imitators(sights)
    found = {
        effect: list(dict.fromkeys(each for truth in one.truths for each in search.of(truth)))
        for effect, one in seen.items()
        if one is not None
    }
    return merged(found, twins)


def visible(sights: Sights) -> dict[str, Visible | None]:
    """Return every effect of the motion; None: it cannot be seen."""
    return {
        effect: _visible(sights, effect) if effect in sights.terms else None
        for effect in EXPLAINED
        if effect not in GROSS
    }


def _visible(sights: Sights, effect: str) -> Visible | None:
    inner = sights.beside(effect)
    terms = sights.terms[effect]
    if not terms[0].variant.coefficients:
        return _there_or_not(sights, effect, inner)
    limits = [_limits(sights, effect, variant, inner) for variant in range(len(terms))]
    order = np.argsort([float(one.min()) for one in limits], kind="stable")
    has_window = "start_s" in terms[0].variant.fixed
    chosen = int(order[len(order) // 2] if has_window else order[0])
    term, own = terms[chosen], limits[chosen]
    high = np.array([sights.prior.of(effect, name).high for name in term.variant.coefficients])
    if not np.any(own <= high):
        return None
    rows = tuple(sights.rows(effect, chosen))
    sizes = np.diag(_TIMES * own)
    cases = [sizes] if term.variant.polar else [sizes[[i]] for i in np.flatnonzero(own <= high)]
    truths = tuple(Truth(term.variant, rows, case, term.variant.is_positive) for case in cases)
    return Visible(float(own[np.argmin(own / high)]), truths)


def _limits(sights: Sights, effect: str, variant: int, inner: Floats) -> Floats:
    """Return the detection limit of each coefficient; infinite where nothing shows."""
    term = sights.terms[effect][variant]
    power = np.maximum(np.diag(inner)[sights.rows(effect, variant)], 0.0)
    if term.variant.polar is not None:
        power = np.full(len(power), float(power.mean()))
    with np.errstate(divide="ignore"):
        return np.asarray(np.maximum(np.sqrt(THRESHOLD / power), term.tolerances))


def _there_or_not(sights: Sights, effect: str, inner: Floats) -> Visible | None:
    """Return the mildest variant that shows: of a limit, the highest."""
    shown: list[tuple[float, int, int]] = []
    for variant, term in enumerate(sights.terms[effect]):
        (row,) = sights.rows(effect, variant)
        if inner[row, row] >= THRESHOLD:
            shown.append((float(term.variant.fixed.get("limit", 0.0)), row, variant))
    if not shown:
        return None
    limit, row, chosen = max(shown)
    mildest = sights.terms[effect][chosen].variant
    return Visible(limit, (Truth(mildest, (row,), np.ones((1, 1)), True),))


def twins_on(recordings: Sequence[Recording], *, with_reference: bool = False) -> list[Effects]:
    """Return pairs of effects that leave the same data in logs like these.

    *with_reference*: as if there had been a reference.
    """
    blind = not with_reference and all(one.reference is None for one in recordings)
    no_gyro = all(one.gyro_rate_rad_s is None for one in recordings)
    held = {
        "": True,
        "scale < 0": True,
        "there is no reference": blind,
        "there is no gyro and no reference": blind and no_gyro,
        "the temperature is constant": all(_is_constant(one.temperature_k) for one in recordings),
        "the supply is constant": all(_is_constant(one.supply_v) for one in recordings),
    }
    # A condition may go on: "there is no reference (opposite sign)".
    return [
        frozenset({name, *twins.effects})
        for name, effect in catalogue().items()
        for twins in effect.twins
        if len(twins.effects) == 1 and held.get(twins.condition.partition(" (")[0], False)
    ]


def _is_constant(values: Floats | None) -> bool:
    """Tell whether a quantity varies by less than a tenth of a percent, or is not recorded."""
    if values is None or not np.isfinite(values).any():
        return True
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return math.isclose(low, high, rel_tol=1e-3)
