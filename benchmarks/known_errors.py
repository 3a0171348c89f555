"""Errors of known size, made up on top of a real robot's own, and what a diagnosis says of them.

    python benchmarks/known_errors.py run --data DIR --results DIR
    python benchmarks/known_errors.py page --results DIR --commit COMMIT --out PAGE

`--data` holds `kobuki/nonfaulty` and `lawnmower/Plaza2_DR.txt` with its `.mat`
(examples/recordings/README.md says where they come from). A real robot is off in ways that nobody
knows: what can be checked is by how much an answer moves. `run` makes and diagnoses each case; what
RESULTS/results.jsonl holds already is not done again.
"""

from __future__ import annotations

import argparse
import json
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
_KOBUKI, _LAWNMOWER = "Kobuki", "lawnmower"


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
        late_s: what is added to the reference's stamps.
    """

    robot: str
    parameters: Mapping[str, float]
    options: tuple[str, ...] = ()
    table: Callable[[Table, Robot], None] = lambda table, robot: None
    described: tuple[str, str] = ("", "")
    late_s: float = 0.0


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
    "reference 0.4 s late": Error(_LAWNMOWER, {"reference_time_offset.offset": 0.4}, late_s=0.4),
}


def write_case(error: Error, data: Path, home: Path) -> None:
    """Write a recording's table, reference and robot with the error made up."""
    script, name = ("kobuki_table", "kobuki/nonfaulty")
    if error.robot == _LAWNMOWER:
        script, name = ("lawnmower_table", "lawnmower/Plaza2")
    subprocess.run(
        [sys.executable, _TABLES / f"{script}.py", data / name, home, *error.options],
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
        poses[:, 0] += error.late_s
        np.savetxt(reference, poses, fmt="%.9f")


def run(data: Path, folder: Path) -> None:
    """Make and diagnose what is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = folder / "results.jsonl"
    done = {one["error"] for one in read_rows(rows)}
    for place, (name, error) in enumerate(ERRORS.items(), 1):
        if name in done:
            continue
        home = folder / str(place)
        write_case(error, data, home)
        with_gps = error.robot == _LAWNMOWER
        found = diagnose(
            [home / "table.csv"],
            robot=home / "robot.toml",
            references=[home / "reference.tum"] if with_gps else [],
            signals=home / "map.toml" if with_gps else None,
        )
        result = found.diagnosis.model_dump(mode="json")
        told = {"error": name, "which": result["which"], "gap": result["gap"]}
        with rows.open("a", encoding="utf-8") as file:
            file.write(json.dumps(told) + "\n")
        print(name, result["verdict"], flush=True)


def _told(which: Sequence[Mapping[str, Any]], name: str) -> Mapping[str, Any] | None:
    """Return what the likeliest set that has a parameter says of it."""
    return next((one["parameters"][name] for one in which if name in one["parameters"]), None)


def page(folder: Path, commit: str) -> str:
    """Return the page: a row for each error."""
    rows = {one["error"]: one for one in read_rows(folder / "results.jsonl")}
    lines = [
        "<!-- Written by benchmarks/known_errors.py; run that again instead of editing. -->",
        "",
        "# Errors of known size on real robots",
        "",
        "Of two [public recordings](../how-to/recordings.md), each with an error made up on top of",
        "the robot's own. Those nobody knows; what can be checked is by how much the answer moves",
        "(its 95 % interval less the estimate without the made-up error). Where that is more than",
        "was made up, look at what else moved: a lag of the gyro that is told as delay beside a",
        "longer one, or what both wheels are off by, told as payload once one of them is off more.",
        f"Commit {commit}, {date.today()}:",
        "",
        "    python benchmarks/known_errors.py run --data DIR --results RESULTS",
        "",
        "| robot | made up | told | group | moved by | by | gap before, after, floor |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    own: Sequence[Mapping[str, Any]] = ()
    for name, error in ERRORS.items():
        if name in rows:
            own = own if error.parameters else rows[name]["which"]
            lines.append(_row(name, error, rows[name], own))
    return "\n".join([*lines, ""])


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
