"""Sides, windows, thresholds, bits: in which variants an effect can act on the log at hand."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis import code_spells
from gap_diagnosis.bends import noise_by_bends
from gap_diagnosis.code_spells import held_bit
from gap_diagnosis.explanations import encoder, gyro, reference, wheel
from gap_diagnosis.explanations.variant import Scatter, Value, Variant
from gap_diagnosis.prediction import Motion, Prediction
from gap_diagnosis.recording import Floats
from gap_diagnosis.setup_mistakes import COUNT_FACTORS, FACTORS, TURN_FACTORS


def missed_ticks(motion: Motion) -> Iterable[Variant]:
    """Return both sides at thresholds over the range of the wheels' rates."""
    for side, act in (
        ("left", encoder.missed_ticks_left),
        ("right", encoder.missed_ticks_right),
    ):
        for share in (0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.9):
            threshold = share * motion.fastest_rad_s
            fixed = {"threshold": threshold}
            report: dict[str, Value] = {"side": side, "threshold": threshold}
            yield Variant(
                "missed_ticks",
                act,
                ("probability",),
                fixed,
                report,
                is_positive=True,
                scatter=_scatter_of_missed(side),
                about=lambda probability: {"about": probability},
            )


def _scatter_of_missed(side: str) -> Scatter:
    """Of N counts, each lost with probability p, N p (1 - p) is the variance of those lost, and of
    those that may be lost, with a share s, (N p)^2 s (1 - s) besides."""

    def scatter(motion: Motion, probability: float, *, threshold: float) -> tuple[Floats, Floats]:
        lost = min(max(probability, 0.0), 0.99)
        step = motion.left_step_rad if side == "left" else motion.right_step_rad
        own = encoder.own_speed(motion, side, lost, threshold)
        share = own.share_above
        left = 1.0 - share * lost
        turned = np.abs(step) / motion.rad_per_count / left
        # Each is of the size of a rounding.
        size = motion.rounding_rad / motion.rad_per_count
        variance = turned * share * lost * (1.0 - lost) * size
        variance += (turned * lost) ** 2 * share * (1.0 - share)
        return of_side(side, variance / left**2)

    return scatter


def extra_ticks(motion: Motion) -> Iterable[Variant]:
    """Return both sides, at rates that leave a count alone for as long as it stands in this log.

    Without a reference a gyro's bias turns as they do, and no wheel turns back as they come.
    """
    for side, act, step in (
        ("left", encoder.extra_ticks_left, motion.left_step_rad),
        ("right", encoder.extra_ticks_right, motion.right_step_rad),
    ):
        yield Variant(
            "extra_ticks",
            act,
            ("rate",),
            report={"side": side},
            scatter=_scatter_of_extra(side),
            most=_fastest(motion, step),
        )


_SELDOM: Final = 8.0
"""So much [nat] speaks against a rate that is out of the question."""


def _fastest(motion: Motion, step_rad: Floats) -> float:
    """Return the rate [1/s] of a Poisson process that leaves a count alone for as long as it stands
    at the longest, of all the times at which that may begin."""
    still = [motion.t_s[last] - motion.t_s[first] for first, last in runs(step_rad == 0.0, 2)]
    longest_s = float(max([*still, motion.tick_s]))
    begins = float(motion.t_s[-1] - motion.t_s[0])
    rate = _SELDOM / longest_s
    for _ in range(20):
        rate = (_SELDOM + math.log1p(rate * begins)) / longest_s
    return rate


def _scatter_of_extra(side: str) -> Scatter:
    """Spurious counts are as many as expected in the mean, and that is their variance."""

    def scatter(motion: Motion, rate: float) -> tuple[Floats, Floats]:
        return of_side(side, abs(rate) * motion.dt_s)

    return scatter


def of_side(side: str, variance: Floats) -> tuple[Floats, Floats]:
    """Return what counts of one side vary by as what those of the left and of the right do."""
    none = np.zeros_like(variance)
    return (variance, none) if side == "left" else (none, variance)


SLIP_WINDOWS: Final = 12
"""One-sided slip is sought in windows whose ends lie on this many equal parts of the log."""
CHANGING: Final = frozenset({"radius_scale", "radius_mismatch", "wheelbase_scale"})
"""Sizes of wheels and of the track, which may change on the way."""
LASTING: Final = frozenset({"radius_mismatch"})
"""Which of them does not change back: one wheel that is smaller for a while has slipped."""
LEFT_OUT: Final = 0.25
"""Of a wheel's way, what a window of its slip leaves out: one that goes less for nearly all of a
drive is a smaller wheel."""


