"""The range of every intermediate of the kernel, proved from the robot's envelope."""

from precision_study.ranges.bounds import Intermediate, intermediates
from precision_study.ranges.envelope import Envelope
from precision_study.ranges.verdicts import Finding, find_ranges, to_json

__all__ = ["Envelope", "Finding", "Intermediate", "find_ranges", "intermediates", "to_json"]
