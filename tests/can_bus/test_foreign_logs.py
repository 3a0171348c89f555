"""Logs that others wrote: python-can, asammdf, can-utils. Read as their own readers read them."""

from __future__ import annotations

import os
import random
import signal
import subprocess
from pathlib import Path
from typing import Any

import asammdf
import can
import numpy as np
import pytest
from asammdf.blocks.source_utils import Source
from hypothesis import given, settings
from hypothesis import strategies as st

from can_bus import CanBusError, columns_of, read_log, read_log_columns, timestamp_us
from can_bus.logs.apart import Reading, read_apart
from can_bus.logs.frame_block import FrameBlock

FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)


@st.composite
def foreign_frames(draw: st.DrawFn) -> list[can.Message]:
    """Draw frames of every kind in the order of their stamps."""
    frames, stamp_us = [], draw(st.sampled_from([0, 1_700_000_000_000_000]))
    for _ in range(draw(st.integers(1, 12))):
        stamp_us += draw(st.integers(1, 3_000_000))
        kind = draw(st.sampled_from(["data", "data", "fd", "remote", "error"]))
        is_extended = draw(st.booleans())
        message = can.Message(
            timestamp=stamp_us / 1e6,
            arbitration_id=draw(st.integers(0, (1 << 29 if is_extended else 1 << 11) - 1)),
            is_extended_id=is_extended,
            is_remote_frame=kind == "remote",
            is_error_frame=kind == "error",
            is_fd=kind == "fd",
            is_rx=draw(st.booleans()),
            channel=draw(st.integers(0, 3)),
            dlc=draw(st.integers(0, 8)) if kind == "remote" else None,
        )
        if kind in ("data", "fd"):
            lengths = FD_LENGTHS if kind == "fd" else FD_LENGTHS[:9]
            size = draw(st.sampled_from(lengths))
            message.data = bytearray(draw(st.binary(min_size=size, max_size=size)))
            message.dlc = size
        if kind == "fd":
            message.bitrate_switch = draw(st.booleans())
            message.error_state_indicator = draw(st.booleans())
        frames.append(message)
    return frames


