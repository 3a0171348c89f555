"""One source, three ways to run it, the same integers: Python, machine code, batch."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import Inputs, config_of, configs, inputs

from firmware_model import STATE_FIELDS, Kernel, KernelConfig, StatusBit, run_batch


def random_ticks(config: KernelConfig, seed: int, count: int) -> npt.NDArray[np.int64]:
    """Return int64 [count, 5] inputs: a drive with pauses, spins, reversals, glitches, dropouts."""
    rng = np.random.default_rng(seed)
    fastest = config.max_step_ticks
    held = rng.integers(1, 200, size=count // 20 + 1)
    phases = np.repeat(np.arange(held.size), held)[:count]
    kinds = rng.integers(0, 4, size=held.size)[phases]
    speeds = rng.integers(-fastest, fastest + 1, size=(held.size, 2))[phases]
    speeds[kinds == 0] = 0
    sway = np.where(kinds == 2, np.sin(np.arange(count) / 20.0), 1.0)  # a frozen gyro is noticed
    steps = np.rint(speeds * sway[:, None]).astype(np.int64)
    steps[:, 1] += rng.integers(-1, 2, size=count) * (kinds == 1)
    counts = np.cumsum(np.clip(steps, -fastest, fastest), axis=0)
    counts[rng.random(count) < 0.002] += 20_000
    rates = rng.normal(0.0, 12_000.0, size=held.size)[phases]
    codes = np.rint(32768 + rates * (kinds != 0) + rng.normal(0, 15, count) * (kinds != 2))
    ticks = np.empty((count, 5), dtype=np.int64)
    ticks[:, :2] = counts
    ticks[:, 2] = rng.choice([0, 1, 2], p=[0.98, 0.01, 0.01], size=count)
    ticks[:, 3] = np.clip(codes, 0, 65535)
    ticks[:, 4] = rng.choice([0, 1, 2], p=[0.98, 0.01, 0.01], size=count)
    gap_start = rng.integers(0, max(count - 400, 1))
    ticks[gap_start : gap_start + 400, 2] = 1  # longer than the gap limit
    return ticks


@given(st.data())
@settings(max_examples=100)
def test_python_and_machine_code_agree_in_the_whole_state_after_every_tick(
    data: st.DataObject,
) -> None:
    config = data.draw(configs())
    oracle, compiled = Kernel(config, "python"), Kernel(config, "compiled")
    assert compiled.state() == oracle.state()
    for tick in data.draw(inputs(config)):
        oracle.step(*tick)
        compiled.step(*tick)
        assert compiled.state() == oracle.state()
        assert (compiled.v_m_s_q, compiled.w_rad_s_q) == (oracle.v_m_s_q, oracle.w_rad_s_q)


@given(st.data())
@settings(max_examples=30)
def test_a_batch_ends_in_the_state_of_the_oracle(data: st.DataObject) -> None:
    config = data.draw(configs())
    ticks = data.draw(inputs(config))
    ticks = [tick._replace(encoder_validity=abs(tick.encoder_validity)) for tick in ticks]
    ticks = [tick._replace(gyro_validity=abs(tick.gyro_validity)) for tick in ticks]
    oracle = Kernel(config, "python")
    for tick in ticks:
        oracle.step(*tick)
    columns = np.array(ticks, dtype=np.int64).T[:, None, :]
    batch = run_batch(config, columns[0], columns[1], columns[3], columns[2], columns[4])
    assert dict(zip(STATE_FIELDS, batch.final_states[0].item(), strict=True)) == oracle.state()


MODES = [
    {"mode": mode, "integration": rule}
    for mode in ("wheel", "gyro", "blend")
    for rule in ("euler_before", "midpoint", "euler_after")
]


@pytest.mark.parametrize("firmware", MODES, ids=lambda one: "-".join(one.values()))
def test_every_mode_and_rule_agrees_tick_by_tick_over_a_long_random_drive(
    firmware: dict[str, str], size: str
) -> None:
    """Small: 3 · 10³ ticks in each of nine modes. Full: 10⁷ compiled steps in all."""
    count = 3_000 if size == "small" else 10_000_000 // len(MODES) + 1
    chunk = min(count, 50_000)
    config = config_of(
        **firmware,
        trig={"method": "cordic"} if firmware["integration"] == "euler_after" else {},
    )
    for start in range(0, count, chunk):
        oracle = Kernel(config, "python")
        ticks = random_ticks(config, seed=start, count=chunk)
        columns = ticks.T[:, None, :]
        batch = run_batch(config, columns[0], columns[1], columns[3], columns[2], columns[4])
        assert batch.pose_q is not None
        assert batch.status is not None
        histories = zip(
            ticks.tolist(), batch.pose_q[0].tolist(), batch.status[0].tolist(), strict=True
        )
        for tick, pose_q, status in histories:
            oracle.step(*tick)
            state = oracle._state
            assert [state.x_m_q, state.y_m_q, state.heading_turn_q] == pose_q
            assert state.status == status
        final = dict(zip(STATE_FIELDS, batch.final_states[0].item(), strict=True))
        assert final == oracle.state()


def test_the_random_drive_meets_every_status_bit() -> None:
    """The soak above would prove little if it never left the plain path."""
    config = config_of()
    seen = 0
    for seed in range(4):
        columns = random_ticks(config, seed, 50_000).T[:, None, :]
        batch = run_batch(config, columns[0], columns[1], columns[3], columns[2], columns[4])
        assert batch.status is not None
        seen |= int(np.bitwise_or.reduce(batch.status[0]))
    default_words_do_not_overflow = {"OVERFLOW"}
    assert {bit.name for bit in StatusBit if not seen & bit} == default_words_do_not_overflow


def test_inputs_are_counts_and_codes_of_any_integer_type() -> None:
    assert Inputs(1, 2).gyro_code == 32768
    config = config_of()
    small, wide = Kernel(config), Kernel(config)
    for tick in range(5):
        small.step(np.uint16(tick), np.uint16(tick), np.int8(0), np.uint16(32800), np.int8(0))  # type: ignore[arg-type]
        wide.step(tick, tick, 0, 32800, 0)
    assert small.state() == wide.state()
