"""Logs: written while running, complete after any end, read back, and clear when broken."""

from __future__ import annotations

from pathlib import Path

import can
import pytest
from sample_logs import ENCODER, SAMPLES, each_suffix, encoder, write

from can_bus import (
    CanBusError,
    open_log_writer,
    read_log,
    timestamp_us,
)


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
