"""In which window each wheel may have slipped, however short, before anything is fitted.

A window a tenth as long as the grid's weighs a tenth in each of them, and levels of noise that have
risen with a slip hide it in all. At the described levels it stands out.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import takewhile
from typing import Final

from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.edges import Edged
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.windows import at_window, windows_of
from gap_diagnosis.recording import Floats

SLIP: Final = "one_sided_slip"
_WORTH: Final = 20.0
"""A window that gains less [nat] is not worth a column."""
_STEPS: Final = 2


def windows_beside(
    model: MotionModel, leading: Sequence[Term], slips: Sequence[Term], levels: Floats
) -> list[tuple[Edged, Term]]:
    """Return each wheel's slip in its best window at *levels*, with a term of the grid.

    Beside it stands what leads before any slip does. Empty where no window is worth it.
    """
    beside = tuple(takewhile(lambda term: term.variant.effect != SLIP, leading))
    by_side = {str(term.variant.report["side"]): term for term in reversed(slips)}
    if not by_side:
        return []
    start: Sequence[tuple[float, ...]] = ()
    if beside:
        start = model.refit(beside, levels, free_levels=False, steps=_STEPS).coefficients
    found = []
    for _, term in sorted(by_side.items()):
        windows = windows_of(model, [*beside, term], len(beside), [*start, (0.0,)], levels)
        if windows.log_evidence.max() > _WORTH:
            found.append((Edged(at_window(term, *windows.best_s), windows.spans_s), term))
    return found
