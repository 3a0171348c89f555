"""How the program on a real ECU differs from the one that `robot.toml` describes.

A change maps the description and the constants to those that the kernel of the node under test is
built from; the kernel itself stays the one source. What acts in time (an offset averaged in
motion, ticks that are not executed) is data for whoever steps the kernel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, get_args

from firmware_model.build import build_config
from firmware_model.config import KernelConfig, require_c
from firmware_model.constants import FirmwareConstants
from firmware_model.description import FirmwareDescription, Overflow

AsDescribed = Literal["described"]
CutRounding = Literal["described", "floor", "toward_zero"]
ResolvedVariable = Literal["position", "step", "heading", "turn_step", "trig"]
LimitedVariable = Literal["position", "step", "turn_step"]
EulerHeading = Literal["described", "before", "after"]
Constant = Literal["wheel_radius", "wheelbase", "ticks_per_rev", "gyro_sensitivity", "tick_period"]

CUT_ROUNDINGS: Final[tuple[CutRounding, ...]] = get_args(CutRounding)
RESOLVED_VARIABLES: Final[tuple[ResolvedVariable, ...]] = get_args(ResolvedVariable)
LIMITED_VARIABLES: Final[tuple[LimitedVariable, ...]] = get_args(LimitedVariable)
EULER_HEADINGS: Final[tuple[EulerHeading, ...]] = get_args(EulerHeading)
CONSTANTS: Final[tuple[Constant, ...]] = get_args(Constant)

_ROUNDED: Final = ("position", "step", "heading", "turn_step", "trig", "gyro")
_NEVER_SETTLES: Final = 65535


@dataclass(frozen=True, kw_only=True)
class FirmwareChanges:
    """Every deviation of the program; all neutral by default. Signs as in the effect catalogue.

    Attributes:
        rounding: used at every narrowing instead of the described one.
        resolution_variable, resolution_bits: this format has so many fraction bits fewer.
        trig_entries, trig_interpolated: a sine table of so many steps per quarter wave; 0 entries
            leave it as described.
        euler: the heading of a tick that its step is taken along.
        stale_heading_cycles: the position uses the heading of so many ticks ago.
        constant, constant_scale: this constant is used over described − 1.
        overflow_variable, overflow_bits, overflow_mode: the word of this format has so many bits;
            0 leaves it as described.
        auto_zero_rad_s: slower turns of the gyro are taken for rest.
        tick_period_scale: assumed over real tick period − 1.
        blend_weight: used − described weight of the gyro.
        calibration_start_s, calibration_stop_s: the gyro's offset is averaged in this window and
            then kept; nothing is learnt at rest.
        missed_deadline: probability with which a tick is not executed.
    """

    rounding: CutRounding = "described"
    resolution_variable: ResolvedVariable = "position"
    resolution_bits: int = 0
    trig_entries: int = 0
    trig_interpolated: int = 1
    euler: EulerHeading = "described"
    stale_heading_cycles: int = 0
    constant: Constant = "wheel_radius"
    constant_scale: float = 0.0
    overflow_variable: LimitedVariable = "position"
    overflow_bits: int = 0
    overflow_mode: Overflow = "wrap"
    auto_zero_rad_s: float = 0.0
    tick_period_scale: float = 0.0
    blend_weight: float = 0.0
    calibration_start_s: float = math.inf
    calibration_stop_s: float = math.inf
    missed_deadline: float = 0.0

    def description(self, described: FirmwareDescription) -> FirmwareDescription:
        """Return the description of the program that runs; the same object if nothing differs.

        Raises FirmwareError for a combination that no firmware can have.
        """
        tables: dict[str, dict[str, Any]] = {}
        top: dict[str, Any] = {}

        def change(table: str, **values: Any) -> None:
            tables.setdefault(table, {}).update(values)

        if self.rounding != "described":
            for table in _ROUNDED:
                change(table, rounding=self.rounding)
        if self.resolution_bits != 0:
            variable = self.resolution_variable
            bits = getattr(described, variable).frac_bits - self.resolution_bits
            change(variable, frac_bits=bits)
        if self.trig_entries != 0:
            interpolated = self.trig_interpolated == 1
            change("trig", method="table", entries=self.trig_entries, interpolated=interpolated)
        if self.euler != "described":
            top["integration"] = f"euler_{self.euler}"
        if self.stale_heading_cycles != 0:
            top["stale_heading_ticks"] = self.stale_heading_cycles
        if self.overflow_bits != 0:
            change(
                self.overflow_variable,
                word_bits=self.overflow_bits,
                overflow=self.overflow_mode,
            )
        if self.auto_zero_rad_s != 0.0:
            change("gyro", auto_zero_rad_s=self.auto_zero_rad_s)
        if self.blend_weight != 0.0:
            weight = described.blend_weight + self.blend_weight
            top["blend_weight"] = min(max(weight, 0.0), 1.0)
        if self.calibrates_in_motion:
            change("standstill", settle_ticks=_NEVER_SETTLES)
        if not tables and not top:
            return described
        whole = described.model_dump() | top
        for table, values in tables.items():
            whole[table] = whole[table] | values
        return FirmwareDescription.from_table(whole)

    @property
    def calibrates_in_motion(self) -> bool:
        """Tell whether the offset is averaged in a window."""
        return self.calibration_start_s < self.calibration_stop_s

    def constants(self, described: FirmwareConstants) -> FirmwareConstants:
        """Return the constants that the program uses; the same object if none differs."""
        used = described
        period = 1.0 + self.tick_period_scale
        if self.constant_scale != 0.0:
            ratio = 1.0 + self.constant_scale
            match self.constant:
                case "wheel_radius":
                    used = replace(used, wheel_radius_m=used.wheel_radius_m * ratio)
                case "wheelbase":
                    used = replace(used, wheelbase_m=used.wheelbase_m * ratio)
                case "ticks_per_rev":
                    # The same as another radius, which need not be whole.
                    used = replace(used, wheel_radius_m=used.wheel_radius_m / ratio)
                case "gyro_sensitivity":
                    sensitivity = used.gyro_sensitivity_rad_s_per_lsb / ratio
                    used = replace(used, gyro_sensitivity_rad_s_per_lsb=sensitivity)
                case "tick_period":
                    period *= ratio
        if period != 1.0:
            used = replace(used, tick_period_s=used.tick_period_s * period)
        return used

    def config(
        self,
        description: FirmwareDescription,
        constants: FirmwareConstants,
        *,
        allow_overflow: bool = False,
    ) -> KernelConfig:
        """Return the kernel's integers of the program that runs. Raises FirmwareError.

        A word that is narrower than described overflows; all that was dimensioned for the described
        one, constants and the longest gap, stays.
        """
        running, used = self.description(description), self.constants(constants)
        if self.overflow_bits == 0:
            return build_config(running, used, allow_overflow=allow_overflow)
        config = build_config(running, used, allow_overflow=True)
        if not allow_overflow:
            require_c(config)
        if self.overflow_bits >= getattr(description, self.overflow_variable).word_bits:
            return config
        usual = replace(self, overflow_bits=0).config(
            description, constants, allow_overflow=allow_overflow
        )
        name = self.overflow_variable.removesuffix("_step")
        limits: dict[str, Any] = {
            one: getattr(config, one)
            for one in (f"{name}_low_q", f"{name}_high_q", f"{name}_overflow")
        }
        return replace(usual, description=running, **limits)
