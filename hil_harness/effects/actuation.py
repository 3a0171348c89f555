"""Stage actuation: from the commanded wheel rate to the wheel rate. Odometry sees what happened."""

from typing import Final

from hil_harness.effects.model import Effect
from hil_harness.effects.plant_effect import moves, plant_effect

EFFECTS: Final[tuple[Effect, ...]] = (
    plant_effect(
        "drive_gain",
        "actuation",
        "Wheel speed and command differ by a constant ratio; the path differs, the odometry of "
        "that path does not.",
        moves("left", "drive_gain_left"),
        moves("right", "drive_gain_right"),
    ),
    plant_effect(
        "drive_deadband",
        "actuation",
        "No motion below a commanded wheel speed and full motion above it.",
        moves("rate", "drive_deadband_rad_s"),
    ),
    plant_effect(
        "drive_saturation",
        "actuation",
        "Wheel speed has a flat top that the command exceeds.",
        moves("limit", "drive_saturation_rad_s"),
    ),
    plant_effect(
        "drive_acceleration_limit",
        "actuation",
        "Wheel speed follows a steep command along a straight slope.",
        moves("limit", "drive_acceleration_limit_rad_s2"),
    ),
    plant_effect(
        "drive_lag",
        "actuation",
        "Wheel speed rounds the corners of a command: the difference is in proportion to the "
        "acceleration and gone at constant speed.",
        moves("time_constant", "drive_lag_s"),
    ),
    plant_effect(
        "drive_delay",
        "actuation",
        "Wheel speed follows the command late, corners unchanged.",
        moves("delay", "drive_delay_s"),
    ),
    plant_effect(
        "drive_cogging",
        "actuation",
        "Wheel speed waves with the wheel's angle; encoder, gyro and ground see it alike.",
        moves("amplitude", "drive_cogging_{side}"),
        moves("order", "drive_cogging_order"),
        moves("phase", "drive_cogging_phase_rad"),
    ),
    plant_effect(
        "backlash",
        "actuation",
        "After each reversal the encoder counts a constant angle that the wheel does not roll.",
        moves("width", "backlash_{side}_rad"),
    ),
)
