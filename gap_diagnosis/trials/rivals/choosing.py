"""From fits of the trajectory to answers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.result_parts import ParameterEstimate
from gap_diagnosis.trials.rivals.door import Effects, named
from gap_diagnosis.trials.rivals.trajectory import Fitted


def settings_of(fitted: Fitted) -> list[Setting]:
    """Return the effect with its values, as predictions take them."""
    return [] if fitted.setting is None else [fitted.setting]


def values_of(fitted: Fitted) -> dict[str, ParameterEstimate]:
    """Return the winner's parameters with the intervals of white residuals."""
    if fitted.setting is None:
        return {}
    variant, coefficients = fitted.setting
    if variant.polar is None:
        pairs = zip(coefficients, fitted.sds, strict=True)
        return named(variant.effect, dict(zip(variant.coefficients, pairs, strict=True)))
    best = variant.parameters(np.array(coefficients))
    size, angle = variant.polar
    sd = math.hypot(*fitted.sds) / math.sqrt(2.0)
    values = {
        size: (float(best[size]), sd),
        angle: (float(best[angle]), sd / max(float(best[size]), 1e-12)),
    }
    return named(variant.effect, values)


def pooled(
    ranked: Sequence[tuple[Effects, float]], found: Sequence[Fitted]
) -> list[tuple[Effects, float]]:
    """Return answers with what lies within tolerance counted as no gap, the best first."""
    news = {(one.effect,) for one in found if one.is_news}
    nothing = math.fsum(p for effects, p in ranked if effects not in news)
    answers = [((), nothing), *((effects, p) for effects, p in ranked if effects in news)]
    return sorted(answers, key=lambda one: -one[1])
