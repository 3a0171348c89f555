"""Diagnose, take it home, diagnose a fresh log with what was written: nothing is left to find."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from command_line import Chiplog

from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import NumberEstimate
from hil_harness.effects import load_effects
from hil_harness.robot import load_robot

WHEELBASE_M = 0.2985
SCALE = 0.02

pytestmark = pytest.mark.usefixtures("no_pictures")


def test_a_corrected_description_leaves_nothing_to_find(chiplog: Chiplog, tmp_path: Path) -> None:
    drive(chiplog, "real", f"wheelbase_scale.scale={SCALE}", seed=1)
    first = diagnosed(chiplog, "real", "--write-robot", "calibrated.toml")
    named(first, "wheelbase_scale", stage="wheel")
    close_to(SCALE, number(first, "wheelbase_scale.scale"))
    assert first.gap is not None
    assert first.gap.after is not None
    assert first.gap.after < first.gap.before
    corrected_m = load_robot(tmp_path / "calibrated.toml").plant.wheels.wheelbase_m
    left = WHEELBASE_M * (1 + SCALE) / corrected_m - 1
    known = "calibrated.toml"
    drive(chiplog, "fresh", f"wheelbase_scale.scale={left!r}", seed=2, robot=known)
    named(diagnosed(chiplog, "fresh", "--robot", known), "no_gap", stage="none")


def test_found_effects_make_the_simulator_drift_as_the_robot_does(
    chiplog: Chiplog, tmp_path: Path, size: str
) -> None:
    effect = "radius_mismatch.mismatch=0.006"
    drive(chiplog, "real", effect, seed=1, duration_s=60)
    first = diagnosed(chiplog, "real", "--write-effects", "explained.toml")
    assert first.verdict == "radius_mismatch"
    drive(chiplog, "again", effect, seed=2, duration_s=60)
    drive(chiplog, "described", seed=2, duration_s=60)
    words = "run --scenario calibration --effects explained.toml --seed 2 --duration-s 60"
    assert chiplog(*words.split(), "--out", "explained").status == 0
    again, described, explained = (
        np.loadtxt(tmp_path / name / "reference.tum")[-1, 1:3]
        for name in ("again", "described", "explained")
    )
    # As much as the value is off: 0.0003 of 0.006.
    assert math.dist(explained, again) < 0.05 * math.dist(described, again)
    if size == "full":
        tell_the_same(first, diagnosed(chiplog, "explained"))


def test_beside_what_was_found_nothing_is_left_to_find_but_a_further_cause(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    own = [
        "gyro_lag.time_constant=0.06",
        "drive_lag.time_constant=0.08",
        "firmware_constant.constant=wheel_radius",
        "firmware_constant.scale=0.0131234567",
        "frame_loss.frame=ENCODER",
        "frame_loss.probability=0.02",
    ]
    drive(chiplog, "real", *own, seed=1, duration_s=60)
    first = diagnosed(chiplog, "real", "--write-effects", "explained.toml")
    assert first.verdict == "drive_lag+firmware_constant+frame_loss+gyro_lag"
    known = ("--effects", "explained.toml")
    drive(chiplog, "fresh", *own, seed=2, duration_s=60)
    healthy = diagnosed(chiplog, "fresh", *known)
    named(healthy, "no_gap", stage="none")
    assert {one.effect for one in healthy.granted} == {*first.which[0].effects}
    assert {one.role for one in healthy.inputs} == {"log", "reference", "effects"}
    drive(chiplog, "worn", *own, "radius_mismatch.mismatch=0.006", seed=3, duration_s=60)
    further = diagnosed(chiplog, "worn", *known, "--write-effects", "both.toml")
    named(further, "radius_mismatch", stage="wheel")
    close_to(0.006, number(further, "radius_mismatch.mismatch"))
    both = {one.effect for one in load_effects(tmp_path / "both.toml")}
    assert both == {"radius_mismatch", *first.which[0].effects}


def named(found: Diagnosis, verdict: str, *, stage: str) -> None:
    assert (found.verdict, found.stage) == (verdict, stage)
    assert found.which[0].probability > 0.8
    listed = [one.effects for one in found.which]
    assert ("no_gap",) in listed
    assert ("unknown",) in listed
    total = math.fsum(one.probability for one in found.which) + found.other
    assert math.isclose(total, 1, abs_tol=1e-6)


def number(found: Diagnosis, key: str) -> NumberEstimate:
    known = found.which[0].parameters[key]
    assert isinstance(known, NumberEstimate)
    return known


def close_to(value: float, known: NumberEstimate) -> None:
    assert abs(known.estimate - value) < 4 * known.sd
    assert known.sd < 0.1 * value


def tell_the_same(first: Diagnosis, second: Diagnosis) -> None:
    assert first.verdict == second.verdict == "radius_mismatch"
    values = [number(one, "radius_mismatch.mismatch").estimate for one in (first, second)]
    assert abs(values[0] - values[1]) < 0.0003


def drive(
    chiplog: Chiplog,
    name: str,
    *effects: str,
    seed: int,
    duration_s: float | None = None,
    robot: str | None = None,
) -> None:
    words = ["run", "--scenario", "calibration", "--seed", f"{seed}", "--out", name]
    words += [word for effect in effects for word in ("--effect", effect)]
    words += [] if duration_s is None else ["--duration-s", f"{duration_s:g}"]
    words += [] if robot is None else ["--robot", robot]
    assert chiplog(*words).status == 0


def diagnosed(chiplog: Chiplog, name: str, *more: str) -> Diagnosis:
    log = (f"{name}/bus.log", "--reference", f"{name}/reference.tum", "--json", "-")
    said = chiplog("diagnose", *log, *more)
    assert said.status == 0, said.err
    found = Diagnosis.from_json(said.out)
    assert json.loads(found.to_json()) == json.loads(said.out)
    return found
