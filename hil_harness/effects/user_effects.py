"""A user's own effects: a short Python file with a list EFFECTS, run because the user names it."""

from __future__ import annotations

import linecache
import re
import traceback
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, get_args

from hil_harness.effects.listed import catalogue
from hil_harness.effects.model import Effect, EffectParameter, Settings, Stage
from hil_harness.errors import HarnessError

_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,59}")
_MODULE: Final = "chiplog_effect_library"
EXPLAINABLE: Final[tuple[Stage, ...]] = ("wheel", "encoder", "gyro", "reference")
"""The stages whose data a prediction of the diagnosis holds: counts, ways, turns and poses."""
_LARGEST_BYTES: Final = 1 << 20
_EXPECTED: Final = (
    "EFFECTS = [Effect(...)], with Effect from hil_harness.effects; see docs/how-to/my-effect.md"
)


def load_effect_library(path: str | Path) -> Mapping[str, Effect]:
    """Return the catalogue with the effects of a file in it, each at the end of its stage.

    The file is run as Python: it is code that the user trusts. Raises HarnessError in one line for
    a file that does not run, and for an effect that is not declared in full.
    """
    path = Path(path)
    found = _run(path).get("EFFECTS")
    if not isinstance(found, list | tuple) or not found:
        raise HarnessError(f"{path}: no list EFFECTS: expected {_EXPECTED}")
    own: dict[str, Effect] = {}
    for place, effect in enumerate(found):
        if not isinstance(effect, Effect):
            raise HarnessError(
                f"{path}: EFFECTS[{place}] is of type {type(effect).__name__}: expected {_EXPECTED}"
            )
        wrong = _mistake(effect, own)
        if wrong is not None:
            raise HarnessError(f"{path}: effect {effect.name!r}: {wrong}")
        own[effect.name] = effect
    stages: tuple[Stage, ...] = get_args(Stage)
    whole = {**catalogue(), **own}
    ordered = sorted(whole.values(), key=lambda effect: stages.index(effect.stage))
    return MappingProxyType({effect.name: effect for effect in ordered})


def _run(path: Path) -> dict[str, Any]:
    try:
        if path.stat().st_size > _LARGEST_BYTES:
            raise HarnessError(f"{path}: larger than 1 MiB: expected a short Python file")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise HarnessError(f"{path}: cannot read this effect library: {error.strerror}") from None
    except UnicodeDecodeError:
        raise HarnessError(f"{path}: not a text: expected a Python file in UTF-8") from None
    names: dict[str, Any] = {"__name__": _MODULE, "__file__": str(path)}
    linecache.checkcache(str(path))
    try:
        exec(compile(text, str(path), "exec"), names)  # named by the user for this purpose
    except SyntaxError as error:
        raise HarnessError(f"{path}:{error.lineno}: {error.msg}: expected a Python file") from None
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        lines = [frame.lineno for frame in frames if frame.filename == str(path)]
        said = " ".join(str(error).split()) or "no message"
        at = f"{path}:{lines[-1]}" if lines else str(path)
        raise HarnessError(
            f"{at}: {type(error).__name__}: {said}: expected a file that runs"
        ) from None
    return names


def _mistake(effect: Effect, own: Mapping[str, Effect]) -> str | None:
    """Return what is wrong with an effect, and what would be right."""
    if not isinstance(effect.name, str) or not _NAME.fullmatch(effect.name):
        return "expected a name of small letters, digits and _, for example battery_sag"
    if effect.name in catalogue() or effect.name in own:
        return "there is an effect of that name: expected another"
    if effect.stage not in get_args(Stage):
        return f"stage = {effect.stage!r}: expected one of {', '.join(get_args(Stage))}"
    if not isinstance(effect.signature, str) or not effect.signature.strip():
        return "signature is empty: expected one sentence on what it leaves in recorded data"
    if not isinstance(effect.parameters, tuple) or not all(
        isinstance(parameter, EffectParameter) for parameter in effect.parameters
    ):
        return "parameters: expected a tuple of EffectParameter"
    names = [parameter.name for parameter in effect.parameters]
    if len(set(names)) != len(names):
        return f"parameters {', '.join(names)}: expected each name once"
    for name in effect.tolerance:
        if name not in names:
            return f"tolerance of {name!r}: expected one of its parameters, {', '.join(names)}"
    if effect.explain is not None and not callable(effect.explain):
        return "explain: expected a function explain(prediction, **values), or None"
    if effect.explain is not None and effect.stage not in EXPLAINABLE:
        return (
            f"explain in stage {effect.stage}: expected one of stage {', '.join(EXPLAINABLE)}, "
            "whose data a prediction holds, or no explain: the effect is then simulated and not "
            "diagnosed"
        )
    return _mistake_of_apply(effect)


def _mistake_of_apply(effect: Effect) -> str | None:
    try:
        at_neutral = effect.apply(Settings(), effect.neutral())
    except Exception as error:
        said = " ".join(str(error).split())
        return f"apply raises {type(error).__name__} at neutral values: {said}: expected settings"
    if not isinstance(at_neutral, Settings):
        return f"apply returns {type(at_neutral).__name__}: expected Settings"
    if at_neutral != Settings() and effect.parameters:
        return "apply changes something at neutral values: expected unchanged settings"
    return None
