"""Which effects can be known of a robot before a log of it is diagnosed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.granted import Granted
from hil_harness.effects import Effect, EffectSetting, catalogue, load_effects

_REFUSED: Final = {
    "accelerometer_bias": "no accelerometer is read",
    "accelerometer_noise": "no accelerometer is read",
    "bus_gap": "a silence of one log",
    "caster_kick": "no diagnosis tells it",
    "contact_offset": "no diagnosis tells it",
    "drive_cogging": "no diagnosis tells it",
    "encoder_dead": "a defect to be mended",
    "firmware_overflow": "a program whose words overflow is to be mended",
    "floor_bump": "a place of one drive",
    "gyro_frozen": "a silence of one log",
    "gyro_tilt": "write its gyro_scale instead, cos(roll) cos(pitch) - 1",
    "micro_slip": "write contact.noise_m_per_sqrt_m in robot.toml instead",
    "missed_deadline": "which ticks it strikes no other log says",
    "moving_calibration": "the offset that it learns is another in every drive",
    "quadrature_phase": "no diagnosis tells it",
    "reception_stamp": "nothing tells what else stamps have beside a poll",
    "reference_dropout": "a silence of one log",
    "reference_jump": "a jump of one log",
    "supply_change": "the supply that a log records says it",
    "warm_up": "the temperature that a log records says it",
    "wheel_toe": "write its reference_yaw instead, of the other sign",
}
"""Why an effect cannot be known beforehand."""


def load_granted(path: Path, library: Mapping[str, Effect] = MappingProxyType({})) -> Granted:
    """Return the known effects that a file states, as ``--write-effects`` writes it.

    Raises HarnessError for what is no such file, and DiagnosisError for an effect that another log
    cannot be held against.
    """
    settings = load_effects(path, {**catalogue(), **library})
    for one in settings:
        why = _refusal(one, library)
        if why:
            raise DiagnosisError(
                f"{path}: {one.effect} cannot be known beforehand: {why}: expected the file "
                "without it"
            )
    return Granted(settings, library, path.name)


def _refusal(setting: EffectSetting, library: Mapping[str, Effect]) -> str:
    effect = {**catalogue(), **library}[setting.effect]
    if effect.stage == "setup":
        return "a mistake of the set-up is to be put right"
    if effect.name in _REFUSED:
        return _REFUSED[effect.name]
    windows = {"start_s", "stop_s"} & {name for name, _ in setting.values}
    if windows:
        return f"{min(windows)} is a time of one log"
    if effect.name in library and effect.explain is None:
        return "its library does not say how it explains a log"
    return ""
