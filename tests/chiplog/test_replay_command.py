"""`chiplog replay`: equal is 0; a difference is 1, with tick, field and both raw values."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from command_line import Chiplog

from can_bus import load_database

pytestmark = pytest.mark.usefixtures("no_pictures")


@pytest.fixture
def log(chiplog: Chiplog, tmp_path: Path) -> Path:
    """Record a second of the lesson."""
    assert chiplog("run", "--duration-s", "1", "--out", "out").status == 0
    return tmp_path / "out" / "bus.log"


def test_our_own_log_is_equal_bit_for_bit(log: Path, chiplog: Chiplog) -> None:
    said = chiplog("replay", str(log))
    assert said.status == 0
    assert re.fullmatch(r"equal, bit for bit: [\d,]+ raw values in 100 ticks\n", said.out)


def test_the_replayed_kernel_ends_in_the_recorded_state(log: Path, chiplog: Chiplog) -> None:
    chiplog("replay", str(log), "--json", "replay.json")
    replayed = json.loads((log.parents[1] / "replay.json").read_text())
    assert replayed["state"] == json.loads((log.parent / "state.json").read_text())
    assert replayed["equal"] is True
    assert replayed["first_difference"] is None


def test_one_bit_of_odometry_is_found(log: Path, chiplog: Chiplog) -> None:
    spec = load_database().message("ODOMETRY_Y")
    frame = f"{spec.frame_id:03X}#"
    lines = log.read_text().splitlines()
    at = [index for index, line in enumerate(lines) if frame in line][40]
    head, data = lines[at].split("#")
    last = int(data[14:16], 16) ^ 1  # the top byte of y
    lines[at] = f"{head}#{data[:14]}{last:02X} T"
    log.write_text("\n".join(lines) + "\n")
    said = chiplog("replay", str(log), "--json", "replay.json")
    assert said.status == 1
    assert re.fullmatch(
        r"differs at tick 40: ODOMETRY_Y\.y_m is -?\d+ in the log, -?\d+ in the replay\n", said.out
    )
    difference = json.loads((log.parents[1] / "replay.json").read_text())["first_difference"]
    assert (difference["tick"], difference["field"]) == (40, "ODOMETRY_Y.y_m")
    assert difference["logged_raw"] != difference["computed_raw"]


def test_frames_that_a_log_has_not_are_named_in_both_answers(log: Path, chiplog: Chiplog) -> None:
    frame = f" {load_database().message('ODOMETRY_Y').frame_id:03X}#"
    lines = log.read_text().splitlines(keepends=True)
    log.write_text("".join(line for line in lines if frame not in line))
    nothing = "; nothing of ODOMETRY_Y to compare: the log has no such frames\n"
    equal = chiplog("replay", str(log))
    assert (equal.status, equal.out.startswith("equal, bit for bit: ")) == (0, True)
    assert equal.out.endswith(nothing)
    (log.parent / "other.toml").write_text("schema = 1\n[wheels]\nradius_m = 0.0503\n")
    other = chiplog("replay", str(log), "--robot", "out/other.toml", "--json", "replay.json")
    assert (other.status, other.out.startswith("differs at tick ")) == (1, True)
    assert other.out.endswith(nothing)
    assert json.loads((log.parents[1] / "replay.json").read_text())["missing"] == ["ODOMETRY_Y"]


def test_json_on_standard_output_is_all_there_is(log: Path, chiplog: Chiplog) -> None:
    said = chiplog("replay", str(log), "--json", "-")
    assert json.loads(said.out)["ticks"] == 100


def test_a_log_of_words_that_overflow_is_replayed_by_force_alone(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    (tmp_path / "narrow.toml").write_text("[firmware.step]\nword_bits = 16\n")
    robot = ("--robot", "narrow.toml")
    ran = chiplog("run", "--duration-s", "0.5", "--out", "out", "--force", *robot)
    refused = chiplog("replay", "out/bus.log", *robot)
    assert refused.status == 2
    assert "firmware.step.frac_bits = 28" in refused.err
    said = chiplog("replay", "out/bus.log", "--force", "--json", "replay.json", *robot)
    assert said.status == 0
    count = json.loads((tmp_path / "replay.json").read_text())["state"]["overflow_count"]
    assert count > 0
    assert said.out.endswith(f"in 50 ticks; {count} overflows of a word\n")
    assert f"{count} overflows of a word" in ran.out
