"""Sweeps: which configuration holds what is asked, and which of those is cheapest."""

from precision_study.study.answer import (
    Outcome,
    cheapest,
    high_words,
    holds,
    outcomes,
    pareto_front,
)
from precision_study.study.cost import Cost, CostTable, cost_table
from precision_study.study.engine import Study, cores, run_study
from precision_study.study.reach import require_drives_fit
from precision_study.study.requirement import (
    Course,
    Requirement,
    parse_course,
    parse_requirement,
)
from precision_study.study.space import (
    DEFAULT_AXES,
    Point,
    build_points,
    parse_axis,
    refuse_unfit,
)
from precision_study.study.store import Store

__all__ = [
    "DEFAULT_AXES",
    "Cost",
    "CostTable",
    "Course",
    "Outcome",
    "Point",
    "Requirement",
    "Store",
    "Study",
    "build_points",
    "cheapest",
    "cores",
    "cost_table",
    "high_words",
    "holds",
    "outcomes",
    "pareto_front",
    "parse_axis",
    "parse_course",
    "parse_requirement",
    "refuse_unfit",
    "require_drives_fit",
    "run_study",
]
