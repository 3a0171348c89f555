"""The robot description: one file, each part validated by the package that answers for it."""

import math
from dataclasses import dataclass, field
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from firmware_model import FirmwareConstants, FirmwareDescription
from hil_harness.errors import HarnessError
from hil_harness.kernel_inputs import GyroCodes, described_gyro
from hil_harness.toml_model import validate
from hil_harness.toml_source import TomlSource, load_toml
from sim_plant import PlantDescription

DEFAULT_NAME: Final = "robot.toml"
LONGEST_MISSION_S: Final = 366 * 86_400.0


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


def _tolerance(meaning: str, default: float) -> Any:
    return Field(default=default, gt=0, le=1, description=meaning, examples=[default])


class RobotTable(_Table):
    """Table [robot]: what people call it."""

    name: str = Field(
        default="lesson", min_length=1, max_length=60, description="in reports", examples=["lesson"]
    )


class Tolerance(_Table):
    """Table [tolerance]: how far a described value may be from the real one before it is news.

    The defaults are those of docs/design.md, section 5.
    """

    radius_scale: float = _tolerance("both radii, real over described − 1", 0.002)
    radius_mismatch: float = _tolerance("difference of the radii over their mean", 0.0005)
    wheelbase_scale: float = _tolerance("real over described − 1", 0.003)
    gyro_scale: float = _tolerance("real over described − 1", 0.003)
    gyro_bias_rad_s: float = _tolerance("bias [rad/s]; the default is 0.02 °/s", 0.00034907)
    time_offset_s: float = _tolerance("between clocks of log, ECU and reference [s]", 0.002)


def _limit(meaning: str, high: float, example: float) -> Any:
    return Field(default=None, gt=0, le=high, description=meaning, examples=[example])


class Design(_Table):
    """Table [design]: what the firmware is made for, as `ranges` and `export-c` take it.

    Raises pydantic.ValidationError.
    """

    tick_period_us: int | None = Field(
        default=None,
        ge=10,
        le=10_000_000,
        description="tick that it was made for [µs]; left out: the DBC's",
        examples=[10_000],
    )
    mission_s: float = Field(
        default=3600.0,
        gt=0,
        le=LONGEST_MISSION_S,
        description="longest mission [s]",
        examples=[3600.0],
    )
    distance_m: float | None = _limit(
        "longest way in a mission, to and fro as the wheels go [m], without what encoders count at "
        "rest; left out: at top speed all along",
        1e9,
        1000.0,
    )
    speed_m_s: float | None = _limit(
        "fastest ground speed of a wheel [m/s]; left out: what [drive] gives", 1e5, 1.0
    )
    turn_rate_rad_s: float | None = _limit(
        "fastest turn of the robot [rad/s]; left out: any its wheels and gyro tell", 1e5, 2.0
    )


class RobotFile(PlantDescription):
    """A whole robot.toml: the plant's tables, the firmware's, tolerances and a name."""

    schema_: Literal[1] = Field(default=1, alias="schema", description="version of this format")
    robot: RobotTable = RobotTable()
    firmware: FirmwareDescription = FirmwareDescription()
    design: Design = Design()
    tolerance: Tolerance = Tolerance()


