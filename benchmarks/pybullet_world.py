"""A robot in a third engine's physics, PyBullet, written as a stranger would.

Wheels are balls, which touch the floor in a point, or cylinders, which touch it with an edge or
both: what they roll on then changes with every turn and stop, as no effect of the library does.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pybullet as engine
from numpy.typing import NDArray

Floats = NDArray[np.float64]

STEP_S: Final = 0.001
TICK_S: Final = 0.01
RADIUS_M: Final = 0.05
TRACK_M: Final = 0.28
LAG_S: Final = 0.05
_SETTLES_S: Final = 0.5
_TORQUE_NM: Final = 5.0
_ACCELERATES: Final = (1.0, 3.0)
"""Of the commands: m/s² and rad/s²."""


@dataclass(frozen=True)
class World:
    """The robot as made.

    Attributes:
        width_m: of the wheels; 0: they are balls.
        left_m, right_m: radii of the wheels.
        track_m: between the wheels' middles.
        lag_s: of the motors' speed controllers.
    """

    width_m: float = 0.0
    left_m: float = RADIUS_M
    right_m: float = RADIUS_M
    track_m: float = TRACK_M
    lag_s: float = LAG_S


@dataclass(frozen=True)
class Driven:
    """What the engine did, a row per tick: commands v [m/s], w [rad/s]; wheel angles [rad]; pose
    x [m], y [m], heading [rad]: float64[n, 2], float64[n, 2] and float64[n, 3]."""

    commands: Floats
    angles: Floats
    pose: Floats


_ROBOT: Final = """<robot name="robot">
<link name="base">
  <inertial><origin xyz="-0.04 0 0.05"/><mass value="6"/>
    <inertia ixx="0.08" ixy="0" ixz="0" iyy="0.08" iyz="0" izz="0.12"/></inertial>
  <collision><origin xyz="-0.02 0 0.07"/><geometry><box size="0.3 0.2 0.06"/></geometry></collision>
</link>
{left}{right}
<link name="caster">
  <inertial><mass value="0.1"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>
  <collision><geometry><sphere radius="0.02"/></geometry></collision>
</link>
<joint name="caster" type="fixed">
  <parent link="base"/><child link="caster"/><origin xyz="-0.14 0 0.02"/></joint>
</robot>"""
_WHEEL: Final = """<link name="{side}">
  <inertial><mass value="0.3"/>
    <inertia ixx="4e-4" ixy="0" ixz="0" iyy="6e-4" iyz="0" izz="4e-4"/></inertial>
  <collision>{shape}</collision>
</link>
<joint name="{side}" type="continuous">
  <parent link="base"/><child link="{side}"/>
  <origin xyz="0 {aside_m} {height_m}"/><axis xyz="0 1 0"/></joint>"""


def _text(world: World) -> str:
    def wheel(side: str, radius_m: float, aside_m: float) -> str:
        shape = f'<geometry><sphere radius="{radius_m}"/></geometry>'
        if world.width_m:
            shape = (
                f'<origin rpy="{math.pi / 2} 0 0"/><geometry>'
                f'<cylinder radius="{radius_m}" length="{world.width_m}"/></geometry>'
            )
        return _WHEEL.format(side=side, shape=shape, aside_m=aside_m, height_m=RADIUS_M)

    half_m = 0.5 * world.track_m
    left, right = wheel("left", world.left_m, half_m), wheel("right", world.right_m, -half_m)
    return _ROBOT.format(left=left, right=right)


def drive(
    world: World,
    legs: Iterable[tuple[float, float, float]],
    rolls_m: tuple[float, float],
    home: Path,
) -> Driven:
    """Drive legs of (duration [s], v [m/s], w [rad/s]) by wheels whose radius and distance are
    taken for *rolls_m*; *home* takes the robot's file."""
    file = home / "robot.urdf"
    file.write_text(_text(world), encoding="utf-8")
    client = engine.connect(engine.DIRECT)
    try:
        robot = _loaded(file)
        return _driven(robot, world, list(legs), rolls_m)
    finally:
        engine.disconnect(client)


