"""Whether each word can overflow: a proof, or a drive that does it, run through the kernel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from firmware_model import FRESH, STALE, Kernel, KernelConfig
from firmware_model.config import MODE_WHEEL
from precision_study.ranges.bounds import Intermediate, intermediates
from precision_study.ranges.envelope import Envelope

Verdict = Literal["impossible", "overflows", "not provoked"]
_CHUNK: Final = 4096


@dataclass(frozen=True)
class Stretch:
    """So many equal ticks of a drive: what the counters gain in each, and what arrives.

    Attributes:
        ticks: how many.
        left_step, right_step: gain of each counter in each of them [encoder ticks].
        encoder_validity: FRESH or STALE.
        gyro_code: the gyro's code, always fresh [LSB].
    """

    ticks: int
    left_step: int
    right_step: int
    encoder_validity: int
    gyro_code: int


@dataclass(frozen=True)
class Finding:
    """What is known of one intermediate.

    Attributes:
        intermediate: the value and its proved bound.
        verdict: overflow is impossible; or `drive` overflows the word at tick `tick`, as the kernel
            confirms; or neither (the bound is beyond the word, by less than its slack).
        drive: from power-on, with counters at zero; None for a proof.
        tick: the first tick (from 0) in which the word has overflowed.
    """

    intermediate: Intermediate
    verdict: Verdict
    drive: tuple[Stretch, ...] | None = None
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
                "bound_q": str(value.bound),
                "least_word_bits": value.least_word_bits,
                "verdict": one.verdict,
                "tick": one.tick,
                "drive": None if one.drive is None else [asdict(part) for part in one.drive],
            }
        )
    seconds = envelope.mission_ticks * config.constants.tick_period_s
    asked = asdict(envelope) | {"mission_s": seconds}
    return {"schema": 1, "envelope": asked, "intermediates": rows}


def drive_inputs(drive: Sequence[Stretch]) -> NDArray[np.int64]:
    """Return a drive as int64[n, 5], the kernel's inputs; the first tick is the baseline."""
    parts = [np.array([[0, 0, FRESH, drive[0].gyro_code, FRESH]], dtype=np.int64)]
    left = right = 0
    for one in drive:
        part = np.zeros((one.ticks, 5), dtype=np.int64)
        steps = np.arange(1, one.ticks + 1)
        part[:, 0], part[:, 1] = left + one.left_step * steps, right + one.right_step * steps
        part[:, 2], part[:, 3] = one.encoder_validity, one.gyro_code
        left, right = left + one.left_step * one.ticks, right + one.right_step * one.ticks
        parts.append(part)
    return np.concatenate(parts)


def _finding(config: KernelConfig, envelope: Envelope, value: Intermediate) -> Finding:
    if value.is_proved:
        return Finding(value, "impossible")
    for drive in _drives(config, envelope, value):
        tick = first_overflow(config, value, drive)
        if tick is not None:
            return Finding(value, "overflows", drive, tick)
    return Finding(value, "not provoked")


def _drives(
    config: KernelConfig, envelope: Envelope, value: Intermediate
) -> list[tuple[Stretch, ...]]:
    """Return drives that go where the word is longest: on at top speed, or after a gap."""
    fastest, ticks = envelope.step_ticks, envelope.mission_ticks
    zero = min(
        max(round(config.constants.gyro_zero_rate_code), envelope.code_low), envelope.code_high
    )
    silent = envelope.gap_ticks - 1

    def straight(count: int, step: int = fastest) -> Stretch:
        return Stretch(count, step, step, FRESH, zero)

    def spin(count: int, sign: int, code: int) -> Stretch:
        return Stretch(count, -sign * fastest, sign * fastest, FRESH, code)

    low, high = envelope.code_low, envelope.code_high
    if value.word == "position":
        return [(straight(ticks),), (straight(ticks, -fastest),)]
    if value.word == "step":
        gap = Stretch(silent, fastest, fastest, STALE, zero)
        return [(straight(min(ticks, 64)),), (gap, straight(1))]
    if value.word == "turn_step":
        quiet = Stretch(silent, -fastest, fastest, STALE, zero)
        drives = [(spin(64, 1, zero),), (spin(64, -1, zero),), (quiet, spin(1, 1, zero))]
        if config.mode != MODE_WHEEL:
            drives += [(spin(64, 1, high),), (spin(64, -1, low),)]
        return drives
    settle = min(ticks, 64 << config.velocity_filter_log2)
    return [(straight(settle),), (spin(settle, 1, high),), (spin(settle, -1, low),)]


def first_overflow(
    config: KernelConfig, value: Intermediate, drive: Sequence[Stretch]
) -> int | None:
    """Return the first tick in which the kernel's own word has overflowed, or None.

    A drive straight on makes no turn and a spin no step; so that none of them is blamed for the
    position, its word is taken at 64 bits when another one is asked about.
    """
    if value.word != "position":
        widest = (1 << 63) - 1
        config = replace(config, position_low_q=-widest - 1, position_high_q=widest)
    kernel = Kernel(config)
    inputs = drive_inputs(drive)
    for start in range(0, len(inputs), _CHUNK):
        before = kernel.state()
        chunk = inputs[start : start + _CHUNK]
        if value.word != "velocity":
            kernel.run(chunk)
            if kernel.overflow_count == before["overflow_count"]:
                continue
            kernel.load_state(before)
        for place, given in enumerate(chunk.tolist()):
            kernel.step(*given)
            if _has_overflowed(kernel, value, drive[0].right_step):
                return start + place
    return None


def _has_overflowed(kernel: Kernel, value: Intermediate, direction: int) -> bool:
    """Tell whether this word has wrapped or has stopped at its limit, by what it holds."""
    config = kernel.config
    if value.word == "velocity":
        found = kernel.v_m_s_q if value.name == "speed" else kernel.w_rad_s_q
        return found in (config.velocity_low_q, config.velocity_high_q)
    if value.word == "position":
        x_m_q = kernel.pose_q[0]
        stopped = x_m_q in (config.position_low_q, config.position_high_q)
        return stopped or x_m_q * direction < 0
    return kernel.overflow_count > 0
