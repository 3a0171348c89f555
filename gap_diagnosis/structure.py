"""What a log can tell, from its manoeuvres alone: what shows, how small, what looks alike."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.explanations import EXPLAINED
from gap_diagnosis.imitation import Effects, Truth, imitators, merged
from gap_diagnosis.limits_elsewhere import limits_elsewhere
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.columns import GROSS
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.result_parts import Structure
from gap_diagnosis.visibility import Sight, Sights, sight_of
from hil_harness.effects import catalogue


def structure_of(analyses: Sequence[Analysis]) -> Structure:
    """Return the detection limit of each effect and the groups that these logs cannot tell apart.

    The limit is the size at which the expected separation from no effect is 29, other effects
    being free within their tolerances; never below the effect's own tolerance. For a phase or
    direction that may be any, separations are averaged; for a window, the median one counts.
    """
    motions = [one.motion for one in analyses if one.motion is not None]
    limits: dict[str, float | None] = limits_elsewhere(analyses)
    groups: list[Effects] = []
    always = _always(analyses)
    if motions:
        sights = Sights(tuple(sight_of_block(one) for one in motions))
        seen = visible(sights)
        limits |= {effect: None if one is None else one[0] for effect, one in seen.items()}
        found = {}
        for effect, one in seen.items():
            if one is not None:
                found[effect] = list(dict.fromkeys(_imitated(sights, one[1])))
        groups = merged(found, [one for one in always if any(limits.get(each) for each in one)])
    else:
        groups = merged({}, [])
    return Structure(
        detectable=dict(sorted(limits.items())),
        groups=tuple(tuple(sorted(group)) for group in groups),
    )


def sight_of_block(block: MotionBlock) -> Sight:
    """Return what a log's motion can see at the noise levels of its best account."""
    model = block.model
    return sight_of(model.columns, model.gram(block.levels), model.prior)


def visible(sights: Sights) -> dict[str, tuple[float, list[Truth]] | None]:
    """Return by effect its detection limit and its truths at twice that; None: cannot be seen."""
    found: dict[str, tuple[float, list[Truth]] | None] = {}
    for effect in EXPLAINED:
        if effect in GROSS:
            continue
        terms = sights.terms.get(effect)
        found[effect] = None if terms is None else _visible(sights, effect)
    return found


def _visible(sights: Sights, effect: str) -> tuple[float, list[Truth]] | None:
    inner = sights.beside({effect})
    terms = sights.terms[effect]
    if not terms[0].variant.coefficients:
        return _there_or_not(sights, effect, inner)
    limits = [_limits(sights, effect, variant, inner) for variant in range(len(terms))]
    smallest = np.array([float(one.min()) for one in limits])
    order = np.argsort(smallest, kind="stable")
    has_window = "start_s" in terms[0].variant.fixed
    chosen = int(order[len(order) // 2] if has_window else order[0])
    term, own = terms[chosen], limits[chosen]
    high = np.array([sights.prior.of(effect, name).high for name in term.variant.coefficients])
    if not np.any(own <= high):
        return None
    rows = tuple(sights.rows(effect, chosen))
    positive = term.variant.is_positive
    truths = []
    if term.variant.polar is not None:
        cases = max(2 * own[0], term.tolerances[0]) * np.eye(len(rows))
        truths.append(Truth(effect, chosen, rows, cases, positive))
    else:
        for index in np.flatnonzero(own <= high):
            case = np.zeros((1, len(rows)))
            case[0, index] = max(2 * own[index], term.tolerances[index])
            truths.append(Truth(effect, chosen, rows, case, positive))
    return float(own[np.argmin(own / high)]), truths


def _limits(sights: Sights, effect: str, variant: int, inner: Floats) -> Floats:
    """Return the detection limit of each coefficient; infinite where nothing shows."""
    term = sights.terms[effect][variant]
    rows = sights.rows(effect, variant)
    power = np.maximum(np.diag(inner)[rows], 0.0)
    if term.variant.polar is not None:
        power = np.full(len(rows), float(power.mean()))
    with np.errstate(divide="ignore"):
        limits = np.sqrt(THRESHOLD / power)
    return np.asarray(np.maximum(limits, term.tolerances[: len(rows)]))


def _there_or_not(
    sights: Sights, effect: str, inner: Floats
) -> tuple[float, list[Truth]] | None:
    """Return the mildest variant that shows: of a limit, the highest."""
    shown: list[tuple[float, int]] = []
    for variant, term in enumerate(sights.terms[effect]):
        rows = sights.rows(effect, variant)
        if float(inner[np.ix_(rows, rows)].sum()) >= THRESHOLD:
            shown.append((float(term.variant.fixed.get("limit", 0.0)), variant))
    if not shown:
        return None
    limit, variant = max(shown)
    rows = sights.rows(effect, variant)
    truth = Truth(effect, variant, tuple(rows), np.ones((1, len(rows))), True)
    return limit, [truth]


def _imitated(sights: Sights, truths: Iterable[Truth]) -> Iterable[Effects]:
    for truth in truths:
        yield from imitators(sights, truth)


def _always(analyses: Sequence[Analysis]) -> list[Effects]:
    """Return effects that leave the same data in logs like these."""
    recordings = [one.recording for one in analyses]
    held = {
        "": True,
        "there is no reference": all(one.reference is None for one in recordings),
        "the temperature is constant": all(_is_constant(one.temperature_k) for one in recordings),
        "the supply is constant": all(_is_constant(one.supply_v) for one in recordings),
        "there is no gyro and no reference": all(_is_bare(one) for one in recordings),
        "scale < 0": True,
    }
    found = []
    for name, effect in catalogue().items():
        for twins in effect.twins:
            # A sentence may go on: "there is no reference (opposite sign)".
            condition = twins.condition.partition(" (")[0]
            if held.get(condition, False) and len(twins.effects) == 1:
                found.append(frozenset({name, *twins.effects}))
    return found


def _is_bare(recording: Recording) -> bool:
    return recording.reference is None and recording.gyro_rate_rad_s is None


def _is_constant(values: Floats | None) -> bool:
    """Tell whether a quantity varies by less than a tenth of a percent, or is not recorded."""
    if values is None or not np.isfinite(values).any():
        return True
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return math.isclose(low, high, rel_tol=1e-3)
