"""The effect catalogue: every cause by which a real robot differs from the simulated one.

An effect is declared once, in the file of its stage; its mechanism lives where it acts.
"""

from hil_harness.effects.listed import catalogue
from hil_harness.effects.model import (
    Effect,
    EffectParameter,
    EffectSetting,
    Settings,
    Stage,
    Twins,
    Typical,
    Value,
    Values,
)
from hil_harness.effects.settings import (
    INTERVAL,
    apply_effects,
    combine_effects,
    effects_from_toml,
    load_effects,
    parse_effect,
    read_effects,
)
from hil_harness.effects.user_effects import load_effect_library

__all__ = [
    "INTERVAL",
    "Effect",
    "EffectParameter",
    "EffectSetting",
    "Settings",
    "Stage",
    "Twins",
    "Typical",
    "Value",
    "Values",
    "apply_effects",
    "catalogue",
    "combine_effects",
    "effects_from_toml",
    "load_effect_library",
    "load_effects",
    "parse_effect",
    "read_effects",
]
