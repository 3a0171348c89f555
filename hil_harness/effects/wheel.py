"""Stage wheel: geometry and contact, from the wheel's rotation to the motion over the ground."""

from typing import Final

from hil_harness.effects.model import Effect, Twins, Typical
from hil_harness.effects.plant_effect import moves, plant_effect
from hil_harness.effects.sources import BORENSTEIN_FENG, CENSI, CLEARPATH, DESIGN, HUSKY

_GEOMETRY: Final[tuple[Effect, ...]] = (
    plant_effect(
        "radius_scale",
        "wheel",
        "Distance error in proportion to the path, and encoder heading error in proportion to the "
        "turn; both vanish at the end of a closed path.",
        moves(
            "scale",
            "radius_scale",
            Typical(0.003, 0.016, f"{BORENSTEIN_FENG} (tape measure); {CLEARPATH} (loaded)"),
        ),
        twins=(Twins(("ticks_per_rev",)),),
    ),
    plant_effect(
        "radius_mismatch",
        "wheel",
        "On a straight the true heading turns in proportion to the path, the same way in either "
        "sense round a square; nothing in a spin.",
        moves("mismatch", "radius_mismatch", Typical(0.0008, 0.006, f"{BORENSTEIN_FENG}; {CENSI}")),
    ),
    plant_effect(
        "wheelbase_scale",
        "wheel",
        "Encoder heading error in proportion to the turn, of opposite sign in opposite senses; "
        "nothing on a straight.",
        moves("scale", "wheelbase_scale", Typical(0.011, 0.022, f"{BORENSTEIN_FENG}; {CENSI}")),
        twins=(Twins(("gyro_scale",), "there is no reference (opposite sign)"),),
    ),
    plant_effect(
        "turn_scrub",
        "wheel",
        "Like a longer wheelbase that depends on the turn's radius: full in a spin, none on a "
        "straight.",
        moves("scrub", "turn_scrub", Typical(0.5, 0.9, f"{CLEARPATH}; skid steering")),
        twins=(Twins(("wheelbase_scale",), "there are spins and straights only"),),
    ),
    plant_effect(
        "payload",
        "wheel",
        "Smaller radii under load, on one side if the load is off centre: constant in a run, a "
        "step between runs.",
        moves("compression_left", "payload_left", Typical(0.001, 0.016, CLEARPATH)),
        moves("compression_right", "payload_right", Typical(0.001, 0.016, CLEARPATH)),
        twins=(Twins(("radius_scale", "radius_mismatch")),),
    ),
    plant_effect(
        "tyre_drift",
        "wheel",
        "A radius scale that grows with time.",
        moves("rate", "tyre_drift_per_s"),
    ),
    plant_effect(
        "wheel_eccentricity",
        "wheel",
        "True speed and heading wobble once per wheel turn about a mean of zero; the gyro sees it.",
        moves("amplitude", "wheel_eccentricity_{side}"),
        moves("phase", "wheel_eccentricity_phase_{side}_rad", meaning="its phase"),
        twins=(Twins(("encoder_eccentricity",), "there is no gyro and no reference"),),
    ),
    plant_effect(
        "wheel_toe",
        "wheel",
        "The robot slides sideways in proportion to its speed, at an angle fixed in the body.",
        moves("angle", "wheel_toe_rad"),
        twins=(Twins(("reference_yaw",), "the lever arm is unknown (opposite sign)"),),
    ),
)

_CONTACT: Final[tuple[Effect, ...]] = (
    plant_effect(
        "one_sided_slip",
        "wheel",
        "Within a window the wheel counts more than the ground sees: encoder and gyro heading part "
        "towards the side that slips.",
        moves("ratio", "slip_ratio_{side}", Typical(0.033, 0.046, HUSKY)),
        moves("start_s", "slip_start_s", meaning="the wheel slips from here"),
        moves("stop_s", "slip_stop_s", meaning="until here"),
    ),
    plant_effect(
        "longitudinal_slip",
        "wheel",
        "Encoders over-read while speeding up and under-read while braking.",
        moves("compliance", "longitudinal_slip_s2_per_m"),
    ),
    plant_effect(
        "lateral_slip",
        "wheel",
        "The robot slides outward in turns in proportion to speed times turn rate, or that by the "
        "speed once more; heading is untouched.",
        moves("compliance", "lateral_slip_s"),
        moves("speed", "lateral_slip_speed_m_s"),
    ),
    plant_effect(
        "cross_slope_drift",
        "wheel",
        "The robot slides towards one compass bearing while it moves.",
        moves("ratio", "cross_slope_ratio"),
        moves("direction", "cross_slope_direction_rad"),
    ),
    plant_effect(
        "grade_slip",
        "wheel",
        "Distance is over-read uphill and under-read downhill.",
        moves("ratio", "grade_slip_ratio"),
        moves("direction", "grade_slip_direction_rad"),
    ),
    plant_effect(
        "caster_kick",
        "wheel",
        "The robot yaws within the first centimetres after a reversal, in the sense of the last "
        "turn before it; the gyro sees it, the encoders do not.",
        moves("angle", "caster_kick_rad"),
        moves("length", "caster_kick_length_m"),
    ),
    plant_effect(
        "floor_bump",
        "wheel",
        "One step of the true pose that the encoders do not see; the gyro sees its yaw.",
        moves("time", "floor_bump_s"),
        moves("yaw", "floor_bump_yaw_rad"),
        moves("forward", "floor_bump_forward_m"),
    ),
    plant_effect(
        "contact_offset",
        "wheel",
        "The ground step of a turning wheel is longer by a constant length per tick, so the error "
        "grows with the number of ticks in motion and not with the distance.",
        moves("left", "contact_offset_left_m"),
        moves("right", "contact_offset_right_m"),
    ),
    plant_effect(
        "micro_slip",
        "wheel",
        "Distance and heading wander off as a random walk over the path, or over the ticks in "
        "motion where a step level is set, and each wheel slips by a share of its way that wanders "
        "within 2 s.",
        moves("left", "micro_slip_left_m_per_sqrt_m", Typical(0.0001, 0.003, DESIGN)),
        moves("right", "micro_slip_right_m_per_sqrt_m", Typical(0.0001, 0.003, DESIGN)),
        moves("step_left", "micro_slip_step_left_m"),
        moves("step_right", "micro_slip_step_right_m"),
        moves("wander_left", "slip_wander_left"),
        moves("wander_right", "slip_wander_right"),
        is_noise=True,
    ),
)

EFFECTS: Final = _GEOMETRY + _CONTACT
