"""`chiplog encode` and `chiplog map`: a table becomes a log, and the log says what is in it."""

from __future__ import annotations

import struct
from pathlib import Path

from command_line import Chiplog


def write_table(folder: Path, header: str = "t_s,left_ticks,right_ticks,gyro_code") -> None:
    rows = [f"{k / 100},{30 * k + k * k // 9},{32 * k},{32768 + k}" for k in range(300)]
    (folder / "table.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")


def test_a_table_is_encoded_and_what_it_lacks_is_said(chiplog: Chiplog, tmp_path: Path) -> None:
    write_table(tmp_path)
    said = chiplog("encode", "table.csv", "--out", "bus.log")
    assert said.status == 0
    assert said.out.splitlines() == [
        "bus.log: 600 frames of 300 ticks",
        "left out, without a column: COMMAND, ENVIRONMENT, ODOMETRY_HEADING, ODOMETRY_X, "
        "ODOMETRY_Y, REFERENCE_POSE",
        "sent as not available, without a column: IMU.accel_x_raw, IMU.accel_y_raw",
    ]


def test_commands_that_change_between_two_frames_are_said_not_to_be_in_the_log(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    """A robot that was told them was an unlisted drive in the log (1,000 nats)."""
    rows = [f"{k / 100},{k},{k},{k / 1000},{0.1 if k < 8 else 0.2}" for k in range(33)]
    header = "t_s,left_ticks,right_ticks,v_command_m_s,w_command_rad_s"
    (tmp_path / "table.csv").write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    said = chiplog("encode", "table.csv", "--out", "bus.log")
    # 32 changes, of which the frames in ticks 16 and 32 carry one each
    assert said.out.splitlines()[-1] == (
        "COMMAND goes out at its cycle: 30 changes between its frames are not in the log; a robot "
        "that was told them does otherwise"
    )


def test_the_encoded_log_replays_after_a_run_and_maps_without_a_guess(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    write_table(tmp_path)
    chiplog("encode", "table.csv", "--out", "bus.log")
    said = chiplog("map", "bus.log", "--out", "map.toml")
    assert said.status == 0
    assert said.out.splitlines()[1].split()[:3] == ["ENCODER.left_count", "left_count", "100"]
    text = (tmp_path / "map.toml").read_text(encoding="utf-8")
    assert 'left_count = "ENCODER.left_count"\n' in text
    assert "GUESS:" not in text
    assert chiplog("run", "--signals", "map.toml", "--duration-s", "1", "--out", "out").status == 0


def test_guesses_are_marked_in_the_list_and_in_the_map(chiplog: Chiplog, tmp_path: Path) -> None:
    write_table(tmp_path, "time,enc_left,enc_right,gyro_z")
    said = chiplog("map", "table.csv")
    assert said.status == 0
    assert "enc_left     left_count?" in said.out
    assert 'left_count = "enc_left"  # GUESS: name, whole numbers, name of a wheel' in said.out


def test_equal_candidates_end_with_status_two_and_both_names(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    write_table(tmp_path, "t_s,wheel_a,wheel_b,light")
    said = chiplog("map", "table.csv", "--out", "map.toml")
    assert said.status == 2
    assert "left_count could be wheel_a as well as wheel_b" in said.err
    assert "light" in said.out  # what there is to choose from
    assert not (tmp_path / "map.toml").exists()
    known = ("--is", "left_count=wheel_a", "--is", "right_count=wheel_b")
    assert chiplog("map", "table.csv", *known, "--out", "map.toml").status == 0


def test_a_yaw_rate_in_a_unit_of_its_own_is_told_as_left_out_and_stands_so_in_the_map(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    """It went to the end of the map without a word, and the diagnosis did without a gyro."""
    (tmp_path / "mine.dbc").write_text(
        'VERSION ""\nBU_: A B\nBO_ 256 CAR: 6 A\n'
        ' SG_ wheel_left : 0|16@1+ (1,0) [0|65535] "" B\n'
        ' SG_ wheel_right : 16|16@1+ (1,0) [0|65535] "" B\n'
        ' SG_ yaw_rate : 32|16@1+ (0.01,0) [0|655] "furlong/s" B\n'
    )
    rows = [
        f"({k / 100:.6f}) can0 100#{struct.pack('<3H', 3 * k, 2 * k + k * k // 40, k % 99).hex()}\n"
        for k in range(200)
    ]
    (tmp_path / "bus.log").write_text("".join(rows))
    told = (
        "CAR.yaw_rate is left out: its unit, furlong/s, is not understood; as gyro one of none "
        "(adc_code), rad/s, mrad/s, deg/s, turn/s, rpm would be"
    )
    said = chiplog("map", "bus.log", "--dbc", "mine.dbc", "--out", "map.toml")
    assert said.status == 0
    assert " ".join(said.out.split()).endswith(
        f"map.toml: 2 roles; check the 2 marked GUESS {told}"
    )
    assert f"# {told}\n" in (tmp_path / "map.toml").read_text()
