"""Which encoder samples are believed, and the way each wheel went since the last one.

The rule, complete:

1. A sample that is stale or invalid is not looked at. Before the first fresh one nothing moves;
   the first fresh one is the baseline.
2. The increment of a wheel is the difference of two counter readings modulo the counter's width,
   as a signed number. A gap is the number of ticks since the last accepted sample (1 as a rule).
3. The gap limit is the longest gap in which a wheel at its fastest believed speed stays within
   half the counter's range (and within the words of step and position). A fresh sample after a
   longer gap is a loss: the counters are re-based, ENCODER_LOSS and POSITION_DEGRADED stick,
   nothing moves.
4. Within the limit, increments of at most max_step_ticks · gap are accepted: the whole distance
   of the gap is applied in this tick. A larger one is refused: ENCODER_JUMP, nothing moves, and
   the gap goes on, so that a single wrong reading costs nothing.
5. Refused samples that are consistent with each other (each within max_step_ticks per tick of
   the one before) are counted; jump_confirm_samples of them are a new baseline, as a loss.
"""

from __future__ import annotations

from typing import Final

from firmware_model._source import kernel_function, rare_kernel_function
from firmware_model.config import KernelConfig
from firmware_model.integers import wrap_signed
from firmware_model.state import FRESH, STALE, EncoderDecision, State, StatusBit

NOT_USED: Final = int(EncoderDecision.NOT_USED)
ACCEPTED: Final = int(EncoderDecision.ACCEPTED)
REBASED: Final = int(EncoderDecision.REBASED)

_STALE: Final = int(StatusBit.ENCODER_STALE)
_INVALID: Final = int(StatusBit.ENCODER_INVALID)
_JUMP: Final = int(StatusBit.ENCODER_JUMP)
_LOSS: Final = int(StatusBit.ENCODER_LOSS) | int(StatusBit.POSITION_DEGRADED)


@kernel_function
def take_encoder(
    state: State, config: KernelConfig, left_count: int, right_count: int, validity: int
) -> None:
    """Decide on this tick's encoder sample; set the decision and both increments.

    Scaling and overflow: counts are reduced to the counter's width first. Gaps stop counting one
    tick beyond the limit, so max_step_ticks · gap stays below 2^33.
    """
    state.encoder_decision = NOT_USED
    state.left_step_ticks = 0
    state.right_step_ticks = 0
    if state.gap_ticks <= config.gap_limit_ticks:
        state.gap_ticks = state.gap_ticks + 1
    if state.candidate_samples > 0:
        state.candidate_age_ticks = state.candidate_age_ticks + 1
        if state.candidate_age_ticks > config.gap_limit_ticks:
            state.candidate_samples = 0
    if validity != FRESH:
        state.status |= _STALE if validity == STALE else _INVALID
        return

    mask = (1 << config.counter_bits) - 1
    left_count = left_count & mask
    right_count = right_count & mask
    if state.is_initialised == 0:
        state.is_initialised = 1
        rebase(state, left_count, right_count)
        return
    if state.gap_ticks > config.gap_limit_ticks:
        state.status |= _LOSS
        rebase(state, left_count, right_count)
        return

    left_step = wrap_signed(left_count - state.left_count, config.counter_bits)
    right_step = wrap_signed(right_count - state.right_count, config.counter_bits)
    believed = config.max_step_ticks * state.gap_ticks
    if -believed <= left_step <= believed and -believed <= right_step <= believed:
        state.encoder_decision = ACCEPTED
        state.left_step_ticks = left_step
        state.right_step_ticks = right_step
        state.left_count = left_count
        state.right_count = right_count
        state.candidate_samples = 0
        return

    state.status |= _JUMP
    consider_new_baseline(state, config, left_count, right_count)


@rare_kernel_function
def consider_new_baseline(
    state: State, config: KernelConfig, left_count: int, right_count: int
) -> None:
    """Count refused samples that agree with each other; re-base when there are enough.

    Scaling and overflow: as take_encoder.
    """
    left_step = wrap_signed(left_count - state.candidate_left_count, config.counter_bits)
    right_step = wrap_signed(right_count - state.candidate_right_count, config.counter_bits)
    believed = config.max_step_ticks * state.candidate_age_ticks
    agrees = -believed <= left_step <= believed and -believed <= right_step <= believed
    if state.candidate_samples > 0 and agrees:
        state.candidate_samples = state.candidate_samples + 1
    else:
        state.candidate_samples = 1
    state.candidate_left_count = left_count
    state.candidate_right_count = right_count
    state.candidate_age_ticks = 0
    if state.candidate_samples >= config.jump_confirm_samples:
        state.status |= _LOSS
        rebase(state, left_count, right_count)


@rare_kernel_function
def rebase(state: State, left_count: int, right_count: int) -> None:
    """Take the counts as the new baseline; nothing moves."""
    state.encoder_decision = REBASED
    state.left_count = left_count
    state.right_count = right_count
    state.candidate_samples = 0
