"""Errors of known size, made up on top of a real robot's own, and what a diagnosis says of them.

    python benchmarks/known_errors.py run --data DIR --results DIR
    python benchmarks/known_errors.py page --results DIR --commit COMMIT --out PAGE

`--data` holds `kobuki/nonfaulty`, `lawnmower/Plaza2_DR.txt` with its `.mat`, and `optiodom` with
the runs of a robot under OptiTrack (examples/recordings/README.md says where they come from). A
real robot is off in ways that nobody knows: what can be checked is by how much an answer moves.
`run` makes and diagnoses each case; what RESULTS/results.jsonl holds already is not done again.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core, not a thread

import numpy as np
from numpy.typing import NDArray
from results import put_page, read_rows, sizes_of

from gap_diagnosis.diagnose import diagnose
from hil_harness.robot import Robot, load_robot

Floats = NDArray[np.float64]
Table = dict[str, Floats]

_TABLES: Final = Path(__file__).parent.parent / "examples" / "recordings"
_KOBUKI, _LAWNMOWER, _OPTITRACK = "Kobuki", "lawnmower", "OptiTrack"
_RUNS: Final = {
    _KOBUKI: ("kobuki/nonfaulty",),
    _LAWNMOWER: ("lawnmower/Plaza2",),
    _OPTITRACK: (
        "optiodom/020120212354_run-01.csv",
        "optiodom/030120210006_run-02.csv",
        "optiodom/030120210006_run-04.csv",
        "optiodom/230620202042_run-04.csv",
        "optiodom/231220200121_run-01.csv",
    ),
}
"""Recordings of each robot. Under OptiTrack: three free drives, a square, circles."""
_SEED: Final = 5


@dataclass(frozen=True)
class Error:
    """What is made up, and what it should change.

    Attributes:
        robot: whose recording.
        parameters: those that may tell it, each with the value it should move by: the likeliest set
            that has one of them is looked at. Empty: nothing is made up.
        options: of the script that makes the table.
        table: changes the columns of the table of a robot.
        described: text of robot.toml and what stands there instead.
        poses: changes the reference's rows, float64[n, 8] as in a `.tum` file.
    """

    robot: str
    parameters: Mapping[str, float]
    options: tuple[str, ...] = ()
    table: Callable[[Table, Robot], None] = lambda table, robot: None
    described: tuple[str, str] = ("", "")
    poses: Callable[[Floats], None] = lambda poses: None


def _smaller_left(table: Table, robot: Robot) -> None:
    wraps_at = 2**robot.plant.encoder.counter_bits
    counts = np.unwrap(table["left_ticks"], period=wraps_at)
    table["left_ticks"] = np.rint(counts[0] + (counts - counts[0]) / 0.97) % wraps_at


def _more_bias(table: Table, robot: Robot) -> None:
    table["gyro_code"] += np.rint(0.02 * robot.plant.gyro.sensitivity_lsb_per_rad_s)


def _later_gyro(table: Table, robot: Robot) -> None:
    """Let each row have the reading of 0.1 s before, rounded as a code is."""
    t_s, code = table["t_s"], table["gyro_code"]
    there = np.isfinite(code)
    before = np.rint(np.interp(t_s - 0.1, t_s[there], code[there]))
    table["gyro_code"] = np.where(there, before, np.nan)


def _later(by_s: float) -> Callable[[Floats], None]:
    def poses(rows: Floats) -> None:
        rows[:, 0] += by_s

    return poses


def _farther(times: float) -> Callable[[Floats], None]:
    def poses(rows: Floats) -> None:
        rows[:, 1:3] *= times

    return poses


def _ahead(by_m: float) -> Callable[[Floats], None]:
    def poses(rows: Floats) -> None:
        heading = 2 * np.arctan2(rows[:, 6], rows[:, 7])
        rows[:, 1] += by_m * np.cos(heading)
        rows[:, 2] += by_m * np.sin(heading)

    return poses


def _turned(by_rad: float) -> Callable[[Floats], None]:
    def poses(rows: Floats) -> None:
        half = np.arctan2(rows[:, 6], rows[:, 7]) + by_rad / 2
        rows[:, 6], rows[:, 7] = np.sin(half), np.cos(half)

    return poses


def _counted(side: str, times: float) -> Callable[[Table, Robot], None]:
    def change(table: Table, robot: Robot) -> None:
        for name in ("left_ticks", "right_ticks") if side == "both" else (f"{side}_ticks",):
            table[name] = np.rint(times * table[name])

    return change


def _off_centre(table: Table, robot: Robot) -> None:
    per_turn = robot.plant.encoder.ticks_per_rev / (2 * np.pi)
    counts = table["left_ticks"]
    table["left_ticks"] = np.rint(counts + 0.04 * per_turn * np.sin(counts / per_turn + 1.0))


def _missing(table: Table, robot: Robot) -> None:
    steps = np.diff(table["left_ticks"], prepend=0.0)
    lost = np.random.default_rng(_SEED).binomial(np.abs(steps).astype(np.int64), 0.03)
    table["left_ticks"] = np.cumsum(steps - np.sign(steps) * lost)


def _stray(table: Table, robot: Robot) -> None:
    row_s = np.diff(table["t_s"], prepend=table["t_s"][0])
    table["right_ticks"] += np.cumsum(np.random.default_rng(_SEED).poisson(20.0 * row_s))


def _dying(table: Table, robot: Robot) -> None:
    row = int(0.6 * len(table["t_s"]))
    table["left_ticks"][row:] = table["left_ticks"][row]


ERRORS: Final[dict[str, Error]] = {
    "nothing": Error(_KOBUKI, {}),
    "gyro reads 20 mrad/s more": Error(_KOBUKI, {"gyro_bias.bias": 0.02}, table=_more_bias),
    "gyro 0.1 s later": Error(_KOBUKI, {"frame_latency.delay": 0.1}, table=_later_gyro),
    "left wheel 3 % smaller": Error(
        _KOBUKI,
        {"radius_mismatch.mismatch": 0.03, "payload.compression_left": 0.03},
        table=_smaller_left,
    ),
    "nothing at all": Error(_LAWNMOWER, {}),
    "left wheel 1.96 % smaller": Error(
        _LAWNMOWER,
        {"payload.compression_left": 0.0196, "radius_mismatch.mismatch": 0.0196},
        ("--left", "1.02"),
    ),
    "both wheels 2.91 % smaller": Error(
        _LAWNMOWER,
        {"ticks_per_rev.scale": 0.03, "radius_scale.scale": -0.0291},
        ("--left", "1.03", "--right", "1.03"),
    ),
    "track 4.76 % narrower": Error(
        _LAWNMOWER,
        {"wheelbase_scale.scale": -0.0476},
        described=("wheelbase_m = 0.5", "wheelbase_m = 0.525"),
    ),
    "reference 0.4 s late": Error(
        _LAWNMOWER, {"reference_time_offset.offset": 0.4}, poses=_later(0.4)
    ),
    "nothing of this one": Error(_OPTITRACK, {}),
    "left wheel 2 % smaller": Error(
        _OPTITRACK,
        {"payload.compression_left": 0.02, "radius_mismatch.mismatch": 0.02},
        table=_counted("left", 1 / 0.98),
    ),
    "both wheels counted 3 % more": Error(
        _OPTITRACK,
        {"ticks_per_rev.scale": 0.03, "radius_scale.scale": -0.0291},
        table=_counted("both", 1.03),
    ),
    "track 4.8 % narrower": Error(
        _OPTITRACK,
        {"wheelbase_scale.scale": -0.0476, "turn_scrub.scrub": -0.0476},
        described=("wheelbase_m = 0.2", "wheelbase_m = 0.21"),
    ),
    "reference 1 % too large": Error(
        _OPTITRACK, {"reference_scale.scale": 0.01}, poses=_farther(1.01)
    ),
    "marker 50 mm ahead": Error(_OPTITRACK, {"reference_lever_arm.x": 0.05}, poses=_ahead(0.05)),
    "reference turned by 50 mrad": Error(
        _OPTITRACK, {"reference_yaw.angle": 0.05}, poses=_turned(0.05)
    ),
    "reference 0.1 s late": Error(
        _OPTITRACK, {"reference_time_offset.offset": 0.1}, poses=_later(0.1)
    ),
    "left encoder 40 mrad off its centre": Error(
        _OPTITRACK, {"encoder_eccentricity.amplitude": 0.04}, table=_off_centre
    ),
    "3 % of the left counts missed": Error(
        _OPTITRACK, {"missed_ticks.probability": 0.03}, table=_missing
    ),
    "20 stray counts a second on the right": Error(
        _OPTITRACK, {"extra_ticks.rate": 20.0}, table=_stray
    ),
    "left encoder dies after three fifths": Error(
        _OPTITRACK, {"encoder_dead.start_s": math.nan}, table=_dying
    ),
}


def write_case(error: Error, recording: Path, home: Path) -> None:
    """Write a recording's table, reference and robot with the error made up."""
    script = _TABLES / f"{error.robot.lower()}_table.py"
    subprocess.run(
        [sys.executable, script, recording, home, *error.options],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    rows = home / "table.csv"
    names = rows.read_text(encoding="utf-8").partition("\n")[0]
    columns = np.genfromtxt(rows, delimiter=",", skip_header=1).T
    table = dict(zip(names.split(","), columns, strict=True))
    robot = home / "robot.toml"
    error.table(table, load_robot(robot))
    lines = (
        ",".join("" if np.isnan(one) else f"{one:.9f}".rstrip("0").rstrip(".") for one in row)
        for row in zip(*table.values(), strict=True)
    )
    rows.write_text("\n".join([names, *lines]) + "\n", encoding="utf-8")
    robot.write_text(robot.read_text(encoding="utf-8").replace(*error.described), encoding="utf-8")
    reference = home / "reference.tum"
    if reference.exists():
        poses = np.loadtxt(reference)
        error.poses(poses)
        np.savetxt(reference, poses, fmt="%.9f")


def run(data: Path, folder: Path) -> None:
    """Make and diagnose what is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = folder / "results.jsonl"
    done = {(one["error"], one["recording"]) for one in read_rows(rows)}
    for place, (name, error) in enumerate(ERRORS.items(), 1):
        for recording in _RUNS[error.robot]:
            if (name, recording) in done:
                continue
            home = folder / f"{place}-{Path(recording).stem}"
            write_case(error, data / recording, home)
            reference, signals = home / "reference.tum", home / "map.toml"
            found = diagnose(
                [home / "table.csv"],
                robot=home / "robot.toml",
                references=[reference] if reference.exists() else [],
                signals=signals if signals.exists() else None,
            )
            result = found.diagnosis.model_dump(mode="json")
            told = {
                "error": name,
                "recording": recording,
                "which": result["which"],
                "gap": result["gap"],
            }
            with rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps(told) + "\n")
            print(name, recording, result["verdict"], flush=True)


def _told(which: Sequence[Mapping[str, Any]], name: str) -> Mapping[str, Any] | None:
    """Return what the likeliest set that has a parameter says of it."""
    return next((one["parameters"][name] for one in which if name in one["parameters"]), None)


def page(folder: Path, commit: str) -> str:
    """Return the page: a row for each error."""
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in ERRORS}
    for one in read_rows(folder / "results.jsonl"):
        rows[one["error"]].append(one)
    lines = [
        "<!-- Written by benchmarks/known_errors.py; run that again instead of editing. -->",
        "",
        "# Errors of known size on real robots",
        "",
        "Of three [public recordings](../how-to/recordings.md), each with an error made up on top",
        "of the robot's own. Those nobody knows; what can be checked is by how much the answer",
        "moves. Where that is more than was made up, look at what else moved: a lag of the gyro",
        "that is told as delay beside a longer one, or what both wheels are off by, told as",
        "payload once one of them is off more.",
        f"Commit {commit}, {date.today()}:",
        "",
        "    python benchmarks/known_errors.py run --data DIR --results RESULTS",
        "",
        "## A robot under OptiTrack",
        "",
        "Each error on five runs: three free drives, a square, circles. *Named*: a set of the",
        "group that the answer gives has it.",
        "",
        "| made up | named in | moved by: mean (least to most) | made up by | group, mean |",
        "| --- | --- | --- | --- | --- |",
    ]
    own = {
        one["recording"]: one["which"]
        for name, error in ERRORS.items()
        for one in rows[name]
        if not error.parameters
    }
    for name, error in ERRORS.items():
        if error.robot == _OPTITRACK and rows[name]:
            lines.append(_row_of_runs(name, error, rows[name], own))
    lines += [
        "",
        "## A Kobuki and a lawnmower",
        "",
        "*Moved by*: the 95 % interval less the estimate without the made-up error.",
        "",
        "| robot | made up | told | group | moved by | by | gap before, after, floor |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for name, error in ERRORS.items():
        if error.robot != _OPTITRACK:
            lines += [_row(name, error, one, own[one["recording"]]) for one in rows[name]]
    return "\n".join([*lines, ""])


def _row_of_runs(
    name: str,
    error: Error,
    rows: Sequence[Mapping[str, Any]],
    own: Mapping[str, Sequence[Mapping[str, Any]]],
) -> str:
    """Return what the answers to several recordings with one error have in common."""
    group = f"{np.mean([one['which'][0]['group_probability'] for one in rows]):.2f}"
    if not error.parameters:
        shared = set.intersection(*(set(one["which"][0]["effects"]) for one in rows))
        told = f"{'`, `'.join(sorted(shared))}"
        return f"| nothing | – | in all: `{told}` | – | {group} |"
    named = 0
    moves: dict[str, list[float]] = {}
    for one in rows:
        best = one["which"][0]
        sets = {name for some in (best["effects"], *best["ambiguous_with"]) for name in some}
        named += any(key.partition(".")[0] in sets for key in error.parameters)
        told_by = {key: found for key in error.parameters if (found := _told(one["which"], key))}
        if told_by:
            key, found = next(iter(told_by.items()))
            before = _told(own[one["recording"]], key)
            at_first = 0.0 if before is None else before["estimate"]
            moves.setdefault(key, []).append(found["estimate"] - at_first)
    moved = "; ".join(
        f"`{key}` {np.mean(values):.3g} ({min(values):.3g} to {max(values):.3g})"
        for key, values in moves.items()
        if not math.isnan(error.parameters[key])
    )
    made_up = ", ".join(f"{error.parameters[key]:.3g}" for key in moves if moved)
    return f"| {name} | {named} of {len(rows)} | {moved or '–'} | {made_up or '–'} | {group} |"


def _row(name: str, error: Error, one: Mapping[str, Any], own: Sequence[Mapping[str, Any]]) -> str:
    best = one["which"][0]
    moved, made_up = "–", "–"
    told = {key: found for key in error.parameters if (found := _told(one["which"], key))}
    if told:
        key, found = next(iter(told.items()))
        before = _told(own, key)
        at_first = 0.0 if before is None else before["estimate"]
        low, high = (edge - at_first for edge in found["ci95"])
        moved = f"`{key}` {found['estimate'] - at_first:.4g} ({low:.4g} to {high:.4g})"
        made_up = f"{error.parameters[key]:.4g}"
    elif error.parameters:
        moved = "not told"
    group = f"{best['group_probability']:.2f}"
    cells = error.robot, name, "+".join(best["effects"]), group, moved, made_up
    return "| " + " | ".join([*cells, sizes_of(one["gap"])]) + " |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("run", "page"))
    parser.add_argument("--results", type=Path, required=True, metavar="DIR")
    parser.add_argument("--data", type=Path, metavar="DIR")
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path, metavar="PAGE")
    given = parser.parse_args(arguments)
    if given.what == "run":
        if given.data is None:
            parser.error("run needs --data")
        run(given.data, given.results)
    else:
        put_page(page(given.results, given.commit), given.out)


if __name__ == "__main__":
    main()
