"""The simulated bus against python-can's virtual bus, and against real time.

    python benchmarks/simulated_bus.py [--rounds N] [--json OUT]

The same one-thread program on both, in turns, in one process: one handle sends, another receives,
frame by frame (`messages_over_virtual`) and in bursts of ten (`bursts_over_virtual`). Both figures
are messages per second of ours over theirs. Ours has arbitration, stuff bits and a clock on top.

`traffic_realtime_factor` is 60 s of the shipped DBC's frames at 500 kbit/s between two handles in
lockstep, encoded once: what the bus alone costs. `loop_realtime_factor` is the whole loop on it,
with plant, firmware, checks, bus meter and log; `loop_over_virtual` that over the same loop on
the virtual bus.
"""

import argparse
import json
import statistics
import tempfile
import time
from pathlib import Path

import can

from can_bus import load_database, make_message, open_bus, open_log_writer
from can_bus.simulated import SimulatedBus
from hil_harness import RunConfig, load_robot, load_wire, scenario
from hil_harness.assembly import build_plant_node
from hil_harness.lockstep import Lockstep, unique_channel
from hil_harness.meter import BusMeter
from hil_harness.nodes import FirmwareNode
from hil_harness.nodes.schedule import cycle_of

BITRATE = 500_000
SECONDS = 60.0
FIRMWARE_MESSAGES = ("ODOMETRY_X", "ODOMETRY_Y", "ODOMETRY_HEADING", "ODOMETRY_VELOCITY", "STATUS")


def messages_per_s(interface: str, count: int, burst: int) -> float:
    """Return how many messages per second one thread sends and receives."""
    channel = unique_channel()
    with (
        can.Bus(channel, interface=interface) as sender,
        can.Bus(channel, interface=interface) as receiver,
    ):
        messages = [
            can.Message(
                arbitration_id=0x100 + number % 8,
                is_extended_id=False,
                data=number.to_bytes(4, "little") + b"\x00\xff\x55\x12",
            )
            for number in range(count)
        ]
        started = time.perf_counter()
        for first in range(0, count, burst):
            for message in messages[first : first + burst]:
                sender.send(message)
            for _ in range(burst):
                if receiver.recv(1.0) is None:
                    raise SystemExit(f"{interface} lost a message")
        return count / (time.perf_counter() - started)


def traffic_factor() -> float:
    """Return simulated seconds per second of our frames on the bus, and nothing else."""
    database = load_database()
    tick_us = database.message("ENCODER").cycle_time_us or 0
    ticks = round(SECONDS * 1e6) // tick_us
    turns: list[list[list[can.Message]]] = []
    for is_firmware in (False, True):
        turn: list[list[can.Message]] = [[] for _ in range(ticks)]
        for spec in database.messages.values():
            if (spec.name in FIRMWARE_MESSAGES) is is_firmware and spec.name != "REFERENCE_POSE":
                every, phase = cycle_of(spec, tick_us)
                values = [signal.initial_raw for signal in spec.payload]
                for tick in range(phase, ticks, every):
                    data = spec.encode_raw(
                        {s.name: v for s, v in zip(spec.payload, values, strict=True)}
                    )
                    data[1:3] = tick.to_bytes(2, "little")
                    turn[tick].append(make_message(spec, data, 0))
        turns.append(turn)
    channel = unique_channel()
    with (
        open_bus("chiplog", channel, bitrate=BITRATE) as plant,
        open_bus("chiplog", channel, bitrate=BITRATE) as firmware,
    ):
        assert isinstance(plant, SimulatedBus)
        received = 0
        half_ns = tick_us * 500
        started = time.perf_counter()
        for tick in range(ticks):
            for half, (sender, receiver) in enumerate(((plant, firmware), (firmware, plant))):
                for message in turns[half][tick]:
                    sender.send(message)
                plant.pass_until_ns((2 * tick + half + 1) * half_ns)
                while receiver.recv(0) is not None:
                    received += 1
        seconds = time.perf_counter() - started
    if received != sum(len(sent) for turn in turns for sent in turn):
        raise SystemExit("frames were lost")
    return SECONDS / seconds


def loop_factor(interface: str, folder: Path) -> float:
    """Return simulated seconds per second of the whole loop."""
    wire = load_wire()
    config = RunConfig(scenario=scenario("lesson"), robot=load_robot(None), interface=interface)
    period_us = wire.tick_period_us
    ticks = round(SECONDS * 1e6) // period_us
    plant = build_plant_node(config, wire, ticks)
    firmware = FirmwareNode(
        config.robot,
        database=wire.database,
        signal_map=wire.signal_map,
        tick_period_us=period_us,
    )
    with (
        open_log_writer(folder / "bus.log") as log,
        Lockstep(
            plant,
            firmware,
            tick_period_us=period_us,
            interface=interface,
            bitrate=BITRATE,
            log=log,
            meter=BusMeter(wire.database),
        ) as loop,
    ):
        loop.step()  # start-up: machine code is loaded
        started = time.perf_counter()
        loop.run(ticks - 1)
        return SECONDS / (time.perf_counter() - started)


def main() -> None:
    """Run all in turns and print medians."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--messages", type=int, default=20_000)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows: dict[str, list[float]] = {
        "messages_over_virtual": [],
        "bursts_over_virtual": [],
        "messages_per_s": [],
        "traffic_realtime_factor": [],
        "loop_realtime_factor": [],
        "loop_over_virtual": [],
    }
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(arguments.rounds):
            for burst, row in ((1, "messages_over_virtual"), (10, "bursts_over_virtual")):
                theirs = messages_per_s("virtual", arguments.messages, burst)
                ours = messages_per_s("chiplog", arguments.messages, burst)
                rows[row].append(ours / theirs)
            rows["messages_per_s"].append(ours)
            rows["traffic_realtime_factor"].append(traffic_factor())
            theirs = loop_factor("virtual", Path(folder))
            ours = loop_factor("chiplog", Path(folder))
            rows["loop_realtime_factor"].append(ours)
            rows["loop_over_virtual"].append(ours / theirs)
    result = {name: _spread(values) for name, values in rows.items()}
    for name, (low, median, high) in result.items():
        print(f"{name:26s} median {median:10.2f}   {low:.2f} … {high:.2f}")
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")


def _spread(values: list[float]) -> tuple[float, float, float]:
    return min(values), statistics.median(values), max(values)


if __name__ == "__main__":
    main()
