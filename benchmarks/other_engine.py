"""What a diagnosis says of physical causes in another engine's physics (MuJoCo, an extra).

    python benchmarks/other_engine.py run --seeds 1 2 3 --results DIR
    python benchmarks/other_engine.py page --results DIR --commit COMMIT --out PAGE

`run` makes each cause of `gap_diagnosis.trials.mujoco_cases` with each seed and diagnoses it; what
DIR/results.jsonl holds already is not done again. A case is right where the answer that the
engine's own state calls for is in the reported group, twins as one name.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any, Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core, not a thread

from results import put_page, read_rows

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.priors import default_prior
from gap_diagnosis.trials.drives import FAMILIAR, NEW
from gap_diagnosis.trials.layout import LOG, REFERENCE, ROBOT
from gap_diagnosis.trials.mujoco_cases import CAUSES, write_case
from gap_diagnosis.trials.truth import UNKNOWN, Answer, canonical
from gap_diagnosis.trials.yardsticks import share
from hil_harness.robot import load_robot

_RESULTS: Final = "results.jsonl"
_SLID: Final = 0.002
"""Of the time that wheels move: where they slid less than that, and came no other way than the
other wheel beyond tolerance, ice was not met."""

_SEEN: Final = 1.2
"""A gap of so many floors can be seen."""

RIGHT: Final[Mapping[str, tuple[Sequence[str], ...]]] = {
    "null": ((),),
    "small_wheels": (("radius_scale",),),
    "small_right_wheel": (("radius_scale", "radius_mismatch"),),
    "wide_track": (("wheelbase_scale",),),
    "icy_patch": (("one_sided_slip",), ("unknown",)),
    "load_on_the_left": (("radius_scale", "radius_mismatch"),),
    "soft_tyres": (("lateral_slip",),),
    "tilted_floor": (("cross_slope_drift",), ("grade_slip",), ("cross_slope_drift", "grade_slip")),
    "weak_motors": (("drive_acceleration_limit",), ("drive_saturation",)),
    "scrubbing_tyres": (("lateral_slip", "turn_scrub"), ("lateral_slip", "wheelbase_scale")),
}
"""By cause, the answers any of which is right; ice that a wheel meets again and again has no name
in the library, and where it is met not at all nothing is. On a slope that it does not drift down a
robot on soft tyres does no more than slip outward in turns. Wide tyres are soft ones too."""

SIZES: Final[Mapping[str, str]] = {
    "radius_scale.scale": "radius_scale",
    "ticks_per_rev.scale": "ticks_per_rev",
    "radius_mismatch.mismatch": "radius_mismatch",
    "wheelbase_scale.scale": "wheelbase_scale",
    "lateral_slip.compliance": "lateral_slip",
}
"""By parameter, what the engine's state calls it."""


