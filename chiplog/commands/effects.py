"""`chiplog effects`: the catalogue of what makes a real robot differ from the simulated one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from chiplog.commands.options import EffectLibraryOption
from chiplog.commands.output import STANDARD_OUTPUT, write_json
from chiplog.errors import CommandError, suggestion

if TYPE_CHECKING:
    from gap_diagnosis.priors import Prior
    from hil_harness.effects import Effect, EffectParameter

_WIDEST = 32
_LAW = 48
_FACTS = ("unit", "neutral", "typical", "tolerance", "prior")
_PRIOR_SAID = (
    "For `chiplog diagnose`, without sign: up to the tolerance is no news (robot.toml's own where "
    "it states one), and the prior is even over orders of magnitude."
)
_NO_PRIOR_SAID = (
    "A law in words goes on in `chiplog effects NAME`; an effect without prior and law is not "
    "named by a diagnosis."
)
_NESTED = ("apply", "explain", "parameters", "twins")


class Stage(StrEnum):
    """Where in the data flow an effect acts."""

    ACTUATION = "actuation"
    WHEEL = "wheel"
    ENCODER = "encoder"
    GYRO = "gyro"
    BUS = "bus"
    FIRMWARE = "firmware"
    REFERENCE = "reference"
    SETUP = "setup"


def command(
    name: Annotated[
        str | None, typer.Argument(help="One effect, with all that is known of it.")
    ] = None,
    stage: Annotated[Stage | None, typer.Option("--stage", help="Only those of one stage.")] = None,
    effect_library: EffectLibraryOption = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the list to this file; - prints it.")
    ] = None,
) -> None:
    """List the effects that `chiplog run --effect NAME.PARAM=VALUE` can switch on."""
    from gap_diagnosis.priors import default_prior, with_library
    from hil_harness.effects import catalogue, load_effect_library

    known = catalogue() if effect_library is None else load_effect_library(effect_library)
    chosen = _chosen(known, name, stage)
    own = {each: effect for each, effect in known.items() if each not in catalogue()}
    prior = with_library(default_prior(), own)
    if json_file is not None:
        write_json(json_file, [_as_json(effect, prior) for effect in chosen])
    if json_file == STANDARD_OUTPUT:
        return
    if name is not None:
        _show_one(chosen[0], prior)
    else:
        _show_all(chosen, prior)


def _chosen(known: Mapping[str, Effect], name: str | None, stage: Stage | None) -> list[Effect]:
    if name is not None and name not in known:
        near = suggestion(name, list(known)) or "; `chiplog effects` lists them"
        raise CommandError(f"no such effect {name!r}{near}")
    return [
        effect
        for effect in known.values()
        if name in (None, effect.name) and stage in (None, effect.stage)
    ]


def _show_all(effects: Sequence[Effect], prior: Prior) -> None:
    from chiplog.terminal import show_line, show_table

    rows = []
    stage = ""
    for effect in effects:
        heads = [effect.stage if effect.stage != stage else "", effect.name]
        stage = effect.stage
        believed = _with_law(_believed(effect, prior), effect, prior)
        for parameter in effect.parameters:
            facts = [*_facts(parameter, _WIDEST), *believed[parameter.name]]
            rows.append([*heads, parameter.name, *facts])
            heads = ["", ""]
        if not effect.parameters:
            law = _shortened(prior.laws.get(effect.name, ""))
            rows.append([*heads, "none", *[""] * (len(_FACTS) - 1), law])
    show_table(["stage", "effect", "parameter", *_FACTS], rows, words=4)
    show_line()
    show_line(_PRIOR_SAID)
    show_line(_NO_PRIOR_SAID)
    show_line("A ratio is real over described, minus 1. `chiplog effects NAME` tells more of one.")
    show_line("Any effect takes start_s and stop_s besides: it then acts in this part of the log.")


def _show_one(effect: Effect, prior: Prior) -> None:
    from chiplog.terminal import show_line, show_table

    believed = _believed(effect, prior)

    show_line(f"{effect.name}, stage {effect.stage}")
    show_line(effect.signature)
    for twins in effect.twins:
        condition = f" if {twins.condition}" if twins.condition else ""
        show_line(f"Leaves the same data as {' + '.join(twins.effects)}{condition}.")
    show_line()
    show_table(
        ["parameter", *_FACTS, "meaning"],
        [[p.name, *_facts(p), *believed[p.name], p.meaning] for p in effect.parameters],
        words=7,
    )
    if effect.name in prior.laws:
        show_line()
        show_line(f"Prior for `chiplog diagnose`: {prior.laws[effect.name]}.")
    if any(any(cells) for cells in believed.values()):
        show_line()
        show_line(_PRIOR_SAID)


def _believed(effect: Effect, prior: Prior) -> dict[str, list[str]]:
    """Return tolerance and prior range of each parameter; empty where none is stated."""
    from gap_diagnosis.priors import stated

    cells = {parameter.name: ["", ""] for parameter in effect.parameters}
    for name, one in stated(prior, effect).items():
        share = f" of {one.of}" if one.of else ""
        span = "" if one.span is None else f"{_text(one.span[0])} to {_text(one.span[1])}{share}"
        seldom = "" if one.most is None else f", seldom to {_text(one.most)}"
        cells[name] = ["" if one.tolerance is None else _text(one.tolerance), span + seldom]
    return cells


def _with_law(cells: dict[str, list[str]], effect: Effect, prior: Prior) -> dict[str, list[str]]:
    """Return the cells with the beginning of the effect's law, where it has one: with the first
    number without a range, else with the first choice."""
    law = prior.laws.get(effect.name)
    without = [one for one in effect.parameters if not cells[one.name][1]]
    if law is None or not without:
        return cells
    numbers = [one for one in without if one.kind in ("real", "whole")]
    name = (numbers or without)[0].name
    return {**cells, name: [cells[name][0], _shortened(law)]}


def _shortened(law: str) -> str:
    """Return a law until a comma near the width of the column, or until a blank."""
    if len(law) <= _LAW:
        return law
    until = max(law.rfind(mark, 0, _LAW) for mark in (",", ";", ":"))
    return law[: until if until > 0 else law.rindex(" ", 0, _LAW)] + " …"


def _facts(parameter: EffectParameter, widest: int = 1000) -> list[str]:
    """Return unit (or choices, or how many if they are too wide), neutral and typical range."""
    unit = "|".join(parameter.choices) if parameter.choices else parameter.unit
    if len(unit) > widest:
        unit = f"one of {len(parameter.choices)}"
    if parameter.kind == "message":
        unit = "message"
    typical = parameter.typical
    span = "" if typical is None else f"{_text(typical.low)} to {_text(typical.high)}"
    return [unit, _text(parameter.neutral), span]


def _text(value: float | int | str) -> str:
    """Return a value as `--effect` takes it."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def _as_json(effect: Effect, prior: Prior) -> Any:
    """Return what the catalogue declares, without the function that applies it."""
    from gap_diagnosis.priors import stated

    believed = stated(prior, effect)
    content = {f.name: getattr(effect, f.name) for f in fields(effect) if f.name not in _NESTED}
    content["parameters"] = [
        {**asdict(parameter), "prior": asdict(believed[parameter.name])}
        if parameter.name in believed
        else {**asdict(parameter), "prior": None}
        for parameter in effect.parameters
    ]
    content["law"] = prior.laws.get(effect.name)
    content["twins"] = [asdict(twins) for twins in effect.twins]
    return _finite(content)


def _finite(value: Any) -> Any:
    """JSON has no infinity: a bound that is none is null."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
