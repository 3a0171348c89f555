"""A healthy robot is healthy too where its log says how fast its wheels turn."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from full_size import at_full_size

from gap_diagnosis.diagnose import diagnose
from gap_diagnosis.recording import Reference
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness import load_robot, load_wire
from hil_harness.scenarios import scenario

MAP = """
[columns]
time = { column = "t_s", unit = "s" }
left_count = { column = "left_m_s", unit = "m/s" }
right_count = { column = "right_m_s", unit = "m/s" }
gyro = { column = "yaw_rate_rad_s", unit = "rad/s" }
"""


def write_tum(path: Path, reference: Reference) -> None:
    assert reference.heading_rad is not None
    half = 0.5 * reference.heading_rad
    zero = np.zeros(len(half))
    rows = (reference.t_s, reference.x_m, reference.y_m, *[zero] * 3, np.sin(half), np.cos(half))
    np.savetxt(path, np.stack(rows, axis=1), fmt="%.6f")


@pytest.mark.parametrize(
    ("every", "noise_m_s"),
    [*at_full_size((2, 0.0)), (1, 0.005)],
    ids=["counts each 20 ms", "noise of 5 mm/s"],
)
def test_speeds_of_a_healthy_robot_show_no_gap(
    tmp_path: Path, every: int, noise_m_s: float
) -> None:
    """Made from counts they had backlash, > 0.999; noisy ones spurious ticks and slip as well."""
    robot = load_robot()
    log = synthetic_recording(
        robot,
        load_wire(),
        replace(scenario("random"), duration_s=60.0),
        (),
        5,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
    )
    per_count_m = robot.plant.wheels.radius_m * 2 * np.pi / robot.plant.encoder.ticks_per_rev
    assert log.gyro_rate_rad_s is not None
    assert log.reference is not None
    row_s = every * log.tick_s
    turned = np.cumsum(log.gyro_rate_rad_s) * log.tick_s
    random = np.random.default_rng(0)
    columns = [log.t_s[::every]]
    for ticks in (log.left_ticks, log.right_ticks):
        speed = np.diff(ticks[::every] * per_count_m, prepend=ticks[0] * per_count_m) / row_s
        columns.append(speed + noise_m_s * random.standard_normal(len(speed)))
    columns.append(np.diff(turned[::every], prepend=0.0) / row_s)
    header = "t_s,left_m_s,right_m_s,yaw_rate_rad_s"
    table = np.stack(columns, axis=1)
    np.savetxt(tmp_path / "log.csv", table, "%.6f", ",", header=header, comments="")
    (tmp_path / "map.toml").write_text(MAP)
    write_tum(tmp_path / "reference.tum", log.reference)
    found = diagnose(
        [tmp_path / "log.csv"],
        signals=tmp_path / "map.toml",
        references=[tmp_path / "reference.tum"],
    ).diagnosis
    assert found.verdict == "no_gap"
    assert (
        "log.csv: No --robot describes this robot: it is taken for Chiplog's own, with wheels of "
        "0.05025 m radius, 0.2985 m apart, and 2,048 counts a turn."
    ) in found.notes
