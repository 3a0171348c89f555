"""The scenarios that Chiplog ships, each sensible for a robot of half a metre."""

import math
from collections.abc import Callable, Iterator
from typing import Final

import numpy as np

from hil_harness.effects.model import EffectSetting
from hil_harness.errors import HarnessError
from hil_harness.scenarios.model import Scenario
from hil_harness.scenarios.profile import FigureEight, LessonProfile, Segment, SegmentProfile

_RAMP_S: Final = 0.8
_REST_S: Final = 2.0

SQUARE_SIDE_M: Final = 4.0
"""Side of UMBmark's square (Borenstein and Feng, "Measurement and correction of systematic
odometry errors in mobile robots", IEEE T-RA 12(6), 1996)."""

RANDOM_MAX_SPEED_M_S: Final = 0.7
RANDOM_MAX_REVERSE_M_S: Final = 0.3
RANDOM_MAX_TURN_RAD_S: Final = 1.0
_RANDOM_DURATION_S: Final = 120.0

LESSON_EFFECTS: Final = (
    EffectSetting("radius_scale", (("scale", 1 / 1.005 - 1),)),
    EffectSetting("radius_mismatch", (("mismatch", -0.004),)),
    EffectSetting("wheelbase_scale", (("scale", 1 / 0.995 - 1),)),
    EffectSetting("gyro_bias", (("bias", 0.005),)),
)
"""The lesson's robot seen from its own description, r̂ = 1.005 r and b̂ = 0.995 b; its wheels
differ by ε_L = +0.002 and ε_R = −0.002."""


def lesson() -> Scenario:
    """Return the textbook lesson: in motion from the first tick on, no motor dynamics."""
    profile = LessonProfile()
    return Scenario(
        name="lesson",
        description="the textbook lesson: 36 m of gentle weaving with its own errors and noise",
        profile=profile,
        duration_s=profile.duration_s,
        drive="ideal",
        encoder_model="lesson_counter",
        noise="lesson",
        effects=LESSON_EFFECTS,
        seed=7,
        per_tick_commands=True,
    )


def straight() -> Scenario:
    """Return ten metres straight ahead at 0.5 m/s."""
    return _of_segments(
        "straight",
        "10 m straight ahead at 0.5 m/s, at rest before and after",
        [_rest(), _go(0.5, 20.0), _rest()],
    )


def square() -> Scenario:
    """Return UMBmark's square clockwise, then anticlockwise."""
    return _of_segments(
        "square",
        "a 4 m square clockwise, then anticlockwise, stopping to turn (UMBmark)",
        [_rest(), *_square(-1.0), _rest(), *_square(+1.0), _rest()],
    )


def square_cw() -> Scenario:
    """Return UMBmark's square clockwise only."""
    return _of_segments(
        "square_cw",
        "a 4 m square clockwise, stopping to turn at each corner",
        [_rest(), *_square(-1.0), _rest()],
    )


def square_ccw() -> Scenario:
    """Return UMBmark's square anticlockwise only."""
    return _of_segments(
        "square_ccw",
        "a 4 m square anticlockwise, stopping to turn at each corner",
        [_rest(), *_square(+1.0), _rest()],
    )


def figure8() -> Scenario:
    """Return two laps of a figure of eight that closes."""
    profile = FigureEight(speed_m_s=0.5, lap_s=24.0, laps=2, rest_s=_REST_S, ramp_s=_RAMP_S)
    return Scenario(
        name="figure8",
        description="two laps of a 12 m figure of eight at 0.5 m/s that ends where it began",
        profile=profile,
        duration_s=profile.duration_s,
    )


def spin() -> Scenario:
    """Return turns on the spot at two rates, both ways round."""
    segments = [_rest()]
    for rate_rad_s in (0.75, 1.5):
        turning_s = 3 * 2 * math.pi / rate_rad_s
        segments += [_turn(rate_rad_s, turning_s), _rest(), _turn(-rate_rad_s, turning_s), _rest()]
    return _of_segments("spin", "three turns on the spot each way, slowly and then fast", segments)


def stop_and_go() -> Scenario:
    """Return starts and stops, first ahead and then back."""
    segments = [_rest()]
    for speed_m_s in (0.3, 0.6, 0.3, 0.6, -0.3, -0.6, -0.3, -0.6):
        segments += [_go(speed_m_s, 2.0), _stop(1.5)]
    return _of_segments(
        "stop_and_go",
        "four starts and stops ahead and four back, gentle and brisk in turn",
        [*segments, _rest()],
    )


