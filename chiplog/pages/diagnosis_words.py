"""A diagnosis in words and rows: the same on the terminal and on the page."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from chiplog.pages import quantities as q
from chiplog.pages.findings import Words
from gap_diagnosis.criterion import Judgement
from gap_diagnosis.pareto import TRUSTED
from gap_diagnosis.result import NO_GAP, UNKNOWN, Diagnosis
from gap_diagnosis.result_parts import (
    CLOSABLE,
    Candidate,
    ChoiceEstimate,
    EffectSet,
    Metric,
    NumberEstimate,
    ParameterEstimate,
    Unknown,
)
from hil_harness.effects import catalogue

METRIC_WORDS = {
    "odometry_position_m": "position of the odometry",
    "odometry_heading_rad": "heading of the odometry",
    "drive_position_m": "position driven on command",
    "firmware_position_m": "position from the firmware",
    "turn_difference_rad": "turning, encoders against gyro",
    "timing_s": "timing",
}
_MOST_NAMES = 4
_LARGE = 2
"""So many effects or parameters that two candidates have in common are told once."""
_ALIKE = 0.1
"""Two estimates are told once that differ by less than this share of the interval."""
_ROUNDING = 1e-11
_PLAIN_UNITS = {"LSB", "K", "V"}


def set_name(effects: Sequence[str]) -> str:
    """Return a set of effects as one word: `a + b`, or the words of no_gap and unknown."""
    if tuple(effects) == (NO_GAP,):
        return "no gap"
    if tuple(effects) == (UNKNOWN,):
        return "an unlisted cause"
    return " + ".join(effects)


def group_name(sets: Sequence[EffectSet]) -> str:
    """Return all members of a group that cannot be told apart: `a or b or c + d`; of a large one
    what all have, and of what the sets are that differ: `a + b and one of 7 sets of c, d, e`."""
    rest = len(sets) - _MOST_NAMES
    common = [one for one in sets[0] if all(one in other for other in sets)]
    if rest > 0 and common:
        sets_with = Counter(one for some in sets for one in some if one not in common)
        differing = [one for one, _ in sets_with.most_common()]
        alone = " or nothing else" if len(common) in map(len, sets) else ""
        beside = f"one of {len(sets)} sets of {', '.join(differing)}{alone}"
        return f"{' + '.join(common)} and {beside}"
    more = f" or {rest} more" if rest > 0 else ""
    return " or ".join(set_name(effects) for effects in sets[:_MOST_NAMES]) + more


def probability(value: float) -> str:
    """Return a probability in percent, never as certain as 0 or 100 %."""
    if value < 0.001:
        return "< 0.1 %"
    if value > 0.999:
        return "> 99.9 %"
    return f"{100 * value:.3g} %" if value < 0.995 else f"{100 * value:.1f} %"


def headline(diagnosis: Diagnosis) -> str:
    """Return verdict, probability and gap before and after in one line.

    Of logs that contradict each other that comes first: the verdict is of one robot.
    """
    name = group_name(diagnosis.group)
    if diagnosis.verdict == UNKNOWN and _is_noises(diagnosis.gap):
        name += ", smaller than noise"
    elif diagnosis.verdict == NO_GAP and _is_above_noise(diagnosis.gap):
        name += " beyond tolerance"
    line = f"{name} ({probability(diagnosis.which[0].group_probability)})"
    if diagnosis.contradicting:
        line = f"the logs contradict each other; as of one robot {line}"
    gap = diagnosis.gap
    if gap is None:
        return line
    if _is_nothing(gap):
        return f"{line}: no gap in the {metric_name(gap.metric)}"
    return f"{line}: gap {gap_arrow(gap)}"


def verdict(diagnosis: Diagnosis) -> list[Words]:
    """Return the verdict as a sentence; it names the group, never its first member alone.

    Of logs that contradict each other that comes first.
    """
    said = _verdict(diagnosis)
    if not diagnosis.contradicting:
        return said
    return [
        Words("The logs contradict each other", strong=True),
        Words(" (the notes say in what): diagnose them one by one. Were they of one robot: "),
        *said,
    ]


def _verdict(diagnosis: Diagnosis) -> list[Words]:
    best = diagnosis.which[0]
    chance = Words(probability(best.group_probability), strong=True)
    if best.effects == (NO_GAP,) and not best.ambiguous_with:
        return [
            Words("No gap", strong=True),
            Words(" beyond tolerance and noise: probability "),
            chance,
            Words("."),
        ]
    if best.effects == (UNKNOWN,) and not best.ambiguous_with:
        return [
            Words("A gap that no listed effect explains", strong=True),
            Words(f", in stage {diagnosis.stage}: probability "),
            chance,
            Words("."),
        ]
    name = Words(group_name(diagnosis.group), strong=True)
    if len(diagnosis.group) > 1:
        return [
            name,
            Words(f" (stage {diagnosis.stage}), which this data cannot tell apart: together "),
            chance,
            Words("."),
        ]
    verb = "explain" if len(best.effects) > 1 else "explains"
    stage = f" {verb} the gap (stage {diagnosis.stage}): probability "
    return [name, Words(stage), chance, Words(".")]


def gap_arrow(gap: Metric) -> str:
    """Return `48.1 mm → 2.3 mm (floor 2.0 mm)`."""
    text = quantity(gap.before, gap.unit)
    if gap.after is not None:
        text += f" → {quantity(gap.after, gap.unit)}"
    return text if gap.floor is None else f"{text} (floor {quantity(gap.floor, gap.unit)})"


def gap_sentence(diagnosis: Diagnosis) -> str:
    """Return what was measured on held-out data, or why nothing was."""
    gap = diagnosis.gap
    if gap is None:
        return "No gap was measured: nothing could be held out."
    where = "another log" if gap.held_out == "log" else "stretches the fit never saw"
    name = metric_name(gap.metric)
    if _is_nothing(gap):
        return f"{name[:1].upper()}{name[1:]} on {where}: no gap."
    text = f"{name[:1].upper()}{name[1:]}, RMS on {where}: {gap_arrow(gap)}"
    if gap.closed is None:
        return f"{text}; {_why_not_closed(diagnosis, gap)}."
    return f"{text}; {_share_closed(gap)}."


def _is_nothing(gap: Metric) -> bool:
    """Tell whether there is nothing to close: a delay that is the same all along moves no beat."""
    return gap.before < _ROUNDING


def _is_noises(gap: Metric | None) -> bool:
    """Tell whether a gap is no larger than what noise alone would leave."""
    return gap is not None and gap.floor is not None and gap.before <= gap.floor


def _is_above_noise(gap: Metric | None) -> bool:
    """Tell whether a gap stands clear of its floor: if it is none, it lies within tolerance."""
    return gap is not None and gap.floor is not None and gap.before >= CLOSABLE * gap.floor


def _why_not_closed(diagnosis: Diagnosis, gap: Metric) -> str:
    """Return why no share is closed: the gap may be none, or nothing listed may close it."""
    if gap.floor is None:
        return "what noise alone would leave is not known"
    if diagnosis.verdict == UNKNOWN and _is_noises(gap):
        return "whatever causes it does less to this than noise does"
    if not _is_above_noise(gap):
        return "too close to the floor to say how much closed"
    if diagnosis.verdict == NO_GAP:
        return "what stands above the floor lies within tolerance"
    if gap.after is not None:
        return "nothing that was held out lies in the window in which it acts"
    return "no listed effect closes it"


def metric_name(metric: str) -> str:
    """Return a metric in words."""
    return METRIC_WORDS.get(metric, metric)


def known_already(diagnosis: Diagnosis) -> str:
    """Return the effects that were known beforehand, and whence: `gyro_bias (explained.toml)`."""
    if not diagnosis.granted:
        return ""
    names = ", ".join(one.effect for one in diagnosis.granted)
    return f"{names} ({diagnosis.granted[0].file})"


def unknown_sentence(diagnosis: Diagnosis) -> str:
    """Return what the leftover looks like, where no listed effect explains it; else nothing."""
    found = diagnosis.unknown
    if found is None:
        return ""
    text = f"The leftover sits in stage {found.stage}"
    if found.windows:
        text += ", " + " and ".join(_window(*one) for one in found.windows[:3])
    if found.depends_on:
        text += ", and goes with " + ", ".join(
            f"{one.variable.replace('_', ' ')} ({100 * one.share:.0f} % of it)"
            for one in found.depends_on
        )
    return f"{text}. {_modelled_sentence(found)}"


def _window(start_s: float, stop_s: float) -> str:
    if stop_s - start_s < 1.0:
        return f"at {0.5 * (start_s + stop_s):.1f} s"
    return f"from {round(start_s)} to {round(stop_s)} s"  # a float would print as -0


def _modelled_sentence(found: Unknown) -> str:
    """Return how far a model of what the leftover goes with closes the gap, or why none says."""
    model = found.modelled
    if model is None or model.after is None:
        because = "" if found.why_not is None else f": {found.why_not}"
        return f"How far a model of it would close the gap is not measured{because}."
    text = (
        f"Modelling it as a function of {model.variable.replace('_', ' ')} would take the "
        f"{metric_name(model.metric)} on held-out stretches from "
        f"{quantity(model.before, model.unit)} to {quantity(model.after, model.unit)}"
    )
    if model.closed is None:
        return f"{text}; {found.why_not}." if found.why_not else f"{text}."
    return f"{text}: {_share_closed(model)}."


def _share_closed(metric: Metric) -> str:
    """Return `88 % closed (95 %: 80 to 93 %)`; and that it may be chance where it may.

    Where less is left than noise leaves on average there is no share to tell.
    """
    closed = metric.closed or 0.0
    is_all = round(100 * closed) >= 100
    share = "closed down to what noise leaves" if is_all else f"{q.fixed(100 * closed, 0)} % closed"
    if metric.ci95 is None:
        return share
    low, high = (q.fixed(100 * min(bound, 1.0), 0) for bound in metric.ci95)
    doubt = "" if metric.ci95[0] > 0 else ", which may be chance"
    interval = f"{low} % or more" if is_all else f"{low} to {high} %"
    return f"{share} (95 %: {interval}){doubt}"


def candidate_rows(diagnosis: Diagnosis, most: int) -> list[list[str]]:
    """Return (probability, explanation, estimate, 95 % interval) of the likeliest.

    The lone parameter of a lone effect shares the row of its explanation; all others follow in rows
    of their own.
    """
    rows = []
    first = diagnosis.which[0]
    for candidate in diagnosis.which[:most]:
        chance = probability(candidate.probability)
        parameters = [
            [key, *parameter_words(key, one)] for key, one in candidate.parameters.items()
        ]
        if len(parameters) == len(candidate.effects) == 1:
            rows.append([chance, *parameters[0]])
            continue
        alike = [] if candidate is first else _said_before(first, candidate)
        rows.append([chance, _beside(first, candidate), "", ""])
        rows += [["", f"  {key}", *values] for key, *values in parameters if key not in alike]
        if alike:
            rows.append(["", "  the rest", "as above", ""])
    return rows


def _beside(first: Candidate, candidate: Candidate) -> str:
    """Return a candidate's effects; of a large set that mostly is the first one's, what differs."""
    common = set(first.effects) & set(candidate.effects)
    own, others = (
        [name for name in one.effects if name not in common] for one in (candidate, first)
    )
    if len(common) < _LARGE or not own or not others:
        return set_name(candidate.effects)
    return f"{set_name(own)} in the place of {set_name(others)}"


def _said_before(first: Candidate, candidate: Candidate) -> list[str]:
    """Return the parameters that were told of the first candidate, as they are here."""
    alike = [
        key
        for key, here in candidate.parameters.items()
        if key in first.parameters and _is_alike(first.parameters[key], here)
    ]
    return alike if len(alike) >= _LARGE else []


def _is_alike(there: ParameterEstimate, here: ParameterEstimate) -> bool:
    if isinstance(here, ChoiceEstimate) or isinstance(there, ChoiceEstimate):
        return here.estimate == there.estimate
    low, high = there.ci95
    return abs(here.estimate - there.estimate) < _ALIKE * (high - low)


def parameter_words(key: str, parameter: ParameterEstimate) -> tuple[str, str]:
    """Return the estimate of `effect.parameter` and its 95 % interval; of a choice its
    probability."""
    if isinstance(parameter, ChoiceEstimate):
        sure = parameter.probabilities[str(parameter.estimate)]
        return str(parameter.estimate), f"probability {probability(sure)}"
    scale, unit = (1.0, "") if _is_number_of(key) else _scale(parameter)
    low, high = (bound / scale for bound in parameter.ci95)
    digits = _decimals((high - low) / 2)
    values = (parameter.estimate / scale, low, high)
    middle, below, above = (q.fixed(value, digits) for value in values)
    return f"{middle} {unit}".rstrip(), f"{below} to {above} {unit}".rstrip()


def _is_number_of(key: str) -> bool:
    """Tell a number of cycles, bits or frames, and a factor: in percent nobody would say them."""
    effect, _, name = key.partition(".")
    known = catalogue().get(effect)
    return known is not None and any(
        one.name == name and one.unit == "1" and (one.kind == "whole" or one.neutral == 1)
        for one in known.parameters
    )


def quantity(value: float, unit: str) -> str:
    """Return a value with its unit as a person would say it, three digits; rounding is 0."""
    if abs(value) < _ROUNDING:
        value = 0.0
    if unit == "rad":
        return q.angle(value, 3)
    if _takes_no_prefix(unit):
        return f"{value:.3g} {unit}".replace("-", q.MINUS)
    return q.prefixed(value, unit, 3)


_WHOLE = {
    "firmware_resolution": "fewer by {} bit",
    "firmware_overflow": "up to {} bit",
    "coarse_trig_table": "up to {} entries",
    "stale_heading": "{} cycles",
}
"""How the whole numbers of effects are told that have nothing smaller."""
_LEAST_SHARE = 1e-6
"""What is less is told as a power of ten."""


def limit(effect: str, size: float | None) -> str:
    """Return from which size of an effect on a log shows it: with its unit, or that any does."""
    if size is None:
        return "cannot be seen"
    if size == 0:
        return "any"
    if effect in _WHOLE:
        return _WHOLE[effect].format(f"{size:.0f}")
    known = catalogue().get(effect)
    numbers = [one for one in known.parameters if one.kind == "real"] if known else []
    if not numbers:
        return f"{size:.3g}"
    unit, is_bound = numbers[0].unit, numbers[0].neutral == math.inf
    value = q.share(size) if unit == "1" else quantity(size, unit)
    if unit == "1" and size < _LEAST_SHARE:
        value = f"{size:.0e}"
    return f"up to {value}" if is_bound else value


def ambiguity_sentences(diagnosis: Diagnosis) -> list[str]:
    """Return what this data cannot tell apart, the winning group first."""
    sentences = []
    if len(diagnosis.group) > 1:
        sentences.append(f"{group_name(diagnosis.group)}: equally good explanations of this data.")
    winners = {name for effects in diagnosis.group for name in effects}
    for group in diagnosis.structure.groups:
        if not winners & set(group):
            sentences.append(f"{', '.join(group)}: this log could not have told them apart.")
    return sentences


def logs_clause(diagnosis: Diagnosis) -> str:
    """Return how much was read: `2 logs, 3 min 20 s, 74.2 m`."""
    logs = diagnosis.logs
    if not logs:
        return "no log"
    text = f"{len(logs)} logs, " if len(logs) > 1 else ""
    text += q.duration(sum(log.duration_s for log in logs))
    driven = [log.distance_m for log in logs if log.distance_m is not None]
    return f"{text}, {q.length(sum(driven), 3)} driven" if driven else text


def judgement_sentence(judgement: Judgement) -> str:
    """Return a bound and the gap it was held against."""
    bound = judgement.bound
    unit = {"heading": "rad", "turn": "rad", "timing": "s"}.get(bound.metric, "m")
    per = "" if bound.per is None else f" per {bound.per:g} {bound.span}"
    verb = "within" if judgement.holds else "more than"
    where = f" in {judgement.log}" if judgement.log else ""
    text = f"{bound.metric}{where}: {quantity(judgement.value, unit)}{per}, "
    text += f"{verb} the {quantity(bound.limit, unit)}{per} allowed"
    if judgement.scaled is not None:
        text += f" (scaled from windows of {judgement.scaled:.3g} {bound.span})"
    return text + "."


def candidate_facts(candidate: Candidate) -> str:
    """Return how well the sampling behind a candidate is trusted, and where it acts."""
    facts = []
    if candidate.windows:
        spans = ", ".join(f"{a:.1f} to {b:.1f} s" for a, b in candidate.windows)
        facts.append(f"acts from {spans}")
    if candidate.separation is not None:
        facts.append(f"2 ln L gained: {candidate.separation:.3g}")
    if candidate.pareto_k is not None:
        trust = "" if candidate.pareto_k < TRUSTED else ": do not trust its interval"
        facts.append(f"Pareto k {candidate.pareto_k:.2f}{trust}")
    return ", ".join(facts)


def _scale(parameter: NumberEstimate) -> tuple[float, str]:
    """Return the divisor and the unit in which a number reads well."""
    unit = parameter.unit
    if unit == "1":
        return 0.01, "%"
    largest = max(abs(parameter.estimate), *(abs(bound) for bound in parameter.ci95))
    if unit == "rad":
        return math.pi / 180, "°"
    if _takes_no_prefix(unit) or largest == 0:
        return 1.0, unit
    for factor, prefix in ((1.0, ""), (1e-3, "m"), (1e-6, "µ")):
        if largest >= factor:
            return factor, prefix + unit
    return 1e-9, f"n{unit}"


def _takes_no_prefix(unit: str) -> bool:
    return unit in _PLAIN_UNITS or "²" in unit or unit.startswith("1/")


def _decimals(half_width: float) -> int:
    """Return decimals that show two digits of an interval's half width."""
    if half_width <= 0:
        return 3
    return min(8, max(0, 1 - math.floor(math.log10(half_width))))
