"""A case: what was drawn for it, all of which is sealed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any, Final, Literal, TypeAlias

from gap_diagnosis.trials.reference_noise import ReferenceLevels
from gap_diagnosis.trials.sizes import tolerances
from hil_harness.effects.model import EffectSetting, Value

Stratum: TypeAlias = Literal["prior", "limit", "field"]
Kind: TypeAlias = Literal["null", "single", "pair", "several", "withheld", "decoy"]
Effects: TypeAlias = Mapping[str, Mapping[str, Value]]

OWN_ENGINE: Final = "own"
OTHER_ENGINE: Final = "mujoco"
RECOMMENDED: Final = "recommended"
RANDOM: Final = "random"

STRATA: Final[tuple[Stratum, ...]] = ("prior", "limit", "field")


@dataclass(frozen=True)
class Case:
    """One case with its answer.

    Attributes:
        name: of its folder; says nothing.
        stratum, kind: from what it was drawn. *withheld*: its effect is taken out of the library;
            *decoy*: another one is, so that the task file gives nothing away.
        effects: by name, the parameters.
        over_limit: by effect, its magnitude over its detection limit; no entry where it has none.
        without: effects that the diagnosis must not try.
        nominal: errors of the description within tolerance, as effects.
        surroundings: warming up, sagging supply, micro-slip, as effects.
        drive, robot: which kind of each.
        noise: of the reference.
        steps: of the plant in a tick.
        secret: 32 hexadecimal digits.
        like: by effect that no library has, those that nobody could tell from it.
        engine: whose physics moved the robot.
        again, of: which manoeuvre was driven besides, after what was said of which case.
        measured: of another engine what it did, from its state, in the catalogue's terms.
    """

    name: str
    stratum: Stratum
    kind: Kind
    effects: Effects
    over_limit: Mapping[str, float]
    without: tuple[str, ...]
    nominal: Effects
    surroundings: Effects
    drive: str
    robot: str
    noise: ReferenceLevels
    steps: int
    secret: str
    like: Mapping[str, Sequence[str]] = field(default_factory=dict)
    engine: str = OWN_ENGINE
    again: str = ""
    of: str = ""
    measured: Mapping[str, float] = field(default_factory=dict)

    @property
    def true_effects(self) -> frozenset[str]:
        """The effects beyond their tolerance: what is inside counts as no gap."""
        return frozenset(name for name, values in self.effects.items() if is_news(name, values))

    @property
    def settings(self) -> tuple[EffectSetting, ...]:
        """All that makes this case's world differ from its description."""
        every = (*self.effects.items(), *self.nominal.items(), *self.surroundings.items())
        return tuple(EffectSetting(name, tuple(values.items())) for name, values in every)

    def as_json(self) -> dict[str, Any]:
        """Return the case for the sealed file."""
        return asdict(self)

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Case:
        """Return the case of a sealed file."""
        values = {one.name: content[one.name] for one in fields(cls) if one.name in content}
        values["noise"] = ReferenceLevels(**values["noise"])
        values["without"] = tuple(values["without"])
        return cls(**values)


def is_news(effect: str, values: Mapping[str, Value]) -> bool:
    """Tell whether an effect of this size is beyond its tolerance (or has no size)."""
    sizes = tolerances(effect)
    if not sizes:
        return True
    return any(abs(float(values.get(name, 0.0))) > limit for name, limit in sizes.items())
