"""What no named program explains: how large it is, and on what it depends."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.firmware.comparison import Windows
from gap_diagnosis.recording import Floats

_MOST_VARIABLES: Final = 2
_LEAST_SHARE: Final = 0.05


@dataclass(frozen=True)
class Leftover:
    """The part of the odometry that the best named program leaves.

    Attributes:
        size: root mean square over windows of misfit over practical floor; below about 1 there is
            nothing left.
        position_m: root mean square of the windows' position misfit.
        depends_on: variable and share of the misfit's square that a smooth function of it
            explains, largest first.
        windows: [start_s, stop_s] of stretches where it is beyond the floor.
        log_evidence: of "some other arithmetic" against the described program, in nats.
    """

    size: float
    position_m: float
    depends_on: tuple[tuple[str, float], ...]
    windows: tuple[tuple[float, float], ...]
    log_evidence: float


def regressors(windows: Windows, t_s: Floats) -> Mapping[str, Floats]:
    """Return for each variable a few columns float64[w, c] that a smooth dependence is made of.

    Each is the integral over the window of a function of the variable.
    """
    each = row_by_row(windows.pose, t_s[windows.rows])
    return {name: np.add.reduceat(columns, windows.first) for name, columns in each.items()}


def row_by_row(pose: Floats, time_s: Floats) -> Mapping[str, Floats]:
    """Return for each variable what each row adds to those integrals, float64[r, c], on a path
    *pose*, float64[r, 3]."""
    step = np.diff(pose, axis=0, prepend=pose[:1])
    interval_s = np.maximum(np.diff(time_s, prepend=time_s[0]), 1e-6)
    forward = np.cos(pose[:, 2]) * step[:, 0] + np.sin(pose[:, 2]) * step[:, 1]
    speed, rate = forward / interval_s, step[:, 2] / interval_s

    def during(*columns: Floats) -> Floats:
        return np.column_stack([column * interval_s for column in columns])

    one = np.ones_like(speed)
    heading = pose[:, 2]
    size = np.abs(speed)
    return {
        "speed": during(speed, size, speed * size),
        "turn_rate": during(rate, np.abs(rate), rate * np.abs(rate)),
        "acceleration": during(np.gradient(speed) / interval_s),
        "lateral_acceleration": during(speed * rate),
        "direction": during(np.sign(speed) * (size > 1e-9)),
        "heading": during(
            *(f(order * heading) * size for order in (1, 2, 4) for f in (np.cos, np.sin))
        ),
        "distance": during(np.cumsum(np.abs(forward)) * size),
        "time": during(one, time_s - time_s[0]),
    }


def explained(columns: Floats, off: Floats, floor: Floats) -> Floats:
    """Return what is left of *off* after least squares on *columns*, each component by itself."""
    left = off.copy()
    for component in range(off.shape[1]):
        weight = 1.0 / floor[:, component]
        A = columns * weight[:, None]
        scale = np.sqrt(np.sum(A**2, axis=0)) + 1e-300
        coefficients = np.linalg.lstsq(A / scale, off[:, component] * weight, rcond=1e-9)[0]
        left[:, component] -= columns @ (coefficients / scale)
    return left


def flexible(windows: Windows, off: Floats, t_s: Floats) -> Floats:
    """Return what is left of *off* after a smooth function of everything that is looked at.

    With few windows only the simplest function is taken out, so that it can never fit all.
    """
    tables = list(regressors(windows, t_s).values())
    columns = np.column_stack([table[:, :1] for table in tables] + tables)
    return explained(columns[:, : max(windows.count // 4, 1)], off, windows.floor)


def describe(windows: Windows, off: Floats, t_s: Floats, log_evidence: float) -> Leftover:
    """Return the leftover of misfits *off*: its size, where it is, and what it depends on."""
    z = off / windows.floor
    bounded = np.clip(z, -1e6, 1e6)
    total = float(np.sum(bounded**2))
    shares = []
    if total > 0.0:
        for name, columns in regressors(windows, t_s).items():
            left = np.clip(explained(columns, off, windows.floor) / windows.floor, -1e6, 1e6)
            shares.append((name, max(0.0, 1.0 - float(np.sum(left**2)) / total)))
    shares.sort(key=lambda pair: -pair[1])
    beyond = np.any(np.abs(z) > 3.0, axis=1)
    time_s = t_s[windows.rows]
    return Leftover(
        size=float(np.sqrt(np.mean(bounded**2))),
        position_m=float(np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1)))),
        depends_on=tuple(
            (name, share) for name, share in shares[:_MOST_VARIABLES] if share >= _LEAST_SHARE
        ),
        windows=_joined(time_s[windows.first[beyond]], time_s[windows.last[beyond]]),
        log_evidence=log_evidence,
    )


def size_of(off: Floats, windows: Windows) -> float:
    """Return a size of misfits that a few wild windows do not dominate."""
    z = np.clip(np.nan_to_num(off, nan=1e30) / windows.floor, -1e6, 1e6)
    return float(np.sum(np.log1p(z**2)))


def _joined(start_s: Floats, stop_s: Floats) -> tuple[tuple[float, float], ...]:
    stretches: list[tuple[float, float]] = []
    for start, stop in zip(start_s.tolist(), stop_s.tolist(), strict=True):
        if stretches and start <= stretches[-1][1]:
            stretches[-1] = (stretches[-1][0], stop)
        else:
            stretches.append((start, stop))
    return tuple(stretches)
