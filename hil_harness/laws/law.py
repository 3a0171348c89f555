"""What a law is, and what checking it yields."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from hil_harness.laws.picture import Panel
from hil_harness.laws.statistics import Interval, Split

if TYPE_CHECKING:
    from hil_harness.laws.bench import Bench


@dataclass(frozen=True)
class Check:
    """One number that a law predicts, beside what was measured.

    Attributes:
        law: name of the number in the JSON list, unique among all checks.
        predicted: by the law.
        measured: on the plant and the firmware.
        tolerance: largest accepted distance between the two.
        unit: of the three numbers above, "1" for a ratio.
        derivation: where the tolerance comes from, one sentence.
        interval: confidence interval of the measured value, where it is random.
        false_alarm: probability that a correct implementation fails this check; 0 where the
            tolerance is a bound.
    """

    law: str
    predicted: float
    measured: float
    tolerance: float
    unit: str
    derivation: str
    interval: Interval | None = None
    false_alarm: float = 0.0

    @property
    def passed(self) -> bool:
        """True when prediction and measurement agree; a NaN never agrees."""
        return abs(self.measured - self.predicted) <= self.tolerance


@dataclass(frozen=True)
class Evidence:
    """What checking a law yields.

    Attributes:
        checks: predicted and measured numbers.
        panels: the picture, side by side where there is room; it goes on to where the law breaks.
        caption: what the picture shows, in words.
        splits: errors over several seeds, each split into systematic and random part.
    """

    checks: tuple[Check, ...]
    panels: tuple[Panel, ...]
    caption: str
    splits: tuple[Split, ...] = field(default=())


@dataclass(frozen=True)
class Law:
    """One law of dead reckoning and how to check it.

    Attributes:
        name: short name, a Python identifier; the names of its checks begin with it.
        title: the law in a few words.
        formula: the law in symbols.
        validity: where the law holds, and what breaks it.
        source: author and year.
        measure: checks the law on a bench.
    """

    name: str
    title: str
    formula: str
    validity: str
    source: str
    measure: Callable[[Bench], Evidence]
