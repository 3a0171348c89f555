"""`chiplog init`: a folder to start from, whose files pass as they are."""

import subprocess
import tomllib
from pathlib import Path

import pytest
from command_line import Chiplog
from forked import folder_of_programs

from can_bus import load_database
from chiplog.commands.init import write_start
from chiplog.errors import CommandError
from hil_harness.robot import load_robot
from hil_harness.scenarios import load_scenario
from hil_harness.signal_map import default_map, load_map

NAMES = {"robot.toml", "map.toml", "two_arcs.toml", "test_robot.py"}


def test_the_files_are_written_and_commented(tmp_path: Path) -> None:
    paths = write_start(tmp_path / "robot")
    assert {path.name for path in paths} == NAMES
    for path in paths:
        assert "# " in path.read_text(encoding="utf-8")


def test_the_test_passes_as_it_is(tmp_path: Path) -> None:
    write_start(tmp_path)
    result = subprocess.run(
        [folder_of_programs() / "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        cwd=tmp_path.parent,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.usefixtures("no_pictures")
def test_the_scenario_runs_on_the_robot_from_the_command_line(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    write_start(tmp_path)
    words = ["run", "--scenario", "two_arcs.toml", "--robot", "robot.toml"]
    said = chiplog(*words, "--signals", "map.toml", "--out", "out")
    assert said.status == 0, said.err
    assert (tmp_path / "out" / "summary.json").is_file()


def test_the_files_say_what_holds_without_them(tmp_path: Path) -> None:
    write_start(tmp_path)
    database = load_database()
    written = load_map(tmp_path / "map.toml", database).signals
    shipped = default_map(database).signals
    for role, mapped in written.items():
        assert mapped == shipped[role]
    robot, default = load_robot(tmp_path / "robot.toml"), load_robot(None)
    assert (robot.plant, robot.firmware) == (default.plant, default.firmware)
    assert load_scenario(tmp_path / "two_arcs.toml").name == "two_arcs"


def test_the_settings_that_are_commented_out_are_right_too(tmp_path: Path) -> None:
    write_start(tmp_path)
    scenario = tmp_path / "two_arcs.toml"
    text = scenario.read_text().replace("# [effects", "[effects").replace("# bias", "bias")
    scenario.write_text(text.replace("# drive =", "drive ="))
    assert "effects" in tomllib.loads(scenario.read_text())
    assert load_scenario(scenario).effects


@pytest.mark.parametrize("name", sorted(NAMES))
def test_nothing_is_overwritten_and_then_nothing_is_written(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(CommandError, match="exists already and nothing is overwritten"):
        write_start(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {name}
    assert (tmp_path / name).read_text() == "mine"


def test_a_file_in_the_folders_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(CommandError, match="is a file; expected a folder"):
        write_start(tmp_path / "taken")


def test_the_command_says_what_to_type_next(chiplog: Chiplog) -> None:
    said = chiplog("init", "my_robot")
    assert said.status == 0, said.err
    assert "chiplog run --scenario my_robot/two_arcs.toml" in said.out
    assert "pytest my_robot" in said.out
    again = chiplog("init", "my_robot")
    assert again.status == 2
    assert again.err.startswith("chiplog: my_robot/robot.toml: exists already")
    assert again.err.count("\n") == 1
