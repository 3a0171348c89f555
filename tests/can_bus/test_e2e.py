"""End-to-end protection against an independent implementation and AUTOSAR's counter rule."""

from dataclasses import dataclass

import numpy as np
import pytest
from e2e.p01 import E2E_P01_DATAID_BOTH, e2e_p01_check, e2e_p01_protect
from hypothesis import given
from hypothesis import strategies as st

from can_bus import (
    CanBusError,
    CounterCheck,
    E2EProtection,
    E2EStatus,
    MessageSpec,
    crc8_profile1,
    crc8_profile1_array,
    load_database,
    protect,
)

DATABASE = load_database()
SPECS = list(DATABASE.messages.values())
each_spec = pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)

data_ids = st.integers(0, 0xFFFF)
frames = st.binary(min_size=2, max_size=64).map(bytearray)


@given(data_ids, frames)
def test_the_crc_is_that_of_the_independent_library(data_id: int, frame: bytearray) -> None:
    theirs = bytearray(frame)
    e2e_p01_protect(theirs, data_id, data_id_mode=E2E_P01_DATAID_BOTH, increment_counter=False)
    assert crc8_profile1(data_id, frame) == theirs[0]


@given(data_ids, st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=20))
def test_the_crc_of_a_column_is_that_of_each_frame(data_id: int, rows: list[bytes]) -> None:
    data = np.frombuffer(b"".join(rows), dtype=np.uint8).reshape(-1, 8)
    assert crc8_profile1_array(data_id, data).tolist() == [crc8_profile1(data_id, r) for r in rows]


@given(st.data())
def test_protected_frames_pass_the_independent_library(data: st.DataObject) -> None:
    spec = data.draw(st.sampled_from(SPECS))
    assert spec.e2e is not None
    frame = bytearray(data.draw(st.binary(min_size=8, max_size=8)))
    counter = data.draw(st.integers(0, 14))
    before = bytes(frame)
    protect(spec, frame, counter)
    assert e2e_p01_check(frame, spec.e2e.data_id)
    assert frame[1] & 0x0F == counter
    assert frame[1] & 0xF0 == before[1] & 0xF0
    assert frame[2:] == before[2:]


@each_spec
def test_the_counter_runs_as_the_independent_library_counts(spec: MessageSpec) -> None:
    assert spec.e2e is not None
    theirs = spec.pack([s.low_raw for s in spec.payload], counter=14)
    for tick in range(40):
        e2e_p01_protect(theirs, spec.e2e.data_id, increment_counter=True)
        assert spec.pack([s.low_raw for s in spec.payload], counter=tick % 15) == theirs


@each_spec
def test_every_flipped_bit_and_pair_of_bits_is_caught(spec: MessageSpec) -> None:
    assert spec.e2e is not None
    frame = int.from_bytes(spec.pack([s.low_raw for s in spec.payload], counter=5), "little")
    patterns = [1 << a | 1 << b for a in range(64) for b in range(a + 1)]
    damaged = np.array([frame ^ pattern for pattern in patterns], dtype="<u8")
    data = damaged.view(np.uint8).reshape(-1, 8)
    assert not np.any(crc8_profile1_array(spec.e2e.data_id, data) == data[:, 0])


@pytest.mark.parametrize("counter", [-1, 15, 16])
def test_a_counter_beyond_profile_1_raises(counter: int) -> None:
    spec = DATABASE.message("COMMAND")
    with pytest.raises(CanBusError, match=r"COMMAND: counter .*: Profile 1 counts from 0 to 14"):
        protect(spec, bytearray(8), counter)
    with pytest.raises(CanBusError, match=r"COMMAND: counter .*: Profile 1 counts from 0 to 14"):
        spec.pack([0, 0], counter)


def test_a_message_without_protection_takes_no_counter() -> None:
    spec = MessageSpec("PLAIN", 1, False, 8, {})
    with pytest.raises(CanBusError, match="PLAIN has no E2E protection: it takes no counter"):
        protect(spec, bytearray(8), 0)
    with pytest.raises(CanBusError, match="PLAIN has no E2E protection"):
        spec.pack([], 0)


def test_a_protection_of_another_profile_is_refused_by_name() -> None:
    spec = MessageSpec("OTHER", 1, False, 8, {}, e2e=E2EProtection("P05", 1, "", ""))
    with pytest.raises(CanBusError, match=r"OTHER: E2EProfile 'P05' cannot be computed here"):
        protect(spec, bytearray(8), 0)


def test_a_frame_of_wrong_length_cannot_be_protected() -> None:
    with pytest.raises(CanBusError, match="COMMAND: a frame of 3 bytes, not 8"):
        protect(DATABASE.message("COMMAND"), bytearray(3), 0)


