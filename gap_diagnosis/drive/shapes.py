"""How each effect bends the prediction: coordinates, priors, and the drive they stand for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.answer import for_a_while, predict
from gap_diagnosis.drive.data import DriveData, Spell, drive_data
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot

Floats = NDArray[np.float64]
About = tuple[float, float, float]
"""Gains of the left and of the right wheel, and by what share wheels slow down faster than they
speed up."""

AS_DESCRIBED: Final = (1.0, 1.0, 0.0)
_NOTHING: Final[Mapping[str, float]] = {}

BENT: Final = (
    "drive_acceleration_limit", "drive_deadband", "drive_delay", "drive_lag", "drive_saturation",
)  # fmt: skip
"""Effects with one parameter that bends the prediction; integrated over a grid."""

THRESHOLDS: Final = frozenset(("drive_acceleration_limit", "drive_deadband", "drive_saturation"))

_FOREIGN_LAGS_S: Final = (0.02, 0.06, 0.15, 0.4)
_FOREIGN_DELAYS_S: Final = (0.01, 0.03, 0.08, 0.2)
_STEP: Final = 0.02
"""Of a gain or of braking, over which a slope is taken."""
_HATS: Final = 5
FEWEST_POLES: Final = 2
_MOST_POLES: Final = 12
WAVE: Final = 0.1
"""Of its rate, by which poles move a drive: a unit of their columns."""
_TOLD: Final = tuple(0.0025 * 1.6**step for step in range(9))
"""Shares of the largest rate that is commanded, up to a tenth of it: whether a drive moves at all
is decided far below."""
_HALVINGS: Final = 12
_WITHIN: Final = 0.5
"""Share of the tolerance of time by which a wheel at its fastest is off in any drive: a threshold
that moves no wheel by more is no news. Another engine's motor, a contact that gives, a count that
slips do as much, and surely so in a log of a minute."""
_TRACE: Final = 0.01
"""Of that; what moves no wheel by more leaves no trace."""

PARAMETERS: Final = {
    "drive_acceleration_limit": "limit",
    "drive_deadband": "rate",
    "drive_delay": "delay",
    "drive_lag": "time_constant",
    "drive_saturation": "limit",
}


@dataclass(frozen=True)
class Coordinate:
    """The parameter of a bending effect, in the coordinate in which its grid is even.

    Thresholds are even in their logarithm, with a log-uniform prior over *span*, of which those
    from *low* to *high* leave a trace and those within *news* do more than any drive may; lag and
    delay in the square root of their size, so that small ones are as finely resolved as they are
    told apart.
    """

    effect: str
    low: float
    high: float
    is_logarithm: bool
    size: prior.Size | None = None
    span: float = 1.0
    news: tuple[float, float] = (-math.inf, math.inf)

    @property
    def key(self) -> str:
        """effect.parameter."""
        return f"{self.effect}.{PARAMETERS[self.effect]}"

    def value(self, coordinate: Floats) -> Floats:
        """Return the parameter."""
        value = np.exp(coordinate) if self.is_logarithm else coordinate**2
        return np.asarray(value, dtype=np.float64)

    def at(self, value: float) -> float:
        """Return the coordinate of a parameter."""
        return math.log(value) if self.is_logarithm else math.sqrt(value)

    @property
    def newsworthy(self) -> tuple[float, float]:
        """The least and the largest parameter that does more than any drive may."""
        if self.size is not None:
            return self.news
        return math.exp(self.news[0]), math.exp(self.news[1])

    def log_prior(self, coordinate: Floats) -> Floats:
        """Return the log prior density in the coordinate."""
        if self.size is None:
            return np.full(coordinate.shape, -math.log(self.span))
        jacobian = np.log(2 * np.maximum(coordinate, 1e-12))
        return np.asarray(self.size.log_density(coordinate**2) + jacobian, dtype=np.float64)


def drive_beside_described(recording: Recording, robot: Robot) -> DriveData | None:
    """Return the drive's data, and how far its wheels go astray from the described drive; None
    where the log has no commands, no motion or too few rows."""
    data = drive_data(recording, robot)
    return None if data is None else data.beside(Shapes(data, robot).angle({}))


def masked(columns: Floats, spell: Spell) -> Floats:
    """Return what columns float64[c, 2, m] add to the angles where they act in a spell alone.

    Angles are means over blocks: of the step between two, half lies in each.
    """
    steps = np.diff(columns, axis=2, prepend=columns[..., :1])
    first, last = spell
    edges = [block for block in spell if 0 < block < steps.shape[2]]
    steps[..., edges] *= 0.5
    steps[..., :first] = 0.0
    steps[..., last + 1 :] = 0.0
    return np.asarray(np.cumsum(steps, axis=2))


def _of_each(change: Floats) -> Floats:
    """Return a change of both wheels, float64[2, m], as that of each: float64[2, 2, m]."""
    columns = np.zeros((2, *change.shape))
    columns[0, 0], columns[1, 1] = change
    return columns


class Shapes:
    """Predictions of one recording's wheel angles under the described drive and its deviations."""

    def __init__(self, data: DriveData, robot: Robot) -> None:
        self._data = data
        drive = robot.plant.drive
        self._lag_s, self._delay_s = drive.time_constant_s, drive.delay_s
        self._limit_rate, self._limit_acceleration = data.limits_beside(robot)
        fastest = float(np.abs(data.commanded).max())
        self._moves_rad = _WITHIN * robot.tolerance.time_offset_s * fastest

    def coordinate(self, effect: str) -> Coordinate:
        """Return the coordinate of a bending effect; of a threshold that does nothing in this log
        whatever its size, an empty one."""
        if effect == "drive_lag":
            return Coordinate(effect, 0.0, math.sqrt(2 * prior.LAG_S.high), False, prior.LAG_S)
        if effect == "drive_delay":
            return Coordinate(effect, 0.0, math.sqrt(2 * prior.DELAY_S.high), False, prior.DELAY_S)
        low, high = self._span(effect)
        least, most = self._ends(effect, self._moves_rad)
        news = (least, most) if most > least else (math.inf, -math.inf)
        first, last = self._ends(effect, _TRACE * self._moves_rad)
        return Coordinate(effect, first, last, True, span=high - low, news=news)

    def _ends(self, effect: str, least_rad: float) -> tuple[float, float]:
        """Return the logarithms between which a threshold moves a wheel by more than *least_rad*;
        twice the same where none does."""
        low, high = self._span(effect)
        nominal = self.angle({})

        def acts(at: float) -> bool:
            moved = np.abs(self.angle({effect: math.exp(at)}) - nominal)
            return bool(moved.max() > least_rad)

        ends = {acts(low): low, acts(high): high}
        if len(ends) == 1:
            return low, high if True in ends else low
        for _ in range(_HALVINGS):
            middle = 0.5 * (ends[True] + ends[False])
            ends[acts(middle)] = middle
        return (low, ends[True]) if ends[True] < ends[False] else (ends[True], high)

    def log_silent(self, effect: str) -> float:
        """Return the log share of a threshold's prior that does nothing in this log.

        A lag or a delay has none: whatever moves is late.
        """
        if effect not in THRESHOLDS:
            return -math.inf
        one = self.coordinate(effect)
        share = 1.0 - (one.high - one.low) / one.span
        return math.log(share) if share > 0 else -math.inf

    def _span(self, effect: str) -> tuple[float, float]:
        """Return the logarithms of the ends of a threshold's prior."""
        share, scale = {
            "drive_deadband": (prior.DEADBAND_SHARE, self._limit_rate),
            "drive_saturation": (prior.SATURATION_SHARE, self._limit_rate),
            "drive_acceleration_limit": (prior.ACCELERATION_SHARE, self._limit_acceleration),
        }[effect]
        return math.log(share[0] * scale), math.log(share[1] * scale)

    def angle(
        self,
        values: Mapping[str, float],
        about: About = AS_DESCRIBED,
        *,
        always: Mapping[str, float] = _NOTHING,
        gain: float = 1.0,
    ) -> Floats:
        """Return block means of the wheel angles: float64[2, m].

        *values* by effect, and *about* what gains and braking, where effects act; by how much the
        drive deviates *always*, and its *gain*.
        """
        within = self._rows({**values, **always}, (gain * about[0], gain * about[1], about[2]))
        if self._data.acting is None:
            return self._data.blocks(within)
        first, last = (int(self._data.start[block]) for block in self._data.acting)
        beside = self._rows(always, (gain, gain, 0.0))
        described_s = self._lag_s + always.get("drive_lag", 0.0)
        lags_s = described_s, described_s + values.get("drive_lag", 0.0)
        rows = for_a_while(beside, within, first, last, lags_s, self._data.dt_s)
        return self._data.blocks(rows)

    def _rows(self, values: Mapping[str, float], about: About) -> Floats:
        """Return the wheel angles at the rows, float64[2, n]."""
        angles: Any = predict(
            self._data.commanded,
            self._data.rate_0,
            self._data.dt_s,
            self._lag_s + values.get("drive_lag", 0.0),
            self._delay_s + values.get("drive_delay", 0.0),
            values.get("drive_deadband", 0.0),
            min(self._limit_rate, values.get("drive_saturation", math.inf)),
            min(self._limit_acceleration, values.get("drive_acceleration_limit", math.inf)),
            np.array(about[:2]),
            about[2],
        )
        return np.asarray(angles)

    def gain_columns(
        self, values: Mapping[str, float], angle: Floats, about: About = AS_DESCRIBED
    ) -> Floats:
        """Return what a relative gain of each wheel adds to the angles *about* others where effects
        act: float64[2, 2, m]."""
        more = self.angle(values, (about[0] + _STEP, about[1] + _STEP, about[2]))
        return _of_each((more - angle) / _STEP)

    def lasting_gain_columns(self, values: Mapping[str, float], angle: Floats) -> Floats:
        """Return what a relative gain of each wheel adds that it always has: float64[2, 2, m]."""
        return _of_each((self.angle(values, gain=1.0 + _STEP) - angle) / _STEP)

    def braking_column(self, values: Mapping[str, float], angle: Floats, about: About) -> Floats:
        """Return what a share of faster braking adds to the angles: float64[1, 2, m]."""
        more = self.angle(values, (about[0], about[1], about[2] + _STEP))
        return ((more - angle) / _STEP)[np.newaxis]

    def foreign(self, *, has_gains: bool = True) -> list[Floats]:
        """Return what a drive other than the described one would add, in several ways:
        float64[c, 2, m] each.

        Responses with other lags less the described one (weighted, they make any stable linear
        response of no overshoot or some), and a speed that bends with its size; responses that come
        late, weighted; a gain of each wheel, where asked, exact as no hats are; one that is any
        smooth function of its speed; and one of driving and of turning, as of a controller that
        takes another track for its own.
        """
        nominal = self.angle({})
        lags = [self.angle({"drive_lag": more}) - nominal for more in _FOREIGN_LAGS_S]
        late = [self.angle({"drive_delay": more}) - nominal for more in _FOREIGN_DELAYS_S]
        rates, share = self._rates(nominal)
        bend = np.cumsum(share * rates, axis=1) * self._data.block_s
        bent = np.zeros((2, _HATS, *rates.shape))
        for wheel in range(2):
            for hat in range(_HATS):
                height = np.maximum(0.0, 1 - np.abs(share[wheel] * (_HATS - 1) - hat))
                bent[wheel, hat, wheel] = np.cumsum(height * rates[wheel]) * self._data.block_s
        made = [
            np.stack([*lags, bend]),
            np.stack(late),
            *([self.gain_columns({}, nominal)] if has_gains else []),
            bent.reshape(2 * _HATS, *rates.shape),
            self.driving_and_turning(),
        ]
        return [np.where(self._data.seen, columns, 0.0) for columns in made]

    def driving_and_turning(self) -> Floats:
        """Return what a gain of the commanded speed and of the commanded turn add:
        float64[2, 2, m]."""
        left, right = self._data.commanded
        speed, turn = 0.5 * (left + right), 0.5 * (right - left)
        made = [self._answers(np.stack(both)) for both in ((speed, speed), (-turn, turn))]
        return np.stack(made)

    def slow(self) -> Floats:
        """Return what a drive adds that answers slow commands otherwise than others: per step of
        what is commanded, what a gain of 2 there adds; float64[c, 2, m].

        What it makes of commands within a dead band that is no news is none either.
        """
        told = self._data.commanded
        fastest = float(np.abs(told).max()) or 1.0
        share = np.abs(told) / fastest
        least = prior.DEADBAND_TOLERANCE / fastest
        shares = [least, *(one for one in _TOLD if one > least)]
        steps = [
            np.where((share > low) & (share <= high), told, 0.0) for low, high in pairwise(shares)
        ]
        made = [self._answers(one) for one in steps if one.any()]
        return np.stack(made) if made else np.zeros((0, *self._data.angle.shape))

    def waves(self) -> list[Floats]:
        """Return what poles add to the angles, by how many there are: float64[4, 2, m] each, cosine
        and sine of each wheel, per *WAVE* of the rate.

        Once per turn is left to the motion: so a disc off centre counts.
        """
        data = self._data
        rows = np.arange(data.start[-1])
        middle = 0.5 * (data.start[:-1] + data.start[1:])
        made = []
        for poles in range(FEWEST_POLES, _MOST_POLES + 1):
            columns = np.zeros((4, *data.angle.shape))
            for wheel in range(2):
                there = data.seen[wheel]
                if not there.any():
                    continue
                angle = np.interp(rows, middle[there], data.angle[wheel, there])
                for place, function in enumerate((np.cos, np.sin)):
                    both = np.zeros((2, data.commanded.shape[1]))
                    both[wheel, : len(rows)] = (WAVE / poles) * function(poles * angle)
                    columns[2 * wheel + place] = data.blocks(both)
            made.append(columns)
        return made

    def _answers(self, commanded: Floats) -> Floats:
        """Return what the described drive makes of commands, as if it knew no limits."""
        angles: Any = predict(
            commanded,
            np.zeros(2),
            self._data.dt_s,
            self._lag_s,
            self._delay_s,
            0.0,
            math.inf,
            math.inf,
            np.ones(2),
            0.0,
        )
        return self._data.blocks(angles)

    def _rates(self, nominal: Floats) -> tuple[Floats, Floats]:
        """Return the described rates, float64[2, m], and their sizes as shares of the largest."""
        steps = np.diff(nominal, axis=1, prepend=nominal[:, :1]) / self._data.block_s
        seen = self._data.seen
        rates = np.where(seen & np.roll(seen, 1, axis=1), steps, 0.0)
        return rates, np.abs(rates) / (float(np.abs(rates).max()) or 1.0)
