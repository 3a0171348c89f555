"""Which effects the motion of a log can speak of, and in which variants each can act.

A variant is one way of acting with everything but its linear coefficients decided: a side, a
window, a threshold, a bit. Its coefficients are amplitudes about neutral; for an effect that is
either there or not it has none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations import encoder, gyro, reference, wheel
from gap_diagnosis.prediction import Motion, Prediction
from hil_harness.effects import catalogue
from hil_harness.effects.model import Effect

Value = float | int | str
Action = Callable[..., None]


@dataclass(frozen=True)
class Variant:
    """One way in which an effect acts.

    Attributes:
        effect: its name in the catalogue.
        act: changes a prediction; takes the coefficients and the fixed values by name.
        coefficients: names of the amplitudes, empty for an effect that is there or not.
        fixed: values decided for this variant, handed to `act`.
        report: values decided for this variant, as the catalogue names them.
        polar: catalogue names (amplitude, phase) that two coefficients a, b stand for, with
            a = A cos(phase), b = A sin(phase); None where coefficients are parameters.
        is_positive: coefficients are sizes that cannot be negative.
        stage_rank: order of acting, for effects of a user's library.
        chance: how far what happened may be off from the coefficient, a rate or probability, by
            chance alone (standard deviation), for that coefficient.
        little: how small amounts act, where a share of a large one would look otherwise.
        large: how amounts act that show in every detail of the motion, where small ones would be
            taken for the rounding of counts.
    """

    effect: str
    act: Action
    coefficients: tuple[str, ...] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)
    report: Mapping[str, Value] = field(default_factory=dict)
    polar: tuple[str, str] | None = None
    polar_turn: Callable[[Any, Any], tuple[Any, Any]] = lambda a, b: (a, b)
    is_positive: bool = False
    stage_rank: int = 3
    little: Action | None = None
    large: Action | None = None
    chance: Callable[[Motion, float], float] = lambda motion, size: 0.0

    def apply(self, prediction: Prediction, coefficients: Sequence[float]) -> None:
        """Change *prediction* as the effect with these coefficients does."""
        named = dict(zip(self.coefficients, coefficients, strict=True))
        self.act(prediction, **named, **self.fixed)

    def parameters(self, draws: Any) -> dict[str, Any]:
        """Return the catalogue's parameters for coefficients *draws*, float64[..., k]."""
        values: dict[str, Any] = {}
        if self.polar is not None:
            a, b = self.polar_turn(draws[..., 0], draws[..., 1])
            values[self.polar[0]] = np.hypot(a, b)
            values[self.polar[1]] = np.arctan2(b, a)
        else:
            for index, name in enumerate(self.coefficients):
                values[name] = draws[..., index]
        return values


@dataclass(frozen=True)
class Explanation:
    """An effect that the motion can speak of.

    Attributes:
        effect: its name.
        stage_rank: order of acting: 0 encoder, 1 wheel, 2 gyro, 3 reference.
        variants: the ways in which it can act on this log.
    """

    effect: str
    stage_rank: int
    variants: Callable[[Motion], Iterable[Variant]]


_RANK: Final = {"encoder": 0, "wheel": 1, "gyro": 2, "reference": 3}


def _plain(
    effect: str, stage: str, act: Action, *coefficients: str, positive: bool = False
) -> Explanation:
    variant = Variant(effect, act, coefficients, is_positive=positive)
    return Explanation(effect, _RANK[stage], lambda motion: (variant,))


def _sided(
    effect: str, stage: str, left: Action, right: Action, *coefficients: str, **more: Any
) -> Explanation:
    variants = tuple(
        Variant(effect, act, coefficients, report={"side": side}, **more)
        for side, act in (("left", left), ("right", right))
    )
    return Explanation(effect, _RANK[stage], lambda motion: variants)


def _missed_ticks(motion: Motion) -> Iterable[Variant]:
    fastest = float(
        max(np.abs(motion.left_rate_rad_s).max(), np.abs(motion.right_rate_rad_s).max())
    )
    for side, act in (
        ("left", encoder.missed_ticks_left),
        ("right", encoder.missed_ticks_right),
    ):
        for share in (0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9):
            threshold = share * fastest
            fixed = {"threshold": threshold}
            report: dict[str, Value] = {"side": side, "threshold": threshold}
            yield Variant(
                "missed_ticks",
                act,
                ("probability",),
                fixed,
                report,
                is_positive=True,
                chance=_chance_of_missed(side, threshold),
            )


