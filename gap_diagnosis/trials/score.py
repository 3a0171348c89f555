"""Scoring a trial: the seal opened, every case held against its answer, one table of scores."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, Final

from gap_diagnosis.trials.case import RANDOM, RECOMMENDED, STRATA
from gap_diagnosis.trials.full import FAMILIAR, NEW, OTHER, is_of_the_prior, newness
from gap_diagnosis.trials.judge import Judged, Parameter
from gap_diagnosis.trials.layout import SCHEMA
from gap_diagnosis.trials.opening import Opened
from gap_diagnosis.trials.tables import (
    by_effect,
    confusion,
    false_alarms,
    miss_curve,
    name_of,
    stages,
)
from gap_diagnosis.trials.truth import UNKNOWN
from gap_diagnosis.trials.yardsticks import (
    Share,
    auroc,
    calibration,
    calibration_interval,
    mean,
    perfect_calibration,
    perfect_share,
    rank_test,
    ratio,
    share,
)

_HALF: Final = 0.5
_CLOSABLE: Final = 2.0
_NO_FLOOR: Final = 1e-12
"""Below it nothing is left by noise: arithmetic replayed bit for bit has no floor."""
_WORST: Final = 12
_POSITIVE: Final = (0.0, math.inf)
_MEDIAN_ERROR: Final = 0.6744897501960817
"""Of a normal error, in standard deviations."""


def scores(opened: Opened, again: Opened | None = None) -> dict[str, Any]:
    """Return all scores: overall, by stratum, by what is new, by effect, with the worst cases.

    *again*: the trial of its ambiguous cases with one log more.
    """
    judged = opened.judged
    familiar = [one for one in judged if not newness(one.case)]
    parts: dict[str, Sequence[Judged]] = {"all": judged, FAMILIAR: familiar}
    parts |= {name: [one for one in judged if one.case.stratum == name] for name in STRATA}
    for name in NEW:
        parts[name] = [one for one in judged if name in newness(one.case)]
    return {
        "schema": SCHEMA,
        "cases": len(judged),
        "missing": opened.missing,
        "crashes": sum(one.error is not None for one in judged),
        "parts": {name: _part(part, again) for name, part in parts.items() if part},
        "alarms": {name: _alarms(parts[name]) for name in STRATA},
        "effects": by_effect(judged),
        "miss_curve": miss_curve(judged),
        "confusion": confusion(judged),
        "stages": stages(judged),
        "other_engine_alarms": false_alarms(
            [one for one in judged if one.is_null and OTHER in newness(one.case)]
        ),
        "wrong": [_told_wrong(one) for one in _wrong(judged)[:_WORST]],
    }


def _part(judged: Sequence[Judged], again: Opened | None) -> dict[str, Any]:
    names = {one.case.name for one in judged}
    driven = [one for one in again.judged if one.case.of in names] if again else judged
    full = [one for one in judged if one.truth != UNKNOWN]
    clear = [one for one in full if one.is_clear]
    alone = [one for one in clear if len(one.oracle) == 1]
    pairs = [one for one in clear if len(one.case.true_effects) == 2]
    staged = [one for one in clear if one.has_one_stage]
    said, right = [one.group_probability for one in judged], [one.in_group for one in judged]
    imitable = [one for one in judged if one.is_withheld and one.is_imitable]
    error, bins = calibration(said, right)
    parameters = [parameter for one in judged for parameter in one.parameters]
    ranks, ranks_p = rank_test([one.rank for one in parameters])
    found = {
        "cases": len(judged),
        "stage": share([one.stage_right for one in staged]),
        "top1": share([one.top1 for one in alone]),
        "top3": share([one.in_top3 for one in clear]),
        "own_name": share([one.has_own_name for one in clear]),
        "true_probability": mean([one.true_probability for one in alone], (0.0, 1.0)),
        "group_top1": share([one.in_group for one in clear]),
        "group_size": mean([float(len(one.group)) for one in clear], _POSITIVE),
        "group_ratio": ratio(
            [float(len(one.group)) for one in clear], [float(len(one.oracle)) for one in clear]
        ),
        "oracle_group_size": mean([float(len(one.oracle)) for one in clear], _POSITIVE),
        "pairs_both_named": share([one.in_group for one in pairs]),
        "false_alarms": _false_alarms(judged),
        "confident_wrong": share([one.confident_wrong for one in _unlisted(judged)]),
        "confident_wrong_nameless": share(
            [
                one.confident_wrong
                for one in judged
                if one.is_lost and not one.is_withheld and not one.is_imitable
            ]
        ),
        "unknown_auroc": _unknown(judged),
        "unknown_stage": share(
            [one.stage_right for one in _unlisted(judged) if one.verdict == "unknown"]
        ),
        **_leftovers(_unlisted(judged)),
        "imitable_right": share([one.in_group for one in imitable]),
        "imitable_named": share([one.names_imitator for one in imitable]),
        "imitable": sum(one.is_imitable for one in judged),
        "brier": mean([one.brier for one in judged], (0.0, 2.0)),
        "log_score": mean([one.log_score for one in judged], _POSITIVE),
        "ece": error,
        "ece_interval": calibration_interval(said, right),
        "ece_by_chance": perfect_calibration(said),
        "forecast": _forecast([one for one in judged if is_of_the_prior(one.case)]),
        "calibration": [asdict(one) for one in bins],
        "coverage": {
            name: share([one.inside[place] for one in parameters])
            for place, name in enumerate(("ci50", "ci80", "ci95"))
        },
        "ranks": {"counts": ranks, "p": ranks_p},
        "error_sd": mean([abs(one.error_sd) for one in parameters]),
        "error_over_bound": _over_bound(parameters),
        "window_overlap": mean([o for one in judged if (o := one.overlap) is not None], (0.0, 1.0)),
        **_closed(judged),
        "seconds": mean([one.seconds for one in judged], _POSITIVE),
        "again": _again(driven),
    }
    return {name: _plain(value) for name, value in found.items()}


def _alarms(judged: Sequence[Judged]) -> dict[str, Any]:
    """Return false alarms apart by what is new, as each has a goal of its own."""
    kinds = {name: [one for one in judged if name in newness(one.case)] for name in NEW}
    kinds[FAMILIAR] = [one for one in judged if not newness(one.case)]
    return {name: {"false_alarms": asdict(_false_alarms(own))} for name, own in kinds.items()}


def _false_alarms(judged: Sequence[Judged]) -> Share:
    return share([one.verdict != "no_gap" for one in judged if one.is_null])


def _forecast(judged: Sequence[Judged]) -> dict[str, Any]:
    """Return the top group's calibration error, its interval, its bins, a perfect forecaster's."""
    said, right = [one.group_probability for one in judged], [one.in_group for one in judged]
    error, bins = calibration(said, right)
    return {
        "cases": len(judged),
        "error": error,
        "bins": [{**asdict(one), "perfect": perfect_share(one)} for one in bins],
        "interval": calibration_interval(said, right),
        "by_chance": perfect_calibration(said),
    }


def _plain(value: Any) -> Any:
    if isinstance(value, Share):
        return asdict(value)
    if isinstance(value, dict):
        return {name: _plain(one) for name, one in value.items()}
    return value


def _unlisted(judged: Sequence[Judged]) -> list[Judged]:
    """Return the cases whose withheld cause nothing left in the library can imitate."""
    return [one for one in judged if one.is_withheld and not one.is_imitable]


def _leftovers(withheld: Sequence[Judged]) -> dict[str, Share]:
    """Return how often what is said of an unlisted cause's leftover points the right way.

    *unknown_goes_with*: it says what the leftover goes with. *unknown_closes*, *unknown_half*: a
    model of that closes some of the gap, or half of it, where no fit has seen it.
    """
    told = [one for one in withheld if one.verdict == "unknown" and one.leftover is not None]
    closes = [one.leftover_closes for one in told if one.leftover_closes is not None]
    return {
        "unknown_goes_with": share([bool(one.leftover) for one in told]),
        "unknown_closes": share([one > 0.0 for one in closes]),
        "unknown_half": share([one >= _HALF for one in closes]),
    }


def _unknown(judged: Sequence[Judged]) -> Share:
    """Return the AUROC of P(unknown): withheld causes against the same with the full library."""
    positive = _unlisted(judged)
    negative = [one for one in judged if one.case.kind == "decoy" and one.truth != UNKNOWN]
    negative = negative or [one for one in judged if one.truth != UNKNOWN and one.is_clear]
    return auroc(
        [one.unknown_probability for one in positive if one.error is None],
        [one.unknown_probability for one in negative if one.error is None],
    )


def _over_bound(parameters: Sequence[Parameter]) -> Share:
    """Return the median of errors over their bounds as a factor of a normal error's median."""
    ratios = sorted(abs(r) for one in parameters if (r := one.over_bound) is not None)
    if not ratios:
        return Share(None, None, None, 0)
    count = len(ratios)
    half = 0.98 * math.sqrt(count)
    places = (count / 2, count / 2 - half, count / 2 + half)
    middle, low, high = (
        ratios[min(max(math.floor(place), 0), count - 1)] / _MEDIAN_ERROR for place in places
    )
    return Share(middle, low, high, count)


