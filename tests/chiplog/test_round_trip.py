"""Diagnose, take it home, diagnose a fresh log with what was written: nothing is left to find."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from command_line import Chiplog

from hil_harness.robot import load_robot

WHEELBASE_M = 0.2985
SCALE = 0.02


def test_a_corrected_description_leaves_nothing_to_find(chiplog: Chiplog, tmp_path: Path) -> None:
    drive(chiplog, "real", f"wheelbase_scale.scale={SCALE}", seed=1)
    first = diagnosed(chiplog, "real", "--write-robot", "calibrated.toml")
    assert first["verdict"] == "wheelbase_scale"
    assert first["gap"]["after"] < first["gap"]["before"]
    corrected_m = load_robot(tmp_path / "calibrated.toml").plant.wheels.wheelbase_m
    left = WHEELBASE_M * (1 + SCALE) / corrected_m - 1
    fresh = ("--robot", "calibrated.toml")
    drive(chiplog, "fresh", f"wheelbase_scale.scale={left!r}", *fresh, seed=2)
    assert diagnosed(chiplog, "fresh", *fresh)["verdict"] == "no_gap"


def test_found_effects_make_the_simulator_drift_as_the_robot_does(
    chiplog: Chiplog, tmp_path: Path, size: str
) -> None:
    effect = "radius_mismatch.mismatch=0.006"
    drive(chiplog, "real", effect, seed=1)
    first = diagnosed(chiplog, "real", "--write-effects", "explained.toml")
    assert first["verdict"] == "radius_mismatch"
    drive(chiplog, "again", effect, seed=2)
    drive(chiplog, "described", "radius_mismatch.mismatch=0", seed=2)
    words = "run --scenario calibration --effects explained.toml --seed 2 --out explained"
    assert chiplog(*words.split()).status == 0
    again, described, explained = (
        np.loadtxt(tmp_path / name / "reference.tum")[-1, 1:3]
        for name in ("again", "described", "explained")
    )
    # As much as the value is off: 0.0003 of 0.006.
    assert math.dist(explained, again) < 0.05 * math.dist(described, again)
    if size == "full":
        tell_the_same(first, diagnosed(chiplog, "explained"))


def tell_the_same(first: dict[str, Any], second: dict[str, Any]) -> None:
    assert first["verdict"] == second["verdict"] == "radius_mismatch"
    values = [
        one["which"][0]["parameters"]["radius_mismatch.mismatch"]["estimate"]
        for one in (first, second)
    ]
    assert abs(values[0] - values[1]) < 0.0003


def drive(chiplog: Chiplog, name: str, effect: str, *more: str, seed: int) -> None:
    words = f"run --scenario calibration --effect {effect} --seed {seed} --out {name}"
    assert chiplog(*words.split(), *more).status == 0


def diagnosed(chiplog: Chiplog, name: str, *more: str) -> dict[str, Any]:
    log = (f"{name}/bus.log", "--reference", f"{name}/reference.tum", "--json", "-")
    said = chiplog("diagnose", *log, *more)
    assert said.status == 0, said.err
    content: dict[str, Any] = json.loads(said.out)
    return content
