"""The kernel as machine code, compiled once per machine and cached on disk."""

from __future__ import annotations

import hashlib
from collections import namedtuple
from collections.abc import Callable
from functools import lru_cache
from importlib.resources import files
from typing import Any, Final, Literal, cast

import numba
import numpy as np
import numpy.typing as npt
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from firmware_model.config import CONFIG_DTYPE, CONFIG_FIELDS
from firmware_model.state import FRESH, INVALID, STATE_DTYPE
from firmware_model.step import step_kernel
from firmware_model.twin import TWIN_CONFIG_DTYPE, TWIN_DTYPE, step_twin


@lru_cache(maxsize=1)
def compiled_step() -> Callable[..., None]:
    """Return one tick as machine code: from numba's cache if it is there, else compiled now.

    The cache lies beside the package or, where that is read-only, in the user's cache folder;
    where neither can be written the code is compiled anew in each process.
    """
    return _compile(_step_entry(_source_digest()), _STEP_SIGNATURE)


@lru_cache(maxsize=1)
def compiled_batch() -> Callable[..., None]:
    """Return many runs of many ticks as machine code, cached like `compiled_step`."""
    return _compile(_batch_entry(_source_digest()), _BATCH_SIGNATURE)


def run_compiled(states: Any, configs: Any, table: Any, inputs: npt.NDArray[np.int64]) -> None:
    """Step one state through many ticks; validities beyond 8 bits count as INVALID.

    Args:
        states, configs: arrays of one record.
        table: of the sine or of CORDIC.
        inputs: int64[n, 5] in the order of `Kernel.step`.
    """
    left, right, encoder, code, gyro = np.ascontiguousarray(inputs.T)[:, None, :]
    encoder, gyro = (
        np.where((one >= FRESH) & (one <= INVALID), one, INVALID).astype(np.int8)
        for one in (encoder, gyro)
    )
    nothing = (
        np.empty((0, 0, 3), dtype=np.int64),
        np.empty((0, 0), dtype=np.int32),
        np.empty((0, 0), dtype=np.int8),
        np.empty((0, 0, 3), dtype=np.float64),
    )
    no_twin = np.empty(0, TWIN_DTYPE), np.empty(0, TWIN_CONFIG_DTYPE)
    given = (left, right, encoder, code, gyro)
    compiled_batch()(states, configs, table, *given, *no_twin, *nothing)


def _source_digest() -> int:
    """Return a number that changes with any module of this package."""
    digest = hashlib.sha256()
    for entry in sorted(files("firmware_model").iterdir(), key=lambda one: one.name):
        if entry.name.endswith(".py"):
            digest.update(entry.name.encode())
            digest.update(entry.read_bytes())
    return int.from_bytes(digest.digest()[:7], "little")


def _compile(function: Callable[..., None], signature: Any) -> Callable[..., None]:
    try:
        compiled = numba.njit(signature, cache=True, nogil=True)(function)
    except RuntimeError:  # numba found no folder that it may write to
        compiled = numba.njit(signature, nogil=True)(function)
    result: Callable[..., None] = compiled
    return result


def _type_data_pointer(typing_context: Any, array: Any) -> Any:
    """Tell numba the type and the code of `data_pointer`."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.make_array(signature.args[0])(context, builder, arguments[0]).data

    pointer: Any = types.CPointer  # numba does not state this constructor's types
    return pointer(array.dtype)(array), codegen


data_pointer: Final[Callable[[Any], Any]] = cast(Any, intrinsic(_type_data_pointer))
"""Return a C pointer to an array of one dimension without gaps; only in compiled code.

It is indexed like the array but not reference-counted at each call, which would cost more than
the arithmetic and make the threads wait for each other. The array must outlive it.
"""


_ConfigValues: Final = namedtuple("_ConfigValues", CONFIG_FIELDS)  # type: ignore[misc]  # no literal


def _type_config_values(typing_context: Any, record: Any) -> Any:
    """Tell numba the type and the code of `config_values`."""

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = context.get_data_type(types.int64)
        member: Any = cgutils.get_record_member  # numba does not state its types
        values = [
            builder.load(member(builder, arguments[0], record.offset(name), word))
            for name in CONFIG_FIELDS
        ]
        return context.make_tuple(builder, signature.return_type, values)

    uniform: Any = types.NamedUniTuple
    return uniform(types.int64, len(CONFIG_FIELDS), _ConfigValues)(record), codegen


config_values: Final[Callable[[Any], Any]] = cast(Any, intrinsic(_type_config_values))
"""Return a configuration record's fields as a named tuple of int64; only in compiled code.

