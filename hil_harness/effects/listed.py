"""All effects by name, stage by stage in the order in which data flows."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from hil_harness.effects import (
    actuation,
    bus,
    encoder,
    firmware,
    gyro,
    reference,
    setup,
    wheel,
)
from hil_harness.effects.model import Effect

_CATALOGUE: Final = MappingProxyType(
    {
        effect.name: effect
        for stage in (actuation, wheel, encoder, gyro, bus, firmware, reference, setup)
        for effect in stage.EFFECTS
    }
)


def catalogue() -> Mapping[str, Effect]:
    """Return every effect Chiplog can switch on, by name, in the order in which data flows."""
    return _CATALOGUE
