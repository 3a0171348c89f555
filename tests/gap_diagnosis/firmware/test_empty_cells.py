"""A table with empty cells does not tell whether the ECU had what it lacks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from full_size import at_full_size
from simulated import kernel_pose, plant_runs, recording_of, robot, wire

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.firmware.block import FirmwareBlock, firmware_block
from gap_diagnosis.motion.blanks import odometry_of_one_part
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.scenarios import scenario

TICKS = 6000


def with_empty_cells(table: Recording, share: float, seed: int = 1) -> Recording:
    """Return the table without some wheel counts; the ECU had them all."""
    empty = np.random.default_rng(seed).random(len(table.t_s)) < share
    empty[[0, -1]] = False
    return replace(
        table,
        frames={},
        left_ticks=np.where(empty, np.nan, table.left_ticks),
        right_ticks=np.where(empty, np.nan, table.right_ticks),
    )


def block_of(**changes: Any) -> FirmwareBlock:
    runs = plant_runs(TICKS)
    table = with_empty_cells(recording_of(runs, kernel_pose(runs, **changes)), 0.005)
    block = firmware_block(odometry_of_one_part(table), robot(), wire())
    assert block is not None
    return block


def evidences(block: FirmwareBlock) -> dict[str, float]:
    return {one: block.fit(frozenset({one})).log_evidence for one in block.effects}


@pytest.mark.parametrize("share", [0.005, *at_full_size(0.05)])
@pytest.mark.parametrize("seed", [1, *at_full_size(2, 3)])
def test_a_healthy_robot_has_no_gap(seed: int, share: float) -> None:
    """Five of these six had a moving calibration, an auto zero or a coarse table (0.46 to 0.97)."""
    calm = replace(scenario("calibration"), effects=())
    log = synthetic_recording(robot(), wire(), calm, (), seed)
    table = with_empty_cells(log, share, seed)
    assert table.odometry_x_m is not None
    assert diagnose_recordings([table], robot(), wire()).diagnosis.verdict == "no_gap"


def test_the_longest_part_without_an_empty_cell_is_replayed() -> None:
    table = with_empty_cells(synthetic_table(), 0.01)
    part = odometry_of_one_part(table).odometry_x_m
    assert part is not None
    kept = np.flatnonzero(np.isfinite(part))
    assert np.array_equal(kept, np.arange(kept[0], kept[-1] + 1))
    empty = np.flatnonzero(np.isnan(table.left_ticks))
    assert len(kept) == np.max(np.diff(np.concatenate([[-1], empty, [len(part)]]))) - 1


def synthetic_table() -> Recording:
    runs = plant_runs(TICKS)
    return recording_of(runs, kernel_pose(runs))


@pytest.mark.parametrize(
    ("effect", "changes"),
    [
        ("coarse_trig_table", {"trig_entries": 64, "trig_interpolated": 0}),
        ("stale_heading", {"stale_heading_cycles": 3}),
        *at_full_size(
            ("euler_integration", {"euler": "after"}),
            ("firmware_resolution", {"resolution_variable": "step", "resolution_bits": 8}),
        ),
    ],
)
def test_another_program_is_found_in_that_part(effect: str, changes: dict[str, Any]) -> None:
    """Within the last digits, which nobody knows there, nothing is: no truncation, for one."""
    found = evidences(block_of(**changes))
    assert found[effect] > 10.0
    assert found[effect] > max(value for name, value in found.items() if name != effect)
