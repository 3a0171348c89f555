"""A flat top: codes that go no further though the wheels, or the noise, say they should."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gap_diagnosis import code_spells
from gap_diagnosis.codes.data import Bools, CodeData, Floats, stretches
from gap_diagnosis.trembling import tremble_lsb

_LEAST_AT_TOP: Final = 5
_NATS: Final = 5.0
_LEAST_TICKS: Final = 5
_PILED_ONCE: Final = 60
_PILED_BY_VISIT: Final = 20
_MOST_PILED: Final = 400
"""So many codes at the top count at most, and of a few visits to it fewer."""
_BELOW_DESCRIBED: Final = 0.99


@dataclass(frozen=True)
class FlatTop:
    """The limit and how much better it explains the extremes, in these rows alone if any."""

    limit_rad_s: float
    sd_rad_s: float
    log_ratio: float
    rows: tuple[int, int] | None = None


def flat_top(data: CodeData) -> FlatTop | None:
    """Return the flat top, of the whole log or of a part of it; None where the extremes are no
    limit, or the described one."""
    whole = _flat_top(data)
    if whole is not None and whole.log_ratio > 0.0:
        return whole
    expected = np.nan_to_num(data.expected, nan=data.zero_code)
    part = code_spells.flat_top(data.code - data.zero_code, expected - data.zero_code)
    if part is None:
        return whole
    within = _flat_top(data.rows(*part[:2]))
    if within is None:
        return whole
    return replace(within, log_ratio=within.log_ratio - math.log(len(data.code)), rows=part[:2])


def _flat_top(data: CodeData) -> FlatTop | None:
    away = data.code - data.zero_code
    reach = float(np.max(np.abs(away)))
    described = min(data.high - data.zero_code, data.zero_code - data.low)
    if reach < 1 or reach >= _BELOW_DESCRIBED * described:
        return None
    tolerance = 0.6 if data.is_whole else 1e-6 * reach
    top = np.abs(away) >= reach - tolerance
    if np.count_nonzero(top) < _LEAST_AT_TOP:
        return None
    ratio = _piled(data, np.abs(away), reach, top) + _overrun(data, away, reach, top)
    step = 1.0 if data.is_whole else 0.0
    sd = max(step / math.sqrt(12), 1e-4 * reach) / data.per_rad_s
    return FlatTop(reach / data.per_rad_s, sd, ratio)


def _piled(data: CodeData, size: Floats, reach: float, top: Bools) -> float:
    """Return the evidence of more codes at the top than noise about any rate would leave there."""
    # Codes that are cut off do not tremble: half of a log of them hides the noise of the rest.
    noise = tremble_lsb(data.code, but=top)
    if noise < 1.5:
        return 0.0
    near = int(np.count_nonzero(size > reach - 2 * noise))
    at = int(np.count_nonzero(top))
    usual = min(0.9, 2.0 / noise)
    share = at / near
    if share <= usual:
        return 0.0
    # What stays at the top for long may be stuck there; what comes back to it again and again not.
    visits = len(stretches(top))
    most = min(max(_PILED_ONCE, _PILED_BY_VISIT * visits), _MOST_PILED)
    told = min(near, most) / near
    return float(
        told
        * (
            at * math.log(share / usual)
            + (near - at) * math.log(max(1 - share, 1e-3) / (1 - usual))
        )
    )


def _overrun(data: CodeData, away: Floats, reach: float, top: Bools) -> float:
    """Return the evidence of stretches in which the wheels turn beyond the top, the code does not.

    Against it: stretches beyond the top with the code elsewhere.
    """
    expected = np.nan_to_num(data.expected, nan=data.zero_code) - data.zero_code
    expected = expected * code_spells.share_read(away, expected, reach)
    margin = max(5 * data.spread, 0.03 * reach)
    beyond = (np.abs(expected) > reach + margin) & (np.sign(expected) == np.sign(away))
    long = [one for one in stretches(beyond & top) if one[1] - one[0] >= _LEAST_TICKS]
    elsewhere = [one for one in stretches(beyond & ~top) if one[1] - one[0] >= _LEAST_TICKS]
    return _NATS * (len(long) - len(elsewhere)) if len(long) > len(elsewhere) else 0.0
