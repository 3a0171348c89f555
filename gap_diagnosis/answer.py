"""From probabilities to the answer's entries: names, intervals, groups."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Final, cast, get_args

import numpy as np

from gap_diagnosis.analysis import Analysis, Reduced
from gap_diagnosis.block_sums import Effects, concerned
from gap_diagnosis.explanations import twin_sets
from gap_diagnosis.gap.metrics import drifting_share
from gap_diagnosis.hypothesis import FORM, Estimate, Fit
from gap_diagnosis.modelled import LEAST_SHARE, known_variable
from gap_diagnosis.ranking import Ranked, Ranking
from gap_diagnosis.recording import Floats
from gap_diagnosis.result import NO_GAP, UNKNOWN
from gap_diagnosis.result_parts import (
    Candidate,
    ChoiceEstimate,
    Dependence,
    Modelled,
    NumberEstimate,
    ParameterEstimate,
    StageOrNone,
    Unknown,
    Variable,
)
from hil_harness.effects import Effect, catalogue

_LISTED: Final = 12
_DETAILED: Final = 4
_CLOSELY: Final = 0.01
"""Of less probable sets, windows and thresholds are told as roughly as the search found them."""
_MOST_AMBIGUOUS: Final = 40
_FEW: Final = 2
"""Twins of a group's members of so many effects are named with it."""
_EXACT: Final = 1e-100
"""What is known to the last digit is as sure as this; its square is still a number."""


def candidates(
    ranking: Ranking,
    analyses: Sequence[Analysis],
    library: Mapping[str, Effect] = MappingProxyType({}),
    split: Collection[str] = (),
) -> tuple[list[Candidate], float]:
    """Return the entries of ``which`` and the probability of all that is not listed; *library* are
    a user's own effects, *split* the parameters in which logs contradict each other."""
    known = {**catalogue(), **library}
    listed = [one for one in ranking.sets if one.effects and one.probability > 0][:_LISTED]
    nothing = ranking.of(frozenset())
    lost = sum(ranking.unknown.values())
    entries = [
        _candidate(one, ranking, analyses, place, known, split) for place, one in enumerate(listed)
    ]
    entries.append(
        Candidate(
            effects=(NO_GAP,), probability=nothing.probability,
            group_probability=nothing.probability, separation=0.0,
        )
    )  # fmt: skip
    entries.append(Candidate(effects=(UNKNOWN,), probability=lost, group_probability=lost))
    other = max(0.0, 1.0 - float(sum(one.probability for one in entries)))
    return entries, other


def _candidate(
    one: Ranked,
    ranking: Ranking,
    analyses: Sequence[Analysis],
    place: int,
    known: Mapping[str, Effect],
    split: Collection[str],
) -> Candidate:
    group = ranking.group(one.effects)
    ambiguous = [tuple(sorted(each.effects)) or (NO_GAP,) for each in group[:_MOST_AMBIGUOUS]]
    named = {tuple(sorted(one.effects)), *ambiguous}
    # Two for one are named beside the set itself only, and so are those of larger sets: of a Kobuki
    # one of 18 sets was one of 34.
    twins = dict.fromkeys(
        tuple(sorted(twin))
        for each in (one, *group[:_MOST_AMBIGUOUS])
        for twin in twin_sets(each.effects)
        if each is one or len(twin) == len(each.effects) <= _FEW
        if tuple(sorted(twin)) not in named
    )
    ambiguous += twins
    # a twin is named whatever it gains over its parts, and so counts like any other member
    group += [
        each for each in ranking.sets if tuple(sorted(each.effects)) in twins and each not in group
    ]
    detailed = analyses if place < _DETAILED else []
    closely = place == 0 or one.probability >= _CLOSELY
    by_log = [_details(one.effects, each, closely=closely) for each in detailed]
    fits = [fit for each in by_log for fit in each]
    parameters = {
        key: _converted(key, said, known, is_split=key in split)
        for key, said in _independent(by_log, known).items()
    }
    windows = tuple(window for fit in fits for window in fit.windows)
    return Candidate(
        effects=tuple(sorted(one.effects)),
        probability=one.probability,
        group_probability=min(1.0, one.probability + sum(each.probability for each in group)),
        parameters=dict(sorted(parameters.items())),
        windows=windows,
        ambiguous_with=tuple(ambiguous),
        separation=2 * one.log_likelihood,
        pareto_k=max((fit.pareto_k for fit in fits if fit.pareto_k is not None), default=None),
    )


