"""What the ECU had in hand in each tick, from when each frame came.

A frame that comes after its tick is used in a later one, and one out of sequence not at all: the
log knows it, for it has the stamps. The firmware's answers carry the tick of the encoder frame that
they used, so that their rows move with it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from can_bus import Arrivals, MessageSpec
from firmware_model import FRESH, STALE
from gap_diagnosis.firmware.inputs import ReplayInputs
from gap_diagnosis.recording import Floats, FrameTimes, Ints, Recording
from hil_harness.assembly import Wire
from hil_harness.effect_runs import accepted_frames, ticks_of_answers
from hil_harness.nodes.schedule import cycle_of

Validity = NDArray[np.int8]

_CLEARLY: Final = 10.0
_EARLIEST: Final = 10
_TRIED: Final = 24
"""So many delays are replayed,"""
_MOST_COMPARED: Final = 500
"""of so many: of a poll's period hardly off the tick's, each is another frame's."""
_NOT_LATE_US: Final = 2
"""Stamps are whole microseconds, and so is the line through them."""


@dataclass(frozen=True)
class Arrived:
    """Inputs by the ECU's own ticks.

    Attributes:
        inputs: what the kernel was handed.
        places: int64[n], the tick whose answer each row of the recording shows.
        repeats: ticks whose answer carried a counter that an earlier one had carried.
    """

    inputs: ReplayInputs
    places: Ints
    repeats: Ints


def as_arrived(inputs: ReplayInputs, recording: Recording, wire: Wire) -> Iterator[Arrived]:
    """Yield the inputs as the ECU had them; nothing where no frame was late, or nobody can tell.

    First as the stamps say. What all frames are late by alike, they do not: a poll may take them
    all half a millisecond later, and then some in the next tick. So then as they would have come
    later by so much that some more of them miss their tick, until replays agree with the answers.
    """
    specs = _sensors(inputs, recording, wire)
    if not specs:
        return
    late = _delays_us(recording, list(specs))
    if max(float(one.max()) for one in late.values()) <= _NOT_LATE_US:
        return
    for more_us in (0.0, *_more_us(late, recording, wire)):
        by = {name: np.rint(delay_us + more_us) for name, delay_us in late.items()}
        yield _as_late(by, inputs, recording, wire)


def _more_us(late: Mapping[str, Floats], recording: Recording, wire: Wire) -> Floats:
    """Return delays at which one frame after the other, or several that are late alike, comes into
    the next tick: first those that agree best with which frames of the wheels have an answer."""
    tick_us = wire.tick_period_us
    to_next_us = np.unique(tick_us - np.mod(np.concatenate(list(late.values())), tick_us))
    to_next_us = to_next_us[: _MOST_COMPARED + 1]
    more_us = 0.5 * (to_next_us[:-1] + to_next_us[1:])
    wheels, answers = wire.signal_map["left_count"].message.name, wire.signal_map.get("odom_x")
    answered = None if answers is None else recording.frames.get(answers.message.name)
    if answered is not None and answered.modulo:
        counter = recording.frames[wheels].counter
        came_us = counter * tick_us + late[wheels]
        is_answered = np.isin(counter, answered.counter)
        wrong = [_disagrees(came_us + more, is_answered, tick_us) for more in more_us]
        more_us = more_us[np.argsort(wrong, kind="stable")]
    return np.asarray(more_us[:_TRIED])


def _disagrees(came_us: Floats, is_answered: NDArray[np.bool_], tick_us: int) -> int:
    """Return how many frames are answered though the next one came in their tick, or are not though
    none did."""
    tick = np.ceil(came_us / tick_us)
    return int(np.count_nonzero((tick[1:] == tick[:-1]) == is_answered[:-1]))


def _as_late(
    late: Mapping[str, Floats], inputs: ReplayInputs, recording: Recording, wire: Wire
) -> Arrived:
    wheels, gyro = wire.signal_map["left_count"], wire.signal_map.get("gyro")
    arrivals = {
        name: _arrivals(name, delay_us, recording, wire, inputs.ticks)
        for name, delay_us in late.items()
    }
    encoder = accepted_frames(wheels.message, arrivals[wheels.message.name], wire, inputs.ticks)[1]
    left, validity = _taken(inputs.left_count, inputs.encoder_validity, encoder)
    right, _ = _taken(inputs.right_count, inputs.encoder_validity, encoder)
    code, gyro_validity = inputs.gyro_code, inputs.gyro_validity
    if gyro is not None:
        sampled = accepted_frames(gyro.message, arrivals[gyro.message.name], wire, inputs.ticks)[1]
        code, gyro_validity = _taken(inputs.gyro_code, inputs.gyro_validity, sampled)
    answers = ticks_of_answers(wire, arrivals, inputs.ticks)
    places, repeats = _places(answers, inputs)
    known = replace(
        inputs,
        left_count=left,
        right_count=right,
        gyro_code=code,
        encoder_validity=validity,
        gyro_validity=gyro_validity,
    )
    return Arrived(known, places, repeats)


def came_in_time(inputs: ReplayInputs, recording: Recording, wire: Wire) -> bool:
    """Tell whether every sensor frame of the log came, in its own tick, and was used in it."""
    specs = _sensors(inputs, recording, wire)
    if not specs or not np.all(inputs.encoder_validity == FRESH):
        return False
    if len(specs) > 1 and not np.all(inputs.gyro_validity == FRESH):
        return False
    own = np.arange(inputs.ticks)
    return all(
        np.array_equal(
            accepted_frames(
                specs[name], _arrivals(name, delay_us, recording, wire, inputs.ticks), wire,
                inputs.ticks,
            )[1],
            own,
        )
        for name, delay_us in _delays_us(recording, list(specs)).items()
    )  # fmt: skip


