"""`chiplog busload`: a table, JSON, and one line for bad input."""

from __future__ import annotations

import json

import pytest
from command_line import Chiplog


def test_the_table_names_every_cyclic_message_and_the_load(chiplog: Chiplog) -> None:
    done = chiplog("busload")
    assert done.status == 0
    assert done.err == ""
    for name in ("ENCODER", "IMU", "ODOMETRY_X", "STATUS", "COMMAND"):
        assert name in done.out
    assert "Load at 500000 bit/s:" in done.out
    assert "Every frame is through before its next one is due." in done.out


def test_json_has_seconds_and_null_where_there_is_no_bound(chiplog: Chiplog) -> None:
    done = chiplog("busload", "--bitrate", "20000", "--json", "-")
    assert done.status == 0
    found = json.loads(done.out)
    assert found["bitrate"] == 20_000
    assert found["load"] == pytest.approx(sum(one["load"] for one in found["frames"]))
    assert found["load"] > 1
    first, *_, last = found["frames"]
    assert first["response_s"] == pytest.approx(2 * 135 / 20_000)
    assert first["end_of_frame_s"] == pytest.approx((2 * 135 - 3) / 20_000)
    assert last["response_s"] is None
    assert last["meets_cycle"] is False


def test_a_bus_too_slow_says_which_frames_are_late(chiplog: Chiplog) -> None:
    done = chiplog("busload", "--bitrate", "20000", "--jitter-us", "100")
    assert done.status == 0
    assert "no bound" in done.out
    assert "May take longer than their cycle: " in done.out