def _chance_of_missed(side: str, threshold: float) -> Callable[[Motion, float], float]:
    """Return the standard deviation of the share of ticks that a probability lets get lost."""

    def chance(motion: Motion, probability: float) -> float:
        step = motion.left_step_rad if side == "left" else motion.right_step_rad
        rate = motion.left_rate_rad_s if side == "left" else motion.right_rate_rad_s
        ticks = float(np.abs(step[np.abs(rate) > threshold]).sum()) / motion.rad_per_count
        share = min(max(probability, 0.0), 1.0)
        return math.sqrt(share * (1.0 - share) / max(ticks, 1.0))

    return chance


def _chance_of_extra(motion: Motion, rate: float) -> float:
    """Return the standard deviation of the mean rate that spurious counts come at."""
    return math.sqrt(abs(rate) / float(motion.elapsed_s[-1]))


SLIP_WINDOWS: Final = 12
"""One-sided slip is sought in windows whose ends lie on this many equal parts of the log."""


def _one_sided_slip(motion: Motion) -> Iterable[Variant]:
    edges = np.linspace(motion.t_s[0] - 1e-6, motion.t_s[-1] + 1e-6, SLIP_WINDOWS + 1)
    for side, act in (("left", wheel.slip_left), ("right", wheel.slip_right)):
        for first in range(SLIP_WINDOWS):
            for last in range(first + 1, SLIP_WINDOWS + 1):
                fixed = {"start_s": float(edges[first]), "stop_s": float(edges[last])}
                report: dict[str, Value] = {"side": side, **fixed}
                yield Variant("one_sided_slip", act, ("ratio",), fixed, report)


def _gyro_saturation(motion: Motion) -> Iterable[Variant]:
    flat = _flat_top(motion)
    if flat is not None:
        known = {"limit": flat}
        yield Variant("gyro_saturation", gyro.gyro_saturation, (), known, known)
        return
    fastest = float(np.abs(motion.turn_rate_rad_s).max())
    for share in (0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3):
        limit = {"limit": share * fastest}
        if fastest > 0.1:
            yield Variant("gyro_saturation", gyro.gyro_saturation, (), limit, limit)


_LEAST_AT_TOP: Final = 20


def _flat_top(motion: Motion) -> float | None:
    """Return the rate beyond which no code goes though many go so far; None where there is none."""
    if motion.gyro_code is None:
        return None
    away = np.abs(motion.gyro_code - motion.gyro_zero_rate_code)
    reach = float(away.max())
    at_top = int(np.count_nonzero(away >= reach - 0.6))
    just_below = int(np.count_nonzero((away < reach - 0.6) & (away > reach - 1.6)))
    if reach < 1 or at_top < max(_LEAST_AT_TOP, 5 * just_below):
        return None
    return reach / motion.gyro_sensitivity_lsb_per_rad_s


def _adc_inl(motion: Motion) -> Iterable[Variant]:
    """Return the converter's bend, where the log has a converter: codes, not physical rates."""
    if motion.gyro_code is not None:
        yield Variant("adc_inl", gyro.adc_inl, ("peak",))


def _adc_stuck_bit(motion: Motion) -> Iterable[Variant]:
    if motion.gyro_code is None:
        return
    for bit in range(int(math.log2(motion.adc_max_code + 1))):
        for value in (0, 1):
            choice = {"bit": bit, "value": value}
            yield Variant("adc_stuck_bit", gyro.adc_stuck_bit, (), choice, choice)


_FROZEN_TICKS: Final = 20
_DEAD_S: Final = 1.0
_DEAD_TICKS: Final = 50


