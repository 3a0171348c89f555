"""What constants within their tolerances change beside effects that are large."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from typing import Final

import numpy as np

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.motion.columns import MOVES_IN_TIME, Columns, Term
from gap_diagnosis.motion.nodes import Nodes, residuals
from gap_diagnosis.recording import Floats

_OF_WHEELS: Final = frozenset({"radius_scale", "radius_mismatch", "wheelbase_scale"})
_OF_GYRO: Final = frozenset(
    {
        "gyro_asymmetry",
        "gyro_nonlinearity",
        "gyro_scale",
        "gyro_temperature_scale",
        "supply_ratio",
    }
)
_OF_CODES: Final = _OF_GYRO | {
    "gyro_bias",
    "gyro_g_sensitivity",
    "gyro_temperature_bias",
    "gyro_vibration",
}
_ACTS_OTHERWISE: Final[Mapping[str, Set[str]]] = {
    **dict.fromkeys(MOVES_IN_TIME, MOVES_IN_TIME),
    "reference_lever_arm": MOVES_IN_TIME | {"reference_scale"},
    "lateral_slip": MOVES_IN_TIME | _OF_WHEELS,
    "longitudinal_slip": frozenset({"gyro_lag"}),
    **dict.fromkeys(
        ("backlash", "encoder_eccentricity", "wheel_eccentricity"),
        _OF_WHEELS | {"gyro_lag", "gyro_scale"},
    ),
    **dict.fromkeys(("gyro_asymmetry", "gyro_lag"), _OF_WHEELS | _OF_GYRO),
    **dict.fromkeys(("adc_stuck_bit", "gyro_saturation"), _OF_CODES),
    **dict.fromkeys(("grade_slip", "one_sided_slip", "turn_scrub"), _OF_WHEELS | {"frame_latency"}),
}
"""Beside a large effect these constants do something else within their tolerances than about none:
of half a slipping wheel's way a radius is half as much, a scrub of -0.5 makes a wheelbase four
times as much, a late reference sees a long arm swung on, a late gyro none of the turns that an
encoder makes up or that wheels count too far as they speed up, late counts show the edges of a slip
late as well, and the scale of a gyro that lags is that of what it shows. A gyro that clips shows
nothing of its scale; where its converter holds a high bit, a bias of one code at the bit's edge
moves the mean reading by twenty."""

_SMOOTHLY: Final = frozenset({"longitudinal_slip"})
"""Effects of what is sharpest in turns: beside them a lag is told along smooth ones, or it takes up
a part (half a standard deviation of a creep, on average)."""


def free_about(
    nodes: Nodes,
    columns: Columns,
    change: Floats | float,
    free: Sequence[tuple[int, float]],
    terms: Sequence[Term],
    coefficients: Sequence[tuple[float, ...]],
    more: int = 0,
) -> Floats:
    """Return the data with a *change*, float64[4, m] or 0, and what units of the *free* constants,
    base columns with their tolerances, change beside effects of these coefficients:
    float64[4, m, 1 + c + more].

    What acts otherwise beside one of them is told about them. Behind them stand *more* columns
    which are still to be written.
    """
    place_of = {index: 1 + place for place, (index, _) in enumerate(columns.nuisances)}
    taken = [0, *(place_of[index] for index, _ in free), *[0] * more]
    values = np.take(columns.within_tolerance, taken, axis=-1)
    values[..., 0] += change
    told = frozenset().union(*(_ACTS_OTHERWISE.get(t.variant.effect, ()) for t in terms))
    beside = [
        (1 + place, sd, *columns.little[index])
        for place, (index, sd) in enumerate(free)
        if index in columns.little and columns.little[index][0].effect in told
    ]
    is_detailed = _SMOOTHLY.isdisjoint(term.variant.effect for term in terms)
    for is_sharp in (False, True):
        # As sharp as it is beside no effect: else none were likelier by what details show.
        alike = [one for one in beside if (is_detailed and one[2].little is not None) == is_sharp]
        if alike:
            _tell(values, alike, nodes, terms, coefficients, is_sharp=is_sharp)
    return values


def _tell(
    values: Floats,
    constants: Sequence[tuple[int, float, Variant, int]],
    nodes: Nodes,
    terms: Sequence[Term],
    coefficients: Sequence[tuple[float, ...]],
    *,
    is_sharp: bool,
) -> None:
    """Write what units of constants change beside effects into *values*, float64[4, m, columns]; of
    each constant its column, tolerance, variant and place among that one's coefficients."""
    motion = nodes.sharp if is_sharp else nodes.smooth
    settings = [
        (term.variant.in_detail if is_sharp else term.variant, sizes)
        for term, sizes in zip(terms, coefficients, strict=True)
    ]
    there = residuals(nodes, predict(motion, settings))
    for column, sd, variant, own in constants:
        sizes = [0.0] * len(variant.coefficients)
        sizes[own] = sd
        ahead = residuals(nodes, predict(motion, [*settings, (variant, sizes)]))
        values[..., column] = (there - ahead) / sd
        if variant.effect in MOVES_IN_TIME:
            # As beside no effect: a chord to one side has the way's bends in it, and where a delay
            # does, any effect would win by them.
            back = (variant, [-size for size in sizes])
            behind = residuals(nodes, predict(motion, [*settings, back]))
            values[..., column] = (behind - ahead) / (2.0 * sd)
