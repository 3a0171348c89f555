"""Which effects the motion of a log can speak of, and in what order they act."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from gap_diagnosis.explanations import (
    actuation,
    choices,
    encoder,
    gyro,
    reference,
    standstill,
    wheel,
)
from gap_diagnosis.explanations.variant import Action, Explanation, Setting, Variant
from gap_diagnosis.prediction import Motion, Prediction
from hil_harness.effects.model import Effect

_RANK: Final = {"actuation": 0, "encoder": 0, "wheel": 1, "gyro": 2, "reference": 3}


def _plain(
    effect: str,
    stage: str,
    act: Action,
    *coefficients: str,
    positive: bool = False,
    **more: Any,
) -> Explanation:
    variant = Variant(effect, act, coefficients, is_positive=positive, **more)
    return Explanation(effect, _RANK[stage], lambda motion: (variant,))


def _sided(
    effect: str,
    stage: str,
    left: Action,
    right: Action,
    *coefficients: str,
    exact: tuple[Action | None, Action | None] = (None, None),
    **more: Any,
) -> Explanation:
    variants = tuple(
        Variant(effect, act, coefficients, report={"side": side}, exact=in_detail, **more)
        for side, act, in_detail in zip(("left", "right"), (left, right), exact, strict=True)
    )
    return Explanation(effect, _RANK[stage], lambda motion: variants)


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
    exact=gyro.exact_gyro_lag,
)
_AMPLITUDE = ("amplitude", "phase")
_DOWNHILL = ("ratio", "direction")

_ALL: Final = (
    # What the counter did last is undone first.
    Explanation("encoder_wrap", 0, choices.encoder_wrap),
    Explanation("ticks_per_rev", 0, lambda motion: ()),
    _sided(
        "encoder_eccentricity",
        "encoder",
        encoder.encoder_eccentricity_left,
        encoder.encoder_eccentricity_right,
        "sine",
        "cosine",
        exact=(
            encoder.exact_encoder_eccentricity_left,
            encoder.exact_encoder_eccentricity_right,
        ),
        polar=_AMPLITUDE,
    ),
    Explanation("missed_ticks", 0, choices.missed_ticks),
    Explanation("extra_ticks", 0, choices.extra_ticks),
    Explanation("encoder_dead", 0, standstill.encoder_dead),
    Explanation("backlash", _RANK["actuation"], actuation.variants_of_backlash),
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
    _plain("tyre_drift", "wheel", wheel.tyre_drift, "rate"),
    _plain("wheelbase_scale", "wheel", wheel.wheelbase_scale, "scale", varies=True, widens=True),
    _plain(
        "turn_scrub",
        "wheel",
        wheel.turn_scrub,
        "scrub",
        exact=wheel.exact_turn_scrub,
        varies=True,
        unbent=wheel.scrub_of_line,
    ),
    Explanation("longitudinal_slip", _RANK["wheel"], choices.longitudinal_slip),
    Explanation("one_sided_slip", 1, choices.one_sided_slip),
    Explanation("lateral_slip", _RANK["wheel"], choices.lateral_slip),
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
                varies=True,
            ),
        ),
    ),
    Explanation(
        "grade_slip",
        1,
        lambda motion: (
            Variant(
                "grade_slip", wheel.grade_slip, ("north", "east"), polar=_DOWNHILL, varies=True
            ),
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
    Explanation("frame_latency", 2, choices.frame_latency),
    Explanation("gyro_lag", 2, lambda motion: (_LAG,)),
    _plain(
        "gyro_nonlinearity",
        "gyro",
        gyro.gyro_nonlinearity,
        "quadratic",
        "cubic",
        exact=gyro.exact_gyro_nonlinearity,
    ),
    _plain(
        "gyro_asymmetry",
        "gyro",
        gyro.gyro_asymmetry,
        "asymmetry",
        exact=gyro.exact_gyro_asymmetry,
        rectifies=True,
    ),
    _plain("gyro_scale", "gyro", gyro.gyro_scale, "scale", exact=gyro.exact_gyro_scale),
    _plain(
        "gyro_temperature_scale",
        "gyro",
        gyro.gyro_temperature_scale,
        "slope",
        exact=gyro.exact_gyro_temperature_scale,
    ),
    _plain("supply_ratio", "gyro", gyro.supply_ratio, "coefficient", exact=gyro.exact_supply_ratio),
    _plain("gyro_bias", "gyro", gyro.gyro_bias, "bias"),
    _plain("gyro_temperature_bias", "gyro", gyro.gyro_temperature_bias, "slope"),
    _plain("gyro_vibration", "gyro", gyro.gyro_vibration, "coefficient"),
    _plain("gyro_g_sensitivity", "gyro", gyro.gyro_g_sensitivity, "x", "y"),
    Explanation("gyro_frozen", 2, choices.gyro_frozen),
    Explanation("gyro_saturation", 2, choices.gyro_saturation),
    Explanation("adc_inl", 2, choices.adc_inl),
    Explanation("adc_stuck_bit", 2, choices.adc_stuck_bit),
    _plain("reference_yaw", "reference", reference.reference_yaw, "angle"),
    _plain("reference_lever_arm", "reference", reference.reference_lever_arm, "x", "y"),
    _plain("reference_time_offset", "reference", reference.reference_time_offset, "offset"),
    _plain("reference_clock_skew", "reference", reference.reference_clock_skew, "skew"),
    _plain("reference_scale", "reference", reference.reference_scale, "scale"),
    _plain("setup_wheels_swapped", "encoder", encoder.wheels_swapped),
    Explanation("setup_sign", 0, choices.setup_sign),
    Explanation("setup_unit", 0, choices.setup_unit),
)

EXPLAINED: Final[Mapping[str, Explanation]] = {one.effect: one for one in _ALL}
"""Every effect that the motion block can fit, by name."""
_OF_WHEELS: Final = (0, 1)
"""Ranks of what changes the turn that the gyro sees."""
_PLACE: Final = {effect: place for place, effect in enumerate(EXPLAINED)}


def predict(motion: Motion, settings: Sequence[Setting] = ()) -> Prediction:
    """Return what the recording means with these effects at work, beside those that are known.

    They are applied stage by stage, and in a stage as they are declared here: what is added after
    a factor is not multiplied by it. An effect of a user's library acts last in its stage.
    """
    prediction = Prediction(motion)
    ordered = sorted(
        [*motion.granted, *settings], key=lambda one: (rank_of(one[0]), _declared(one[0]))
    )
    # It rolls as described until the counts are read otherwise.
    rolled = not any(rank_of(variant) == 0 for variant, _ in ordered)
    before: int | None = None
    for variant, coefficients in ordered:
        rank = rank_of(variant)
        if not rolled and rank >= 1:
            prediction.roll()
            rolled = True
        if before in _OF_WHEELS and rank not in _OF_WHEELS:
            prediction.turn()
        variant.apply(prediction, coefficients)
        before = rank
    if not rolled:
        prediction.roll()
    if before in _OF_WHEELS:
        prediction.turn_at_last()
    return prediction


def rank_of(variant: Variant) -> int:
    """Return when a variant acts: encoder 0, wheel 1, gyro 2, reference 3."""
    known = EXPLAINED.get(variant.effect)
    return variant.stage_rank if known is None else known.stage_rank


def _declared(variant: Variant) -> int:
    return _PLACE.get(variant.effect, len(_PLACE))


def explanation_of(effect: Effect) -> Explanation | None:
    """Return how an effect of a user's library acts; None where the library does not say.

    Its stage is one that can be explained: `load_effect_library` refuses others.
    """
    if effect.explain is None:
        return None
    rank = _RANK[effect.stage]
    variant = Variant(
        effect.name,
        effect.explain,
        tuple(parameter.name for parameter in effect.parameters if parameter.kind == "real"),
        is_positive=all(parameter.minimum >= 0 for parameter in effect.parameters),
        stage_rank=rank,
    )
    return Explanation(effect.name, rank, lambda motion: (variant,))