def estimates_by_log(
    effects: Effects, analyses: Sequence[Analysis]
) -> dict[str, dict[int, Estimate]]:
    """Return, by parameter, what each log says by itself: of its blocks, the surest. Sizes that
    hold at another speed than all logs together say are left out."""
    by_log = [_by_parameter(_details(effects, analysis)) for analysis in analyses]
    found: dict[str, dict[int, Estimate]] = {}
    for place, told in enumerate(_in_one_form(by_log)):
        for key, said in told.items():
            found.setdefault(key, {})[place] = min(said, key=lambda one: one.sd)
    return found


def _details(effects: Effects, analysis: Analysis, *, closely: bool = True) -> list[Fit]:
    fits = []
    for block, own, _ in concerned([analysis.blocks], effects):
        whole = block.block if isinstance(block, Reduced) else block
        motion = analysis.motion if whole is analysis.motion else None
        fit = block.fit(own) if motion is None else motion.detail(own, closely=closely)
        fits.append(
            replace(fit, parameters=_by_own_names(fit.parameters, analysis.recording.own_names))
        )
    return fits


def _by_own_names(
    parameters: Mapping[str, Estimate], own_names: Mapping[str, str]
) -> Mapping[str, Estimate]:
    """Return the parameters with the name that the log's bus has for a message."""
    key = "frame_latency.frame"
    told = parameters.get(key)
    if told is None:
        return parameters
    by_name = {own_names.get(name, name): p for name, p in (told.probabilities or {}).items()}
    value = own_names.get(str(told.value), told.value)
    return {**parameters, key: replace(told, value=value, probabilities=by_name)}


def _independent(
    by_log: Sequence[Sequence[Fit]], known: Mapping[str, Effect]
) -> dict[str, list[Estimate]]:
    """Return what logs and their blocks say of each parameter, each reading of it once: all that
    blocks say of a gyro they read from the same codes."""
    found: dict[str, list[Estimate]] = {}
    for told in _in_one_form([_by_parameter(fits) for fits in by_log]):
        for key, said in told.items():
            effect = known.get(key.partition(".")[0])
            is_number = all(one.samples is not None for one in said)
            of_one_reading = is_number and effect is not None and effect.stage == "gyro"
            surest = [min(said, key=lambda one: one.sd)] if of_one_reading else said
            found.setdefault(key, []).extend(surest)
    return found


def _in_one_form(
    by_log: Sequence[Mapping[str, list[Estimate]]],
) -> list[dict[str, list[Estimate]]]:
    """Return what logs say of each parameter, without the sizes of those that take an effect for
    one of another form than all together do: a log at one speed alone hardly tells."""
    told: dict[str, list[Estimate]] = {}
    for log in by_log:
        for key, said in log.items():
            if key.endswith(f".{FORM}") and said[0].samples is None:
                told.setdefault(key, []).extend(said)
    forms = {key: str(_choice(said).estimate) for key, said in told.items()}

    def holds(log: Mapping[str, list[Estimate]], key: str) -> bool:
        form = f"{key.partition('.')[0]}.{FORM}"
        is_told = form in forms and form in log
        return key == form or not is_told or str(log[form][0].value) == forms[form]

    return [{key: said for key, said in log.items() if holds(log, key)} for log in by_log]


def _by_parameter(fits: Sequence[Fit]) -> dict[str, list[Estimate]]:
    found: dict[str, list[Estimate]] = {}
    for fit in fits:
        for key, estimate in fit.parameters.items():
            found.setdefault(key, []).append(estimate)
    return found


_MOMENTS: Final = frozenset({"start_s", "stop_s"})


def _converted(
    key: str, estimates: Sequence[Estimate], known: Mapping[str, Effect], *, is_split: bool
) -> ParameterEstimate:
    """Return one estimate of all: blocks and logs that speak of a parameter are weighed.

    Where it *is_split*, the interval spans what the logs say.
    """
    choices = [one for one in estimates if one.samples is None]
    if choices:
        return _choice(choices)
    if any(one.is_either for one in estimates):
        ways = [[_read_one_way(one, way) for one in estimates] for way in (0, 1)]
        samples = np.concatenate([_weighed(one, is_split=is_split) for one in ways])
    else:
        samples = _weighed(estimates, is_split=is_split)
    effect, _, name = key.partition(".")
    try:
        unit = known[effect].parameter(name).unit
    except KeyError:
        unit = "1"
    low95, low80, low50, middle, high50, high80, high95 = np.percentile(
        samples, [2.5, 10, 25, 50, 75, 90, 97.5]
    )
    return NumberEstimate(
        # Between two moments at which something may begin nothing does.
        estimate=float(middle if name in _MOMENTS else samples.mean()),
        unit=unit,
        sd=float(samples.std()),
        ci50=(float(low50), float(high50)),
        ci80=(float(low80), float(high80)),
        ci95=(float(low95), float(high95)),
    )


