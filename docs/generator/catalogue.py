"""The pages of effects and laws, from where each is declared."""

from __future__ import annotations

from gap_diagnosis.priors import Stated, default_prior, stated
from generator.tables import number, table
from hil_harness.effects import Effect, EffectParameter, catalogue
from hil_harness.laws import LAWS


def effects() -> str:
    """Return the page of effects, from the catalogue."""
    parts = [
        "# Effects",
        "An effect is one cause by which a real robot differs from the simulated one. Switch it "
        "on with `--effect NAME.PARAM=VALUE`, in a file for `--effects` (`[gyro_bias]`, `bias = "
        "0.005`), in a scenario file or in a test's marker. Every parameter says how the *real* "
        "robot differs from `robot.toml`: ratios are real / described − 1, differences are real − "
        "described. At its neutral value an effect changes nothing, bit for bit. Effects combine "
        "freely.",
        "*Typical* is the size seen in real robots, without sign, and *twins* leave the same "
        "data, so that no log can tell them apart. For `chiplog diagnose`, a size up to the "
        "*tolerance* is no news (where `robot.toml` states one, its own is used), and the *prior* "
        "is even over orders of magnitude between the two sizes, without sign; parameters without "
        "one have a law of their own, which is told in words, or are not looked for. All of it "
        "stands in `gap_diagnosis/data/prior.toml`.",
    ]
    by_stage: dict[str, list[Effect]] = {}
    for effect in catalogue().values():
        by_stage.setdefault(effect.stage, []).append(effect)
    for stage, members in by_stage.items():
        parts.append(f"## Stage {stage}")
        for effect in members:
            parts += [f"### {effect.name}", effect.signature]
            believed = stated(default_prior(), effect)
            rows = [
                [*_parameter_row(parameter), *_belief(believed.get(parameter.name))]
                for parameter in effect.parameters
            ]
            header = ["parameter", "unit", "meaning", "neutral", "typical", "tolerance", "prior"]
            parts.append(table(header, rows))
            if effect.name in default_prior().laws:
                parts.append(f"Prior: {default_prior().laws[effect.name]}.")
            for twins in effect.twins:
                names = ", ".join(f"`{name}`" for name in twins.effects)
                condition = f", if {twins.condition}" if twins.condition else ""
                parts.append(f"Twins: {names}{condition}.")
    return "\n\n".join(part.strip() for part in parts)


def _parameter_row(parameter: EffectParameter) -> list[str]:
    neutral = parameter.neutral
    typical = ""
    if parameter.choices:
        typical = ", ".join(f"`{choice}`" for choice in parameter.choices)
    elif parameter.typical is not None:
        low, high = number(parameter.typical.low), number(parameter.typical.high)
        typical = f"{low} to {high} ({parameter.typical.source})"
    return [
        f"`{parameter.name}`",
        parameter.unit,
        parameter.meaning,
        number(neutral) if isinstance(neutral, float | int) else f"`{neutral}`",
        typical,
    ]


def _belief(one: Stated | None) -> list[str]:
    if one is None:
        return ["", ""]
    share = f" of {one.of}" if one.of else ""
    span = "" if one.span is None else f"{number(one.span[0])} to {number(one.span[1])}{share}"
    seldom = "" if one.most is None else f", seldom to {number(one.most)}"
    return ["" if one.tolerance is None else number(one.tolerance), span + seldom]


def laws() -> str:
    """Return the page of the laws and their checks."""
    parts = [
        "# The laws that `chiplog laws` checks",
        "Each law with its formula, where it holds, and its source; the [explanation]"
        "(../explanation/laws.md) tells the story. `chiplog laws NAME` checks one.",
        table(
            ["law", "formula", "holds", "source"],
            [[f"`{law.name}`: {law.title}", law.formula, law.validity, law.source] for law in LAWS],
        ),
    ]
    return "\n\n".join(parts)
