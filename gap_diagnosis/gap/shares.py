"""Which stage's data carries the gap: shares that add up, over a log and along its manoeuvres.

The chain: start with everything simulated, replace one stage's input after the other by the
recorded one, in the order in which data flows. The errors that appear telescope to the whole error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.gap.manoeuvres import KINDS, Kinds, stretches_of
from gap_diagnosis.recording import Floats
from gap_diagnosis.result_parts import Segment, StageOrNone

_LEAST_SEGMENT_S: Final = 1.0


@dataclass(frozen=True)
class Chain:
    """Errors at window ends along the chain.

    Attributes:
        stages: in the order in which data flows.
        parts: float64[stages, w, c], the error that appears when this stage's input changes from
            simulated to recorded.
    """

    stages: tuple[StageOrNone, ...]
    parts: Floats

    @property
    def total(self) -> Floats:
        """The whole error, float64[w, c]."""
        return np.asarray(self.parts.sum(0))


def chain_of(ends: Mapping[StageOrNone, Floats]) -> Chain:
    """Return the chain from the window-end errors with all stages up to each one recorded.

    *ends* holds float64[w, c] by stage in the order in which data flows; before the first stage
    everything is simulated and the error is zero.
    """
    cumulated = np.array(list(ends.values()))
    return Chain(tuple(ends), np.diff(cumulated, axis=0, prepend=0.0))


def joined(chains: Sequence[Chain]) -> Chain:
    """Return the windows of several logs as one chain; a stage that one has not carries nothing."""
    if len(chains) == 1:
        return chains[0]
    kept = [one for one in chains if one.parts.shape[1]] or list(chains[:1])
    stages = tuple(dict.fromkeys(stage for one in kept for stage in one.stages))
    parts = []
    for one in kept:
        own = np.zeros((len(stages), *one.parts.shape[1:]))
        own[[stages.index(stage) for stage in one.stages]] = one.parts
        parts.append(own)
    return Chain(stages, np.concatenate(parts, axis=1))


def shares_of(chain: Chain, window: int | None = None) -> dict[StageOrNone, float]:
    """Return share_k = Σ⟨e_k, e⟩/Σ⟨e, e⟩ over all windows or in one; empty without any error.

    Shares add up to 1 and may be negative.
    """
    chosen = slice(None) if window is None else slice(window, window + 1)
    parts = chain.parts[:, chosen]
    total = parts.sum(0)
    energy = float((total * total).sum())
    if not energy > 0:
        return {}
    weights = (parts * total).sum((1, 2)) / energy
    return {stage: float(share) for stage, share in zip(chain.stages, weights, strict=True)}


def segment_spans(t_s: Floats, kinds: Kinds) -> tuple[tuple[float, float, str], ...]:
    """Return (start_s, stop_s, kind) of each manoeuvre of at least a second, rest left out."""
    return tuple(
        (float(t_s[run.first]), float(t_s[run.stop - 1]), KINDS[run.kind])
        for run in stretches_of(kinds)
        if run.kind and t_s[run.stop - 1] - t_s[run.first] >= _LEAST_SEGMENT_S
    )


def segments_of(
    spans: Sequence[tuple[float, float, str]], window: Sequence[int], chain: Chain
) -> tuple[Segment, ...]:
    """Return each span with the stage that carries most of the error that arises in it.

    *window* says which span each window of the chain speaks of.
    """
    found = []
    for place, index in enumerate(window):
        shares = shares_of(chain, place)
        if not shares:
            continue
        stage = max(shares, key=lambda name: shares[name])
        start_s, stop_s, kind = spans[index]
        row = {"start_s": start_s, "stop_s": stop_s, "kind": kind}
        found.append(Segment.model_validate({**row, "stage": stage, "share": shares[stage]}))
    return tuple(found)
