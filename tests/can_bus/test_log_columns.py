"""A whole log as arrays: the frames of the reader, row by row."""

from __future__ import annotations

import re
from pathlib import Path

import can
import numpy as np
import pytest
from sample_logs import ENCODER, SAMPLES, each_suffix, write

from can_bus import (
    read_log,
    read_log_columns,
    timestamp_us,
)


@each_suffix
def test_columns_are_the_frames_of_the_log(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"bus{suffix}"
    write(path, SAMPLES)
    columns = read_log_columns(path)
    assert len(columns) == len(SAMPLES)
    for row, message in enumerate(read_log(path)):
        assert columns.timestamp_us[row] == timestamp_us(message)
        assert columns.frame_id[row] == message.arbitration_id
        assert columns.is_extended[row] == message.is_extended_id
        assert columns.length[row] == len(message.data)
        assert bytes(columns.data[row]) == bytes(message.data).ljust(8, b"\0")
        assert columns.is_rx[row] == message.is_rx
        assert columns.is_data[row] == (not message.is_remote_frame)
    assert columns.rows_of(ENCODER).tolist() == [0, 4]


def test_columns_widen_for_can_fd_frames(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text("(0.1) vcan0 123#0102\n(0.2) vcan0 124##3" + "AB" * 16 + "\n")
    columns = read_log_columns(path)
    assert columns.data.shape == (2, 64)
    assert columns.length.tolist() == [2, 16]
    assert columns.data[0, :3].tolist() == [1, 2, 0]


def test_columns_of_an_empty_log_are_empty(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text("")
    columns = read_log_columns(path)
    assert len(columns) == 0
    assert columns.data.shape == (0, 8)


def test_columns_cannot_be_written_to(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    write(path, SAMPLES)
    columns = read_log_columns(path)
    for column in vars(columns).values():
        with pytest.raises(ValueError, match="read-only"):
            column[0] = 0


def test_a_standard_and_an_extended_identifier_of_one_number_are_two(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text(
        f"(0.1) vcan0 {ENCODER.frame_id:03X}#{'00' * 8}\n"
        f"(0.2) vcan0 {ENCODER.frame_id:08X}#{'00' * 8}\n"
        f"(0.3) vcan0 {ENCODER.frame_id:03X}#00\n"
    )
    assert read_log_columns(path).rows_of(ENCODER).tolist() == [0]


def test_an_error_frame_is_no_data(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    error = can.Message(timestamp=0.1, is_error_frame=True)
    write(path, [error])
    assert re.search(r" 20000080#0{16} R$", path.read_text().rstrip())
    columns = read_log_columns(path)
    assert np.count_nonzero(columns.is_data) == 0
