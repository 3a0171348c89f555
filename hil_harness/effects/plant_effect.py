"""Effects whose mechanism is a parameter of the simulated plant: declared in one call each.

Unit, sign, neutral value and admitted range of such a parameter stand in ``sim_plant.Mechanisms``
and are read from there.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, Final

from hil_harness.effects.model import (
    Effect,
    EffectParameter,
    Settings,
    Stage,
    Twins,
    Typical,
    Value,
    Values,
)
from sim_plant import Mechanisms

SIDES: Final = ("left", "right")

_MECHANISMS: Final = {item.name: item for item in fields(Mechanisms)}
_NEUTRAL: Final[dict[str, Any]] = vars(Mechanisms())

_SIDE: Final = EffectParameter(
    "side", "", "both", "which wheel", kind="choice", choices=(*SIDES, "both")
)


@dataclass(frozen=True)
class Moved:
    """A parameter and the plant mechanism it moves; ``{side}`` stands for the chosen side."""

    parameter: EffectParameter
    mechanism: str


def moves(
    name: str, mechanism: str, typical: Typical | None = None, *, meaning: str | None = None
) -> Moved:
    """Return parameter *name* of an effect, moving the field *mechanism* of Mechanisms.

    What it means is what the field's own description says, unless *meaning* is given.
    """
    item = _MECHANISMS[mechanism.format(side=SIDES[0])]
    if meaning is None:
        meaning = str(item.metadata["meaning"])
        if "{side}" in mechanism:
            meaning = meaning.removeprefix("left ")
    neutral: Value = _NEUTRAL[item.name]
    parameter = EffectParameter(
        name=name,
        unit=item.metadata["unit"],
        neutral=neutral,
        meaning=meaning,
        kind="whole" if isinstance(neutral, int) else "real",
        minimum=item.metadata["low"],
        maximum=item.metadata["high"],
        typical=typical,
    )
    return Moved(parameter, mechanism)


def plant_effect(
    name: str,
    stage: Stage,
    signature: str,
    *moved: Moved,
    twins: tuple[Twins, ...] = (),
    is_noise: bool = False,
) -> Effect:
    """Return an effect that moves plant mechanisms, with a ``side`` where one of them has sides."""
    sided = any("{side}" in one.mechanism for one in moved)
    own = tuple(one.parameter for one in moved)
    return Effect(
        name=name,
        stage=stage,
        parameters=(_SIDE, *own) if sided else own,
        signature=signature,
        apply=_apply(moved),
        twins=twins,
        is_noise=is_noise,
    )


def _apply(moved: tuple[Moved, ...]) -> Callable[[Settings, Values], Settings]:
    def apply(settings: Settings, values: Values) -> Settings:
        side = values.get("side", "both")
        changes = {
            one.mechanism.format(side=each): values[one.parameter.name]
            for one in moved
            for each in (SIDES if side == "both" else (side,))
        }
        return settings.with_plant(**changes)

    return apply
