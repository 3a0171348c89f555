"""Which effects leave the same data as others in every log."""

from __future__ import annotations

from typing import Final

from hil_harness.effects import catalogue


def twin_sets(effects: frozenset[str]) -> list[frozenset[str]]:
    """Return the sets of effects that leave the same data as this one in every log."""
    found = [
        (effects - {effect}) | {twin}
        for effect in sorted(effects)
        for twin in twins_of(effect)
        if twin not in effects
    ]
    found += [
        (effects - given) | other
        for given, other in _TWIN_PAIRS
        if given <= effects and not other & (effects - given)
    ]
    return found


_TWIN_PAIRS: Final = (
    (frozenset({"payload"}), frozenset({"radius_mismatch", "radius_scale"})),
    (frozenset({"radius_mismatch", "radius_scale"}), frozenset({"payload"})),
    (frozenset({"reference_scale"}), frozenset({"radius_scale", "wheelbase_scale"})),
    (frozenset({"radius_scale", "wheelbase_scale"}), frozenset({"reference_scale"})),
)


_ALWAYS: Final = frozenset({"", "scale < 0", "the lever arm is unknown (opposite sign)"})
"""Conditions under which the catalogue's twins leave the same data for one sign, or usually."""


def twins_of(effect: str) -> tuple[str, ...]:
    """Return single effects that leave the same data as this one: the catalogue's twins."""
    known = catalogue()
    mine = known[effect].twins if effect in known else ()
    named = [one.effects[0] for one in mine if len(one.effects) == 1 and one.condition in _ALWAYS]
    named += [
        other.name
        for other in known.values()
        for one in other.twins
        if one.effects == (effect,) and one.condition in _ALWAYS and other.name not in named
    ]
    return tuple(named)
