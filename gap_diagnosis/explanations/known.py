"""How the known effects of a robot act in one log.

What a log alone can say of them stands in no file: how a wheel off centre stood when it began, at
which flank a motor lay, how roughly the wheels rolled. There an effect has several ways.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from gap_diagnosis.explanations import encoder, gyro
from gap_diagnosis.explanations.registry import EXPLAINED, explanation_of, predict
from gap_diagnosis.explanations.variant import Setting, Variant
from gap_diagnosis.granted import Granted
from gap_diagnosis.hypothesis import FORM
from gap_diagnosis.prediction import Motion, Prediction
from hil_harness.effects.model import Value

LONG_S: Final = 0.03
"""A gyro that is later is told so at sight, and every detail of its turns shows it."""
_ANGLES: Final = 24
"""So many angles are tried where a log alone says how something stood."""
_MATCHED: Final = ("side", "frame", "bit", "value", "bits")
_PLACED: Final = ("threshold", "limit", FORM, "start_s", "stop_s")
COUNTING: Final = frozenset({"extra_ticks", "missed_ticks", "ticks_per_rev"})
"""By these a drive turns its wheels otherwise than they are counted."""
_TICKS: Final = Variant("ticks_per_rev", encoder.ticks_per_rev, ("scale",))


@dataclass(frozen=True)
class Known:
    """A known effect in one log.

    Attributes:
        ways: in which it may act, each with its coefficients.
        sds: by how much each coefficient may be off.
    """

    ways: tuple[Setting, ...]
    sds: tuple[float, ...]


def known_effects(granted: Granted, motion: Motion) -> tuple[Known, ...]:
    """Return those of the known effects that act on wheels, gyro or reference in this log.

    Wheels that stand farther apart do so in the motion already (`estimate_motion`): of them it is
    left by how much that may be off.
    """
    found = []
    for effect, given in granted.values.items():
        off = {name: granted.sds.get(f"{effect}.{name}", 0.0) for name in given}
        told, values, sds = _told_as(effect, _in_our_names(given, motion), off, motion)
        ways = tuple(_ways(told, values, granted, motion))
        if ways:
            found.append(Known(ways, tuple(_sds(ways[0][0], values, sds, is_open=len(ways) > 1))))
    return tuple(found)


def by_counts(motion: Motion, wheelbase_m: float) -> Prediction:
    """Return what wheels as described, so far apart, make of what a drive turned them by: counts
    with those errors that are known."""
    counting = tuple(one for one in motion.granted if one[0].effect in COUNTING)
    return predict(replace(motion, granted=counting, wheelbase_m=wheelbase_m))


def gyro_delay_s(settings: Iterable[Setting]) -> float:
    """Return how late known effects let the gyro show what the wheels do."""
    late_s = 0.0
    for variant, sizes in settings:
        if variant.effect == "gyro_lag" or variant.report.get("frame") == "IMU":
            late_s += sizes[0]
        elif variant.report.get("frame") == "ENCODER":
            late_s -= sizes[0]
    return late_s


def _in_our_names(values: Mapping[str, Value], motion: Motion) -> Mapping[str, Value]:
    """Return the values with Chiplog's name of a message that the log's bus calls otherwise."""
    ours = {own: name for name, own in motion.own_names.items()}
    frame = values.get("frame")
    return {**values, "frame": ours[frame]} if isinstance(frame, str) and frame in ours else values


def _told_as(
    effect: str, values: Mapping[str, Value], sds: Mapping[str, float], motion: Motion
) -> tuple[str, Mapping[str, Value], Mapping[str, float]]:
    """Return the effect of the motion that does the same, its values and standard deviations."""

    def as_other(
        other: str, to: str, of: str, factor: float
    ) -> tuple[str, Mapping[str, Value], Mapping[str, float]]:
        return other, {to: factor * float(values[of])}, {to: abs(factor) * sds[of]}

    match effect:
        case "adc_gain":
            return as_other("gyro_scale", "scale", "gain", 1.0)
        case "adc_offset":
            per_lsb = 1.0 / motion.gyro_sensitivity_lsb_per_rad_s
            return as_other("gyro_bias", "bias", "offset", per_lsb)
        case "frame_latency" if motion.has_counters and values["frame"] == "sensors":
            return as_other("reference_time_offset", "offset", "delay", -1.0)
        case "wheelbase_scale":
            farther = 1.0 + float(values["scale"])
            return effect, {"scale": 0.0}, {"scale": sds["scale"] / farther}
    return effect, values, sds


def _ways(
    effect: str, values: Mapping[str, Value], granted: Granted, motion: Motion
) -> Iterator[Setting]:
    """Yield the ways in which an effect of this size may act."""
    for variant in _variants(effect, values, granted, motion):
        if variant.polar is not None:
            size, angle = (float(values[name]) for name in variant.polar)
            for step in range(_ANGLES if _is_open(variant, motion) else 1):
                at = angle + math.tau * step / _ANGLES
                pair = variant.polar_turn(size * math.cos(at), size * math.sin(at))
                yield variant, pair
        else:
            sizes = tuple(float(values[name]) for name in variant.coefficients)
            yield _long(variant, sizes, motion), sizes


def _variants(
    effect: str, values: Mapping[str, Value], granted: Granted, motion: Motion
) -> Iterable[Variant]:
    """Return the variants that act on this side, in this frame, beyond this threshold."""
    if effect == "ticks_per_rev":
        return [_TICKS]
    known = EXPLAINED.get(effect)
    if known is None and effect in granted.library:
        known = explanation_of(granted.library[effect])
    found: dict[tuple[tuple[str, float], ...], Variant] = {}
    for one in () if known is None else known.variants(motion):
        if any(values[name] != one.report[name] for name in _MATCHED if name in one.report):
            continue
        placed = {name: float(values[name]) for name in _PLACED if name in one.fixed}
        fixed = {**one.fixed, **placed}
        jumps = one.jumps
        if effect == "gyro_saturation" and jumps is not None:
            contact = fixed["contact_m_per_sqrt_m"]
            jumps = partial(gyro.unseen_beyond, limit=fixed["limit"], contact_m_per_sqrt_m=contact)
        key = tuple(sorted(fixed.items()))
        found.setdefault(key, replace(one, fixed=fixed, jumps=jumps))
    return found.values()


def _is_open(variant: Variant, motion: Motion) -> bool:
    """Tell whether a log alone says at which angle an effect acts: wheels stand otherwise when
    another log begins, and without a reference so do headings."""
    return "side" in variant.report or not motion.bent.any()


def _long(variant: Variant, sizes: Sequence[float], motion: Motion) -> Variant:
    """Return the variant as large amounts act, where these are."""
    if variant.large is None or sizes[0] < LONG_S:
        return variant
    is_sharp = variant.effect == "gyro_lag" and motion.has_counters
    return replace(variant, act=variant.large, exact=variant.exact if is_sharp else None)


def _sds(
    variant: Variant, values: Mapping[str, Value], sds: Mapping[str, float], *, is_open: bool
) -> Iterator[float]:
    """Yield by how much each coefficient may be off."""
    if variant.polar is None:
        yield from (sds[name] for name in variant.coefficients)
        return
    size, angle = variant.polar
    angle_sd = math.pi / _ANGLES / math.sqrt(3.0) if is_open else sds[angle]
    sd = max(sds[size], float(values[size]) * angle_sd)
    yield from (sd, sd)
