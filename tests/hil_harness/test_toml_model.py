"""Each thing a person can get wrong in a TOML file comes back as one line that helps."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from hil_harness.errors import HarnessError
from hil_harness.toml_model import validate
from hil_harness.toml_source import MAX_BYTES, load_toml, parse_toml


class Rounding(StrEnum):
    FLOOR = "floor"
    HALF_EVEN = "half_even"


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Encoder(Table):
    ticks_per_rev: int = Field(default=2048, ge=1, le=65535, examples=[2048])
    rounding: Rounding = Rounding.FLOOR
    mode: Literal["wheel", "gyro"] = "wheel"
    inverted: bool = False


class Segment(Table):
    duration_s: float = Field(gt=0, allow_inf_nan=False, examples=[2.5])
    ramp_s: float | None = Field(default=None, ge=0, lt=10)


class Robot(Table):
    name: str = Field(default="robot", max_length=20)
    encoder: Encoder = Encoder()
    segments: tuple[Segment, ...] = Field(default=(), max_length=2)
    weights: tuple[float, float] = (0.5, 0.5)
    offsets: Annotated[list[int], Field(max_length=3)] = []

    @field_validator("name")
    @classmethod
    def _no_spaces(cls, name: str) -> str:
        if " " in name:
            raise ValueError("expected a name without spaces")
        return name

    @model_validator(mode="after")
    def _weights_add_up(self) -> "Robot":
        if sum(self.weights) != 1:
            raise ValueError(f"weights add up to {sum(self.weights)}: expected 1")
        return self


def problems(text: str) -> tuple[str, ...]:
    with pytest.raises(HarnessError) as caught:
        validate(parse_toml(text, name="robot.toml"), Robot)
    assert "\n" not in str(caught.value)
    return caught.value.problems


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            '[encoder]\n\nticks_per_rev = "2048 ticks"',
            'robot.toml:3: encoder.ticks_per_rev = "2048 ticks": '
            "expected a whole number from 1 to 65535, for example 2048",
        ),
        (
            '[encoder]\nticks_per_rev = "2048"',
            'robot.toml:2: encoder.ticks_per_rev = "2048": '
            "expected a whole number from 1 to 65535, for example 2048",
        ),
        (
            "encoder.ticks_per_rev = 2048.0",
            "robot.toml:1: encoder.ticks_per_rev = 2048.0: "
            "expected a whole number from 1 to 65535, for example 2048",
        ),
        (
            "encoder = { ticks_per_rev = 0 }",
            "robot.toml:1: encoder.ticks_per_rev = 0: "
            "expected a whole number from 1 to 65535, for example 2048",
        ),
        (
            "[encoder]\ntick_per_rev = 2048",
            "robot.toml:2: encoder.tick_per_rev: unknown key: the nearest is ticks_per_rev",
        ),
        (
            "[wheels]\nradius = 1",
            "robot.toml:1: wheels: unknown key: "
            "known are encoder, name, offsets, segments, weights",
        ),
        (
            '[encoder]\nmode = "giro"',
            'robot.toml:2: encoder.mode = "giro": expected one of "wheel", "gyro"',
        ),
        (
            '[encoder]\nrounding = "up"',
            'robot.toml:2: encoder.rounding = "up": expected one of "floor", "half_even"',
        ),
        (
            "[encoder]\ninverted = 1",
            "robot.toml:2: encoder.inverted = 1: expected true or false, for example false",
        ),
        (
            "encoder = 3",
            "robot.toml:1: encoder = 3: "
            "expected a table with ticks_per_rev, rounding, mode, inverted",
        ),
        (
            "[[segments]]\nduration_s = 1.0\n[[segments]]\nduration_s = -1.0",
            "robot.toml:4: segments[2].duration_s = -1.0: "
            "expected a number above 0, for example 2.5",
        ),
        (
            "[[segments]]\nduration_s = inf",
            "robot.toml:2: segments[1].duration_s = inf: "
            "expected a number above 0, for example 2.5",
        ),
        (
            "\n[[segments]]\nramp_s = 1",
            "robot.toml:2: segments[1].duration_s is missing: "
            "expected a number above 0, for example 2.5",
        ),
        (
            "[[segments]]\nduration_s = 1.0\nramp_s = 10",
            "robot.toml:3: segments[1].ramp_s = 10: expected a number of at least 0 and below 10",
        ),
        (
            "segments = [{ duration_s = 1 }, { duration_s = 1 }, { duration_s = 1 }]",
            "robot.toml:1: segments = [{ duration_s = 1 }, { duration_s = 1 }, { dura…: "
            "expected a list of at most 2 values, each a table with duration_s, ramp_s",
        ),
        (
            "weights = [0.5,\n 'half']",
            'robot.toml:2: weights[2] = "half": expected a number',
        ),
        (
            "offsets = [1, 2.5]",
            "robot.toml:1: offsets[2] = 2.5: expected a whole number",
        ),
        ("weights = [0.5, 0.6]", "robot.toml:1: weights add up to 1.1: expected 1"),
        ('name = "my robot"', 'robot.toml:1: name = "my robot": expected a name without spaces'),
        (
            "name = 2020-01-01",
            "robot.toml:1: name = 2020-01-01: "
            'expected text of at most 20 characters, for example "robot"'
            "",
        ),
        (
            "[encoder]\nticks_per_rev = 1979-05-27T07:32:00",
            "robot.toml:2: encoder.ticks_per_rev = 1979-05-27T07:32:00: "
            "expected a whole number from 1 to 65535, for example 2048",
        ),
        (
            f"[encoder]\nticks_per_rev = {10**60}",
            "robot.toml:2: encoder.ticks_per_rev = a whole number of 200 bits: "
            "expected a whole number from 1 to 65535, for example 2048",
        ),
        (
            '"a key\\u001b[31m" = 1',
            'robot.toml:1: "a key\\x1b[31m": unknown key: '
            "known are encoder, name, offsets, segments, weights",
        ),
    ],
)
def test_a_wrong_value_says_what_where_and_what_would_be_right(text: str, line: str) -> None:
    assert problems(text)[0] == line


def test_all_problems_are_kept_in_the_order_of_their_lines() -> None:
    found = problems('weights = "no"\n[encoder]\nmode = 3\nspeed = 1\nticks_per_rev = 0')
    assert [line.split(": ")[0] for line in found] == [
        "robot.toml:1",
        "robot.toml:3",
        "robot.toml:4",
        "robot.toml:5",
    ]


def test_the_first_problem_says_how_many_more_there_are() -> None:
    with pytest.raises(HarnessError, match=r"^bad\.toml:1: .* \(and 2 more problems\)$"):
        validate(parse_toml("a = 1\nb = 1\nc = 1", name="bad.toml"), Robot)


def test_a_correct_file_becomes_the_model() -> None:
    text = 'name = "x"\nweights = [1, 0]\n[encoder]\nrounding = "half_even"\n'
    robot = validate(parse_toml(text, name="robot.toml"), Robot)
    assert robot == Robot(
        name="x", weights=(1.0, 0.0), encoder=Encoder(rounding=Rounding.HALF_EVEN)
    )


def test_one_table_of_a_file_can_be_validated_alone() -> None:
    source = parse_toml("[encoder]\nticks_per_rev = 7\n[other]\nx = 1", name="robot.toml")
    assert validate(source, Encoder, ("encoder",)) == Encoder(ticks_per_rev=7)
    with pytest.raises(HarnessError, match=r"^robot\.toml:4: other\.x: unknown key: "):
        validate(source, Encoder, ("other",))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a = 1\nb = ", "bad.toml:2: not a TOML file: invalid value near `b =`"),
        (
            b"a = 1\nb c\n",
            "bad.toml:2: not a TOML file: expected '=' after a key in a key/value pair near `b c`",
        ),
        (b'a = "open', 'bad.toml:1: not a TOML file: unterminated string near `a = "open`'),
        (b"a = 1\na = 2\n", "bad.toml:2: not a TOML file: cannot overwrite a value near `a = 2`"),
        (
            b"ok = 1\n# caf\xe9\n",
            "bad.toml:2: byte 0xE9 is not UTF-8: expected a TOML file saved as UTF-8",
        ),
        (
            b"a = " + b"[" * 5000,
            "bad.toml: tables or lists are nested too deeply: expected at most 32 levels",
        ),
        (
            b"a = " + b"[" * 33 + b"]" * 33,
            "bad.toml:1: tables or lists are nested too deeply: expected at most 32 levels",
        ),
        (
            b"x = 1\n" + b"a." * 20_000 + b"a = 1",
            "bad.toml:2: tables or lists are nested too deeply: expected at most 32 levels",
        ),
        (b"#" * (MAX_BYTES + 1), "larger than 256 KiB: expected a TOML file written by a person"),
    ],
)
def test_a_file_that_is_not_toml_is_refused_in_one_line(
    tmp_path: Path, content: bytes, message: str
) -> None:
    file = tmp_path / "bad.toml"
    file.write_bytes(content)
    with pytest.raises(HarnessError) as caught:
        load_toml(file)
    assert str(caught.value).endswith(message)
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_a_dotted_rule_and_a_long_list_of_numbers_do_no_harm() -> None:
    text = "\ufeff# " + "." * 70 + "\nweights = [" + "0.25, " * 500 + "]"
    source = parse_toml(text.encode(), name="robot.toml")
    assert source.data["weights"] == [0.25] * 500
    assert source.line_of("weights") == 2


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(HarnessError, match=r"robot\.toml: no such file: expected a TOML file$"):
        load_toml(tmp_path / "robot.toml")
    with pytest.raises(HarnessError, match=r": is a folder: expected a TOML file$"):
        load_toml(tmp_path)
    with pytest.raises(HarnessError, match=r"cannot be read"):
        load_toml("a\0b")


@given(st.binary(max_size=60))
def test_random_bytes_never_end_in_anything_but_one_line(content: bytes) -> None:
    message = ""
    try:
        validate(parse_toml(content, name="bad.toml"), Robot)
    except HarnessError as error:
        message = str(error)
    assert "\n" not in message
    assert not message or message.isprintable()


def test_a_line_is_known_for_every_key_and_the_table_above_a_missing_one() -> None:
    source = parse_toml("[encoder]\nticks_per_rev = 1\n", name="robot.toml")
    assert source.line_of("encoder.ticks_per_rev") == 2
    assert source.line_of("encoder.no_such_key") == 1
    assert source.line_of("no_such_table") is None
    assert source.where("no_such_table") == "robot.toml"
