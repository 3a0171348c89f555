"""Stage bus: stamps, counters and payloads of the frames; no reference needed."""

from gap_diagnosis.bus.block import BusBlock, bus_block

__all__ = ["BusBlock", "bus_block"]
