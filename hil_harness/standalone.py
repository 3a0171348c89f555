"""One node alone on a real-time bus, so that plant and firmware can be two processes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import can

from can_bus import FrameChecker, LogWriter, open_bus, open_log_writer
from hil_harness.assembly import RunConfig, build_plant_node, default_channel, load_wire
from hil_harness.errors import HarnessError
from hil_harness.lockstep import LOCKSTEP_INTERFACES
from hil_harness.nodes import FirmwareNode
from hil_harness.realtime import Pacer, run_firmware_node, run_plant_node
from hil_harness.results import Timing
from hil_harness.stopping import stop_between_ticks


@dataclass(frozen=True)
class NodeOutcome:
    """How a node's life went.

    `rejected` counts refused frames by reason. `timing` is the plant's: how late its ticks started;
    `starved_ticks` the firmware's: ticks without a complete set of sensor frames.
    """

    ticks: int
    interrupted: bool
    timing: Timing = field(default_factory=Timing)
    starved_ticks: int = 0
    rejected: Mapping[str, int] = field(default_factory=dict)


def run_plant_alone(config: RunConfig) -> NodeOutcome:
    """Run the plant on its bus for the duration of its scenario, or until Ctrl-C.

    Raises HarnessError for an interface that other processes cannot reach, CanBusError if the bus
    cannot be opened or goes away.
    """
    _refuse_in_process(config.interface)
    wire = load_wire(config.dbc, config.signals)
    ticks = config.tick_count(wire.tick_period_us)
    node = build_plant_node(config, wire, ticks, keep_truth=False)
    with _opened(config) as (bus, log):
        pacer = Pacer(wire.tick_period_us)
        with stop_between_ticks() as stop:
            run_plant_node(node, bus, pacer=pacer, ticks=ticks, stop=stop, log=log)
        rejected = rejected_frames(node.checker, bus)
    return NodeOutcome(node.ticks, stop.is_made, pacer.timing(), rejected=rejected)


def run_firmware_alone(config: RunConfig, *, ticks: int | None = None) -> NodeOutcome:
    """Run the firmware on its bus for so many ticks from the first sensor frame, or until Ctrl-C.

    Of the configuration the scenario, its effects and seed are the plant's and not used here.
    Raises as `run_plant_alone` does.
    """
    _refuse_in_process(config.interface)
    wire = load_wire(config.dbc, config.signals)
    node = FirmwareNode(
        config.robot,
        database=wire.database,
        signal_map=wire.signal_map,
        tick_period_us=wire.tick_period_us,
        implementation=config.kernel,
        keep_inputs=False,
    )
    starved = 0
    with _opened(config) as (bus, log), stop_between_ticks() as stop:
        for is_complete in run_firmware_node(
            node, bus, tick_period_us=wire.tick_period_us, ticks=ticks, stop=stop, log=log
        ):
            starved += not is_complete
        rejected = rejected_frames(node.checker, bus)
    return NodeOutcome(
        node.ticks,
        stop.is_made,
        starved_ticks=starved,
        rejected=rejected,
    )


@contextmanager
def _opened(config: RunConfig) -> Iterator[tuple[can.BusABC, LogWriter | None]]:
    with ExitStack() as stack:
        log = None if config.log is None else stack.enter_context(open_log_writer(config.log))
        bus = open_bus(
            config.interface,
            config.channel or default_channel(config.interface),
            bitrate=config.bitrate,
            bus_args=config.bus_args,
        )
        yield stack.enter_context(bus), log


def rejected_frames(checker: FrameChecker, bus: can.BusABC | None) -> dict[str, int]:
    """Return how many frames were rejected, by reason.

    `malformed` are datagrams on a UDP bus that are no CAN frame; it is left out where none came.
    """
    rejected = {str(why): count for why, count in checker.rejected.items()}
    malformed: int = getattr(bus, "malformed", 0)
    return rejected | ({"malformed": malformed} if malformed else {})


def _refuse_in_process(interface: str) -> None:
    if interface in LOCKSTEP_INTERFACES:
        raise HarnessError(
            f"--interface {interface} lives inside one process, where no other node could hear "
            "this one: use udp_multicast (this host), socketcan (vcan0, can0) or your adapter's"
        )
