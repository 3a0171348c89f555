"""The same nodes in real time: paced, logged, replayable; and as processes of their own."""

import os
import threading
from pathlib import Path

import can
import numpy as np
import pytest

from can_bus import CanBusError, read_log
from hil_harness import (
    HarnessError,
    RunConfig,
    load_robot,
    load_wire,
    replay,
    run,
    run_firmware_alone,
    run_plant_alone,
    scenario,
)
from hil_harness.realtime import LatenessCount, Link, Pacer, WallClock
from hil_harness.results import Timing

GROUP = f"239.74.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF or 1}"


def config(**arguments: object) -> RunConfig:
    return RunConfig(
        scenario=scenario("figure8"),
        robot=load_robot(None),
        **{"duration_s": 0.5, "time": "real", **arguments},  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("interface", "channel"), [("virtual", None), ("udp_multicast", GROUP)], ids=["virtual", "udp"]
)
def test_a_real_time_run_replays_bit_for_bit_from_its_log(
    tmp_path: Path, interface: str, channel: str | None
) -> None:
    path = tmp_path / "bus.log"
    result = run(config(interface=interface, channel=channel, log=path))
    assert result.time == "real"
    assert result.ticks == 50
    replayed = replay(path, load_robot(None), load_wire())
    assert replayed.is_equal
    assert replayed.ticks == 50
    assert replayed.state == result.kernel_state


def test_a_real_time_run_is_paced_and_says_how_well(tmp_path: Path) -> None:
    result = run(config())
    assert result.wall_s >= 0.49  # 50 ticks, the last of which starts 0.49 s after the first
    timing = result.timing
    assert 0 <= timing.jitter_p50_us <= timing.jitter_p99_us <= timing.jitter_max_us


def test_the_robot_drives_the_same_way_in_real_time_as_in_lockstep() -> None:
    real, lockstep = run(config()), run(config(time="lockstep"))
    assert np.array_equal(real.truth, lockstep.truth)


def test_plant_and_firmware_meet_over_a_bus_between_processes(tmp_path: Path) -> None:
    group = f"239.75.{os.getpid() >> 8 & 0xFF}.{os.getpid() & 0xFF or 1}"
    ours = config(interface="udp_multicast", channel=group, log=tmp_path / "firmware.log")
    outcomes = {}
    ready = threading.Event()

    def firmware() -> None:
        ready.set()
        outcomes["firmware"] = run_firmware_alone(ours, ticks=30)

    thread = threading.Thread(target=firmware)
    thread.start()
    ready.wait()
    # The plant starts when it likes: the firmware waits for the first sensor frame.
    plant = run_plant_alone(config(interface="udp_multicast", channel=group, duration_s=3.0))
    thread.join()
    assert plant.ticks == 300
    assert outcomes["firmware"].ticks == 30
    replayed = replay(tmp_path / "firmware.log", load_robot(None), load_wire())
    assert replayed.is_equal
    assert replayed.ticks == 30


def test_a_node_alone_refuses_a_bus_that_nobody_else_can_reach() -> None:
    for run_alone in (run_plant_alone, run_firmware_alone):
        with pytest.raises(HarnessError, match="udp_multicast") as refusal:
            run_alone(config(interface="virtual"))
        assert "socketcan" in str(refusal.value)


def test_an_interface_without_a_default_channel_asks_for_one() -> None:
    with pytest.raises(HarnessError, match="--channel vcan0"):
        run(config(interface="socketcan", channel=None))


class FakeTime:
    """A clock that moves when it is slept on, and by a microsecond when it is read."""

    def __init__(self) -> None:
        self.now_ns = 0

    def monotonic_ns(self) -> int:
        self.now_ns += 1000
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)


def test_an_unknown_interface_is_named_before_a_channel_is_asked_for() -> None:
    with pytest.raises(CanBusError, match="no interface 'canalyzer': python-can knows"):
        run(config(interface="canalyzer"))


def test_a_tick_that_starts_a_period_late_has_missed_its_deadline() -> None:
    clock = FakeTime()
    pacer = Pacer(1000, monotonic_ns=clock.monotonic_ns, sleep=clock.sleep)
    for tick in range(5):
        pacer.wait_for(tick)
    assert pacer.missed_deadlines == 0
    assert pacer.timing().jitter_max_us < 10
    clock.now_ns += 2_500_000  # the work of tick 4 takes two periods and a half
    for tick in range(5, 10):
        pacer.wait_for(tick)
    assert pacer.missed_deadlines == 1
    assert 1000 < pacer.timing().jitter_max_us < 2000


def test_lateness_is_summarised_by_percentiles() -> None:
    count = LatenessCount()
    assert count.timing(0) == Timing()
    for lateness_us in range(1, 101):
        count.add(lateness_us + 0.25)
    timing = count.timing(3)
    assert (timing.jitter_p50_us, timing.jitter_p99_us, timing.jitter_max_us) == (50, 99, 100.25)
    assert timing.missed_deadlines == 3
    count.add(2e6)
    assert count.timing(0).jitter_max_us == 2e6


def test_ticks_that_pile_up_are_caught_up_with_one_by_one() -> None:
    channel = "backlog"
    trigger = frozenset({(1, False), (2, False)})
    with (
        can.Bus(interface="virtual", channel=channel) as sender,
        can.Bus(interface="virtual", channel=channel) as receiver,
    ):
        link = Link(receiver, WallClock())
        for tick in range(3):
            for frame_id in (1, 2, 9):
                sender.send(can.Message(arbitration_id=frame_id, is_extended_id=False, data=[tick]))
        for tick in range(3):
            frames = link.receive(0, trigger)
            assert [(f.arbitration_id, f.data[0]) for f in frames] == [
                (1, tick), (2, tick), (9, tick),
            ]  # fmt: skip
        assert link.receive(0, trigger) == []


def test_frames_are_stamped_when_they_are_taken_not_by_their_sender() -> None:
    with (
        can.Bus(interface="virtual", channel="stamps", preserve_timestamps=True) as sender,
        can.Bus(interface="virtual", channel="stamps", preserve_timestamps=True) as receiver,
    ):
        clock = WallClock()
        before_us = clock.now_us()
        sender.send(can.Message(arbitration_id=1, is_extended_id=False, timestamp=5.0))
        (frame,) = Link(receiver, clock).receive(0)
        assert before_us <= round(frame.timestamp * 1e6) <= clock.now_us()


def test_the_log_of_a_real_time_run_carries_the_wall_clock(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    clock = WallClock()
    before_s = clock.now_us() * 1e-6
    result = run(config(log=path))
    assert before_s <= result.stamp_us[0] / 1e6
    assert (np.diff(result.stamp_us) > 0).all()
    stamps = [message.timestamp for message in read_log(path)]
    assert before_s <= stamps[0]
    assert stamps == sorted(stamps)
    assert stamps[-1] <= clock.now_us() * 1e-6
