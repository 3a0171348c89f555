"""Logs: written while running, complete after any end, read back, and clear when broken."""

from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bus import (
    LOG_SUFFIXES,
    CanBusError,
    load_database,
    make_message,
    open_log_writer,
    read_log,
    read_log_columns,
    timestamp_us,
)
from can_bus.logs.reader import parse_candump

DATABASE = load_database()
ENCODER = DATABASE.message("ENCODER")
each_suffix = pytest.mark.parametrize("suffix", LOG_SUFFIXES)


def encoder(tick: int) -> can.Message:
    return make_message(ENCODER, ENCODER.pack((tick, 0), tick % 15), tick * 10_000)


SAMPLES = [
    encoder(0),
    can.Message(timestamp=0.25, arbitration_id=0x18FEF1FE, is_extended_id=True, data=b"\x01\x02"),
    can.Message(timestamp=0.5, arbitration_id=0x7FF, is_extended_id=False, data=b""),
    can.Message(
        timestamp=0.75, arbitration_id=0x55, is_extended_id=False, is_remote_frame=True, dlc=4
    ),
    encoder(150),
]


def write(path: Path, messages: list[can.Message]) -> None:
    with open_log_writer(path) as log:
        for number, message in enumerate(messages):
            log.write(message, received=number % 2 == 0)


