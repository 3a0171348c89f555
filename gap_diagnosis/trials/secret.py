"""Secret seeds of cases: 128 bits, in streams that no diagnosis can address.

All that is random in a case follows from its secret by SHA-256 under names of this package. The
seeds handed to the plant are 128 bits as well; `synthetic_recordings`, which is all that the
diagnosis simulates with, takes the first 2^64 alone.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.synthetic import FIRST_SEALED_SEED

SECRET_BYTES: Final = 16
_NAMESPACE: Final = b"blind trial 1: "


@dataclass(frozen=True)
class Secret:
    """What a case's draws and noise follow from.

    Attributes:
        word: 16 secret bytes.
    """

    word: bytes

    def seed(self, purpose: str) -> int:
        """Return a seed for the plant: a whole number from 2^64 to 2^128 − 1."""
        drawn = int.from_bytes(self._digest(purpose)[:SECRET_BYTES], "big")
        return max(drawn, FIRST_SEALED_SEED)  # one in 2^64 would be anyone's

    def generator(self, purpose: str) -> np.random.Generator:
        """Return a generator of its own for each purpose, keyed with 128 bits."""
        key = np.frombuffer(self._digest(purpose)[:SECRET_BYTES], dtype=np.uint64)
        return np.random.Generator(np.random.Philox(key=key))

    def child(self, purpose: str) -> Secret:
        """Return the secret of a part, from which this one cannot be told."""
        return Secret(self._digest(purpose)[:SECRET_BYTES])

    def _digest(self, purpose: str) -> bytes:
        return hmac.new(self.word, _NAMESPACE + purpose.encode(), hashlib.sha256).digest()


def fresh_secret() -> Secret:
    """Return a secret that nobody knows."""
    return Secret(secrets.token_bytes(SECRET_BYTES))
