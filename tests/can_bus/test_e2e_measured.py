"""What end-to-end protection catches, counted: bits, bursts, and each fault of communication."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import can
import numpy as np
import pytest
from numpy.typing import NDArray

from can_bus import (
    CanBusError,
    E2EState,
    E2EStateMachine,
    E2EStatus,
    FrameChecker,
    MessageSpec,
    ProfileStatus,
    StateLimits,
    crc8_profile1_array,
    load_database,
    make_message,
)

DATABASE = load_database()
SPECS = list(DATABASE.messages.values())
ENCODER = DATABASE.message("ENCODER")
TICK_US = ENCODER.cycle_time_us or 0
FRAME_BITS = 64
PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "e2e.md"

LONGEST_BURST = {"small": 16, "full": 20}


# --- damage -----------------------------------------------------------------------------------


def missed(patterns: NDArray[np.uint64]) -> int:
    """Return how many error patterns change a frame and leave its CRC right.

    The CRC is linear: whether a pattern is seen depends on the pattern alone, so that frame, data
    ID and counter do not matter. Bit 63 is the first on the wire.
    """
    data = patterns.astype(">u8").view(np.uint8).reshape(-1, 8)
    return int(np.count_nonzero(crc8_profile1_array(0, data) == data[:, 0]))


def bursts(length: int) -> NDArray[np.uint64]:
    """Return all bursts of exactly this length: first and last bit wrong, any between."""
    inner = np.arange(1 << max(length - 2, 0), dtype=np.uint64) << np.uint64(1)
    edges = np.uint64(1 << (length - 1) | 1)
    places = np.arange(FRAME_BITS - length + 1, dtype=np.uint64)
    return ((inner | edges)[:, None] << places[None, :]).ravel()


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_whether_damage_is_seen_depends_on_the_damage_alone(spec: MessageSpec) -> None:
    assert spec.e2e is not None
    frame = np.frombuffer(spec.pack([s.low_raw for s in spec.payload], 7), dtype=np.uint8)
    patterns = bursts(9).astype(">u8").view(np.uint8).reshape(-1, 8)
    damaged = frame ^ patterns
    seen = crc8_profile1_array(spec.e2e.data_id, damaged) != damaged[:, 0]
    assert np.count_nonzero(~seen) == missed(bursts(9))


def test_every_error_of_one_and_two_bits_is_caught() -> None:
    ones = [1 << place for place in range(FRAME_BITS)]
    twos = [a | b for a, b in itertools.combinations(ones, 2)]
    assert missed(np.array(ones + twos, dtype=np.uint64)) == 0


@pytest.mark.parametrize("length", range(1, 8))
def test_every_burst_of_up_to_seven_bits_is_caught(length: int) -> None:
    assert missed(bursts(length)) == 0


def test_of_longer_bursts_exactly_so_many_are_missed_as_the_page_says(size: str) -> None:
    rows = re.findall(r"^\| (\d+) \| ([\d,]+) \| ([\d,]+) \|", PAGE.read_text("utf-8"), re.M)
    told = {int(n): (int(a.replace(",", "")), int(m.replace(",", ""))) for n, a, m in rows}
    assert sorted(told) == list(range(8, LONGEST_BURST["full"] + 1))
    for length in range(8, LONGEST_BURST[size] + 1):
        patterns = bursts(length)
        assert told[length] == (len(patterns), missed(patterns))
        # A code of eight bits misses 1 in 128 of the bursts one bit longer, 1 in 256 of the rest.
        assert told[length][1] / told[length][0] <= 1 / 128


def missed_by_rank(length: int) -> int:
    """Return how many bursts of a length are missed, by linear algebra over single bits."""
    ones = (np.uint64(1) << np.arange(FRAME_BITS, dtype=np.uint64)).astype(">u8")
    data = ones.view(np.uint8).reshape(-1, 8)
    syndromes = [int(one) for one in crc8_profile1_array(0, data) ^ data[:, 0]]
    total = 0
    for place in range(FRAME_BITS - length + 1):
        left = syndromes[place] ^ syndromes[place + length - 1]
        basis: list[int] = []
        for syndrome in syndromes[place + 1 : place + length - 1]:
            rest = reduced(syndrome, basis)
            if rest:
                basis = sorted([*basis, rest], reverse=True)
        total += 0 if reduced(left, basis) else 2 ** (length - 2 - len(basis))
    return total


def reduced(syndrome: int, basis: list[int]) -> int:
    """Return what is left of a syndrome, modulo sums of a basis of distinct leading bits."""
    for one in basis:
        syndrome = min(syndrome, syndrome ^ one)
    return syndrome


def test_counting_by_rank_agrees_with_counting_one_by_one() -> None:
    assert [missed_by_rank(n) for n in range(8, 14)] == [missed(bursts(n)) for n in range(8, 14)]


@pytest.mark.parametrize("length", range(16, FRAME_BITS + 1))
def test_of_the_longest_bursts_one_in_256_is_missed(length: int) -> None:
    assert missed_by_rank(length) == (FRAME_BITS + 1 - length) * 2 ** (length - 10)


# --- faults of communication ------------------------------------------------------------------


class Receiver:
    """A checker that hears one message, and what it made of each frame."""

    def __init__(self) -> None:
        self.checker = FrameChecker(DATABASE, ["ENCODER"], max_age_us=2 * TICK_US)
        self.results: list[tuple[str, str]] = []
        self.is_trusted = False

    def hear(self, message: can.Message, now_us: int) -> bool:
        accepted = self.checker.check(message, now_us)
        self.is_trusted = accepted is not None and accepted.is_trusted
        status, state = self.checker.e2e("ENCODER")
        self.results.append((status.name, state.name))
        return accepted is not None

    @property
    def statuses(self) -> list[str]:
        return [status for status, _ in self.results]


def frame(tick: int, left: int = 0) -> can.Message:
    return make_message(ENCODER, ENCODER.pack((left, 0), tick % 15), tick * TICK_US)


def heard(ticks: list[int], times: list[int] | None = None) -> Receiver:
    """Return a receiver that heard the frames of these ticks, at these ticks."""
    receiver = Receiver()
    for tick, time in zip(ticks, times or ticks, strict=True):
        message = frame(tick)
        message.timestamp = time * TICK_US * 1e-6
        receiver.hear(message, time * TICK_US)
    return receiver


def test_good_frames_are_ok_and_make_the_stream_valid() -> None:
    receiver = heard([0, 1, 2, 3])
    assert receiver.results == [("OK", "INIT"), ("OK", "VALID"), ("OK", "VALID"), ("OK", "VALID")]


@pytest.mark.parametrize("lost", range(1, 14))
def test_loss_is_told_and_the_next_frame_used(lost: int) -> None:
    receiver = heard([0, 1, 2, 3 + lost])
    assert receiver.statuses[-1] == "OKSOMELOST"
    assert receiver.checker.rejected["counter"] == 0


def test_fifteen_frames_lost_look_like_none_but_for_the_silence() -> None:
    """What the counter cannot tell, the cycles without data do: the state is not valid any more."""
    receiver = heard([0, 1, 2, 3, 19])
    assert receiver.statuses[-1] == "OK"
    assert receiver.results[-1][1] == "INVALID"
    assert not receiver.is_trusted


def test_repetition() -> None:
    receiver = heard([0, 1, 1, 2], [0, 1, 2, 3])
    assert receiver.statuses == ["OK", "OK", "REPEATED", "OK"]
    assert receiver.checker.rejected["counter"] == 1


def test_wrong_order() -> None:
    receiver = heard([0, 1, 3, 2, 4], [0, 1, 3, 3, 4])
    assert receiver.statuses == ["OK", "OK", "OKSOMELOST", "WRONGSEQUENCE", "OK"]


def test_of_fifteen_frames_inserted_two_pass() -> None:
    """A stranger who knows the data ID: seen unless it has the next counter or the one after."""
    believed = []
    for step in range(15):
        receiver = heard([0, 1, 2, 3, 4, 5])
        stranger = frame(6 + step)
        stranger.timestamp = 5.5 * TICK_US * 1e-6
        if receiver.hear(stranger, 5 * TICK_US + TICK_US // 2):
            believed.append(step)
    assert believed == [0, 1]


def test_a_frame_believed_in_place_of_the_true_one_makes_that_one_a_repetition() -> None:
    receiver = heard([0, 1, 2, 2], [0, 1, 1, 2])
    assert receiver.statuses[-1] == "REPEATED"


def test_delay() -> None:
    receiver = Receiver()
    assert receiver.hear(frame(0), 0)
    assert receiver.hear(frame(1), 3 * TICK_US)
    assert not receiver.hear(frame(2), 4 * TICK_US + 1)
    assert receiver.checker.rejected["age"] == 1


def test_masquerade_is_always_seen() -> None:
    """A frame under another identifier: two data IDs differ in the CRC by the same bits always."""
    payloads = np.random.default_rng(7).integers(0, 256, (50, 8), dtype=np.uint8)
    for own, other in itertools.permutations(SPECS, 2):
        assert own.e2e is not None
        assert other.e2e is not None
        difference = crc8_profile1_array(own.e2e.data_id, payloads) ^ crc8_profile1_array(
            other.e2e.data_id, payloads
        )
        assert len(set(difference.tolist())) == 1
        assert difference[0] != 0


def test_damage_is_an_error_and_too_much_of_it_makes_the_stream_invalid() -> None:
    receiver = heard([0, 1, 2, 3])
    for tick in range(4, 8):
        damaged = frame(tick)
        damaged.data[3] ^= 1
        assert not receiver.hear(damaged, tick * TICK_US)
    assert receiver.results[4:] == [
        ("ERROR", "VALID"),
        ("ERROR", "VALID"),
        ("ERROR", "INVALID"),
        ("ERROR", "INVALID"),
    ]
    for tick in range(8, 12):
        receiver.hear(frame(tick), tick * TICK_US)
    assert [state for _, state in receiver.results[8:]] == ["INVALID", "INVALID", "VALID", "VALID"]


def test_a_receiver_is_asked_only_about_what_it_hears() -> None:
    receiver = Receiver()
    assert receiver.checker.e2e("ENCODER") == (ProfileStatus.NOTAVAILABLE, E2EState.NODATA)
    with pytest.raises(CanBusError, match="does not accept 'IMU'"):
        receiver.checker.e2e("IMU")


# --- the state machine ------------------------------------------------------------------------


def states(*statuses: E2EStatus, limits: StateLimits | None = None) -> list[E2EState]:
    machine = E2EStateMachine(limits or StateLimits())
    return [machine.add(status) for status in statuses]


def test_nothing_and_damage_leave_no_data() -> None:
    found = states(E2EStatus.NONEWDATA, E2EStatus.WRONGCRC, E2EStatus.INITIAL, E2EStatus.OK)
    assert found == [E2EState.NODATA, E2EState.NODATA, E2EState.INIT, E2EState.VALID]


def test_a_stream_that_begins_with_damage_is_invalid_until_it_has_left_the_window() -> None:
    first = [E2EStatus.INITIAL, E2EStatus.WRONGCRC, E2EStatus.WRONGCRC]
    found = states(*first, *[E2EStatus.OK] * 4, limits=StateLimits(min_ok_init=2))
    assert [state.name for state in found] == [
        *("INIT", "INIT", "INVALID", "INVALID", "INVALID", "VALID", "VALID"),
    ]


def test_silence_longer_than_the_window_makes_a_stream_invalid() -> None:
    machine = E2EStateMachine()
    for _ in range(6):
        machine.add(E2EStatus.OK)
    after = []
    for cycles in (3, 10**9):  # however long
        machine.pass_cycles(cycles)
        after.append(machine.state)
    assert after == [E2EState.VALID, E2EState.INVALID]


@pytest.mark.parametrize("limits", [{"window": 0}, {"min_ok_init": 9}, {"max_error_valid": 0}])
def test_limits_that_the_standard_does_not_allow_raise(limits: dict[str, int]) -> None:
    with pytest.raises(CanBusError, match="E2E state machine"):
        StateLimits(**limits)
