"""What one row of the table of messages says, and what several subjects' rows share."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field

Content = str | bytes


@dataclass(frozen=True)
class Row:
    """One message: when it comes, files that provoke it, the command, the line on stderr.

    `or_line` is what machines say that have what this one lacks. `breaks_after_frames` makes the
    bus fail under way. `links` are symbolic links; a C file is compiled to a library beside it.
    """

    when: str
    command: str
    line: str
    files: Mapping[str, Content] = field(default_factory=dict)
    or_line: str = ""
    breaks_after_frames: int | None = None
    links: Mapping[str, str] = field(default_factory=dict)

    @property
    def words(self) -> list[str]:
        """The command's words after `chiplog`."""
        return shlex.split(self.command)[1:]

    @property
    def slug(self) -> str:
        """A name for the test."""
        return self.when.replace(" ", "-")


DBC = """VERSION ""
BU_: A B
BO_ 256 SPEED: 8 A
 SG_ v : 0|16@1+ (1,0) [0|65535] "rpm" B
"""
"""The smallest DBC."""

WHEELS = """[signals]
left_count = "ENCODER.left_count"
right_count = "ENCODER.right_count"
"""
"""The smallest map of the shipped DBC."""
