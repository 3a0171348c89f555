"""Driving the robot of `mujoco_world`: commands in, the engine's state at each tick out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.trials.mujoco_world import GRAVITY_M_S2, STEP_S, World, model_of
from sim_plant import PlantDescription

Floats = NDArray[np.float64]

_SETTLE_S: Final = 0.5
_DEPTH_SHARE: Final = 0.5
"""The contact lies in the middle of the dent."""


@dataclass(frozen=True)
class Driven:
    """The engine's state at each tick t_k, k = 0 … n − 1.

    Attributes:
        time_s: float64[n].
        pose: float64[n, 3], of the axle's middle in the floor's plane, heading unwrapped.
        wheel_rad: float64[n, 2], how far the left and the right wheel have turned in the body.
        wheel_rad_s: float64[n, 2].
        creep_m_s: float64[n, 2], speed of each wheel's lowest point over the floor, ahead.
        sideways_m_s: float64[n], velocity of the axle's middle to the left.
        normal_n: float64[n, 2], force of the floor on each drive wheel.
    """

    time_s: Floats
    pose: Floats
    wheel_rad: Floats
    wheel_rad_s: Floats
    creep_m_s: Floats
    sideways_m_s: Floats
    normal_n: Floats


def drive_through(
    world: World, description: PlantDescription, commands: Floats, tick_period_us: int
) -> Driven:
    """Drive commands float64[n, 2], (v_m_s, w_rad_s); row k is in force in (t_k, t_{k+1}].

    The motors' controllers take them for wheel rates by the *described* geometry and follow with
    the described lag.
    """
    engine = _Engine(world, description, tick_period_us)
    rows = [engine.state()]
    for v_m_s, w_rad_s in commands[:-1]:
        engine.step(float(v_m_s), float(w_rad_s))
        rows.append(engine.state())
    table = np.array(rows)
    pose = table[:, :3].copy()
    pose[:, 2] = np.unwrap(pose[:, 2])
    return Driven(
        time_s=np.arange(len(table), dtype=np.float64) * (tick_period_us * 1e-6),
        pose=_from_start(pose),
        wheel_rad=table[:, 3:5] - table[0, 3:5],
        wheel_rad_s=table[:, 5:7],
        creep_m_s=table[:, 7:9],
        sideways_m_s=table[:, 9],
        normal_n=table[:, 10:12],
    )


class _Engine:
    """One world under way."""

    def __init__(self, world: World, description: PlantDescription, tick_period_us: int) -> None:
        self._world, self._described = world, description
        self._steps = round(tick_period_us * 1e-6 / STEP_S)
        if abs(self._steps * STEP_S - tick_period_us * 1e-6) > 1e-12:
            raise ValueError(f"a tick of {tick_period_us} µs: expected a multiple of {STEP_S} s")
        lag_s = description.drive.time_constant_s
        self._settle(model_of(world, lag_s))
        if world.tyre_m_per_n > 0:
            self._world = world = pressed(world, self.normal_n())
            self._settle(model_of(world, lag_s))
        self._start = self.pose()

    def _settle(self, model: Any) -> None:
        self.model, self.data = model, mujoco.MjData(model)
        sides = ("left", "right")
        self._wheels = [model.geom(side).id for side in sides]
        self._angles = [int(model.joint(side).qposadr[0]) for side in sides]
        self._speeds = [int(model.joint(side).dofadr[0]) for side in sides]
        mujoco.mj_step(model, self.data, nstep=round(_SETTLE_S / STEP_S))

    def step(self, v_m_s: float, w_rad_s: float) -> None:
        """Go on by one tick under a command."""
        wheels = self._described.wheels
        turn = 0.5 * w_rad_s * wheels.wheelbase_m
        limit = self._described.drive.max_wheel_rate_rad_s
        targets = np.array([v_m_s - turn, v_m_s + turn]) / wheels.radius_m
        self.data.ctrl[:] = np.clip(targets, -limit, limit)
        patch = self._world.patch
        if patch is not None:
            wheel = 0 if patch.side == "left" else 1
            x_m = float(self.data.body(patch.side).xpos[0]) - float(self._start[0])
            on_it = patch.start_m <= x_m < patch.stop_m
            self.model.pair_friction[wheel, :2] = patch.friction if on_it else self._world.friction
        mujoco.mj_step(self.model, self.data, nstep=self._steps)

    def pose(self) -> Floats:
        """Return x_m, y_m of the axle's middle and the heading."""
        w, x, y, z = self.data.qpos[3:7]
        heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return np.array([self.data.qpos[0], self.data.qpos[1], heading])

    def normal_n(self) -> Floats:
        """Return the floor's force on the left and the right wheel."""
        return self._of_wheels(self.data.efc_force[self.data.contact.efc_address])

    def _depth_m(self) -> Floats:
        return np.maximum(-self._of_wheels(self.data.contact.dist), 0.0)

    def _of_wheels(self, values: Floats) -> Floats:
        """Return the values of the contacts of the left and the right wheel; 0 off the floor."""
        geoms = self.data.contact.geom
        return np.array([values[(geoms == wheel).any(1)].sum() for wheel in self._wheels])

    def state(self) -> Floats:
        """Return one row of what `Driven` holds."""
        pose, qvel = self.pose(), self.data.qvel
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        rates, angles = qvel[self._speeds], self.data.qpos[self._angles]
        radii = np.array([self._world.radius_left_m, self._world.radius_right_m])
        radii = radii - _DEPTH_SHARE * self._depth_m()
        forward = cosine * qvel[0] + sine * qvel[1]
        sideways = cosine * qvel[1] - sine * qvel[0]
        half = 0.5 * self._world.track_m
        creep = forward + qvel[5] * np.array([-half, half]) - radii * rates
        return np.concatenate([pose, angles, rates, creep, [sideways], self.normal_n()])


