"""What a diagnosis says of robots in PyBullet (`pip install pybullet`): causes, and none, on wheels
that are balls and on cylinders, whose contact wanders.

    python benchmarks/third_engine.py run --results DIR
    python benchmarks/third_engine.py page --results DIR --commit COMMIT --out PAGE

`run` makes and diagnoses each case; what DIR/results.jsonl holds already is not done again. A case
is right where the cause is in the reported group, alone, twins as one name.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core, not a thread

import numpy as np
from pybullet_world import (
    LAG_S,
    RADIUS_M,
    TICK_S,
    TRACK_M,
    Driven,
    Floats,
    World,
    calibrated,
    drive,
)
from results import put_page, read_rows, sizes_of

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.trials.truth import UNKNOWN, canonical

_LASTS_S: Final = 90.0
_COUNTS: Final = 4096
_CODES_PER_RAD_S: Final = 7505.747
_ZERO_CODE: Final = 32768
_GYRO_RAD_PER_SQRT_S: Final = 0.0002
_REFERENCE: Final = 0.0005
"""White noise of the reference: m and rad."""


@dataclass(frozen=True)
class Cause:
    """What is done to a robot, and what is right to say of it.

    Attributes:
        right: any of these; none: no gap.
        left: the left wheel's radius, as a share of the described.
        track: likewise of the distance of wheels.
        lag_s: of the motors.
        scale, bias_rad_s, gyro_lag_s: of the gyro.
        late_s: what the reference's stamps are late by.
        ahead_m: how far ahead of the axle the reference is measured.
    """

    right: tuple[tuple[str, ...], ...] = ((),)
    left: float = 1.0
    track: float = 1.0
    lag_s: float = LAG_S
    scale: float = 0.0
    bias_rad_s: float = 0.0
    gyro_lag_s: float = 0.0
    late_s: float = 0.0
    ahead_m: float = 0.0


CAUSES: Final[Mapping[str, Cause]] = {
    "none": Cause(),
    "left wheel 2 % smaller": Cause((("radius_mismatch", "radius_scale"), ("payload",)), left=0.98),
    "track 4 % wider": Cause((("wheelbase_scale",), ("turn_scrub",)), track=1.04),
    "motors that lag by 0.15 s": Cause((("drive_lag",),), lag_s=0.15),
    "gyro that reads 3 % more": Cause((("gyro_scale",),), scale=0.03),
    "gyro off by 4 mrad/s": Cause((("gyro_bias",),), bias_rad_s=0.004),
    "gyro that lags by 0.08 s": Cause((("gyro_lag",),), gyro_lag_s=0.08),
    "reference 0.04 s late": Cause((("reference_time_offset",),), late_s=0.04),
    "reference 3 cm ahead": Cause((("reference_lever_arm",),), ahead_m=0.03),
}
WHEELS: Final[Mapping[str, float]] = {
    "balls": 0.0,
    "cylinders, 1 cm": 0.01,
    "cylinders, 2 cm": 0.02,
}
DRIVES: Final = ("square", "figure eight", "mixed")


def legs_of(kind: str, seed: int) -> Iterator[tuple[float, float, float]]:
    """Yield (duration [s], v [m/s], w [rad/s]) of a drive that rests at both ends."""
    draw = np.random.default_rng(seed)
    left_s, turns = _LASTS_S - 6.0, 0
    yield 3.0, 0.0, 0.0
    while left_s > 0.0:
        sense = 1.0 if turns // 4 % 2 == 0 else -1.0
        parts = {
            "square": [(4.0, 0.4, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.8 * sense), (1.0, 0.0, 0.0)],
            "figure eight": [(8.0, 0.4, 0.8), (8.0, 0.4, -0.8), (2.0, 0.0, 0.0)],
            "mixed": [_some_leg(draw)],
        }[kind]
        for duration_s, v_m_s, w_rad_s in parts:
            lasts_s = round(min(duration_s, left_s), 2)
            left_s -= lasts_s
            if lasts_s > 0.0:
                yield lasts_s, v_m_s, w_rad_s
        turns += 1
    yield 3.0, 0.0, 0.0


def _some_leg(draw: np.random.Generator) -> tuple[float, float, float]:
    fast, slow = draw.uniform(0.2, 0.5), draw.uniform(0.2, 0.3)
    turn, spin = draw.choice([-1, 1]) * draw.uniform(0.4, 0.9), draw.uniform(-0.5, 0.5)
    kinds = [
        (4.0, fast, 0.0),
        (4.0, fast, turn),
        (3.0, 0.0, turn),
        (2.0, 0.0, 0.0),
        (3.0, -slow, spin),
    ]
    return kinds[draw.integers(len(kinds))]


def write_case(cause: Cause, width_m: float, kind: str, seed: int, home: Path) -> None:
    """Calibrate the robot without the cause, drive it with, and write what a lab would have."""
    home.mkdir(parents=True, exist_ok=True)
    world = World(width_m=width_m)
    rolls_m = calibrated(world, home)
    real = replace(
        world, left_m=cause.left * RADIUS_M, track_m=cause.track * TRACK_M, lag_s=cause.lag_s
    )
    seen = drive(real, legs_of(kind, seed), rolls_m, home)
    _write_table(cause, seen, np.random.default_rng([seed, 1]), home)
    _write_reference(cause, seen, np.random.default_rng([seed, 2]), home)
    (home / "robot.toml").write_text(
        f"[wheels]\nradius_m = {rolls_m[0]:.6f}\nwheelbase_m = {rolls_m[1]:.6f}\n"
        f"[encoder]\nticks_per_rev = {_COUNTS}\ncounter_bits = 32\n"
        f"[drive]\ntime_constant_s = {LAG_S}\nmax_wheel_acceleration_rad_s2 = 100\n"
        f"[gyro]\nsensitivity_lsb_per_rad_s = {_CODES_PER_RAD_S}\n"
        f"noise_density_rad_per_sqrt_s = {_GYRO_RAD_PER_SQRT_S}\n",
        encoding="utf-8",
    )


def _write_table(cause: Cause, seen: Driven, draw: np.random.Generator, home: Path) -> None:
    counts = np.floor(seen.angles * _COUNTS / math.tau + draw.normal(0, 0.05, seen.angles.shape))
    rate = np.diff(seen.pose[:, 2], prepend=0.0) / TICK_S * (1 + cause.scale) + cause.bias_rad_s
    rate = _lagging(rate, cause.gyro_lag_s)
    rate += draw.normal(0.0, _GYRO_RAD_PER_SQRT_S / math.sqrt(TICK_S), len(rate))
    codes = np.rint(_ZERO_CODE + _CODES_PER_RAD_S * rate)
    lines = ["t_s,left_ticks,right_ticks,gyro_code,v_command_m_s,w_command_rad_s"]
    for k, ((left, right), (v_m_s, w_rad_s)) in enumerate(zip(counts, seen.commands, strict=True)):
        lines.append(
            f"{k * TICK_S:.2f},{left:.0f},{right:.0f},{codes[k]:.0f},{v_m_s:.5f},{w_rad_s:.5f}"
        )
    (home / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _lagging(rate: Floats, lag_s: float) -> Floats:
    if lag_s == 0.0:
        return rate
    # Of a rate that is constant over a tick, what lags behind it exactly: its mean, and its end.
    stays = math.exp(-TICK_S / lag_s)
    behind = lag_s / TICK_S * (1.0 - stays)
    last, lagging = 0.0, np.zeros(len(rate))
    for k, one in enumerate(rate):
        lagging[k] = one + (last - one) * behind
        last = one + (last - one) * stays
    return lagging


def _write_reference(cause: Cause, seen: Driven, draw: np.random.Generator, home: Path) -> None:
    x_m, y_m, heading = (seen.pose + draw.normal(0.0, _REFERENCE, seen.pose.shape)).T
    x_m = x_m + cause.ahead_m * np.cos(seen.pose[:, 2])
    y_m = y_m + cause.ahead_m * np.sin(seen.pose[:, 2])
    stamps_s = np.arange(len(heading)) * TICK_S + cause.late_s
    rows = zip(stamps_s, x_m, y_m, np.sin(heading / 2), np.cos(heading / 2), strict=True)
    lines = [f"{t:.4f} {x:.6f} {y:.6f} 0 0 0 {qz:.9f} {qw:.9f}" for t, x, y, qz, qw in rows]
    (home / "reference.tum").write_text("\n".join(lines) + "\n", encoding="utf-8")


def run(folder: Path) -> None:
    """Make and diagnose what is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = folder / "results.jsonl"
    done = {(one["cause"], one["wheels"]) for one in read_rows(rows)}
    for place, (wheels, width_m) in enumerate(WHEELS.items()):
        for seed, (name, cause) in enumerate(CAUSES.items(), 1):
            if (name, wheels) in done:
                continue
            kind = DRIVES[(place + seed) % len(DRIVES)]
            home = folder / f"{place}-{seed}"
            write_case(cause, width_m, kind, seed, home)
            found = diagnose(
                [home / "log.csv"], robot=home / "robot.toml", references=[home / "reference.tum"]
            )
            result = found.diagnosis.model_dump(mode="json")
            best = result["which"][0]
            told = {
                "cause": name,
                "wheels": wheels,
                "drive": kind,
                "group": [best["effects"], *best["ambiguous_with"]],
                "probability": best["group_probability"],
                "gap": result["gap"],
            }
            with rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps(told) + "\n")
            print(name, wheels, kind, result["verdict"], flush=True)


