"""The codes' block: stuck bits, missing codes, a frozen gyro, a flat top."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from gap_diagnosis.codes.bits import missing_codes, stuck_bits
from gap_diagnosis.codes.data import CodeData, code_data
from gap_diagnosis.codes.frozen import frozen_prior, frozen_run
from gap_diagnosis.codes.saturation import FlatTop, flat_top
from gap_diagnosis.hypothesis import Estimate, Fit, generator_of
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot

Floats = NDArray[np.float64]

_SAMPLES: Final = 2000
_NOTHING_SEEN: Final = -1.0
"""Log evidence of an effect that should show on most logs and left no trace on this one."""
_LIMITS: Final = 1.0 / default_prior().ranges["gyro_saturation"]["share"][0]
"""The described limit over the least that is believed: log-uniform, in steps this fine."""


def codes_block(recording: Recording, robot: Robot) -> CodesBlock | None:
    """Return the block, or None where the log has no gyro."""
    data = code_data(recording, robot)
    return None if data is None else CodesBlock(data)


class CodesBlock:
    """Evidence for faults of the converter from the codes, with the wheels as witness.

    Only what the codes themselves show is weighed; what a fault does to the heading, the motion
    says.
    """

    name = "codes"

    def __init__(self, data: CodeData) -> None:
        self._data = data
        self._fits: dict[str, Fit] = {}

    @cached_property
    def effects(self) -> frozenset[str]:
        """The effects that this log's codes can tell."""
        always = {"gyro_frozen", "gyro_saturation"}
        of_converter = {"adc_missing_code", "adc_stuck_bit"} if self._data.is_whole else set()
        return frozenset(always | of_converter)

    def fit(self, effects: frozenset[str]) -> Fit:
        """Return the fit of these effects; each leaves a trace of its own."""
        fits = [self._single(name) for name in sorted(effects)]
        parameters: dict[str, Estimate] = {}
        for one in fits:
            parameters |= one.parameters
        return Fit(
            effects=tuple(sorted(effects)),
            log_evidence=sum(one.log_evidence for one in fits),
            log_likelihood=sum(one.log_likelihood for one in fits),
            parameters=parameters,
            windows=tuple(window for one in fits for window in one.windows),
            log_silent=fits[0].log_silent if len(fits) == 1 else -math.inf,
        )

    def _single(self, name: str) -> Fit:
        if name not in self._fits:
            make = {
                "adc_missing_code": self._missing,
                "adc_stuck_bit": self._stuck,
                "gyro_frozen": self._frozen,
                "gyro_saturation": self._saturation,
            }
            self._fits[name] = make[name]()
        return self._fits[name]

    def _stuck(self) -> Fit:
        found = stuck_bits(self._data)
        logs = np.array([one.log_ratio for one in found])
        if not np.isfinite(logs).any():
            return Fit(("adc_stuck_bit",), 2 * _NOTHING_SEEN - math.log(len(logs)), 0.0)
        weight = np.exp(logs - logs.max())
        weight /= weight.sum()
        bits: dict[str, float] = {}
        values: dict[str, float] = {}
        for one, part in zip(found, weight, strict=True):
            bits[str(one.bit)] = bits.get(str(one.bit), 0.0) + float(part)
            values[str(one.value)] = values.get(str(one.value), 0.0) + float(part)
        best = found[int(np.argmax(logs))]
        parameters = {
            "adc_stuck_bit.bit": Estimate(best.bit, probabilities=bits),
            "adc_stuck_bit.value": Estimate(best.value, probabilities=values),
        }
        evidence = float(logsumexp(logs)) - math.log(len(logs))
        windows, ends = self._acting("adc_stuck_bit", best.rows)
        parameters |= ends
        return Fit(("adc_stuck_bit",), evidence, max(best.log_ratio, 0.0), parameters, windows)

    def _acting(
        self, effect: str, rows: tuple[int, int] | None
    ) -> tuple[tuple[tuple[float, float], ...], dict[str, Estimate]]:
        """Return the window of an effect that acts in some rows alone, and that end of it which is
        not the log's own."""
        if rows is None:
            return (), {}
        time_s = self._data.t_s
        window = float(time_s[rows[0]]), float(time_s[rows[1] - 1])
        name, at = ("start_s", window[0]) if rows[0] else ("stop_s", window[1])
        even = generator_of([effect]).uniform(0, float(np.median(np.diff(time_s))), _SAMPLES)
        return (window,), _estimates({f"{effect}.{name}": at + (-even if rows[0] else even)})

    def _missing(self) -> Fit:
        codes, ratio = missing_codes(self._alive())
        price = self._data.bits * math.log(2.0)
        if len(codes) == 0 or not np.isfinite(ratio).any():
            return Fit(("adc_missing_code",), _NOTHING_SEEN, 0.0, log_silent=_NOTHING_SEEN)
        best = int(np.argmax(ratio))
        weight = np.exp(ratio - ratio[best])
        likely = np.argsort(-weight)[:5]
        chances = {
            str(int(codes[i])): float(weight[i] / weight.sum()) for i in likely if weight[i] > 0
        }
        parameters = {"adc_missing_code.code": Estimate(int(codes[best]), probabilities=chances)}
        unseen = math.log1p(-min(len(codes) / 2**self._data.bits, 0.9))
        evidence = float(np.logaddexp(logsumexp(ratio) - price, unseen))
        return Fit(
            ("adc_missing_code",),
            evidence,
            max(float(ratio[best]), 0.0),
            parameters,
            log_silent=unseen,
        )

    def _alive(self) -> Floats:
        """Return the codes but those of a frozen gyro, which says one of them over and over."""
        frozen = self._single("gyro_frozen")
        if frozen.log_evidence <= 0:
            return self._data.code
        ((start_s, stop_s),) = frozen.windows
        return self._data.code[(self._data.t_s < start_s) | (self._data.t_s > stop_s)]

    def _frozen(self) -> Fit:
        found = frozen_run(self._data, self._flat)
        if found is None:
            return Fit(("gyro_frozen",), 2 * _NOTHING_SEEN, 0.0)
        period = float(np.median(np.diff(self._data.t_s)))
        even = generator_of(["gyro_frozen"]).uniform(0, period, (2, _SAMPLES))
        evidence = max(found.log_ratio + frozen_prior(self._data), 2 * _NOTHING_SEEN)
        parameters = _estimates(
            {
                "gyro_frozen.start_s": found.start_s + even[0],
                "gyro_frozen.stop_s": found.stop_s + even[1],
            }
        )
        return Fit(
            ("gyro_frozen",),
            evidence,
            max(found.log_ratio, 0.0),
            parameters,
            ((found.start_s, found.stop_s),),
        )

    @cached_property
    def _flat(self) -> FlatTop | None:
        return flat_top(self._data)

    def _saturation(self) -> Fit:
        found = self._flat
        reach = float(np.max(np.abs(self._data.code - self._data.zero_code)))
        described = max(self._data.high - self._data.zero_code, 1.0)
        # A limit beyond what was reached leaves no trace: that share of the prior stands.
        reached = min(max(reach / described, 1.0 / _LIMITS), 1.0)
        beyond = min(max(-math.log(reached) / math.log(_LIMITS), 1e-3), 0.99)
        unseen = math.log(beyond)
        if found is None or found.log_ratio <= 0:
            return Fit(("gyro_saturation",), unseen, 0.0)
        evidence = float(np.logaddexp(found.log_ratio - 2 * math.log(_LIMITS), unseen))
        random = generator_of(["gyro_saturation"])
        draws = found.limit_rad_s + found.sd_rad_s * random.standard_normal(_SAMPLES)
        windows, ends = self._acting("gyro_saturation", found.rows)
        parameters = {**_estimates({"gyro_saturation.limit": draws}), **ends}
        return Fit(("gyro_saturation",), evidence, found.log_ratio, parameters, windows)


def _estimates(draws: Mapping[str, Floats]) -> dict[str, Estimate]:
    return {
        name: Estimate(float(values.mean()), float(values.std()), values)
        for name, values in draws.items()
    }