def _closed(judged: Sequence[Judged]) -> dict[str, Share]:
    """Return what was closed of the gaps of twice their floor or more.

    *gap_closed* is Σ(before − after)/Σ(before − floor), each gap in floors of its own, as metrics
    differ in unit; *gap_closed_each* the mean of the same gaps' shares, so that none outweighs
    another; *gap_closed_exact* that of gaps without a floor, which no sum in floors can hold.
    """
    gaps = [one.gap for one in judged if one.gap is not None]
    large = [(b, a, f) for b, a, f in gaps if b >= _CLOSABLE * f > _CLOSABLE * _NO_FLOOR]
    exact = [(b, a) for b, a, f in gaps if f <= _NO_FLOOR < b]
    return {
        "gap_closed": ratio([(b - a) / f for b, a, f in large], [(b - f) / f for b, _, f in large]),
        "gap_closed_each": mean([(b - a) / (b - f) for b, a, f in large]),
        "gap_closed_exact": mean([(b - a) / b for b, a in exact]),
    }


def _again(judged: Sequence[Judged]) -> dict[str, Share]:
    """Return the probability of the truth after the recommended manoeuvre, after another one, and
    by how much the first is more, case by case."""
    told = {(one.case.of, one.case.again): one.true_probability for one in judged}
    both = [of for of, kind in told if kind == RECOMMENDED and (of, RANDOM) in told]
    advised = [told[of, RECOMMENDED] for of in both]
    other = [told[of, RANDOM] for of in both]
    more = [a - b for a, b in zip(advised, other, strict=True)]
    return {
        RECOMMENDED: mean(advised, (0.0, 1.0)),
        RANDOM: mean(other, (0.0, 1.0)),
        "more": mean(more, (-1.0, 1.0)),
    }


