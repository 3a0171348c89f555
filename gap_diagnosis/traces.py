"""Traces which show whether or not their cause has a name.

Counters that jump, stamps that spread or lie on a lattice, codes that never come, more noise than
described: that something does not do as described is seen without knowing what does it.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, replace
from typing import Final

from gap_diagnosis.bus import BusBlock
from gap_diagnosis.hypothesis import Block, Fit

_STAGE: Final = {"bus": "bus", "codes": "gyro"}
_NOISY: Final = {"gyro_noise": "gyro", "gyro_bias_walk": "gyro", "reference_noise": "reference"}
_CLOCK: Final = "clock_skew"
_PRICE: Final = 6.0
"""An unlisted cause leaves some trace, not this one: a named one that leaves it is believed unless
it is so many nats worse than what the trace itself says."""


@dataclass(frozen=True)
class Trace(Fit):
    """What shows, as a fit without a name.

    Attributes:
        frame: in which frames; None where it is in none.
        goes_with_time: share of it that is in `windows` beyond what is elsewhere.
        is_of_clock: all frames drift together against the log's clock.
        is_apart: shown by other data than the motion, whose evidence it adds to, and left by
            nothing that has a name: a name would be believed first, however roughly it says what it
            does to the motion.
    """

    frame: str | None = None
    goes_with_time: float = 0.0
    is_apart: bool = False
    is_of_clock: bool = False

    def beside(self, moves: float) -> float:
        """Return the log evidence of a cause that leaves this trace, moves the robot or what says
        so by as much as *moves* tells, or does both."""
        if self.is_apart and min(moves, self.log_evidence) > 0.0:
            return moves + self.log_evidence
        return max(moves, self.log_evidence)


def traces(blocks: Sequence[Block], without: Set[str] = frozenset()) -> dict[str, Trace]:
    """Return, by stage, the clearest trace in whole blocks, its evidence less the price; effects
    *without* a name leave theirs all the same."""
    found: dict[str, Trace] = {}
    for block in blocks:
        for effect in sorted(block.effects):
            stage = _STAGE.get(block.name) or (block.name == "motion" and _NOISY.get(effect))
            if not stage:
                continue
            fit = block.fit(frozenset({effect}))
            evidence = fit.log_evidence - _PRICE
            if stage not in found or evidence > found[stage].log_evidence:
                made = Trace(
                    (),
                    evidence,
                    fit.log_likelihood,
                    windows=fit.windows,
                    is_apart=block.name != "motion" and effect in without,
                    is_of_clock=effect == _CLOCK,
                )
                found[stage] = _of_frames(made, block, effect)
    return found


def _of_frames(trace: Trace, block: Block, effect: str) -> Trace:
    """Return a trace with where in the frames and when it shows, if it is one of frames."""
    if not isinstance(block, BusBlock) or trace.log_evidence < 0:
        return trace
    frame, windows, share = block.shown(effect)
    return replace(trace, frame=frame, windows=windows, goes_with_time=share)
