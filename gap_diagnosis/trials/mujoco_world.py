"""A robot in another engine: wheels that roll by contact on a floor, a caster, a load, motors.

What the catalogue calls an effect is made of matter here: a smaller wheel is a smaller ellipsoid, a
slope is gravity that points elsewhere, a weak motor has a smaller largest torque.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import mujoco

STEP_S: Final = 0.0004
CONTACT_S: Final = 0.0008
"""Time constant of the contact; below a millisecond, for it shows as a time offset of its size."""
GRAVITY_M_S2: Final = 9.81

_CASTER_RADIUS_M: Final = 0.02
_CASTER_AT_M: Final = -0.20
_WHEEL_WIDTH_M: Final = 0.02
_ROTOR_KG_M2: Final = 0.02
"""Of a motor, seen through its gear."""
_SERVO_NM_S: Final = 20.0
_SERVO_LAG_S: Final = 0.0015
"""The rotor, and half the robot at a wheel's radius, over the controller's gain."""


@dataclass(frozen=True)
class Patch:
    """A part of the floor where one wheel finds little hold.

    Attributes:
        side: which wheel can tread on it.
        start_m, stop_m: along the world's x axis.
        friction: coefficient there.
    """

    side: str
    start_m: float
    stop_m: float
    friction: float


@dataclass(frozen=True)
class World:
    """The robot and its floor.

    Attributes:
        radius_left_m, radius_right_m: of the wheels as made; they roll on a little less.
        track_m: between the middles of the wheels.
        mass_kg, middle_x_m: of the body and where its centre of mass lies ahead of the axle.
        load_kg, load_at_m: a load on top, and where, in the body frame from the axle's middle.
        friction: of wheels on the floor.
        scrub_m: torsional friction of a wheel's contact [m], its moment over the normal force.
        caster_friction, trail_m: of the caster behind: how far it trails its swivel.
        patch: icy part of the floor.
        slope_rad, downhill_rad: of the floor, and the direction in it that leads down.
        torque_nm: largest of each motor, at the wheel.
        tyre_m_per_n: by how much the tyres' rolling radius shrinks under load.
        soft_s: time constant of the tyres' hold along the floor. The engine lifts what slides: a
            wheel that turns about where it stands hops as soon as *scrub_m* [m], times the turn
            rate, over this is more than 0.5 m/s².
    """

    radius_left_m: float = 0.05
    radius_right_m: float = 0.05
    track_m: float = 0.30
    mass_kg: float = 8.0
    middle_x_m: float = -0.05
    load_kg: float = 0.0
    load_at_m: tuple[float, float, float] = (0.0, 0.0, 0.1)
    friction: float = 1.0
    scrub_m: float = 0.001
    caster_friction: float = 0.6
    trail_m: float = 0.015
    patch: Patch | None = None
    slope_rad: float = 0.0
    downhill_rad: float = 0.0
    torque_nm: float = 20.0
    tyre_m_per_n: float = 0.0
    soft_s: float = CONTACT_S


_SCENE: Final = """
<mujoco>
  <option timestep="{step}" integrator="Euler" cone="elliptic" impratio="10"
          gravity="{gravity_x} {gravity_y} {gravity_z}"/>
  <default>
    <geom contype="0" conaffinity="0"/>
  </default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="base" pos="0 0 {height}">
      <freejoint/>
      <inertial pos="{middle_x} 0 0.04" mass="{mass}" diaginertia="{inertia}"/>
      <body name="load" pos="{load_at}">
        <geom type="sphere" size="0.03" mass="{load}"/>
      </body>
      <body name="left" pos="0 {half} 0">
        <joint name="left" type="hinge" axis="0 1 0" armature="{rotor}"/>
        <geom name="left" type="ellipsoid" size="{left} {width} {left}" mass="0.3"/>
      </body>
      <body name="right" pos="0 -{half} 0">
        <joint name="right" type="hinge" axis="0 1 0" armature="{rotor}"/>
        <geom name="right" type="ellipsoid" size="{right} {width} {right}" mass="0.3"/>
      </body>
      {caster}
    </body>
  </worldbody>
  <contact>
    <pair name="left" geom1="left" geom2="floor" condim="4" solref="{contact} 1"
          solreffriction="{soft} 1" friction="{friction} {friction} {scrub} 0 0"/>
    <pair name="right" geom1="right" geom2="floor" condim="4" solref="{contact} 1"
          solreffriction="{soft} 1" friction="{friction} {friction} {scrub} 0 0"/>
    <pair name="caster" geom1="caster" geom2="floor" condim="3" solref="{contact} 1"
          friction="{caster_friction} {caster_friction} 0 0 0"/>
  </contact>
  <actuator>
    <general name="left" joint="left" dyntype="filterexact" dynprm="{lag}" gainprm="{servo}"
             biastype="affine" biasprm="0 0 -{servo}" forcerange="-{torque} {torque}"/>
    <general name="right" joint="right" dyntype="filterexact" dynprm="{lag}" gainprm="{servo}"
             biastype="affine" biasprm="0 0 -{servo}" forcerange="-{torque} {torque}"/>
  </actuator>
</mujoco>
"""
_SWIVEL: Final = """
      <body name="swivel" pos="{at} 0 {down}">
        <joint name="swivel" type="hinge" axis="0 0 1" damping="0.002"/>
        <inertial pos="0 0 0.01" mass="0.05" diaginertia="1e-5 1e-5 1e-5"/>
        <body name="caster" pos="-{trail} 0 0">
          <joint name="caster" type="hinge" axis="0 1 0"/>
          <geom name="caster" type="ellipsoid" size="{radius} 0.008 {radius}" mass="0.05"/>
        </body>
      </body>
"""


def model_of(world: World, lag_s: float) -> Any:
    """Return the compiled model (`mujoco.MjModel`).

    *lag_s* is the first-order lag of the motors' speed controllers.
    """
    slope, way = math.sin(world.slope_rad), world.downhill_rad
    height = 0.5 * (world.radius_left_m + world.radius_right_m)
    swivel = _SWIVEL.format(
        at=_CASTER_AT_M,
        down=_CASTER_RADIUS_M - height,
        radius=_CASTER_RADIUS_M,
        trail=world.trail_m,
    )
    text = _SCENE.format(
        step=STEP_S,
        gravity_x=GRAVITY_M_S2 * slope * math.cos(way),
        gravity_y=GRAVITY_M_S2 * slope * math.sin(way),
        gravity_z=-GRAVITY_M_S2 * math.cos(world.slope_rad),
        height=height,
        middle_x=world.middle_x_m,
        mass=world.mass_kg,
        inertia="{0} {0} {1}".format(0.01 * world.mass_kg, 0.015 * world.mass_kg),
        load=max(world.load_kg, 1e-6),
        load_at=" ".join(map(str, world.load_at_m)),
        half=world.track_m / 2,
        left=world.radius_left_m,
        right=world.radius_right_m,
        width=_WHEEL_WIDTH_M,
        caster=swivel,
        contact=CONTACT_S,
        soft=world.soft_s,
        friction=world.friction,
        scrub=world.scrub_m,
        caster_friction=world.caster_friction,
        lag=max(lag_s - _SERVO_LAG_S, 1e-6),
        rotor=_ROTOR_KG_M2,
        servo=_SERVO_NM_S,
        torque=world.torque_nm,
    )
    return mujoco.MjModel.from_xml_string(text)
