"""A scenario: what the robot is told to do, and which world it does it in."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from hil_harness.effects.model import EffectSetting
from hil_harness.errors import HarnessError
from hil_harness.scenarios.profile import FloatArray, Profile

Drive: TypeAlias = Literal["motor", "ideal"]
EncoderModel: TypeAlias = Literal["counter", "lesson_counter"]
Noise: TypeAlias = Literal["streams", "lesson"]


@dataclass(frozen=True)
class Scenario:
    """A drive and the world around it; immutable.

    Attributes:
        name: as ``--scenario`` takes it.
        description: one sentence for a table of scenarios.
        profile: speed and turn rate over time.
        duration_s: how long a run lasts unless told otherwise.
        drive: "motor" (wheel and motor dynamics) or "ideal" (the body follows at once).
        encoder_model: "counter" (real) or "lesson_counter" (the lesson's rounded increments).
        noise: "streams" (one per mechanism) or "lesson" (the lesson's own generator and order).
        effects: effects that belong to the scenario.
        seed: seed of the noise unless told otherwise.
        per_tick_commands: the plant is driven by the rate at the start of each tick; otherwise
            a command is sent as often as the DBC says and held in between.
    """

    name: str
    description: str
    profile: Profile
    duration_s: float
    drive: Drive = "motor"
    encoder_model: EncoderModel = "counter"
    noise: Noise = "streams"
    effects: tuple[EffectSetting, ...] = ()
    seed: int = 1
    per_tick_commands: bool = False

    def tick_count(self, tick_period_us: int) -> int:
        """Return how many ticks the scenario lasts."""
        return round(self.duration_s * 1e6) // tick_period_us

    def commands(self, tick_count: int, tick_period_us: int, *, hold_ticks: int = 1) -> FloatArray:
        """Return the commanded (v_m_s, w_rad_s) of each tick, float64[tick_count, 2].

        Row k drives from t_k to t_(k+1), with t_k = k·tick_period_us. A command is renewed every
        *hold_ticks* ticks and is the mean of the profile over the time it holds, so that distance
        and turn are those of the profile. With ``per_tick_commands`` it is the rate at t_k and
        *hold_ticks* has no say. After the end of its profile the robot rests.

        Raises HarnessError when an argument is not positive.
        """
        if tick_count < 0 or tick_period_us < 1 or hold_ticks < 1:
            raise HarnessError(
                f"commands for {tick_count} ticks of {tick_period_us} µs held {hold_ticks} ticks: "
                "expected a count from 0, a period from 1 and a hold from 1"
            )
        if self.per_tick_commands:
            return self.profile.rates(
                np.arange(tick_count, dtype=np.float64) * (tick_period_us / 1e6)
            )
        hold_s = hold_ticks * tick_period_us / 1e6
        hold_count = -(-tick_count // hold_ticks)
        travel = self.profile.travel(np.arange(hold_count + 1, dtype=np.float64) * hold_s)
        return np.repeat(np.diff(travel, axis=0) / hold_s, hold_ticks, axis=0)[:tick_count]