def _read_one_way(one: Estimate, way: int) -> Estimate:
    """Return what an estimate says of one of the two ways to read a log, 0 or 1."""
    if not one.is_either:
        return one
    samples = np.asarray(one.samples)[way::2]
    return replace(one, value=float(samples.mean()), sd=float(samples.std()), samples=samples)


def _weighed(estimates: Sequence[Estimate], *, is_split: bool) -> Floats:
    """Return draws, float64[s], of what estimates say together, each by its variance."""
    best = min(estimates, key=lambda one: one.sd)
    samples = np.asarray(best.samples, dtype=np.float64)
    if len(estimates) > 1:
        weights = np.array([max(one.sd, _EXACT) ** -2 for one in estimates])
        values = np.array([float(one.value) for one in estimates])
        mean = float(np.average(values, weights=weights))
        sd = float(weights.sum() ** -0.5)
        if is_split:
            sd = float(np.hypot(sd, np.sqrt(np.mean((values - mean) ** 2))))
        samples = mean + (samples - samples.mean()) * sd / max(best.sd, _EXACT)
    return samples


def _choice(estimates: Sequence[Estimate]) -> ChoiceEstimate:
    total: dict[str, float] = {}
    for one in estimates:
        known = one.probabilities or {str(one.value): 1.0}
        for name, probability in known.items():
            total[name] = total.get(name, 0.0) + np.log(max(probability, 1e-12))
    top = max(total.values())
    weights = {name: float(np.exp(value - top)) for name, value in total.items()}
    whole = sum(weights.values())
    best = max(weights, key=lambda name: weights[name])
    value = next((one.value for one in estimates if str(one.value) == best), estimates[0].value)
    known_value = value if isinstance(value, str) else int(value)
    return ChoiceEstimate(
        estimate=known_value if str(known_value) in weights else best,
        probabilities={name: weight / whole for name, weight in weights.items()},
    )


def stage_probabilities(ranking: Ranking, stage_of: Mapping[str, str]) -> dict[StageOrNone, float]:
    """Return the probability of each stage; a pair's is split evenly between its effects."""
    stages: dict[StageOrNone, float] = dict.fromkeys(get_args(StageOrNone), 0.0)
    for one in ranking.sets:
        if not one.effects:
            stages["none"] += one.probability
        for effect in one.effects:
            stage = cast(StageOrNone, stage_of[effect])
            stages[stage] += one.probability / len(one.effects)
    for name, probability in ranking.unknown.items():
        stages[cast(StageOrNone, name)] += probability
    total = sum(stages.values())
    return {stage: value / total for stage, value in stages.items()}


def unknown_part(
    analyses: Sequence[Analysis],
    stage: StageOrNone,
    modelled: Modelled | None = None,
    why_not: str | None = None,
) -> Unknown:
    """Describe the leftover: when it is there, on what it depends, the likeliest first, and how far
    a model of the first closes the gap.

    What explains a share of it and speaks against itself by more, as a function of many bends may,
    is nothing that it depends on.
    """
    shares: dict[Variable, float] = {}
    likely: dict[Variable, float] = {}
    windows: tuple[tuple[float, float], ...] = ()
    for analysis in analyses:
        if stage == "firmware" and analysis.firmware is not None:
            left = analysis.firmware.leftover()
            windows = left.windows
            found = [(variable, share, share) for variable, share in left.depends_on]
        elif stage == "actuation" and analysis.drive is not None:
            found = [(o.variable, o.share, o.log_evidence) for o in analysis.drive.goes_with]
        else:
            own = [one for one in analysis.alternatives if one.stage == stage][:3]
            found = [(one.variable, one.share, one.log_evidence) for one in own]
            seen = analysis.traces.get(stage)
            if own and own[0].log_evidence > 0:
                windows += own[0].windows
            if seen is not None and not own:
                windows += seen.windows
                frames = analysis.recording.frames
                share = drifting_share(frames) if seen.is_of_clock else seen.goes_with_time
                found = [("time", share, share)]
            windows += analysis.lost.windows if stage == "reference" else ()
        for named, share, evidence in found:
            known = known_variable(named)
            if known is not None and share >= LEAST_SHARE:
                shares[known] = max(shares.get(known, 0.0), float(share))
                likely[known] = likely.get(known, 0.0) + evidence
    if not windows:  # it acts all along
        first, last = analyses[0].recording.t_s[[0, -1]]
        windows = ((float(first), float(last)),)
    ordered = sorted((one for one in likely if likely[one] > 0), key=lambda one: -likely[one])
    return Unknown(
        stage=stage,
        windows=windows,
        depends_on=tuple(Dependence(variable=name, share=shares[name]) for name in ordered),
        closes=None if modelled is None else modelled.closed,
        modelled=modelled,
        why_not=why_not,
    )
