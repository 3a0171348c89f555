"""What a log says of some columns at any levels of noise: what searches for the best ones ask."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.motion.evidence import Gram, gram_of
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats
from gap_diagnosis.slopes import Weighed


@dataclass(frozen=True)
class Weighing:
    """Columns of a log beside free ones, as a function of the levels.

    Attributes:
        values: data and columns, float64[4, m, 1 + c], contiguous.
        nuisances: places of those that are within tolerance, and the tolerance of each.
        course, ticks: along which they are whitened.
        gain: what their products say beyond those [nat].
    """

    values: Floats
    nuisances: Sequence[tuple[int, float]]
    course: Course
    ticks: Floats
    gain: Callable[[Gram], float] = lambda _: 0.0

    def __call__(self, levels: Floats) -> Weighed:
        """Return what the log says at levels, float64[levels]."""
        white, log_variance, gram = self._seen(levels)
        products = gram.full_inner, gram.full_data
        return Weighed(gram.log_nothing + self.gain(gram), white, log_variance, products)

    def gram(self, levels: Floats) -> Gram:
        """Return the columns' products at levels, those within tolerance marginalised."""
        return self._seen(levels)[2]

    def _seen(self, levels: Floats) -> tuple[Floats, Floats, Gram]:
        white, log_variance = whiten(self.values, self.course, levels, self.ticks)
        return white, log_variance, gram_of(white, log_variance, self.nuisances, levels)
