"""The error budget: what firmware − float is made of, guaranteed and expected."""

from precision_study.budget.bound import guaranteed_bound
from precision_study.budget.causes import CAUSES, Share
from precision_study.budget.expected import Expectation, Expected, expected_error
from precision_study.budget.path import Path, Tracer, trace
from precision_study.budget.travel import Asked, Travel

__all__ = [
    "CAUSES",
    "Asked",
    "Expectation",
    "Expected",
    "Path",
    "Share",
    "Tracer",
    "Travel",
    "expected_error",
    "guaranteed_bound",
    "trace",
]
