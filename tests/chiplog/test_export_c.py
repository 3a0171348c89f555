"""`chiplog export-c` and `--kernel`: the same firmware as C99, and as any of its kernels."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest
from command_line import Chiplog

from firmware_model import Kernel, c99
from firmware_model.c99_export import CONFIG_HEADER, export_files
from firmware_model.c99_layout import c_types
from firmware_model.c99_library import library
from firmware_model.tables import quarter_sine_table
from hil_harness.assembly import load_wire
from hil_harness.nodes.firmware import firmware_config
from hil_harness.robot import load_robot

pytestmark = pytest.mark.usefixtures("no_pictures")

STRICT = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wsign-conversion",
    "-pedantic",
    "-Werror",
]
MAIN = """#include <inttypes.h>
#include <stdio.h>
#include "chiplog_config.h"

int main(void)
{
    chiplog_state state;
    chiplog_inputs inputs = {0, 0, 0, CHIPLOG_FRESH, CHIPLOG_FRESH};

    chiplog_kernel_start(&state, &chiplog_robot);
    while (scanf("%" SCNu32 " %" SCNu32 " %" SCNd32, &inputs.left_count, &inputs.right_count,
                 &inputs.gyro_code) == 3) {
        chiplog_kernel_step(&state, &chiplog_robot, &inputs);
        printf("%" PRId64 " %" PRId64 " %" PRId32 "\\n", state.x_m_q, state.y_m_q,
               state.heading_turn_q);
    }
    return 0;
}
"""
ROBOTS = {
    "default": "",
    "cordic": '[firmware.trig]\nmethod = "cordic"\n',
    "narrow": "[firmware]\nmode = 'blend'\n[firmware.position]\nword_bits = 32\nfrac_bits = 16\n"
    "[firmware.trig]\nentries = 64\nfrac_bits = 15\ninterpolated = false\n",
}


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_program_built_from_the_exported_files_computes_the_firmwares_pose(
    chiplog: Chiplog, tmp_path: Path, robot: str
) -> None:
    (tmp_path / "robot.toml").write_text(ROBOTS[robot])
    said = chiplog("export-c", "--robot", "robot.toml", "--out", "c")
    assert (said.status, said.err) == (0, "")
    assert said.out == "wrote chiplog_config.h, chiplog_firmware.h, chiplog_firmware.c to c\n"
    (tmp_path / "c" / "main.c").write_text(MAIN)
    units = ["main.c", "chiplog_firmware.c"]
    subprocess.run(["cc", *STRICT, "-o", "main", *units], cwd=tmp_path / "c", check=True)

    wire = load_wire()
    described = load_robot(tmp_path / "robot.toml")
    kernel = Kernel(firmware_config(described, wire.signal_map, wire.tick_period_us))
    ticks = [(40 * k % 65536, 55 * k % 65536, 32768 + 7 * k % 3000) for k in range(2_000)]
    expected = []
    for left, right, code in ticks:
        kernel.step(left, right, 0, code, 0)
        expected.append(" ".join(map(str, kernel.pose_q)))
    given = "\n".join(" ".join(map(str, one)) for one in ticks)
    ran = subprocess.run(
        [str(tmp_path / "c" / "main")], input=given, capture_output=True, text=True, check=True
    )
    assert ran.stdout.splitlines() == expected


def test_the_table_is_the_kernels_own_and_every_field_is_set() -> None:
    wire = load_wire()
    config = firmware_config(load_robot(None), wire.signal_map, wire.tick_period_us)
    header = export_files(config, "lesson")[CONFIG_HEADER]
    table = re.search(r"chiplog_sine_table\[1025\] = \{(.*?)\}", header, re.S)
    assert table is not None
    numbers = tuple(int(number) for number in re.findall(r"\d+", table[1]))
    assert numbers == quarter_sine_table(1024, 30) == config.table
    assert re.findall(r"^    \.(\w+) = ", header, re.M) == list(c_types("chiplog_config"))


def test_a_robots_name_cannot_end_the_comment_it_stands_in() -> None:
    wire = load_wire()
    config = firmware_config(load_robot(None), wire.signal_map, wire.tick_period_us)
    header = export_files(config, "evil */ #error \\\n ??/")[CONFIG_HEADER]
    assert "Robot evil __ #error __ ___:" in header


def test_the_robots_formats_stand_in_the_header_and_are_written_again(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    assert chiplog("export-c", "--out", "c").status == 0
    first = (tmp_path / "c" / CONFIG_HEADER).read_text()
    assert "x_m_q, y_m_q: 2^-32 m in 64 bits (floor, wrap)" in first
    (tmp_path / "robot.toml").write_text("[firmware.position]\nword_bits = 32\nfrac_bits = 16\n")
    assert chiplog("export-c", "--robot", "robot.toml", "--out", "c").status == 0
    assert "2^-16 m in 32 bits" in (tmp_path / "c" / CONFIG_HEADER).read_text()
    assert (tmp_path / "c" / c99.SOURCE).read_text() == c99.text(c99.SOURCE)


def test_a_file_where_the_folder_would_be_is_left_alone(chiplog: Chiplog, tmp_path: Path) -> None:
    (tmp_path / "c").write_text("mine")
    said = chiplog("export-c", "--out", "c")
    assert said.status == 2
    assert said.err == "chiplog: c: is a file; expected a folder, which may not exist yet\n"
    assert (tmp_path / "c").read_text() == "mine"


def test_a_file_that_differs_is_refused_and_nothing_is_written(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / c99.SOURCE).write_text("/* mine */\n")
    assert chiplog("export-c", "--out", "c").status == 2
    assert [one.name for one in (tmp_path / "c").iterdir()] == [c99.SOURCE]


def test_formats_that_overflow_are_refused_before_anything_is_written(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    (tmp_path / "robot.toml").write_text("[firmware.step]\nfrac_bits = 40\n")
    said = chiplog("export-c", "--robot", "robot.toml", "--out", "c")
    assert said.status == 2
    assert "robot.toml:2: firmware.step.frac_bits = 40: the longest step of a tick" in said.err
    assert not (tmp_path / "c").exists()


def test_the_kernel_asked_for_writes_the_same_log_and_state(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    for kernel in ("compiled", "python", "c99"):
        words = ("--duration-s", "2", "--kernel", kernel, "--out", kernel)
        assert chiplog("run", *words).status == 0
    for name in ("bus.log", "state.json"):
        found = {
            (tmp_path / kernel / name).read_bytes() for kernel in ("compiled", "python", "c99")
        }
        assert len(found) == 1


def test_a_firmware_effect_runs_in_the_c_kernel_as_well(chiplog: Chiplog, tmp_path: Path) -> None:
    for kernel in ("compiled", "c99"):
        words = (
            "--effect",
            "firmware_overflow.bits=24",
            "--effect",
            "firmware_overflow.variable=position",
        )
        given = (*words, "--duration-s", "3", "--kernel", kernel, "--out", kernel)
        assert chiplog("run", *given).status == 0
    found = {(tmp_path / kernel / "bus.log").read_bytes() for kernel in ("compiled", "c99")}
    assert len(found) == 1


def test_without_a_compiler_the_run_is_refused_in_one_line(
    chiplog: Chiplog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library.cache_clear()
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    said = chiplog("run", "--kernel", "c99", "--out", "out")
    assert said.status == 2
    assert said.err.startswith("chiplog: kernel c99: no C compiler: none of cc, gcc, clang is on")
    assert said.err.count("\n") == 1


NARROW = "[firmware.position]\nword_bits = 12\nfrac_bits = 14\n"


def test_formats_that_overflow_run_by_force_and_the_overflows_are_counted(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    (tmp_path / "robot.toml").write_text(NARROW)
    words = ("run", "--robot", "robot.toml", "--duration-s", "3")
    refused = chiplog(*words, "--out", "refused")
    assert refused.status == 2
    assert "robot.toml:2: firmware.position.word_bits = 12: 1.803 m by the wheels" in refused.err
    assert not (tmp_path / "refused" / "bus.log").exists()

    forced = chiplog(*words, "--force", "--out", "forced")
    assert forced.status == 0
    count = json.loads((tmp_path / "forced" / "state.json").read_text())["overflow_count"]
    assert count > 0
    assert re.search(rf"^firmware +{count:,} overflows of a word$", forced.out, re.M)


BEYOND_C = "[firmware.step]\nword_bits = 33\nfrac_bits = 40\n"


def test_what_c_cannot_hold_runs_by_force_in_python_and_overflows_at_its_own_width(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    """33 bits of 2^-40 m hold 3.9 mm a tick: the lesson drives 6 mm from its first tick on."""
    (tmp_path / "robot.toml").write_text(BEYOND_C)
    words = ("run", "--robot", "robot.toml", "--duration-s", "1")
    line = "chiplog: robot.toml:2: firmware.step.word_bits = 33: expected at most 32, as many as"
    for refused in (
        words,
        (*words, "--force", "--kernel", "compiled"),
        ("ranges", "--robot", "robot.toml"),
        ("export-c", "--robot", "robot.toml", "--force"),
    ):
        said = chiplog(*refused)
        assert said.status == 2
        assert said.err.startswith(line)
        assert said.err.endswith("only --kernel python holds more, by --force\n")
    forced = chiplog(*words, "--force", "--out", "out")
    assert forced.status == 0
    state = json.loads((tmp_path / "out" / "state.json").read_text())
    assert state["overflow_count"] == state["tick"] - 1  # the first sets the baseline
    assert f"firmware   {state['overflow_count']} overflows of a word" in forced.out
    assert chiplog("replay", "out/bus.log", "--robot", "robot.toml", "--force").status == 0


def test_formats_that_overflow_are_exported_by_force(chiplog: Chiplog, tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(NARROW)
    assert chiplog("export-c", "--robot", "robot.toml", "--out", "c").status == 2
    forced = chiplog("export-c", "--robot", "robot.toml", "--out", "c", "--force")
    assert forced.status == 0
    assert "by force, although robot.toml:2: firmware.position.word_bits = 12: " in forced.out
    assert ".position_high_q = INT64_C(2047)," in (tmp_path / "c" / CONFIG_HEADER).read_text()


def test_a_run_without_an_overflow_does_not_speak_of_any(chiplog: Chiplog) -> None:
    said = chiplog("run", "--duration-s", "1", "--out", "out")
    assert "overflow" not in said.out


NARROW_FOR_A_MISSION = "[firmware.position]\nword_bits = 25\nfrac_bits = 21\n"


def test_a_position_that_does_not_hold_the_mission_is_refused_and_the_header_tells_the_truth(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    words = ("export-c", "--robot", "robot.toml", "--out", "c")
    (tmp_path / "robot.toml").write_text(NARROW_FOR_A_MISSION)
    refused = chiplog(*words)
    assert refused.status == 2
    assert refused.err == (
        "chiplog: robot.toml:2: firmware.position.word_bits = 25: 5427 m in a mission of 3600 s do "
        "not fit with 21 fraction bits: expected at least 35 bits, or less in [design]\n"
    )
    assert not (tmp_path / "c").exists()
    header = tmp_path / "c" / CONFIG_HEADER
    assert "by force, although robot.toml:2" in chiplog(*words, "--force").out
    assert "It is not proved that they stay within them." in " ".join(header.read_text().split())

    design = "[design]\ndistance_m = 7.8\nmission_s = 60\n"  # an hour may tremble for metres
    (tmp_path / "robot.toml").write_text(NARROW_FOR_A_MISSION + design)
    assert chiplog(*words).status == 0
    proved = (
        "7.8 m in a mission of 60 s, and wheels that tremble on a count's edge, with readings 6 × "
        "0.2 counts off."
    )
    said = " ".join(header.read_text().replace(" * ", " ").split())
    assert f"Proved that they stay within them: {proved}" in said
    ranges = chiplog("ranges", "--robot", "robot.toml")
    assert proved in ranges.out
    assert (ranges.status, "No word can overflow." in ranges.out) == (0, True)


def test_ranges_asks_for_the_bits_without_which_no_firmware_is_built(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    """A word that holds the turns of a slow robot, and not those that its firmware believes."""
    (tmp_path / "robot.toml").write_text(
        "[firmware.turn_step]\nword_bits = 48\n[design]\nturn_rate_rad_s = 0.5\nmission_s = 1.0\n"
    )
    refused = chiplog("export-c", "--robot", "robot.toml", "--out", "c").err
    (said,) = re.findall(
        r"firmware\.turn_step\.word_bits = 48: .* expected at least (\d+)", refused
    )
    ranges = chiplog("ranges", "--robot", "robot.toml")
    assert (ranges.status, "No word can overflow." in ranges.out) == (1, False)
    assert refused.removeprefix("chiplog: ").strip() in ranges.out
    turns = re.findall(r"^turn by the .*? 48 +(\d+) ", ranges.out, re.MULTILINE)
    assert turns == [said, said]


def test_the_tick_that_the_firmware_was_made_for_is_the_headers(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    (tmp_path / "robot.toml").write_text("[design]\ntick_period_us = 2500\n")
    words = ("export-c", "--robot", "robot.toml", "--out", "c")
    assert chiplog(*words).status == 0
    header = (tmp_path / "c" / CONFIG_HEADER).read_text()
    assert "#define CHIPLOG_TICK_PERIOD_US UINT32_C(2500)\n" in header
    kernel = load_robot(tmp_path / "robot.toml").firmware_constants(2500)
    assert f"tick period {kernel.tick_period_s:g} s" in " ".join(header.split()).replace(" * ", " ")
    rate = re.search(r"\.tick_rate_hz_q = INT64_C\((\d+)\)", header)
    assert rate is not None
    assert int(rate[1]) == 400 << 16
    (tmp_path / "mine.dbc").write_bytes(load_wire().database.path.read_bytes())
    refused = chiplog(*words, "--dbc", "mine.dbc")
    assert refused.status == 2
    assert "design.tick_period_us = 2500: the tick of mine.dbc is 10000 µs" in refused.err


def test_the_answer_of_a_study_at_another_tick_is_exported_with_that_tick_and_its_mission(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    sweep = ("--sweep", "tick_rate_hz=400", "--sweep", "position.word_bits=26")
    coarse = ("--sweep", "position.frac_bits=21", "--scenario", "straight", "--seeds", "1")
    meet = ("--meet", "arithmetic position 5 mm after 5 m")
    studied = chiplog("study", *sweep, *coarse, *meet, "--out", "s")
    assert studied.status == 0
    assert "write it in C: chiplog export-c --robot s/robot.toml\n" in studied.out
    assert chiplog("export-c", "--robot", "s/robot.toml", "--out", "c").status == 0
    header = (tmp_path / "c" / CONFIG_HEADER).read_text()
    assert "#define CHIPLOG_TICK_PERIOD_US UINT32_C(2500)\n" in header
    assert "Proved that they stay within them: 5 m in a mission of" in " ".join(
        header.replace(" * ", " ").split()
    )
    refused = chiplog("run", "--robot", "s/robot.toml", "--duration-s", "1")
    assert refused.status == 2
    assert "design.tick_period_us = 2500: the tick of chiplog.dbc is 10000 µs" in refused.err
