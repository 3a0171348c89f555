"""Logs that are cut, corrupt or hostile: one clear line, and nothing before it is lost."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_logs import SAMPLES, encoder, write

from can_bus import (
    CanBusError,
    open_log_writer,
    read_log,
    read_log_columns,
)
from can_bus.logs.reader import parse_candump

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
        list(read_log(path))


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


@pytest.mark.parametrize("last", ["", "no internal events logged\n", "// nothing more\n"])
def test_the_first_frame_of_an_asc_log_is_read_whatever_its_heading_says(
    last: str, tmp_path: Path
) -> None:
    path = tmp_path / "bus.asc"
    heading = f"date Mon Jan 01 00:00:00.000 2024\nbase hex  timestamps absolute\n{last}"
    path.write_text(f"{heading}0.1 1 123 Rx d 1 00\n0.2 1 124 Rx d 1 00\n0.3 1 800 Rx d 1 00\n")
    frames = read_log(path)
    assert [next(frames).arbitration_id for _ in range(2)] == [0x123, 0x124]
    with pytest.raises(CanBusError, match=rf"bus.asc:{5 + bool(last)}: "):
        next(frames)
