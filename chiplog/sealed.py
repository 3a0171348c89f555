"""An effect drawn and sealed: committed to before a diagnosis, shown after it.

The seal is the SHA-256 of a line that holds the effect and a random word: it gives nothing away,
and cannot be made to fit another effect afterwards.
"""

from __future__ import annotations

import hashlib
import math
import random
import secrets
from dataclasses import dataclass
from typing import Final

from hil_harness.effects import EffectSetting

_SIGNED: Final = (-1.0, 1.0)
_POSITIVE: Final = (1.0,)
DRAWN: Final = (
    ("radius_scale", "scale", 0.006, 0.02, _SIGNED),
    ("radius_mismatch", "mismatch", 0.002, 0.01, _SIGNED),
    ("wheelbase_scale", "scale", 0.01, 0.04, _SIGNED),
    ("turn_scrub", "scrub", 0.03, 0.2, _POSITIVE),
    ("longitudinal_slip", "compliance", 0.01, 0.05, _POSITIVE),
    ("lateral_slip", "compliance", 0.01, 0.1, _POSITIVE),
    ("gyro_scale", "scale", 0.01, 0.04, _SIGNED),
    ("gyro_bias", "bias", 0.003, 0.02, _SIGNED),
)
"""What can be drawn: effect, parameter, smallest and largest size, signs.

Sizes lie beyond the shipped robot's tolerances and within what real robots show.
"""


@dataclass(frozen=True)
class Sealed:
    """A drawn effect and the random word that is sealed with it."""

    setting: EffectSetting
    word: str

    @property
    def line(self) -> str:
        """What is sealed, as it is shown when the seal is opened."""
        return f"{self.setting} {self.word}"

    @property
    def seal(self) -> str:
        """Its SHA-256, in hexadecimal."""
        return hashlib.sha256(self.line.encode()).hexdigest()


def draw(seed: int | None = None) -> Sealed:
    """Draw one effect, even over effects and over orders of magnitude.

    A `seed` draws the same again; without one nobody knows what comes.
    """
    source = random.Random(secrets.randbits(128) if seed is None else seed)
    effect, parameter, low, high, signs = source.choice(DRAWN)
    size = math.exp(source.uniform(math.log(low), math.log(high)))
    value = float(f"{source.choice(signs) * size:.4g}")
    return Sealed(EffectSetting(effect, ((parameter, value),)), f"{source.getrandbits(128):032x}")
