"""A silent node, and a bus that takes no frame, are noticed, told, and over when they are over."""

import can
import pytest

from can_bus import BusFullError, load_database, open_bus
from hil_harness.peers import Outage, Outages, PeerWatch
from hil_harness.realtime import CycleMeter, Link, WallClock
from hil_harness.results import Timing

ENCODER = (193, False)
PERIOD_US = 10_000


def frame(frame_id: int = 193, **more: bool) -> can.Message:
    return can.Message(arbitration_id=frame_id, is_extended_id=False, **more)


def test_a_node_is_silent_after_ten_cycles_and_back_with_its_next_frame() -> None:
    said: list[str] = []
    outages = Outages(said.append)
    outages.start(1_000_000)
    watch = PeerWatch("firmware", [ENCODER], PERIOD_US, outages)
    for tick in range(100):
        now_us = 1_000_000 + tick * PERIOD_US
        is_there = tick < 20 or tick >= 60
        watch.see(now_us, [frame()] if is_there else [frame(0x7FF)])
        assert outages.count == (tick > 19 + 10)
    assert said == ["firmware: silent since 0.19 s", "firmware: back at 0.60 s"]
    assert outages.all() == [Outage("firmware", 0.19, 0.6)]


def test_a_silence_that_lasts_has_no_end() -> None:
    outages = Outages()
    watch = PeerWatch("plant", [ENCODER], PERIOD_US, outages)
    watch.see(0, [frame()])
    watch.see(500_000, [])
    watch.see(900_000, [])
    assert outages.all() == [Outage("plant", 0.0, None)]


def test_a_node_that_never_spoke_is_not_missed() -> None:
    outages = Outages()
    watch = PeerWatch("firmware", [ENCODER], PERIOD_US, outages)
    for tick in range(1000):
        watch.see(tick * PERIOD_US, [])
    assert outages.count == 0


def test_an_error_frame_is_no_sign_of_life() -> None:
    outages = Outages()
    watch = PeerWatch("firmware", [ENCODER], PERIOD_US, outages)
    watch.see(0, [frame()])
    watch.see(500_000, [frame(is_error_frame=True)])
    assert outages.count == 1


def test_the_quickest_message_of_a_node_says_what_silence_is() -> None:
    database = load_database()
    specs = [database.message(name) for name in ("ODOMETRY_X", "STATUS")]
    outages = Outages()
    watch = PeerWatch.of("firmware", specs, PERIOD_US, outages)
    watch.see(0, [frame(specs[1].frame_id)])
    watch.see(100_000, [])
    assert outages.count == 0
    watch.see(100_001, [])
    assert outages.count == 1


def test_of_a_node_that_flaps_for_days_the_first_thousand_outages_are_kept() -> None:
    outages = Outages()
    watch = PeerWatch("firmware", [ENCODER], PERIOD_US, outages)
    for second in range(3000):
        watch.see(second * 1_000_000, [frame()])
        watch.see(second * 1_000_000 + 200_000, [])
    assert outages.count == 3000
    assert len(outages.all()) == 1001  # and the one that lasts


class _Full(can.BusABC):
    """A bus that takes no frame while `is_full`."""

    channel_info = "socketcan channel 'can0'"

    def __init__(self) -> None:
        super().__init__("can0")
        self.is_full = False
        self.taken: list[can.Message] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.is_full:
            raise BusFullError("no buffer space")
        self.taken.append(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return None, False


def test_a_bus_that_takes_no_frame_ends_no_run() -> None:
    said: list[str] = []
    outages = Outages(said.append)
    with _Full() as bus:
        clock = WallClock()
        outages.start(clock.now_us())
        link = Link(bus, clock, outages=outages)
        link.send([frame()])
        bus.is_full = True
        for _ in range(3):
            link.send([frame(), frame()])
        bus.is_full = False
        link.send([frame()])
        assert len(bus.taken) == 2
    assert outages.unsent_frames == 6
    assert [line.split(" since ")[0].split(" at ")[0] for line in said] == [
        "bus: takes no frame",
        "bus: back",
    ]
    (outage,) = outages.all()
    assert outage.node == "bus"
    assert outage.stop_s is not None


def test_an_error_frame_whose_number_is_a_sensors_completes_no_tick() -> None:
    with open_bus("virtual", "error-frames") as sender, open_bus("virtual", "error-frames") as bus:
        sender.send(frame(is_error_frame=True))
        sender.send(frame(is_error_frame=True))
        sender.send(frame())
        arrived = Link(bus, WallClock()).receive(0, frozenset({ENCODER}))
    assert [one.is_error_frame for one in arrived] == [True, True, False]


def test_a_cycle_is_measured_from_step_to_step() -> None:
    cycle = CycleMeter(PERIOD_US)
    assert cycle.timing() == Timing()
    at_us = 0
    for off_us in (0, 40, -40, 0, 12_000, 0):
        at_us += PERIOD_US + off_us
        cycle.step(at_us * 1000)
    timing = cycle.timing()
    assert timing.missed_deadlines == 1
    assert (timing.jitter_p50_us, timing.jitter_max_us) == (40, 12_000)


def test_a_full_queue_of_the_interface_is_told_from_a_bus_that_is_gone() -> None:
    class Socketcan(_Full):
        error: Exception = can.CanOperationError("Failed to transmit: No buffer space", 105)

        def send(self, msg: can.Message, timeout: float | None = None) -> None:
            raise self.error

    from can_bus.backends import plain  # noqa: PLC0415  # what open_bus does with every bus

    bus = plain(Socketcan())
    with pytest.raises(BusFullError, match="is there another node that acknowledges"):
        bus.send(frame())
    Socketcan.error = can.CanOperationError("Failed to transmit: Network is down", 100)
    with pytest.raises(Exception, match="went away: cannot send") as gone:
        bus.send(frame())
    assert not isinstance(gone.value, BusFullError)
    bus.shutdown()