A loop over ticks then knows that no store to the state changes them: masks, half quanta and
the like are computed once a run.
"""


def _array(
    dtype: Any, dimensions: int, layout: Literal["C", "A"] = "C", *, readonly: bool = False
) -> Any:
    return types.Array(dtype, dimensions, layout, readonly=readonly)


_STATES: Final = _array(numba.from_dtype(STATE_DTYPE), 1)
_CONFIGS: Final = _array(numba.from_dtype(CONFIG_DTYPE), 1)
_TWINS: Final = _array(numba.from_dtype(TWIN_DTYPE), 1)
_TWIN_CONFIGS: Final = _array(numba.from_dtype(TWIN_CONFIG_DTYPE), 1)
_TABLE: Final = _array(types.int64, 1)
_INPUTS: Final = _array(types.int64, 2, "A", readonly=True)
_VALIDITIES: Final = _array(types.int8, 2, "A", readonly=True)

_STEP_SIGNATURE: Final = types.void(_STATES, _CONFIGS, _TABLE, *([types.int64] * 5))
_BATCH_SIGNATURE: Final = types.void(
    _STATES,
    _CONFIGS,
    _TABLE,
    _INPUTS,
    _INPUTS,
    _VALIDITIES,
    _INPUTS,
    _VALIDITIES,
    _TWINS,
    _TWIN_CONFIGS,
    _array(types.int64, 3),
    _array(types.int32, 2),
    _array(types.int8, 2),
    _array(types.float64, 3),
)


def _step_entry(source_digest: int) -> Callable[..., None]:
    """Return the function that numba compiles for one tick.

    numba keys its disk cache on a function's own file and closure, not on the functions that it
    calls. The digest of all sources is therefore part of the closure: an edited kernel is never
    mistaken for the cached one.
    """

    def step(
        states: Any,
        configs: Any,
        table: Any,
        left_count: int,
        right_count: int,
        encoder_validity: int,
        gyro_code: int,
        gyro_validity: int,
    ) -> None:
        if source_digest >= 0:
            step_kernel(
                states[0],
                configs[0],
                data_pointer(table),
                left_count,
                right_count,
                encoder_validity,
                gyro_code,
                gyro_validity,
            )

    return step


def _batch_entry(source_digest: int) -> Callable[..., None]:
    """Return the function that numba compiles for a batch; the digest is as in `_step_entry`."""

    def batch(
        states: Any,
        configs: Any,
        table: Any,
        left_count: Any,
        right_count: Any,
        encoder_validity: Any,
        gyro_code: Any,
        gyro_validity: Any,
        twins: Any,
        twin_configs: Any,
        pose_q: Any,
        status: Any,
        heading_source: Any,
        twin_pose: Any,
    ) -> None:
        """Step each run through all of its ticks; an output of no runs is not wanted.

        The ticks of one run lie one beside the other in each input.
        """
        if source_digest < 0:
            return
        pointer = data_pointer(table)
        for run in range(states.shape[0]):
            state = states[run]
            config = config_values(configs[run])
            lefts = data_pointer(left_count[run])
            rights = data_pointer(right_count[run])
            codes = data_pointer(gyro_code[run])
            encoders = data_pointer(encoder_validity[run])
            gyros = data_pointer(gyro_validity[run])
            for tick in range(left_count.shape[1]):
                step_kernel(
                    state,
                    config,
                    pointer,
                    lefts[tick],
                    rights[tick],
                    encoders[tick],
                    codes[tick],
                    gyros[tick],
                )
                if pose_q.shape[0] > 0:
                    pose_q[run, tick, 0] = state.x_m_q
                    pose_q[run, tick, 1] = state.y_m_q
                    pose_q[run, tick, 2] = state.heading_turn_q
                    status[run, tick] = state.status
                    heading_source[run, tick] = state.heading_source
                if twins.shape[0] > 0:
                    step_twin(twins[run], twin_configs[run], state)
                    if twin_pose.shape[0] > 0:
                        twin_pose[run, tick, 0] = twins[run].x_m
                        twin_pose[run, tick, 1] = twins[run].y_m
                        twin_pose[run, tick, 2] = twins[run].heading_rad

    return batch
