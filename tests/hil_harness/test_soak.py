"""The loop for a day, with faults on: its state is its own replay's, and its memory stays flat.

Full size: 24 simulated hours.
"""

from __future__ import annotations

import random
import resource
from collections.abc import Callable
from pathlib import Path

from can_bus import Fault, FaultInjector, make_message, open_log_writer
from hil_harness import load_robot, load_wire, replay
from hil_harness.assembly import Wire
from hil_harness.lockstep import Lockstep
from hil_harness.nodes import FirmwareNode, PlantNode
from hil_harness.nodes.schedule import cycle_of, encode_frame
from hil_harness.robot import Robot
from sim_plant import Mechanisms, Plant

SEED = 20_240_229
HOURS = {"small": 1 / 60, "full": 24.0}
FAULTS = (
    Fault(kind="drop", probability=0.01),
    Fault(kind="corrupt", probability=0.01),
    Fault(kind="duplicate", probability=0.01),
    Fault(kind="delay", probability=0.005, delay_us=15_000),
    Fault(kind="delay", message="ENCODER", probability=0.002, delay_us=40_000),
)
# What a run of any length may keep on the way: buffers that fill once, and what Python's allocator
# has not given back. A list with one pointer a tick would take 66 MiB in a day.
FLAT_KIB = 24 * 1024


def host(wire: Wire) -> Callable[[Lockstep], None]:
    """Return a host that drives somewhere else every few seconds, and rests now and then."""
    spec = wire.signal_map["v_command"].message
    every, phase, *_ = cycle_of(spec, wire.tick_period_us)
    stream = random.Random(SEED)
    speed, turn, until = 0.0, 0.0, 0

    def send(loop: Lockstep) -> None:
        nonlocal speed, turn, until
        if loop.ticks >= until:
            until = loop.ticks + stream.randrange(100, 900)
            moves = stream.random() < 0.8
            speed = stream.uniform(-0.3, 0.9) if moves else 0.0
            turn = stream.uniform(-1.0, 1.0) if moves else 0.0
        if loop.ticks % every == phase:
            raw = {signal.name: signal.initial_raw for signal in spec.payload}
            for role, value in (("v_command", speed), ("w_command", turn)):
                mapped = wire.signal_map[role]  # type: ignore[index]
                raw[mapped.signal.name] = mapped.to_raw(value)
            loop.inject(make_message(spec, encode_frame(spec, raw, loop.ticks), loop.now_us))

    return send


def nodes(robot: Robot, wire: Wire) -> tuple[PlantNode, FirmwareNode]:
    """Return plant and firmware, neither of which keeps a history."""
    period_us = wire.tick_period_us
    plant = Plant(robot.plant, Mechanisms(), tick_period_us=period_us, seed=SEED)
    return (
        PlantNode(
            plant,
            robot.plant,
            database=wire.database,
            signal_map=wire.signal_map,
            tick_period_us=period_us,
            keep_truth=False,
        ),
        FirmwareNode(
            robot,
            database=wire.database,
            signal_map=wire.signal_map,
            tick_period_us=period_us,
            keep_inputs=False,
        ),
    )


def resident_kib() -> int:
    """Return the memory in use now (of Linux; elsewhere the most so far)."""
    try:
        fields = Path("/proc/self/statm").read_text(encoding="ascii").split()
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(fields[1]) * resource.getpagesize() // 1024


def test_a_day_with_faults_ends_as_its_own_replay_does_in_flat_memory(
    tmp_path: Path, size: str
) -> None:
    robot, wire = load_robot(None), load_wire()
    ticks = round(HOURS[size] * 3600e6) // wire.tick_period_us
    plant, firmware = nodes(robot, wire)
    drive = host(wire)
    faults = FaultInjector(wire.database, seed=SEED)
    for fault in FAULTS:
        faults.add(fault)
    path = tmp_path / "bus.blf"
    early_kib = 0
    with (
        open_log_writer(path) as log,
        Lockstep(
            plant, firmware, tick_period_us=wire.tick_period_us, log=log, faults=faults
        ) as loop,
    ):
        for tick in range(ticks):
            drive(loop)
            loop.step()
            if tick == ticks // 10:
                early_kib = resident_kib()
    grown_kib = resident_kib() - early_kib
    print(f"{ticks} ticks; {grown_kib} KiB more than after a tenth; faults {faults.struck}")
    print(f"rejected {dict(firmware.checker.rejected)}")
    assert grown_kib < FLAT_KIB
    assert all(faults.struck[kind] > 0 for kind in ("drop", "corrupt", "duplicate", "delay"))
    assert all(firmware.checker.rejected[why] > 0 for why in ("crc", "counter"))

    again = replay(path, robot, wire)
    print(f"replayed {again.ticks} ticks, {again.fields} fields")
    assert again.is_equal
    assert again.ticks == ticks
    assert again.state == firmware.kernel.state()
    assert again.rejected == {str(why): n for why, n in firmware.checker.rejected.items()}
    path.unlink()
