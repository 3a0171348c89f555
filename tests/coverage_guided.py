"""A small coverage-guided fuzzer: inputs that reach new lines of ours are kept and mutated."""

from __future__ import annotations

import random
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

ROOT = str(Path(__file__).parents[1])
MOST_LINES = 2_000_000
"""Of ours that one input may run: what is read in bounded time stays far below."""
MOST_BYTES = 1 << 16
MOST_WORDS = 1000
"""Characters of an error: a line for people."""
TOKENS = (
    b"\n",
    b"#",
    b"=",
    b"[",
    b"]",
    b'"',
    b"nan",
    b"-1",
    b"1e999",
    b"9" * 30,
    b"\0" * 8,
    b"\xff" * 4,
    b"LOBJ",
    b"0x",
    b" ",
    b"\r\n",
)


class TookTooLongError(AssertionError):
    """An input ran more lines than a file of its size deserves."""


class Lines:
    """Which lines of this repository ran while it was switched on."""

    def __init__(self) -> None:
        self.seen: set[tuple[CodeType, int]] = set()
        self.fresh = 0
        self._count = 0

    def _enter(self, frame: FrameType, event: str, argument: Any) -> Any:
        name = frame.f_code.co_filename
        return self._line if name.startswith(ROOT) and ".venv" not in name else None

    def _line(self, frame: FrameType, event: str, argument: Any) -> Any:
        self._count += 1
        if self._count > MOST_LINES:
            raise TookTooLongError(f"more than {MOST_LINES} lines")
        place = (frame.f_code, frame.f_lineno)
        if place not in self.seen:
            self.seen.add(place)
            self.fresh += 1
        return self._line

    def run(self, action: Callable[[], object]) -> int:
        """Run an action; return how many lines it was the first to reach."""
        self.fresh = self._count = 0
        before = sys.gettrace()
        sys.settrace(self._enter)
        try:
            action()
        finally:
            sys.settrace(before)
        return self.fresh


def explore(
    target: Callable[[bytes], object],
    seeds: Sequence[bytes],
    *,
    errors: tuple[type[Exception], ...],
    runs: int,
    seed: int = 0,
) -> int:
    """Feed mutated inputs to a reader; return how many lines of ours they reached.

    Any exception but `errors` comes out, with the input that raised it.
    """
    stream, lines, corpus = random.Random(seed), Lines(), list(seeds)

    def one(content: bytes) -> None:
        def attempt() -> None:
            said = ""
            try:
                target(content)
            except errors as error:
                said = str(error)
            assert "\n" not in said
            assert len(said) < MOST_WORDS

        try:
            fresh = lines.run(attempt)
        except Exception as error:
            raise AssertionError(f"{type(error).__name__}: {error}: of {content!r}") from error
        if fresh:
            corpus.append(content)

    for content in seeds:
        one(content)
    for _ in range(runs):
        # The newest reach furthest: every other mutation starts from one of them.
        of = corpus[-8:] if stream.random() < 0.5 else corpus
        one(mutated(stream, stream.choice(of), corpus))
    return len(lines.seen)


def mutated(stream: random.Random, content: bytes, corpus: Sequence[bytes]) -> bytes:
    """Return an input changed in one to four places."""
    data = bytearray(content)
    for _ in range(stream.randint(1, 4)):
        at = stream.randrange(len(data) + 1)
        stop = min(len(data), at + stream.choice((1, 1, 2, 4, 16, 100)))
        match stream.randrange(7):
            case 0 if at < len(data):
                data[at] ^= 1 << stream.randrange(8)
            case 1:
                data[at:stop] = b""
            case 2:
                data[at:at] = data[at:stop]
            case 3:
                data[at:stop] = stream.choice(TOKENS)
            case 4:
                data[at:at] = stream.choice(TOKENS)
            case 5:
                other = stream.choice(corpus)
                start = stream.randrange(len(other) + 1)
                data[at:] = other[start:]
            case _:
                data[at:stop] = stream.randbytes(stop - at)
    return bytes(data[:MOST_BYTES])
