"""The error budget: what firmware − float is made of, guaranteed and expected."""

from precision_study.budget.bound import guaranteed_bound
from precision_study.budget.causes import CAUSES, Share
from precision_study.budget.expected import Expected, expected_error
from precision_study.budget.path import Path, trace
from precision_study.budget.travel import Travel

__all__ = [
    "CAUSES",
    "Expected",
    "Path",
    "Share",
    "Travel",
    "expected_error",
    "guaranteed_bound",
    "trace",
]