def calibration() -> Scenario:
    """Return two minutes that tell most effects apart: each manoeuvre in both senses, two speeds.

    Rests at both ends, straights, spins, arcs of three radii ahead and one behind, stop and go.
    """
    segments = [_stop(8.0)]
    for speed_m_s, rate_rad_s, driving_s, turning_s in (
        (0.25, 0.5, 7.0, 7.0),
        (0.6, 2.0, 4.5, 6.0),
    ):
        for sense in (1.0, -1.0):
            segments += [_go(sense * speed_m_s, driving_s), _stop(1.2)]
        for sense in (1.0, -1.0):
            segments += [_turn(sense * rate_rad_s, turning_s), _stop(1.2)]
    for speed_m_s, rate_rad_s, driving_s in (
        (0.4, 0.4, 5.0), (0.4, -0.4, 5.0), (0.4, 1.0, 5.0), (0.4, -1.0, 5.0),
        (0.5, 0.2, 4.0), (0.5, -0.2, 4.0), (0.0, 0.0, 1.2), (-0.3, 0.6, 4.0),
    ):  # fmt: skip
        segments.append(Segment(speed_m_s, rate_rad_s, driving_s, _RAMP_S))
    segments.append(_stop(0.9))
    for _ in range(4):
        segments += [_go(0.5, 1.4), _stop(0.9)]
    return _of_segments(
        "calibration",
        "rests, straights, spins, arcs and stops, each both ways and at two speeds: "
        "a drive that tells causes apart",
        [*segments, _stop(10.0)],
    )


def random(seed: int = 1) -> Scenario:
    """Return a drive of random arcs, straights and stops that depends on *seed* alone.

    Speeds stay within RANDOM_MAX_REVERSE_M_S behind and RANDOM_MAX_SPEED_M_S ahead, turns within
    RANDOM_MAX_TURN_RAD_S. Raises HarnessError for a seed below 0 or above 64 bits.
    """
    if not 0 <= seed < 2**64:
        raise HarnessError(f"seed {seed}: expected a whole number from 0 to 2^64 - 1")
    return _of_segments(
        "random",
        "two minutes of random arcs, straights and stops; --seed draws another drive",
        [_rest(), *_random_segments(seed)],
        seed=seed,
    )


NAMED: Final[dict[str, Callable[[], Scenario]]] = {
    make.__name__: make
    for make in (
        lesson, straight, square, square_cw, square_ccw, figure8, spin, stop_and_go, calibration,
        random,
    )
}  # fmt: skip
"""Every shipped scenario by its name, in the order in which they are listed."""


def _of_segments(
    name: str, description: str, segments: list[Segment], *, seed: int = 1
) -> Scenario:
    profile = SegmentProfile(segments)
    return Scenario(name, description, profile, duration_s=profile.duration_s, seed=seed)


def _rest() -> Segment:
    return _stop(_REST_S)


def _stop(duration_s: float) -> Segment:
    return Segment(0.0, 0.0, duration_s, _RAMP_S)


def _go(speed_m_s: float, duration_s: float) -> Segment:
    return Segment(speed_m_s, 0.0, duration_s, _RAMP_S)


def _turn(rate_rad_s: float, duration_s: float) -> Segment:
    return Segment(0.0, rate_rad_s, duration_s, _RAMP_S)


def _square(sense: float) -> Iterator[Segment]:
    speed_m_s, rate_rad_s = 0.4, math.pi / 4
    for _ in range(4):
        yield _go(speed_m_s, SQUARE_SIDE_M / speed_m_s)
        yield _stop(1.2)
        yield _turn(sense * rate_rad_s, math.pi / 2 / rate_rad_s)
        yield _stop(1.2)


def _random_segments(seed: int) -> Iterator[Segment]:
    # Philox's words and their division by 2⁶⁴ are the same on every machine and NumPy version.
    draws = np.random.Philox(key=seed).random_raw(4 * 128) / 2.0**64
    left_s = _RANDOM_DURATION_S - 2 * _REST_S
    for kind, speed, turn, length in draws.reshape(-1, 4):
        duration_s = 1.5 + 3.5 * float(length)
        if duration_s > left_s:
            break
        left_s -= duration_s
        v_m_s = float(speed) * (RANDOM_MAX_SPEED_M_S + RANDOM_MAX_REVERSE_M_S)
        v_m_s -= RANDOM_MAX_REVERSE_M_S
        w_rad_s = (2 * float(turn) - 1) * RANDOM_MAX_TURN_RAD_S
        if kind < 0.15:
            v_m_s, w_rad_s = 0.0, 0.0
        elif kind < 0.35:
            w_rad_s = 0.0
        elif kind < 0.5:
            v_m_s = 0.0
        yield Segment(v_m_s, w_rad_s, duration_s, _RAMP_S)
    yield _stop(left_s + _REST_S)
