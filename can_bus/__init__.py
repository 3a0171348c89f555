"""The wire: codec, python-can backends, faults, end-to-end protection, logs.

The database (a DBC file) is the one home of everything that is true of the wire. Bytes from the bus
never raise: they are dropped and counted. Wrong local arguments raise `CanBusError`.
"""

from can_bus.backends import (
    CONNECTING_INTERFACES,
    IN_PROCESS_INTERFACES,
    check_interface,
    open_bus,
    vcan_commands,
)
from can_bus.checker import REASONS, Accepted, FrameChecker, Reason
from can_bus.columns import decode_columns, decode_columns_scaled, present_columns
from can_bus.database import Database, load_database, parse_database, shipped_path
from can_bus.disturbances import SENSORS, Arrivals, Disturbances, DisturbanceSchedule, Traffic
from can_bus.e2e import (
    COUNTER_MODULO,
    CounterCheck,
    E2EProtection,
    E2EStatus,
    crc8_profile1,
    crc8_profile1_array,
)
from can_bus.e2e_state import E2EState, E2EStateMachine, ProfileStatus, StateLimits
from can_bus.errors import BusFullError, CanBusError
from can_bus.faults import FAULT_KINDS, Fault, FaultInjector, FaultKind
from can_bus.frames import Frame, QuickMessage, make_message, timestamp_us
from can_bus.logs.columns import read_log_columns
from can_bus.logs.decoded import MessageColumns, decode_log, decode_log_columns
from can_bus.logs.log_columns import LogColumns, columns_of
from can_bus.logs.reader import read_log
from can_bus.logs.writer import LOG_SUFFIXES, LogWriter, open_log_writer
from can_bus.response_time import QueuedFrame, ResponseTime, response_times
from can_bus.signals import Raw, SignalSpec
from can_bus.specs import MessageSpec, protect
from can_bus.timing import (
    INTERFRAME_BITS,
    frame_length_bits,
    frame_length_bits_array,
    worst_length_bits,
)

__all__ = [
    "CONNECTING_INTERFACES",
    "COUNTER_MODULO",
    "FAULT_KINDS",
    "INTERFRAME_BITS",
    "IN_PROCESS_INTERFACES",
    "LOG_SUFFIXES",
    "REASONS",
    "SENSORS",
    "Accepted",
    "Arrivals",
    "BusFullError",
    "CanBusError",
    "CounterCheck",
    "Database",
    "DisturbanceSchedule",
    "Disturbances",
    "E2EProtection",
    "E2EState",
    "E2EStateMachine",
    "E2EStatus",
    "Fault",
    "FaultInjector",
    "FaultKind",
    "Frame",
    "FrameChecker",
    "LogColumns",
    "LogWriter",
    "MessageColumns",
    "MessageSpec",
    "ProfileStatus",
    "QueuedFrame",
    "QuickMessage",
    "Raw",
    "Reason",
    "ResponseTime",
    "SignalSpec",
    "StateLimits",
    "Traffic",
    "check_interface",
    "columns_of",
    "crc8_profile1",
    "crc8_profile1_array",
    "decode_columns",
    "decode_columns_scaled",
    "decode_log",
    "decode_log_columns",
    "frame_length_bits",
    "frame_length_bits_array",
    "load_database",
    "make_message",
    "open_bus",
    "open_log_writer",
    "parse_database",
    "present_columns",
    "protect",
    "read_log",
    "read_log_columns",
    "response_times",
    "shipped_path",
    "timestamp_us",
    "vcan_commands",
    "worst_length_bits",
]