def _wrong(judged: Sequence[Judged]) -> list[Judged]:
    """Return the cases that went wrong, the most certain first."""
    found = [
        one for one in judged if not one.in_group and (one.is_clear or one.is_null or one.error)
    ]
    return sorted(found, key=lambda one: -one.group_probability)


def _told_wrong(one: Judged) -> dict[str, Any]:
    return {
        "case": one.case.name,
        "truth": name_of(one.truth),
        "effects": {name: dict(values) for name, values in one.case.effects.items()},
        "over_limit": one.over_limit,
        "verdict": one.verdict,
        "probability": one.group_probability,
        "true_probability": one.true_probability,
        "drive": one.case.drive,
        "noise": one.case.noise.kind,
        "robot": one.case.robot,
        "error": one.error,
    }


def summary(found: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of a short table: what was scored, and how it went."""
    part = found["parts"]["all"]
    rows = [("cases", f"{found['cases']}"), ("crashes", f"{found['crashes']}")]
    names = (
        ("stage", "stage"), ("group-top-1", "group_top1"), ("top-1, one name right", "top1"),
        ("probability of the truth", "true_probability"), ("pairs, both named", "pairs_both_named"),
        ("false alarms", "false_alarms"), ("unknown, AUROC", "unknown_auroc"),
        ("unknown, confident wrong", "confident_wrong"), ("Brier", "brier"),
    )  # fmt: skip
    rows += [(label, words(part[key])) for label, key in names if part[key]["count"]]
    if part["again"]["more"]["count"]:
        rows.append(("truth after what is recommended", words(part["again"][RECOMMENDED])))
        rows.append(("truth after another manoeuvre", words(part["again"][RANDOM])))
    rows += [("coverage of " + name, words(one)) for name, one in part["coverage"].items()]
    rows.append(("calibration error", "none" if part["ece"] is None else f"{part['ece']:.3f}"))
    return rows


def words(one: Mapping[str, Any]) -> str:
    """Return a share with its interval: ``0.95 (0.91 to 0.98), 120``."""
    if one["value"] is None:
        return "none"
    span = "" if one["low"] is None else f" ({one['low']:.2f} to {one['high']:.2f})"
    return f"{one['value']:.2f}{span}, {one['count']}"
