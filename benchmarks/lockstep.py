"""The lockstep loop against real time, and against a bare python-can and cantools loop.

    python benchmarks/lockstep.py [--rounds N] [--json OUT]

Both loops carry the lesson's frames at the cycle times of the shipped DBC over python-can's
virtual bus with two handles, in turns, in one process; start-up is left out. Ours has the plant,
the kernel, the end-to-end checks, the bus meter and bus.log on top. The bare loop encodes, sends,
receives and decodes each frame and does nothing else: what a user would write first.
"""

import argparse
import json
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import can
import cantools

from can_bus import load_database, open_log_writer
from hil_harness import RunConfig, load_robot, load_wire, scenario
from hil_harness.assembly import build_plant_node
from hil_harness.lockstep import Lockstep, unique_channel
from hil_harness.meter import BusMeter
from hil_harness.nodes import FirmwareNode
from hil_harness.nodes.schedule import cycle_of

PLANT_MESSAGES = ("ENCODER", "IMU", "ENVIRONMENT", "COMMAND")
FIRMWARE_MESSAGES = (
    "ODOMETRY_X",
    "ODOMETRY_Y",
    "ODOMETRY_HEADING",
    "ODOMETRY_VELOCITY",
    "STATUS",
)


def run_ours(folder: Path) -> tuple[float, int, float]:
    """Return seconds, frames and simulated seconds of the lesson in lockstep."""
    wire = load_wire()
    config = RunConfig(scenario=scenario("lesson"), robot=load_robot(None))
    period_us = wire.tick_period_us
    ticks = config.tick_count(period_us)
    plant = build_plant_node(config, wire, ticks)
    firmware = FirmwareNode(
        config.robot,
        database=wire.database,
        signal_map=wire.signal_map,
        tick_period_us=period_us,
    )
    meter = BusMeter(wire.database)
    with (
        open_log_writer(folder / "bus.log") as log,
        Lockstep(plant, firmware, tick_period_us=period_us, log=log, meter=meter) as loop,
    ):
        loop.step()  # start-up: machine code is loaded
        started = time.perf_counter()
        loop.run(ticks - 1)
        seconds = time.perf_counter() - started
    return seconds, meter.frames, ticks * period_us * 1e-6


def run_bare() -> tuple[float, int]:
    """Return seconds and frames of the bare loop."""
    wire = load_wire()
    period_us = wire.tick_period_us
    database = cantools.database.load_file(load_database().path)
    assert isinstance(database, cantools.database.Database)
    ticks = scenario("lesson").tick_count(period_us)

    def schedule(names: tuple[str, ...]) -> list[tuple[Any, dict[str, Any], int, int]]:
        rows = []
        for name in names:
            message = database.get_message_by_name(name)
            values = {signal.name: signal.initial or 0 for signal in message.signals}
            rows.append((message, values, *cycle_of(wire.database.message(name), period_us)))
        return rows

    channel = unique_channel()
    handles = [
        can.Bus(interface="virtual", channel=channel, preserve_timestamps=True) for _ in range(2)
    ]
    turns = [
        (handles[0], handles[1], schedule(PLANT_MESSAGES)),
        (handles[1], handles[0], schedule(FIRMWARE_MESSAGES)),
    ]
    frames = 0
    started = time.perf_counter()
    for tick in range(ticks):
        for sender, receiver, rows in turns:
            for message, values, every, phase in rows:
                if tick % every == phase:
                    sender.send(
                        can.Message(
                            timestamp=tick * period_us * 1e-6,
                            arbitration_id=message.frame_id,
                            is_extended_id=False,
                            data=database.encode_message(message.frame_id, values, strict=False),
                        )
                    )
                    frames += 1
            while (received := receiver.recv(0)) is not None:
                # No copy first: the bare loop pays for nothing that it need not.
                data: Any = received.data
                database.decode_message(received.arbitration_id, data)
    seconds = time.perf_counter() - started
    for handle in handles:
        handle.shutdown()
    return seconds, frames


def main() -> None:
    """Run both in turns and print medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    factors, ratios, rates = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(arguments.rounds):
            ours_s, ours_frames, simulated_s = run_ours(Path(folder))
            bare_s, bare_frames = run_bare()
            factors.append(simulated_s / ours_s)
            rates.append(ours_frames / ours_s)
            ratios.append((ours_frames / ours_s) / (bare_frames / bare_s))
    result = {
        "rounds": arguments.rounds,
        "realtime_factor": _spread(factors),
        "frames_per_second": _spread(rates),
        "frames_per_second_over_bare_loop": _spread(ratios),
    }
    for name, (low, median, high) in list(result.items())[1:]:
        print(f"{name:34s} median {median:10.2f}   {low:.2f} … {high:.2f}")
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")


def _spread(values: list[float]) -> tuple[float, float, float]:
    return min(values), statistics.median(values), max(values)


if __name__ == "__main__":
    main()
