"""Drives of known truth: everything that is random in them is what the likelihood assumes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gap_diagnosis.explanations import EXPLAINED
from gap_diagnosis.motion.columns import GROSS, NEVER_NUISANCE
from gap_diagnosis.motion.levels import FLOORS
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.trials import drives
from hil_harness.assembly import Wire, load_wire
from hil_harness.effects import EffectSetting, catalogue
from hil_harness.effects.model import Value
from hil_harness.robot import Robot, load_robot
from hil_harness.scenarios.model import Scenario

Draw = np.random.Generator
Values = Mapping[str, Value]

SIDED: Final = frozenset(
    {
        "backlash",
        "encoder_eccentricity",
        "extra_ticks",
        "missed_ticks",
        "one_sided_slip",
        "wheel_eccentricity",
    }
)
_OCCURRING: Final = frozenset(
    {"gyro_saturation", "gyro_frozen", "encoder_dead", "encoder_wrap", "adc_stuck_bit"}
)
_LATENCY: Final = frozenset({"frame_latency"})
CONSTANTS: Final = tuple(
    sorted(EXPLAINED.keys() - NEVER_NUISANCE - SIDED - _OCCURRING - _LATENCY - GROSS)
)
"""Effects that are always free within their tolerance: errors of the description."""

TIME_MAP: Final = frozenset({"reference_time_offset", "reference_clock_skew"})


@dataclass(frozen=True)
class World:
    """A robot, its drive and all that is unknown beside the effect.

    Attributes:
        described, real: the robot as its owner has it, and with the noise that it really has.
        wire: the DBC.
        scenario: what is driven.
        reference: how well the truth is measured.
        constants: errors of the description within tolerance, by effect.
        surroundings: warm-up and sagging supply.
        off_centre: sine and cosine of an encoder's eccentricity within tolerance. Only beside a
            wheel's on the same side, which it passes for: elsewhere it hardly shows.
        seed: of the plant's noise.
    """

    described: Robot
    real: Robot
    wire: Wire
    scenario: Scenario
    reference: ReferenceNoise
    constants: Mapping[str, Values]
    surroundings: tuple[EffectSetting, ...]
    off_centre: tuple[float, float]
    seed: int

    @property
    def levels(self) -> Floats:
        """The true noise levels in the order of `LEVELS`; the plant never skids sideways, and
        what it has not stands at its floor."""
        gyro, noise = self.real.plant.gyro, self.reference
        known = dict(zip(LEVELS, FLOORS, strict=True)) | {
            "contact_m_per_sqrt_m": self.real.plant.contact.noise_m_per_sqrt_m,
            "lateral_m_per_sqrt_m": 2e-5,
            "gyro_noise_rad_per_sqrt_s": gyro.noise_density_rad_per_sqrt_s,
            "gyro_bias_walk_rad_s_per_sqrt_s": gyro.bias_walk_density_rad_s_per_sqrt_s,
            "reference_position_m": noise.position_m,
            "reference_heading_rad": noise.heading_rad,
            "reference_slow_position_m": noise.coloured_position_m,
            "reference_slow_heading_rad": noise.coloured_heading_rad,
            "reference_slow_s": noise.correlation_time_s,
        }
        return np.array([known[name] for name in LEVELS])

    def recording(self, effect: str | None, values: Values) -> Recording:
        """Return the log of one drive with an effect (and no constant beside its own)."""
        settings = [*self.surroundings]
        settings += [
            EffectSetting(name, tuple(constant.items()))
            for name, constant in self.constants.items()
            if name != effect and name not in _OWN.get(effect or "", ())
        ]
        if effect is not None:
            settings.append(EffectSetting(effect, tuple(values.items())))
        if effect == "wheel_eccentricity":
            off = {"amplitude": math.hypot(*self.off_centre), "phase": math.atan2(*self.off_centre)}
            both = (("side", values["side"]), *off.items())
            settings.append(EffectSetting("encoder_eccentricity", both))
        return synthetic_recording(
            self.real, self.wire, self.scenario, settings, self.seed, reference=self.reference
        )


_OWN: Final[Mapping[str, tuple[str, ...]]] = {
    "ticks_per_rev": ("radius_scale",),
    "frame_latency": ("reference_time_offset",),
}
"""Effects told by another's name take the place of that one's constant too."""
_OFF_CENTRE: Final = 1
"""With a world's seed: its encoder's draw leaves all others as they are."""


def draw_world(effect: str | None, draw: Draw, *, exact: bool = False) -> World:
    """Return a world for an effect; *exact*: only the time map is off from the description."""
    robot, wire = load_robot(), load_wire()
    world = World(
        described=robot,
        real=_with_noise(robot, draw),
        wire=wire,
        scenario=drives.drive(str(draw.choice(drives.FAMILIAR)), draw, 0.5),
        reference=ReferenceNoise(
            position_m=_even(draw, 2e-4, 1e-3),
            heading_rad=_even(draw, 2e-4, 1e-3),
            coloured_position_m=_even(draw, 1e-4, 5e-4),
            coloured_heading_rad=_even(draw, 1e-4, 5e-4),
            correlation_time_s=_even(draw, 0.5, 2.0),
        ),
        constants=_constants(robot, draw, TIME_MAP if exact else frozenset(CONSTANTS)),
        surroundings=_surroundings(effect, draw),
        off_centre=(0.0, 0.0),
        seed=int(draw.integers(1 << 62)),
    )
    if exact:
        return world
    sd = 0.5 * tolerances(robot, "encoder_eccentricity", "all")
    sine, cosine = sd * np.random.default_rng([world.seed, _OFF_CENTRE]).standard_normal(2)
    return replace(world, off_centre=(float(sine), float(cosine)))


def tolerances(robot: Robot, effect: str, coefficient: str) -> float:
    """Return up to where a coefficient is no news: by robot.toml, else by the prior."""
    known = robot.tolerance
    stated = {
        "radius_scale": known.radius_scale,
        "ticks_per_rev": known.radius_scale,
        "radius_mismatch": known.radius_mismatch,
        "wheelbase_scale": known.wheelbase_scale,
        "gyro_scale": known.gyro_scale,
        "gyro_bias": known.gyro_bias_rad_s,
        "reference_time_offset": known.time_offset_s,
        "gyro_lag": known.time_offset_s,
    }
    return stated.get(effect, default_prior().of(effect, coefficient).tolerance)


def _even(draw: Draw, low: float, high: float) -> float:
    return float(np.exp(draw.uniform(math.log(low), math.log(high))))


def _with_noise(robot: Robot, draw: Draw) -> Robot:
    """Return the robot with noise of its own: floor 0.1 to 1 mm per root metre, gyro near its
    description, a walking bias."""
    plant = robot.plant
    density = plant.gyro.noise_density_rad_per_sqrt_s * math.exp(0.2 * draw.standard_normal())
    gyro = {
        "noise_density_rad_per_sqrt_s": density,
        "bias_walk_density_rad_s_per_sqrt_s": _even(draw, 1e-6, 6e-6),
    }
    contact = {"noise_m_per_sqrt_m": _even(draw, 1e-4, 1e-3)}
    changed = {
        "gyro": plant.gyro.model_copy(update=gyro),
        "contact": plant.contact.model_copy(update=contact),
    }
    return replace(robot, plant=plant.model_copy(update=changed))


def _constants(robot: Robot, draw: Draw, wanted: frozenset[str]) -> dict[str, Values]:
    """Return errors of the description: half a tolerance is their standard deviation."""
    found: dict[str, Values] = {}
    for effect in CONSTANTS:
        parameters = catalogue()[effect].parameters
        if "direction" in (one.name for one in parameters):
            sd = 0.5 * tolerances(robot, effect, "all")
            east, north = sd * draw.standard_normal(2)
            values = {"ratio": math.hypot(east, north), "direction": math.atan2(east, north)}
        else:
            values = {}
            for one in parameters:
                if default_prior().tolerance(effect, one.name) is None:
                    continue  # in which form it acts, no size
                value = 0.5 * tolerances(robot, effect, one.name) * draw.standard_normal()
                values[one.name] = abs(value) if one.minimum >= 0 else value
        if effect in wanted:
            found[effect] = values
    return found


def _surroundings(effect: str | None, draw: Draw) -> tuple[EffectSetting, ...]:
    """Return a warm-up and a sagging supply: half of the time, or where the effect needs them."""
    warm = (
        ("offset", float(draw.uniform(-8.0, 8.0))),
        ("rise", float(draw.uniform(3.0, 15.0))),
        ("time_constant", float(draw.uniform(15.0, 60.0))),
    )
    sag = (("offset", float(draw.uniform(-0.3, 0.3))), ("rate", float(draw.uniform(-0.02, -0.003))))
    coins = draw.random(2)
    found = []
    if coins[0] < 0.5 or (effect or "").startswith("gyro_temperature"):
        found.append(EffectSetting("warm_up", warm))
    if coins[1] < 0.5 or effect == "supply_ratio":
        found.append(EffectSetting("supply_change", sag))
    return tuple(found)
