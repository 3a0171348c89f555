"""Unlisted causes beside listed effects.

A drive that answers in its own way, a program of someone else's, frames that come as they like: on
real robots one of them is always there. They are news, but must not hide what the wheels and the
gyro show: a set of listed effects keeps their company at the price of any unlisted cause.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from gap_diagnosis.block_sums import Effects, total_of
from gap_diagnosis.hypothesis import Block

OWN_BLOCK: Final = {"actuation": "drive", "bus": "bus", "firmware": "firmware"}
"""In which block an unlisted cause of a stage shows; all others in the motion."""


class Company:
    """What unlisted causes in blocks of their own add beside listed effects."""

    def __init__(self, logs: Sequence[Sequence[Block]], guesses: Mapping[str, float]) -> None:
        """Take the log probability of each unlisted cause by itself."""
        self._guesses = {stage: one for stage, one in guesses.items() if stage in OWN_BLOCK}
        self._seen: dict[str, Effects] = {}
        self._elsewhere: dict[str, Effects] = {}
        self._logs = logs
        self._rest: dict[str, Sequence[Sequence[Block]]] = {}
        for stage in self._guesses:
            block = OWN_BLOCK[stage]
            own = [[one for one in blocks if one.name == block] for blocks in logs]
            rest = [[one for one in blocks if one.name != block] for blocks in logs]
            self._seen[stage] = _effects_of(own)
            self._elsewhere[stage] = _effects_of(rest)
            self._rest[stage] = rest

    def of(self, effects: Effects, but: str = "") -> float:
        """Return what they add to the evidence of a set, of all stages but one."""
        return math.fsum(
            float(np.logaddexp(0.0, self._in_its_place(stage, effects)))
            for stage in self._guesses
            if stage != but
        )

    def beside(self, effects: Effects) -> tuple[str, ...]:
        """Return the stages in which an unlisted cause is likelier than none beside a set."""
        return tuple(sorted(s for s in self._guesses if self._in_its_place(s, effects) > 0))

    def _in_its_place(self, stage: str, effects: Effects) -> float:
        """Return by how much the unlisted cause is likelier than what the set says of its block.

        Effects that this block alone tells are its listed causes: they are there instead.
        """
        own = effects & self._seen[stage]
        if not own <= self._elsewhere[stage]:
            return -math.inf
        guess = self._guesses[stage]
        if not own:
            return guess
        # In the set, not each by itself: a block may deny one effect alone that another makes room
        # for, and what the set says of this block then counts already.
        return guess - (total_of(self._logs, effects)[0] - total_of(self._rest[stage], effects)[0])


def _effects_of(logs: Sequence[Sequence[Block]]) -> Effects:
    return frozenset(effect for blocks in logs for block in blocks for effect in block.effects)
