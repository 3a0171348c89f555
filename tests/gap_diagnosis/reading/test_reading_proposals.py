"""What `chiplog map` takes signals for, and when it refuses to choose."""

from pathlib import Path

import numpy as np
import pytest
from drives import ROBOT, Drive, drive, encoded
from scipy.signal import lfilter

from can_bus import load_database
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.map_text import propose_map
from gap_diagnosis.reading.propose import propose
from gap_diagnosis.reading.signals_found import FoundSignal

TURNING = drive(900)
TURNING.columns["gyro_code"] = np.rint(
    32_768 + 40 * np.gradient(TURNING.columns["right_ticks"] - TURNING.columns["left_ticks"])
)


def table(folder: Path, **names: str) -> Path:
    renamed = {"t_s": "time", "v_command_m_s": "cmd_v_m_s", "w_command_rad_s": "cmd_w_rad_s"}
    columns = dict(TURNING.columns)
    for side in ("left_ticks", "right_ticks"):
        columns[side] = columns[side] % 65_536
    return Drive(columns).write(folder / "foreign.csv", {**renamed, **names})


def test_the_shipped_names_are_no_guess(tmp_path: Path) -> None:
    _, guesses, text = propose_map(encoded(drive(400), tmp_path), load_database())
    assert guesses["left_count"].signal.path == "ENCODER.left_count"
    assert all(guess.is_certain for guess in guesses.values())
    assert "GUESS:" not in text


def test_names_units_and_wraps_find_the_roles_and_every_guess_is_marked(tmp_path: Path) -> None:
    path = table(tmp_path, left_ticks="enc_left", right_ticks="enc_right", gyro_code="gyro_z")
    _, guesses, text = propose_map(path, None)
    found = {role: guess.signal.path for role, guess in guesses.items()}
    assert found == {
        "left_count": "enc_left",
        "right_count": "enc_right",
        "gyro": "gyro_z",
        "v_command": "cmd_v_m_s",
        "w_command": "cmd_w_rad_s",
    }
    assert text.count("# GUESS:") == 6  # these and the clock


def on_a_bus(late_s: float, unit_of_turns: str = "deg/s") -> dict[str, FoundSignal]:
    """Return what a bus says of a drive whose message DRIVE comes so long after the wheels."""
    time_s = np.arange(0.0, 60.0, 0.02)
    speed = 300.0 + 200.0 * np.sign(np.sin(0.4 * time_s))
    turn = 20.0 * np.sign(np.sin(0.9 * time_s))
    done = [lfilter([0.3], [1.0, -0.7], one) for one in (speed, turn)]
    away = np.radians(done[1]) * 150.0
    ways = {"Left": np.cumsum(done[0] - away), "Right": np.cumsum(done[0] + away)}
    said = {"Speed": (speed, "mm/s"), "TurnRate": (turn, unit_of_turns)}
    signals = [
        FoundSignal(f"WHEELS.{side}Pulses", "pulses", time_s, np.rint(0.1 * way), None, 50.0)
        for side, way in ways.items()
    ]
    signals += [
        FoundSignal(f"DRIVE.{name}", unit, time_s + late_s, values, None, 50.0)
        for name, (values, unit) in said.items()
    ]
    return {one.path: one for one in signals}


def test_a_speed_and_a_turn_rate_that_wheels_follow_are_the_commands() -> None:
    guesses = propose(on_a_bus(late_s=0.0), is_table=False)
    assert guesses["v_command"].signal.path == "DRIVE.Speed"
    assert guesses["w_command"].signal.path == "DRIVE.TurnRate"
    assert guesses["w_command"].reasons == ("unit deg/s", "wheels follow it")
    assert not guesses["w_command"].is_certain


@pytest.mark.parametrize("late_s", [0.06, 0.2])
def test_what_comes_after_the_wheels_is_measured_and_no_command(late_s: float) -> None:
    assert "v_command" not in propose(on_a_bus(late_s), is_table=False)


def test_a_speed_without_a_turn_rate_beside_it_is_no_command() -> None:
    assert "v_command" not in propose(on_a_bus(0.0, unit_of_turns="degC"), is_table=False)


def test_a_way_with_a_side_is_a_wheels_and_one_without_is_none(tmp_path: Path) -> None:
    columns = dict(TURNING.columns)
    for side in ("left", "right"):
        columns[f"{side}_ticks"] = np.round(columns[f"{side}_ticks"] * 0.153, 1)
    columns["dist_front_mm"] = 800.0 + 100.0 * np.sin(0.01 * np.arange(900))
    names = {"t_s": "stamp", "left_ticks": "dist_l_mm", "right_ticks": "dist_r_mm"}
    path = Drive(columns).write(tmp_path / "own.csv", names)
    guesses = propose_map(path, None)[1]
    found = {role: guess.signal.path for role, guess in guesses.items()}
    assert (found["left_count"], found["right_count"]) == ("dist_l_mm", "dist_r_mm")
    assert guesses["left_count"].unit == "mm"
    assert "dist_front_mm" not in found.values()


