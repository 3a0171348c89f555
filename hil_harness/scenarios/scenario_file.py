"""Scenario files: a drive written by a person, validated to the line."""

from pathlib import Path
from typing import Any, Final, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from hil_harness.effects.settings import effects_from_toml
from hil_harness.scenarios.model import Drive, Scenario
from hil_harness.scenarios.profile import Segment, SegmentProfile
from hil_harness.toml_model import validate
from hil_harness.toml_source import load_toml

LONGEST_S: Final = 7 * 24 * 3600.0
"""Longest scenario that is read: a week."""


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class SegmentTable(_Table):
    """One [[segments]] table: a stretch of constant speed and turn rate."""

    v_m_s: float = Field(
        default=0.0, ge=-100, le=100, description="speed forward [m/s]", examples=[0.5]
    )
    w_rad_s: float = Field(
        default=0.0, ge=-100, le=100, description="turn rate, anticlockwise [rad/s]", examples=[0.3]
    )
    duration_s: float = Field(
        gt=0, le=LONGEST_S, description="length in time, ramp included [s]", examples=[10.0]
    )
    ramp_s: float = Field(
        default=0.5,
        ge=0,
        le=LONGEST_S,
        description="time in which the speeds change to this segment's [s]",
        examples=[0.5],
    )

    @model_validator(mode="after")
    def _the_ramp_fits(self) -> Self:
        if self.ramp_s > self.duration_s:
            raise ValueError(
                f"a ramp of {self.ramp_s:g} s does not fit into {self.duration_s:g} s: "
                f"expected ramp_s of at most {self.duration_s:g}"
            )
        return self


class ScenarioTable(_Table):
    """A whole scenario file but for its [effects], which the effect catalogue reads."""

    name: str = Field(
        min_length=1,
        max_length=60,
        pattern=r"^[A-Za-z0-9_-]+$",
        description="letters, digits, - and _",
        examples=["two_arcs"],
    )
    description: str = Field(default="", max_length=200, examples=["a left arc, then a right one"])
    duration_s: float | None = Field(
        default=None,
        gt=0,
        le=LONGEST_S,
        description="length of the run [s]; rests after the last segment",
        examples=[60.0],
    )
    seed: int = Field(default=1, ge=0, le=2**63 - 1, description="of the noise", examples=[1])
    drive: Drive = Field(default="motor", description="motor dynamics, or none", examples=["motor"])
    segments: tuple[SegmentTable, ...] = Field(
        min_length=1, max_length=10_000, description="one after another, from rest"
    )

    @model_validator(mode="after")
    def _the_segments_fit(self) -> Self:
        total_s = sum(segment.duration_s for segment in self.segments)
        if total_s > LONGEST_S:
            raise ValueError(f"segments last {total_s:g} s: expected at most {LONGEST_S:g}")
        if self.duration_s is not None and self.duration_s < total_s * (1 - 1e-12):
            raise ValueError(
                f"duration_s = {self.duration_s:g} cuts off segments of {total_s:g} s: "
                f"expected at least {total_s:g}, or none"
            )
        return self


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario file.

    Raises HarnessError in one line with file, line and what would be right.
    """
    source = load_toml(path)
    own: dict[str, Any] = {key: value for key, value in source.data.items() if key != "effects"}
    table = validate(source, ScenarioTable, data=own)
    effects = effects_from_toml(source, ("effects",)) if "effects" in source.data else ()
    profile = SegmentProfile(
        [Segment(part.v_m_s, part.w_rad_s, part.duration_s, part.ramp_s) for part in table.segments]
    )
    return Scenario(
        name=table.name,
        description=table.description,
        profile=profile,
        duration_s=table.duration_s or profile.duration_s,
        drive=table.drive,
        effects=effects,
        seed=table.seed,
    )