@given(frames=foreign_frames(), container_bytes=st.sampled_from([150, 333, 128 * 1024]))
def test_a_blf_log_is_read_as_python_can_reads_it(
    frames: list[can.Message], container_bytes: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("blf") / "bus.blf"
    with can.BLFWriter(path, max_container_size=container_bytes) as log:
        for number, frame in enumerate(frames):
            log.on_message_received(frame)
            if number % 3 == 0:
                log.log_event("x" * (number % 7), frame.timestamp)  # an object of another length
    theirs, ours = list(can.BLFReader(path)), list(read_log(path))
    assert len(ours) == len(theirs) == len(frames)
    for one, other in zip(ours, theirs, strict=True):
        assert one.equals(other, timestamp_delta=0)
    expected, columns = columns_of(theirs), read_log_columns(path)
    for name, column in vars(expected).items():
        np.testing.assert_array_equal(getattr(columns, name), column, name)


@settings(max_examples=20)  # python-can writes 20 000 frames a second at best
@given(frames=foreign_frames())
def test_an_mf4_log_of_python_can_is_read_as_python_can_reads_it(
    frames: list[can.Message], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("mf4") / "bus.mf4"
    with can.MF4Writer(path) as log:
        for frame in frames:
            log.on_message_received(frame)
    with can.MF4Reader(path) as log:
        theirs = list(log)
    ours = list(read_log(path))
    assert len(ours) == len(theirs)
    for one, other in zip(ours, theirs, strict=True):
        assert one.equals(other, timestamp_delta=1e-9)
    assert read_log_columns(path).timestamp_us.tolist() == [timestamp_us(one) for one in theirs]


def asammdf_log(path: Path, count: int) -> list[can.Message]:
    """Let asammdf write a bus log of its own, compressed; return what is in it."""
    stream = random.Random(5)
    names = {"BusChannel": "<u1", "ID": "<u4", "IDE": "<u1", "DLC": "<u1", "DataLength": "<u1"}
    kind = [(f"CAN_DataFrame.{name}", code) for name, code in names.items()]
    kind += [("CAN_DataFrame.DataBytes", "(8,)u1"), ("CAN_DataFrame.Dir", "<u1")]
    samples: Any = np.zeros(count, dtype=kind)
    frames = []
    for number in range(count):
        data = stream.randbytes(stream.randrange(9))
        frame = can.Message(
            timestamp=number / 1000,
            arbitration_id=stream.randrange(1 << 11),
            is_extended_id=False,
            is_rx=stream.random() < 0.5,
            channel=1,
            data=data,
        )
        padded = np.frombuffer(data.ljust(8, b"\0"), dtype=np.uint8)
        row = (1, frame.arbitration_id, 0, len(data), len(data), padded, not frame.is_rx)
        samples[number] = row
        frames.append(frame)
    source = Source("bus", "bus", "CAN", Source.SOURCE_BUS, Source.BUS_TYPE_CAN)
    signal = asammdf.Signal(
        samples, np.arange(count) / 1000, name="CAN_DataFrame", source=source, comment=""
    )
    with asammdf.MDF(version="4.10") as recording:
        recording.append(signal, acq_source=source, comment="")
        recording.save(path, compression=2)
    return frames


def test_an_mf4_log_of_asammdf_holds_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "bus.mf4"
    written = asammdf_log(path, 300)
    with asammdf.MDF(path) as recording:
        start_s = recording.header.start_time.timestamp()
    read = list(read_log(path))
    assert len(read) == len(written)
    for one, other in zip(read, written, strict=True):
        other.timestamp += start_s
        assert one.equals(other, timestamp_delta=1e-6)
    assert np.all(read_log_columns(path).is_data)


def test_an_mf4_log_cut_short_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "bus.mf4"
    asammdf_log(path, 300)
    whole = path.read_bytes()
    for stop in (10, 64, 100, 200, 500, len(whole) // 2):
        path.write_bytes(whole[:stop])
        with pytest.raises(CanBusError, match="not an MF4 file that can be read") as caught:
            list(read_log(path))
        assert "\n" not in str(caught.value)


def test_a_library_that_breaks_down_on_a_file_ends_no_other_process() -> None:
    def break_down() -> Reading:
        os.kill(os.getpid(), signal.SIGSEGV)
        return []

    assert read_apart(break_down) == "it breaks the library that reads it"


def test_what_is_read_apart_comes_back_as_it_was() -> None:
    block = FrameBlock.empty(3, 64)
    block.timestamp_s[:] = [0.5, 1.5, np.inf]
    block.data[1] = np.arange(64)
    for blocks in ([], [block], [block, FrameBlock.empty(0, 64), block]):
        back = read_apart(lambda blocks=blocks: blocks)
        assert isinstance(back, list)
        for one, other in zip(back, blocks, strict=True):
            for name, column in vars(other).items():
                np.testing.assert_array_equal(getattr(one, name), column)
    assert read_apart(lambda: "not\nthis") == "not\nthis"

    def refuse() -> Reading:
        raise CanBusError("too many")

    with pytest.raises(CanBusError, match="too many"):
        read_apart(refuse)


def test_an_asc_log_of_can_utils_is_read(tmp_path: Path) -> None:
    source, path = tmp_path / "bus.log", tmp_path / "bus.asc"
    source.write_text(
        "(1700000000.123456) vcan0 123#DEADBEEF\n(1700000000.123789) vcan0 1F334455#1122\n"
        "(1700000000.124000) vcan0 123#R\n(1700000001.125000) vcan0 7FF#\n"
    )
    subprocess.run(["log2asc", "-I", source, "-O", path, "vcan0"], check=True)
    for asc, log in zip(read_log(path), read_log(source), strict=True):
        assert asc.arbitration_id == log.arbitration_id
        assert asc.is_extended_id == log.is_extended_id
        assert asc.is_remote_frame == log.is_remote_frame
        assert asc.data == log.data
    stamps_us = [timestamp_us(one) for one in read_log(path)]
    assert np.diff(stamps_us).tolist() == [333, 211, 1_001_000]


def test_logs_of_can_utils_are_read(tmp_path: Path) -> None:
    # As candump -L of can-utils prints them: with and without direction, FD, remote and error.
    path = tmp_path / "candump.log"
    path.write_text(
        "(1700000000.123456) vcan0 123#DEADBEEF\n"
        "(1700000000.123789) can1 1F334455#1122334455667788\n"
        "(1700000000.124000) vcan0 123#R\n"
        "(1700000000.125000) vcan0 213##311223344556677889900AABB\n"
        "(1700000000.126000) vcan0 20000004#0004000000000000\n"
        "(1700000000.127000) vcan0 5A1#11.2233.44556677.88\n"
    )
    frames = read_log(path)
    read = [next(frames) for _ in range(5)]
    assert [timestamp_us(one) - 1_700_000_000_000_000 for one in read] == [
        123_456,
        123_789,
        124_000,
        125_000,
        126_000,
    ]
    assert (read[3].is_fd, read[3].bitrate_switch, read[3].error_state_indicator) == (True,) * 3
    assert (read[2].is_remote_frame, read[4].is_error_frame) == (True, True)
    with pytest.raises(CanBusError, match=r"candump.log:6: "):  # cansend's dots are in no log
        next(frames)
