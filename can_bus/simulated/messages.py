"""python-can messages, copied without the `copy` module: one per receiver and frame."""

from __future__ import annotations

import can

from can_bus.simulated.frame_bits import FrameContent

_new_message = can.Message.__new__


def copy_of(message: can.Message, timestamp_s: float) -> can.Message:
    """Return a received classic frame equal to `message`, with its own data and this stamp."""
    twin = _new_message(can.Message)
    twin.timestamp = timestamp_s
    twin.arbitration_id = message.arbitration_id
    twin.is_extended_id = message.is_extended_id
    twin.is_remote_frame = message.is_remote_frame
    twin.is_error_frame = False
    twin.channel = message.channel
    twin.dlc = message.dlc
    twin.data = message.data[:]
    twin.is_fd = False
    twin.is_rx = True
    twin.bitrate_switch = False
    twin.error_state_indicator = False
    return twin


def message_of(content: FrameContent, timestamp_s: float) -> can.Message:
    """Return what was read off the wire as a message."""
    return can.Message(
        timestamp=timestamp_s,
        arbitration_id=content.arbitration_id,
        is_extended_id=content.is_extended,
        is_remote_frame=content.is_remote,
        dlc=content.dlc,
        data=content.data,
    )
