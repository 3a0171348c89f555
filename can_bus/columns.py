"""Whole logs at array speed: the codec over columns of frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from can_bus.errors import CanBusError
from can_bus.signals import SignalSpec
from can_bus.specs import MessageSpec

Column = NDArray[np.int64] | NDArray[np.uint64] | NDArray[np.float64]
"""Raw values of one signal: int64; uint64 for unsigned signals of 64 bits; float64 for floats."""

_WORD_BITS = 64
_EXACT_FLOATS = 1 << 53
_FLOAT_TYPES: dict[int, Any] = {16: np.float16, 32: np.float32, 64: np.float64}


def decode_columns(
    spec: MessageSpec, data: NDArray[np.uint8], rows: NDArray[np.intp] | None = None
) -> dict[str, Column]:
    """Return the raw value of each signal in each frame of a message.

    Args:
        spec: the message; little and big endian, signed, float, up to 64 bytes.
        data: uint8[frames, bytes]; columns beyond the message's length are ignored.
        rows: which frames are its own; all of them if left out.

    Of a multiplexed message every signal is decoded in every frame; `present_columns` tells where
    it means something. Raises CanBusError for fewer columns than the message has bytes.
    """
    _require_columns(spec, data)
    if rows is None:
        rows = np.arange(len(data), dtype=np.intp)
    return {signal.name: _decode(signal, spec, data, rows) for signal in spec.signals.values()}


def decode_columns_scaled(
    spec: MessageSpec, data: NDArray[np.uint8], rows: NDArray[np.intp] | None = None
) -> dict[str, Column]:
    """Return the scaled value of each signal in each frame as float64.

    NaN where the value is not available (SNA) or the signal is not in the frame. Whole numbers
    beyond 2^53 are the nearest float64. Raises as `decode_columns`.
    """
    return scale_columns(spec, decode_columns(spec, data, rows))


def scale_columns(spec: MessageSpec, raw: dict[str, Column]) -> dict[str, Column]:
    """Return raw columns of a message scaled, as `decode_columns_scaled` does."""
    present = present_columns(spec, raw) if _is_multiplexed(spec) else None
    scaled: dict[str, Column] = {}
    for name, column in raw.items():
        signal = spec.signals[name]
        values = _scale(signal, column)
        if signal.invalid_raw is not None:
            values[column == signal.invalid_raw] = np.nan
        if present is not None:
            values[~present[name]] = np.nan
        scaled[name] = values
    return scaled


def present_columns(spec: MessageSpec, raw: dict[str, Column]) -> dict[str, NDArray[np.bool_]]:
    """Return where each signal is in the frame: everywhere unless it is multiplexed."""
    present: dict[str, NDArray[np.bool_]] = {}

    def of(signal: SignalSpec) -> NDArray[np.bool_]:
        if signal.name not in present:
            if signal.multiplexer is None:
                present[signal.name] = np.ones(len(raw[signal.name]), dtype=np.bool_)
            else:
                selected = np.isin(raw[signal.multiplexer], sorted(signal.multiplexer_values))
                present[signal.name] = selected & of(spec.signals[signal.multiplexer])
        return present[signal.name]

    for signal in spec.signals.values():
        of(signal)
    return present


def _is_multiplexed(spec: MessageSpec) -> bool:
    return any(signal.multiplexer is not None for signal in spec.signals.values())


def _require_columns(spec: MessageSpec, data: NDArray[np.uint8]) -> None:
    if data.ndim != 2 or data.dtype != np.uint8 or data.shape[1] < spec.length_bytes:
        raise CanBusError(
            f"{spec.name}: frames of shape {data.shape} {data.dtype}: expected "
            f"uint8[frames, at least {spec.length_bytes}]"
        )


def _decode(
    signal: SignalSpec, spec: MessageSpec, data: NDArray[np.uint8], rows: NDArray[np.intp]
) -> Column:
    # numba takes a quarter of a second to import: only who decodes whole logs pays for it.
    from can_bus.field_words import gather_words  # noqa: PLC0415

    shift = signal.shift_in(spec.length_bytes)
    first, last = shift // 8, (shift + signal.length_bits - 1) // 8
    is_little = signal.byte_order == "little_endian"
    words = np.empty(len(rows), dtype=np.uint64)
    gather_words(
        data,
        rows,
        first if is_little else spec.length_bytes - 1 - first,
        1 if is_little else -1,
        last - first + 1,
        shift % 8,
        signal.length_bits,
        signal.is_signed and not signal.is_float,
        words,
    )
    if signal.is_float:
        floats: Column = (
            words.astype(f"<u{signal.length_bits // 8}")
            .view(_FLOAT_TYPES[signal.length_bits])
            .astype(np.float64)
        )
        return floats
    is_beyond_int64 = signal.length_bits == _WORD_BITS and not signal.is_signed
    return words if is_beyond_int64 else words.view(np.int64)


def _scale(signal: SignalSpec, raw: Column) -> NDArray[np.float64]:
    from can_bus.field_words import scale_integers  # noqa: PLC0415

    factor, offset = signal.factor, signal.offset
    if factor == 1 and offset == 0:
        return raw.astype(np.float64)  # also −0.0 as it is
    if signal.is_float or not (factor.is_integer() and offset.is_integer()):
        scaled = np.empty(len(raw))
        scale_integers(raw, factor, offset, scaled)
        return scaled
    ends = [code * int(factor) + int(offset) for code in (signal.low_code, signal.high_code)]
    if max(map(abs, ends)) <= _EXACT_FLOATS:
        scaled = np.empty(len(raw))
        scale_integers(raw, factor, offset, scaled)
        return scaled
    # Whole numbers that a float may not hold: exact first, then rounded once.
    if all(abs(end) < 1 << (_WORD_BITS - 1) for end in ends):
        whole: Any = raw.astype(np.int64) * int(factor) + int(offset)
    else:
        whole = raw.astype(object) * int(factor) + int(offset)
    result: NDArray[np.float64] = whole.astype(np.float64)
    return result
