"""Stage setup: mistakes of whoever connected things. Gross, and exact."""

from __future__ import annotations

from typing import Final

from hil_harness.effects.model import Effect, EffectParameter, Settings, Values
from hil_harness.effects.setup_mistakes import SIGN_SIGNALS, UNIT_SIGNALS

_NO_SIGNAL: Final = "none"


def _swapped(settings: Settings, values: Values) -> Settings:
    return settings.with_setup(wheels_swapped=1)


def _sign(settings: Settings, values: Values) -> Settings:
    signal = values["signal"]
    return settings.with_setup(flipped="" if signal == _NO_SIGNAL else signal)


def _unit(settings: Settings, values: Values) -> Settings:
    return settings.with_setup(unit_signal=values["signal"], unit_factor=values["factor"])


EFFECTS: Final[tuple[Effect, ...]] = (
    Effect(
        "setup_wheels_swapped",
        "setup",
        (),
        "Left and right are exchanged: encoder heading has the wrong sign, distances are right.",
        _swapped,
    ),
    Effect(
        "setup_sign",
        "setup",
        (
            EffectParameter(
                "signal",
                "",
                _NO_SIGNAL,
                "the signal whose sign is flipped; reference: its y and heading, as in axes "
                "of the other hand (north, east, down); reference_position: its y alone, as where "
                "x and y are exchanged",
                kind="choice",
                choices=(_NO_SIGNAL, *SIGN_SIGNALS),
            ),
        ),
        "One signal is the mirror image of what it should be.",
        _sign,
    ),
    Effect(
        "setup_unit",
        "setup",
        (
            EffectParameter(
                "signal",
                "",
                UNIT_SIGNALS[0],
                "the signal in the wrong unit; ticks: both wheels",
                kind="choice",
                choices=UNIT_SIGNALS,
            ),
            EffectParameter(
                "factor",
                "1",
                1.0,
                "it reads so many times what it should: 2, 4, 10, 256, 1000, 180/π and inverses, "
                "ways 100 too, speeds 3.6",
                minimum=1e-6,
                maximum=1e6,
            ),
        ),
        "One signal is an exact multiple of what it should be.",
        _unit,
    ),
)