def one_sided_slip(motion: Motion) -> Iterable[Variant]:
    """Return both sides in every window whose ends lie on the grid."""
    edges = np.linspace(motion.t_s[0] - 1e-6, motion.t_s[-1] + 1e-6, SLIP_WINDOWS + 1)
    for side, act in (("left", wheel.slip_left), ("right", wheel.slip_right)):
        for first in range(SLIP_WINDOWS):
            for last in range(first + 1, SLIP_WINDOWS + 1):
                fixed = {"start_s": float(edges[first]), "stop_s": float(edges[last])}
                report: dict[str, Value] = {"side": side, **fixed}
                yield Variant("one_sided_slip", act, ("ratio",), fixed, report)


def longitudinal_slip(motion: Motion) -> Iterable[Variant]:
    """Return a creep that goes with each wheel's acceleration, and one with that of both."""
    for act, exact in (
        (wheel.longitudinal_slip, wheel.exact_longitudinal_slip),
        (wheel.creep_of_the_body, wheel.exact_creep_of_the_body),
    ):
        yield Variant(
            "longitudinal_slip", act, ("compliance",), is_positive=True, exact=exact, varies=True
        )


def lateral_slip(motion: Motion) -> Iterable[Variant]:
    """Return a slide that goes with speed and turn rate, and one that goes with the square of the
    speed."""
    for speed_m_s in (0, 1):
        yield Variant(
            "lateral_slip",
            wheel.lateral_slip,
            ("compliance",),
            {"speed": float(speed_m_s)},
            {"speed": speed_m_s},
            is_positive=True,
            exact=wheel.exact_lateral_slip,
            varies=True,
        )


def leaves_out(motion: Motion, variant: Variant) -> bool:
    """Tell whether a slip's window leaves out a part of its wheel's way.

    Where it does not, what slips all the time is a wheel of another size, and nothing tells when
    it would have begun.
    """
    if variant.effect != "one_sided_slip":
        return True
    is_left = variant.report["side"] == "left"
    way = np.abs(motion.left_step_rad if is_left else motion.right_step_rad)
    inside = (motion.t_s > variant.fixed["start_s"]) & (motion.t_s <= variant.fixed["stop_s"])
    return bool(way[~inside].sum() > LEFT_OUT * way.sum())


def gyro_saturation(motion: Motion) -> Iterable[Variant]:
    """Return the limit that a flat top of the rate shows, or limits below the largest turn rate;
    none of a gyro that goes as far as described."""
    if motion.gyro_at_its_end.any():
        return
    top = _flat_top(motion)
    if top is not None:
        flat, window = top
        choice = {"limit": flat, **window}
        half_a_code = 0.5 / motion.gyro_sensitivity_lsb_per_rad_s
        told = {"limit": (flat - half_a_code, flat + half_a_code)}
        for contact in _CONTACTS_M_PER_SQRT_M:
            known = {"limit": flat, "contact_m_per_sqrt_m": contact, **window}
            unseen = partial(gyro.unseen_beyond, limit=flat, contact_m_per_sqrt_m=contact, **window)
            yield Variant(
                "gyro_saturation",
                gyro.gyro_saturation,
                (),
                known,
                choice,
                told,
                jumps=unseen,
            )
        return
    fastest = float(np.abs(motion.turn_rate_rad_s).max())
    for share in (0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3):
        limit = {"limit": share * fastest}
        if fastest > 0.1:
            yield Variant("gyro_saturation", gyro.gyro_saturation, (), limit, limit)


_LEAST_AT_TOP: Final = 20


def _flat_top(motion: Motion) -> tuple[float, dict[str, Any]] | None:
    """Return the rate beyond which no code goes though many go so far, and the window in which that
    is so, if not all along; None where there is none."""
    if motion.gyro_code is None:
        return None
    away = np.abs(motion.gyro_code - motion.gyro_zero_rate_code)
    per_rad_s = motion.gyro_sensitivity_lsb_per_rad_s
    reach = float(away.max())
    at_top = int(np.count_nonzero(away >= reach - 0.6))
    just_below = int(np.count_nonzero((away < reach - 0.6) & (away > reach - 1.6)))
    if reach < 1 or at_top < max(_LEAST_AT_TOP, 5 * just_below):
        part = code_spells.flat_top(away, per_rad_s * motion.turn_rate_rad_s)
        if part is None:
            return None
        first, last, top = part
        return top / per_rad_s, _window(motion, first, last)
    return reach / per_rad_s, {}


