"""Reading and decoding logs against python-can, cantools and asammdf.

    python benchmarks/log_reading.py [--frames N] [--rounds N] [--json OUT]

Candump and BLF: N frames whose lines and objects vary in length (identifiers of both kinds, 0 to 8
bytes; and a second log in which a tenth of the frames are CAN FD), python-can's readers against
`read_log_columns`. Decode: N frames of the shipped DBC, cantools' `decode_message` in a loop
against `decode_log_columns`. End to end: asammdf's `extract_bus_logging` of an MF4 log that asammdf
wrote, opening included, against `decode_log` of the same file. In turns, in one process; ratios are
of processor time, so that other work on the machine counts for neither side (asammdf: of both
clocks, as it may use threads).
"""

import argparse
import json
import os
import random
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import asammdf
import can
import cantools
import numpy as np
from asammdf.blocks.source_utils import Source

from can_bus import (
    LogColumns,
    decode_log,
    decode_log_columns,
    load_database,
    read_log_columns,
    shipped_path,
)

FD_LENGTHS = (12, 16, 20, 24, 32, 48, 64)
DATABASE = load_database()


def varied_frames(count: int, fd_share: float) -> Iterator[can.Message]:
    """Yield frames of both identifiers and of every length."""
    stream = random.Random(1)
    time_s = 0.0
    for _ in range(count):
        time_s += stream.randrange(50, 2000) * 1e-6
        is_extended, is_fd = stream.random() < 0.3, stream.random() < fd_share
        size = stream.choice(FD_LENGTHS) if is_fd else stream.choice((*range(9), 8, 8))
        yield can.Message(
            timestamp=time_s,
            arbitration_id=stream.randrange(1 << 29 if is_extended else 1 << 11),
            is_extended_id=is_extended,
            is_fd=is_fd,
            is_rx=stream.random() < 0.5,
            data=stream.randbytes(size),
        )


def our_traffic(count: int) -> LogColumns:
    """Return frames of all messages of the shipped DBC, of random content."""
    stream = np.random.default_rng(1)
    ids = np.array([spec.frame_id for spec in DATABASE.messages.values()], dtype=np.uint32)
    return LogColumns(
        timestamp_us=np.arange(count) * 1000,
        frame_id=ids[stream.integers(0, len(ids), count)],
        is_extended=np.zeros(count, dtype=np.bool_),
        data=stream.integers(0, 256, (count, 8), dtype=np.uint8),
        length=np.full(count, 8, dtype=np.uint8),
        is_rx=np.ones(count, dtype=np.bool_),
        is_data=np.ones(count, dtype=np.bool_),
        bus=np.zeros(count, dtype=np.uint32),
    )


def write_mf4(path: Path, log: LogColumns) -> None:
    """Let asammdf write a log as a bus logger would."""
    kinds = {"BusChannel": "<u1", "ID": "<u4", "IDE": "<u1", "DLC": "<u1", "DataLength": "<u1"}
    fields = [(f"CAN_DataFrame.{name}", kind) for name, kind in kinds.items()]
    samples: Any = np.zeros(len(log), dtype=[*fields, ("CAN_DataFrame.DataBytes", "(8,)u1")])
    samples["CAN_DataFrame.BusChannel"] = 1
    samples["CAN_DataFrame.ID"] = log.frame_id
    samples["CAN_DataFrame.DLC"] = samples["CAN_DataFrame.DataLength"] = log.length
    samples["CAN_DataFrame.DataBytes"] = log.data
    source = Source("bus", "bus", "CAN", Source.SOURCE_BUS, Source.BUS_TYPE_CAN)
    signal = asammdf.Signal(
        samples, log.timestamp_us * 1e-6, name="CAN_DataFrame", source=source, comment=""
    )
    with asammdf.MDF(version="4.10") as recording:
        recording.append(signal, acq_source=source, comment="")
        recording.save(path, compression=0)


def seconds(action: Callable[[], object]) -> tuple[float, float]:
    """Return processor time, of child processes too, and wall-clock time of one call."""
    wall, processor = time.perf_counter(), sum(os.times()[:4])
    action()
    return sum(os.times()[:4]) - processor, time.perf_counter() - wall


def ratio(
    rounds: int, theirs: Callable[[], object], ours: Callable[[], object], clock: int = 0
) -> tuple[float, float, float]:
    """Return lowest, median and highest ratio of times over so many turns."""
    ours()  # machine code is loaded
    values = []
    for _ in range(rounds):
        other = seconds(theirs)[clock]
        values.append(other / min(seconds(ours)[clock] for _ in range(3)))
    return min(values), statistics.median(values), max(values)


def drain(frames: Iterator[can.Message]) -> None:
    """Read to the end."""
    for _ in frames:
        pass


def reading(folder: Path, frames: int, rounds: int) -> dict[str, tuple[float, float, float]]:
    """Compare the readers."""
    result = {}
    readers = {".log": can.CanutilsLogReader, ".blf": can.BLFReader}
    for name, fd_share in (("varied", 0.0), ("with_fd", 0.1)):
        paths = [folder / f"{name}{suffix}" for suffix in readers]
        with can.Logger(paths[0]) as log, can.Logger(paths[1]) as blf:
            for message in varied_frames(frames, fd_share):
                log(message)
                blf(message)
        for path in paths:
            reader: Any = readers[path.suffix]
            result[f"{name}{path.suffix}_over_python_can"] = ratio(
                rounds,
                lambda path=path, reader=reader: drain(iter(reader(path))),  # type: ignore[misc]
                lambda path=path: read_log_columns(path),  # type: ignore[misc]
            )
    return result


def decoding(folder: Path, frames: int, rounds: int) -> dict[str, tuple[float, float, float]]:
    """Compare the decoders."""
    theirs = cantools.database.load_file(shipped_path())
    log = our_traffic(frames)
    rows = [(int(i), bytes(d)) for i, d in zip(log.frame_id, log.data, strict=True)]

    def loop() -> None:
        for frame_id, data in rows:
            theirs.decode_message(frame_id, data, decode_choices=False)  # type: ignore[union-attr]

    path = folder / "bus.mf4"
    write_mf4(path, log)

    def extract() -> None:
        with asammdf.MDF(path) as recording:
            recording.extract_bus_logging({"CAN": [(shipped_path(), 0)]})

    def end_to_end() -> object:
        return decode_log(path, DATABASE)

    return {
        "decode_over_cantools": ratio(rounds, loop, lambda: decode_log_columns(log, DATABASE)),
        "mf4_end_to_end_over_asammdf_processor": ratio(rounds, extract, end_to_end),
        "mf4_end_to_end_over_asammdf_wall": ratio(rounds, extract, end_to_end, clock=1),
    }


def main() -> None:
    """Measure all and print medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        result = reading(Path(folder), arguments.frames, arguments.rounds)
        result |= decoding(Path(folder), arguments.frames, arguments.rounds)
    for name, (low, median, high) in result.items():
        print(f"{name:40s} median {median:8.1f}   {low:.1f} … {high:.1f}")
    if arguments.json:
        content = {"frames": arguments.frames, "rounds": arguments.rounds, **result}
        arguments.json.write_text(json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
