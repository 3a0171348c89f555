"""The range of every intermediate of the kernel, proved from the robot's envelope."""

from precision_study.ranges.bounds import intermediates
from precision_study.ranges.envelope import Envelope, envelope_of, trembling, way
from precision_study.ranges.intermediate import Intermediate
from precision_study.ranges.verdicts import Finding, find_ranges, to_json

__all__ = [
    "Envelope",
    "Finding",
    "Intermediate",
    "envelope_of",
    "find_ranges",
    "intermediates",
    "to_json",
    "trembling",
    "way",
]