def run(seeds: Sequence[int], folder: Path) -> None:
    """Make and diagnose what is not there yet."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = folder / _RESULTS
    done = {(one["cause"], one["seed"]) for one in read_rows(rows)}
    kinds = (*FAMILIAR, *NEW)
    for seed in seeds:
        for place, cause in enumerate(CAUSES):
            if (cause, seed) in done:
                continue
            home = folder / f"{cause}-{seed}"
            shutil.rmtree(home, ignore_errors=True)  # begun, and not ended
            made = write_case(cause, seed, home, kind=kinds[(place + seed) % len(kinds)])
            told = _diagnosed(home)
            with rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps({**made, "told": told}) + "\n")
            print(cause, seed, told["verdict"], flush=True)


def _diagnosed(home: Path) -> dict[str, Any]:
    found = diagnose([home / LOG], robot=home / ROBOT, references=[home / REFERENCE])
    result = found.diagnosis.model_dump(mode="json")
    best = result["which"][0]
    kept = ("verdict", "stage", "gap", "seconds")
    return {name: result[name] for name in kept} | {
        "group": [best["effects"], *best["ambiguous_with"]],
        "probability": best["group_probability"],
        "parameters": best["parameters"],
    }


def right_answers(one: Mapping[str, Any]) -> set[Answer]:
    """Return what may be said of a case, by its cause and by what the engine did."""
    truth = one["truth"]
    crept = abs(truth["radius_mismatch"]) > load_robot().tolerance.radius_mismatch
    slid = max(truth["slides_left"], truth["slides_right"]) > _SLID
    if one["cause"] == "icy_patch" and not (slid or crept):
        return {canonical(())}
    if one["cause"] == "tilted_floor" and not _drifts(truth):
        return {canonical(()), canonical(("lateral_slip",))}
    return {
        UNKNOWN if tuple(names) == ("unknown",) else canonical(names)
        for names in RIGHT[one["cause"]]
    }


def _drifts(truth: Mapping[str, float]) -> bool:
    """Tell whether a robot drifts down a slope, across it or along it, by more than its tolerance:
    else nothing need be told of the slope."""
    prior = default_prior()
    return any(
        abs(truth[effect]) > (prior.tolerance(effect, "ratio") or 0.0)
        for effect in ("cross_slope_drift", "grade_slip")
    )


def is_hidden(one: Mapping[str, Any]) -> bool:
    """Tell whether nothing was told of a cause that moves the robot by no more than noise does
    (docs/design.md, section 5: no gap is closed below 1.2 floors)."""
    gap = one["told"]["gap"]
    is_quiet = one["told"]["verdict"] == "no_gap" and gap is not None and one["cause"] != "null"
    return is_quiet and bool(gap["before"] < _SEEN * gap["floor"])


def is_right(one: Mapping[str, Any]) -> bool:
    """Tell whether one of the right answers is in the reported group."""
    group = {
        UNKNOWN if names == ["unknown"] else canonical(names) for names in one["told"]["group"]
    }
    return not group.isdisjoint(right_answers(one))


def page(folder: Path, commit: str) -> str:
    """Return the page: a row for each case, and how many were right."""
    rows = sorted(
        read_rows(folder / _RESULTS), key=lambda one: (list(RIGHT).index(one["cause"]), one["seed"])
    )
    shown = [one for one in rows if not is_hidden(one)]
    right = share([is_right(one) for one in shown])
    lines = [
        "<!-- Written by benchmarks/other_engine.py; run that again instead of editing. -->",
        "",
        "# Physical causes in another engine",
        "",
        "Robots in MuJoCo, which shares no code with the simulated plant: a smaller wheel is a",
        "smaller wheel there, ice a patch of little friction, a load a body off the middle. Each",
        "robot is described by what a calibration drive in that engine gives. *Truth* is what the",
        "engine did, measured from its state; of ice, the share of the time in which a wheel slid.",
        "On the tilted floor it is how much of its way the robot drifts downhill, and its outward",
        "slip in turns. *Floor* is what noise alone leaves of the gap.",
        "",
        f"**{sum(map(is_right, shown))} of {len(shown)} right** "
        f"({right.low:.2f} to {right.high:.2f}); in {len(rows) - len(shown)} more the cause moves",
        f"the robot by less than {_SEEN} times what noise does, and no gap was told. "
        f"Commit {commit}, {date.today()}:",
        "",
        f"    python benchmarks/other_engine.py run --seeds {_seeds(rows)} --results DIR",
        "",
        "| cause | drive | told | probability | truth, and what was told of it | gap | |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(_row(one) for one in rows),
        "",
    ]
    return "\n".join(lines)


def _seeds(rows: Sequence[Mapping[str, Any]]) -> str:
    return " ".join(str(seed) for seed in sorted({one["seed"] for one in rows}))


def _row(one: Mapping[str, Any]) -> str:
    told = one["told"]
    names = " or ".join("+".join(names) for names in told["group"][:3])
    names += f" and {len(told['group']) - 3} more" if len(told["group"]) > 3 else ""
    cells = (
        one["cause"].replace("_", " "),
        one["drive"],
        names,
        f"{told['probability']:.3f}",
        "; ".join(_sizes(one)) or "–",
        _gap(told["gap"]),
        "not to be seen" if is_hidden(one) else "" if is_right(one) else "WRONG",
    )
    return "| " + " | ".join(cells) + " |"


def _sizes(one: Mapping[str, Any]) -> list[str]:
    """Return true and told sizes, told ones with their 95 % interval."""
    truth, found = dict(one["truth"]), []
    truth["ticks_per_rev"] = 1 / (1 + truth["radius_scale"]) - 1  # its twin
    if one["cause"] == "icy_patch":
        found.append(f"slid {truth['slides_left']:.1%} left, {truth['slides_right']:.1%} right")
    if one["cause"] == "tilted_floor":
        across, along = truth["cross_slope_drift"], truth["grade_slip"]
        found.append(
            f"drifts {across:.2%} across, {along:.2%} along; slips {truth['lateral_slip']:.4f} s"
        )
    parameters = one["told"]["parameters"]
    # The engine's state has no size of a slip angle.
    without = parameters.get("lateral_slip.speed", {}).get("estimate", 0) != 0
    for name, told in parameters.items():
        if without and name.startswith("lateral_slip."):
            continue
        if name in SIZES and "ci95" in told:
            low, high = told["ci95"]
            true = truth[SIZES[name]]
            found.append(f"{name} {true:.5f}: {told['estimate']:.5f} ({low:.5f} to {high:.5f})")
    return found


def _gap(gap: Mapping[str, Any] | None) -> str:
    if gap is None:
        return "–"
    unit = {"m": (1e3, "mm"), "rad": (1e3, "mrad"), "s": (1e3, "ms")}.get(gap["unit"], (1.0, ""))
    before, after, floor = (
        "–" if gap[key] is None else f"{gap[key] * unit[0]:.3g}"
        for key in ("before", "after", "floor")
    )
    return f"{before} → {after} {unit[1]} (floor {floor})"


def main() -> None:
    """Run, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("run", "page"))
    parser.add_argument("--results", type=Path, required=True, metavar="DIR")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--commit", default="unknown")
    parser.add_argument("--out", type=Path, metavar="PAGE")
    given = parser.parse_args()
    if given.what == "run":
        run(given.seeds, given.results)
    else:
        put_page(page(given.results, given.commit), given.out)


if __name__ == "__main__":
    main()
