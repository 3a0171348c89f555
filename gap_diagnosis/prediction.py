"""What the recorded signals mean, and what they would mean if effects were at work.

`Motion` holds a recording at tick level beside a smooth estimate of the true motion; a `Prediction`
is what one set of effects makes of it: steps over ground explained from the counts, the gyro's
reading explained from the true turn, the reference's reading explained from the true pose. Effects
change a prediction in the order in which data flows; each is a short function of
`gap_diagnosis.explanations`.

Index k of every array speaks of the tick that ends at t_k; at k = 0 steps are zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, wraps
from typing import TYPE_CHECKING, Any, Final, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from gap_diagnosis.play import motor_steps
from gap_diagnosis.recording import Floats
from gap_diagnosis.wheel_speeds import WheelSpeeds

if TYPE_CHECKING:
    from gap_diagnosis.explanations.variant import Setting

USUAL_CONTACT_M_PER_SQRT_M: Final = 5e-4
"""Contact noise of a wheel on a floor, before a log is seen."""


@dataclass(frozen=True)
class Motion:
    """A recording at tick level, all float64[n].

    Attributes:
        t_s, dt_s: end and length of each tick on the log's clock.
        left_step_rad, right_step_rad: wheel turns as the description reads the counts.
        left_jump_rad, right_jump_rad: what a counter narrower than described adds where it wraps;
            taken off the turns above, zeros where nothing jumps.
        wrap_bits: at which width it wraps; 0 where nothing jumps.
        left_angle_rad, right_angle_rad: sums of the turns.
        left_steady_rad, right_steady_rad: the turns as counted, without the trembling of a wheel
            that stands.
        left_rate_rad_s, right_rate_rad_s, left_acceleration_rad_s2, right_acceleration_rad_s2:
            means over each tick, smoothed.
        x_m, y_m, heading_rad: estimate of the true pose (in the reference's frame if there is one).
        speed_m_s, turn_rate_rad_s, acceleration_m_s2: of the body, means over each tick, smoothed.
        even_turn_rate_rad_s: the turn rate smoothed by Gaussians alone, as what these round off is
            told of; None where the turn rate is no smoother on straights.
        gyro_turn_rad: sum of the gyro's rate as the description reads it; None without a gyro.
        wheel_unsure_rad2: float64[2, n], variance of each wheel's turn where it was added up from
            speeds.
        told_rad2_per_s: what noise of those speeds adds to the variance of the robot's turn in 1 s.
        lost_m2: variance of where a tick leads, along either axis: which way the robot took to get
            there, no counts say.
        gyro_unsure_rad2: variance of a tick's turn by the gyro beyond its noise: a sample was lost,
            or may be of a moment.
        gyro_code: as recorded, lost samples interpolated; None without a gyro.
        gyro_is_filled: bool[n], where it is interpolated.
        gyro_sensitivity_lsb_per_rad_s, gyro_zero_rate_code, gyro_noise_lsb, adc_max_code: of the
            description; the noise is that of one sample.
        gyro_step_lsb: by how many codes it steps: more than one where a rate is told coarsely.
        gyro_at_its_end: bool[n], codes at an end of the described range or within a sample's noise
            of it: there the gyro does as described, and says no more than that.
        warm_k: temperature over 298.15 K; None where not recorded.
        supply_error: supply over the described one - 1; None where not recorded.
        radius_m, wheelbase_m, rad_per_count: of the description.
        wheel_rounding_rad: float64[2], to what a reading of each wheel's turn is rounded: a count,
            or hardly at all where wheels say how fast they are.
        turning_s: over how long turn rates were averaged.
        bent: float64[n], 1 where headings are bent onto a reference, 0 where they are the wheels'.
        bent_over_s: over how long: the turn is the reference's in what lasts longer.
        sharp_s: details of the turn rate that are shorter are the wheels' noise; inf: all are.
        wheel_speeds: what is known of each beside its own counts.
        has_speeds: wheels say how fast they are, and no way.
        has_counters: rows were put together by the frames' counters, not by their stamps.
        are_rows_late: rows have no clock of their own: what they say was read at other times.
        own_names: what the log's bus calls ENCODER and IMU.
        granted: effects that are known beside the description: every prediction has them.
    """

    t_s: Floats
    dt_s: Floats
    left_step_rad: Floats
    right_step_rad: Floats
    left_jump_rad: Floats
    right_jump_rad: Floats
    wrap_bits: int
    left_angle_rad: Floats
    right_angle_rad: Floats
    left_steady_rad: Floats
    right_steady_rad: Floats
    left_rate_rad_s: Floats
    right_rate_rad_s: Floats
    left_acceleration_rad_s2: Floats
    right_acceleration_rad_s2: Floats
    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    speed_m_s: Floats
    turn_rate_rad_s: Floats
    acceleration_m_s2: Floats
    gyro_turn_rad: Floats | None
    gyro_code: Floats | None
    gyro_is_filled: NDArray[np.bool_]
    gyro_sensitivity_lsb_per_rad_s: float
    gyro_zero_rate_code: float
    gyro_noise_lsb: float
    gyro_step_lsb: float
    adc_max_code: float
    gyro_at_its_end: NDArray[np.bool_]
    warm_k: Floats | None
    supply_error: Floats | None
    radius_m: float
    wheelbase_m: float
    rad_per_count: float
    wheel_unsure_rad2: Floats
    told_rad2_per_s: float
    lost_m2: Floats
    gyro_unsure_rad2: Floats
    wheel_rounding_rad: Floats
    turning_s: float
    bent: Floats
    bent_over_s: float
    sharp_s: float
    wheel_speeds: WheelSpeeds
    has_speeds: bool
    has_counters: bool = True
    are_rows_late: bool = False
    own_names: Mapping[str, str] = field(default_factory=dict)
    granted: tuple[Setting, ...] = ()
    even_turn_rate_rad_s: Floats | None = None

    @cached_property
    def tick_s(self) -> float:
        """The usual length of a tick."""
        return float(np.median(self.dt_s[1:]))

    @cached_property
    def rounding_rad(self) -> float:
        """To what the reading of the coarser wheel is rounded."""
        return float(self.wheel_rounding_rad.max())

    @cached_property
    def told(self) -> dict[Callable[[Motion], Any], Any]:
        """What was told of the motion so far, by what told it (`told_once`)."""
        return {}

    @cached_property
    def left_motor_rad(self) -> Floats:
        """Turns of the left motor, of which a play behind it takes its share."""
        return motor_steps(self.left_steady_rad, float(self.wheel_rounding_rad[0]), self.tick_s)

    @cached_property
    def right_motor_rad(self) -> Floats:
        """Turns of the right motor."""
        return motor_steps(self.right_steady_rad, float(self.wheel_rounding_rad[1]), self.tick_s)

    @cached_property
    def fastest_rad_s(self) -> float:
        """The largest rate of either wheel."""
        return float(max(np.abs(self.left_rate_rad_s).max(), np.abs(self.right_rate_rad_s).max()))

    @cached_property
    def is_bent(self) -> bool:
        """Headings are bent onto a reference anywhere."""
        return bool(self.bent.any())

    @cached_property
    def described_turn_rad(self) -> Floats:
        """Turn of each tick by the description; as `Prediction.turn_rad` to the last digit."""
        ways = self.radius_m * self.right_step_rad - self.radius_m * self.left_step_rad
        return np.asarray(ways / self.wheelbase_m)

    def bent_part(self, rates: Floats) -> Floats:
        """Return of rates by the wheels what a reference takes the place of: what lasts."""
        width = self.bent_over_s / self.tick_s
        return self.bent * _lasting(rates, width) if self.is_bent else np.zeros_like(rates)

    @cached_property
    def described(self) -> Motion:
        """The same without what is known beside the description."""
        return replace(self, granted=()) if self.granted else self

    @property
    def elapsed_s(self) -> Floats:
        """Time since the log's start."""
        return np.asarray(self.t_s - self.t_s[0])


def noise_of_speeds(unsure_rad2: Floats, turn_per_rad: float, tick_s: float) -> float:
    """Return what noise of wheels' speeds usually adds to a turn's variance [rad²/s].

    *unsure_rad2*: float64[2, n], variance of each wheel's step of *tick_s*; one rad of a wheel
    turns the robot by *turn_per_rad*. Where a wheel speeds up more is unsure of it, which is no
    noise.
    """
    both = unsure_rad2.sum(axis=0)
    moving = both[both > 0.0]
    return turn_per_rad**2 * float(np.median(moving)) / tick_s if len(moving) else 0.0


_Told = TypeVar("_Told")


def told_once(tell: Callable[[Motion], _Told]) -> Callable[[Motion], _Told]:
    """Return *tell*, which goes by the motion alone, asked once of each: an effect needs the same
    of it whatever its size."""

    @wraps(tell)
    def told(motion: Motion) -> _Told:
        if tell not in motion.told:
            motion.told[tell] = tell(motion)
        return cast(_Told, motion.told[tell])

    return told


@dataclass
class Prediction:
    """What a set of effects makes of a recording; arrays are float64[n] and may be replaced.

    Attributes:
        motion: what was recorded.
        left_rad, right_rad: true wheel turns (encoder effects correct what was counted).
        left_m, right_m: steps over ground (wheel effects).
        wheelbase_m: effective distance of the wheels.
        lateral_m: step to the left of the body's x axis.
        yaw_rad: turn that no wheel made.
        reference_forward_m, reference_left_m: tracked point in the body frame.
        reference_heading_rad: added to the reported heading.
        reference_delay_s: reported stamp - true time.
        reference_scale: reported over true distance - 1.
        encoder_delay_s: stamp of the counts - time of sampling.
    """

    motion: Motion
    left_rad: Floats = field(init=False)
    right_rad: Floats = field(init=False)
    left_m: Floats = field(init=False)
    right_m: Floats = field(init=False)
    wheelbase_m: Floats = field(init=False)
    lateral_m: Floats = field(init=False)
    yaw_rad: Floats = field(init=False)
    reference_forward_m: Floats | float = 0.0
    reference_left_m: Floats | float = 0.0
    reference_heading_rad: Floats | float = 0.0
    reference_delay_s: Floats | float = 0.0
    reference_scale: float = 0.0
    encoder_delay_s: Floats | float = 0.0
    _turned_rad_s: Floats = field(init=False)
    _gyro_rad_s: Floats = field(init=False)
    _showed_rad_s: Floats | float = field(init=False, default=0.0)
    _is_to_turn: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        """Start from the description."""
        self.left_rad = self.motion.left_step_rad + self.motion.left_jump_rad
        self.right_rad = self.motion.right_step_rad + self.motion.right_jump_rad
        self._turned_rad_s = self._gyro_rad_s = self.motion.turn_rate_rad_s
        self.roll()

    @property
    def turned_rad_s(self) -> Floats:
        """Turn rate by the wheels, as the effects so far have them turn."""
        self._turn_if_due()
        return self._turned_rad_s

    @property
    def showed_rad_s(self) -> Floats | float:
        """What a reference showed of that change before any effect explained it."""
        self._turn_if_due()
        return self._showed_rad_s

    @property
    def gyro_rad_s(self) -> Floats:
        """Rate that the gyro should read."""
        self._turn_if_due()
        return self._gyro_rad_s

    @gyro_rad_s.setter
    def gyro_rad_s(self, value: Floats) -> None:
        self._turn_if_due()
        self._gyro_rad_s = value

    def roll(self) -> None:
        """Let the wheels roll as described, by the turns explained so far."""
        count = len(self.motion.t_s)
        self.left_m = self.motion.radius_m * self.left_rad
        self.right_m = self.motion.radius_m * self.right_rad
        self.wheelbase_m = np.full(count, self.motion.wheelbase_m)
        self.lateral_m = np.zeros(count)
        self.yaw_rad = np.zeros(count)

    def turn(self) -> None:
        """Let the gyro see the turn that the wheels make by the effects explained so far.

        Counts that jump are left out: no body turns with them. What a reference showed of the
        change stands in the estimated turn already.
        """
        m = self.motion
        if m.wrap_bits:
            return
        # As smooth from row to row as the turn is: stamps may jitter.
        changed = (self.turn_rad - m.described_turn_rad) / m.tick_s
        if m.is_bent:
            self._showed_rad_s = m.bent_part(changed)
            changed = changed - self._showed_rad_s
        self._gyro_rad_s = self._gyro_rad_s + changed
        self._turned_rad_s = self._turned_rad_s + changed

    def turn_at_last(self) -> None:
        """Do so once anyone asks for it: what is compared with a gyro is what it reads beside."""
        self._is_to_turn = True

    def _turn_if_due(self) -> None:
        if self._is_to_turn:
            self._is_to_turn = False
            self.turn()

    @property
    def gyro_added_rad_s(self) -> Floats:
        """What the gyro reads beside the turn that the wheels make."""
        return np.asarray(self._gyro_rad_s - self._turned_rad_s)

    @property
    def forward_m(self) -> Floats:
        """Step along the body's x axis."""
        return np.asarray(0.5 * (self.left_m + self.right_m))

    @property
    def turn_rad(self) -> Floats:
        """Turn of each tick."""
        return np.asarray((self.right_m - self.left_m) / self.wheelbase_m + self.yaw_rad)

    def path(self, heading_rad: Floats | None = None) -> tuple[Floats, Floats, Floats]:
        """Return x_m, y_m, heading_rad dead-reckoned from zero by the midpoint rule.

        With *heading_rad* (float64[n], for example from a gyro) steps go along it.
        """
        if heading_rad is None:
            heading_rad = np.cumsum(self.turn_rad)
        middle = heading_rad - 0.5 * np.diff(heading_rad, prepend=heading_rad[0])
        forward, lateral = self.forward_m, self.lateral_m
        x_m = np.cumsum(forward * np.cos(middle) - lateral * np.sin(middle))
        y_m = np.cumsum(forward * np.sin(middle) + lateral * np.cos(middle))
        return x_m, y_m, heading_rad


def _lasting(values: Floats, width: float) -> Floats:
    """Return values smoothed about as a Gaussian of *width* ticks does, by three moving means."""
    length = max(round(math.sqrt(4.0 * width**2 + 1.0)), 1)
    for _ in range(3):
        values = uniform_filter1d(values, length, mode="nearest")
    return values
