"""What a diagnosis shows beside its numbers: arrays to draw from, kept out of OUT.json."""

from __future__ import annotations

from dataclasses import dataclass

from gap_diagnosis.recording import Floats
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.touching import stages_that_touch


@dataclass(frozen=True)
class ResidualSeries:
    """One stage's residual over the log.

    Attributes:
        stage: whose data it speaks of.
        name: what is compared, as in ``encoder heading - reference heading``.
        unit: SI.
        t_s: float64[n], time of the log's clock.
        value: float64[n], as described; NaN where unknown.
        explained: float64[n], with the winning effects on; None where they do not change it.
        is_sum: it adds up over the log: what arises is its change over a while, not its jitter.
    """

    stage: str
    name: str
    unit: str
    t_s: Floats
    value: Floats
    explained: Floats | None = None
    is_sum: bool = True

    @property
    def touched_by(self) -> tuple[str, ...]:
        """The stages whose effects can show in it."""
        return stages_that_touch(self.name)


@dataclass(frozen=True)
class ResidualMap:
    """When each residual arises; rows do not compare, for each is a share of itself.

    Attributes:
        edges_s: float64[w + 1], borders of the time windows.
        stages: the rows' names.
        belongs: whose data each row speaks of.
        shares: float64[stages, w], share of the row's own energy that arises in a time window;
            each row sums to 1.
    """

    edges_s: Floats
    stages: tuple[str, ...]
    shares: Floats
    belongs: tuple[str, ...] = ()


@dataclass(frozen=True)
class HeldOutPath:
    """The same stretch three times; each float64[n, 2], x and y [m], started from one pose.

    Attributes:
        name: the log, or the stretch of it.
        reference: measured; None without a reference.
        before: the simulation as described.
        after: with the winning effects on; None where there are none.
    """

    name: str
    reference: Floats | None
    before: Floats
    after: Floats | None


@dataclass(frozen=True)
class Pictures:
    """All that a report draws; every part may be missing.

    Attributes:
        residuals, residual_map, paths: see there.
        missing: residuals without a row in the map, and why: the log may have no data for them.
    """

    residuals: tuple[ResidualSeries, ...] = ()
    residual_map: ResidualMap | None = None
    paths: tuple[HeldOutPath, ...] = ()
    missing: tuple[str, ...] = ()


@dataclass(frozen=True)
class Report:
    """A diagnosis and the pictures that go with it."""

    diagnosis: Diagnosis
    pictures: Pictures
