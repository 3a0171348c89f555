"""How often and how large bus effects may be; the numbers are in data/prior.toml."""

from __future__ import annotations

from typing import Final

from gap_diagnosis.priors import Range, default_prior

_PRIOR: Final = default_prior()


def present(effect: str, what: str = "probability") -> Range:
    """Return the range of an effect."""
    return _PRIOR.ranges[effect][what]


def usual(effect: str) -> Range:
    """Return the range of what every bus may do without being news."""
    return _PRIOR.ranges[effect]["usual"]


BURST: Final = present("frame_loss", "burst")
"""Mean number of frames lost in a row."""

JITTER_PRESENT_S: Final = present("frame_jitter", "sigma")
JITTER_USUAL_S: Final = usual("frame_jitter")
POLL_PERIOD_S: Final = present("reception_stamp", "period")

SKEW: Final = _PRIOR.of("clock_skew", "all")
"""A crystal is within 50 ppm, an RC oscillator within 1 to 3 %, a Kobuki 1,000 to 1,320 ppm off."""

LATENCY: Final = _PRIOR.of("frame_latency", "all")
LATENCY_USUAL_S: Final = _PRIOR.nuisances["frame_latency"].tolerance