def pressed(world: World, normal_n: Floats) -> World:
    """Return the world with wheels as large as they roll under these forces."""
    left_m, right_m = world.tyre_m_per_n * normal_n
    return replace(
        world,
        radius_left_m=world.radius_left_m - float(left_m),
        radius_right_m=world.radius_right_m - float(right_m),
    )


def _from_start(pose: Floats) -> Floats:
    """Return poses seen from the first one."""
    x_m, y_m, heading = (pose - pose[0]).T
    cosine, sine = np.cos(pose[0, 2]), np.sin(pose[0, 2])
    return np.column_stack([cosine * x_m + sine * y_m, cosine * y_m - sine * x_m, heading])


def highest_hold_share(driven: Driven, world: World) -> float:
    """Return the largest acceleration of the drive over what the floor could give, µ·g."""
    step_s = float(driven.time_s[1] - driven.time_s[0])
    heading = driven.pose[:, 2]
    x_m_s, y_m_s = np.gradient(driven.pose[:, :2], step_s, axis=0).T
    ahead = x_m_s * np.cos(heading) + y_m_s * np.sin(heading)
    sideways = y_m_s * np.cos(heading) - x_m_s * np.sin(heading)
    return hold_share(ahead, sideways, np.gradient(heading, step_s), step_s, world)


def hold_share(
    ahead_m_s: Floats, sideways_m_s: Floats, turn_rad_s: Floats, step_s: float, world: World
) -> float:
    """Return the largest acceleration of either wheel over µ·g, in means of five steps.

    Along the way it is the wheel's own, so that turning has its part in it; across, the axle's.
    """
    half = 0.5 * world.track_m
    across = _smooth(np.gradient(sideways_m_s, step_s) + turn_rad_s * ahead_m_s)
    along = [
        _smooth(np.gradient(ahead_m_s + place * turn_rad_s, step_s) - turn_rad_s * sideways_m_s)
        for place in (-half, half)
    ]
    return float(np.hypot(along, across).max()) / (world.friction * GRAVITY_M_S2)


def _smooth(values: Floats) -> Floats:
    """Return the means of five values each, without the ends."""
    return np.convolve(values, np.ones(5) / 5, "same")[10:-10]
