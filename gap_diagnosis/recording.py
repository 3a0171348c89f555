"""What a log says, on one clock: the arrays that every part of the diagnosis reads.

One row per sensor tick of the ECU. Times are seconds of the log's clock. What the log does not hold
is None; what a tick misses (a lost frame) is NaN, and its row still stands, so that counts and gyro
keep their place in time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.granted import NOTHING, Granted

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Reference:
    """A trajectory measured from outside the robot.

    Attributes:
        t_s: float64[m], ascending, its own stamps on (nominally) the log's clock.
        x_m, y_m: float64[m].
        heading_rad: float64[m], unwrapped; None where the file has no orientation.
        without_fix: what a GPS receiver said while it had no fix, left out of the samples.
    """

    t_s: Floats
    x_m: Floats
    y_m: Floats
    heading_rad: Floats | None
    without_fix: int = 0

    def only(self, kept: NDArray[np.bool_]) -> Reference:
        """Return the samples of which *kept*, bool[m], is true."""
        heading = self.heading_rad
        return replace(
            self,
            t_s=self.t_s[kept],
            x_m=self.x_m[kept],
            y_m=self.y_m[kept],
            heading_rad=None if heading is None else heading[kept],
        )

    def said_again(self) -> NDArray[np.bool_]:
        """Tell, bool[m], which samples say the pose before them again, to the last digit."""
        same = (np.diff(self.x_m) == 0.0) & (np.diff(self.y_m) == 0.0)
        if self.heading_rad is not None:
            same &= np.diff(self.heading_rad) == 0.0
        return np.concatenate(([False], same))

    def mirrored(self) -> Reference:
        """Return the trajectory as axes of the other hand have it."""
        heading = self.heading_rad
        return replace(self, y_m=-self.y_m, heading_rad=None if heading is None else -heading)


@dataclass(frozen=True)
class FrameTimes:
    """When the frames of one message came, for the bus stage.

    Attributes:
        t_s: float64[f], reception stamps in the log's order (not sorted).
        counter: int64[f], the frame's tick counter unwrapped as far as it can be; -1 where the
            message has none.
        modulo: what the counter counts to, 0 without a counter.
        cycle_s: described cycle time.
        payload: uint64[f], the payload without counter and CRC, to tell repeated data.
    """

    t_s: Floats
    counter: Ints
    modulo: int
    cycle_s: float
    payload: NDArray[np.uint64]


@dataclass(frozen=True)
class Recording:
    """One log of the vehicle, with its reference if there is one.

    Attributes:
        name: the file's name, for messages.
        tick_period_s: described period of the ECU's clock tick.
        t_s: float64[n], time of each tick on the log's clock: the straight line (piecewise, where
            the ECU restarts) through the reception stamps, without their jitter.
        stamp_s: float64[n], the stamps as recorded (NaN: no frame).
        tick: int64[n], ticks of the ECU's clock since the first row, strictly ascending; rows of
            lost frames may be missing.
        left_ticks, right_ticks: float64[n], unwrapped counts, the first valid one being 0.
        gyro_code: float64[n], raw codes (whole numbers), or None; for a log with physical rates the
            code they would have by the description, not rounded.
        gyro_rate_rad_s: float64[n], (code - zero rate code)/sensitivity by the description, the
            sample for (t_{k-1}, t_k]; or None.
        temperature_k, supply_v: float64[n] held between their frames, or None.
        v_command_m_s, w_command_rad_s: float64[n], the command in force from t_k on (zero-order
            hold of the frames received until then), or None.
        odometry_x_m, odometry_y_m, odometry_heading_rad: float64[n] (heading unwrapped), or None.
        frames: per message name, the reception stamps of its frames; empty for tables.
        own_names: what the log's bus calls the messages with wheels and gyro that Chiplog calls
            ENCODER and IMU; empty where both are in one message, and for tables until they are
            diagnosed.
        rejected: frames that failed a check, by reason.
        counter_bits: width at which the counts were unwrapped.
        counts_per_step: by how many counts the reading of each wheel steps, left and right: more
            than one where a wrong unit is undone.
        reference: measured from outside, or None.
        clock_skew, clock_skew_sd: ECU clock rate over log clock rate - 1 from stamps against ticks,
            and its standard deviation (NaN where the log does not tell).
        speed_cycle_s: how often wheels say their speed, where they say no way: a speed may be one
            of the moment, or a mean since the one before; 0 where counts are recorded.
        unsure_ticks2: float64[2, n], variance of the step of each wheel to each row, where ways
            were added up from speeds; None where counts were recorded, or speeds that are their
            differences.
        half_row_ticks: float64[2, n], what each wheel's count has more where its speeds are means
            since the row before, not of the moment; None where that is no question, or answered.
        stamps_late_s: by how much the stamps of a table's rows were taken to be late on average,
            because they jitter: so much it may be off itself.
        stamped_by_host: the rows are a table's that has no clock of the ECU: what stands in one was
            read at some time before or after its stamp.
        notes: what was read otherwise than it may be meant, each a sentence.
        doubts: where the log and the robot's description contradict each other, and which was
            believed, each a sentence.
        granted: effects that are known of the robot beside its description.
    """

    name: str
    tick_period_s: float
    t_s: Floats
    stamp_s: Floats
    tick: Ints
    left_ticks: Floats
    right_ticks: Floats
    gyro_code: Floats | None = None
    gyro_rate_rad_s: Floats | None = None
    temperature_k: Floats | None = None
    supply_v: Floats | None = None
    v_command_m_s: Floats | None = None
    w_command_rad_s: Floats | None = None
    odometry_x_m: Floats | None = None
    odometry_y_m: Floats | None = None
    odometry_heading_rad: Floats | None = None
    frames: Mapping[str, FrameTimes] = field(default_factory=dict)
    own_names: Mapping[str, str] = field(default_factory=dict)
    rejected: Mapping[str, int] = field(default_factory=dict)
    counter_bits: int = 16
    counts_per_step: tuple[float, float] = (1.0, 1.0)
    reference: Reference | None = None
    clock_skew: float = float("nan")
    clock_skew_sd: float = float("nan")
    speed_cycle_s: float = 0.0
    unsure_ticks2: Floats | None = None
    half_row_ticks: Floats | None = None
    stamps_late_s: float = 0.0
    stamped_by_host: bool = False
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    granted: Granted = NOTHING

    @cached_property
    def told(self) -> dict[object, tuple[object, Any]]:
        """What was told of the log so far, by what told it, with the robot it was told of."""
        return {}

    @property
    def tick_s(self) -> float:
        """How long a tick lasts on the log's clock."""
        skew = self.clock_skew if math.isfinite(self.clock_skew) else 0.0
        return self.tick_period_s / (1.0 + skew)

    @property
    def duration_s(self) -> float:
        """From the first tick to the last."""
        return float(self.t_s[-1] - self.t_s[0])