def _runs(same: NDArray[np.bool_], least: int) -> list[tuple[int, int]]:
    """Return [first, last] of runs of at least *least* true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2) if b - a >= least]


def _gyro_frozen(motion: Motion) -> Iterable[Variant]:
    """Return the longest stretches in which the code repeats though it could not.

    Either the wheels' turning varies, or a converter that sees the sensor's noise never says the
    same so often; then even at a constant rate the code that is held is off by one sample's noise.
    """
    if motion.gyro_code is None:
        return
    same = np.diff(motion.gyro_code, prepend=np.nan) == 0
    turning = motion.right_rate_rad_s - motion.left_rate_rad_s
    found = [
        (first, last)
        for first, last in _runs(same, _FROZEN_TICKS)
        if motion.gyro_noise_lsb > _NOISY_LSB
        or np.ptp(turning[first : last + 1]) * motion.radius_m / motion.wheelbase_m > _FROZEN_RATE
    ]
    for first, last in sorted(found, key=lambda run: run[0] - run[1])[:4]:
        window = {
            "start_s": float(motion.t_s[first - 1]) - 1e-6,
            "stop_s": float(motion.t_s[last]) + 1e-6,
        }
        yield Variant("gyro_frozen", gyro.gyro_frozen, (), window, window)


_FROZEN_RATE: Final = 0.02
_NOISY_LSB: Final = 2.0
"""With a sample's noise as large as this, one code comes up in at most a fifth of the samples."""


def _dead_windows(motion: Motion) -> dict[str, tuple[int, int]]:
    """Return for each side the longest stretch [first, last] in which only the other counts."""
    steps = {"left": motion.left_step_rad, "right": motion.right_step_rad}
    least = max(3, round(_DEAD_S / float(np.median(motion.dt_s[1:]))))
    found = {}
    for side, step in steps.items():
        other = steps["right" if side == "left" else "left"]
        runs = [
            (first, last)
            for first, last in _runs(step == 0, least)
            if np.abs(other[first : last + 1]).sum() > _DEAD_TICKS * motion.rad_per_count
        ]
        if runs:
            found[side] = max(runs, key=lambda run: run[1] - run[0])
    return found


def dead_ticks(motion: Motion) -> NDArray[np.bool_]:
    """Return, bool[n], the ticks in which only one wheel counts for long."""
    dead = np.zeros(len(motion.t_s), dtype=np.bool_)
    for first, last in _dead_windows(motion).values():
        dead[first : last + 1] = True
    return dead


def _encoder_dead(motion: Motion) -> Iterable[Variant]:
    acts = {"left": encoder.encoder_dead_left, "right": encoder.encoder_dead_right}
    for side, (first, last) in _dead_windows(motion).items():
        window = {
            "start_s": float(motion.t_s[max(first - 1, 0)]) - 1e-6,
            "stop_s": float(motion.t_s[last]) + 1e-6,
        }
        report: dict[str, Value] = {"side": side, "start_s": window["start_s"]}
        yield Variant("encoder_dead", acts[side], (), window, report)


def _encoder_wrap(motion: Motion) -> Iterable[Variant]:
    if motion.wrap_bits:
        choice: dict[str, Value] = {"bits": motion.wrap_bits}
        fixed = {"bits": motion.wrap_bits}
        yield Variant("encoder_wrap", encoder.encoder_wrap, (), fixed, choice)


def _frame_latency(motion: Motion) -> Iterable[Variant]:
    """Return latencies of rows whose frames carry no counter: tables, where stamps are all."""
    if motion.has_counters:
        return
    for frame, act, large in (
        ("IMU", reference.gyro_latency, reference.late_gyro),
        ("ENCODER", reference.counts_latency, reference.late_counts),
        ("sensors", reference.sensors_latency, None),
    ):
        yield Variant(
            "frame_latency",
            act,
            ("delay",),
            report={"frame": frame},
            is_positive=True,
            large=large,
        )


def _setup_sign(motion: Motion) -> Iterable[Variant]:
    actions = (
        ("left_ticks", encoder.left_factor),
        ("right_ticks", encoder.right_factor),
        ("gyro", gyro.gyro_factor),
    )
    for signal, act in actions:
        yield Variant("setup_sign", act, (), {"factor": -1.0}, {"signal": signal})


_FACTORS: Final = (2, 4, 10, 256, 1000, math.pi / 180)


