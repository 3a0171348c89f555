"""The value of a real parameter with which a kernel gives the record: sought to the last bit."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from typing import Any, Final

import numpy as np

from gap_diagnosis.firmware.candidates import Candidate, RealParameter
from gap_diagnosis.firmware.cells import cell_about
from gap_diagnosis.firmware.workbench import Workbench
from gap_diagnosis.recording import Floats

_LEAST_WIDTH: Final = 2.0**-46
_CELLS: Final = tuple(sign * step for step in range(1, 17) for sign in (1, -1))
"""So many steps of the kernel's resolution beside the best value are tried as well: the cell that
gives the record shows in no other, and a step beside it many digits may be others."""
_NEIGHBOURS: Final = tuple(s * 2.0**-k for k in (46, 45, 44, 36, 30, 29) for s in (1, -1))


@dataclass(frozen=True)
class Sought:
    """A search of one real parameter.

    Attributes:
        bench: what the record is held against.
        parameter: the parameter.
        changes, timing: what else is different from the described program.
    """

    bench: Workbench
    parameter: RealParameter
    changes: Mapping[str, Any]
    timing: Mapping[str, Any]

    def found(self) -> tuple[list[Candidate], bool]:
        """Return the value, or its rivals where none does, and whether it gives the record's bits.

        Where no value gives them, it is known as well as the misfit lets it be.
        """
        parameter, best = self.parameter, self._nearest()
        if abs(best) < parameter.small:
            return [parameter.unseen()], False
        values = [best]
        if self._is_near(best):
            if whole := self._whole(chain([best], self._cells(best))):
                return whole, True
            best = self.bench.polish(self._pose_at, best, self._width(best))
        if self._is_near(best):
            values.append(best)
            spread = max(abs(best), 1.0)
            values += [best + step * spread for step in _NEIGHBOURS]
            values += [round(best, digits) for digits in range(3, 12)]
            if whole := self._whole(chain(values, self._cells(best))):
                return whole, True
        width = self._width(best)
        return [
            parameter.at(value, width) for value in sorted(set(values)) if self._is_in(value)
        ], False

    def _pose_at(self, value: float) -> Floats | None:
        parameter = self.parameter
        changes = {**self.changes, **parameter.fixed, parameter.field: value}
        program = self.bench.program(changes, **self.timing)
        return None if program is None else self.bench.poses(program)

    def _nearest(self) -> float:
        """Return the value whose pose comes nearest, by ever dearer searches."""
        bench, low, high = self.bench, self.parameter.low, self.parameter.high
        best = bench.solve(self._pose_at, low, high)
        if not self._is_near(best):
            # Where a word of the position runs over, places leap; turns do not.
            turned = bench.solve(bench.turns_of(self._pose_at), low, high)
            best = min(best, turned, key=self._distance)
        if not self._is_near(best):
            begin = bench.nearest(self._pose_at, low, high)
            best = min(best, bench.solve(self._pose_at, low, high, begin), key=self._distance)
        return best

    def _distance(self, value: float) -> float:
        return self.bench.distance(self._pose_at, value)

    def _is_near(self, value: float) -> bool:
        pose = self._pose_at(value)
        return pose is not None and self.bench.is_near(pose)

    def _is_in(self, value: float) -> bool:
        """Tell whether a value is one that the effect has: in its range, and not neutral."""
        return self.parameter.low <= value <= self.parameter.high and value != 0.0

    def _is_equal(self, value: float) -> bool:
        pose = self._pose_at(value) if self._is_in(value) else None
        return pose is not None and self.bench.is_equal(pose)

    def _whole(self, values: Iterable[float]) -> list[Candidate]:
        """Return the first of these values that gives the record's bits, with its cell."""
        parameter = self.parameter
        for value in values:
            if self._is_equal(value):
                low, high = cell_about(value, self._is_equal, parameter.low, parameter.high)
                middle = 0.5 * (low + high)
                # Between values that give the record's bits lie some that do not.
                sure = middle if self._is_equal(middle) else value
                return [parameter.at(sure, 0.5 * (high - low))]
        return []

    def _cells(self, value: float) -> Iterator[float]:
        """Yield values in the cells beside that of *value*, the nearest first."""
        pose = self._pose_at(value)

        def is_same(at: float) -> bool:
            other = self._pose_at(at)
            return (
                pose is not None
                and other is not None
                and np.array_equal(other, pose, equal_nan=True)
            )

        low, high = cell_about(value, is_same, self.parameter.low, self.parameter.high)
        yield from (0.5 * (low + high) + step * (high - low) for step in _CELLS)

    def _width(self, best: float) -> float:
        """Return how far the value may be from the best one that the misfit alone finds."""
        loose = self.bench.looseness(self._pose_at, best)
        return max(_LEAST_WIDTH, 2.0 * self.bench.resolution, loose)


def sought_together(
    bench: Workbench, first: RealParameter, second: RealParameter
) -> Iterator[tuple[RealParameter, Candidate, RealParameter]]:
    """Yield each of two parameters with about the value it has beside the other, and the other."""
    both = (first, second)

    def pose_at(values: Floats) -> Floats | None:
        changes = {one.field: float(at) for one, at in zip(both, values, strict=True)}
        program = bench.program({**first.fixed, **second.fixed, **changes})
        return None if program is None else bench.poses(program)

    low, high = (np.array([getattr(one, end) for one in both]) for end in ("low", "high"))
    best = bench.solve_together(pose_at, low, high, np.zeros(2))
    for one, at, other in zip(both, best.tolist(), reversed(both), strict=True):
        yield one, one.at(at, _LEAST_WIDTH), other
