"""What a batch is given: arrays of runs and ticks that belong together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from firmware_model.config import KernelConfig
from firmware_model.errors import FirmwareError
from firmware_model.state import FRESH

Int64Array: TypeAlias = npt.NDArray[np.int64]


@dataclass(frozen=True)
class BatchInputs:
    """One configuration per run, arrays of [runs, ticks] whose ticks lie side by side."""

    configs: tuple[KernelConfig, ...]
    runs: int
    ticks: int
    left: Int64Array
    right: Int64Array
    encoder: npt.NDArray[np.int8]
    gyro: Int64Array
    gyro_valid: npt.NDArray[np.int8]

    @classmethod
    def of(
        cls,
        config: KernelConfig | Sequence[KernelConfig],
        left_count: npt.ArrayLike,
        right_count: npt.ArrayLike,
        gyro_code: npt.ArrayLike,
        encoder_validity: npt.ArrayLike | None,
        gyro_validity: npt.ArrayLike | None,
    ) -> BatchInputs:
        """Check what belongs together. Raises FirmwareError as `run_batch` says."""
        inputs = {
            "left_count": _counts("left_count", left_count),
            "right_count": _counts("right_count", right_count),
            "gyro_code": _counts("gyro_code", gyro_code),
        }
        configs = (config,) if isinstance(config, KernelConfig) else tuple(config)
        ticks = inputs["left_count"].shape[1]
        sizes = {one.shape[0] for one in inputs.values()} - {1} or {1}
        runs = max(sizes) if sizes != {1} else len(configs)
        if len(configs) == 1:
            configs = configs * runs
        if len(configs) != runs:
            raise FirmwareError(
                f"config: {len(configs)} configurations for {runs} runs: expected one per run"
            )
        arrays = {name: _spread(name, one, runs, ticks) for name, one in inputs.items()}
        return cls(
            configs=configs,
            runs=runs,
            ticks=ticks,
            left=arrays["left_count"],
            right=arrays["right_count"],
            encoder=_validity("encoder_validity", encoder_validity, runs, ticks),
            gyro=arrays["gyro_code"],
            gyro_valid=_validity("gyro_validity", gyro_validity, runs, ticks),
        )


def _counts(name: str, values: npt.ArrayLike) -> Int64Array:
    array = np.asarray(values)
    if array.dtype.kind not in "iu" or array.ndim != 2:
        raise FirmwareError(
            f"{name}: {array.dtype} array of shape {array.shape}: "
            "expected integers of shape [runs, ticks]"
        )
    return _without_gaps(array.astype(np.int64, copy=False))


def _spread(name: str, array: Any, runs: int, ticks: int) -> Any:
    if array.shape[1] != ticks or array.shape[0] not in (1, runs):
        raise FirmwareError(f"{name}: shape {array.shape}: expected ({runs}, {ticks})")
    return np.broadcast_to(array, (runs, ticks))


def _validity(name: str, values: npt.ArrayLike | None, runs: int, ticks: int) -> Any:
    if values is None:
        return _spread(name, np.full((1, ticks), FRESH, np.int8), runs, ticks)
    array = np.asarray(values)
    if array.dtype.kind not in "iu" or array.ndim != 2:
        raise FirmwareError(
            f"{name}: {array.dtype} array of shape {array.shape}: "
            "expected integers of shape [runs, ticks]"
        )
    if array.size and (array.min() < 0 or array.max() > 127):
        raise FirmwareError(f"{name}: values {array.min()} to {array.max()}: expected 0, 1 or 2")
    return _spread(name, _without_gaps(array.astype(np.int8, copy=False)), runs, ticks)


def _without_gaps(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Return the array, or a copy, with the ticks of a run beside each other in memory."""
    return array if array.strides[1] == array.itemsize else np.ascontiguousarray(array)
