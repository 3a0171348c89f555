"""A CAN bus in simulated time, as a python-can interface: `can.Bus("name", interface="chiplog")`.

Small rooms, each of one purpose: `frame_bits` (a frame bit by bit), `disturbed_frame` (what nodes
do when something goes wrong), `confinement` (error counters), `queues` (what waits to be sent),
`faults`, `channel` (clock and arbitration), `pace` (which thread moves the clock), `bus` (what
python-can sees).
"""

from can_bus.simulated.bus import SimulatedBus
from can_bus.simulated.faults import BUS_FAULT_KINDS, ActiveFault, BusFault, BusFaultKind
from can_bus.simulated.queues import TRANSMIT_ORDERS, TransmitOrder

__all__ = [
    "BUS_FAULT_KINDS",
    "TRANSMIT_ORDERS",
    "ActiveFault",
    "BusFault",
    "BusFaultKind",
    "SimulatedBus",
    "TransmitOrder",
]
