"""Residual r6: recorded odometry against bit-exact replay. It isolates the firmware alone."""

from gap_diagnosis.firmware.block import FirmwareBlock, firmware_block
from gap_diagnosis.firmware.inputs import lacks_the_gyro
from gap_diagnosis.firmware.leftover import Leftover
from gap_diagnosis.firmware.replay import replayed_pose

__all__ = ["FirmwareBlock", "Leftover", "firmware_block", "lacks_the_gyro", "replayed_pose"]
