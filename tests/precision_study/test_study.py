"""A study: what is asked, run once however often it is stopped, and answered with the cheapest."""

from __future__ import annotations

import csv
import importlib
import json
import math
import os
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

from chiplog.cli import main
from chiplog.pages.study import study_page
from firmware_model import FirmwareDescription
from firmware_model.cortex_m import Job
from firmware_model.cortex_m import measure as measure_cost
from hil_harness.assembly import load_wire
from hil_harness.nodes.firmware import firmware_config
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario
from precision_study import StudyError
from precision_study.study import (
    Course,
    Outcome,
    Store,
    Study,
    build_points,
    cheapest,
    cost_table,
    outcomes,
    pareto_front,
    parse_axis,
    parse_course,
    parse_requirement,
    run_study,
)
from precision_study.study.drives import drive
from precision_study.study.measure import measure
from precision_study.study.results import dbc_at_tick, robot_toml, rows
from precision_study.study.space import build, with_adc_bits

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
            least = 1.01 * one.cost.instructions_per_s
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

    def stop(done: int, total: int) -> None:
        if done >= total // 2:
            raise StopError

    study = small_study()
    with pytest.raises(StopError), Store(tmp_path) as store:
        run_study(study, store, stop)
    before = lines(tmp_path)
    assert 0 < len(before) < study.runs // 3
    with (tmp_path / "runs.jsonl").open("a") as file:
        file.write('{"unit":"cut off')
    told: list[int] = []
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
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
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
    assert main([*words, "--meet", "position 1 nm after 4 m"]) == 1
    assert "None of 4 configurations holds" in capsys.readouterr().out


def test_results_in_parquet_are_those_in_csv(tmp_path: Path) -> None:
    parquet = importlib.import_module("pyarrow.parquet")
    words = ["study", "--sweep", "rounding=floor,half_up", "--scenario", "lesson", "--seeds", "2"]
    words += ["--after", "2 m", "--out", str(tmp_path)]
    assert main(words) == main([*words, "--format", "parquet"]) == 0
    read = parquet.read_table(tmp_path / "results.parquet").to_pylist()
    with (tmp_path / "results.csv").open(newline="") as file:
        for ours, theirs in zip(read, csv.DictReader(file), strict=True):
            key = "p99_largest_arithmetic_position_m"
            assert ours[key] == float(theirs[key])


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
    assert "Cheapest that holds “position 1 mm after 8 m”: position.word_bits = 48" in said


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


def test_the_cost_is_what_the_emulated_core_takes() -> None:
    firmware = FirmwareDescription.from_table(
        {
            "mode": "wheel",
            "trig": {"rounding": "half_even", "entries": 64},
            "heading": {"rounding": "half_even"},
        }
    )
    config = firmware_config(replace(ROBOT, firmware=firmware), WIRE.signal_map, 10_000)
    tick = np.arange(4000)
    inputs = np.zeros((len(tick), 5), dtype=np.int64)
    inputs[:, 0] = np.cumsum(np.rint(60 * np.sin(tick / 300.0)).astype(np.int64))
    inputs[:, 1] = np.cumsum(np.rint(60 * np.sin(tick / 250.0)).astype(np.int64))
    inputs[:, 3] = 32768 + (tick * 7919) % 5
    table = cost_table()
    measured = measure_cost(Job(config, inputs)).instructions
    # The drive is another one than that of the table: as much again as choices depend on others.
    assert table.instructions(firmware) == pytest.approx(measured, rel=2 * table.largest_error)


def test_memory_grows_with_neither_runs_nor_ticks_beyond_the_drives() -> None:
    config = firmware_config(ROBOT, WIRE.signal_map, 10_000)

    def peak(distance_m: float, seeds: int) -> int:
        course = Course(distance_m=distance_m)
        those = drive(scenario("lesson"), ROBOT.plant, WIRE, 10_000, course, tuple(range(seeds)))
        tracemalloc.start()
        measure(config, those)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    # A stretch is 8,192 ticks of all rows together, some 20 words each.
    largest = 8_192 * 8 * 40 + 1_000_000
    assert peak(10.0, 8) < largest
    assert peak(100.0, 8) < largest
    assert peak(10.0, 64) < largest


def test_names_on_the_page_are_escaped(found: list[Outcome]) -> None:
    study = small_study()
    bad = replace(scenario("lesson"), name="<script>x</script>")
    page = study_page(replace(study, scenarios=(bad,)), found, None, None, 1.0)
    assert "<script>x" not in page


def test_a_scenario_that_never_gets_there_is_refused() -> None:
    with pytest.raises(StudyError, match="never reaches"):
        drive(scenario("spin"), ROBOT.plant, WIRE, 10_000, Course(distance_m=1.0), (1,))
