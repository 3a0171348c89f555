"""How large each effect is drawn: one table.

*tolerance*: up to here a deviation is no news (docs/design.md, section 5; where robot.toml states
one, the same). *low*, *high*: what real robots show (docs/reference/effects.md), log-uniform.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal, TypeAlias

from hil_harness.effects.model import Value
from hil_harness.effects.setup_mistakes import SIGN_SIGNALS, UNIT_SIGNALS


@dataclass(frozen=True)
class Size:
    """A magnitude: what makes the effect larger or smaller."""

    tolerance: float
    low: float
    high: float
    signed: bool = True


@dataclass(frozen=True)
class Even:
    """Anything between, as a phase."""

    low: float
    high: float


@dataclass(frozen=True)
class Pick:
    """One of several."""

    values: tuple[Value, ...]


@dataclass(frozen=True)
class Moment:
    """A time, as a share of the drive."""

    low: float = 0.2
    high: float = 0.6


@dataclass(frozen=True)
class Lasting:
    """The end of a window that starts at `start_s` [s]."""

    low_s: float
    high_s: float


@dataclass(frozen=True)
class Peak:
    """A limit, as a share of the largest value that the drive asks for."""

    of: Literal["wheel_rate", "wheel_acceleration", "turn_rate"]
    low: float
    high: float


@dataclass(frozen=True)
class Code:
    """A code near the gyro's zero."""

    spread: int


Drawn: TypeAlias = Size | Even | Pick | Moment | Lasting | Peak | Code

_SIDE: Final = Pick(("left", "right"))
_PHASE: Final = Even(-math.pi, math.pi)
_FRAME: Final = Pick(("sensors", "ENCODER", "IMU"))


def _up(tolerance: float, low: float, high: float) -> Size:
    return Size(tolerance, low, high, signed=False)