def _loaded(file: Path) -> int:
    engine.setGravity(0, 0, -9.81)
    engine.setTimeStep(STEP_S)
    engine.setPhysicsEngineParameter(numSolverIterations=100, deterministicOverlappingPairs=1)
    floor = engine.createMultiBody(0, engine.createCollisionShape(engine.GEOM_PLANE))
    engine.changeDynamics(floor, -1, lateralFriction=1.0)
    robot = int(engine.loadURDF(str(file), [0, 0, 0.0005]))
    for wheel in (0, 1):
        engine.changeDynamics(robot, wheel, lateralFriction=1.0, linearDamping=0, angularDamping=0)
    engine.changeDynamics(robot, 2, lateralFriction=0.02)
    engine.changeDynamics(robot, -1, linearDamping=0, angularDamping=0)
    return robot


def _turn(robot: int, rates: Floats) -> None:
    for wheel in (0, 1):
        engine.setJointMotorControl2(
            robot, wheel, engine.VELOCITY_CONTROL, targetVelocity=rates[wheel], force=_TORQUE_NM
        )
    engine.stepSimulation()


def _pose(robot: int) -> tuple[float, float, float]:
    """Return x, y and heading of the middle of the axle; the engine's is the centre of mass."""
    at, turned = engine.getBasePositionAndOrientation(robot)
    inertial: Any = engine.getDynamicsInfo(robot, -1)
    back, turned_back = engine.invertTransform(inertial[3], inertial[4])
    (x_m, y_m, _), turned = engine.multiplyTransforms(at, turned, back, turned_back)
    return x_m, y_m, engine.getEulerFromQuaternion(turned)[2]


def _driven(
    robot: int,
    world: World,
    legs: list[tuple[float, float, float]],
    rolls_m: tuple[float, float],
) -> Driven:
    rates = np.zeros(2)
    for _ in range(round(_SETTLES_S / STEP_S)):
        _turn(robot, rates)
    asked = np.array([leg[1:] for leg in legs for _ in range(round(leg[0] / TICK_S))])
    commands, angles, pose = np.zeros((len(asked), 2)), np.zeros((len(asked), 2)), []
    given = np.zeros(2)
    most = np.array(_ACCELERATES) * TICK_S
    follows = 1.0 - math.exp(-STEP_S / world.lag_s)
    radius_m, track_m = rolls_m
    for k, wanted in enumerate(asked):
        angles[k] = [engine.getJointState(robot, wheel)[0] for wheel in (0, 1)]
        pose.append(_pose(robot))
        given = given + np.clip(wanted - given, -most, most)
        commands[k] = given
        aim = (given[0] + 0.5 * track_m * given[1] * np.array([-1.0, 1.0])) / radius_m
        for _ in range(round(TICK_S / STEP_S)):
            rates = rates + follows * (aim - rates)
            _turn(robot, rates)
    where = np.array(pose)
    where[:, 2] = np.unwrap(where[:, 2])
    return Driven(commands, angles - angles[0], where - where[0])


def calibrated(world: World, home: Path) -> tuple[float, float]:
    """Return the wheels' radius and distance that a straight and a spin in the engine give."""
    nominal = RADIUS_M, TRACK_M
    ahead = drive(world, [(1, 0, 0), (15, 0.3, 0), (2, 0, 0)], nominal, home)
    radius_m = float(np.hypot(*ahead.pose[-1, :2]) / ahead.angles[-1].mean())
    spun = drive(world, [(1, 0, 0), (30, 0, 0.8), (2, 0, 0)], nominal, home)
    track_m = float(radius_m * np.diff(spun.angles[-1])[0] / spun.pose[-1, 2])
    return radius_m, track_m