# --- the counter rule -------------------------------------------------------------------------


@dataclass
class Autosar:
    """E2E_P01Check's counter part as the standard's flow chart has it, one call per cycle."""

    max_delta_init: int
    max_no_new: int
    sync_init: int
    last_valid: int = 0
    max_delta: int = 0
    no_new: int = 0
    sync: int = 0
    waiting: bool = True

    def call(self, counter: int | None) -> str:
        if self.max_delta < 14:
            self.max_delta += 1
        if counter is None:
            if self.no_new < 14:
                self.no_new += 1
            return "NONEWDATA"
        if self.waiting:
            self.waiting = False
            self.max_delta = self.max_delta_init
            self.last_valid = counter
            return "INITIAL"
        if counter >= self.last_valid:
            delta = counter - self.last_valid
        else:
            delta = 15 + counter - self.last_valid
        if delta == 0:
            if self.no_new < 14:
                self.no_new += 1
            return "REPEATED"
        if delta > self.max_delta:
            self.no_new = 0
            self.sync = self.sync_init
            if self.sync > 0:
                self.max_delta = self.max_delta_init
                self.last_valid = counter
            return "WRONGSEQUENCE"
        self.max_delta = self.max_delta_init
        self.last_valid = counter
        if self.no_new <= self.max_no_new:
            self.no_new = 0
            if self.sync > 0:
                self.sync -= 1
                return "SYNC"
            return "OK" if delta == 1 else "OKSOMELOST"
        self.no_new = 0
        self.sync = self.sync_init
        return "SYNC"


@given(
    st.integers(0, 13),
    st.integers(0, 14),
    st.integers(0, 3),
    st.lists(st.one_of(st.none(), st.integers(0, 14)), max_size=60),
)
def test_the_counter_rule_is_that_of_autosar(
    max_delta: int, max_no_new: int, sync: int, receptions: list[int | None]
) -> None:
    ours = CounterCheck(E2EProtection("P01_1A", 0, "", "", max_delta, max_no_new, sync))
    theirs = Autosar(max_delta, max_no_new, sync)
    missed = 0
    has_started = False
    for counter in receptions:
        if counter is None and not has_started:
            continue  # AUTOSAR counts cycles before the first frame; the first frame resets them
        expected = theirs.call(counter)
        if counter is None:
            missed += 1
            continue
        has_started = True
        ours.pass_cycles(missed)
        missed = 0
        assert ours.check(counter).name == expected


@pytest.mark.parametrize("lost", range(14))
def test_after_up_to_thirteen_lost_frames_the_next_one_is_accepted(lost: int) -> None:
    check = shipped_check()
    check.check(0)
    check.pass_cycles(lost)
    assert check.check((1 + lost) % 15) is (E2EStatus.OKSOMELOST if lost else E2EStatus.OK)


def test_a_jump_of_the_sender_is_believed_after_one_round_at_most() -> None:
    for jump in range(1, 15):
        check = shipped_check()
        check.check(0)
        refused = 0
        while not check.check((1 + jump + refused) % 15).is_accepted:
            refused += 1
        assert refused < 15
        assert check.check((2 + jump + refused) % 15) is E2EStatus.OK


def test_with_synchronisation_a_jump_is_believed_after_so_many_frames() -> None:
    check = CounterCheck(E2EProtection("P01_1A", 0, "", "", 1, 14, 2))
    statuses = [check.check(counter) for counter in (0, 1, 9, 10, 11, 12)]
    assert [status.name for status in statuses] == [
        "INITIAL",
        "OK",
        "WRONGSEQUENCE",
        "SYNC",
        "SYNC",
        "OK",
    ]


def test_a_late_old_frame_does_not_disturb_the_sequence() -> None:
    check = shipped_check()
    statuses = [check.check(counter) for counter in (3, 4, 6, 5, 7, 8)]
    assert [status.name for status in statuses] == [
        "INITIAL",
        "OK",
        "OKSOMELOST",
        "WRONGSEQUENCE",
        "OK",
        "OK",
    ]


def test_counter_fifteen_is_never_believed() -> None:
    check = shipped_check()
    assert check.check(15) is E2EStatus.WRONGSEQUENCE
    assert check.check(3) is E2EStatus.INITIAL
    assert check.check(15) is E2EStatus.WRONGSEQUENCE
    assert check.check(4) is E2EStatus.OK


def shipped_check() -> CounterCheck:
    protection = DATABASE.message("ENCODER").e2e
    assert protection is not None
    return CounterCheck(protection)
