"""Reading a DBC file: the shipped one wherever it lies, foreign ones, and broken ones."""

from pathlib import Path

import pytest
from cantools.database import UnsupportedDatabaseFormatError  # type: ignore[attr-defined]
from hypothesis import example, given
from hypothesis import strategies as st

import can_bus
from can_bus import CanBusError, Database, load_database, parse_database, shipped_path

SHIPPED = shipped_path().read_text()

FOREIGN = """\
VERSION ""
NS_ :
BS_:
BU_: MOTOR PANEL
BO_ 2566844926 LONG_ID: 8 MOTOR
 SG_ speed : 7|16@0- (0.1,-40) [-40|6513.5] "rpm" PANEL
BO_ 256 UNTIMED: 2 Vector__XXX
 SG_ level : 0|16@1+ (1,0) [0|0] "" Vector__XXX
"""

PROTECTED = """\
BO_ 257 GUARDED: 8 MOTOR
 SG_ check : 7|8@0+ (1,0) [0|255] "" PANEL
 SG_ alive : 11|4@0+ (1,0) [0|14] "" PANEL
BA_DEF_ BO_ "E2EProfile" STRING ;
BA_DEF_ BO_ "E2EDataId" INT 0 65535;
BA_DEF_DEF_ "E2EProfile" "";
BA_DEF_DEF_ "E2EDataId" 0;
BA_ "E2EProfile" BO_ 257 "P01_1A";
BA_ "E2EDataId" BO_ 257 4711;
"""


def parse(text: str) -> Database:
    return parse_database(text, Path("mine.dbc"))


def test_the_shipped_database_is_found_in_a_checkout() -> None:
    assert load_database().path == Path(can_bus.__file__).parent.parent / "dbc" / "chiplog.dbc"


def test_the_shipped_database_is_found_inside_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As the wheel places it: the package's own folder comes first.
    inside = tmp_path / "can_bus" / "dbc" / "chiplog.dbc"
    inside.parent.mkdir(parents=True)
    inside.write_text(SHIPPED)
    monkeypatch.setattr("can_bus.database.files", lambda _: tmp_path / "can_bus")
    assert shipped_path() == inside


def test_a_missing_shipped_database_says_where_it_was_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("can_bus.database.files", lambda _: tmp_path / "can_bus")
    with pytest.raises(CanBusError, match=r"chiplog.dbc is missing: looked at .* and .*"):
        shipped_path()


def test_the_data_folder_is_no_python_package() -> None:
    assert not (shipped_path().parent / "__init__.py").exists()


def test_a_foreign_database_needs_no_attributes() -> None:
    database = parse(FOREIGN)
    assert database.bitrate is None
    long_id = database.message("LONG_ID")
    assert (long_id.frame_id, long_id.is_extended) == (0x18FEF1FE, True)
    assert long_id.e2e is None
    assert long_id.cycle_time_us is None
    assert long_id.start_delay_us == 0
    assert long_id.signal("speed").initial_raw == 0
    assert database.message("UNTIMED").senders == ()
    assert database.message("UNTIMED").receivers == ()


def test_messages_are_found_by_identifier_and_its_width() -> None:
    database = parse(FOREIGN)
    assert database.by_id(0x18FEF1FE, is_extended=True) is database.message("LONG_ID")
    assert database.by_id(256) is database.message("UNTIMED")
    assert database.by_id(256, is_extended=True) is None


def test_messages_are_found_by_sender() -> None:
    database = load_database()
    assert [m.name for m in database.sent_by("HOST")] == ["COMMAND"]
    assert {m.name for m in database.sent_by("HOST", "PLANT")} >= {"COMMAND", "ENCODER", "IMU"}
    assert database.senders() == ("ECU", "HOST", "PLANT")
    with pytest.raises(CanBusError, match=r"chiplog.dbc has no node 'PLAN': it has HOST, PLANT"):
        database.sent_by("PLAN")


def test_protection_is_found_by_position_in_either_byte_order() -> None:
    head, attributes = PROTECTED.split("BA_DEF_", 1)
    guarded = parse(FOREIGN + head + "BA_DEF_" + attributes).message("GUARDED")
    assert guarded.e2e is not None
    assert (guarded.e2e.crc_signal, guarded.e2e.counter_signal) == ("check", "alive")
    assert guarded.e2e.data_id == 4711


