"""A study: what is asked, run once however often it is stopped, and answered with the cheapest."""

from __future__ import annotations

import csv
import importlib
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markupsafe import Markup

from chiplog.cli import main
from chiplog.pages.drawing import Picture
from chiplog.pages.study import study_page
from firmware_model import FirmwareDescription, KernelConfig, build_config
from firmware_model.cortex_m import Job
from firmware_model.cortex_m import measure as measure_cost
from hil_harness.assembly import load_wire
from hil_harness.nodes.firmware import firmware_config
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario
from precision_study import StudyError
from precision_study.budget import Asked
from precision_study.study import (
    Course,
    Outcome,
    Store,
    Study,
    build_points,
    cheapest,
    cost_table,
    drives,
    high_words,
    outcomes,
    pareto_front,
    parse_axis,
    parse_course,
    parse_requirement,
    run_study,
)
from precision_study.study.cost import Cost
from precision_study.study.drives import Drives, drive, drive_in_blocks
from precision_study.study.results import dbc_at_tick, robot_toml, rows
from precision_study.study.space import build, with_adc_bits
from precision_study.study.together import Family
from sim_plant import BLOCK_TICKS

ROBOT, WIRE = load_robot(None), load_wire()
AXES: dict[str, tuple[Any, ...]] = {
    "position.frac_bits": (12, 16, 20),
    "rounding": ("floor", "half_up"),
    "position.carry_remainder": (True, False),
}
KIND = "arithmetic position"


def small_study(**changes: Any) -> Study:
    points = tuple(build_points(ROBOT, AXES, WIRE.tick_period_us))
    scenarios = (scenario("lesson"), scenario("figure8"))
    asked = Study(ROBOT, WIRE, points, scenarios, (1, 2, 3), Course(distance_m=2.0))
    return replace(asked, **changes)


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave a page's pictures out: they take most of a small study, and here nobody looks."""

    def said(name: str, title: str, caption: str, *_: Any, **__: Any) -> Picture:
        return Picture(title, caption, Markup(""))

    monkeypatch.setattr("chiplog.pages.study_pictures.picture", said)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> list[Outcome]:
    study = small_study()
    with Store(tmp_path_factory.mktemp("study")) as store:
        run_study(study, store)
        return outcomes(study, store)


@pytest.mark.parametrize(
    ("text", "kind", "quantity", "limit"),
    [
        ("arithmetic position 5 mm after 100 m", "arithmetic", "position", 0.005),
        ("position 5e-1cm after 1 km", "arithmetic", "position", 0.005),
        ("total heading 2 deg after 10 min", "total", "heading", math.radians(2)),
        ("heading 3 µrad after 1 h", "arithmetic", "heading", 3e-6),
    ],
)
def test_a_requirement_is_read_as_it_is_said(
    text: str, kind: str, quantity: str, limit: float
) -> None:
    read = parse_requirement(text)
    assert (read.kind, read.quantity) == (kind, quantity)
    assert read.limit == pytest.approx(limit)
    assert read.course == parse_course(text.partition(" after ")[2])


def test_an_axis_counts_up_and_table_sizes_double() -> None:
    assert parse_axis("position.frac_bits=12..15,20") == (
        "position.frac_bits",
        (12, 13, 14, 15, 20),
    )
    assert parse_axis("firmware.trig.entries=64..300") == ("trig.entries", (64, 128, 256))
    assert parse_axis("mode=gyro,wheel") == ("mode", ("gyro", "wheel"))
    assert parse_axis("trig.interpolated=true,false")[1] == (True, False)


def test_every_axis_of_the_issue_reaches_robot_and_firmware() -> None:
    axes = {
        "rounding": ("floor",),
        "overflow": ("saturate",),
        "trig.entries": (64,),
        "trig.interpolated": (False,),
        "integration": ("midpoint",),
        "tick_rate_hz": (200,),
        "adc.bits": (12,),
        "position.word_bits": (48,),
    }
    (point,) = build_points(ROBOT, axes, 10_000)
    config = build(point, ROBOT)
    assert point.tick_period_us == 5_000
    assert (config.position_rounding, config.position_overflow, config.integration) == (0, 1, 1)
    assert (len(config.table), config.trig_interpolated) == (65, 0)
    assert config.position_high_q == 2**47 - 1
    assert config.gyro_max_code < 4096


