"""A recording survives kill -9: the last second is missing at most, and the file opens."""

from __future__ import annotations

import random
import shutil
import subprocess
import sys
from pathlib import Path

import can
import pytest
from sample_logs import encoder

from can_bus import LOG_SUFFIXES, open_log_writer, read_log, read_log_columns, timestamp_us

WRITER = """
import sys
sys.path.insert(0, sys.argv[1])
from sample_logs import encoder
from can_bus import LOG_SUFFIXES, open_log_writer
logs = [open_log_writer(f"{sys.argv[2]}/bus{suffix}") for suffix in LOG_SUFFIXES]
tick = 0
while True:
    for log in logs:
        log.write(encoder(tick), received=True)
    if tick % 10 == 0:
        print(tick, flush=True)
    tick += 1
"""
KILLS = {"small": 1, "full": 30}
READERS = {".log": can.CanutilsLogReader, ".asc": can.ASCReader, ".blf": can.BLFReader}
TICKS_PER_S = 100


def killed_after(ticks: int, folder: Path) -> int:
    """Let a process write until so many ticks were said, kill it; return the last that it said."""
    command = [sys.executable, "-c", WRITER, str(Path(__file__).parent), str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        said = -1
        for line in writer.stdout:
            said = int(line)
            if said >= ticks:
                break
        writer.kill()
        rest = writer.stdout.read().splitlines(keepends=True)
    return max([said, *(int(line) for line in rest if line.endswith("\n"))])


def test_a_killed_recording_lacks_a_second_at_most_and_opens(tmp_path: Path, size: str) -> None:
    ends = random.Random(9)
    for number in range(KILLS[size]):
        folder = tmp_path / str(number)
        folder.mkdir()
        said = killed_after(ends.randrange(900, 3000), folder)
        for suffix in LOG_SUFFIXES:
            path = folder / f"bus{suffix}"
            frames = list(read_log(path))
            assert len(frames) > said - TICKS_PER_S, suffix
            for tick, frame in enumerate(frames):
                assert frame.data == encoder(tick).data
                assert timestamp_us(frame) == tick * 10_000
            assert len(read_log_columns(path)) == len(frames)
            assert sum(1 for _ in READERS[suffix](path)) == len(frames), suffix


@pytest.mark.parametrize("suffix", LOG_SUFFIXES)
def test_of_a_slow_bus_as_well_only_the_last_second_is_missing(suffix: str, tmp_path: Path) -> None:
    path, left_behind = tmp_path / f"bus{suffix}", tmp_path / f"killed{suffix}"
    with open_log_writer(path) as log:
        for number in range(40):  # a frame each 0.4 s
            log.write(encoder(40 * number), received=True)
            shutil.copyfile(path, left_behind)  # what a kill would leave now
            missing = range(len(list(read_log(left_behind))), number + 1)
            assert all(0.4 * (number - one) < 1.0 for one in missing)


@pytest.mark.parametrize("suffix", LOG_SUFFIXES)
def test_many_frames_at_one_time_are_whole_on_the_disk_too(suffix: str, tmp_path: Path) -> None:
    path, left_behind = tmp_path / f"bus{suffix}", tmp_path / f"killed{suffix}"
    with open_log_writer(path) as log:
        for _ in range(10_000):
            log.write(encoder(0), received=True)
        shutil.copyfile(path, left_behind)
    assert len(list(read_log(left_behind))) > 7000
