"""What effects change of the residuals in every detail: the columns of a search are smooth."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Final

import numpy as np

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.variant import Setting, Variant
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.nodes import Nodes, residuals
from gap_diagnosis.motion.whitening import CONTACT
from gap_diagnosis.recording import Floats

_FAR: Final = 0.1
"""Share by which wheels stand farther apart: a tenth of what counts round off matters little."""


class Details:
    """What effects change of one log's residuals."""

    def __init__(self, nodes: Nodes) -> None:
        """Prepare for the motion of a log."""
        self._nodes = nodes

    def change(
        self,
        terms: Sequence[Term],
        coefficients: Sequence[tuple[float, ...]],
        levels: Floats,
        *,
        is_sharp: bool = False,
    ) -> Floats | float:
        """Return what effects of these sizes change, at these levels of noise, float64[4, m];
        *is_sharp*: of what is sharp alone, however far from none they are."""
        if not terms:
            return 0.0
        contact = float(levels[CONTACT])
        settings = [
            (term.variant.in_noise(contact), sizes)
            for term, sizes in zip(terms, coefficients, strict=True)
        ]
        change = residuals(self._nodes, predict(self._nodes.sharp, settings)) - self._nominal
        far = [] if is_sharp else [one for one in settings if turns_less(*one)]
        return change + self.beyond_sharp(far, settings) if far else change

    def beyond_sharp(self, far: Sequence[Setting], settings: Sequence[Setting]) -> Floats:
        """Return what effects that are far from none, of these settings, change of what is not
        sharp, float64[4, m]: of two turns that differ by so much not even the rounding of counts is
        the same.

        Against the gyro it is less by as much as a turn is, by whatever effects: else wheels
        farther apart and a gyro that reads as much more would hide it, and were likelier.
        """
        counted = self._nodes.motion
        change = residuals(self._nodes, predict(counted, far))
        change -= residuals(self._nodes, predict(counted))
        change -= residuals(self._nodes, predict(self._nodes.sharp, far))
        change += self._nominal
        (_, (scale,)), *_ = far
        farther = 1.0 + scale
        read = self._read_share([one for one in settings if one not in far])
        change[3] *= (1.0 - read / farther) / (1.0 - 1.0 / farther)
        return np.asarray(change)

    def _read_share(self, settings: Sequence[Setting]) -> float:
        """Return what share of the described turns the gyro reads with effects."""
        smooth = self._nodes.smooth
        described, read = (predict(smooth, one).gyro_rad_s for one in ((), settings))
        away = described - described.mean()
        return float(away @ read) / max(float(away @ described), np.finfo(np.float64).tiny)

    @cached_property
    def _nominal(self) -> Floats:
        return residuals(self._nodes, predict(self._nodes.sharp))


def turns_less(variant: Variant, sizes: Sequence[float]) -> bool:
    """Tell whether an effect turns the robot by so much less that errors of counting do, too."""
    return variant.widens and abs(sizes[0]) > _FAR
