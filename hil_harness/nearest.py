"""Names for people: the known name that a misspelt one probably meant."""

from collections.abc import Iterable
from difflib import get_close_matches


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the name in *known* most like *word*, or None when none is near.

    >>> nearest("tick_per_rev", ["radius_m", "ticks_per_rev"])
    'ticks_per_rev'
    """
    names = list(known)
    by_lower = {name.lower(): name for name in names}
    matches = get_close_matches(word.lower(), by_lower, n=1, cutoff=0.5)
    return by_lower[matches[0]] if matches else None


def did_you_mean(word: str, known: Iterable[str], *, limit: int = 12) -> str:
    """Return a clause that helps: the nearest known name, or else the first *limit* names.

    >>> did_you_mean("gyro_bais", ["gyro_bias", "radius_scale"])
    'the nearest is gyro_bias'
    >>> did_you_mean("xyz", ["b", "a"])
    'known are a, b'
    """
    names = sorted(known)
    if not names:
        return "none are known"
    guess = nearest(word, names)
    if guess is not None:
        return f"the nearest is {guess}"
    more = f" and {len(names) - limit} more" if len(names) > limit else ""
    return f"known are {', '.join(names[:limit])}{more}"
