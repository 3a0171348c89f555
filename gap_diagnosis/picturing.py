"""The arrays that a report draws: residuals, their map over the log, held-out trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, cast

import numpy as np

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.gap.odometry import odometry_path
from gap_diagnosis.gap.windows import Window
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.pictures import HeldOutPath, Pictures, ResidualMap, ResidualSeries
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.result_parts import ResidualRow, ResidualTimes, StageOrNone
from gap_diagnosis.touching import (
    WHEEL_HEADING_AGAINST_GYRO,
    WHEEL_HEADING_AGAINST_REFERENCE,
    WHEELS_AGAINST_REFERENCE,
    stages_that_touch,
)
from hil_harness.robot import Robot

_PATHS: Final = 6
_WINDOWS: Final = 12


def pictures_of(
    recording: Recording,
    model: MotionModel,
    windows: Sequence[Window],
    settings: Sequence[Setting],
    *,
    motion: Motion | None = None,
    robot: Robot | None = None,
    apart: Sequence[ResidualSeries] = (),
    missing: Sequence[str] = (),
) -> Pictures:
    """Return residuals of the fitted log, and trajectories over *windows* of *recording*.

    *apart* are residuals beside the motion's, *missing* those that the log has no data for.
    """
    series = (*_residuals(model, settings), *apart)
    paths: tuple[HeldOutPath, ...] = ()
    if motion is not None and robot is not None:
        paths = tuple(
            path
            for window in _longest(windows)
            if (path := _path(recording, robot, motion, window, settings)) is not None
        )
    if not model.nodes.has_reference:
        missing = [f"{WHEELS_AGAINST_REFERENCE}: no reference", *missing]
    if not model.nodes.has_gyro:
        missing = [f"{WHEEL_HEADING_AGAINST_GYRO}: no gyro", *missing]
    known = _map(series)
    even = [one.name for one in series if known is None or one.name not in known.stages]
    return Pictures(
        series, known, paths, (*missing, *(f"{name}: the same all along" for name in even))
    )


_CHANNELS: Final = (
    ("wheel", f"{WHEELS_AGAINST_REFERENCE}, along x", "m"),
    ("wheel", f"{WHEELS_AGAINST_REFERENCE}, along y", "m"),
    ("wheel", WHEEL_HEADING_AGAINST_REFERENCE, "rad"),
    ("gyro", WHEEL_HEADING_AGAINST_GYRO, "rad"),
)


def _residuals(model: MotionModel, settings: Sequence[Setting]) -> tuple[ResidualSeries, ...]:
    nodes = model.nodes
    t_s = nodes.mean(nodes.motion.t_s)
    before = residuals(nodes, predict(nodes.motion))
    after = residuals(nodes, predict(nodes.motion, settings)) if settings else None
    found = []
    for channel, (stage, name, unit) in enumerate(_CHANNELS):
        if np.isfinite(before[channel]).any():
            found.append(
                ResidualSeries(
                    stage,
                    name,
                    unit,
                    t_s,
                    _from_zero(before[channel]),
                    None if after is None else _from_zero(after[channel]),
                )
            )
    return tuple(found)


def _from_zero(values: Floats) -> Floats:
    known = np.flatnonzero(np.isfinite(values))
    return np.asarray(values - values[known[0]])


def _map(series: Sequence[ResidualSeries]) -> ResidualMap | None:
    """Return in which twelfth of the log how much of each residual's own energy arises."""
    if not series:
        return None
    first = series[0].t_s
    edges = np.linspace(first[0], first[-1], _WINDOWS + 1)
    rows: dict[str, Floats] = {}
    stages: list[str] = []
    for one in series:
        known = np.isfinite(one.value)
        if known.sum() < 2:
            continue
        t_s, value = one.t_s[known], one.value[known]
        if one.is_sum:
            energy = np.diff(np.interp(edges, t_s, value)) ** 2
        else:
            place = np.clip(np.searchsorted(edges, t_s[1:]) - 1, 0, _WINDOWS - 1)
            energy = np.bincount(place, np.diff(value) ** 2, minlength=_WINDOWS)
        total = float(energy.sum())
        if total > 0:
            rows[one.name] = energy / total
            stages.append(one.stage)
    if not rows:
        return None
    return ResidualMap(edges, tuple(rows), np.array(list(rows.values())), tuple(stages))


def residual_times(pictures: Pictures) -> ResidualTimes | None:
    """Return the map of residuals as the answer has it; None without one."""
    known = pictures.residual_map
    if known is None:
        return None
    return ResidualTimes(
        edges_s=tuple(float(edge) for edge in known.edges_s),
        rows=tuple(
            ResidualRow(
                stage=cast(StageOrNone, stage),
                touched_by=stages_that_touch(name),
                residual=name,
                shares=tuple(map(float, shares)),
            )
            for stage, name, shares in zip(known.belongs, known.stages, known.shares, strict=True)
        ),
        missing=pictures.missing,
    )


def _longest(windows: Sequence[Window]) -> list[Window]:
    ordered = sorted(windows, key=lambda one: one.start_s - one.stop_s)[:_PATHS]
    return sorted(ordered, key=lambda one: one.start_s)


def _path(
    recording: Recording,
    robot: Robot,
    motion: Motion,
    window: Window,
    settings: Sequence[Setting],
) -> HeldOutPath | None:
    """Return one stretch three times, moved so that it starts in the origin along x."""
    inside = (motion.t_s >= window.start_s) & (motion.t_s <= window.stop_s)
    if inside.sum() < 3:
        return None
    reference = recording.reference
    measured = None
    if reference is not None:
        span = (reference.t_s >= window.start_s) & (reference.t_s <= window.stop_s)
        if span.sum() < 3:
            return None
        heading = float(np.interp(window.start_s, motion.t_s, motion.heading_rad))
        measured = _moved(reference.x_m[span], reference.y_m[span], heading)
    tracks = []
    for effects in ((), settings):
        path = odometry_path(predict(motion, effects), robot)
        heading_rad = np.zeros(1) if path.heading_rad is None else path.heading_rad[inside]
        tracks.append(_moved(path.x_m[inside], path.y_m[inside], float(heading_rad[0])))
    start_s, stop_s = (at_s - recording.t_s[0] for at_s in (window.start_s, window.stop_s))
    name = f"{recording.name}, {start_s:.0f} to {stop_s:.0f} s"
    return HeldOutPath(name, measured, tracks[0], tracks[1] if settings else None)


def _moved(x_m: Floats, y_m: Floats, heading_rad: float) -> Floats:
    cosine, sine = np.cos(heading_rad), np.sin(heading_rad)
    dx, dy = x_m - x_m[0], y_m - y_m[0]
    return np.column_stack([cosine * dx + sine * dy, -sine * dx + cosine * dy])
