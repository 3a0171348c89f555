"""At which stage each effect of a diagnosis acts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gap_diagnosis.analysis import Analysis
from hil_harness.effects import catalogue
from hil_harness.effects.model import Effect


def stages_of(analyses: Sequence[Analysis], library: Mapping[str, Effect]) -> Mapping[str, str]:
    """Return the stage of every effect that some block can tell of."""
    known = {**catalogue(), **library}
    names = {effect for one in analyses for block in one.blocks for effect in block.effects}
    return {name: known[name].stage for name in sorted(names)}
