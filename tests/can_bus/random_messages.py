"""Random DBC files: what cantools can describe, our codec must read alike."""

from __future__ import annotations

from pathlib import Path

import cantools.database.can as cantools
from cantools.database.conversion import BaseConversion
from hypothesis import strategies as st

from can_bus import MessageSpec, parse_database
from can_bus.signals import ByteOrder

FLOAT_LENGTHS = (32, 64)  # those that SIG_VALTYPE_ knows


def covered_bits(start: int, length: int, byte_order: str) -> list[int]:
    """Walk the bits of a signal as the DBC numbers them."""
    if byte_order == "little_endian":
        return list(range(start, start + length))
    bits = []
    bit = start
    for _ in range(length):
        bits.append(bit)
        bit = bit - 1 if bit % 8 else bit + 15
    return bits


@st.composite
def multiplexed_messages(draw: st.DrawFn, frame_id: int, name: str) -> cantools.Message:
    """Draw a message with two pages or more, a signal on each."""
    length_bytes = draw(st.sampled_from((4, 8, 24)))
    byte_order: ByteOrder = draw(st.sampled_from(("little_endian", "big_endian")))
    pages = sorted(draw(st.sets(st.integers(0, 15), min_size=2, max_size=5)))
    selector = cantools.Signal(
        "page", 0 if byte_order == "little_endian" else 3, 4, byte_order=byte_order
    )
    selector.is_multiplexer = True
    signals = [selector]
    for number, page in enumerate(pages):
        length = draw(st.integers(1, 8 * length_bytes - 8 if length_bytes < 9 else 64))
        first = draw(st.integers(8, 8 * length_bytes - length))
        start = first if byte_order == "little_endian" else 8 * (first // 8) + 7 - first % 8
        signal = cantools.Signal(
            f"signal_{number}",
            start,
            length,
            byte_order=byte_order,
            is_signed=draw(st.booleans()),
            conversion=draw(conversions(is_float=False)),
        )
        signal.multiplexer_ids = [page]
        signal.multiplexer_signal = "page"
        signals.append(signal)
    return cantools.Message(
        frame_id=frame_id,
        name=name,
        length=length_bytes,
        signals=signals,
        is_extended_frame=draw(st.booleans()),
    )


@st.composite
def conversions(draw: st.DrawFn, is_float: bool) -> BaseConversion:
    """Draw factor and offset."""
    return BaseConversion.factory(
        scale=draw(st.sampled_from((1, 0.5, 0.001, -2, 3))),
        offset=draw(st.sampled_from((0, -40, 0.25))),
        is_float=is_float,
    )


@st.composite
def parsed_messages(
    draw: st.DrawFn, max_bytes: int = 8, frame_id: int | None = None, name: str = "RANDOM"
) -> cantools.Message:
    """Draw a message of up to six signals without overlap: any order, sign, float."""
    length_bytes = draw(st.integers(1, max_bytes))
    taken: set[int] = set()
    signals = []
    for number in range(draw(st.integers(1, 6))):
        byte_order: ByteOrder = draw(st.sampled_from(("little_endian", "big_endian")))
        is_float = draw(st.sampled_from((False, False, False, True)))
        length = draw(st.sampled_from(FLOAT_LENGTHS) if is_float else st.integers(1, 64))
        start = draw(st.integers(0, 8 * length_bytes - 1))
        bits = covered_bits(start, length, byte_order)
        if taken & set(bits) or max(bits) >= 8 * length_bytes:
            continue
        taken |= set(bits)
        conversion = draw(conversions(is_float=is_float))
        signals.append(
            cantools.Signal(
                f"signal_{number}",
                start,
                length,
                byte_order=byte_order,
                is_signed=is_float or draw(st.booleans()),
                conversion=conversion,
            )
        )
    is_extended = draw(st.booleans())
    if frame_id is None:
        frame_id = draw(st.integers(0, (1 << 29 if is_extended else 1 << 11) - 1))
    return cantools.Message(
        frame_id=frame_id,
        name=name,
        length=length_bytes,
        signals=signals,
        is_extended_frame=is_extended,
    )


def spec_of(message: cantools.Message) -> MessageSpec:
    """Read the message back from the text of a DBC file."""
    text = cantools.Database(messages=[message]).as_dbc_string()
    return parse_database(text, Path("random.dbc")).message("RANDOM")
