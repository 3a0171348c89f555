"""The C99 kernel in the place of the compiled one: one tick, or many runs of many ticks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from firmware_model.c99_layout import (
    Int32Array,
    Int64Array,
    Records,
    config_record,
    config_tables,
    put,
    struct_dtype,
)
from firmware_model.c99_library import FLAGS, library
from firmware_model.config import KernelConfig, require_c
from firmware_model.state import STATE_FIELDS


@dataclass(frozen=True)
class C99Config:
    """A configuration as C sees it, with the tables that its pointers lead to."""

    record: Records
    sine_table: Int32Array
    cordic_table: Int64Array

    @property
    def address(self) -> int:
        """Where the record lies."""
        return self.record.ctypes.data


def c99_config(config: KernelConfig) -> C99Config:
    """Return *config* for the C kernel.

    Raises:
        FirmwareError: a value that its C field cannot hold.
    """
    require_c(config)
    sines, angles = config_tables(config)
    record = config_record(config, sines.ctypes.data, angles.ctypes.data)
    return C99Config(record, sines, angles)


class C99Kernel:
    """One state of the C kernel.

    Args:
        config: from `build_config`.
        flags: of the compiler.

    Raises:
        FirmwareError: no C compiler, or one that does not compile the sources.
    """

    def __init__(self, config: KernelConfig, flags: Sequence[str] = FLAGS) -> None:
        self._library = library(tuple(flags))
        self._states = np.zeros(1, struct_dtype("chiplog_state"))
        self.record = self._states[0]
        self._address = self._states.ctypes.data
        self._step: Callable[..., None] = self._library.chiplog_host_step
        self.configure(config)
        self._library.chiplog_host_start(self._address, self._config.address)

    def configure(self, config: KernelConfig) -> None:
        """Go on under another configuration; the state stays as it is."""
        self._config = c99_config(config)
        self._arguments = self._address, self._config.address

    def step(self, *inputs: int) -> None:
        """Take one tick's inputs, as `Kernel.step` has them, each within int64."""
        self._step(*self._arguments, *inputs)

    def run(self, ticks: Int64Array) -> None:
        """Take many ticks' inputs, int64[n, 5]; validities beyond 8 bits count as INVALID."""
        left, right, encoder, code, gyro = np.ascontiguousarray(ticks.T)
        validities = [
            np.where((one >= 0) & (one <= 2), one, 2).astype(np.int8) for one in (encoder, gyro)
        ]
        columns = left, right, validities[0], code, validities[1]
        addresses = [one.ctypes.data for one in columns]
        self._library.chiplog_host_run(*self._arguments, len(ticks), *addresses, None, None, None)

    def state(self) -> dict[str, int]:
        """Return the full state, as `Kernel.state` does."""
        return {name: int(self.record[name]) for name in STATE_FIELDS}

    def load_state(self, state: Mapping[str, int]) -> None:
        """Continue from a state.

        Raises:
            FirmwareError: a value that no kernel reaches.
        """
        changed = self._states.copy()
        for name, value in state.items():
            put(changed, name, value)
        self._states[:] = changed

    @property
    def v_m_s_q(self) -> int:
        """Low-passed forward speed, in velocity_frac_bits."""
        return int(self._library.chiplog_host_speed(*self._arguments))

    @property
    def w_rad_s_q(self) -> int:
        """Low-passed turn rate, in velocity_frac_bits."""
        return int(self._library.chiplog_host_turn_rate(*self._arguments))


def c99_batch(
    configs: Sequence[KernelConfig], flags: Sequence[str] = FLAGS
) -> tuple[Callable[..., None], Records]:
    """Return what steps a slice of runs through all of its ticks, and the runs' states.

    The function takes a slice, the five inputs [runs, ticks] in the kernel's order, and pose_q,
    status and heading_source [runs, ticks, …] or arrays of no runs; ticks lie side by side.
    """
    loaded = library(tuple(flags))
    unique: dict[int, C99Config] = {}
    for config in configs:
        if id(config) not in unique:
            unique[id(config)] = c99_config(config)
    states = np.zeros(len(configs), struct_dtype("chiplog_state"))

    def batch(part: slice, inputs: Sequence[Any], outputs: Sequence[Any]) -> None:
        for run in range(part.start, part.stop):
            where = states[run : run + 1].ctypes.data, unique[id(configs[run])].address
            kept = [one[run].ctypes.data if len(one) else None for one in outputs]
            rows = [one[run] for one in inputs]
            loaded.chiplog_host_start(*where)
            loaded.chiplog_host_run(*where, rows[0].size, *(row.ctypes.data for row in rows), *kept)

    return batch, states
