"""The words of the effect catalogue: effect, parameter, setting, and what settings add up to."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, TypeAlias, TypeVar

from can_bus import Disturbances
from firmware_model import FirmwareChanges
from hil_harness.effects.reference_errors import ReferenceErrors
from hil_harness.effects.setup_mistakes import SetupMistakes
from sim_plant import Mechanisms, MechanismSchedule

Stage: TypeAlias = Literal[
    "actuation", "wheel", "encoder", "gyro", "bus", "firmware", "reference", "setup"
]
"""Where an effect acts, in the order in which data flows."""

Value: TypeAlias = float | int | str
"""A parameter's value: a number, a whole number, or the name of a choice."""


@dataclass(frozen=True)
class Typical:
    """How large a parameter is in real robots, and who says so.

    Attributes:
        low: smaller end of its size (without sign), in the parameter's unit.
        high: larger end.
        source: a paper, data sheet or measurement.
    """

    low: float
    high: float
    source: str


@dataclass(frozen=True)
class EffectParameter:
    """One number (or choice) of an effect.

    Attributes:
        name: as in ``effect.name=value``.
        unit: SI; "1" for a ratio or a plain count, "" for a choice.
        neutral: the value at which the effect changes nothing; for a choice, its default.
        meaning: what the value says and which way its sign goes.
        kind: "real", "whole", "choice", or "message": the name of a message of the DBC in use.
        minimum: smallest value that makes sense.
        maximum: largest value that makes sense.
        choices: what a choice can be.
        typical: size in real robots; None where no source is known, or none applies.
    """

    name: str
    unit: str
    neutral: Value
    meaning: str
    kind: Literal["real", "whole", "choice", "message"] = "real"
    minimum: float = -math.inf
    maximum: float = math.inf
    choices: tuple[str, ...] = ()
    typical: Typical | None = None

    def expected(self) -> str:
        """Return in words what the parameter takes: ``a number from -1 to 1 [rad/s]``."""
        if self.kind == "choice":
            return f"one of {', '.join(self.choices)}"
        if self.kind == "message":
            return f"the name of a message of the DBC, or {self.neutral}"
        noun = "a whole number" if self.kind == "whole" else "a number"
        low, high = self.minimum, self.maximum
        if math.isfinite(low) and math.isfinite(high):
            noun += f" from {low:g} to {high:g}"
        elif math.isfinite(low):
            noun += f" of at least {low:g}"
        elif math.isfinite(high):
            noun += f" of at most {high:g}"
        return noun if self.unit in {"", "1"} else f"{noun} [{self.unit}]"


@dataclass(frozen=True)
class Twins:
    """Effects that leave the same data as this one, and the condition under which they do.

    Attributes:
        effects: their names.
        condition: "" for always, otherwise what must hold: ``there is no reference``.
    """

    effects: tuple[str, ...]
    condition: str = ""


@dataclass(frozen=True)
class EffectSetting:
    """An effect switched on with some values; parameters that are not named stay neutral.

    Attributes:
        effect: a name from the catalogue.
        values: (parameter, value) pairs in the order of the effect's parameters.
        ci95: (parameter, 95 % interval) pairs of those that were estimated, as a file states them;
            a simulation goes by the values alone.
    """

    effect: str
    values: tuple[tuple[str, Value], ...]
    ci95: tuple[tuple[str, tuple[float, float]], ...] = ()

    def __str__(self) -> str:
        """Return the setting as the command line takes it: ``gyro_bias.bias=0.005``."""
        return " ".join(f"{self.effect}.{name}={value}" for name, value in self.values)


Values: TypeAlias = Mapping[str, Value]
"""All parameters of one effect by name, those not set standing at neutral."""


WINDOW: Final = (
    EffectParameter("start_s", "s", -math.inf, "log time from which the effect acts"),
    EffectParameter("stop_s", "s", math.inf, "log time at which it ceases to act"),
)
"""Any effect may act in a part of the log only."""

_Part = TypeVar("_Part")