def _setup_unit(motion: Motion) -> Iterable[Variant]:
    factors = [value for factor in _FACTORS for value in (factor, 1 / factor)]
    actions = (
        ("left_ticks", encoder.left_factor),
        ("right_ticks", encoder.right_factor),
        ("ticks", _both_factors),
        ("gyro", gyro.gyro_factor),
    )
    for signal, act in actions:
        for factor in factors:
            named: dict[str, Value] = {"signal": signal, "factor": factor}
            yield Variant("setup_unit", act, (), {"factor": factor}, named)


def _both_factors(p: Prediction, *, factor: float) -> None:
    encoder.left_factor(p, factor=factor)
    encoder.right_factor(p, factor=factor)


def _swap_axes(a: Any, b: Any) -> tuple[Any, Any]:
    return b, a


def _turn_back(a: Any, b: Any) -> tuple[Any, Any]:
    """From r(1 + c cos(phi) + s sin(phi)) to 1 + A cos(phi + phase): c = A cos, s = -A sin."""
    return a, -b


_LAG: Final = Variant(
    "gyro_lag",
    gyro.gyro_lag,
    ("time_constant",),
    is_positive=True,
    little=gyro.little_gyro_lag,
    large=gyro.long_gyro_lag,
)
_AMPLITUDE = ("amplitude", "phase")
_DOWNHILL = ("ratio", "direction")

_ALL: Final = (
    Explanation("ticks_per_rev", 0, lambda motion: ()),
    _sided(
        "encoder_eccentricity",
        "encoder",
        encoder.encoder_eccentricity_left,
        encoder.encoder_eccentricity_right,
        "sine",
        "cosine",
        polar=_AMPLITUDE,
    ),
    Explanation("missed_ticks", 0, _missed_ticks),
    _sided(
        "extra_ticks",
        "encoder",
        encoder.extra_ticks_left,
        encoder.extra_ticks_right,
        "rate",
        chance=_chance_of_extra,
    ),
    Explanation("encoder_dead", 0, _encoder_dead),
    Explanation("encoder_wrap", 0, _encoder_wrap),
    _plain("radius_scale", "wheel", wheel.radius_scale, "scale"),
    _plain("radius_mismatch", "wheel", wheel.radius_mismatch, "mismatch"),
    _plain(
        "payload",
        "wheel",
        wheel.payload,
        "compression_left",
        "compression_right",
        positive=True,
    ),
    _plain("wheelbase_scale", "wheel", wheel.wheelbase_scale, "scale"),
    _plain("turn_scrub", "wheel", wheel.turn_scrub, "scrub"),
    _plain("longitudinal_slip", "wheel", wheel.longitudinal_slip, "compliance", positive=True),
    Explanation("one_sided_slip", 1, _one_sided_slip),
    _plain("lateral_slip", "wheel", wheel.lateral_slip, "compliance", positive=True),
    Explanation(
        "cross_slope_drift",
        1,
        lambda motion: (
            Variant(
                "cross_slope_drift",
                wheel.cross_slope_drift,
                ("east", "north"),
                polar=_DOWNHILL,
                polar_turn=_swap_axes,
            ),
        ),
    ),
    Explanation(
        "grade_slip",
        1,
        lambda motion: (
            Variant("grade_slip", wheel.grade_slip, ("north", "east"), polar=_DOWNHILL),
        ),
    ),
    _sided(
        "wheel_eccentricity",
        "wheel",
        wheel.wheel_eccentricity_left,
        wheel.wheel_eccentricity_right,
        "cosine",
        "sine",
        polar=_AMPLITUDE,
        polar_turn=_turn_back,
    ),
    Explanation("frame_latency", 2, _frame_latency),
    Explanation("gyro_lag", 2, lambda motion: (_LAG,)),
    _plain("gyro_nonlinearity", "gyro", gyro.gyro_nonlinearity, "quadratic", "cubic"),
    _plain("gyro_scale", "gyro", gyro.gyro_scale, "scale"),
    _plain("gyro_temperature_scale", "gyro", gyro.gyro_temperature_scale, "slope"),
    _plain("supply_ratio", "gyro", gyro.supply_ratio, "coefficient"),
    _plain("gyro_bias", "gyro", gyro.gyro_bias, "bias"),
    _plain("gyro_temperature_bias", "gyro", gyro.gyro_temperature_bias, "slope"),
    _plain("gyro_vibration", "gyro", gyro.gyro_vibration, "coefficient"),
    _plain("gyro_g_sensitivity", "gyro", gyro.gyro_g_sensitivity, "x", "y"),
    Explanation("gyro_frozen", 2, _gyro_frozen),
    Explanation("gyro_saturation", 2, _gyro_saturation),
    Explanation("adc_inl", 2, _adc_inl),
    Explanation("adc_stuck_bit", 2, _adc_stuck_bit),
    _plain("reference_yaw", "reference", reference.reference_yaw, "angle"),
    _plain("reference_lever_arm", "reference", reference.reference_lever_arm, "x", "y"),
    _plain("reference_time_offset", "reference", reference.reference_time_offset, "offset"),
    _plain("reference_clock_skew", "reference", reference.reference_clock_skew, "skew"),
    _plain("reference_scale", "reference", reference.reference_scale, "scale"),
    _plain("setup_wheels_swapped", "encoder", encoder.wheels_swapped),
    Explanation("setup_sign", 0, _setup_sign),
    Explanation("setup_unit", 0, _setup_unit),
)

