"""How busy a bus is, from its database."""

from pathlib import Path

import pytest

from can_bus import CanBusError, load_database, parse_database, worst_length_bits
from can_bus.bus_load import bus_load

DBC = """VERSION ""
BU_: A
BO_ 256 SLOW: 8 A
 SG_ v : 0|8@1+ (1,0) [0|255] "" A
BO_ 16 FAST: 2 A
 SG_ v : 0|8@1+ (1,0) [0|255] "" A
BO_ 17 SOMETIMES: 2 A
 SG_ v : 0|8@1+ (1,0) [0|255] "" A
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 256 20;
BA_ "GenMsgCycleTime" BO_ 16 5;
"""


def test_load_and_response_by_hand() -> None:
    found = bus_load(parse_database(DBC, Path("hand.dbc")), 125_000)
    assert [one.spec.name for one in found.frames] == ["FAST", "SLOW"]
    # 75 and 135 bits with the intermission, 8 µs each.
    assert worst_length_bits(False, 2) + 3 == 75
    assert found.load == pytest.approx(75 * 8e-6 / 5e-3 + 135 * 8e-6 / 20e-3)
    fast, slow = (one.response for one in found.frames)
    assert fast.response_s == pytest.approx((135 + 75) * 8e-6)
    assert slow.response_s == pytest.approx((75 + 135) * 8e-6)
    assert found.not_cyclic == ("SOMETIMES",)


def test_jitter_makes_it_later() -> None:
    database = parse_database(DBC, Path("hand.dbc"))
    early, late = (bus_load(database, 125_000, jitter_us=jitter) for jitter in (0, 500))
    for before, after in zip(early.frames, late.frames, strict=True):
        assert before.response.response_s is not None
        assert after.response.response_s == pytest.approx(before.response.response_s + 500e-6)


def test_the_shipped_bus_has_room() -> None:
    found = bus_load(load_database())
    assert found.bitrate == 500_000
    assert found.load < 0.5
    assert all(one.response.response_s is not None for one in found.frames)


def test_without_a_bit_rate_or_a_cycle_there_is_nothing_to_say() -> None:
    with pytest.raises(CanBusError, match=r"hand.dbc names no Baudrate: expected --bitrate"):
        bus_load(parse_database(DBC, Path("hand.dbc")))
    silent = DBC.replace("BO_ 256 20;", "BO_ 256 0;").replace("BO_ 16 5;", "BO_ 16 0;")
    with pytest.raises(CanBusError, match="no classic CAN message has a cycle time"):
        bus_load(parse_database(silent, Path("silent.dbc")), 125_000)