def _window(motion: Motion, first: int, last: int) -> dict[str, Any]:
    """Return the window of some rows, from the first to before the last."""
    return {"start_s": float(motion.t_s[first]), "stop_s": float(motion.t_s[last - 1])}


_WHOLE: Final = 0.1
"""Of means of a few codes more than this share is whole, of physical rates less."""


def _has_codes(motion: Motion) -> bool:
    """Tell codes, or means of a few, from what physical rates would give by the description."""
    if motion.gyro_code is None:
        return False
    distinct = np.unique(motion.gyro_code)
    return bool(np.mean(distinct == np.rint(distinct)) > _WHOLE)


def adc_inl(motion: Motion) -> Iterable[Variant]:
    """Return the converter's bend, where the log has a converter: codes, not physical rates."""
    if _has_codes(motion):
        yield Variant("adc_inl", gyro.adc_inl, ("peak",))


_CONTACTS_M_PER_SQRT_M: Final = (0.0, 1.25e-4, 2.5e-4, 5e-4, 1e-3, 2e-3)
"""How roughly wheels may roll: no slip at all, then most of the levels' prior in octaves."""


def adc_stuck_bit(motion: Motion) -> Iterable[Variant]:
    """Return every bit at both values, where there are codes, in the part of the log in which these
    have it if that is not all; the rougher the wheels roll, the less they tell which code there
    should be."""
    if motion.gyro_code is None or not _has_codes(motion):
        return
    for bit in range(int(math.log2(motion.adc_max_code + 1))):
        for value in (0, 1):
            window = _held(motion, motion.gyro_code, bit, value)
            choice = {"bit": bit, "value": value, **window}
            for contact in _CONTACTS_M_PER_SQRT_M:
                known = {**choice, "contact_m_per_sqrt_m": contact}
                jumps = partial(
                    gyro.jumps_of_stuck_bit,
                    bit=bit,
                    value=value,
                    contact_m_per_sqrt_m=contact,
                    **window,
                )
                yield Variant(
                    "adc_stuck_bit",
                    gyro.adc_stuck_bit,
                    (),
                    known,
                    choice,
                    jumps=jumps,
                    is_held=bool(window),
                )


_FROZEN_TICKS: Final = 20


def _held(motion: Motion, code: Floats, bit: int, value: int) -> dict[str, Any]:
    """Return the window in which a bit of the codes that came is *value*: empty for all along."""
    came = np.flatnonzero(~motion.gyro_is_filled)
    rows = held_bit(code[came], bit, value)
    return {} if rows is None else _window(motion, came[rows[0]], came[rows[1] - 1] + 1)


