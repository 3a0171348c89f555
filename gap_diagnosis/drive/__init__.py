"""Stage actuation: the recorded commands, through the described drive, against the wheels."""

from gap_diagnosis.drive.block import DriveBlock
from gap_diagnosis.drive.undescribed import drive_block

__all__ = ["DriveBlock", "drive_block"]
