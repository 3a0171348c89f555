"""The lesson's `simulate()` in the style in which such lessons print it.

One scalar loop, one call of the generator per draw, NumPy functions on single numbers: the rival
that the batch path is measured against, and an oracle for `hil_harness.lesson` that shares no
line with it.
"""

import numpy as np


def simulate(seed: int = 7) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return truth, wheel-only and gyro-heading trajectories, each (6000, 3)."""
    rng = np.random.default_rng(seed)
    dt = 0.01
    t = np.arange(0.0, 60.0, dt)
    v = 0.6 * np.ones_like(t)
    w = 0.10 * np.sin(2 * np.pi * t / 20.0)
    r, b, ticks = 0.05, 0.30, 2048
    r_hat, b_hat = 1.005 * r, 0.995 * b
    eps_left, eps_right = 0.002, -0.002

    truth = np.zeros((len(t), 3))
    wheel = np.zeros((len(t), 3))
    gyro = np.zeros((len(t), 3))
    for k in range(len(t) - 1):
        ds, dth = v[k] * dt, w[k] * dt
        x, y, th = truth[k]
        truth[k + 1] = [
            x + ds * np.cos(th + 0.5 * dth),
            y + ds * np.sin(th + 0.5 * dth),
            th + dth,
        ]

        phi_right = (v[k] + w[k] * b / 2) * dt / (r * (1 + eps_right))
        phi_left = (v[k] - w[k] * b / 2) * dt / (r * (1 + eps_left))
        n_right = np.round(phi_right * ticks / (2 * np.pi)) + rng.normal(0.0, 0.2)
        n_left = np.round(phi_left * ticks / (2 * np.pi)) + rng.normal(0.0, 0.2)
        w_meas = w[k] + 0.005 + rng.normal(0.0, 0.002)

        ds_right = r_hat * 2 * np.pi * n_right / ticks
        ds_left = r_hat * 2 * np.pi * n_left / ticks
        ds_hat = 0.5 * (ds_right + ds_left)
        dth_hat = (ds_right - ds_left) / b_hat

        x, y, th = wheel[k]
        wheel[k + 1] = [
            x + ds_hat * np.cos(th + 0.5 * dth_hat),
            y + ds_hat * np.sin(th + 0.5 * dth_hat),
            th + dth_hat,
        ]
        x, y, th = gyro[k]
        gyro[k + 1] = [
            x + ds_hat * np.cos(th),
            y + ds_hat * np.sin(th),
            th + w_meas * dt,
        ]
    return truth, wheel, gyro
