"""Candump logs at array speed say what they say line by line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bus import CanBusError, columns_of, read_log, read_log_columns
from can_bus.logs import candump_columns, candump_lines
from can_bus.logs.log_columns import empty_columns

CLASSIC = st.builds(
    "({}.{:06d}) {} {}#{}{}".format,
    st.integers(0, 2**32 - 1),
    st.integers(0, 10**6 - 1),
    st.sampled_from(["vcan0", "can0", "slcan_0", "x"]),
    st.one_of(
        st.integers(0, 0x7FF).map("{:03X}".format), st.integers(0, 0x1FFFFFFF).map("{:08x}".format)
    ),
    st.binary(max_size=8).map(bytes.hex) | st.binary(max_size=8).map(lambda b: b.hex().upper()),
    st.sampled_from(["", " R", " T"]),
)
FD_DATA = st.sampled_from([0, 3, 8, 12, 20, 64]).flatmap(
    lambda size: st.binary(min_size=size, max_size=size)
)
PLAIN = st.one_of(
    CLASSIC,
    st.builds(
        "(0.000100) can1 1FFFFFFF##{:X}{}".format, st.integers(0, 15), FD_DATA.map(bytes.hex)
    ),
)
OTHER = st.sampled_from(
    [
        "(1.000000) can0 123#R",
        "(4294967296.000000) can0 123#00",
        "(1.000000) can0 123#R4 T",
        "(1.5) can0 123#00",
        "(1.000000) can0 123##1" + "00" * 12,
        "(1.000000) can0 20000080#0000000000000000",
        "(1.000000) can0.1 123#0011",
        "(1.000000)  can0  123#0011  R",
        "(99999999999.999999) can0 123#0011",
        "",
    ]
)
FAULTY = st.sampled_from(
    [
        "(1.000000) can0 12#00",
        "(1.000000) can0 123#0",
        "(1.000000) can0 123#0G",
        "(1.000000) can0 123##",
        "(1.000000) can0 123##10",
        "(1.000000) can0 123##1" + "00" * 9,
        "(1.000000) can0 123##1" + "00" * 65,
        "(1.000000) can0 123#001122334455667788",
        "(1.000000) can0 900#00",
        "(1.000000 can0 123#00",
        "(1.00000x) can0 123#00",
        "(1.000 00) can0 123#00",
        "(1.00000/) can0 123#00",
        "(1 .000000) can0 123#00",
        "(1.000000) can0 123#00 X",
        "(1.000000) can0 a 123#00",
        "(1.000000) 123#00",
        "1.000000) can0 123#00",
        "(.000000) can0 123#00",
        "(1.000000) can0 123#00 R R",
    ]
)


def read_both(path: Path) -> tuple[object, object]:
    results: list[object] = []
    for read in (read_log_columns, lambda log: columns_of(read_log(log))):
        try:
            results.append(read(path))
        except CanBusError as error:
            results.append(str(error))
    return results[0], results[1]


@given(lines=st.lists(st.one_of(PLAIN, PLAIN, PLAIN, OTHER, FAULTY), max_size=12))
def test_blocks_and_lines_are_the_same_frames_or_the_same_error(
    lines: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("candump") / "bus.log"
    path.write_text("".join(f"{line}\n" for line in lines))
    fast, slow = read_both(path)
    if isinstance(slow, str):
        assert fast == slow
        return
    for name, column in vars(slow).items():
        assert np.array_equal(getattr(fast, name), column), name
        assert getattr(fast, name).dtype == column.dtype


def end_of_pass(line: str) -> tuple[int, int]:
    """Return where the pass over one line stopped, and how many frames it read."""
    text = np.frombuffer(f"{line}\n".encode(), dtype=np.uint8)
    columns = empty_columns(1, 64)
    scanned = [columns[name] for name in candump_columns.SCANNED]
    at, row = candump_lines.read_lines(text, 0, 0, *scanned)
    return at, row


@given(line=PLAIN)
def test_a_plain_line_is_read_by_the_pass(line: str) -> None:
    assert end_of_pass(line) == (len(line) + 1, 1)


@given(line=FAULTY)
def test_a_faulty_line_is_left_to_the_line_reader(line: str) -> None:
    assert end_of_pass(line) == (0, 0)


def test_a_fault_far_into_a_long_log_is_named_by_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(candump_columns, "_BLOCK_BYTES", 1000)
    lines = [f"({k}.000000) can0 123#{k % 256:02X}" for k in range(1, 501)]
    path = tmp_path / "long.log"
    path.write_text("\n".join(lines) + "\n")
    assert np.array_equal(read_log_columns(path).timestamp_us, np.arange(1, 501) * 10**6)
    lines[420] += "0"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(CanBusError, match=r"long.log:421: "):
        read_log_columns(path)
    path.write_text("\n".join(lines[:400]))
    with pytest.raises(CanBusError, match=r"long.log:400: .*the log breaks off here"):
        read_log_columns(path)
