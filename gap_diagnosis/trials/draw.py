"""The draw of a case: how large, which way, when."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from can_bus import CanBusError
from gap_diagnosis.motion.whitening import SLIP_WANDER
from gap_diagnosis.priors import default_prior
from gap_diagnosis.scoring import LevelPrior
from gap_diagnosis.trials.case import Stratum
from gap_diagnosis.trials.sizes import (
    SIZES,
    UNIT_FACTORS,
    Code,
    Drawn,
    Even,
    Lasting,
    Moment,
    Peak,
    Pick,
    Size,
)
from gap_diagnosis.trials.truth import class_of
from hil_harness.assembly import Wire, commands_on_the_wire
from hil_harness.effects import catalogue
from hil_harness.effects.model import Value
from hil_harness.robot import Robot
from hil_harness.scenarios.model import Scenario
from hil_harness.signal_roles import Role

Draw = np.random.Generator
Values = dict[str, Value]

_INTO_STEP_S: Final = 1e-6
"""Not at the step's very beginning: that is the end of the one before."""
_POLAR: Final = ("phase", "direction")


@dataclass(frozen=True)
class World:
    """What sizes depend on.

    Attributes:
        duration_s: of the drive.
        peaks: the largest wheel rate, wheel acceleration and turn rate that it asks for.
        zero_code: of the gyro.
        room: how many times larger each command may be and still be carried on the bus.
    """

    duration_s: float
    peaks: Mapping[str, float]
    zero_code: int
    room: Mapping[str, float]


_NOWHERE: Final = World(0.0, {}, 0, {})
"""For sides and angles, which depend on no drive."""


def world_of(scenario: Scenario, robot: Robot, wire: Wire) -> World:
    """Return what the draws must know of a drive."""
    period_us = wire.tick_period_us
    commands = commands_on_the_wire(scenario, scenario.tick_count(period_us), wire)
    wheels = robot.plant.wheels
    half = 0.5 * wheels.wheelbase_m
    rates = (commands[:, :1] + commands[:, 1:] * np.array([-half, half])) / wheels.radius_m
    every = max(1, round(0.1e6 / period_us))
    change = np.abs(rates[every:] - rates[:-every]) / (every * period_us * 1e-6)
    return World(
        duration_s=scenario.duration_s,
        peaks={
            "wheel_rate": float(np.abs(rates).max()),
            "wheel_acceleration": float(change.max()),
            "turn_rate": float(np.abs(commands[:, 1]).max()),
        },
        zero_code=robot.plant.gyro.zero_rate_code,
        room={
            name: _room(wire, role, float(np.abs(commands[:, column]).max()))
            for column, (name, role) in enumerate(_COMMANDS.items())
        },
    )


_COMMANDS: Final[Mapping[str, Role]] = {"command_speed": "v_command", "command_turn": "w_command"}


def _room(wire: Wire, role: Role, peak: float) -> float:
    """Return how many times *peak* a command's signal carries, of the factors that are drawn."""
    signal = wire.signal_map.get(role)
    if signal is None:
        return math.inf
    carried = 0.0
    for factor in sorted(UNIT_FACTORS):
        try:
            signal.to_raw(factor * peak)
            signal.to_raw(-factor * peak)
        except CanBusError:
            break
        carried = factor
    return carried


def draw_values(effect: str, stratum: Stratum, world: World, draw: Draw) -> Values:
    """Return the parameters of an effect; in stratum *limit* its sizes are at their tolerances."""
    values: Values = {}
    for name, drawn in SIZES[effect].items():
        if isinstance(drawn, Size):
            values[name] = _admitted(effect, name, drawn, stratum, draw)
        elif effect == "setup_unit" and name == "factor":
            room = world.room.get(str(values["signal"]), math.inf)
            fitting = [factor for factor in UNIT_FACTORS if factor <= room]
            values[name] = fitting[int(draw.integers(len(fitting)))]
        elif isinstance(drawn, Lasting):
            start_s = values["start_s"]
            values[name] = float(start_s) + float(draw.uniform(drawn.low_s, drawn.high_s))
        else:
            values[name] = _other(drawn, world, draw)
    return values