def test_a_converter_with_fewer_bits_reads_the_same_rates_more_coarsely() -> None:
    coarse = with_adc_bits(ROBOT.plant, 12)
    ratio = ROBOT.plant.gyro.sensitivity_lsb_per_rad_s / coarse.gyro.sensitivity_lsb_per_rad_s
    assert ratio == 16
    assert coarse.gyro.zero_rate_code == 2048
    assert with_adc_bits(coarse, 16) == ROBOT.plant


def test_of_each_scenario_the_worst_counts_and_of_each_run_the_largest_error_on_the_way(
    found: list[Outcome],
) -> None:
    for one in found:
        assert one.error(KIND) == max(part.high[KIND] for part in one.scenarios)
        for part in one.scenarios:
            assert part.runs == 3
            assert part.high[KIND] >= part.final_rms[KIND]
            assert part.high[KIND] <= part.bound["position"]
            assert math.fsum(b for b, *_ in part.budget.values()) == part.bound["position"]


def test_the_front_holds_what_none_beats_and_beats_all_that_it_leaves_out(
    found: list[Outcome],
) -> None:
    def vector(one: Outcome) -> tuple[float, ...]:
        return one.cost.instructions_per_s, one.cost.memory_bytes, one.error(KIND)

    front = pareto_front(found, KIND)
    for one in found:
        beaten = any(
            all(a <= b for a, b in zip(vector(best), vector(one), strict=True)) for best in front
        )
        assert beaten
    assert len({vector(one) for one in front}) == len(front)


def test_the_cheapest_holds_with_its_margin_and_none_cheaper_does(found: list[Outcome]) -> None:
    asked = parse_requirement("arithmetic position 2 mm after 2 m")
    chosen = cheapest(found, asked, margin=2.0)
    assert chosen is not None
    assert chosen.error(KIND) * 2.0 <= asked.limit
    for one in found:
        if one.error(KIND) * 2.0 <= asked.limit:
            least = cost_table().about_equal * one.cost.instructions_per_s
            assert chosen.cost.instructions_per_s <= least
    assert cheapest(found, parse_requirement("position 1 nm after 2 m"), 1.0) is None


def lines(folder: Path) -> list[str]:
    path = folder / "runs.jsonl"
    return path.read_text().splitlines() if path.exists() else []


def test_a_study_that_is_stopped_goes_on_and_ends_as_if_it_had_not_been(
    tmp_path: Path, found: list[Outcome]
) -> None:
    class StopError(Exception):
        pass

    def stop(done: float, total: int) -> None:
        if len(lines(tmp_path)) >= total // 6:
            raise StopError

    study = small_study()
    with pytest.raises(StopError), Store(tmp_path) as store:
        run_study(study, store, stop)
    before = lines(tmp_path)
    assert 0 < len(before) < study.runs // 3
    with (tmp_path / "runs.jsonl").open("a") as file:
        file.write('{"unit":"cut off')
    told: list[float] = []
    with Store(tmp_path) as store:
        run_study(study, store, lambda done, total: told.append(done))
        assert rows(outcomes(study, store)) == rows(found)
    assert told[0] == 3 * len(before)
    after = lines(tmp_path)
    assert after[: len(before)] == before
    assert len({json.loads(line)["unit"] for line in after}) == len(after) == study.runs // 3


def test_a_study_with_more_seeds_runs_only_those(tmp_path: Path) -> None:
    for seeds in ((1, 2), (1, 2, 3)):
        with Store(tmp_path) as store:
            run_study(small_study(seeds=seeds), store)
    read = [json.loads(line)["seeds"] for line in lines(tmp_path)]
    assert sorted(read) == [[1, 2]] * 24 + [[3]] * 24


@pytest.mark.usefixtures("no_pictures")
def test_a_study_that_is_killed_loses_no_line_and_runs_none_twice(tmp_path: Path) -> None:
    words = ["study", "--sweep", "position.frac_bits=12..31", "--scenario", "lesson"]
    words += ["--seeds", "4", "--after", "10 m", "--workers", "1", "--out", str(tmp_path / "out")]
    process = subprocess.Popen([sys.executable, "-m", "chiplog", *words])
    while len(lines(tmp_path / "out")) < 3:
        assert process.poll() is None, "it ended before it could be killed"
        time.sleep(0.005)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    before = lines(tmp_path / "out")
    assert main(words) == 0
    after = lines(tmp_path / "out")
    assert after[: len(before)] == before
    assert len({json.loads(line)["unit"] for line in after}) == len(after) == 20


