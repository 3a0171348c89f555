"""numpy's generators, compiled: PCG64 and Philox4x64-10 feeding numpy's ziggurat normals.

Bit for bit what `numpy.random.Generator(...).standard_normal()` returns, in a third of its time and
without a Python object per stream: drawing is most of what a batch does. Sources: O'Neill 2014 (PCG
XSL-RR 128/64) and 2015, *Developing a seed_seq Alternative* (numpy's SeedSequence); Salmon et al.
2011, *Parallel random numbers: as easy as 1, 2, 3* (Philox); Marsaglia and Tsang 2000, *The
ziggurat method* (with numpy's tables, `ziggurat.npy`: rows k, w, f of its 256 layers).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from sim_plant.compiled import inlined

# One generator. PCG64: 128-bit state and increment. Philox: three counter words and the key.
SOURCE = np.dtype(
    [
        ("philox", "i8"),
        ("position", "i8"),  # of the next raw word in the buffer
        ("state_low", "u8"),
        ("state_high", "u8"),
        ("state_third", "u8"),
        ("fixed_low", "u8"),
        ("fixed_high", "u8"),
    ]
)
BUFFER_WORDS = 4

_LAYERS = np.load(Path(__file__).with_name("ziggurat.npy"), allow_pickle=False)
_K = _LAYERS[0].astype(np.uint64)
_SIGNED_W = np.concatenate((_LAYERS[1], -_LAYERS[1]))  # the word's bit 8 is the normal's sign
_F = _LAYERS[2].copy()
_TAIL_START = 3.6541528853610087963519472518
_INVERSE_TAIL_START = 0.27366123732975827203338247596

_U = np.uint64
_PCG_LOW = _U(4865540595714422341)
_PCG_HIGH = _U(2549297995355413924)
_PHILOX_M0 = _U(0xD2E7470EE14C6C93)
_PHILOX_M1 = _U(0xCA5A826395121157)
_PHILOX_W0 = _U(0x9E3779B97F4A7C15)
_PHILOX_W1 = _U(0xBB67AE8584CAA73B)
_ZERO, _ONE, _EIGHT, _NINE, _ELEVEN = _U(0), _U(1), _U(8), _U(9), _U(11)
_58, _63, _64 = _U(58), _U(63), _U(64)
_BYTE, _SIGNED_BYTE, _MANTISSA = _U(0xFF), _U(0x1FF), _U(0x000FFFFFFFFFFFFF)

# numpy's SeedSequence, on 32-bit words.
_POOL_WORDS = 4
_16, _32, _WORD = _U(16), _U(32), _U(0xFFFFFFFF)
_POOL_START, _POOL_FACTOR = _U(0x43B0D7E5), _U(0x931E8875)
_STATE_START, _STATE_FACTOR = _U(0x8B51F9DD), _U(0x58F38DED)
_MIX_LEFT, _MIX_RIGHT = _U(0xCA01F9DD), _U(0x4973F715)


def _type_high_word(context: Any, a: Any, b: Any) -> Any:
    """Return the upper 64 bits of the 128-bit product of two unsigned words."""

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        wide = ir.IntType(128)
        product = builder.mul(*(builder.zext(argument, wide) for argument in arguments))
        return builder.trunc(builder.lshr(product, ir.Constant(wide, 64)), ir.IntType(64))

    return types.uint64(types.uint64, types.uint64), emit


_high_word: Any = intrinsic(_type_high_word)


@inlined
def _advance_pcg(low: Any, high: Any, add_low: Any, add_high: Any) -> tuple[Any, Any]:
    """Return the next 128-bit state (low, high): state · multiplier + increment."""
    product = low * _PCG_LOW
    high = _high_word(low, _PCG_LOW) + high * _PCG_LOW + low * _PCG_HIGH + add_high
    low = product + add_low
    if low < product:
        high += _ONE
    return low, high


@inlined
def _pcg_word(low: Any, high: Any) -> Any:
    """Return the word of a state: upper xor lower half, rotated by the top six bits (XSL-RR)."""
    word = high ^ low
    turn = high >> _58
    return (word >> turn) | (word << ((_64 - turn) & _63))


@inlined
def _philox_words(
    low: Any, high: Any, third: Any, key_low: Any, key_high: Any
) -> tuple[Any, Any, Any, Any]:
    """Return the four words of a counter (low, high, third, 0): ten rounds."""
    c0, c1, c2, c3 = low, high, third, _ZERO
    for _ in range(10):
        high0, high1 = _high_word(_PHILOX_M0, c0), _high_word(_PHILOX_M1, c2)
        low0, low1 = _PHILOX_M0 * c0, _PHILOX_M1 * c2
        c0, c1, c2, c3 = high1 ^ c1 ^ key_low, low1, high0 ^ c3 ^ key_high, low0
        key_low += _PHILOX_W0
        key_high += _PHILOX_W1
    return c0, c1, c2, c3


@inlined
def _refill_philox(source: Any, raws: Any) -> None:
    source.state_low += _ONE  # a block of ticks never gets near 2^64 draws
    raws[0], raws[1], raws[2], raws[3] = _philox_words(
        source.state_low,
        source.state_high,
        source.state_third,
        source.fixed_low,
        source.fixed_high,
    )
    source.position = 0


@inlined
def _next_word(source: Any, raws: Any) -> Any:
    if source.philox == 0:
        source.state_low, source.state_high = _advance_pcg(
            source.state_low, source.state_high, source.fixed_low, source.fixed_high
        )
        return _pcg_word(source.state_low, source.state_high)
    if source.position == raws.size:
        _refill_philox(source, raws)
    source.position += 1
    return raws[source.position - 1]


@inlined
def _next_uniform(source: Any, raws: Any) -> float:
    return float(_next_word(source, raws) >> _ELEVEN) * (1.0 / 9007199254740992.0)


@njit(error_model="numpy")
def _finish_normal(source: Any, raws: Any, word: Any) -> float:
    """Return the normal that begins with a word; the whole ziggurat, with wedges and tail."""
    while True:
        layer = word & _BYTE
        magnitude = (word >> _NINE) & _MANTISSA
        x: float = float(magnitude) * _SIGNED_W[word & _SIGNED_BYTE]
        if magnitude < _K[layer]:
            return x
        if layer == _ZERO:
            while True:
                beyond = -_INVERSE_TAIL_START * math.log1p(-_next_uniform(source, raws))
                height = -math.log1p(-_next_uniform(source, raws))
                if height + height > beyond * beyond:
                    far = _TAIL_START + beyond
                    return -far if (magnitude >> _EIGHT) & _ONE else far
        f_inner, f_outer = _F[layer - _ONE], _F[layer]
        if (f_inner - f_outer) * _next_uniform(source, raws) + f_outer < math.exp(-0.5 * x * x):
            return x
        word = _next_word(source, raws)


@inlined
def draw_pcg(source: Any, raws: Any, table: Any, row: int, columns: int) -> None:
    """Fill `table[row:, :columns]` with the next normals of a PCG64, row by row."""
    low, high = source.state_low, source.state_high
    for k in range(row, table.shape[0]):
        for j in range(columns):
            low, high = _advance_pcg(low, high, source.fixed_low, source.fixed_high)
            word = _pcg_word(low, high)
            layer = word & _BYTE
            magnitude = (word >> _NINE) & _MANTISSA
            if magnitude < _K[layer]:  # 99 % of the draws end here
                table[k, j] = float(magnitude) * _SIGNED_W[word & _SIGNED_BYTE]
            else:
                source.state_low, source.state_high = low, high
                table[k, j] = _finish_normal(source, raws, word)
                low, high = source.state_low, source.state_high
    source.state_low, source.state_high = low, high


@inlined
def draw_philox(
    source: Any, raws: Any, table: Any, column: int, seed: Any, stream: int, block: int
) -> None:
    """Fill `table[:, column]` from `Philox(key=[low, stream], counter=[0, block, high, 0])`.

    `seed` is (low, high), the two words of a seed of 128 bits.
    """
    source.philox = 1
    source.state_low, source.state_high, source.state_third = _ZERO, _U(block), seed[1]
    source.fixed_low, source.fixed_high = seed[0], _U(stream)
    k = 0
    while k < table.shape[0]:
        _refill_philox(source, raws)
        while source.position < raws.size and k < table.shape[0]:
            word = raws[source.position]
            source.position += 1
            layer = word & _BYTE
            magnitude = (word >> _NINE) & _MANTISSA
            if magnitude < _K[layer]:  # 99 % of the draws end here
                table[k, column] = float(magnitude) * _SIGNED_W[word & _SIGNED_BYTE]
            else:
                table[k, column] = _finish_normal(source, raws, word)
            k += 1


@inlined
def _hash(value: Any, constant: Any, factor: Any) -> tuple[Any, Any]:
    """Return the hash of a 32-bit word, and the constant of the next one."""
    value ^= constant
    constant = (constant * factor) & _WORD
    value = (value * constant) & _WORD
    return value ^ (value >> _16), constant


@njit(error_model="numpy")
def seed_pcg64(source: Any, seed: Any) -> None:
    """Set a source to the state of numpy's `default_rng(seed)`; `seed` is its words (low, high)."""
    pool = np.zeros(_POOL_WORDS, np.uint64)
    pool[0], pool[1] = seed[0] & _WORD, seed[0] >> _32
    pool[2], pool[3] = seed[1] & _WORD, seed[1] >> _32
    constant = _POOL_START
    for i in range(_POOL_WORDS):
        pool[i], constant = _hash(pool[i], constant, _POOL_FACTOR)
    for i in range(_POOL_WORDS):
        for j in range(_POOL_WORDS):
            if i != j:
                word, constant = _hash(pool[i], constant, _POOL_FACTOR)
                mixed = (_MIX_LEFT * pool[j] - _MIX_RIGHT * word) & _WORD
                pool[j] = mixed ^ (mixed >> _16)
    words = np.zeros(_POOL_WORDS, np.uint64)
    constant = _STATE_START
    for i in range(2 * _POOL_WORDS):
        word, constant = _hash(pool[i % _POOL_WORDS], constant, _STATE_FACTOR)
        words[i // 2] |= word << _32 if i % 2 else word
    # PCG's own seeding: the increment is odd, the state is advanced before and after the seed.
    source.philox = 0
    source.fixed_low = (words[3] << _ONE) | _ONE
    source.fixed_high = (words[2] << _ONE) | (words[3] >> _63)
    low = source.fixed_low + words[1]
    high = source.fixed_high + words[0] + (_ONE if low < words[1] else _ZERO)
    source.state_low, source.state_high = _advance_pcg(
        low, high, source.fixed_low, source.fixed_high
    )