def test_what_says_no_unit_is_proposed_as_a_comment_that_asks_for_it(tmp_path: Path) -> None:
    """A map that is not read would be no help; a role that is not named would be missed."""
    columns = dict(TURNING.columns)
    columns["gyro_z"] = (columns.pop("gyro_code") - 32_768) / 131
    columns["cmd_lin"] = columns.pop("v_command_m_s")
    columns["cmd_ang"] = columns.pop("w_command_rad_s")
    path = Drive(columns).write(tmp_path / "bare.csv", {"t_s": "time"})
    _, guesses, text = propose_map(path, None)
    bare = {role: guess.signal.path for role, guess in guesses.items() if guess.lacks_unit}
    assert bare == {"gyro": "gyro_z", "v_command": "cmd_lin", "w_command": "cmd_ang"}
    assert '\n# gyro = { column = "gyro_z", unit = "?" }  # GUESS: ' in text
    (tmp_path / "map.toml").write_text(text)
    assert read_recording(path, robot=ROBOT, signals=tmp_path / "map.toml").gyro_code is None
    said = text.replace("# gyro", "gyro").replace('"?"', '"deg/s"', 1)
    said = said.replace("# v_command", "v_command").replace(
        '"cmd_lin", unit = "?"', '"cmd_lin", unit = "m/s"'
    )
    (tmp_path / "said.toml").write_text(said)
    recording = read_recording(path, robot=ROBOT, signals=tmp_path / "said.toml")
    assert recording.gyro_rate_rad_s is not None


def test_a_command_named_v_is_no_voltage(tmp_path: Path) -> None:
    columns = dict(TURNING.columns)
    columns["cmd_v"] = columns.pop("v_command_m_s")
    _, guesses, _ = propose_map(Drive(columns).write(tmp_path / "bare.csv", {"t_s": "time"}), None)
    assert guesses["v_command"].signal.path == "cmd_v"


def test_sides_without_a_name_are_told_by_the_gyro(tmp_path: Path) -> None:
    for first, second in (("left_ticks", "right_ticks"), ("right_ticks", "left_ticks")):
        path = table(tmp_path, **{first: "wheel_a", second: "wheel_b", "gyro_code": "gyro_z"})
        _, guesses, _ = propose_map(path, None)
        expected = {"left_ticks": "left_count", "right_ticks": "right_count"}
        assert guesses[expected[first]].signal.path == "wheel_a"
        assert guesses[expected[second]].signal.path == "wheel_b"


def test_a_rate_that_counts_clockwise_is_inverted(tmp_path: Path) -> None:
    columns = dict(TURNING.columns)
    columns["yaw_rate_deg_s"] = (32_768 - columns.pop("gyro_code")) / 100
    path = Drive(columns).write(tmp_path / "clockwise.csv")
    _, guesses, text = propose_map(path, None)
    assert guesses["gyro"].invert
    assert 'gyro = { column = "yaw_rate_deg_s", unit = "deg/s", invert = true }  # GUESS' in text


def test_two_equal_candidates_are_named_and_one_can_be_said(tmp_path: Path) -> None:
    columns = dict(TURNING.columns)
    columns["enc_left_front"] = columns.pop("left_ticks")
    columns["enc_left_rear"] = columns["enc_left_front"] + 1
    columns["enc_right"] = columns.pop("right_ticks")
    path = Drive(columns).write(tmp_path / "four_wheels.csv")
    with pytest.raises(DiagnosisError, match=r"left_count could be enc_left_\w+ as well as enc_l"):
        propose_map(path, None)
    _, guesses, _ = propose_map(path, None, {"left_count": "enc_left_rear"})
    assert guesses["left_count"].is_certain
    with pytest.raises(DiagnosisError, match="no such signal with values: the nearest is enc_left"):
        propose_map(path, None, {"left_count": "enc_left"})


def test_sides_that_nothing_tells_apart_are_refused(tmp_path: Path) -> None:
    columns = {
        "t_s": TURNING.columns["t_s"],
        "wheel_a": TURNING.columns["left_ticks"],
        "wheel_b": TURNING.columns["right_ticks"],
    }
    path = Drive(columns).write(tmp_path / "sideless.csv")
    with pytest.raises(DiagnosisError, match="neither name says left or right"):
        propose_map(path, None)


def test_a_proposed_map_reads_the_table_it_was_made_of(tmp_path: Path) -> None:
    path = table(tmp_path, left_ticks="enc_left", right_ticks="enc_right", gyro_code="gyro_z")
    _, _, text = propose_map(path, None)
    signals = tmp_path / "map.toml"
    signals.write_text(text, encoding="utf-8")
    found = read_recording(path, robot=ROBOT, signals=signals)
    want = TURNING.columns["left_ticks"]
    assert np.array_equal(found.left_ticks, want - want[0])
    assert found.w_command_rad_s == pytest.approx(TURNING.columns["w_command_rad_s"])


def test_a_log_of_another_dbc_says_so(tmp_path: Path) -> None:
    log = tmp_path / "other.log"
    log.write_text("(0.000000) can0 7F1#00 R\n" * 20, encoding="ascii")
    with pytest.raises(DiagnosisError, match=r"no frames that chiplog.dbc knows .unknown_id 20."):
        propose_map(log, load_database())


def test_speeds_without_a_unit_are_no_counts_and_a_gyros_axis_is_no_coordinate(
    tmp_path: Path,
) -> None:
    columns = {"t_s": TURNING.columns["t_s"], "gyro_x": TURNING.columns["gyro_code"] / 1e6}
    for side in ("left", "right"):
        columns[f"wheel_{side}"] = np.gradient(TURNING.columns[f"{side}_ticks"]) / 1000
        columns[f"{side}_ticks"] = TURNING.columns[f"{side}_ticks"]
    path = Drive(columns).write(tmp_path / "speeds.csv")
    with pytest.raises(DiagnosisError, match="no whole counts and its name says no unit"):
        propose_map(path, None, {"left_count": "wheel_left"})
    _, guesses, _ = propose_map(path, None)
    assert "odom_x" not in guesses
