"""One kernel source for two worlds: marks what runs as plain Python and as machine code."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from numba.extending import register_jitable

_Function = TypeVar("_Function", bound=Callable[..., object])


def kernel_function(function: _Function) -> _Function:
    """Return *function* unchanged for Python, and callable from compiled code.

    Called from Python it stays the readable oracle on unbounded ints; called from a compiled
    function numba translates the same text to 64-bit machine integers.
    """
    return register_jitable(forceinline=True)(function)


def rare_kernel_function(function: _Function) -> _Function:
    """Mark a function like `kernel_function`, for what few ticks need: it stays a call.

    Keeping it out of line keeps the path of a usual tick short and dense.
    """
    return register_jitable(function)
