"""Traces in frames and codes, which show whether or not their cause has a name.

Counters that jump, stamps that spread or lie on a lattice, codes that never come: that the bus or
the converter does not do as described is seen without knowing what does it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from gap_diagnosis.hypothesis import Block, Fit

_STAGE: Final = {"bus": "bus", "codes": "gyro"}
_PRICE: Final = 6.0
"""An unlisted cause leaves some trace, not this one: a named one that leaves it is believed unless
it is so many nats worse than what the trace itself says."""


def traces(blocks: Sequence[Block]) -> dict[str, Fit]:
    """Return, by stage, the clearest trace in each whole block, its evidence less the price."""
    found: dict[str, Fit] = {}
    for block in blocks:
        if block.name in _STAGE and block.effects:
            fits = [block.fit(frozenset({effect})) for effect in sorted(block.effects)]
            best = max(fits, key=lambda one: one.log_evidence)
            evidence, likelihood = best.log_evidence - _PRICE, best.log_likelihood
            found[_STAGE[block.name]] = Fit((), evidence, likelihood, windows=best.windows)
    return found
