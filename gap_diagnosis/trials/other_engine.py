"""Nulls of the other engine for a trial: a robot of MuJoCo as a calibration in it describes it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gap_diagnosis.trials import reference_noise
from gap_diagnosis.trials.case import OTHER_ENGINE, Case
from gap_diagnosis.trials.draw import Values, draw_surroundings
from gap_diagnosis.trials.layout import ROBOT
from gap_diagnosis.trials.mujoco_cases import calibrate, gentle_drive, nominal_world
from gap_diagnosis.trials.mujoco_sensors import Engine
from gap_diagnosis.trials.mujoco_truth import Calibrated, news_of, truth_of
from gap_diagnosis.trials.plan import Planned
from gap_diagnosis.trials.robots import robot_text
from gap_diagnosis.trials.secret import Secret
from hil_harness.assembly import Wire
from hil_harness.effect_runs import EffectRun, run_with_effects
from hil_harness.robot import Robot, load_robot


def driven_null(
    one: Planned, home: Path, wire: Wire, secret: Secret
) -> tuple[Case, EffectRun | None, Robot]:
    """Return a case without an effect, its run and its robot, described in *home*.

    No run where what the engine did, measured from its state, is more than the description's
    tolerances allow: that is no null.

    Matched: radius and wheelbase are those that a calibration drive gives, as a lab would measure
    them, and commands are so gentle that the wheels hold.
    """
    file = home / ROBOT
    file.write_text(robot_text(one.robot, secret.generator("robot")), encoding="ascii")
    drawn = load_robot(file).plant
    world = replace(
        nominal_world(secret.seed("world")),
        radius_left_m=drawn.wheels.radius_m,
        radius_right_m=drawn.wheels.radius_m,
        track_m=drawn.wheels.wheelbase_m,
    )
    found = calibrate(world, drawn, wire)
    described = (found.radius_m, found.wheelbase_m)
    text = robot_text(one.robot, secret.generator("robot"), described_m=described)
    file.write_text(text, encoding="ascii")
    robot = load_robot(file)
    scenario = gentle_drive(one.drive, [secret.seed("drive")], world, robot.plant, wire)
    case = Case(
        name=home.name,
        stratum=one.stratum,
        kind=one.kind,
        effects={},
        over_limit={},
        without=one.without,
        nominal={},
        surroundings=_surroundings(secret),
        drive=one.drive,
        robot=one.robot,
        noise=reference_noise.draw_levels(one.noise, secret.generator("noise")),
        steps=1,
        secret=secret.word.hex(),
        engine=OTHER_ENGINE,
    )
    engine = Engine(world)
    (run,) = run_with_effects(
        scenario, robot, wire, [(case.settings, secret.seed("plant"))], simulator=engine
    )
    assert engine.driven is not None  # it was driven just now
    wheels = robot.plant.wheels
    did = truth_of(engine.driven, world, Calibrated(wheels.radius_m, 0.0, wheels.wheelbase_m))
    is_null = not news_of(did, robot.tolerance)
    return replace(case, measured=did), run if is_null else None, robot


def _surroundings(secret: Secret) -> dict[str, Values]:
    """Return what warms up and sags as in any case; how the wheels slip is the engine's own."""
    found = draw_surroundings(secret.generator("surroundings"))
    return {name: values for name, values in found.items() if name != "micro_slip"}
