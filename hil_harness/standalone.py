"""One node alone on a real-time bus, so that plant and firmware can be two processes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, Final

import can

from can_bus import FrameChecker, LogWriter, open_bus, open_log_writer
from hil_harness.assembly import (
    RunConfig,
    Wire,
    build_plant_node,
    default_channel,
    load_wire,
)
from hil_harness.errors import HarnessError
from hil_harness.lockstep import LOCKSTEP_INTERFACES
from hil_harness.nodes import FirmwareNode
from hil_harness.nodes.reports import firmware_messages
from hil_harness.peers import Outages, PeerWatch, Tell
from hil_harness.realtime import CycleMeter, Pacer, run_firmware_node, run_plant_node
from hil_harness.results import Timing
from hil_harness.stopping import stop_between_ticks

NODE_SCHEMA: Final = 1


@dataclass(frozen=True)
class NodeOutcome:
    """How a node's life went.

    `timing` says of the plant how late its ticks started, of the firmware how uneven its cycle was,
    of both when the other one or the bus was out. `starved_ticks` are the firmware's ticks without
    a complete set of sensor frames, `overflows` how often a word of its kernel has overflowed.
    `rejected` counts refused frames by reason.
    """

    ticks: int
    interrupted: bool
    timing: Timing = field(default_factory=Timing)
    starved_ticks: int = 0
    overflows: int = 0
    rejected: Mapping[str, int] = field(default_factory=dict)

    def summary(self, role: str) -> dict[str, Any]:
        """Return what `chiplog node --json` writes."""
        return {
            "schema": NODE_SCHEMA,
            "role": role,
            "ticks": self.ticks,
            "interrupted": self.interrupted,
            "timing": self.timing.summary(),
            "starved_ticks": self.starved_ticks,
            "overflows": self.overflows,
            "rejected": dict(self.rejected),
        }


def run_plant_alone(config: RunConfig, tell: Tell | None = None) -> NodeOutcome:
    """Run the plant on its bus for the duration of its scenario, or until Ctrl-C.

    `tell` hears at once when the firmware falls silent and when it is back.

    Raises HarnessError for an interface that other processes cannot reach, CanBusError if the bus
    cannot be opened or goes away.
    """
    _refuse_in_process(config.interface)
    wire = load_wire(config.dbc, config.signals)
    ticks = config.tick_count(wire.tick_period_us)
    node = build_plant_node(config, wire, ticks, keep_truth=False)
    outages = Outages(tell)
    with _opened(config) as (bus, log):
        pacer = Pacer(wire.tick_period_us)
        with stop_between_ticks() as stop:
            run_plant_node(
                node,
                bus,
                pacer=pacer,
                ticks=ticks,
                stop=stop,
                log=log,
                watch=firmware_watch(wire, outages),
                outages=outages,
            )
        rejected = rejected_frames(node.checker, bus)
    timing = with_outages(pacer.timing(), outages)
    return NodeOutcome(node.ticks, stop.is_made, timing, rejected=rejected)


def run_firmware_alone(
    config: RunConfig, *, ticks: int | None = None, tell: Tell | None = None
) -> NodeOutcome:
    """Run the firmware on its bus for so many ticks from the first sensor frame, or until Ctrl-C.

    Of the configuration the scenario, its effects and seed are the plant's and not used here.
    `tell` hears at once when the plant falls silent and when it is back.
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
    period_us = wire.tick_period_us
    outages, cycle = Outages(tell), CycleMeter(period_us)
    with _opened(config) as (bus, log), stop_between_ticks() as stop:
        for is_complete in run_firmware_node(
            node,
            bus,
            tick_period_us=period_us,
            ticks=ticks,
            stop=stop,
            log=log,
            watch=PeerWatch("plant", node.trigger_ids, period_us, outages),
            outages=outages,
            cycle=cycle,
        ):
            starved += not is_complete
        rejected = rejected_frames(node.checker, bus)
    return NodeOutcome(
        node.ticks,
        stop.is_made,
        with_outages(cycle.timing(), outages),
        starved_ticks=starved,
        overflows=node.kernel.overflow_count,
        rejected=rejected,
    )


def firmware_watch(wire: Wire, outages: Outages) -> PeerWatch:
    """Return what notices when the firmware, ours or an ECU, falls silent."""
    messages = firmware_messages(wire.database, wire.signal_map)
    return PeerWatch.of("firmware", messages, wire.tick_period_us, outages)


def with_outages(timing: Timing, outages: Outages) -> Timing:
    """Return the timing with what was noticed of the other side."""
    return replace(timing, outages=tuple(outages.all()), unsent_frames=outages.unsent_frames)


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
