"""Diagnose, take it home, diagnose a fresh log with what was written: nothing is left to find."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

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


def test_found_effects_make_the_simulator_drift_as_the_robot_does(chiplog: Chiplog) -> None:
    drive(chiplog, "real", "radius_mismatch.mismatch=0.006", seed=1)
    first = diagnosed(chiplog, "real", "--write-effects", "explained.toml")
    words = "run --scenario calibration --effects explained.toml --seed 2 --out explained"
    assert chiplog(*words.split()).status == 0
    second = diagnosed(chiplog, "explained")
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
