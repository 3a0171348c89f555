"""Traces which show whether or not their cause has a name.

Counters that jump, stamps that spread or lie on a lattice, codes that never come, more noise than
described: that something does not do as described is seen without knowing what does it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from gap_diagnosis.hypothesis import Block, Fit

_STAGE: Final = {"bus": "bus", "codes": "gyro"}
_NOISY: Final = {"gyro_noise": "gyro", "gyro_bias_walk": "gyro", "reference_noise": "reference"}
_PRICE: Final = 6.0
"""An unlisted cause leaves some trace, not this one: a named one that leaves it is believed unless
it is so many nats worse than what the trace itself says."""


def traces(blocks: Sequence[Block]) -> dict[str, Fit]:
    """Return, by stage, the clearest trace in whole blocks, its evidence less the price."""
    found: dict[str, Fit] = {}
    for block in blocks:
        for effect in sorted(block.effects):
            stage = _STAGE.get(block.name) or (block.name == "motion" and _NOISY.get(effect))
            if not stage:
                continue
            fit = block.fit(frozenset({effect}))
            evidence = fit.log_evidence - _PRICE
            if stage not in found or evidence > found[stage].log_evidence:
                found[stage] = Fit((), evidence, fit.log_likelihood, windows=fit.windows)
    return found
