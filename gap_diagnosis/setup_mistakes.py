"""What is known of mistakes of the set-up before a log is seen."""

import math
from typing import Final

FACTORS: Final = (2, 3.6, 4, 10, 100, 256, 1000, math.pi / 180)
"""By which a signal may be read wrong, or by their inverse: units (of km/h and cm too), prefixes, a
byte, degrees."""

COUNT_FACTORS: Final = tuple(one for one in FACTORS if one != 3.6)
"""Those of counts, ways and places, which nobody states in km/h."""

TURN_FACTORS: Final = tuple(one for one in COUNT_FACTORS if one != 100)
"""Those of a rate of turn, which nobody states in cm either."""

LEAST_GAIN: Final = 30.0
"""A mistake of the set-up is gross: what gains less than this [nat] is not one."""


def counts_per_step(factor: float) -> float:
    """Return by how many counts a reading steps once a wrong factor is undone.

    What read a tenth was rounded to counts as well, and then goes by tens.
    """
    return max(1.0, 1.0 / abs(factor))
