"""The chain of stages on a recording: which data carries the odometry's error, and when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import reduce
from typing import Final

import numpy as np

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.registry import rank_of
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.gap.manoeuvres import Kinds
from gap_diagnosis.gap.metrics import Path, path_errors, series_errors
from gap_diagnosis.gap.odometry import (
    as_reported,
    as_travelled,
    gyro_share,
    gyro_turn_rad,
    without_offset,
)
from gap_diagnosis.gap.shares import Chain, chain_of, segment_spans, segments_of
from gap_diagnosis.gap.windows import Window, segment_window
from gap_diagnosis.prediction import Motion, Prediction
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.result_parts import Segment, StageOrNone
from hil_harness.robot import Robot

_OF_WHEELS: Final = 1
"""Rank of what changes how wheels roll."""
_ALONE: Final[Mapping[str, StageOrNone]] = {
    "drive_position_m": "actuation",
    "firmware_position_m": "firmware",
    "timing_s": "bus",
}
"""Metrics that judge the simulation of one stage, whose they are: what else can show in their
residuals (`touching.TOUCHED_BY`) has others to be told by."""


def metric_chain(
    metric: str,
    recording: Recording,
    robot: Robot,
    motion: Motion,
    windows: Sequence[Window],
    effects: Sequence[Setting] = (),
) -> Chain:
    """Return the chain whose shares are those of a metric."""
    if metric in _ALONE:
        return Chain((_ALONE[metric],), np.ones((1, 1, 1)))
    return stage_chain(recording, robot, motion, windows, effects, metric=metric)[0]


def stage_chain(
    recording: Recording,
    robot: Robot,
    motion: Motion,
    windows: Sequence[Window],
    effects: Sequence[Setting] = (),
    *,
    metric: str = "odometry_position_m",
) -> tuple[Chain, tuple[int, ...]]:
    """Return the chain wheel, encoder, gyro, reference and each row's place in *windows*.

    Its errors are positions, or turns for ``turn_difference_rad`` and where there is no reference.
    With a reference the true motion is the one that the reference shows, freed of its explained
    errors: what remains unexplained falls to the stage whose data differs from it. Wheel and
    encoder share one signal, so only an explained encoder error counts as the encoder's. Without a
    reference the true turn is the explained one, and without an explanation nothing can be said:
    the chain is empty.
    """
    explained = predict(motion, effects)
    if recording.reference is not None and metric != "turn_difference_rad":
        return _position_chain(recording, robot, explained, windows)
    if motion.gyro_turn_rad is None or (recording.reference is None and not effects):
        return chain_of({"wheel": np.zeros((0, 1))}), ()
    true_rad = np.cumsum(explained.turn_rad)
    if recording.reference is not None:
        true_rad = np.interp(motion.t_s, *_heading(_truth(explained)))
    return _turn_chain(explained, true_rad, windows)


def manoeuvre_segments(
    recording: Recording,
    robot: Robot,
    motion: Motion,
    kinds: Kinds,
    effects: Sequence[Setting] = (),
    *,
    metric: str = "odometry_position_m",
) -> tuple[Segment, ...]:
    """Return each manoeuvre with the stage that carries most of the error that arises in it."""
    spans = segment_spans(motion.t_s, kinds)
    windows = [segment_window(start_s, stop_s) for start_s, stop_s, _ in spans]
    if metric in _ALONE:
        stage = _ALONE[metric]
        sole = Chain((stage,), np.ones((1, len(spans), 1)))
        return segments_of(spans, range(len(spans)), sole)
    chain, places = stage_chain(recording, robot, motion, windows, effects, metric=metric)
    return segments_of(spans, places, chain)


def _truth(explained: Prediction) -> Path:
    motion = explained.motion
    return as_travelled(explained, Path(motion.t_s, motion.x_m, motion.y_m, motion.heading_rad))


def _heading(path: Path) -> tuple[Floats, Floats]:
    return path.t_s, np.asarray(path.heading_rad)


def _position_chain(
    recording: Recording, robot: Robot, explained: Prediction, windows: Sequence[Window]
) -> tuple[Chain, tuple[int, ...]]:
    motion, reference = explained.motion, recording.reference
    if reference is None:
        raise ValueError("a chain of positions needs a reference")
    measured = Path(reference.t_s, reference.x_m, reference.y_m, reference.heading_rad)
    truth = _truth(explained)
    # Held against at the reference's own stamps, so that every link speaks of the same samples.
    true = _at(truth, reference.t_s, with_heading=reference.heading_rad is not None)
    true_rad = np.interp(motion.t_s, *_heading(truth))
    share = gyro_share(robot, motion)
    recorded = predict(motion)
    wheels = _rolled_as_known(explained)
    gyro = without_offset(motion, gyro_turn_rad(recorded), robot)

    def path(wheel: Prediction, gyro_rad: Floats) -> Path:
        heading = share * gyro_rad + (1 - share) * np.cumsum(wheel.turn_rad)
        return Path(motion.t_s, *wheel.path(heading))

    links = (
        path_errors(path(wheels, true_rad), true, windows).position,
        path_errors(path(recorded, true_rad), true, windows).position,
        path_errors(path(recorded, gyro), true, windows).position,
        path_errors(as_reported(recorded, path(recorded, gyro)), measured, windows).position,
    )
    # Against positions alone, a window in which one link's path hardly moves is left out of it.
    shared = reduce(np.intersect1d, [one.window for one in links])
    ends = [one.end[np.isin(one.window, shared)] for one in links]
    stages: tuple[StageOrNone, ...] = ("wheel", "encoder", "gyro", "reference")
    return chain_of(dict(zip(stages, ends, strict=True))), tuple(map(int, shared))


def _turn_chain(
    explained: Prediction, true_rad: Floats, windows: Sequence[Window]
) -> tuple[Chain, tuple[int, ...]]:
    motion = explained.motion
    recorded = predict(motion)
    wheels_rad = np.cumsum(_rolled_as_known(explained).turn_rad)
    counted_rad = np.cumsum(recorded.turn_rad)
    links = [
        series_errors(motion.t_s, difference, windows)
        for difference in (
            wheels_rad - true_rad,
            counted_rad - true_rad,
            counted_rad - gyro_turn_rad(recorded),
        )
    ]
    return chain_of({"wheel": links[0].end, "encoder": links[1].end, "gyro": links[2].end}), tuple(
        int(place) for place in links[0].window
    )


def _rolled_as_known(explained: Prediction) -> Prediction:
    """Return wheels as they are known rolling by the explained turns: encoder errors are gone."""
    wheels = Prediction(explained.motion)
    wheels.left_rad, wheels.right_rad = explained.left_rad, explained.right_rad
    wheels.roll()
    for variant, sizes in explained.motion.granted:
        if rank_of(variant) == _OF_WHEELS:
            variant.apply(wheels, sizes)
    return wheels


def _at(path: Path, t_s: Floats, *, with_heading: bool) -> Path:
    x_m, y_m = np.interp(t_s, path.t_s, path.x_m), np.interp(t_s, path.t_s, path.y_m)
    heading = None
    if with_heading and path.heading_rad is not None:
        heading = np.interp(t_s, path.t_s, path.heading_rad)
    return Path(t_s, x_m, y_m, heading)
