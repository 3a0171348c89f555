"""What each bit buys: proved ranges, error budgets, sweeps."""

from precision_study.errors import StudyError

__all__ = ["StudyError"]