EXPLAINED: Final[Mapping[str, Explanation]] = {one.effect: one for one in _ALL}
"""Every effect that the motion block can fit, by name."""

Setting = tuple[Variant, Sequence[float]]
"""A variant with its coefficients."""


def predict(motion: Motion, settings: Sequence[Setting] = ()) -> Prediction:
    """Return what the recording means with these effects at work, applied in stage order.

    An effect that a user's library explains without a rank of its own acts last.
    """
    prediction = Prediction(motion)
    ordered = sorted(settings, key=lambda one: rank_of(one[0]))
    rolled = False
    for variant, coefficients in ordered:
        if not rolled and rank_of(variant) >= 1:
            prediction.roll()
            rolled = True
        variant.apply(prediction, coefficients)
    if not rolled:
        prediction.roll()
    return prediction


def rank_of(variant: Variant) -> int:
    """Return when a variant acts: encoder 0, wheel 1, gyro 2, reference 3."""
    known = EXPLAINED.get(variant.effect)
    return variant.stage_rank if known is None else known.stage_rank


def explanation_of(effect: Effect) -> Explanation | None:
    """Return how an effect of a user's library acts; None where the library does not say."""
    if effect.explain is None:
        return None
    rank = _RANK.get(effect.stage, _RANK["reference"])
    variant = Variant(
        effect.name,
        effect.explain,
        tuple(parameter.name for parameter in effect.parameters if parameter.kind == "real"),
        is_positive=all(parameter.minimum >= 0 for parameter in effect.parameters),
        stage_rank=rank,
    )
    return Explanation(effect.name, rank, lambda motion: (variant,))


def twin_sets(effects: frozenset[str]) -> list[frozenset[str]]:
    """Return the sets of effects that leave the same data as this one in every log."""
    found = [
        (effects - {effect}) | {twin}
        for effect in sorted(effects)
        for twin in twins_of(effect)
        if twin not in effects
    ]
    found += [
        (effects - given) | other
        for given, other in _TWIN_PAIRS
        if given <= effects and not other & (effects - given)
    ]
    return found


_TWIN_PAIRS: Final = (
    (frozenset({"payload"}), frozenset({"radius_mismatch", "radius_scale"})),
    (frozenset({"radius_mismatch", "radius_scale"}), frozenset({"payload"})),
    (frozenset({"reference_scale"}), frozenset({"radius_scale", "wheelbase_scale"})),
    (frozenset({"radius_scale", "wheelbase_scale"}), frozenset({"reference_scale"})),
)


_ALWAYS: Final = frozenset({"", "scale < 0", "the lever arm is unknown (opposite sign)"})
"""Conditions under which the catalogue's twins leave the same data for one sign, or usually."""


def twins_of(effect: str) -> tuple[str, ...]:
    """Return single effects that leave the same data as this one: the catalogue's twins."""
    known = catalogue()
    mine = known[effect].twins if effect in known else ()
    named = [one.effects[0] for one in mine if len(one.effects) == 1 and one.condition in _ALWAYS]
    named += [
        other.name
        for other in known.values()
        for one in other.twins
        if one.effects == (effect,) and one.condition in _ALWAYS and other.name not in named
    ]
    return tuple(named)