def test_the_command_finds_the_cheapest_and_export_c_takes_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest
) -> None:
    out = tmp_path / "out"
    words = ["study", "--sweep", "trig.entries=64,1024", "--sweep", "tick_rate_hz=100,200"]
    words += ["--scenario", "lesson", "--seeds", "2", "--out", str(out)]
    asked = ["--meet", "position 1 mm after 4 m"]
    assert main([*words, *asked, "--json", str(tmp_path / "answer.json")]) == 0
    said = capsys.readouterr().out
    assert "Cheapest that holds" in said
    answer = json.loads((tmp_path / "answer.json").read_text())
    (best,) = answer["cheapest"]
    assert (best["trig.entries"], best["tick_rate_hz"]) == (64, 100)
    with (out / "results.csv").open(newline="") as file:
        assert len(list(csv.DictReader(file))) == answer["configurations"] == 4
    assert main(["export-c", "--robot", str(out / "robot.toml"), "--out", str(tmp_path / "c")]) == 0
    assert load_robot(out / "robot.toml").firmware.trig.entries == 64
    page = (out / "study.html").read_text()
    assert page.count("<svg") >= 6
    assert "http" not in page.replace("http://www.w3.org", "").replace("http-equiv", "")
    request.getfixturevalue("no_pictures")
    assert main([*words, "--meet", "position 1 nm after 4 m"]) == 1
    assert "None of 4 configurations holds" in capsys.readouterr().out
    # Of what the sensors and the robot add to it, arithmetic is proved to be a small part.
    assert main([*words, "--meet", "total heading 90 deg after 4 m"]) == 0
    said = capsys.readouterr().out
    assert "Cheapest that holds “total heading 90 deg after 4 m”: trig.entries = 64" in said
    assert "no format changes the rest" in said


@pytest.mark.usefixtures("no_pictures")
def test_results_in_parquet_are_those_in_csv(tmp_path: Path) -> None:
    parquet = importlib.import_module("pyarrow.parquet")
    words = ["study", "--sweep", "rounding=floor,half_up", "--scenario", "lesson", "--seeds", "2"]
    words += ["--after", "2 m", "--out", str(tmp_path)]
    assert main(words) == main([*words, "--format", "parquet"]) == 0
    read = parquet.read_table(tmp_path / "results.parquet").to_pylist()
    with (tmp_path / "results.csv").open(newline="") as file:
        for ours, theirs in zip(read, csv.DictReader(file), strict=True):
            key = "high_arithmetic_position_m"
            assert ours["high"] == theirs["high"] == "largest of 2 seeds"
            assert ours[key] == float(theirs[key])


@pytest.mark.usefixtures("no_pictures")
def test_forced_configurations_run_and_their_overflows_are_counted_but_never_chosen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["study", "--sweep", "position.word_bits=34,48", "--scenario", "lesson"]
    words += ["--seeds", "2", "--out", str(tmp_path), "--meet", "position 1 mm after 8 m"]
    assert main(words) == 2
    assert "firmware.position.word_bits = 34" in capsys.readouterr().err
    assert not (tmp_path / "runs.jsonl").exists()
    assert main([*words, "--force"]) == 0
    said = capsys.readouterr().out
    assert "1 of 2 configurations overflow" in said
    assert re.search(r"configuration +overflows +runs", said)
    assert "Cheapest that holds “position 1 mm after 8 m”: position.word_bits = 48" in said


