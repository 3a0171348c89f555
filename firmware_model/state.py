"""Everything the kernel remembers, and the words it uses: status bits, validities, sources."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum, IntFlag
from typing import Final

import numpy as np

FRESH: Final = 0
"""Validity of an input: a sample of this tick, checked and believed."""
STALE: Final = 1
"""Validity of an input: no new sample has arrived; the value handed in is not looked at."""
INVALID: Final = 2
"""Validity of an input: the sender says that it has no value, or a check failed; not looked at."""


class StatusBit(IntFlag):
    """One bit of the status word; the three last are sticky until the kernel is restarted."""

    INITIALISED = 1 << 0
    """A first encoder sample has set the baseline; before it nothing moves."""
    STANDSTILL = 1 << 1
    """The wheels have not moved for a while and the gyro does not object: heading is held."""
    OFFSET_VALID = 1 << 2
    """The gyro's zero-rate offset in use was estimated, not assumed."""
    GYRO_STALE = 1 << 3
    GYRO_INVALID = 1 << 4
    GYRO_SATURATED = 1 << 5
    """The gyro's code is at or beyond the end of its range."""
    GYRO_STUCK = 1 << 6
    """The gyro's code has not changed while the wheels' turning has."""
    ENCODER_STALE = 1 << 7
    ENCODER_INVALID = 1 << 8
    ENCODER_JUMP = 1 << 9
    """The counters moved farther than the wheels can turn: refused."""
    WHEEL_FALLBACK = 1 << 10
    """The heading should come from the gyro and came from the wheels in this tick."""
    POSITION_HELD = 1 << 11
    """x and y were not updated in this tick."""
    POSITION_DEGRADED = 1 << 12
    """Some distance is missing from the position, for good (sticky)."""
    OVERFLOW = 1 << 13
    """A word has overflowed: wrapped or saturated as configured (sticky)."""
    ENCODER_LOSS = 1 << 14
    """The counters were re-based without knowing the distance between (sticky)."""


class HeadingSource(IntEnum):
    """What moved the heading in the present tick."""

    HELD = 0
    WHEELS = 1
    GYRO = 2
    BLEND = 3


class EncoderDecision(IntEnum):
    """What became of the encoder sample of the present tick."""

    NOT_USED = 0
    ACCEPTED = 1
    REBASED = 2


@dataclass(slots=True)
class State:
    """The kernel's state as plain integers; all zero at power-on but for the gyro offset.

    A name with ``_q`` counts in the fraction bits that the configuration states for it. The
    compiled kernel uses a NumPy record of the same field names (`STATE_DTYPE`).
    """

    # Pose.
    x_m_q: int = 0
    y_m_q: int = 0
    heading_turn_q: int = 0

    # Remainders carried from one narrowing to the next, in the fraction bits before it.
    x_remainder_q: int = 0
    y_remainder_q: int = 0
    heading_remainder_q: int = 0
    step_remainder_q: int = 0
    wheel_turn_remainder_q: int = 0
    gyro_turn_remainder_q: int = 0

    # Velocity: low-pass filters of step and turn, holding 2^filter_log2 times their output.
    v_filter_q: int = 0
    w_filter_q: int = 0
    v_is_valid: int = 0
    w_is_valid: int = 0

    # Headings before those of the last ticks, newest first; kept only where one of them is used.
    past_1_turn_q: int = 0
    past_2_turn_q: int = 0
    past_3_turn_q: int = 0

    # Decisions of the present tick; with the gap and the offset, all that the float twin needs.
    encoder_decision: int = 0
    heading_source: int = 0
    gyro_is_zeroed: int = 0
    left_step_ticks: int = 0
    right_step_ticks: int = 0
    gyro_code: int = 0
    cosine_q: int = 0
    sine_q: int = 0

    # Encoder: the last accepted counts, the time since, and a possible new baseline.
    is_initialised: int = 0
    left_count: int = 0
    right_count: int = 0
    gap_ticks: int = 0
    gap_turn_q: int = 0
    gap_misses_gyro: int = 0
    candidate_samples: int = 0
    candidate_left_count: int = 0
    candidate_right_count: int = 0
    candidate_age_ticks: int = 0

    # Gyro: the offset in use with the sum it came from, and the watch for a stuck code.
    gyro_offset_q: int = 0
    offset_is_valid: int = 0
    offset_sum: int = 0
    offset_samples_log2: int = 0
    repeated_code: int = -1
    repeated_ticks: int = 0
    turn_blocks: int = 0
    turn_block_ticks: int = 0
    turn_block_sum: int = 0
    turn_block_low: int = 0
    turn_block_high: int = 0

    # Standstill and the offset estimate that grows in it.
    still_ticks: int = 0
    still_left_ticks: int = 0
    still_right_ticks: int = 0
    rest_ticks: int = 0
    rest_samples: int = 0
    rest_sum: int = 0
    rest_next_log2: int = 0
    pending_sum: int = 0
    pending_samples_log2: int = 0
    pending_ticks: int = 0

    # Reports.
    status: int = 0
    overflow_count: int = 0
    tick: int = 0


STATE_FIELDS: Final[tuple[str, ...]] = tuple(field.name for field in fields(State))
"""Names of the state's fields, in the order of the compiled record."""

STATE_DTYPE: Final = np.dtype([(name, np.int64) for name in STATE_FIELDS])
"""The same state as a NumPy record, for compiled code and for batches."""
