"""A firmware of your own, in Python: dead reckoning from the wheels alone.

Anything with ``step(now_us, frames) -> frames`` will do. This one checks what it receives with
chiplog's own FrameChecker; every number of the frames comes from the DBC, every measure of the
robot from robot.toml.
"""

import math
from collections.abc import Sequence

import can

from can_bus import COUNTER_MODULO, FrameChecker, make_message, protect
from hil_harness.devices import DeviceSetup


class WheelOdometry:
    """Integrates the encoders at the midpoint of each step and sends the pose every tick."""

    def __init__(self, setup: DeviceSetup) -> None:
        """Take layout and measures from the run that this node is created for."""
        assert setup.database is not None
        assert setup.robot is not None
        wheels, encoder = setup.robot.plant.wheels, setup.robot.plant.encoder
        self._metres_per_tick = math.tau * wheels.radius_m / encoder.ticks_per_rev
        self._wheelbase_m = wheels.wheelbase_m
        self._wrap = 1 << encoder.counter_bits
        self._tick = -1
        self._database = setup.database
        self._checker = FrameChecker(
            self._database, ["ENCODER"], max_age_us=2 * setup.tick_period_us
        )
        self._last: tuple[int, int] | None = None
        self.x_m = self.y_m = self.heading_rad = 0.0

    def step(self, now_us: int, frames: Sequence[can.Message]) -> list[can.Message]:
        """Take the encoder frame of this tick, if a good one came, and tell the pose."""
        self._tick += 1
        for frame in frames:
            accepted = self._checker.check(frame, now_us)
            if accepted is not None and accepted.is_trusted and not accepted.invalid:
                self._move(int(accepted.raw["left_count"]), int(accepted.raw["right_count"]))
        if self._last is None:
            return []
        return [
            self._frame("ODOMETRY_X", "x_m", self.x_m, now_us),
            self._frame("ODOMETRY_Y", "y_m", self.y_m, now_us),
            self._frame("ODOMETRY_HEADING", "heading_turn", self._heading_turn(), now_us),
        ]

    def _move(self, left_count: int, right_count: int) -> None:
        if self._last is not None:
            left_m = self._ticks(self._last[0], left_count) * self._metres_per_tick
            right_m = self._ticks(self._last[1], right_count) * self._metres_per_tick
            distance_m = (left_m + right_m) / 2
            turn_rad = (right_m - left_m) / self._wheelbase_m
            self.x_m += distance_m * math.cos(self.heading_rad + turn_rad / 2)
            self.y_m += distance_m * math.sin(self.heading_rad + turn_rad / 2)
            self.heading_rad += turn_rad
        self._last = (left_count, right_count)

    def _ticks(self, before: int, now: int) -> int:
        """Return the signed difference of two counters that wrap."""
        half = self._wrap // 2
        return (now - before + half) % self._wrap - half

    def _heading_turn(self) -> float:
        """Return the heading in turns, -0.5 included, 0.5 not."""
        spec = self._database.message("ODOMETRY_HEADING").signal("heading_turn")
        raw = round(self.heading_rad / math.tau / spec.factor)
        turn = round(1 / spec.factor)
        return ((raw + turn // 2) % turn - turn // 2) * spec.factor

    def _frame(self, message: str, signal: str, value: float, now_us: int) -> can.Message:
        spec = self._database.message(message)
        data = spec.encode_scaled({signal: value})
        protect(spec, data, self._tick % COUNTER_MODULO)
        return make_message(spec, data, now_us)
