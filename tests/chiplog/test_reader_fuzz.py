"""Coverage-guided fuzzing of every file reader: a result or one clear line, in bounded memory.

Full size: a hundred thousand inputs for each reader.
"""

from __future__ import annotations

import resource
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import pytest

sys.path.insert(0, str(Path(__file__).parents[1]))

from coverage_guided import explore

from can_bus import (
    CanBusError,
    load_database,
    make_message,
    open_log_writer,
    parse_database,
    read_log,
    read_log_columns,
    shipped_path,
)
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.reference_file import read_reference
from hil_harness import HarnessError, load_robot
from hil_harness.effects import load_effects
from hil_harness.scenarios import scenario
from hil_harness.signal_map import load_map

RUNS = {"small": 60, "full": 100_000}
SLOW = {"mine.dbc": 3, "bus.mf4": 10}
GROWN_KIB = 256 * 1024
OURS = (CanBusError, HarnessError, DiagnosisError)
DATABASE = load_database()
ENCODER = DATABASE.message("ENCODER")


def log_seed(suffix: str, folder: Path) -> bytes:
    path = folder / f"seed{suffix}"
    with open_log_writer(path) as log:
        for tick in range(3):
            log.write(make_message(ENCODER, ENCODER.pack((tick, 0), tick), tick * 10_000), True)
        log.write(can.Message(timestamp=1, arbitration_id=5, is_remote_frame=True, dlc=3), False)
        log.write(can.Message(timestamp=2, is_error_frame=True), False)
        log.write(can.Message(timestamp=3, is_fd=True, data=bytes(12)), True)
    return path.read_bytes()


def stored_blf(folder: Path) -> bytes:
    """Return a BLF file whose container is not deflated, so that mutations reach its objects."""
    path = folder / "stored.blf"
    with can.BLFWriter(path, compression_level=0) as log:
        log.on_message_received(can.Message(timestamp=1, arbitration_id=5, data=b"abc"))
        log.on_message_received(can.Message(timestamp=2, is_fd=True, data=bytes(64)))
        log.on_message_received(can.Message(timestamp=3, is_error_frame=True))
        log.log_event("event", 4)
    v64 = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 76, 101, 2, 0, 0, 5)
    v64 += struct.pack("<BBBBLLLLLLLHBBL", 1, 4, 4, 0, 7, 0, 0x1000, 0, 0, 0, 0, 0, 0, 0, 0)
    head = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + 76, 10) + struct.pack("<H6xL4x", 0, 76)
    return path.read_bytes() + head + v64 + b"abcd"


def mf4_seed(folder: Path) -> bytes:
    path = folder / "seed.mf4"
    with can.MF4Writer(path) as log:
        log.on_message_received(can.Message(timestamp=1, arbitration_id=5, data=b"abc"))
        log.on_message_received(can.Message(timestamp=2, is_fd=True, data=bytes(12)))
    return path.read_bytes()


def file_reader(path: Path, read: Callable[[Path], object]) -> Callable[[bytes], object]:
    def target(content: bytes) -> object:
        path.write_bytes(content)
        return read(path)

    return target


def both_ways(path: Path) -> None:
    """Read a log frame by frame and as columns: the same number, or both refuse."""
    results: list[Any] = []
    for read in (lambda: len(list(read_log(path))), lambda: len(read_log_columns(path))):
        try:
            results.append(read())
        except CanBusError as error:
            results.append(type(error))
    assert results[0] == results[1], results


ROBOT = b"schema = 1\n[encoder]\nticks_per_rev = 2048\n[wheels]\nradius_m = 0.05\n"
SCENARIO = (
    b'schema = 1\nname = "mine"\nduration_s = 5.0\n[[segments]]\nv_m_s = 0.5\nw_rad_s = 0.1\n'
    b"duration_s = 2.0\nramp_s = 0.5\n"
)
MAP = b'[signals]\nleft_count = "ENCODER.left_count"\nright_count = "ENCODER.right_count"\n'
EFFECTS = b"[gyro_bias]\nbias = 0.005\n[wheel_radius]\ncommon = 0.01\n"
TUM = b"# t x y z qx qy qz qw\n0.0 0 0 0 0 0 0 1\n0.1 1e-3 0 0 0 0 0.1 0.995\n0.2,1,2,0,0,0,0,1\n"


NAMES = ("bus.log", "bus.asc", "bus.blf", "robot.toml", "mine.toml", "map.toml", "effects.toml")


@pytest.mark.parametrize("name", [*NAMES, "way.tum", "mine.dbc", "bus.mf4"])
def test_any_file_is_read_or_refused_in_one_line(name: str, tmp_path: Path, size: str) -> None:
    path = tmp_path / name
    readers: dict[str, tuple[Callable[[Path], object], list[bytes]]] = {
        "bus.log": (both_ways, [b"(0.1) can0 123##1" + b"00" * 12 + b"\n"]),
        "bus.asc": (both_ways, []),
        "bus.blf": (both_ways, []),
        "bus.mf4": (read_log_columns, []),
        "robot.toml": (load_robot, [ROBOT]),
        "mine.toml": (lambda file: scenario(str(file)), [SCENARIO]),
        "map.toml": (lambda file: load_map(file, DATABASE), [MAP]),
        "effects.toml": (load_effects, [EFFECTS]),
        "way.tum": (read_reference, [TUM]),
        "mine.dbc": (
            lambda file: parse_database(file.read_text(errors="replace"), file),
            [shipped_path().read_bytes()[:3000]],
        ),
    }
    read, seeds = readers[name]
    if path.suffix == ".mf4":
        seeds = [mf4_seed(tmp_path)]
    elif name.startswith("bus"):
        seeds = [*seeds, log_seed(path.suffix, tmp_path)]
    if path.suffix == ".blf":
        seeds.append(stored_blf(tmp_path))
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    runs = RUNS[size] // SLOW.get(name, 1)
    reached = explore(file_reader(path, read), seeds, errors=OURS, runs=runs, seed=3)
    grown_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib
    print(f"{name}: {runs} inputs, {reached} lines reached, {grown_kib} KiB more than before")
    assert reached > 10
    assert grown_kib < GROWN_KIB
