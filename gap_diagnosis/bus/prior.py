"""How often and how large bus effects may be: numbers only.

Each pair is a log-uniform range. `*_PRESENT` is the range of an effect, `*_USUAL` what every bus
may do without being news.
"""

from __future__ import annotations

from typing import Final

LOSS_PRESENT: Final = (1e-4, 0.4)
LOSS_USUAL: Final = (1e-7, 1e-4)
BURST: Final = (1.0, 20.0)
"""Mean number of frames lost in a row."""

DUPLICATION_PRESENT: Final = (3e-5, 0.4)
REORDERING_PRESENT: Final = (3e-5, 0.4)
STALE_PRESENT: Final = (3e-5, 0.1)
RARE_USUAL: Final = (1e-8, 3e-5)

JITTER_PRESENT_S: Final = (0.4e-3, 50e-3)
JITTER_USUAL_S: Final = (0.5e-6, 0.4e-3)
"""A frame waits for a longer one and for interrupts: up to 0.2 ms; twice that is news."""

SKEW_TOLERANCE: Final = 1e-4
SKEW_HIGH: Final = 0.03
"""A crystal is within 50 ppm, an RC oscillator within 1 to 3 %, a Kobuki 1,000 to 1,320 ppm off."""

LATENCY_TOLERANCE_S: Final = 2e-3
LATENCY_HIGH_S: Final = 0.2
LATENCY_USUAL_S: Final = 1e-3
"""Frames of one tick queue behind each other."""

POLL_PERIOD_S: Final = (0.5e-3, 50e-3)

MOST_INDEPENDENT: Final = 400
"""Stamps are late together: a log says no more of its jitter than so many stamps on their own."""
