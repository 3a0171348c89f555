"""The ECU: an integer-only dead-reckoning kernel and its float64 twin.

Counts and codes with a validity go in; pose, velocity and a status word come out. The package
knows no CAN and no plant.
"""

from firmware_model.batch import BatchRuns, pose_m_rad, run_batch, run_batch_c99
from firmware_model.build import build_config
from firmware_model.changes import FirmwareChanges
from firmware_model.config import KernelConfig
from firmware_model.constants import FirmwareConstants
from firmware_model.description import FirmwareDescription
from firmware_model.errors import FirmwareError
from firmware_model.kernel import FloatTwin, Kernel
from firmware_model.state import (
    FRESH,
    INVALID,
    STALE,
    STATE_FIELDS,
    EncoderDecision,
    HeadingSource,
    State,
    StatusBit,
)

__all__ = [
    "FRESH",
    "INVALID",
    "STALE",
    "STATE_FIELDS",
    "BatchRuns",
    "EncoderDecision",
    "FirmwareChanges",
    "FirmwareConstants",
    "FirmwareDescription",
    "FirmwareError",
    "FloatTwin",
    "HeadingSource",
    "Kernel",
    "KernelConfig",
    "State",
    "StatusBit",
    "build_config",
    "pose_m_rad",
    "run_batch",
    "run_batch_c99",
]