@pytest.mark.usefixtures("no_pictures")
def test_what_c_cannot_hold_is_run_by_force_and_counted_and_never_chosen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A step of 33 bits is as exact as one of 32 where both hold it; 2^-40 m overflow either."""
    words = ["study", "--sweep", "step.word_bits=32,33", "--sweep", "step.frac_bits=28,40"]
    words += ["--scenario", "straight", "--seeds", "1", "--out", str(tmp_path)]
    words += ["--meet", "position 1 mm after 1 m"]
    assert main(words) == 2
    assert not (tmp_path / "runs.jsonl").exists()
    assert main([*words, "--force"]) == 0
    said = capsys.readouterr().out
    assert "Cheapest that holds “position 1 mm after 1 m”: step.word_bits = 32, step.frac" in said
    assert "C cannot hold 2 of 4 configurations: these ran in Python" in said
    assert "2 of 4 configurations overflow" in said
    with (tmp_path / "results.csv").open(newline="") as file:
        in_c, in_python = [one for one in csv.DictReader(file) if one["step.frac_bits"] == "28"]
    for name in ("high_arithmetic_position_m", "expected_position_m", "overflows"):
        assert in_c[name] == in_python[name]


@pytest.mark.usefixtures("no_pictures")
def test_a_constant_of_zero_is_run_by_force_and_never_chosen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The gyro's, of a robot that does not use it: nothing overflows, and no C is made of it."""
    words = ["study", "--sweep", "gyro.sensitivity_frac_bits=4,30", "--sweep", "mode=wheel"]
    words += ["--sweep", "turn_step.frac_bits=20", "--sweep", "heading.frac_bits=16"]
    words += ["--sweep", "velocity.frac_bits=12", "--scenario", "straight", "--seeds", "1"]
    words += ["--out", str(tmp_path), "--meet", "position 1 m after 1 m"]
    assert main(words) == 2
    assert "rounds to zero" in capsys.readouterr().err
    assert main([*words, "--force"]) == 0
    cheapest = re.search(r"Cheapest that holds .*", capsys.readouterr().out)
    assert cheapest is not None
    assert "gyro.sensitivity_frac_bits = 30" in cheapest[0]
    assert main(["export-c", "--robot", str(tmp_path / "robot.toml"), "--out", str(tmp_path)]) == 0


@pytest.mark.usefixtures("no_pictures")
def test_a_table_without_room_is_run_by_force_and_never_chosen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["study", "--sweep", "trig.entries=16,64", "--table-bytes", "100", "--seeds", "1"]
    words += ["--scenario", "straight", "--out", str(tmp_path)]
    words += ["--meet", "position 1 mm after 2 m"]
    assert main(words) == 2
    assert "a table of 260 bytes does not fit --table-bytes 100" in capsys.readouterr().err
    assert main([*words, "--force"]) == 0
    assert "trig.entries = 16" in capsys.readouterr().out


