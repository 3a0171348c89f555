"""Stage actuation: the recorded commands, through the described drive, against the wheels."""

from gap_diagnosis.drive.block import DriveBlock, drive_block

__all__ = ["DriveBlock", "drive_block"]
