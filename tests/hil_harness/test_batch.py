"""The bus path and the batch path are one: the same odometry, bit for bit."""

from pathlib import Path

import numpy as np
import pytest

from hil_harness import RunConfig, load_robot, load_wire, run, run_scenario_batch, scenario


@pytest.mark.parametrize("name", ["lesson", "square_cw", "stop_and_go", "random"])
def test_bus_and_batch_give_the_same_odometry_bit_for_bit(name: str, tmp_path: Path) -> None:
    robot, seed, ticks = load_robot(None), 7, 1500
    wire = load_wire()
    over_the_bus = run(
        RunConfig(
            scenario=scenario(name),
            robot=robot,
            seed=seed,
            duration_s=ticks * wire.tick_period_us * 1e-6,
        )
    )
    batch = run_scenario_batch(scenario(name), robot, wire, [3, seed], ticks=ticks)
    final = batch.firmware.final_states[1]
    assert {key: int(final[key]) for key in final.dtype.names} == dict(over_the_bus.kernel_state)
    assert np.array_equal(batch.firmware.pose_m_rad()[1], over_the_bus.firmware)
    assert np.array_equal(batch.truth[-1], over_the_bus.truth)
    assert batch.firmware.twin_pose is not None
    assert np.array_equal(batch.firmware.twin_pose[1], over_the_bus.float_twin)
