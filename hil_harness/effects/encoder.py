"""Stage encoder: from the wheel's rotation to counts. The ground does not see it."""

from typing import Final

from hil_harness.effects.model import Effect, Twins, Typical
from hil_harness.effects.plant_effect import moves, plant_effect
from hil_harness.effects.sources import COURSE_NOTES

EFFECTS: Final[tuple[Effect, ...]] = (
    plant_effect(
        "ticks_per_rev",
        "encoder",
        "Distance and encoder heading read high by one ratio, as with a smaller wheel.",
        moves("scale", "ticks_scale"),
        twins=(Twins(("radius_scale",)),),
    ),
    plant_effect(
        "encoder_eccentricity",
        "encoder",
        "Measured speed wobbles once per wheel turn while neither gyro nor ground does; the "
        "position error stays bounded.",
        moves("amplitude", "encoder_eccentricity_{side}_rad", Typical(0.003, 0.052, COURSE_NOTES)),
        moves("phase", "encoder_eccentricity_phase_{side}_rad", meaning="its phase"),
        twins=(Twins(("wheel_eccentricity",), "there is no gyro and no reference"),),
    ),
    plant_effect(
        "missed_ticks",
        "encoder",
        "Distance is under-read in proportion to the path above some speed, usually on one side.",
        moves("probability", "missed_ticks_{side}"),
        moves("threshold", "missed_ticks_threshold_rad_s"),
    ),
    plant_effect(
        "extra_ticks",
        "encoder",
        "Counts come in at a constant rate, at rest too.",
        moves("rate", "extra_ticks_{side}_per_s"),
    ),
    plant_effect(
        "quadrature_phase",
        "encoder",
        "Every other tick is long and the ones between are short; bounded, and the same in both "
        "directions of travel.",
        moves("error", "quadrature_{side}_rad"),
    ),
    plant_effect(
        "encoder_wrap",
        "encoder",
        "The count jumps back by a power of two at a value below the described counter's end.",
        moves("bits", "encoder_wrap_bits"),
    ),
    plant_effect(
        "encoder_dead",
        "encoder",
        "A count stops for good while the robot goes on.",
        moves("start_s", "encoder_dead_{side}_s", meaning="the count is frozen from here on"),
    ),
)