def runs(same: NDArray[np.bool_], least: int) -> list[tuple[int, int]]:
    """Return [first, last] of runs of at least *least* true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int8), [0]])))
    return [(int(a), int(b) - 1) for a, b in edges.reshape(-1, 2) if b - a >= least]


def gyro_frozen(motion: Motion) -> Iterable[Variant]:
    """Return the longest stretches in which the code repeats though it could not."""
    for first, last in sorted(frozen_runs(motion), key=lambda run: run[0] - run[1])[:4]:
        start_s, stop_s = float(motion.t_s[first - 1]), float(motion.t_s[last])
        window = {"start_s": start_s - 1e-6, "stop_s": stop_s + 1e-6}
        # Between which two rows, and no closer.
        after = min(last + 1, len(motion.t_s) - 1)
        told = {
            "start_s": (start_s, float(motion.t_s[first])),
            "stop_s": (stop_s, float(motion.t_s[after])),
        }
        yield Variant("gyro_frozen", gyro.gyro_frozen, (), window, window, told, is_held=True)


def frozen_runs(motion: Motion) -> list[tuple[int, int]]:
    """Return [first, last] of the stretches in which the gyro's code repeats though it could not.

    Either the wheels' turning varies, or a converter that sees the sensor's noise, in this log as
    it is described, never says the same so often; then even at a constant rate the code that is
    held is off by one sample's noise. What repeats at an end of all codes is a flat top.
    """
    if motion.gyro_code is None:
        return []
    ends = {motion.gyro_code.min(), motion.gyro_code.max()}
    flat = _runs_at_a_flat_top(motion)
    same = np.diff(motion.gyro_code, prepend=np.nan) == 0
    bends = np.diff(motion.gyro_code, 2)
    noise_lsb = noise_by_bends(bends)
    turning = motion.right_rate_rad_s - motion.left_rate_rad_s
    step_rad_s = motion.gyro_step_lsb / motion.gyro_sensitivity_lsb_per_rad_s
    varied = max(_FROZEN_RATE, _VARIED_STEPS * step_rad_s)
    return [
        (first, last)
        for first, last in runs(same, _FROZEN_TICKS)
        if motion.gyro_code[first] not in ends
        and not any(start <= first and last <= stop for start, stop in flat)
        and (
            min(motion.gyro_noise_lsb, noise_lsb) > _NOISY_STEPS * motion.gyro_step_lsb
            or np.ptp(turning[first : last + 1]) * motion.radius_m / motion.wheelbase_m > varied
        )
    ]


def _runs_at_a_flat_top(motion: Motion) -> list[tuple[int, int]]:
    """Return [first, last] of the runs at a flat top of a part of the log."""
    top = _flat_top(motion)
    if motion.gyro_code is None or top is None or not top[1]:
        return []
    limit, window = top
    away = np.abs(motion.gyro_code - motion.gyro_zero_rate_code)
    inside = (motion.t_s >= window["start_s"]) & (motion.t_s <= window["stop_s"])
    return runs(inside & (away >= limit * motion.gyro_sensitivity_lsb_per_rad_s - 0.6), 1)


_FROZEN_RATE: Final = 0.02
_VARIED_STEPS: Final = 2.0
"""A rate that varies by less may be told by one code, the wheels' turning not being so exact."""
_NOISY_STEPS: Final = 2.0
"""With a sample's noise as large as this, one code comes up in at most a fifth of the samples."""


def encoder_wrap(motion: Motion) -> Iterable[Variant]:
    """Return the width at which the counts jump, if they do."""
    if motion.wrap_bits:
        choice: dict[str, Value] = {"bits": motion.wrap_bits}
        fixed = {"bits": motion.wrap_bits}
        yield Variant("encoder_wrap", encoder.encoder_wrap, (), fixed, choice)


def frame_latency(motion: Motion) -> Iterable[Variant]:
    """Return latencies of rows whose frames carry no counter: tables, where stamps are all."""
    if motion.has_counters:
        return
    for frame, act, large, exact in (
        ("IMU", reference.gyro_latency, reference.late_gyro, reference.exact_gyro_latency),
        (
            "ENCODER",
            reference.counts_latency,
            reference.late_counts,
            reference.exact_counts_latency,
        ),
        ("sensors", reference.sensors_latency, None, None),
    ):
        yield Variant(
            "frame_latency",
            act,
            ("delay",),
            report={"frame": frame},
            is_positive=True,
            large=large,
            exact=exact,
        )


def setup_sign(motion: Motion) -> Iterable[Variant]:
    """Return a wrong sign of either count or of the gyro; without a gyro also a mirrored reference,
    beside which wheels look swapped."""
    actions = (
        ("left_ticks", encoder.left_factor),
        ("right_ticks", encoder.right_factor),
        ("gyro", gyro.gyro_factor),
    )
    for signal, act in actions:
        yield Variant("setup_sign", act, (), {"factor": -1.0}, {"signal": signal})
    if motion.gyro_turn_rad is None:
        yield Variant("setup_sign", encoder.wheels_swapped, (), {}, {"signal": "reference"})


def setup_unit(motion: Motion) -> Iterable[Variant]:
    """Return every known factor on counts or gyro."""
    of_wheels = FACTORS if motion.has_speeds else COUNT_FACTORS
    actions = (
        ("left_ticks", encoder.left_factor, of_wheels),
        ("right_ticks", encoder.right_factor, of_wheels),
        ("ticks", _both_factors, of_wheels),
        ("gyro", gyro.gyro_factor, TURN_FACTORS),
    )
    for signal, act, factors in actions:
        for factor in (value for one in factors for value in (one, 1 / one)):
            named: dict[str, Value] = {"signal": signal, "factor": factor}
            yield Variant("setup_unit", act, (), {"factor": factor}, named)


def _both_factors(p: Prediction, *, factor: float) -> None:
    encoder.left_factor(p, factor=factor)
    encoder.right_factor(p, factor=factor)
