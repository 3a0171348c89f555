"""Whichever kernel the firmware node runs, the bus carries the same bytes."""

from __future__ import annotations

from pathlib import Path

import pytest

from firmware_model.kernel import IMPLEMENTATIONS
from hil_harness.assembly import RunConfig
from hil_harness.robot import load_robot
from hil_harness.running import run
from hil_harness.scenarios import scenario, scenario_names


@pytest.mark.parametrize("name", scenario_names())
def test_every_kernel_puts_the_same_bytes_on_the_bus(name: str, tmp_path: Path, size: str) -> None:
    """Small: the first 2 s of each scenario. Full: the whole of it, or its first two minutes."""
    whole_s = scenario(name).duration_s
    duration_s = 2.0 if size == "small" else min(whole_s, 120.0)
    logs, states = set(), []
    for kernel in IMPLEMENTATIONS:
        log = tmp_path / f"{kernel}.log"
        config = RunConfig(
            scenario=scenario(name),
            robot=load_robot(None),
            duration_s=duration_s,
            kernel=kernel,
            log=log,
        )
        states.append(dict(run(config).kernel_state))
        logs.add(log.read_bytes())
    assert len(logs) == 1
    assert states[1:] == states[:-1]
