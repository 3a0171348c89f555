"""`chiplog run`: the files that other programs rely on, and the same seed, the same bytes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import Chiplog

from chiplog.run_folder import OUR_FILES

pytestmark = pytest.mark.usefixtures("no_pictures")

SUM_ROUNDING = 1e-12  # the parts add up to this, component by component


@pytest.fixture
def run(chiplog: Chiplog, tmp_path: Path) -> Any:
    """Run two seconds of a scenario into a folder of its own; return the folder."""

    def call(name: str, *words: str) -> Path:
        said = chiplog("run", "--duration-s", "2", "--out", name, *words)
        assert said.err == ""
        assert said.status == 0
        return tmp_path / name

    return call


def summary_of(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return content


def test_a_run_writes_its_five_files_and_no_others(run: Any) -> None:
    assert {file.name for file in run("out").iterdir()} == set(OUR_FILES)


def test_without_out_the_folder_is_named_after_the_scenario(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    said = chiplog("run", "--scenario", "spin", "--duration-s", "1")
    assert said.out.splitlines()[-1] == "report   out/spin/report.html"
    assert (tmp_path / "out" / "spin" / "bus.log").exists()


def test_the_summary_holds_what_the_contract_names(run: Any) -> None:
    summary = summary_of(run("out", "--scenario", "straight", "--seed", "5"))
    assert summary["schema"] == 1
    assert (summary["scenario"], summary["seed"], summary["time"]) == ("straight", 5, "lockstep")
    assert (summary["ticks"], summary["duration_s"]) == (200, 2.0)
    assert summary["realtime_factor"] > 0
    assert {"numpy", "python", "machine"} <= summary["versions"].keys()
    pose = {"x_m", "y_m", "heading_rad"}
    assert {name: set(p) for name, p in summary["final"].items()} == {
        "truth": pose,
        "float": pose,
        "firmware": pose,
    }
    error = pose | {"position_m"}
    assert {name: set(e) for name, e in summary["error"].items()} == {
        "total": error,
        "arithmetic": error,
        "model": error,
    }
    reasons = {"length", "crc", "counter", "range", "age", "unknown_id"}
    assert set(summary["bus"]) == {"frames", "load", "rejected"}
    assert set(summary["bus"]["rejected"]) == reasons
    assert set(summary["timing"]) == {
        "missed_deadlines",
        "jitter_us",
        "outages",
        "unsent_frames",
    }
    assert set(summary["timing"]["jitter_us"]) == {"p50", "p99", "max"}


def test_arithmetic_and_model_add_up_to_the_total(run: Any) -> None:
    error = summary_of(run("out"))["error"]
    for name in ("x_m", "y_m", "heading_rad"):
        parts = error["arithmetic"][name] + error["model"][name]
        assert parts == pytest.approx(error["total"][name], abs=SUM_ROUNDING)


def test_the_reference_ends_at_the_true_pose_and_starts_at_rest(run: Any) -> None:
    folder = run("out")
    rows = np.loadtxt(folder / "reference.tum")
    truth = summary_of(folder)["final"]["truth"]
    assert rows.shape == (200, 8)
    assert rows[0].tolist() == [0, 0, 0, 0, 0, 0, 0, 1]
    assert rows[-1, 1:3].tolist() == [truth["x_m"], truth["y_m"]]


def test_the_same_seed_gives_the_same_bytes_on_the_bus(run: Any) -> None:
    words = ("--scenario", "figure8", "--effect", "gyro_noise.density=0.001")
    first, second = run("first", *words), run("second", *words)
    other = run("other", *words, "--seed", "99")
    assert (first / "bus.log").read_bytes() == (second / "bus.log").read_bytes()
    assert (first / "bus.log").read_bytes() != (other / "bus.log").read_bytes()
    assert (first / "state.json").read_bytes() == (second / "state.json").read_bytes()


def test_the_command_line_overrides_a_file_of_effects(run: Any, tmp_path: Path) -> None:
    (tmp_path / "effects.toml").write_text("[gyro_bias]\nbias = 0.5\n")
    words = ("--scenario", "straight", "--effects", "effects.toml")
    folder = run("out", *words, "--effect", "gyro_bias.bias=0.25")
    assert summary_of(folder)["configuration"]["effects"] == ["gyro_bias.bias=0.25"]


def test_a_run_in_real_time_reports_how_punctual_it_was(chiplog: Chiplog) -> None:
    said = chiplog("run", "--time", "real", "--duration-s", "0.3", "--out", "out")
    assert said.status == 0
    assert "missed deadlines, late by" in said.out