@dataclass(frozen=True)
class Settings:
    """What switched-on effects add up to: the parameters of every mechanism they move.

    Attributes:
        plant: the physical deviations of the simulated robot.
        bus: what happens to frames on their way.
        firmware: how the ECU's arithmetic and constants differ from the described ones.
        reference: errors of the measuring system outside the robot.
        setup: mistakes of whoever connected things.
        later: (log time in seconds from which on they hold, settings), in ascending order: what
            becomes of these settings where an effect has `start_s` or `stop_s`.
    """

    plant: Mechanisms = field(default_factory=Mechanisms)
    bus: Disturbances = field(default_factory=Disturbances)
    firmware: FirmwareChanges = field(default_factory=FirmwareChanges)
    reference: ReferenceErrors = field(default_factory=ReferenceErrors)
    setup: SetupMistakes = field(default_factory=SetupMistakes)
    later: tuple[tuple[float, "Settings"], ...] = ()

    def with_plant(self, **changes: Any) -> "Settings":
        """Return settings whose plant mechanisms have *changes*, by their field names."""
        return replace(self, plant=replace(self.plant, **changes))

    def with_bus(self, **changes: Any) -> "Settings":
        """Return settings whose disturbances of the bus have *changes*."""
        return replace(self, bus=replace(self.bus, **changes))

    def with_firmware(self, **changes: Any) -> "Settings":
        """Return settings whose firmware has *changes*."""
        return replace(self, firmware=replace(self.firmware, **changes))

    def with_reference(self, **changes: Any) -> "Settings":
        """Return settings whose reference has *changes*."""
        return replace(self, reference=replace(self.reference, **changes))

    def with_setup(self, **changes: Any) -> "Settings":
        """Return settings whose set-up has *changes*."""
        return replace(self, setup=replace(self.setup, **changes))

    @property
    def plant_over_time(self) -> Mechanisms | MechanismSchedule:
        """The plant's deviations, as a schedule only where they change with time."""
        pieces = self.over_time(lambda settings: settings.plant)
        return self.plant if len(pieces) == 1 else MechanismSchedule(pieces)

    def over_time(self, part: Callable[["Settings"], _Part]) -> tuple[tuple[float, _Part], ...]:
        """Return one part as (from_s, part) in ascending order, neighbours that are equal joined.

        The first holds from -inf on; its length is 1 where the part never changes.
        """
        found = [(-math.inf, part(self))]
        for start_s, settings in self.later:
            now = part(settings)
            if now != found[-1][1]:
                found.append((start_s, now))
        return tuple(found)


@dataclass(frozen=True)
class Effect:
    """One physical or numerical cause by which a real robot differs from the simulated one.

    Attributes:
        name: as in ``name.parameter=value``.
        stage: where it acts.
        parameters: what can be set; never empty but for effects that are either on or off.
        signature: one sentence: what it leaves in recorded data.
        apply: maps values to the mechanisms it moves; at neutral values the settings come back
            unchanged, bit for bit.
        twins: effects that leave the same data.
        is_noise: the parameters are levels of noise that the description states too.
        tolerance: sizes of parameters that are no news, where robot.toml states none (effects of a
            user's library).
        explain: for effects of a user's library: ``explain(prediction, **values)`` changes what a
            recording predicts, so that the diagnosis can fit it; None leaves that to Chiplog.
    """

    name: str
    stage: Stage
    parameters: tuple[EffectParameter, ...]
    signature: str
    apply: Callable[[Settings, Values], Settings]
    twins: tuple[Twins, ...] = ()
    is_noise: bool = False
    tolerance: Mapping[str, float] = field(default_factory=dict)
    explain: Callable[..., None] | None = None

    @property
    def settable(self) -> tuple[EffectParameter, ...]:
        """All that can be set: the parameters, and the window unless the effect has its own."""
        own = {parameter.name for parameter in self.parameters}
        return (*self.parameters, *(p for p in WINDOW if p.name not in own))

    def parameter(self, name: str) -> EffectParameter:
        """Return what can be set under *name*; raise KeyError when there is nothing."""
        for parameter in self.settable:
            if parameter.name == name:
                return parameter
        raise KeyError(name)

    def neutral(self) -> dict[str, Value]:
        """Return the values at which the effect changes nothing."""
        return {parameter.name: parameter.neutral for parameter in self.parameters}
