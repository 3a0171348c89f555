"""The package's public surface works from its front door."""

import math

import numpy as np

import firmware_model
from firmware_model import (
    FRESH,
    STATE_FIELDS,
    FirmwareConstants,
    FirmwareDescription,
    Kernel,
    build_config,
    run_batch,
)


def test_every_public_name_exists() -> None:
    assert all(hasattr(firmware_model, name) for name in firmware_model.__all__)


def test_ten_straight_ticks_give_the_same_integers_in_three_ways() -> None:
    constants = FirmwareConstants(
        wheel_radius_m=0.05,
        wheelbase_m=0.3,
        ticks_per_rev=2048,
        counter_bits=16,
        tick_period_s=0.01,
        gyro_sensitivity_rad_s_per_lsb=1.33e-4,
        gyro_zero_rate_code=32768,
        gyro_min_code=18,
        gyro_max_code=65518,
        max_wheel_rate_rad_s=30.0,
    )
    config = build_config(FirmwareDescription(), constants)
    counts = [(40 * tick) % 65536 for tick in range(11)]
    codes = [32768] * 11
    batch = run_batch(config, [counts], [counts], [codes])
    final = dict(zip(STATE_FIELDS, batch.final_states[0].item(), strict=True))
    for implementation in ("python", "compiled"):
        kernel = Kernel(config, implementation)
        for count, code in zip(counts, codes, strict=True):
            kernel.step(count, count, FRESH, code, FRESH)
        assert kernel.state() == final
    travelled_m = 400 * 2 * math.pi * 0.05 / 2048
    assert np.isclose(batch.pose_m_rad()[0, -1, 0], travelled_m, atol=1e-8)
