"""How each effect acts on a prediction: one short function each, one module per stage."""

from gap_diagnosis.explanations.registry import EXPLAINED, predict
from gap_diagnosis.explanations.twins import twin_sets, twins_of
from gap_diagnosis.explanations.variant import Explanation

__all__ = ["EXPLAINED", "Explanation", "predict", "twin_sets", "twins_of"]