def _sensors(inputs: ReplayInputs, recording: Recording, wire: Wire) -> dict[str, MessageSpec]:
    """Return the messages of wheels and gyro by name; none where nobody can tell when they came."""
    mapped = [wire.signal_map.get("left_count"), wire.signal_map.get("gyro")]
    if mapped[0] is None or inputs.at_row[-1] != recording.tick[-1]:
        return {}
    specs = {one.message.name: one.message for one in mapped if one is not None}
    return specs if all(_is_known(one, recording, wire) for one in specs.values()) else {}


def _is_known(spec: MessageSpec, recording: Recording, wire: Wire) -> bool:
    frames = recording.frames.get(spec.name)
    if frames is None or not frames.modulo or len(frames.t_s) <= _EARLIEST:
        return False
    return cycle_of(spec, wire.tick_period_us)[0] == 1


def _delays_us(recording: Recording, names: Sequence[str]) -> dict[str, Floats]:
    """Return by how much each frame came later than the earliest can: whole microseconds.

    Delays are never negative, so that the ECU's clock is the line below all stamps that lies
    closest to them: with delays like an exponential's it is the most likely one. A clock that runs
    as described is believed until another one is clearly likelier.
    """
    frames = [recording.frames[name] for name in names]
    counter = np.concatenate([one.counter for one in frames])
    even_us = np.concatenate([_by_described_clock_us(one, recording) for one in frames])
    line_us = np.concatenate([_lateness_us(one, recording) for one in frames])
    start, slope = line_below(counter.astype(np.float64), line_us)
    even_us -= even_us.min()
    line_us -= start + slope * counter
    closer = math.log(max(float(even_us.mean()), 1.0) / max(float(line_us.mean()), 1.0))
    delay_us = line_us if len(counter) * closer > _CLEARLY else even_us
    whole_us = np.maximum(np.rint(delay_us + _least_delay_us(delay_us)), 0.0)
    ends = np.cumsum([len(one.counter) for one in frames])[:-1]
    return dict(zip(names, np.split(whole_us, ends), strict=True))


def _least_delay_us(delay_us: Floats) -> float:
    """Return by how much the earliest frame is late itself: about as the next ones follow it."""
    first = np.partition(delay_us, _EARLIEST)[: _EARLIEST + 1]
    return float(np.ptp(first)) / _EARLIEST


def _by_described_clock_us(frames: FrameTimes, recording: Recording) -> Floats:
    """Return the time from each frame's tick to its stamp, if a tick lasts as described."""
    return np.asarray((frames.t_s - frames.counter * recording.tick_period_s) * 1e6)


def line_below(x: Floats, y: Floats) -> tuple[float, float]:
    """Return start and slope of the line below all points whose distances add up to the least.

    It goes along the edge of their lower convex hull over their mean.
    """
    order = np.lexsort((y, x))
    hull: list[tuple[float, float]] = []
    for point in zip(x[order].tolist(), y[order].tolist(), strict=True):
        if hull and hull[-1][0] == point[0]:
            continue
        while len(hull) > 1 and _turns_right(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    middle = float(x.mean())
    for (x_0, y_0), (x_1, y_1) in pairwise(hull):
        if x_1 >= middle:
            slope = (y_1 - y_0) / (x_1 - x_0)
            return y_0 - slope * x_0, slope
    return hull[-1][1], 0.0


def _turns_right(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    return (b[0] - a[0]) * (c[1] - a[1]) <= (b[1] - a[1]) * (c[0] - a[0])


def _lateness_us(frames: FrameTimes, recording: Recording) -> Floats:
    """Return the ECU's time from each frame's tick to its stamp, by the recording's clock."""
    tick_s = (recording.t_s[-1] - recording.t_s[0]) / (recording.tick[-1] - recording.tick[0])
    line = np.interp(frames.counter, recording.tick, recording.t_s)
    beyond = frames.counter - np.clip(frames.counter, recording.tick[0], recording.tick[-1])
    late_s = frames.t_s - line - beyond * tick_s
    return np.asarray(late_s * (recording.tick_period_s / tick_s) * 1e6, dtype=np.float64)


def _arrivals(
    name: str, delay_us: Floats, recording: Recording, wire: Wire, ticks: int
) -> Arrivals:
    counter = recording.frames[name].counter
    inside = (counter >= 0) & (counter < ticks)
    frame = counter[inside]
    time_us = frame * wire.tick_period_us + delay_us[inside].astype(np.int64)
    return Arrivals(frame, frame, time_us)


def _taken(values: Ints, validity: Validity, frame: Ints) -> tuple[Ints, Validity]:
    """Return what came of the frames that were used in each tick, and whether any did."""
    there = (frame >= 0) & (validity[np.maximum(frame, 0)] == FRESH)
    taken = np.where(there, values[np.maximum(frame, 0)], 0)
    return taken, np.where(there, FRESH, STALE).astype(np.int8)


def _places(answers: Ints, inputs: ReplayInputs) -> tuple[Ints, Ints]:
    """Return the tick of each row's answer, and the ticks whose answer says a counter again."""
    ticks = np.arange(inputs.ticks, dtype=np.int64)
    of_counter = np.full(inputs.ticks, -1, dtype=np.int64)
    inside = (answers >= 0) & (answers < inputs.ticks)
    of_counter[answers[inside][::-1]] = ticks[inside][::-1]
    first = np.zeros(inputs.ticks, dtype=np.bool_)
    first[of_counter[of_counter >= 0]] = True
    places = of_counter[inputs.at_row]
    return np.where(places >= 0, places, inputs.at_row), np.flatnonzero(~first)