_PI: Final = math.pi / 180
UNIT_FACTORS: Final = (2.0, 0.5, 4.0, 0.25, 10.0, 0.1, _PI, 1 / _PI)
"""By which a signal in a wrong unit is off."""
_TABLE: Final[dict[str, dict[str, Drawn]]] = {
    # actuation
    "drive_gain": {"left": Size(0.01, 0.02, 0.1), "right": Size(0.01, 0.02, 0.1)},
    "drive_deadband": {"rate": _up(0.1, 0.3, 2.0)},
    "drive_saturation": {"limit": Peak("wheel_rate", 0.6, 0.9)},
    "drive_acceleration_limit": {"limit": Peak("wheel_acceleration", 0.2, 0.6)},
    "drive_lag": {"time_constant": _up(0.01, 0.02, 0.2)},
    "drive_delay": {"delay": _up(0.005, 0.01, 0.1)},
    "drive_cogging": {
        "side": _SIDE, "amplitude": _up(0.005, 0.02, 0.15), "order": Pick((1, 2, 6, 12)),
        "phase": _PHASE,
    },
    "backlash": {"side": _SIDE, "width": _up(0.002, 0.005, 0.05)},
    # wheel
    "radius_scale": {"scale": Size(0.002, 0.003, 0.016)},
    "radius_mismatch": {"mismatch": Size(0.0005, 0.001, 0.006)},
    "wheelbase_scale": {"scale": Size(0.003, 0.011, 0.022)},
    "turn_scrub": {"scrub": Size(0.004, 0.02, 0.5)},
    "payload": {
        "compression_left": _up(0.001, 0.002, 0.016),
        "compression_right": _up(0.001, 0.002, 0.016),
    },
    "tyre_drift": {"rate": Size(5e-6, 2e-5, 3e-4)},
    "wheel_eccentricity": {"side": _SIDE, "amplitude": _up(0.001, 0.003, 0.03), "phase": _PHASE},
    "wheel_toe": {"angle": Size(0.001, 0.003, 0.035)},
    "one_sided_slip": {
        "side": _SIDE, "ratio": Size(0.005, 0.02, 0.2), "start_s": Moment(0.1, 0.7),
        "stop_s": Lasting(5.0, 20.0),
    },
    "longitudinal_slip": {"compliance": _up(0.003, 0.005, 0.05)},
    "lateral_slip": {"compliance": _up(0.002, 0.01, 0.1)},
    "cross_slope_drift": {"ratio": _up(0.001, 0.003, 0.03), "direction": _PHASE},
    "grade_slip": {"ratio": _up(0.001, 0.003, 0.03), "direction": _PHASE},
    "caster_kick": {"angle": _up(0.001, 0.004, 0.035), "length": Even(0.05, 0.2)},
    "floor_bump": {
        "time": Moment(), "yaw": Size(0.003, 0.01, 0.05), "forward": Size(0.001, 0.002, 0.02),
    },
    # encoder
    "ticks_per_rev": {"scale": Size(0.002, 0.003, 0.02)},
    "encoder_eccentricity": {"side": _SIDE, "amplitude": _up(0.001, 0.003, 0.05), "phase": _PHASE},
    "missed_ticks": {
        "side": _SIDE, "probability": _up(0.0005, 0.002, 0.05), "threshold": Pick((0.0, 4.0)),
    },
    "extra_ticks": {"side": _SIDE, "rate": Size(0.2, 1.0, 50.0)},
    "quadrature_phase": {"side": _SIDE, "error": Size(0.05, 0.1, 0.5)},
    "encoder_wrap": {"bits": Pick((12, 13, 14))},
    "encoder_dead": {"side": _SIDE, "start_s": Moment()},
    # gyro
    "gyro_bias": {"bias": Size(0.00034907, 0.002, 0.1)},
    "gyro_bias_walk": {"density": _up(6e-6, 2e-5, 3e-4)},
    "gyro_noise": {"density": _up(4e-4, 6e-4, 3e-3)},
    "gyro_scale": {"scale": Size(0.003, 0.005, 0.03)},
    "gyro_nonlinearity": {
        "quadratic": Size(0.0005, 0.001, 0.02), "cubic": Size(0.0005, 0.001, 0.02),
    },
    "gyro_asymmetry": {"asymmetry": Size(0.001, 0.003, 0.03)},
    "gyro_g_sensitivity": {"x": Size(0.00005, 0.0002, 0.005), "y": Size(0.00005, 0.0002, 0.005)},
    "gyro_tilt": {"roll": Size(0.0775, 0.1, 0.25)},
    "gyro_temperature_bias": {"slope": Size(0.00002, 0.0001, 0.0028)},
    "gyro_temperature_scale": {"slope": Size(0.0001, 0.0003, 0.005)},
    "gyro_saturation": {"limit": Peak("turn_rate", 0.5, 0.9)},
    "gyro_lag": {"time_constant": _up(0.002, 0.015, 0.1)},
    "gyro_vibration": {"coefficient": Size(1e-6, 1e-5, 3e-4)},
    "gyro_frozen": {"start_s": Moment(), "stop_s": Lasting(0.5, 3.0)},
    "adc_offset": {"offset": Size(2.62, 10.0, 300.0)},
    "adc_gain": {"gain": Size(0.003, 0.005, 0.03)},
    "adc_inl": {"peak": Size(3.0, 20.0, 150.0)},
    "adc_missing_code": {"code": Code(3)},
    "adc_stuck_bit": {"bit": Pick((2, 3, 4, 5, 6, 7, 8)), "value": Pick((0, 1))},
    "supply_ratio": {"coefficient": Size(0.02, 0.1, 1.0)},
    # bus
    "frame_latency": {"frame": _FRAME, "delay": _up(0.002, 0.003, 0.03)},
    "frame_jitter": {"frame": _FRAME, "sigma": _up(0.0004, 0.0009, 0.005)},
    "frame_loss": {
        "frame": _FRAME, "probability": _up(1e-4, 1e-3, 0.03), "burst": Pick((1.0, 1.0, 4.0)),
    },
    "frame_duplication": {"frame": _FRAME, "probability": _up(3e-5, 1e-3, 0.02)},
    "frame_reordering": {"frame": _FRAME, "probability": _up(3e-5, 1e-3, 0.02)},
    "stale_producer": {
        "frame": Pick(("ENCODER", "IMU")), "cycles": Pick((3, 6, 12)),
        "probability": _up(3e-5, 5e-4, 0.005),
    },
    "clock_skew": {"skew": Size(1e-4, 3e-4, 0.013)},
    "reception_stamp": {
        "frame": _FRAME, "delay": Even(0.0, 0.001), "period": _up(0.0015, 0.003, 0.02),
    },
    "bus_gap": {"start_s": Moment(), "stop_s": Lasting(0.05, 0.6)},
    # firmware
    "firmware_truncation": {"rounding": Pick(("toward_zero",))},
    "firmware_resolution": {
        "variable": Pick(("position", "step", "heading", "turn_step")), "bits": Pick((10, 12, 14)),
    },
    "coarse_trig_table": {"entries": Pick((16, 32, 64)), "interpolated": Pick((0, 1))},
    "euler_integration": {"heading": Pick(("before", "after"))},
    "stale_heading": {"cycles": Pick((1, 2, 4))},
    "firmware_constant": {
        "constant": Pick(
            ("wheel_radius", "wheelbase", "ticks_per_rev", "gyro_sensitivity", "tick_period")
        ),
        "scale": Size(1e-4, 0.001, 0.1),
    },
    "firmware_overflow": {
        "variable": Pick(("position",)), "bits": Pick((33, 34)), "mode": Pick(("wrap", "saturate")),
    },
    "moving_calibration": {"start_s": Moment(), "stop_s": Lasting(1.0, 4.0)},
    "auto_zero": {"threshold": _up(0.002, 0.0035, 0.03)},
    "fixed_tick_period": {"scale": Size(1e-4, 0.001, 0.03)},
    "blend_weight": {"weight": Size(0.01, 0.05, 0.3)},
    "missed_deadline": {"probability": _up(1e-4, 5e-4, 0.01)},
    # reference
    "reference_yaw": {"angle": Size(0.001, 0.002, 0.035)},
    "reference_lever_arm": {"x": Size(0.002, 0.005, 0.1), "y": Size(0.002, 0.005, 0.1)},
    "reference_time_offset": {"offset": Size(0.002, 0.005, 0.2)},
    "reference_scale": {"scale": Size(0.0005, 0.001, 0.005)},
    "reference_clock_skew": {"skew": Size(0.00005, 0.0001, 0.003)},
    "reference_noise": {
        "position": _up(0.002, 0.005, 0.02), "heading": _up(0.002, 0.005, 0.02),
    },
    "reference_dropout": {"start_s": Moment(), "stop_s": Lasting(1.0, 5.0)},
    "reference_jump": {
        "time": Moment(), "x": Size(0.005, 0.01, 0.2), "y": Size(0.005, 0.01, 0.2),
        "yaw": Size(0.002, 0.01, 0.2),
    },
    # setup
    "setup_wheels_swapped": {},
    "setup_sign": {"signal": Pick(SIGN_SIGNALS)},
    "setup_unit": {"signal": Pick(UNIT_SIGNALS), "factor": Pick(UNIT_FACTORS)},
}  # fmt: skip

SIZES: Final[Mapping[str, Mapping[str, Drawn]]] = MappingProxyType(_TABLE)
"""Every effect that is drawn, with its parameters."""


def tolerances(effect: str) -> dict[str, float]:
    """Return the tolerance of each magnitude of an effect."""
    return {
        name: drawn.tolerance for name, drawn in SIZES[effect].items() if isinstance(drawn, Size)
    }


UNLISTED: Final = frozenset(
    {
        "caster_kick",
        "drive_cogging",
        "floor_bump",
        "quadrature_phase",
        "reference_dropout",
        "reference_jump",
    }
)
"""Effects that the diagnosis knows no name for: the right answer is ``unknown``."""
