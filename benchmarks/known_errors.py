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

from gap_diagnosis.diagnose import diagnose

Floats = NDArray[np.float64]
Table = dict[str, Floats]

_TABLES: Final = Path(__file__).parent.parent / "examples" / "recordings"
_KOBUKI, _LAWNMOWER = "Kobuki", "lawnmower"
_CODES_PER_RAD_S: Final = 6548.089
_WRAPS_AT: Final = 65536


@dataclass(frozen=True)
class Error:
    """What is made up, and what it should change.

    Attributes:
        robot: whose recording.
        parameters: those that may tell it, each with the value it should move by: the likeliest set
            that has one of them is looked at. None: nothing is made up.
        table: changes the columns of the table.
        described: text of robot.toml and what stands there instead.
        late_s: what is added to the reference's stamps.
    """

    robot: str
    parameters: Mapping[str, float]
    table: Callable[[Table], None] = lambda table: None
    described: tuple[str, str] = ("", "")
    late_s: float = 0.0


def _longer(*sides: str, times: float) -> Callable[[Table], None]:
    """Return what counts more of a wheel's way than it went."""

    def change(table: Table) -> None:
        for side in sides:
            table[f"{side}_m"] *= times

    return change


def _smaller_left(table: Table) -> None:
    counts = np.unwrap(table["left_ticks"], period=_WRAPS_AT)
    table["left_ticks"] = np.rint(counts[0] + (counts - counts[0]) / 0.97) % _WRAPS_AT


def _more_bias(table: Table) -> None:
    table["gyro_code"] += np.rint(0.02 * _CODES_PER_RAD_S)


def _later_gyro(table: Table) -> None:
    """Let each row have the reading of 0.1 s before, rounded as a code is."""
    t_s, code = table["t_s"], table["gyro_code"]
    there = np.isfinite(code)
    before = np.rint(np.interp(t_s - 0.1, t_s[there], code[there]))
    table["gyro_code"] = np.where(there, before, np.nan)


ERRORS: Final[dict[str, Error]] = {
    "nothing": Error(_KOBUKI, {}),
    "gyro reads 20 mrad/s more": Error(
        _KOBUKI, {"gyro_bias.bias": 0.02, "adc_inl.peak": 0.02 * _CODES_PER_RAD_S}, _more_bias
    ),
    "gyro 0.1 s later": Error(_KOBUKI, {"frame_latency.delay": 0.1}, _later_gyro),
    "left wheel 3 % smaller": Error(
        _KOBUKI, {"radius_mismatch.mismatch": 0.03, "payload.compression_left": 0.03}, _smaller_left
    ),
    "nothing at all": Error(_LAWNMOWER, {}),
    "left wheel 1.96 % smaller": Error(
        _LAWNMOWER,
        {"payload.compression_left": 0.0196, "radius_mismatch.mismatch": 0.0196},
        _longer("left", times=1.02),
    ),
    "both wheels 2.91 % smaller": Error(
        _LAWNMOWER,
        {"ticks_per_rev.scale": 0.03, "radius_scale.scale": -0.0291},
        _longer("left", "right", times=1.03),
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
        [sys.executable, _TABLES / f"{script}.py", data / name, home],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    rows = home / "table.csv"
    names = rows.read_text(encoding="utf-8").partition("\n")[0]
    columns = np.genfromtxt(rows, delimiter=",", skip_header=1).T
    table = dict(zip(names.split(","), columns, strict=True))
    error.table(table)
    lines = (
        ",".join("" if np.isnan(one) else f"{one:.9f}".rstrip("0").rstrip(".") for one in row)
        for row in zip(*table.values(), strict=True)
    )
    rows.write_text("\n".join([names, *lines]) + "\n", encoding="utf-8")
    robot = home / "robot.toml"
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
    done = {one["error"] for one in _read(rows)}
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


def _read(rows: Path) -> list[dict[str, Any]]:
    if not rows.exists():
        return []
    return [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()]


def _told(which: Sequence[Mapping[str, Any]], name: str) -> Mapping[str, Any] | None:
    """Return what the likeliest set that has a parameter says of it."""
    return next((one["parameters"][name] for one in which if name in one["parameters"]), None)


def page(folder: Path, commit: str) -> str:
    """Return the page: a row for each error."""
    rows = {one["error"]: one for one in _read(folder / "results.jsonl")}
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
        "| robot | made up | told | group | moved by | made up | gap before, after, floor |",
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
    gap = one["gap"] or {}
    sizes = ", ".join(
        "–" if gap.get(key) is None else f"{1e3 * gap[key]:.3g}"
        for key in ("before", "after", "floor")
    )
    unit = {"m": "mm", "rad": "mrad"}.get(gap.get("unit", ""), "")
    group = f"{best['group_probability']:.2f}"
    cells = error.robot, name, "+".join(best["effects"]), group, moved, made_up, f"{sizes} {unit}"
    return "| " + " | ".join(cells) + " |"


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
    elif given.out is not None:
        given.out.write_text(page(given.results, given.commit), encoding="utf-8")
    else:
        print(page(given.results, given.commit))


if __name__ == "__main__":
    main()
