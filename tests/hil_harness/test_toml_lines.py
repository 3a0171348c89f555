"""The line locator agrees with tomllib about what there is, and with the eye about where."""

import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_harness.toml_lines import Path, key_lines

DOCUMENT = '''\
# a comment with [brackets] and key = value
schema = 1
title = """
a string = "with things"
[that look like tables]
"""
physical."odd key".'another' = 3

[encoder]
ticks_per_rev = 2048   # [not.a.table]
  [encoder.nested]
  value = 'it''s' # '''

DOCUMENT = DOCUMENT.replace("'it''s' # ", "'its'\n") + (
    "inline = { first = 1, second = { third = [10, 20,\n  30] } }\n"
    "\n"
    "[[segments]]\n"
    "v_m_s = 1.0\n"
    "[[segments]]\n"
    "v_m_s = 2.0\n"
    "[segments.ramp]\n"
    "duration_s = 0.5\n"
    "[[segments.marks]]\n"
    "at_s = 1\n"
)


def paths(value: Any, above: Path = ()) -> set[Path]:
    found: set[Path] = set()
    items: Any = ()
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list):
        items = enumerate(value)
    for key, item in items:
        found |= {(*above, key)} | paths(item, (*above, key))
    return found


@pytest.mark.parametrize(
    ("path", "start_of_line"),
    [
        (("schema",), "schema = 1"),
        (("title",), 'title = """'),
        (("physical", "odd key", "another"), "physical."),
        (("physical",), "physical."),
        (("encoder",), "[encoder]"),
        (("encoder", "ticks_per_rev"), "ticks_per_rev"),
        (("encoder", "nested"), "  [encoder.nested]"),
        (("encoder", "nested", "value"), "  value"),
        (("encoder", "nested", "inline", "second", "third", 1), "inline"),
        (("encoder", "nested", "inline", "second", "third", 2), "  30]"),
        (("segments",), "[[segments]]"),
        (("segments", 0, "v_m_s"), "v_m_s = 1.0"),
        (("segments", 1, "v_m_s"), "v_m_s = 2.0"),
        (("segments", 1, "ramp", "duration_s"), "duration_s"),
        (("segments", 1, "marks", 0, "at_s"), "at_s"),
    ],
)
def test_each_key_is_found_on_its_line(path: Path, start_of_line: str) -> None:
    line = key_lines(DOCUMENT)[path]
    assert DOCUMENT.split("\n")[line - 1].startswith(start_of_line)


def test_the_locator_finds_exactly_the_keys_that_tomllib_finds() -> None:
    assert set(key_lines(DOCUMENT)) == paths(tomllib.loads(DOCUMENT))


def test_windows_line_ends_do_not_move_a_line() -> None:
    assert key_lines(DOCUMENT.replace("\n", "\r\n")) == key_lines(DOCUMENT)


strings = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"])
    | st.sampled_from("\"'[]{}#=.\\,"),
    max_size=8,
)
scalars = st.integers(-(2**40), 2**40) | st.booleans() | st.floats(allow_nan=False) | strings
values = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(strings, inner, max_size=3),
    max_leaves=6,
)


def quote(text: str, style: int) -> str:
    if style == 1 and "'" not in text:
        return f"'{text}'"
    escaped = "".join("\\" + character if character in '"\\' else character for character in text)
    return f'"{escaped}"'


def render(value: Any, style: int) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        if style == 2:
            return f'"""\n{quote(value, 0)[1:-1]}"""'
        return quote(value, style)
    if isinstance(value, list):
        joint = ",\n  # ] }\n" if style else ", "
        return "[" + joint.join(render(item, style) for item in value) + "]"
    if isinstance(value, dict):
        pairs = (f"{quote(key, style)} = {render(item, style)}" for key, item in value.items())
        return "{ " + ", ".join(pairs) + " }"
    return repr(value)


@given(
    tables=st.dictionaries(strings, st.dictionaries(strings, values, max_size=3), max_size=3),
    lists=st.lists(st.dictionaries(strings, values, max_size=2), max_size=3),
    style=st.integers(0, 2),
)
def test_the_locator_reads_whatever_tomllib_reads(
    tables: dict[str, dict[str, Any]], lists: list[dict[str, Any]], style: int
) -> None:
    text = ""
    expected: dict[Path, int] = {}
    for name, table in tables.items():
        text += f"[ {quote(name, style)} ]  # note\n"
        for key, value in table.items():
            expected[(name, key)] = text.count("\n") + 1
            text += f"{quote(key, style)} = {render(value, style)}\n"
    for index, table in enumerate(lists):
        text += '[[ "list of tables" . items ]]\n'
        for key, value in table.items():
            expected[("list of tables", "items", index, key)] = text.count("\n") + 1
            text += f"{quote(key, style)} = {render(value, style)}\n"
    found = key_lines(text)
    assert set(found) == paths(tomllib.loads(text))
    assert {path: found[path] for path in expected} == expected