def test_a_protected_message_without_room_for_it_is_refused() -> None:
    text = FOREIGN + PROTECTED.replace("SG_ alive : 11|4", "SG_ alive : 15|4")
    with pytest.raises(
        CanBusError, match=r"^mine.dbc:9: GUARDED: E2EProfile 'P01_1A' wants an 8-bit"
    ):
        parse(text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"^mine.dbc:1: "),
        ("hello", r"^mine.dbc:1: invalid DBC syntax at column 1: >>!<<hello"),
        ("BO_ 1 M: 8 A\n SG_ s : 0|8@1+ (1,0", r"^mine.dbc:2: this DBC file breaks off"),
        ('VERSION ""\nBU_: A\n', r"^mine.dbc:1: no message \(BO_\) in this DBC file"),
        (
            'BO_ 1 M: 1 A\n SG_ s : 4|8@1+ (1,0) [0|0] "" A\n',
            r"^mine.dbc:[12]: .*signal s does not fit in message M",
        ),
        (
            'BO_ 1 M: 8 A\n SG_ s : 0|8@1+ (1,0) [0|0] "" A\n SG_ u : 4|8@1+ (1,0) [0|0] "" A\n',
            r"^mine.dbc:[123]: .*overlapping",
        ),
        (
            'BO_ 1 M: 8 A\n SG_ s : 0|8@1+ (0,0) [0|0] "" A\n',
            r"^mine.dbc:2: M.s: factor 0.0 and offset 0.0: both must be finite and the factor",
        ),
        (
            "BO_ 1 M: 8 A\nBO_ 1 N: 8 A\n",
            r"^mine.dbc:2: N has the identifier of M: each needs its own",
        ),
        (
            "BO_ 1 M: 8 A\nBO_ 2 M: 8 A\n",
            r"^mine.dbc:1: M stands twice in this file: each message once",
        ),
    ],
)
def test_a_broken_database_is_one_line_with_file_and_line(text: str, message: str) -> None:
    with pytest.raises(CanBusError, match=message) as caught:
        parse(text)
    assert "\n" not in str(caught.value)


WRONG = """\
BO_ 1 RIGHT: 8 A
 SG_ speed : 0|16@1+ (0.01,0) [0|0] "m/s" A

BO_ 2 OVERLAPS: 8 A
 SG_ s : 0|8@1+ (1,0) [0|0] "" A
 SG_ u : 4|8@1+ (1,0) [0|0] "" A

BO_ 3 OUTSIDE: 1 A
 SG_ s : 4|8@1+ (1,0) [0|0] "" A

  BO_ 419360000 TOO_MANY_BITS: 8 A
 SG_ s : 0|8@1+ (1,0) [0|0] "" A

// guessed
SG_ t : 8|8@1+ (1,0) [0|0] "" A

BO_ 3758096384 OF_30_BITS: 8 A
 SG_ s : 0|8@1+ (1,0) [0|0] "" A

BO_ 4 ALSO_RIGHT: 8 A
 SG_ s : 0|8@1+ (1,0) [0|0] "" A

VAL_ 419360000 s 1 "on; or \\"on\\"" 0 "off" ;
VAL_ 4 s 1 "on" ;
VAL_ 004 gone 1 "on" ;
CM_ SG_ 4 s "not; VAL_ 4 gone 1 ;";
"""


def test_to_read_a_log_messages_that_cannot_be_right_are_left_out_and_said_to_be() -> None:
    """43 of 119 files that a public collection has for cars were refused for such a one."""
    database = parse_database(WRONG, Path("mine.dbc"), leave_out_faulty=True)
    assert list(database.messages) == ["RIGHT", "ALSO_RIGHT"]
    assert list(database.message("RIGHT").signals) == ["speed"]
    assert database.message("ALSO_RIGHT").signal("s").choices == {1: "on"}
    assert database.message("ALSO_RIGHT").signal("s").comment == "not; VAL_ 4 gone 1 ;"
    assert {name: text.split(":")[1] for name, text in database.faulty.items()} == {
        "OVERLAPS": "4",
        "OUTSIDE": "8",
        "TOO_MANY_BITS": "11",
        "OF_30_BITS": "17",
    }
    with pytest.raises(CanBusError, match=r"^mine.dbc:4: OVERLAPS: The signals .* overlapping"):
        database.message("OVERLAPS")


def test_to_send_every_message_must_be_right() -> None:
    for text in (
        WRONG,
        WRONG.replace("BO_ 419360000", "BO_ 5").replace("VAL_ 419360000", "VAL_ 5"),
    ):
        with pytest.raises(CanBusError, match=r"^mine.dbc:\d+: "):
            parse(text)


def test_a_right_message_is_not_hidden_by_a_faulty_one_of_its_name() -> None:
    text = WRONG.replace("OVERLAPS", "RIGHT")
    database = parse_database(text, Path("mine.dbc"), leave_out_faulty=True)
    assert list(database.message("RIGHT").signals) == ["speed"]


def test_what_is_left_out_is_found_in_time_that_grows_with_the_file() -> None:
    """Backtracking doubled with each escaped quote, and each message looked through all lines."""
    unclosed = "// VAL_ 4 gone " + '\\"' * 200
    messages = "".join(f"BO_ {5000 + k} M{k}: 8 A\n" for k in range(3000))
    database = parse_database(WRONG + messages + unclosed, Path("mine.dbc"), leave_out_faulty=True)
    assert len(database.faulty) == 3004