def is_right(one: Mapping[str, Any]) -> bool:
    """Tell whether one of the right answers is in the reported group."""
    right = {canonical(names) for names in CAUSES[one["cause"]].right}
    if one["cause"] == "none" and WHEELS[one["wheels"]] > 0.0:
        right.add(UNKNOWN)  # what their contact does, no listed effect does
    group = {UNKNOWN if names == ["unknown"] else canonical(names) for names in one["group"]}
    return not group.isdisjoint(right)


def is_astray(one: Mapping[str, Any]) -> bool:
    """Tell whether names are given, surely, none of which is right."""
    return not is_right(one) and one["probability"] >= 0.8 and one["group"][0] != ["unknown"]


def page(folder: Path, commit: str) -> str:
    """Return the page: a row for each case, and how many were right on each kind of wheels."""
    rows = read_rows(folder / "results.jsonl")
    rows.sort(key=lambda one: (list(WHEELS).index(one["wheels"]), list(CAUSES).index(one["cause"])))
    lines = [
        "<!-- Written by benchmarks/third_engine.py; run that again instead of editing. -->",
        "",
        "# Robots in a third engine",
        "",
        "Drives of 90 s in PyBullet, written as a stranger would, each robot described by what a",
        "straight and a spin in that engine give. Balls touch the floor in a point, as the plant's",
        "wheels do. Cylinders touch it with an edge or both: what they roll on changes by 1 %",
        "from turn to turn, which no listed effect does, and which is there in *none* too: that is",
        "unlisted there rightly, and in a figure eight, which always turns, it is a constant.",
        f"Commit {commit}, {date.today()}:",
        "",
        "    pip install pybullet",
        "    python benchmarks/third_engine.py run --results DIR",
        "",
        "| wheels | cases | right in the group | unlisted | wrong names at 0.8 and more |",
        "| --- | --- | --- | --- | --- |",
    ]
    for wheels in WHEELS:
        own = [one for one in rows if one["wheels"] == wheels]
        unlisted = sum(one["group"][0] == ["unknown"] for one in own)
        lines.append(
            f"| {wheels} | {len(own)} | {sum(map(is_right, own))} | {unlisted} | "
            f"{sum(map(is_astray, own))} |"
        )
    lines += [
        "",
        "| wheels | drive | cause | told | probability | gap before, after, floor | |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(_row(one) for one in rows),
        "",
    ]
    return "\n".join(lines)


def _row(one: Mapping[str, Any]) -> str:
    names = " or ".join("+".join(names) for names in one["group"][:3])
    names += f" and {len(one['group']) - 3} more" if len(one["group"]) > 3 else ""
    verdict = "" if is_right(one) else "WRONG" if is_astray(one) else "not found"
    cells = one["wheels"], one["drive"], one["cause"], names, f"{one['probability']:.3f}"
    return "| " + " | ".join([*cells, sizes_of(one["gap"]), verdict]) + " |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("run", "page"))
    parser.add_argument("--results", type=Path, required=True, metavar="DIR")
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path, metavar="PAGE")
    given = parser.parse_args(arguments)
    if given.what == "run":
        run(given.results)
    else:
        put_page(page(given.results, given.commit), given.out)


if __name__ == "__main__":
    main()