@each_suffix
def test_what_was_written_is_read_back(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"bus{suffix}"
    write(path, SAMPLES)
    read = list(read_log(path))
    assert len(read) == len(SAMPLES)
    for number, (back, sent) in enumerate(zip(read, SAMPLES, strict=True)):
        assert back.equals(sent, timestamp_delta=1e-7, check_channel=False, check_direction=False)
        assert back.is_rx is (number % 2 == 0)
        assert timestamp_us(back) == timestamp_us(sent)


@each_suffix
def test_stamps_count_from_the_start_of_simulated_time(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"bus{suffix}"
    write(path, [encoder(30), encoder(31)])
    assert [timestamp_us(message) for message in read_log(path)] == [300_000, 310_000]


def test_a_candump_line_has_six_decimals_capitals_and_the_direction(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    write(path, SAMPLES)
    lines = path.read_text().splitlines()
    data = SAMPLES[0].data.hex().upper()
    assert lines[0] == f"(0.000000) vcan0 {ENCODER.frame_id:03X}#{data} R"
    assert lines[1] == "(0.250000) vcan0 18FEF1FE#0102 T"
    assert lines[2] == "(0.500000) vcan0 7FF# R"
    assert lines[3] == "(0.750000) vcan0 055#R4 T"


def test_the_channel_of_the_bus_is_not_in_the_log(tmp_path: Path) -> None:
    # Channels of rigs are unique; equal runs still have to be equal bytes.
    message = encoder(0)
    message.channel = "chiplog-1234-7"
    write(tmp_path / "a.log", [message])
    write(tmp_path / "b.log", [encoder(0)])
    assert (tmp_path / "a.log").read_bytes() == (tmp_path / "b.log").read_bytes()


@each_suffix
def test_after_an_exception_the_log_is_complete(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"bus{suffix}"

    def run() -> None:
        with open_log_writer(path) as log:
            for tick in range(7):
                log.write(encoder(tick), received=True)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run()
    assert len(list(read_log(path))) == 7


@pytest.mark.parametrize("suffix", [".log", ".asc"])
def test_all_but_the_last_second_is_on_disk_while_writing(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"bus{suffix}"
    with open_log_writer(path) as log:
        for tick in range(501):
            log.write(encoder(tick), received=True)
        on_disk = path.read_text().count(f"{ENCODER.frame_id:X}")
        assert on_disk >= 400


@each_suffix
def test_closing_twice_is_fine(suffix: str, tmp_path: Path) -> None:
    log = open_log_writer(tmp_path / f"bus{suffix}")
    log.write(encoder(0), received=True)
    log.close()
    log.close()


def test_another_suffix_is_refused_with_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(CanBusError, match=r"bus.mp3: a log ends in .log, .asc, .blf, not '.mp3'"):
        open_log_writer(tmp_path / "bus.mp3")


@each_suffix
def test_a_log_that_cannot_be_created_is_one_line(suffix: str, tmp_path: Path) -> None:
    with pytest.raises(CanBusError, match=r"cannot create this log: No such file or directory"):
        open_log_writer(tmp_path / "missing" / f"bus{suffix}")


@each_suffix
def test_a_full_disk_is_one_line(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"bus{suffix}"
    path.symlink_to("/dev/full")

    def run() -> None:
        with open_log_writer(path) as log:
            for tick in range(200):
                log.write(encoder(tick), received=True)

    with pytest.raises(CanBusError, match=r"cannot write this log: No space left on device"):
        run()


def test_python_can_reads_our_candump_log(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    write(path, [*SAMPLES[:3], SAMPLES[4]])
    for theirs, ours in zip(can.CanutilsLogReader(path), read_log(path), strict=True):
        assert theirs.equals(ours, timestamp_delta=0)


@pytest.mark.parametrize("writer", [can.CanutilsLogWriter, can.ASCWriter, can.BLFWriter])
def test_we_read_what_python_can_writes(
    writer: type[can.CanutilsLogWriter | can.ASCWriter | can.BLFWriter], tmp_path: Path
) -> None:
    suffix = {can.CanutilsLogWriter: "log", can.ASCWriter: "asc", can.BLFWriter: "blf"}[writer]
    path = tmp_path / f"theirs.{suffix}"
    sent = [
        *SAMPLES[:3],
        can.Message(
            timestamp=1.0,
            arbitration_id=0x123,
            is_extended_id=False,
            is_fd=True,
            bitrate_switch=True,
            data=bytes(range(12)),
        ),
    ]
    with writer(path) as log:
        for message in sent:
            log.on_message_received(message)
    read = list(read_log(path))
    for back, message in zip(read, sent, strict=True):
        assert back.equals(message, timestamp_delta=1e-6, check_channel=False)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("noname", "(0.000000) vcan0 123#00 R\n"),
        ("bus.txt", "(0.000000) vcan0 123#00 R\n"),
        ("trace", "date Sat Sep 30 15:06:13.191 2023\nbase hex timestamps absolute\n"),
    ],
)
def test_a_format_is_recognised_without_its_suffix(name: str, content: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(content)
    assert len(list(read_log(path))) == content.count("#")


def test_empty_lines_and_foreign_line_ends_are_fine(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_bytes(b"\n(0.5) can1 123#AAbb\r\n\r\n(1436509052.249713) vcan0 044#R\n")
    first, second = read_log(path)
    assert first.data == b"\xaa\xbb"
    assert first.is_rx
    assert second.is_remote_frame
    assert timestamp_us(second) == 1436509052249713


BROKEN_LINES = [
    "(0.010000) vcan0 0C1#0011AABB22",  # fine: the first line of each file
    "(0.010000) vcan0 0C1#0011AAB R",
    "(0.010000) vcan0 0C1",
    "(0.010000) vcan0 8C1#00",
    "(0.010000) vcan0 C1#00",
    "(0.010000) vcan0 0C1#001122334455667788",
    "(0.010000) vcan0 0C1##0" + "00" * 9,
    "(nan) vcan0 0C1#00",
    "(1e3) vcan0 0C1#00",
    "(-1.000000) vcan0 0C1#00",
    "(99999999999999999999.0) vcan0 0C1#00",
    "(0.010000) vcan0 FFFFFFFF#00Z",
    "(0.010000) vcan0 0C1#00 X",
    "0.010000 vcan0 0C1#00",
    "\x00\x01\x02",
]


@pytest.mark.parametrize("line", BROKEN_LINES[1:])
def test_a_broken_candump_line_is_named_with_file_and_line(line: str, tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text(f"{BROKEN_LINES[0]}\n{line}\n", encoding="latin-1")
    frames = read_log(path)
    assert next(frames).dlc == 5  # what came before is not lost
    with pytest.raises(CanBusError, match=r"bus.log:2: '.*': expected ") as caught:
        next(frames)
    assert "\n" not in str(caught.value)


def test_a_log_cut_within_a_line_says_where(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    write(path, [encoder(tick) for tick in range(3)])
    path.write_text(path.read_text()[:-8])
    with pytest.raises(CanBusError, match=r"bus.log:3: "):
        list(read_log(path))


def test_a_file_without_line_ends_does_not_fill_the_memory(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text("(" + "0" * 100_000)
    with pytest.raises(CanBusError, match=r"bus.log:1: a line of over 1000 characters"):
        list(read_log(path))


def test_a_broken_asc_line_is_named_with_file_and_line(tmp_path: Path) -> None:
    path = tmp_path / "bus.asc"
    write(path, SAMPLES)
    lines = path.read_text().splitlines(keepends=True)
    number = next(n for n, line in enumerate(lines) if " Rx " in line or " Tx " in line)
    lines[number] = lines[number].replace(" d 8", " d Q")
    path.write_text("".join(lines))
    with pytest.raises(CanBusError, match=rf"bus.asc:{number + 1}: .*: expected an ASC event"):
        list(read_log(path))


def test_a_candump_log_cut_within_a_frame_says_so(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    write(path, SAMPLES)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines)[: -len(" R\n") - 4])
    with pytest.raises(CanBusError, match=rf"bus.log:{len(lines)}: .*the log breaks off here"):
        list(read_log(path))


def test_a_line_that_is_no_asc_is_not_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "bus.asc"
    write(path, SAMPLES)
    path.write_text(path.read_text() + "0.1garbage\n")
    number = len(path.read_text().splitlines())
    with pytest.raises(CanBusError, match=rf"bus.asc:{number}: '0.1garbage': expected a line of"):
        list(read_log(path))


ASC_HEAD = (
    "date Mon Jan 1 00:00:00.000 2024\nbase hex  timestamps absolute\ninternal events logged\n"
)


@pytest.mark.parametrize(
    "line",
    [
        "0.1 1 123 Rx d 8 00 11",
        "0.1 1 123 Rx d FFFFFFF 00 11 22 33 44 55 66 77",
        "0.1 CANFD 1 Rx 123 0 0 9 12 00 11",
        "0.1 CANFD 1 Rx 123 0 0 9 9 00 11 22 33 44 55 66 77 88",
        "0.1 1 123 Rx r 9",
        "0.1 1 FFFFFFFFFFFF Rx d 1 00",
        "0.1 1 20000000x Rx d 1 00",
        "0.1 1 800 Rx d 1 00",
        "99999999999999999999.0 1 123 Rx d 1 00",
    ],
)
def test_an_asc_frame_that_no_bus_carries_is_refused(line: str, tmp_path: Path) -> None:
    path = tmp_path / "bus.asc"
    path.write_text(f"{ASC_HEAD}0.1 1 7FF Rx d 1 00\n{line}\n")
    frames = read_log(path)
    assert next(frames).arbitration_id == 0x7FF  # what came before is not lost
    with pytest.raises(CanBusError, match=r"bus.asc:5: '.*': expected "):
        next(frames)
    with pytest.raises(CanBusError, match=r"bus.asc:5: "):
        read_log_columns(path)


@pytest.mark.parametrize(
    ("dlc", "identifier", "stamp", "expected"),
    [
        (9, 0x123, 0, "as many data bytes as its length says"),
        (8, 0x800, 0, "a standard identifier up to 7FF"),
        (8, 0x123, (1 << 64) - 1, "a stamp from 0 up to 1e\\+12 s"),
    ],
)
def test_a_blf_frame_that_no_bus_carries_is_refused(
    dlc: int, identifier: int, stamp: int, expected: str, tmp_path: Path
) -> None:
    path = tmp_path / "bus.blf"
    write(path, [])
    ten_microseconds = 1
    frame = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 48, 1, ten_microseconds, 0, 0, stamp)
    frame += struct.pack("<HBBL8s", 1, 0, dlc, identifier, bytes(8))
    path.write_bytes(path.read_bytes()[:144] + blf_container(frame))
    with pytest.raises(CanBusError, match=rf"bus.blf: frame 1: .*: expected {expected}"):
        read_log_columns(path)


@pytest.mark.parametrize("cut", [1, 30, 200])
def test_a_blf_log_cut_short_says_so(cut: int, tmp_path: Path) -> None:
    path = tmp_path / "bus.blf"
    write(path, [encoder(tick) for tick in range(2000)])
    path.write_bytes(path.read_bytes()[:-cut])
    with pytest.raises(CanBusError, match=r"bus.blf: truncated") as caught:
        list(read_log(path))
    assert "\n" not in str(caught.value)


def test_a_blf_log_of_garbage_says_so(tmp_path: Path) -> None:
    path = tmp_path / "bus.blf"
    for garbage in (b"", bytes(range(100)), b"\xff" * 500):
        path.write_bytes(b"LOGG" + garbage)
        with pytest.raises(CanBusError, match=r"bus.blf: truncated .*BLF file after 0 frames: "):
            list(read_log(path))


def test_a_blf_container_that_would_fill_the_memory_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bus.blf"
    write(path, [encoder(0)])
    bomb = zlib.compress(bytes(65 << 20))
    container = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(bomb), 10)
    container += struct.pack("<HxxxxxxLxxxx", 2, 65 << 20) + bomb
    path.write_bytes(path.read_bytes() + container)
    with pytest.raises(CanBusError, match=r"bus.blf: a container of over 64 MiB"):
        list(read_log(path))


def blf_container(content: bytes) -> bytes:
    deflated = zlib.compress(content)
    head = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(deflated), 10)
    padding = bytes((32 + len(deflated)) % 4)
    return head + struct.pack("<HxxxxxxLxxxx", 2, len(content)) + deflated + padding


@pytest.mark.parametrize("size", [0, 15, (1 << 20) + 1, 0xFFFFFFF0])
@pytest.mark.parametrize("cut", [4, 16, 500])
def test_a_blf_object_of_no_possible_size_is_refused(size: int, cut: int, tmp_path: Path) -> None:
    # Too large: the reader would join containers for ever. Too small: it would never get past it.
    path = tmp_path / "bus.blf"
    write(path, [encoder(0)])
    content = struct.pack("<4sHHLL", b"LOBJ", 32, 1, size, 2) + bytes(1000)
    bomb = blf_container(content[:cut]) + blf_container(content[cut:])
    path.write_bytes(path.read_bytes() + bomb)
    with pytest.raises(CanBusError, match=rf"bus.blf: an object of {size} bytes: expected 16 to"):
        next(read_log(path))


def test_a_blf_object_may_go_on_in_the_next_container(tmp_path: Path) -> None:
    path = tmp_path / "bus.blf"
    write(path, [])
    head = path.read_bytes()[:144]
    frame = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 48, 1, 2, 0, 0, 0)
    frame += struct.pack("<HBBL8s", 1, 0, 8, 0x123, b"abcdefgh")
    content = frame * 100
    for cut in (1, 8, 20, 47, 48, 49, 1000):
        path.write_bytes(head + blf_container(content[:cut]) + blf_container(content[cut:]))
        frames = list(read_log(path))
        assert [bytes(f.data) for f in frames] == [b"abcdefgh"] * 100


def test_a_blf_log_of_a_killed_writer_opens(tmp_path: Path) -> None:
    path = tmp_path / "bus.blf"
    with open_log_writer(path) as log:
        for tick in range(3000):
            log.write(encoder(tick), received=True)
        left_behind = path.read_bytes()
    path.write_bytes(left_behind)
    assert len(list(read_log(path))) > 2500


def test_a_missing_log_and_a_file_of_another_kind_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(CanBusError, match=r"none.log: cannot read this log: No such file"):
        read_log(tmp_path / "none.log")
    picture = tmp_path / "picture.png"
    picture.write_bytes(b"\x89PNG\r\n")
    with pytest.raises(CanBusError, match=r"picture.png: not a log that can be read here"):
        read_log(picture)


@given(st.text(max_size=80))
def test_any_line_is_a_frame_or_one_clear_error(line: str) -> None:
    try:
        parse_candump(line, Path("x.log"), 1)
    except CanBusError as error:
        problem = str(error)
    else:
        return
    assert problem.startswith("x.log:1: ")
    assert "\n" not in problem


@given(st.binary(max_size=300), st.sampled_from([".log", ".asc", ".blf"]))
def test_any_bytes_are_read_or_one_clear_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, suffix: str
) -> None:
    path = tmp_path_factory.mktemp("log") / f"bus{suffix}"
    path.write_bytes(b"LOGG" + content if suffix == ".blf" else content)
    try:
        list(read_log(path))
    except CanBusError as error:
        problem = str(error)
    else:
        return
    assert "\n" not in problem


# --- columns ----------------------------------------------------------------------------------


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
