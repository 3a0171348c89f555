"""Stage reference: errors of the measuring system itself. The robot's own signals do not see it."""

from __future__ import annotations

from typing import Final

from hil_harness.effects.model import Effect, EffectParameter, Settings, Twins, Typical, Values
from hil_harness.effects.sources import VICON

_INF: Final = float("inf")


def _signed(
    name: str, unit: str, meaning: str, limit: float, typical: Typical | None = None
) -> EffectParameter:
    return EffectParameter(name, unit, 0.0, meaning, minimum=-limit, maximum=limit, typical=typical)


def _level(
    name: str, unit: str, meaning: str, limit: float, typical: Typical | None = None
) -> EffectParameter:
    return EffectParameter(name, unit, 0.0, meaning, minimum=0.0, maximum=limit, typical=typical)


def _yaw(settings: Settings, values: Values) -> Settings:
    return settings.with_reference(yaw_rad=values["angle"])


def _lever_arm(settings: Settings, values: Values) -> Settings:
    return settings.with_reference(lever_x_m=values["x"], lever_y_m=values["y"])


def _time_offset(settings: Settings, values: Values) -> Settings:
    return settings.with_reference(time_offset_s=values["offset"])


def _scale(settings: Settings, values: Values) -> Settings:
    return settings.with_reference(scale=values["scale"])


def _clock_skew(settings: Settings, values: Values) -> Settings:
    return settings.with_reference(clock_skew=values["skew"])


def _noise(settings: Settings, values: Values) -> Settings:
    return settings.with_reference(
        position_noise_m=values["position"],
        heading_noise_rad=values["heading"],
        correlation_time_s=values["correlation_time"],
    )


def _dropout(settings: Settings, values: Values) -> Settings:
    return settings.with_reference(
        dropout_start_s=values["start_s"], dropout_stop_s=values["stop_s"]
    )


def _jump(settings: Settings, values: Values) -> Settings:
    return settings.with_reference(
        jump_s=values["time"],
        jump_x_m=values["x"],
        jump_y_m=values["y"],
        jump_yaw_rad=values["yaw"],
    )


EFFECTS: Final[tuple[Effect, ...]] = (
    Effect(
        "reference_yaw",
        "reference",
        (
            _signed(
                "angle",
                "rad",
                "its heading reads high by this, against the body's x axis",
                3.2,
                Typical(0.0017, 0.035, "engineering estimate, 0.1 to 2 °"),
            ),
        ),
        "The reference moves at a constant angle to where it says the robot points.",
        _yaw,
        twins=(Twins(("wheel_toe",), "the lever arm is unknown (opposite sign)"),),
    ),
    Effect(
        "reference_lever_arm",
        "reference",
        (
            _signed("x", "m", "the tracked point lies so far ahead of the axle's middle", 10.0),
            _signed("y", "m", "the tracked point lies so far to its left", 10.0),
        ),
        "In a spin the reference runs round a circle of the lever arm's length.",
        _lever_arm,
    ),
    Effect(
        "reference_time_offset",
        "reference",
        (
            _signed(
                "offset",
                "s",
                "reference stamp − true time; + is stamped late",
                10.0,
                Typical(0.001, 0.2, "engineering estimate"),
            ),
        ),
        "Position and heading lag by speed and turn rate times the offset; nothing at rest.",
        _time_offset,
        twins=(Twins(("frame_latency",), "on all sensor frames (opposite sign)"),),
    ),
    Effect(
        "reference_scale",
        "reference",
        (
            _signed(
                "scale",
                "1",
                "reported over true distance − 1 (headings untouched)",
                0.9,
                Typical(0.0001, 0.005, "engineering estimate"),
            ),
        ),
        "Distances are off by one ratio, headings are not.",
        _scale,
        twins=(Twins(("radius_scale", "wheelbase_scale"), "both have the same scale"),),
    ),
    Effect(
        "reference_clock_skew",
        "reference",
        (
            _signed(
                "skew",
                "1",
                "reference clock rate over log clock rate − 1",
                0.05,
                Typical(1e-6, 1e-4, "quartz oscillators"),
            ),
        ),
        "The lag against the robot's signals grows with time.",
        _clock_skew,
    ),
    Effect(
        "reference_noise",
        "reference",
        (
            _level(
                "position",
                "m",
                "standard deviation of x and of y",
                10.0,
                Typical(0.00015, 0.02, f"{VICON}; RTK"),
            ),
            _level("heading", "rad", "standard deviation of the heading", 3.2),
            _level("correlation_time", "s", "of the noise; 0: white", 1e6),
        ),
        "Scatter of the reference that no sensor of the robot sees.",
        _noise,
        is_noise=True,
    ),
    Effect(
        "reference_dropout",
        "reference",
        (
            EffectParameter("start_s", "s", _INF, "no samples from here"),
            EffectParameter("stop_s", "s", _INF, "until here"),
        ),
        "A hole in the reference.",
        _dropout,
    ),
    Effect(
        "reference_jump",
        "reference",
        (
            EffectParameter("time", "s", _INF, "when the pose steps"),
            _signed("x", "m", "step of x", 1e3),
            _signed("y", "m", "step of y", 1e3),
            _signed("yaw", "rad", "step of the heading", 10.0),
        ),
        "One step of the reference that stays: another body taken for the robot, a relocalisation.",
        _jump,
    ),
)