@pytest.mark.usefixtures("no_pictures")
def test_what_effects_make_the_wheels_count_is_held_against_the_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Wheels 5 % smaller than described count 16.3 m of 15.5 m; the word holds 16 m."""
    monkeypatch.chdir(tmp_path)
    drive = 'name = "mine"\nduration_s = 60.0\n[[segments]]\nv_m_s = 0.5\nduration_s = 60.0\n'
    words = ["study", "--after", "15.5 m", "--seeds", "1", "--sweep", "position.word_bits=25"]
    words += ["--sweep", "position.frac_bits=20", "--scenario", "mine.toml"]
    Path("mine.toml").write_text(drive)
    assert main(words) == 0
    Path("mine.toml").write_text(f"{drive}[effects.radius_scale]\nscale = -0.05\n")
    capsys.readouterr()
    assert main(words) == 2
    said = capsys.readouterr().err
    assert "position.word_bits = 25: 16.3" in said
    assert "m by the wheels on mine do not fit with 20 fraction bits: expected at least 26" in said


def test_another_tick_has_its_dbc(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "dbc" / "chiplog.dbc").read_text()
    halved = dbc_at_tick(text, 10_000, 5_000)
    assert halved is not None
    path = tmp_path / "fast.dbc"
    path.write_text(halved)
    assert load_wire(path).tick_period_us == 5_000
    assert dbc_at_tick(text, 10_000, 2_500) is None


def test_a_chosen_robot_reads_back_as_it_was(tmp_path: Path) -> None:
    axes = {"adc.bits": (12,), "position.frac_bits": (17,), "mode": ("blend",)}
    (point,) = build_points(ROBOT, axes, 10_000)
    named = replace(ROBOT, name='a "name" with \\ and µ')
    path = tmp_path / "robot.toml"
    path.write_text(robot_toml(named, point, ["why"]), encoding="utf-8")
    again = load_robot(path)
    assert again.firmware == point.firmware
    assert again.plant == point.plant
    assert (again.name, again.tolerance) == (named.name, ROBOT.tolerance)


@pytest.mark.parametrize(
    "firmware",
    [
        {
            "mode": "blend",
            "stale_heading_ticks": 2,
            "turn_step": {"rounding": "half_even", "carry_remainder": False},
            "step": {"rounding": "toward_zero", "carry_remainder": False},
            "trig": {"method": "cordic", "iterations": 12, "rounding": "half_even"},
        },
        {
            "position": {"carry_remainder": False},
            "heading": {"frac_bits": 12, "rounding": "half_even", "carry_remainder": False},
            "trig": {"entries": 2048, "rounding": "half_even"},
        },
    ],
    ids=["choices that cost more together", "no bits between the entries"],
)
def test_the_cost_is_what_the_emulated_core_takes(firmware: dict[str, Any]) -> None:
    description = FirmwareDescription.from_table(firmware)
    config = firmware_config(replace(ROBOT, firmware=description), WIRE.signal_map, 10_000)
    tick = np.arange(4000)
    moves = (tick // 250) % 4 != 3
    speed = 0.6 * config.max_step_ticks * np.sin(tick / 300.0) * moves
    turn = 0.3 * config.max_step_ticks * np.sin(tick / 70.0) * moves
    inputs = np.zeros((len(tick), 5), dtype=np.int64)
    inputs[:, 0] = np.cumsum(np.rint(speed - turn).astype(np.int64))
    inputs[:, 1] = np.cumsum(np.rint(speed + turn).astype(np.int64))
    inputs[:, 3] = 32768 + np.rint(60.0 * turn).astype(np.int64) + (tick * 7919) % 5 - 2
    table = cost_table()
    measured = measure_cost(Job(config, inputs))
    said = table.cost(config)
    # The drive is the first part of the table's: its error, and as much again for the rest of it.
    assert said.instructions == pytest.approx(measured.instructions, rel=2 * table.largest_error)
    assert said.table_bytes == measured.table_bytes
    assert table.median_error <= table.high_error <= table.largest_error


def test_a_remainder_that_is_carried_costs_instructions_and_memory() -> None:
    def cost(**changes: dict[str, Any]) -> Cost:
        description = FirmwareDescription.from_table(changes)
        known = ROBOT.firmware_constants(WIRE.tick_period_us)
        return cost_table().cost(build_config(description, known))

    kept = cost()
    for name, words in (("position", 2), ("step", 1), ("heading", 1), ("turn_step", 2)):
        dropped = cost(**{name: {"carry_remainder": False}})
        assert dropped.instructions < kept.instructions - 1.0
        assert words <= kept.state_bytes - dropped.state_bytes <= 8 * words


def test_costs_that_the_table_cannot_tell_apart_count_as_equal(found: list[Outcome]) -> None:
    asked = parse_requirement("arithmetic position 1 m after 2 m")
    best = min(found, key=lambda one: one.error(KIND))
    smaller = replace(best.cost, state_bytes=best.cost.state_bytes - 1)
    for ratio, is_equal in ((0.999, True), (1.001, False)):
        rate = best.cost.instructions_per_s * cost_table().about_equal * ratio
        other = replace(best, cost=replace(smaller, instructions_per_s=rate))
        assert (cheapest([best, other], asked, 1.0) is other) == is_equal


@pytest.mark.parametrize(("name", "stale_ticks"), [("lesson", 0), ("random", 2)])
def test_a_drive_in_blocks_of_ticks_gives_what_the_whole_drive_gives(
    name: str, stale_ticks: int
) -> None:
    axes = {
        "mode": ("wheel", "gyro", "blend"),
        "rounding": ("floor", "toward_zero"),
        "carry_remainder": (True, False),
        "stale_heading_ticks": (stale_ticks,),
    }
    here = (ROBOT.plant, WIRE, WIRE.tick_period_us, Course(distance_m=25.0), (1, 2, 3))
    whole = drive(scenario(name), *here)
    parts = list(drive_in_blocks(scenario(name), *here, block_ticks=BLOCK_TICKS))
    assert len(parts) > 2
    np.testing.assert_array_equal(np.sum([one.ticks for one in parts], axis=0), whole.ticks)
    for field in ("left", "right", "gyro", "truth"):
        joined = np.concatenate([getattr(one, field) for one in parts], axis=1)
        np.testing.assert_array_equal(joined, getattr(whole, field))
    for point in build_points(ROBOT, axes, WIRE.tick_period_us):
        config = build(point, ROBOT)
        (once,) = run_over([whole], config)
        (again,) = run_over(parts, config)
        for cause, shares in once.pop("budget").items():
            bounds, expected = shares[::2], shares[1::2]
            assert again["budget"][cause][::2] == bounds
            # Sums over a drive in another order; what cancels leaves their last places.
            assert again["budget"][cause][1::2] == pytest.approx(expected, rel=1e-5, abs=1e-14)
        assert again["expected"] == pytest.approx(once.pop("expected"), rel=1e-9)
        assert {name: again[name] for name in once} == once


def test_the_expected_error_is_that_of_all_seeds_however_few_of_them_make_it() -> None:
    """On a straight course the wheels' heading is off in 5 of 32 drives, all of them late ones."""
    axes = {
        "mode": ("wheel",),
        "turn_step.frac_bits": (35,),
        "heading.frac_bits": (24,),
        "heading.rounding": ("toward_zero",),
    }
    (point,) = build_points(ROBOT, axes, WIRE.tick_period_us)
    seeds = (*range(101, 117), *range(1, 17))
    course = Course(distance_m=15.0)
    drives = drive(scenario("straight"), ROBOT.plant, WIRE, WIRE.tick_period_us, course, seeds)
    (found,) = run_over([drives], build(point, ROBOT))
    measured = np.array([found["arithmetic_position_m"], found["arithmetic_heading_rad"]])
    assert np.sqrt(np.mean(measured[1, :16] ** 2)) < 0.2 * np.sqrt(np.mean(measured[1] ** 2))
    # Along the drives themselves nothing is left to chance; products have more bits than float64.
    assert found["expected"] == pytest.approx(np.sqrt(np.mean(measured**2, axis=1)), rel=0.01)


