"""What is said of a real-time run whose other side was away for a while."""

from __future__ import annotations

from typing import TYPE_CHECKING

from chiplog.pages import quantities as q

if TYPE_CHECKING:
    from hil_harness.peers import Outage
    from hil_harness.results import Timing

_MOST_NAMED = 3


def outage_span(outage: Outage) -> str:
    """Return from when to when, in seconds since the run began."""
    if outage.stop_s is None:
        return f"from {outage.start_s:.2f} s to the end"
    return f"from {outage.start_s:.2f} s to {outage.stop_s:.2f} s"


def outage_clause(timing: Timing) -> str:
    """Return the rest of a sentence on timing: who was away and what was not sent (else "")."""
    words = [f"{one.node} out {outage_span(one)}" for one in timing.outages[:_MOST_NAMED]]
    if len(timing.outages) > _MOST_NAMED:
        words.append(f"{q.count(len(timing.outages) - _MOST_NAMED)} more outages")
    if timing.unsent_frames:
        words.append(f"{q.count(timing.unsent_frames)} frames not taken by the bus")
    return "".join(f"; {word}" for word in words)
