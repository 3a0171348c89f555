"""What no listed effect explains: a stage's residual plus a smooth function of a variable.

Each alternative adds a few columns: a function of one variable (hats over its range, or two
harmonics of an angle) on every way in which a stage can err. Its evidence is compared with the
library's on equal terms; what wins says on what the leftover depends, without naming a cause.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.motion.evidence import gram_of
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import Nodes, residuals
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.prediction import Motion, Prediction
from gap_diagnosis.recording import Floats

_HATS: Final = 5
_SCALES: Final = 4
_HARMONICS: Final = 2
_LEAST_RANGE: Final = {
    "speed": 0.05,
    "acceleration": 0.1,
    "turn_rate": 0.1,
    "lateral_acceleration": 0.05,
}
"""A variable that varies less [SI] is noise: a function of it would fit the noise."""


@dataclass(frozen=True)
class Way:
    """One way in which a stage can err: what a unit function adds, and usual sizes."""

    stage: str
    act: Callable[[Prediction, Floats], None]
    low: float
    high: float
    needs_reference: bool = False
    needs_gyro: bool = False


@dataclass(frozen=True)
class Alternative:
    """A stage whose residual depends smoothly on a variable.

    Attributes:
        stage, variable: which.
        log_evidence: less that of no effect, at the same noise levels.
        log_likelihood: gain at the best coefficients.
        share: of the whitened residual's energy above noise that it takes.
        windows: [start_s, stop_s] where it does not act at all times.
    """

    stage: str
    variable: str
    log_evidence: float
    log_likelihood: float
    share: float
    windows: tuple[tuple[float, float], ...] = ()


def _forward(p: Prediction, f: Floats) -> None:
    p.left_m = p.left_m * (1 + f)
    p.right_m = p.right_m * (1 + f)


def _each_wheel(p: Prediction, f: Floats) -> None:
    p.left_m = p.left_m * (1 + f[0])
    p.right_m = p.right_m * (1 + f[1])


def _turn(p: Prediction, f: Floats) -> None:
    p.yaw_rad = p.yaw_rad + f * 0.5 * (np.abs(p.left_m) + np.abs(p.right_m)) / p.wheelbase_m


def _lateral(p: Prediction, f: Floats) -> None:
    p.lateral_m = p.lateral_m + f * 0.5 * (np.abs(p.left_m) + np.abs(p.right_m))


def _left(p: Prediction, f: Floats) -> None:
    p.left_m = p.left_m * (1 + f)


def _right(p: Prediction, f: Floats) -> None:
    p.right_m = p.right_m * (1 + f)


def _gyro(p: Prediction, f: Floats) -> None:
    p.gyro_rad_s = p.gyro_rad_s + f


def _gyro_gain(p: Prediction, f: Floats) -> None:
    p.gyro_rad_s = p.gyro_rad_s * (1 + f)


def _reference_along(p: Prediction, f: Floats) -> None:
    p.reference_forward_m = p.reference_forward_m + f


def _reference_across(p: Prediction, f: Floats) -> None:
    p.reference_left_m = p.reference_left_m + f


def _reference_heading(p: Prediction, f: Floats) -> None:
    p.reference_heading_rad = p.reference_heading_rad + f


_GYRO: Final = (Way("gyro", _gyro, 1e-3, 0.1, needs_gyro=True),)
_DRIFTING: Final = (*_GYRO, Way("gyro", _gyro_gain, 1e-3, 0.1, needs_gyro=True))
_WAYS: Final[Mapping[str, tuple[Way, ...]]] = {
    "wheel": (
        Way("wheel", _forward, 1e-3, 0.1),
        Way("wheel", _turn, 1e-3, 0.1),
        Way("wheel", _lateral, 1e-3, 0.1, needs_reference=True),
    ),
    "encoder": (Way("encoder", _left, 1e-3, 0.1), Way("encoder", _right, 1e-3, 0.1)),
    # From three tolerances of the bias on: every gyro's bias wanders by less.
    "gyro": _GYRO,
    "reference": (
        Way("reference", _reference_along, 1e-3, 0.2, needs_reference=True),
        Way("reference", _reference_across, 1e-3, 0.2, needs_reference=True),
        Way("reference", _reference_heading, 1e-3, 0.1, needs_reference=True),
    ),
}
_OWN_WAYS: Final[Mapping[tuple[str, str], tuple[Way, ...]]] = {
    # On each wheel's own motion, not on the body's.
    ("wheel", "acceleration"): (Way("wheel", _each_wheel, 1e-3, 0.1),),
    # What drifts with its surroundings may be the scale as well as the bias.
    ("gyro", "temperature"): _DRIFTING,
    ("gyro", "supply"): _DRIFTING,
    ("gyro", "time"): _DRIFTING,
}
"""Ways in which a variable acts where they are not the stage's."""
_VARIABLES: Final[Mapping[str, tuple[str, ...]]] = {
    "wheel": (
        "speed",
        "acceleration",
        "turn_rate",
        "lateral_acceleration",
        "direction",
        "heading",
        "distance",
        "time",
    ),
    "encoder": ("wheel_angle_left", "wheel_angle_right"),
    "gyro": (
        "turn_rate",
        "speed",
        "acceleration",
        "lateral_acceleration",
        "temperature",
        "supply",
        "time",
    ),
    # Not with time: every reference wanders about slowly, and that is noise.
    "reference": ("heading", "place"),
}


