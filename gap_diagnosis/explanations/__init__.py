"""How each effect acts on a prediction: one short function each, one module per stage."""

from gap_diagnosis.explanations.registry import (
    EXPLAINED,
    Explanation,
    predict,
    twin_sets,
    twins_of,
)

__all__ = ["EXPLAINED", "Explanation", "predict", "twin_sets", "twins_of"]
