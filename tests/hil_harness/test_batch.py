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


def test_many_seeds_split_the_error_into_a_systematic_and_a_random_part() -> None:
    runs = 200
    batch = run_scenario_batch(
        scenario("lesson"), load_robot(None), load_wire(), range(runs), ticks=1001, twin=False
    )
    heading = batch.split_final_error()["heading_rad"]
    # Ten seconds: the mean is b_g·t, to half a converter step; the spread is σ·√(T·t).
    assert heading.runs == runs
    assert heading.systematic == pytest.approx(
        0.005 * 10, abs=4 * heading.random / runs**0.5 + 10 / 7505.7 / 2
    )
    predicted = 0.0002 * 10**0.5
    assert heading.random == pytest.approx(predicted, rel=4 / (2 * runs) ** 0.5)
    assert heading.random in heading.random_interval