def run_over(parts: list[Drives], config: KernelConfig) -> list[dict[str, Any]]:
    """Return the statistics of a configuration over drives that come in parts."""
    family = Family([config], len(parts[0].seeds))
    asked = Asked(config, len(parts[0].seeds))
    for part in parts:
        asked.add(part.left, part.right, part.gyro, part.ticks)
        family.add(part)
    return family.statistics(asked)


def test_memory_of_a_whole_study_grows_with_neither_ticks_nor_runs_nor_configurations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Blocks of ticks as small as they get: what is held for each tick is then soon more than them.
    monkeypatch.setattr(drives, "HELD_TICKS_OF_A_ROW", BLOCK_TICKS, raising=False)

    def peak_mb(seeds: int, duration_s: float, offsets: int) -> float:
        """Return the peak of a study of so many seeds and ticks, and 4 configurations an offset."""
        axes: dict[str, tuple[Any, ...]] = {
            "mode": ("gyro", "blend"),
            "stale_heading_ticks": (0, 1),
            "gyro.offset_frac_bits": tuple(range(8, 8 + offsets)),
        }
        study = small_study(
            points=tuple(build_points(ROBOT, axes, WIRE.tick_period_us)),
            scenarios=(scenario("random"),),
            seeds=tuple(range(seeds)),
            course=Course(duration_s=duration_s),
        )
        tracemalloc.start()
        with Store(tmp_path / f"{seeds} {duration_s} {offsets}") as store:
            run_study(study, store, workers=1)
            outcomes(study, store)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most / 1e6

    peak_mb(1, 10.0, 1)  # what is compiled and loaded once
    base_mb = peak_mb(8, 20.0, 2)
    assert peak_mb(8, 60.0, 2) < 1.2 * base_mb
    assert peak_mb(32, 20.0, 2) < 2.0 * base_mb  # 16 seeds are driven together
    # 16 more configurations add their results, a few numbers a seed, but not one column of ticks.
    column_mb = 16 * 8 * (20_000_000 // WIRE.tick_period_us) * 8 / 1e6
    assert peak_mb(8, 20.0, 6) < base_mb + 0.5 * column_mb


def test_a_99th_percentile_is_claimed_of_100_seeds_and_more_only(found: list[Outcome]) -> None:
    study = small_study()
    few = study_page(study, found, None, None, 1.0)
    assert few.count("99th percentile") == few.count("(100 would show the 99th percentile)") == 1
    assert few.count("largest of 3 seeds") > 2
    many = replace(study, seeds=tuple(range(100)))
    assert "largest of" not in study_page(many, found, None, None, 1.0)
    assert high_words(99) == "largest of 99 seeds"
    assert high_words(100) == "99th percentile of 100 seeds"


def test_names_on_the_page_are_escaped(found: list[Outcome]) -> None:
    study = small_study()
    bad = replace(scenario("lesson"), name="<script>x</script>")
    page = study_page(replace(study, scenarios=(bad,)), found, None, None, 1.0)
    assert "<script>x" not in page


def test_a_scenario_that_never_gets_there_is_refused() -> None:
    with pytest.raises(StudyError, match="never reaches"):
        drive(scenario("spin"), ROBOT.plant, WIRE, 10_000, Course(distance_m=1.0), (1,))