def test_a_database_of_which_nothing_is_right_is_refused() -> None:
    wrong = 'BO_ 3 OUTSIDE: 1 A\n SG_ s : 4|8@1+ (1,0) [0|0] "" A\n'
    with pytest.raises(CanBusError, match=r"^mine.dbc:[12]: .*does not fit in message OUTSIDE"):
        parse_database(wrong, Path("mine.dbc"), leave_out_faulty=True)


def test_a_missing_database_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(CanBusError, match=r"none.dbc: cannot read this DBC file: No such file"):
        load_database(tmp_path / "none.dbc")
    with pytest.raises(CanBusError, match=r"cannot read this DBC file: Is a directory"):
        load_database(tmp_path)


def test_a_file_far_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.dbc"
    with path.open("wb") as file:
        file.truncate(1 << 30)
    with pytest.raises(CanBusError, match="over 4 MiB: this is no DBC file"):
        load_database(path)


BOMB = """\
BO_ 5 M: 8 A
 SG_ a M : 0|8@1+ (1,0) [0|255] "" A
 SG_ b m0 : 8|8@1+ (1,0) [0|255] "" A
SG_MUL_VAL_ 5 b a 0-3;
"""


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("M: 8", "M: 100000000", "1: M: a length of 100000000 bytes: expected 0 to 64"),
        ("M: 8", "M // 8\n\n:+99", "1: M: a length of 99 bytes: expected 0 to 64"),
        ("M: 8", "M: " + "9" * 5000, f"1: M: a length of {'9' * 80}… bytes: expected 0 to 64"),
        ("8|8", "8|100000000", "3: b: a length of 100000000 bits: expected 1 to 64"),
        ("8|8", "900000000|8", "3: b: start bit 900000000: expected 0 to 511"),
        (
            "0-3",
            "0-60000000",
            "4: b: with this the multiplexer ranges (SG_MUL_VAL_) of the file have 60000001 values:"
            " expected 65536 at most",
        ),
        (
            "0-3",
            "0-3, //;\n -40000-40000",
            "4: b: with this the multiplexer ranges (SG_MUL_VAL_) of the file have 80005 values:"
            " expected 65536 at most",
        ),
    ],
)
def test_a_number_that_would_fill_the_memory_is_refused_before_it_does(
    old: str, new: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert parse(BOMB).message("M").signal("b").multiplexer_values == {0, 1, 2, 3}
    monkeypatch.setattr("cantools.database.load_string", lambda *_, **__: pytest.fail("too late"))
    with pytest.raises(CanBusError) as caught:
        parse(BOMB.replace(old, new))
    assert str(caught.value) == f"mine.dbc:{message}"


def test_a_comment_may_say_what_it_likes() -> None:
    text = BOMB + 'CM_ "BO_ 5 M: 100000000 A";\n// SG_ b : 0|100000000\n'
    assert parse(text).message("M").length_bytes == 8


@pytest.mark.parametrize("is_wrapped", [False, True])
def test_an_error_without_text_is_named_by_its_type(
    is_wrapped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        error = MemoryError()
        if is_wrapped:
            raise UnsupportedDatabaseFormatError(None, error, None, None, None)
        raise error

    monkeypatch.setattr("cantools.database.load_string", fail)
    with pytest.raises(CanBusError, match=r"^mine.dbc:4: MemoryError$"):
        parse(BOMB)


def test_umlauts_in_either_encoding_are_read(tmp_path: Path) -> None:
    for encoding in ("utf-8", "utf-8-sig", "cp1252"):
        path = tmp_path / f"{encoding}.dbc"
        path.write_bytes(FOREIGN.replace("rpm", "°C").encode(encoding))
        assert load_database(path).message("LONG_ID").signal("speed").unit == "°C"


@given(st.integers(0, len(SHIPPED)))
def test_a_database_cut_anywhere_loads_or_fails_in_one_line(length: int) -> None:
    loads_or_fails_in_one_line(SHIPPED[:length])


@given(st.integers(0, len(SHIPPED) - 1), st.characters(codec="utf-8"))
@example(SHIPPED.index("|") - 1, "9")
def test_a_database_with_one_wrong_character_loads_or_fails_in_one_line(
    position: int, character: str
) -> None:
    loads_or_fails_in_one_line(SHIPPED[:position] + character + SHIPPED[position + 1 :])


@given(st.text())
def test_any_text_loads_or_fails_in_one_line(text: str) -> None:
    loads_or_fails_in_one_line(text)


def loads_or_fails_in_one_line(text: str) -> None:
    try:
        database = parse(text)
    except CanBusError as error:
        problem = str(error)
    else:
        assert database.messages
        return
    assert problem.startswith("mine.dbc:")
    assert "\n" not in problem
    assert len(problem) < 600