@dataclass(frozen=True)
class Robot:
    """A described robot.

    Attributes:
        name: what people call it.
        plant: its body and sensors.
        firmware: its dead reckoning.
        design: what that is made for.
        tolerance: how far the real robot may differ before it is news.
        source: the file it was read from; None for the shipped one.
    """

    name: str
    plant: PlantDescription
    firmware: FirmwareDescription
    design: Design
    tolerance: Tolerance
    source: TomlSource | None = field(default=None, repr=False, compare=False)

    @property
    def describes_drive(self) -> bool:
        """Whether it is said how the wheels answer their commands: a file that says neither how
        late nor how fast describes no drive, and has the shipped robot's."""
        if self.source is None:
            return True
        return any(("drive", key) in self.source.lines for key in ("time_constant_s", "delay_s"))

    def where(self, message: str) -> str:
        """Return the file, with the line of the first key that *message* names if it has it."""
        if self.source is None:
            return DEFAULT_NAME
        return self.source.where(self.source.key_named_in(message))

    def require_tick(self, tick_period_us: int, dbc: str) -> None:
        """Refuse a tick other than the one that the firmware was made for.

        Raises HarnessError with file and line.
        """
        made_for = self.design.tick_period_us
        if made_for not in (None, tick_period_us):
            message = (
                f"design.tick_period_us = {made_for}: the tick of {dbc} is {tick_period_us} µs: "
                "expected --dbc with the tick that the firmware was made for"
            )
            raise HarnessError(f"{self.where(message)}: {message}")

    def firmware_constants(
        self, tick_period_us: int, gyro: GyroCodes | None = None
    ) -> FirmwareConstants:
        """Return what the firmware is told about this robot.

        *tick_period_us* is the tick period of the DBC in use. *gyro* says what the gyro's codes
        mean on its bus (``KernelInputs.gyro``); None means the described sensor on its ADC.

        Raises HarnessError for a wheel so fast that its counter wraps half way within a tick, and
        FirmwareError for a value the firmware cannot work with.
        """
        encoder, drive = self.plant.encoder, self.plant.drive
        codes = gyro or described_gyro(self.plant)
        tick_s = tick_period_us / 1e6
        ticks_per_tick = drive.max_wheel_rate_rad_s * tick_s * encoder.ticks_per_rev / math.tau
        half_counter = 1 << (encoder.counter_bits - 1)
        if ticks_per_tick >= half_counter:
            message = (
                f"at drive.max_wheel_rate_rad_s = {drive.max_wheel_rate_rad_s:g} a wheel makes "
                f"{ticks_per_tick:.0f} ticks in {tick_period_us} µs, and {encoder.counter_bits} "
                f"bits tell directions apart below {half_counter}: expected more "
                "encoder.counter_bits, fewer encoder.ticks_per_rev or a slower drive"
            )
            raise HarnessError(f"{self.where(message)}: {message}")
        return FirmwareConstants(
            wheel_radius_m=self.plant.wheels.radius_m,
            wheelbase_m=self.plant.wheels.wheelbase_m,
            ticks_per_rev=encoder.ticks_per_rev,
            counter_bits=encoder.counter_bits,
            tick_period_s=tick_s,
            gyro_sensitivity_rad_s_per_lsb=codes.sensitivity_rad_s_per_lsb,
            gyro_zero_rate_code=codes.zero_rate_code,
            gyro_min_code=codes.min_code,
            gyro_max_code=codes.max_code,
            max_wheel_rate_rad_s=drive.max_wheel_rate_rad_s,
        )


def load_robot(path: str | Path | None = None) -> Robot:
    """Read a robot.toml; None reads the shipped one, the lesson's robot.

    Tables and values left out are those of the shipped robot. Raises HarnessError with file, line,
    value and what would be right, for every problem in the file.
    """
    if path is not None:
        source = load_toml(path)
        return _robot(source, source)
    with as_file(files("hil_harness") / "data" / DEFAULT_NAME) as shipped:
        return _robot(load_toml(shipped), None)


def default_robot_text() -> str:
    """Return the shipped robot.toml, comments and all, for a user to copy."""
    return (files("hil_harness") / "data" / DEFAULT_NAME).read_text(encoding="utf-8")


def robot_schema() -> dict[str, Any]:
    """Return the JSON schema of robot.toml."""
    schema = RobotFile.model_json_schema(by_alias=True)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _robot(source: TomlSource, named: TomlSource | None) -> Robot:
    whole = validate(source, RobotFile)
    plant = {name: getattr(whole, name) for name in PlantDescription.model_fields}
    gyro_span = whole.gyro.range_rad_s * whole.gyro.sensitivity_lsb_per_rad_s
    if gyro_span < 1:
        raise source.error(
            "gyro.range_rad_s",
            f"gyro.range_rad_s = {whole.gyro.range_rad_s:g}: {gyro_span:.2g} LSB: expected a range "
            "of at least one code of gyro.sensitivity_lsb_per_rad_s",
        )
    return Robot(
        name=whole.robot.name,
        plant=PlantDescription(**plant),
        firmware=whole.firmware,
        design=whole.design,
        tolerance=whole.tolerance,
        source=named,
    )
