"""What a foreign firmware's odometry frames state, and what is said of those refused."""

from __future__ import annotations

import can
import numpy as np

from can_bus import load_database, protect, shipped_path
from hil_harness.results import Reception
from hil_harness.signal_map import default_map
from hil_harness.traces import StatedOdometry, odometry_poses

DATABASE = load_database(shipped_path())
TICKS = 5


def x_frame(tick: int, flip: int = 0) -> can.Message:
    """Return one ODOMETRY_X frame, its CRC off by `flip`."""
    spec = DATABASE.message("ODOMETRY_X")
    data = bytearray(spec.length_bytes)
    protect(spec, data, tick % 15)
    data[0] ^= flip
    return can.Message(
        arbitration_id=spec.frame_id, is_extended_id=False, data=data, timestamp=tick * 0.01
    )


def stated(frames_of_a_tick: list[list[can.Message]]) -> StatedOdometry:
    answers = ((tick * 10_000, frames) for tick, frames in enumerate(frames_of_a_tick))
    return odometry_poses(answers, TICKS, DATABASE, default_map(DATABASE))


def test_frames_with_a_wrong_crc_are_counted_by_message_and_reason() -> None:
    said = stated([[x_frame(tick, flip=1)] for tick in range(TICKS)])
    assert said.receptions["ODOMETRY_X"] == Reception(TICKS, {"crc": TICKS})
    assert np.isnan(said.poses).all()


def test_a_message_that_never_came_has_no_frames() -> None:
    said = stated([[x_frame(tick)] for tick in range(TICKS)])
    assert said.receptions == {
        "ODOMETRY_X": Reception(TICKS),
        "ODOMETRY_Y": Reception(),
        "ODOMETRY_HEADING": Reception(),
    }
    assert np.isfinite(said.poses[:, 0]).all()


def test_frames_that_are_no_odometry_are_not_counted() -> None:
    stranger = can.Message(arbitration_id=0x7FF, is_extended_id=False, data=b"")
    said = stated([[stranger, x_frame(tick)] for tick in range(TICKS)])
    assert said.receptions["ODOMETRY_X"] == Reception(TICKS)
