"""How accurate drive, bus, codes and firmware are, given the right name.

    python benchmarks/accuracy_blocks.py run --rounds 60 --results DIR
    python benchmarks/accuracy_blocks.py page --results DIR --commit COMMIT --out PAGE

A round is one case of each effect, as `_ABOUT` tells. Results are appended to DIR/blocks.jsonl;
what is there already is not done again.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
import zlib
from collections import defaultdict
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a process for each core, not a thread

import numpy as np
from accuracy.drive_bounds import SMOOTH_DRIVE, bounds
from numpy.typing import NDArray
from scipy.stats import chi2

from gap_diagnosis.bus import bus_block
from gap_diagnosis.codes import codes_block
from gap_diagnosis.drive import drive_block
from gap_diagnosis.drive.limits import limits_of_answers
from gap_diagnosis.firmware import firmware_block
from gap_diagnosis.hypothesis import Estimate
from gap_diagnosis.motion.counters import unwrapped
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import synthetic_recording
from gap_diagnosis.trials import drives
from gap_diagnosis.trials.draw import (
    draw_nominal,
    draw_surroundings,
    draw_values,
    scaled,
    world_of,
)
from gap_diagnosis.trials.robots import FAMILIAR, robot_text
from hil_harness.assembly import Wire, load_wire
from hil_harness.effects.model import EffectSetting, Value
from hil_harness.robot import Robot, load_robot

BLOCKS: Final[Mapping[str, tuple[str, ...]]] = {
    "drive": ("drive_gain", "drive_lag", "drive_delay", "drive_deadband", "drive_saturation",
              "drive_acceleration_limit"),
    "bus": ("frame_loss", "frame_duplication", "frame_reordering", "stale_producer",
            "frame_jitter", "frame_latency", "reception_stamp", "clock_skew", "bus_gap"),
    "codes": ("gyro_frozen", "gyro_saturation", "adc_stuck_bit", "adc_missing_code"),
    "firmware": ("firmware_truncation", "firmware_resolution", "coarse_trig_table",
                 "euler_integration", "stale_heading", "firmware_constant", "firmware_overflow",
                 "moving_calibration", "auto_zero", "fixed_tick_period", "blend_weight",
                 "missed_deadline"),
}  # fmt: skip

_ABOUT: Final = """\
How far the estimates of drive, bus, converter and firmware effects are off, and whether their
intervals hold what they promise, *given the right name*. For wheels, gyro and reference see
[Accuracy of the motion's estimates](accuracy.md).

Robot, drive and sizes are drawn as in the blind trials' stratum *field*, a gain, a lag and a delay
from 2 to 10 times their detection limits; the description's constants are off within their
tolerances, with micro-slip, warm-up and a sagging supply as there.

*RMS*: root mean square of error over Cramér–Rao bound, its 95 % interval beside it, where the
likelihood is smooth; it should be at most 1.2; ✗ marks what is surely larger. *Mean*: of error over
bound. The bound is, of a gain, a lag and a delay, that of whitened sensitivities at the log's own
noise levels, with gains and the other dynamics free within tolerance; of a share of events, the
binomial one of the frames or ticks in which an event shows; of a jitter, of whose delays no shape
is described, that of a sample's standard deviation.

*Exact*, *one step*: the share of cases in which a name or a whole number is right or off by one; an
edge of a window within half a tick or one; a threshold or a limit within 0.5 % or 1 %. A dead
band is told no finer than the rates that were commanded are apart; its interval says so.

*50 %*, *80 %*, *95 %*: of the true values, how many these intervals hold.

No bound stands beside what is told so exactly that rounding decides (constants and a tick's period,
which a replay tells to many digits; a clock's skew, of which 2 ppm are always allowed for), nor
beside a delay, a polling period and the length of bursts, which one or a few stamps tell.
`adc_offset`, `adc_gain` and `gyro_tilt` do to a log what `gyro_bias` and `gyro_scale` do, and are
told in one group with these, whose accuracy is theirs. A `setup_*` has no size; how often it is
named, the [blind trials](blind-trial.md) count.
"""

_EVENTS: Final = frozenset(
    {"frame_loss", "frame_duplication", "frame_reordering", "stale_producer", "missed_deadline"}
)
_STEP: Final[Mapping[str, float]] = {"start_s": 0.01, "stop_s": 0.01}
"""One tick of the clock."""
_THRESHOLDS: Final = frozenset({"limit", "rate", "threshold"})
_LEVELS: Final = (0.5, 0.8, 0.95)
_MOST: Final = 1.2
_TRIES: Final = 6
_KURTOSIS: Final = 9.0
"""Of an exponential distribution."""


def case(effect: str, number: int, wire: Wire, folder: Path) -> dict[str, Any] | None:
    """Return one result; None where no drive of a few gives the effect a place."""
    (name,) = (block for block, effects in BLOCKS.items() if effect in effects)
    for attempt in range(_TRIES):
        draw = np.random.default_rng([zlib.crc32(effect.encode()), number, attempt])
        text = robot_text(FAMILIAR, draw)
        if effect == "blend_weight":
            text = text.replace('"gyro"', '"blend"').replace('"wheel"', '"blend"')
        path = folder / "robot.toml"
        path.write_text(text, encoding="ascii")
        robot = load_robot(path)
        fastest = min(0.8, 14.0 * robot.plant.wheels.radius_m)
        kinds = (*drives.FAMILIAR, *drives.ONCE_FRESH)
        scenario = drives.drive(kinds[int(draw.integers(len(kinds)))], draw, fastest)
        truth = draw_values(effect, "field", world_of(scenario, robot, wire), draw)
        if effect == "blend_weight":  # no weight is more than 1
            most = 1.0 - robot.firmware.blend_weight
            truth["weight"] = min(float(truth["weight"]), most * float(draw.uniform(0.0, 1.0)))
        worlds = {
            **draw_nominal(robot, frozenset({effect}), "field", draw),
            **draw_surroundings(draw),
        }
        settings = [EffectSetting(one, tuple(v.items())) for one, v in worlds.items()]
        if effect in SMOOTH_DRIVE:
            without = synthetic_recording(robot, wire, scenario, settings, number + 1)
            truth = _about_limit(effect, truth, without, robot, draw)
        settings.append(EffectSetting(effect, tuple(truth.items())))
        recording = synthetic_recording(robot, wire, scenario, settings, number + 1)
        started = time.process_time()
        block: Any = _block(name, recording, robot, wire)
        if block is None or effect not in block.effects:
            continue
        fit = block.fit(frozenset({effect}))
        if fit.log_evidence < 3 and attempt < _TRIES - 1 and name in ("codes", "firmware"):
            continue  # a threshold that nothing crossed, a constant that the mode does not use
        bound = bounds(block, effect, truth) if effect in SMOOTH_DRIVE else {}
        bound |= _bus_bounds(effect, truth, recording)
        return {
            "block": name,
            "effect": effect,
            "number": number,
            "evidence": fit.log_evidence,
            "seconds": time.process_time() - started,
            "found": _compared(effect, truth, fit.parameters, bound),
        }
    return None


def _about_limit(
    effect: str,
    values: dict[str, Value],
    without: Recording,
    robot: Robot,
    draw: np.random.Generator,
) -> dict[str, Value]:
    """Return an effect of 2 to 10 times what can be detected of it."""
    block = drive_block(unwrapped(without, robot), robot)
    limit = limits_of_answers([] if block is None else [block])[effect]
    largest = max(abs(float(value)) for value in values.values())
    if limit is None:
        return values
    return scaled(effect, values, limit / largest * math.exp(draw.uniform(*np.log([2, 10]))))


def _block(name: str, recording: Recording, robot: Robot, wire: Wire) -> Any:
    match name:
        case "drive":
            return drive_block(unwrapped(recording, robot), robot)
        case "bus":
            return bus_block(recording, robot, wire)
        case "codes":
            return codes_block(recording, robot)
    return firmware_block(recording, robot, wire)


def _bus_bounds(effect: str, truth: Mapping[str, Value], recording: Recording) -> dict[str, float]:
    """Return the bounds of shares of events and of a jitter."""
    frame = str(truth.get("frame", ""))
    names = [frame] if frame in recording.frames else ["ENCODER", "IMU"]
    frames = sum(len(recording.frames[name].t_s) for name in names)
    if effect == "missed_deadline":
        frames = len(recording.tick)
    if effect == "stale_producer":  # a payload that would have been the same anyway shows nothing
        frames = sum(_changes(recording.frames[name].payload) for name in names)
    if effect in _EVENTS:
        share = float(truth["probability"]) * (1.0 / float(truth.get("burst", 1.0)))
        return {"probability": math.sqrt(share / frames) * float(truth.get("burst", 1.0))}
    return (
        {"sigma": float(truth["sigma"]) * math.sqrt((_KURTOSIS - 1) / (4 * frames))}
        if effect == "frame_jitter"
        else {}
    )


def _changes(payload: NDArray[np.uint64]) -> int:
    return int(np.count_nonzero(payload[1:] != payload[:-1]))


def _compared(
    effect: str,
    truth: Mapping[str, Value],
    found: Mapping[str, Estimate],
    bound: Mapping[str, float],
) -> dict[str, Any]:
    """Return truth, estimate, rank and bound of each parameter that was estimated."""
    truth = _as_named(effect, truth, found)
    result: dict[str, Any] = {}
    for name, value in truth.items():
        estimate = found.get(f"{effect}.{name}")
        if estimate is None:
            continue
        one: dict[str, Any] = {"truth": value, "value": estimate.value}
        if estimate.samples is not None and not isinstance(value, str):
            number = float(value)
            below = float(np.mean(estimate.samples < number))
            same = float(np.mean(estimate.samples == number))
            one |= {"rank": below + 0.5 * same, "sd": estimate.sd}
            if name in bound:
                one["over_bound"] = (float(estimate.value) - number) / bound[name]
        result[name] = one
    return result


def _as_named(
    effect: str, truth: Mapping[str, Value], found: Mapping[str, Estimate]
) -> dict[str, Value]:
    """Return the truth in the words of the answer: constants that leave the same bits are one."""
    values = dict(truth)
    told = found.get("firmware_constant.constant")
    if effect == "firmware_constant" and told is not None:
        pairs = ({"wheel_radius", "ticks_per_rev"}, {"gyro_sensitivity", "tick_period"})
        constant = str(values["constant"])
        if told.value != constant and {str(told.value), constant} in pairs:
            values["constant"] = told.value
            if "ticks_per_rev" in (constant, told.value) or "gyro_sensitivity" in (
                constant, told.value
            ):  # fmt: skip
                values["scale"] = 1 / (1 + float(values["scale"])) - 1
    return values


def run(names: list[str], rounds: int, folder: Path, until: str | None) -> None:
    """Run what is not there yet and append it."""
    out = folder / "blocks.jsonl"
    done = {(one["effect"], one["number"]) for one in _results(out)}
    wire = load_wire()
    with out.open("a", encoding="utf-8") as file, TemporaryDirectory() as place:
        for number in range(rounds):
            for effect in names:
                if until is not None and f"{datetime.now():%H:%M}" >= until:
                    return
                if (effect, number) not in done:
                    found = case(effect, number, wire, Path(place))
                    file.write(json.dumps(found or _nothing(effect, number)) + "\n")
                    file.flush()


def _nothing(effect: str, number: int) -> dict[str, Any]:
    return {"effect": effect, "number": number, "found": {}}


def _results(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def page(results: list[dict[str, Any]], commit: str) -> str:
    """Return the page as Markdown."""
    rows: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for one in results:
        for name, found in one["found"].items():
            rows[one["effect"], name].append(found)
    rounds = len({one["number"] for one in results})
    order = [effect for effects in BLOCKS.values() for effect in effects]
    keys = sorted(rows, key=lambda key: (order.index(key[0]), key[1]))
    pooled = [
        found["rank"] for found in (one for group in rows.values() for one in group)
        if "rank" in found and _moves(found)
    ]  # fmt: skip
    shares = " | ".join(f"{_held(pooled, level):.1%}" for level in _LEVELS)
    of_bound = [key for key in keys if any("over_bound" in one for one in rows[key])]
    small = [key for key in of_bound if _rms(rows[key])[0] <= _MOST]
    return "\n".join(
        [
            "<!-- Written by benchmarks/accuracy_blocks.py; run that again instead of editing. -->",
            "",
            "# Accuracy of the other estimates, as measured",
            "",
            _ABOUT,
            f"Measured on {datetime.now():%Y-%m-%d}, commit {commit}, with",
            "",
            f"    python benchmarks/accuracy_blocks.py run --rounds {rounds} --results DIR",
            "",
            f"At or below {_MOST}: {len(small)} of {len(of_bound)}.",
            "",
            "| effect | parameter | cases | RMS | 95 % | mean | exact | one step "
            "| 50 % | 80 % | 95 % |",
            "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
            *(_line(*key, rows[key]) for key in keys),
            f"| all | | {len(pooled)} | | | | | | {shares} |",
            "",
        ]
    )


def _rms(cases: list[dict[str, Any]]) -> tuple[float, float, float]:
    """Return the root mean square over the bound, and its 95 % interval."""
    over = np.array([one["over_bound"] for one in cases if "over_bound" in one])
    rms = math.sqrt(float(np.mean(over**2)))
    low, high = (math.sqrt(len(over) / chi2.ppf(p, len(over))) for p in (0.975, 0.025))
    return rms, rms * low, rms * high


def _line(effect: str, name: str, cases: list[dict[str, Any]]) -> str:
    cells = ["", "", "", "", ""]
    over = np.array([one["over_bound"] for one in cases if "over_bound" in one])
    if len(over):
        rms, low, high = _rms(cases)
        wrong = " ✗" if low > _MOST else ""
        cells[:3] = [f"{rms:.2f}{wrong}", f"{low:.2f} to {high:.2f}", f"{float(over.mean()):+.2f}"]
    steps = [_off_in_steps(name, one) for one in cases]
    known = np.array([one for one in steps if one is not None])
    if len(known):
        cells[3:] = [f"{float(np.mean(known <= 0.5)):.0%}", f"{float(np.mean(known <= 1.01)):.0%}"]
    ranks = [one["rank"] for one in cases if "rank" in one and _moves(one)]
    held = [f"{_held(ranks, level):.0%}" if ranks else "" for level in _LEVELS]
    return "| " + " | ".join([f"`{effect}`", f"`{name}`", str(len(cases)), *cells, *held]) + " |"


def _moves(one: Mapping[str, Any]) -> bool:
    """Tell whether an estimate is a number with an interval, not a whole number or a choice."""
    return not isinstance(one["truth"], int) and one.get("sd", 0.0) > 0


def _off_in_steps(name: str, one: Mapping[str, Any]) -> float | None:
    """Return by how many steps an answer is off; None for what has no steps."""
    truth, value = one["truth"], one["value"]
    if isinstance(truth, str) or isinstance(value, str):
        return 0.0 if str(truth) == str(value) else math.inf
    if isinstance(truth, int):
        return abs(float(value) - truth)
    if name in _THRESHOLDS:
        return float(abs(float(value) - truth) / (0.01 * abs(truth)))
    return None if name not in _STEP else abs(float(value) - float(truth)) / _STEP[name]


def _held(ranks: list[float], level: float) -> float:
    return float(np.mean(np.abs(np.array(ranks) - 0.5) <= 0.5 * level)) if ranks else math.nan


def main() -> None:
    """Run cases, or print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("what", choices=["run", "page"])
    parser.add_argument("--results", type=Path, required=True, help="folder of results")
    parser.add_argument("--rounds", type=int, default=60, help="cases of each effect")
    parser.add_argument("--effects", help="names, separated by commas; all without it")
    parser.add_argument("--until", help="HH:MM: begin no case after this time today")
    parser.add_argument("--out", type=Path, help="of the page")
    parser.add_argument("--commit", default="", help="that was measured, for the page")
    given = parser.parse_args()
    given.results.mkdir(parents=True, exist_ok=True)
    if given.what == "page":
        text = page(_results(given.results / "blocks.jsonl"), given.commit)
        if given.out is None:
            print(text)
        else:
            given.out.write_text(text, encoding="utf-8")
        return
    every = [effect for effects in BLOCKS.values() for effect in effects]
    names = given.effects.split(",") if given.effects else every
    run(names, given.rounds, given.results, given.until)


if __name__ == "__main__":
    main()