def scaled(effect: str, values: Values, factor: float) -> Values:
    """Return an effect *factor* times as large, within what its parameters admit."""
    found = dict(values)
    for name, drawn in SIZES[effect].items():
        if isinstance(drawn, Size):
            parameter = catalogue()[effect].parameter(name)
            size = float(values[name]) * factor
            found[name] = min(max(size, parameter.minimum), parameter.maximum)
    return found


def is_credible(effect: str, values: Values | Mapping[str, Value]) -> bool:
    """Tell whether sizes are such as occur: where a drive hardly shows an effect, a multiple of its
    detection limit is more than any robot has."""
    known = default_prior().parameters.get(effect)
    for name, drawn in SIZES[effect].items():
        if isinstance(drawn, Size):
            prior = None if known is None else known.get(name) or known.get("all")
            high = 2 * drawn.high if prior is None else max(prior.high, drawn.high)
            if abs(float(values[name])) > high:
                return False
    return True


def _admitted(effect: str, name: str, size: Size, stratum: Stratum, draw: Draw) -> float:
    """Draw a size until the effect admits it: a prior's tails go farther."""
    parameter = catalogue()[effect].parameter(name)
    while True:
        found = _size(effect, name, size, stratum, draw)
        found *= float(draw.choice([-1.0, 1.0])) if size.signed else 1.0
        if parameter.minimum <= found <= parameter.maximum:
            return found


def _size(effect: str, name: str, size: Size, stratum: Stratum, draw: Draw) -> float:
    if stratum == "limit":
        several = sum(isinstance(one, Size) for one in SIZES[effect].values()) > 1
        return size.tolerance * (math.exp(draw.uniform(-1.0, 0.0)) if several else 1.0)
    if stratum == "field":
        return _log_even(size.low, size.high, draw)
    known = default_prior().parameters.get(effect)
    if known is None:
        return _log_even(size.tolerance, size.high, draw)
    prior = known.get(name) or known.get("all") or next(iter(known.values()))
    scale = float(draw.choice(prior.scales()))
    polar = any(other in SIZES[effect] for other in _POLAR)
    return float(np.hypot(*draw.normal(0.0, scale, 2)) if polar else abs(draw.normal(0.0, scale)))


def _log_even(low: float, high: float, draw: Draw) -> float:
    return math.exp(draw.uniform(math.log(low), math.log(high)))


def as_stepped(effect: str, values: Values, step_s: float) -> Values:
    """Return an effect as a plant in steps has it: an encoder counts nothing of the step in which
    it dies, and what a fast wheel did not count tells of its death to less than that."""
    if effect != "encoder_dead":
        return values
    begun = math.floor(float(values["start_s"]) / step_s)
    return values | {"start_s": begun * step_s + _INTO_STEP_S}


def _other(drawn: Drawn, world: World, draw: Draw) -> Value:
    match drawn:
        case Pick(values):
            return values[int(draw.integers(len(values)))]
        case Even(low, high):
            return float(draw.uniform(low, high))
        case Moment(low, high):
            return float(world.duration_s * draw.uniform(low, high))
        case Peak(of, low, high):
            return float(world.peaks[of] * draw.uniform(low, high))
        case Code(spread):
            return world.zero_code + int(draw.integers(-spread, spread + 1))
        case _:
            raise AssertionError(drawn)


_NOMINAL: Final[tuple[tuple[str, str, Callable[[Robot], float]], ...]] = (
    ("radius_scale", "scale", lambda robot: robot.tolerance.radius_scale),
    ("radius_mismatch", "mismatch", lambda robot: robot.tolerance.radius_mismatch),
    ("wheelbase_scale", "scale", lambda robot: robot.tolerance.wheelbase_scale),
    ("gyro_scale", "scale", lambda robot: robot.tolerance.gyro_scale),
    ("gyro_bias", "bias", lambda robot: robot.tolerance.gyro_bias_rad_s),
    ("reference_time_offset", "offset", lambda robot: robot.tolerance.time_offset_s),
)


