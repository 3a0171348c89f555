"""Replays are handed what the ECU had in hand, so that a late frame is no fault of the firmware."""

from typing import Any

import numpy as np
import pytest
from simulated import robot, wire

from gap_diagnosis.firmware import FirmwareBlock, firmware_block
from gap_diagnosis.firmware.arrived import line_below
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios.named import random


def block_of(**effects: dict[str, Any]) -> FirmwareBlock:
    settings = [EffectSetting(name, tuple(values.items())) for name, values in effects.items()]
    recording = synthetic_recording(robot(), wire(), random(2), settings, 2, duration_s=30.0)
    block = firmware_block(recording, robot(), wire())
    assert block is not None
    return block


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("frame_jitter", {"frame": "sensors", "sigma": 0.005}),
        ("frame_jitter", {"frame": "ENCODER", "sigma": 0.004}),
        ("frame_reordering", {"frame": "ENCODER", "probability": 0.01}),
        ("frame_latency", {"frame": "IMU", "delay": 0.0143}),
        ("frame_loss", {"frame": "ENCODER", "probability": 0.1, "burst": 6}),
        ("bus_gap", {"start_s": 3, "stop_s": 3.3}),
        ("stale_producer", {"frame": "ENCODER", "cycles": 6, "probability": 0.0005}),
        ("reception_stamp", {"frame": "ENCODER", "delay": 0.0005, "period": 0.0131}),
        ("reception_stamp", {"frame": "sensors", "delay": 0.00045, "period": 0.0097}),
        ("reception_stamp", {"frame": "sensors", "delay": 0.0006, "period": 0.009986}),
    ],
)
def test_what_the_bus_did_to_the_frames_leaves_nothing_for_the_firmware(
    effect: str, values: dict[str, Any]
) -> None:
    block = block_of(**{effect: values})
    assert block.is_equal
    assert max(block.fit(frozenset({one})).log_evidence for one in block.effects) <= 0.5


def test_a_wrong_constant_is_named_alone_though_frames_come_late() -> None:
    block = block_of(
        frame_jitter={"frame": "sensors", "sigma": 0.002},
        firmware_constant={"constant": "wheel_radius", "scale": 0.01},
    )
    found = {one: block.fit(frozenset({one})) for one in block.effects}
    best = max(found, key=lambda one: found[one].log_evidence)
    assert best == "firmware_constant"
    scale = found[best].parameters["firmware_constant.scale"]
    assert float(scale.value) == pytest.approx(0.01, abs=1e-6)


def test_the_line_below_touches_the_points_and_none_lies_under_it() -> None:
    rng = np.random.default_rng(1)
    x = np.arange(3000.0)
    y = 5.0 + 0.01 * x + rng.exponential(2.0, 3000)
    start, slope = line_below(x, y)
    away = y - start - slope * x
    assert away.min() > -1e-9
    assert np.count_nonzero(away < 1e-9) == 2
    assert slope == pytest.approx(0.01, abs=1e-5)
    assert start == pytest.approx(5.0, abs=0.02)
