"""What tyres do on a floor is not exact: how far it leads wheels astray, and may vary.

A track is wider in one turn than in the next, a tyre scrubs now more and now less. Beside each set
of effects the filter knows how much farther each wheel goes with them, and takes it to be more or
less by a share that is a level of noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.variant import Setting, Variant
from gap_diagnosis.motion.nodes import Nodes, without_jumps
from gap_diagnosis.motion.whitening import CONTACT, INEXACT
from gap_diagnosis.recording import Floats

_ROUGHLY: Final = 0.1
"""The share by which effects vary where a search for it begins."""
_OVER_S: Final = 0.5
"""Over which it is told how far wheels go astray: what measures it is noisy."""


def varies(variant: Variant, nodes: Nodes) -> bool:
    """Tell whether an effect may vary: a gyro alone does not show whose turns do, its own or those
    of the wheels."""
    return nodes.has_reference and variant.varies


def roughly(levels: Floats, described: Floats) -> list[Floats]:
    """Return levels, float64[levels], at which effects vary, in a contact as it is or as it is
    described: from exact effects no slope leads there."""
    found = []
    for contact in (levels[CONTACT], min(levels[CONTACT], described[CONTACT])):
        one = levels.copy()
        one[CONTACT], one[INEXACT] = contact, _ROUGHLY
        found.append(one)
    return found


def astray(nodes: Nodes, settings: Sequence[Setting], seen_m: float) -> tuple[Floats, Floats]:
    """Return how much farther each wheel goes in each block with effects [m], float64[m] each.

    It is no more in all than the log shows, *seen_m*: effects that cancel each other, as the scales
    of wheels and of a room may, would buy as much noise as they are large. What a counter jumps is
    no way.
    """
    motion = without_jumps(nodes.smooth)
    with_them, without = (predict(motion, one) for one in (settings, ()))
    ahead = with_them.forward_m - without.forward_m
    aside = 0.5 * nodes.motion.wheelbase_m * (with_them.turn_rad - without.turn_rad)
    left, right = (nodes.mean(np.cumsum(one)) for one in (ahead - aside, ahead + aside))
    left, right = (np.diff(one, prepend=one[0]) for one in (left, right))
    size_m = _size(left, right)
    share = min(1.0, seen_m / size_m) if size_m > 0 else 0.0
    return share * left, share * right


def seen_astray_m(nodes: Nodes, left_over: Floats) -> float:
    """Return how far from their description wheels are seen to go in a block, the root of the sum
    of squares.

    *left_over*: float64[4, m], what the description leaves of the reference and the gyro.
    """
    motion = nodes.motion
    heading = nodes.mean(motion.heading_rad)
    width = _OVER_S / float(np.median(np.diff(nodes.mean(motion.t_s))))

    def steps(values: Floats) -> Floats:
        seen = np.flatnonzero(np.isfinite(values))
        if len(seen) < 2:
            return np.zeros(len(values))
        between = np.interp(np.arange(len(values)), seen, values[seen])
        return np.asarray(gaussian_filter1d(np.gradient(between), width))

    ahead = np.cos(heading) * steps(left_over[0]) + np.sin(heading) * steps(left_over[1])
    aside = 0.5 * motion.wheelbase_m * steps(left_over[2 if nodes.has_heading else 3])
    return _size(ahead - aside, ahead + aside)


def _size(left: Floats, right: Floats) -> float:
    return math.sqrt(float(left @ left + right @ right))
