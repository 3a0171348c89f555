"""Runs of the kernel in Python side by side, for configurations that C cannot hold.

Its integers have no width but that of their word, so what would leave 64 bits on the way is exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from firmware_model.config import KernelConfig
from firmware_model.kernel import initial_state
from firmware_model.state import STATE_DTYPE, STATE_FIELDS
from firmware_model.step import step_kernel
from firmware_model.twin import TWIN_DTYPE, Twin, build_twin_config, step_twin

Integers = npt.NDArray[np.int64] | npt.NDArray[np.object_]
"""int64, or Python's integers where a configuration is beyond C."""

_STATE_DTYPE: Final = np.dtype([(name, object) for name in STATE_FIELDS])


def integer_type(configs: Sequence[KernelConfig]) -> type[np.int64 | object]:
    """Return what holds the words of all of these: int64, or objects where one is beyond C."""
    return object if any(one.beyond_c for one in configs) else np.int64


class OracleRuns:
    """One kernel in Python and one float twin per run, which go on from where they are."""

    def __init__(self, configs: Sequence[KernelConfig]) -> None:
        """Put every run at power-on."""
        self._configs = configs
        self._states = [initial_state(one) for one in configs]
        self._twin_configs = [build_twin_config(one) for one in configs]
        self._twins = [Twin() for _ in configs]

    @property
    def overflow_count(self) -> npt.NDArray[np.int64]:
        """Overflows of each run since power-on."""
        return np.array([one.overflow_count for one in self._states])

    @property
    def states(self) -> npt.NDArray[np.void]:
        """The kernels' states: structured array [runs] with the fields of `State`."""
        dtype = _STATE_DTYPE if integer_type(self._configs) is object else STATE_DTYPE
        return np.array([astuple(one) for one in self._states], dtype)

    @property
    def twins(self) -> npt.NDArray[np.void]:
        """The twins' states: structured array [runs]."""
        return np.array([astuple(one) for one in self._twins], TWIN_DTYPE)

    def step(
        self, inputs: Sequence[npt.NDArray[Any]], histories: Sequence[npt.NDArray[Any]]
    ) -> None:
        """Step each run through the next ticks.

        Args:
            inputs: the five of `Kernel.step`, each integers [runs, ticks].
            histories: pose_q, status, heading_source and twin_pose of `BatchRuns`, to be filled;
                one of no runs is not wanted.
        """
        for run, (state, config) in enumerate(zip(self._states, self._configs, strict=True)):
            twin, twin_config = self._twins[run], self._twin_configs[run]
            kept = [one[run] if len(one) else None for one in histories]
            rows = (one[run].tolist() for one in inputs)
            for tick, given in enumerate(zip(*rows, strict=True)):
                step_kernel(state, config, config.table, *given)
                step_twin(twin, twin_config, state)
                told = (
                    (state.x_m_q, state.y_m_q, state.heading_turn_q),
                    state.status,
                    state.heading_source,
                    (twin.x_m, twin.y_m, twin.heading_rad),
                )
                for history, values in zip(kept, told, strict=True):
                    if history is not None:
                        history[tick] = values