def alternatives(
    model: MotionModel, levels: Floats, settings: tuple[Setting, ...] = ()
) -> list[Alternative]:
    """Return every stage and variable with its evidence beside *settings*, best first."""
    nodes = model.nodes
    smooth = nodes.smooth
    nominal = residuals(nodes, predict(smooth, settings))
    data = model.columns.values[..., 0] + nominal - residuals(nodes, predict(smooth))
    columns = [data, *(model.columns.values[..., index + 1] for index, _ in
                          model.columns.nuisances)]  # fmt: skip
    nuisances = [(place, sd) for place, (_, sd) in enumerate(model.columns.nuisances)]
    plans: list[tuple[str, str, list[tuple[int, Way]]]] = []
    for stage, ways in _WAYS.items():
        for variable in _VARIABLES[stage]:
            of_each_wheel = (stage, variable) == ("wheel", "acceleration")
            functions = _by_acceleration(smooth) if of_each_wheel else basis(smooth, variable)
            placed: list[tuple[int, Way]] = []
            for way in _usable(nodes, _OWN_WAYS.get((stage, variable), ways)):
                for function in functions:
                    step = math.sqrt(way.low * way.high)
                    prediction = predict(smooth, settings)
                    way.act(prediction, step * function)
                    columns.append((nominal - residuals(nodes, prediction)) / step)
                    placed.append((len(columns) - 2, way))
            if placed:
                plans.append((stage, variable, placed))
    values = np.ascontiguousarray(np.stack(columns, axis=-1))
    white, log_determinant, rows = whiten(values, model.course, levels, nodes.ticks)
    gram = gram_of(white.T @ white, log_determinant, rows, nuisances, levels)
    above_noise = max(float(white[:, 0] @ white[:, 0]) - rows, 1.0)
    found = []
    for stage, variable, placed in plans:
        index = np.array([column for column, _ in placed])
        inner, data = gram.inner[np.ix_(index, index)], gram.data[index]
        evidences = []
        likelihood = 0.0
        for step in range(_SCALES):
            share = step / (_SCALES - 1)
            scale = np.array([way.low * (way.high / way.low) ** share for _, way in placed])
            small = np.eye(len(index)) + scale[:, None] * inner * scale
            solved = np.linalg.solve(small, scale * data)
            evidences.append(
                0.5 * float((scale * data) @ solved) - 0.5 * float(np.linalg.slogdet(small)[1])
            )
            mean = scale * solved
            likelihood = max(likelihood, float(data @ mean - 0.5 * mean @ inner @ mean))
        evidence = float(np.logaddexp.reduce(evidences)) - math.log(_SCALES)
        found.append(
            Alternative(stage, variable, evidence, likelihood, min(2 * likelihood / above_noise, 1))
        )
        if (stage, variable) == ("gyro", "turn_rate") and smooth.gyro_code is not None:
            # Which code there should be, the wheels' turn rate says: a function of the codes that
            # there are would explain their noise with itself.
            found.append(replace(found[-1], variable="adc_code"))
    return sorted(found, key=lambda one: -one.log_evidence)


def _usable(nodes: Nodes, ways: Sequence[Way]) -> list[Way]:
    return [
        way
        for way in ways
        if (nodes.has_reference or not way.needs_reference)
        and (nodes.has_gyro or not way.needs_gyro)
    ]


def basis(motion: Motion, variable: str) -> list[Floats]:
    """Return functions of a variable, float64[n] each; none where it does not vary."""
    if variable in {"heading", "wheel_angle_left", "wheel_angle_right"}:
        angle = {
            "heading": motion.heading_rad,
            "wheel_angle_left": motion.left_angle_rad,
            "wheel_angle_right": motion.right_angle_rad,
        }[variable]
        return [
            function(order * angle)
            for order in range(1, _HARMONICS + 1)
            for function in (np.cos, np.sin)
        ]
    if variable == "direction":
        forward = np.tanh(motion.speed_m_s / 0.02)
        return [forward] if np.ptp(forward) > 1 else []
    if variable == "place":
        return [*_hats(motion.x_m), *_hats(motion.y_m)]
    value = _variable(motion, variable)
    least = _LEAST_RANGE.get(variable, 0.0)
    if value is None or np.subtract(*np.percentile(value, [95, 5])) < least:
        return []
    return _hats(value)


def _by_acceleration(motion: Motion) -> list[Floats]:
    """Return functions of each wheel's speeding up, float64[2, n] each."""
    rates = np.array([motion.left_rate_rad_s, motion.right_rate_rad_s])
    changes = np.array([motion.left_acceleration_rad_s2, motion.right_acceleration_rad_s2])
    value = motion.radius_m * changes * np.sign(rates)
    if np.subtract(*np.percentile(value, [95, 5])) < _LEAST_RANGE["acceleration"]:
        return []
    return _hats(value)


def _variable(motion: Motion, name: str) -> Floats | None:
    if name == "distance":
        return np.asarray(np.cumsum(np.abs(motion.speed_m_s) * motion.dt_s))
    known: dict[str, Floats | None] = {
        "speed": motion.speed_m_s,
        "acceleration": motion.acceleration_m_s2,
        "turn_rate": motion.turn_rate_rad_s,
        "lateral_acceleration": motion.speed_m_s * motion.turn_rate_rad_s,
        "temperature": motion.warm_k,
        "supply": motion.supply_error,
        "time": motion.elapsed_s,
    }
    return known[name]


def _hats(value: Floats) -> list[Floats]:
    """Return hats over the range between the 1st and 99th percentile."""
    low, high = np.percentile(value, [1, 99])
    if not high - low > 1e-9 * max(abs(low), abs(high), 1.0):
        return []
    place = np.clip((value - low) / (high - low), 0, 1) * (_HATS - 1)
    return [np.maximum(0.0, 1 - np.abs(place - index)) for index in range(_HATS)]
