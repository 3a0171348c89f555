"""Whether each word can overflow: a proof, or a drive that does it, run through the kernel."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from typing import Any, Literal

from firmware_model import Kernel, KernelConfig
from firmware_model.integers import SATURATE
from precision_study.ranges.bounds import intermediates
from precision_study.ranges.drives import drives, straight
from precision_study.ranges.envelope import Envelope
from precision_study.ranges.intermediate import Intermediate
from precision_study.ranges.stretches import Drive, drive_chunks, until

Verdict = Literal["impossible", "overflows", "overflows later", "not provoked"]
_WIDEST = (1 << 63) - 1
_LONGEST_TICKS = 1 << 28
"""A minute of the kernel."""


@dataclass(frozen=True)
class Finding:
    """What is known of one intermediate.

    Attributes:
        intermediate: the value and its proved bound.
        verdict: overflow is impossible; or `drive` overflows the word at tick `tick`, as the kernel
            confirms; or does so later, in a drive that lasts or goes farther than the mission, the
            bound of which is beyond the word too; or neither proof nor drive was found.
        drive: from power-on, with counters at zero; None for a proof.
        tick: the first tick (from 0) in which the word has overflowed.
    """

    intermediate: Intermediate
    verdict: Verdict
    drive: Drive | None = None
    tick: int | None = None


def find_ranges(config: KernelConfig, envelope: Envelope) -> list[Finding]:
    """Return what is known of every intermediate.

    *config* may come from ``build_config(…, allow_overflow=True)``: 64-bit registers are proved
    there in any case.
    """
    return [_finding(config, envelope, one) for one in intermediates(config, envelope)]


def to_json(config: KernelConfig, envelope: Envelope, findings: Sequence[Finding]) -> Any:
    """Return the findings as plain data."""
    rows = []
    for one in findings:
        value = one.intermediate
        rows.append(
            {
                "name": value.name,
                "field": value.field,
                "unit": value.unit,
                "frac_bits": value.frac_bits,
                "word_bits": value.word_bits,
                "bound": value.bound / 2.0**value.frac_bits,
                "low_q": str(value.low),
                "high_q": str(value.high),
                "is_signed": value.is_signed,
                "least_word_bits": value.least_word_bits,
                "verdict": one.verdict,
                "tick": one.tick,
                "drive": None if one.drive is None else [asdict(part) for part in one.drive],
            }
        )
    seconds = envelope.mission_ticks * config.constants.tick_period_s
    asked = {
        name: float(value) if isinstance(value, Fraction) else value
        for name, value in asdict(envelope).items()
    } | {"mission_s": seconds}
    return {"schema": 2, "envelope": asked, "intermediates": rows}


def _finding(config: KernelConfig, envelope: Envelope, value: Intermediate) -> Finding:
    if value.is_proved:
        return Finding(value, "impossible")
    found = _shown(config, value, "overflows", drives(config, envelope, value))
    if value.word == "position" and found is None:  # it grows as long as the robot drives
        later = _later(config, envelope, value)
        found = _shown(config, value, "overflows later", later)
    return found or Finding(value, "not provoked")


def _later(config: KernelConfig, envelope: Envelope, value: Intermediate) -> Iterator[Drive]:
    """Yield drives of twice the mission, then that of the mission that goes farthest, for longer.

    It goes on as it ends until the word is full, and half as long again. The last goes straight on.
    """
    yield from drives(config, envelope.twice_as_long(), value)
    farthest = max(
        drives(config, envelope, value), key=lambda drive: _end(config, drive), default=()
    )
    reached = _end(config, farthest) if farthest else 0
    if reached > 0:
        *before, last = farthest
        ticks = last.ticks * 3 * (config.position_high_q + 1) // (2 * reached)
        if ticks <= _LONGEST_TICKS:
            yield (*before, replace(last, ticks=ticks))
    yield from straight(config, envelope, _LONGEST_TICKS)


def _end(config: KernelConfig, drive: Drive) -> int:
    """Return how far x or y is from the start at the end of a drive [2^-P m]."""
    kernel = Kernel(_with_wide_position(config))
    for chunk in drive_chunks(drive):
        kernel.run(chunk)
    return max(abs(one) for one in kernel.pose_q[:2])


def _with_wide_position(config: KernelConfig) -> KernelConfig:
    return replace(
        config,
        position_low_q=-_WIDEST - 1,
        position_high_q=_WIDEST,
        position_overflow=SATURATE,
    )


def _shown(
    config: KernelConfig, value: Intermediate, verdict: Verdict, tried: Iterator[Drive]
) -> Finding | None:
    """Return the first drive that overflows a word, until then; None where none does."""
    for drive in tried:
        tick = first_overflow(config, value, drive)
        if tick is not None:
            return Finding(value, verdict, until(drive, tick), tick)
    return None


def first_overflow(config: KernelConfig, value: Intermediate, drive: Drive) -> int | None:
    """Return the first tick in which the kernel's own word has overflowed, or None.

    The position is run in the widest word and held against the limits of its own: a step that
    overflows in the same drive is not mistaken for it. A drive for another word can overflow only
    that one and the position, whose word is then out of the way as well.
    """
    kernel = Kernel(_with_wide_position(config))
    has_overflowed = _test(kernel, config, value)
    tick = 0
    for chunk in drive_chunks(drive):
        before = kernel.state()
        kernel.run(chunk)
        if not has_overflowed():
            tick += len(chunk)
            continue
        low, high = 1, len(chunk)  # once overflowed, a word stays beyond in these drives
        while low < high:
            middle = (low + high) // 2
            kernel.load_state(before)
            kernel.run(chunk[:middle])
            low, high = (low, middle) if has_overflowed() else (middle + 1, high)
        return tick + low - 1
    return None


def _test(kernel: Kernel, config: KernelConfig, value: Intermediate) -> Callable[[], bool]:
    """Return what tells whether this word of the kernel has overflowed."""

    def position() -> bool:
        low, high = config.position_low_q, config.position_high_q
        for place_m_q in kernel.pose_q[:2]:
            if high == _WIDEST:
                if place_m_q in (-_WIDEST - 1, _WIDEST):
                    return True
            elif not low <= place_m_q <= high:
                return True
        return False

    def velocity() -> bool:
        found = kernel.v_m_s_q if value.name == "speed" else kernel.w_rad_s_q
        return found in (config.velocity_low_q, config.velocity_high_q)

    def counter() -> bool:  # in a drive whose right wheel goes forward
        return kernel.state()["right_step_ticks"] < 0

    def word() -> bool:
        return kernel.overflow_count > 0

    tests = {"counter": counter, "position": position, "velocity": velocity}
    return tests.get(value.word, word)
