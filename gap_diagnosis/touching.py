"""Which stage can touch which residual: the catalogue of effects, section 2.0, as data.

A residual holds one recorded signal against another, or against the simulation of its stage: what
acts before both, or on neither, leaves it alone. What shows in one residual and not in another is
therefore of a stage that touches only the first.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from gap_diagnosis.result_parts import STAGES, StageOrNone

WHEELS_AGAINST_COMMANDS: Final = "wheels − commands"
WHEELS_AGAINST_REFERENCE: Final = "reference − wheels"
WHEEL_HEADING_AGAINST_REFERENCE: Final = "reference heading − wheel heading"
WHEEL_HEADING_AGAINST_GYRO: Final = "gyro heading − wheel heading"
ODOMETRY_AGAINST_REPLAY: Final = "odometry − replay"
STAMPS_AGAINST_BEAT: Final = "stamps − beat"
FRAMES_MISSING: Final = "frames missing"

_WHEELS: Final[frozenset[StageOrNone]] = frozenset({"actuation", "wheel", "encoder", "bus"})
"""What counts go through: of actuation the play between motor, where it is counted, and wheel."""

TOUCHED_BY: Final[Mapping[str, frozenset[StageOrNone]]] = {
    WHEELS_AGAINST_COMMANDS: _WHEELS,
    WHEELS_AGAINST_REFERENCE: _WHEELS | {"reference"},
    WHEEL_HEADING_AGAINST_REFERENCE: _WHEELS | {"reference"},
    WHEEL_HEADING_AGAINST_GYRO: _WHEELS | {"gyro"},
    ODOMETRY_AGAINST_REPLAY: frozenset({"firmware", "bus"}),
    STAMPS_AGAINST_BEAT: frozenset({"bus"}),
    FRAMES_MISSING: frozenset({"bus"}),
}
"""Stages by residual. The bus is late or silent: a replay goes by the frames that the log has.
Those against reference and gyro are held against what effects do (tests); the others are as the
catalogue has them."""


def stages_that_touch(residual: str) -> tuple[StageOrNone, ...]:
    """Return the stages, in the order of the signal, that can touch a residual, given by its name:
    ``odometry − replay, along x`` is of ``odometry − replay``. None of one that the table has not.
    """
    touching = TOUCHED_BY.get(residual.partition(",")[0], frozenset())
    return tuple(stage for stage in STAGES if stage in touching)
