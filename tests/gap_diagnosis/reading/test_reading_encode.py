"""What `chiplog encode` writes, and what it refuses, with row and column."""

from pathlib import Path

import numpy as np
import pytest
from drives import ROBOT, Drive, drive, encoded, read_lines

from can_bus import FrameChecker, load_database, read_log, timestamp_us
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.encode import encode_table
from hil_harness import load_wire


def encode(table: Drive, folder: Path) -> object:
    return encode_table(table.write(folder / "table.csv"), folder / "bus.log", ROBOT, load_wire())


def test_the_ecu_accepts_every_frame(tmp_path: Path) -> None:
    database = load_database()
    checker = FrameChecker(database, ["ENCODER", "IMU", "COMMAND"], max_age_us=10**12)
    log = encoded(drive(300), tmp_path)
    for message in read_log(log):
        accepted = checker.check(message, timestamp_us(message))
        assert accepted is not None
        assert accepted.counter == round((message.timestamp - 5.0) / 0.01) % 15
    assert not any(checker.rejected.values())


def test_slow_messages_come_at_their_cycles_and_columns_that_are_missing_are_said(
    tmp_path: Path,
) -> None:
    table = drive(310)
    table.columns["temperature_code"] = np.full(310, 32_768.0)
    done = encode_table(table.write(tmp_path / "t.csv"), tmp_path / "t.log", ROBOT, load_wire())
    assert done.frames == {"ENCODER": 310, "IMU": 310, "COMMAND": 20, "ENVIRONMENT": 10}
    assert "ODOMETRY_X" in done.left_out
    assert done.not_available == ("IMU.accel_x_raw", "IMU.accel_y_raw", "ENVIRONMENT.supply_raw")


def test_ticks_without_a_row_have_no_frames_and_the_counter_goes_on(tmp_path: Path) -> None:
    table = drive(300)
    kept = np.concatenate((np.arange(100), np.arange(107, 300)))
    log = encoded(Drive({n: column[kept] for n, column in table.columns.items()}), tmp_path)
    wheels = [line for line in read_lines(log) if line.message == "0C1"]
    counters = [int(line.rest.split("#")[1][3], 16) for line in wheels]
    assert counters == [k % 15 for k in kept]


@pytest.mark.parametrize(
    ("column", "value", "said"),
    [
        ("left_ticks", 3.5, r"table.csv:12: left_ticks = 3.5: expected a whole number"),
        ("gyro_code", 65_536.0, r"table.csv:12: gyro_code = 65536: expected 0 to 65535"),
        ("gyro_code", -1.0, r"table.csv:12: gyro_code = -1: expected 0 to 65535"),
        ("t_s", 5.0, r"table.csv:12: t_s = 5: expected seconds from 0, each later"),
        ("t_s", 5.103, r"table.csv:12: 1.3 ticks after the row before: .* 10 ms"),
        ("v_command_m_s", 99.0, r"v_command_m_s: COMMAND.v_m_s = 99.0 m/s: expected"),
    ],
)
def test_a_cell_that_no_frame_can_carry_is_named(
    column: str, value: float, said: str, tmp_path: Path
) -> None:
    table = drive(300)
    # Line 12 is row 10, which the command's cycle of 16 ticks passes over.
    row = slice(10, 17) if column == "v_command_m_s" else slice(10, 11)
    table.columns[column][row] = value
    with pytest.raises(DiagnosisError, match=said):
        encode(table, tmp_path)