_BELIEVED: Final = (
    "cross_slope_drift",
    "drive_delay",
    "drive_gain",
    "drive_lag",
    "encoder_eccentricity",
    "grade_slip",
    "gyro_asymmetry",
    "gyro_g_sensitivity",
    "gyro_lag",
    "gyro_nonlinearity",
    "gyro_temperature_bias",
    "gyro_temperature_scale",
    "gyro_vibration",
    "lateral_slip",
    "longitudinal_slip",
    "reference_clock_skew",
    "reference_lever_arm",
    "reference_scale",
    "reference_yaw",
    "tyre_drift",
)
"""What else the diagnosis believes any robot to be off by, within tolerance."""


def draw_nominal(
    robot: Robot, effects: frozenset[str], stratum: Stratum, draw: Draw
) -> dict[str, Values]:
    """Return errors of the description within tolerance: half of it is their standard deviation.

    In stratum *prior* all of those that the diagnosis believes in: without them its intervals held
    too often. What is drawn as an effect, by whichever of its names, has no further error.
    """
    taken = frozenset[str]().union(*(class_of(one) for one in effects))
    if "payload" in effects:
        taken |= {"radius_scale", "radius_mismatch"}
    found: dict[str, Values] = {}
    for effect, parameter, tolerance in _NOMINAL:
        limit = tolerance(robot)
        value = _error_within(limit, draw)
        if effect not in taken:
            found[effect] = {parameter: value}
    for effect in _BELIEVED if stratum == "prior" else ():
        values = _within_tolerance(effect, draw)
        if effect not in taken:
            found[effect] = values
    return found


def _within_tolerance(effect: str, draw: Draw) -> Values:
    """Return the parameters of an effect that is no news."""
    values: Values = {}
    for name, drawn in SIZES[effect].items():
        if not isinstance(drawn, Size):
            values[name] = _other(drawn, _NOWHERE, draw)
            continue
        size = _error_within(drawn.tolerance, draw, at_right_angles=_has_angle(effect))
        values[name] = size if drawn.signed else abs(size)
    return values


def _error_within(tolerance: float, draw: Draw, *, at_right_angles: bool = False) -> float:
    """Return an error within tolerance, of which half is its standard deviation: drawn again where
    it is beyond, so that none is just at it. An amplitude, or a slope, is the length of two at
    right angles."""
    while True:
        error = draw.normal(0.0, 0.5 * tolerance, 2)
        size = math.hypot(*error) if at_right_angles else float(error[0])
        if abs(size) < tolerance:
            return size


def _has_angle(effect: str) -> bool:
    return any(name in _POLAR for name in SIZES[effect])


def believed_wander(believed: LevelPrior, draw: Draw) -> float:
    """Return by what share of their way wheels slip now more and now less, as the diagnosis
    believes it beforehand."""
    score = believed.spread[SLIP_WANDER] * draw.standard_normal()
    return float(believed.median[SLIP_WANDER] * math.exp(score))


def draw_surroundings(draw: Draw) -> dict[str, Values]:
    """Return the floor's micro-slip, and half of the time each a warm-up and a sagging supply."""
    slip = math.exp(draw.uniform(math.log(1e-4), math.log(1e-3)))
    warm = {
        "offset": float(draw.uniform(-8.0, 8.0)),
        "rise": float(draw.uniform(3.0, 15.0)),
        "time_constant": float(draw.uniform(15.0, 60.0)),
    }
    sag = {"offset": float(draw.uniform(-0.3, 0.3)), "rate": float(draw.uniform(-0.02, -0.003))}
    found: dict[str, Values] = {"micro_slip": {"left": slip, "right": slip}}
    if draw.random() < 0.5:
        found["warm_up"] = dict(warm)
    if draw.random() < 0.5:
        found["supply_change"] = dict(sag)
    return found
