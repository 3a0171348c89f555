"""Many runs at once: the same integers as one by one, in any shape, on any number of threads."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from kernel_cases import ZERO_CODE, config_of
from test_kernel_bit_equal import random_ticks

from firmware_model import FirmwareError, pose_m_rad, run_batch

Int64Array = npt.NDArray[np.int64]
CONFIGS = [
    config_of(mode=mode, trig={"entries": entries}, heading={"frac_bits": bits})
    for mode, entries, bits in (("wheel", 1024, 32), ("gyro", 64, 24), ("blend", 1024, 32))
]


def columns(seeds: list[int], ticks: int = 1_500) -> tuple[Int64Array, ...]:
    """Return left, right, gyro, and both validities, each [runs, ticks]."""
    runs = np.stack([random_ticks(CONFIGS[0], seed, ticks) for seed in seeds])
    left, right, encoder, gyro, gyro_validity = np.moveaxis(runs, 2, 0)
    return left, right, gyro, encoder, gyro_validity


def test_runs_do_not_know_of_each_other_nor_of_the_threads() -> None:
    inputs = columns([1, 2, 3, 4, 5])
    together = run_batch(CONFIGS[2], *inputs, workers=3)
    for run in range(5):
        alone = run_batch(CONFIGS[2], *(one[run : run + 1] for one in inputs), workers=1)
        for name in ("pose_q", "status", "heading_source", "twin_pose"):
            np.testing.assert_array_equal(getattr(together, name)[run], getattr(alone, name)[0])
        assert together.final_states[run] == alone.final_states[0]


def test_one_drive_serves_many_configurations_without_a_copy() -> None:
    inputs = columns([7])
    together = run_batch(CONFIGS, *inputs)
    for run, config in enumerate(CONFIGS):
        alone = run_batch(config, *inputs)
        assert together.final_states[run] == alone.final_states[0]
        assert together.pose_q is not None
        assert alone.pose_q is not None
        np.testing.assert_array_equal(together.pose_q[run], alone.pose_q[0])
        np.testing.assert_array_equal(together.pose_m_rad()[run], alone.pose_m_rad()[0])


def test_without_history_only_the_ends_are_kept_and_they_are_the_same() -> None:
    inputs = columns([1, 2])
    full, ends = run_batch(CONFIGS[1], *inputs), run_batch(CONFIGS[1], *inputs, history=False)
    assert ends.pose_q is None
    assert ends.status is None
    assert ends.twin_pose is None
    np.testing.assert_array_equal(ends.final_states, full.final_states)
    assert full.twin_pose is not None
    assert ends.final_twins is not None
    np.testing.assert_array_equal(ends.final_twins["x_m"], full.twin_pose[:, -1, 0])
    with pytest.raises(FirmwareError, match=r"no history was kept: expected run_batch\(history"):
        ends.pose_m_rad()


def test_without_twin_the_firmware_is_the_same() -> None:
    inputs = columns([1, 2])
    with_twin = run_batch(CONFIGS[1], *inputs)
    without = run_batch(CONFIGS[1], *inputs, twin=False)
    assert without.twin_pose is None
    assert without.final_twins is None
    np.testing.assert_array_equal(without.final_states, with_twin.final_states)


def test_any_integer_type_and_memory_order_will_do() -> None:
    left, right, gyro, encoder, gyro_validity = columns([1, 2])
    plain = run_batch(CONFIGS[1], left % 65536, right % 65536, gyro, encoder, gyro_validity)
    narrow = run_batch(
        CONFIGS[1],
        np.asfortranarray((left % 65536).astype(np.uint16)),
        (right % 65536).astype(np.int32),
        gyro.astype(np.uint32)[:, ::1],
        encoder.astype(np.uint8),
        gyro_validity.tolist(),
    )
    np.testing.assert_array_equal(narrow.final_states, plain.final_states)


def test_left_out_validities_mean_fresh() -> None:
    left, right, gyro, encoder, _ = columns([1])
    fresh = np.zeros_like(encoder)
    np.testing.assert_array_equal(
        run_batch(CONFIGS[0], left, right, gyro).final_states,
        run_batch(CONFIGS[0], left, right, gyro, fresh, fresh).final_states,
    )


def test_no_runs_and_no_ticks_are_empty_results() -> None:
    nothing = np.zeros((0, 10), dtype=np.int64)
    runs = run_batch(CONFIGS[0], nothing, nothing, nothing)
    assert runs.final_states.shape == (0,)
    assert runs.pose_m_rad().shape == (0, 10, 3)
    start = run_batch(CONFIGS[0], *(np.zeros((2, 0), dtype=np.int64),) * 3)
    assert start.final_states["gyro_offset_q"].tolist() == [ZERO_CODE << 16] * 2
    assert start.pose_m_rad().shape == (2, 0, 3)


def test_poses_come_in_metres_and_unwrapped_radians() -> None:
    quarter = 1 << 30
    headings = [0, quarter, 2 * quarter - 1, -quarter, 0, quarter]  # once round and on
    pose_q = np.array([[1 << 32, -(1 << 31), heading] for heading in headings])
    poses = pose_m_rad(CONFIGS[0], pose_q)
    assert poses[0].tolist() == [1.0, -0.5, 0.0]
    np.testing.assert_allclose(
        poses[:, 2], [0, math.pi / 2, math.pi, 1.5 * math.pi, 2 * math.pi, 2.5 * math.pi], atol=2e-9
    )


def test_wrong_arrays_are_refused_in_one_line() -> None:
    good = np.zeros((2, 10), dtype=np.int64)
    for arguments, message in (
        (
            (good.astype(float), good, good),
            r"left_count: float64 array of shape \(2, 10\): expected integers of shape",
        ),
        ((good, good[0], good), r"right_count: int64 array of shape \(10,\): expected integers"),
        ((good, good, good[:, :9]), r"gyro_code: shape \(2, 9\): expected \(2, 10\)"),
        ((good, good, good, good + 300), r"encoder_validity: values 300 to 300: expected 0, 1"),
        ((good, good, good, None, good > 0), r"gyro_validity: bool array"),
    ):
        with pytest.raises(FirmwareError, match=message):
            run_batch(CONFIGS[0], *arguments)  # type: ignore[arg-type]
    with pytest.raises(FirmwareError, match="config: 3 configurations for 2 runs"):
        run_batch(CONFIGS, good, good, good)
