"""From what a person writes to settings: the command line, TOML files, and their sum."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final, TypeAlias

from hil_harness.effects.listed import catalogue
from hil_harness.effects.model import Effect, EffectParameter, EffectSetting, Settings, Value
from hil_harness.errors import HarnessError
from hil_harness.nearest import did_you_mean
from hil_harness.toml_lines import Path as KeyPath
from hil_harness.toml_model import dotted
from hil_harness.toml_source import TomlSource, load_toml, shorten, toml_text

_FORM: Final = "expected NAME.PARAMETER=VALUE, for example gyro_bias.bias=0.005"
_TABLES: Final = "a table per effect, for example [gyro_bias] with bias = 0.005"
_LARGEST: Final = 1e12
INTERVAL: Final = "_ci95"
"""Of a key: the 95 % interval of the number whose key it follows."""
_MESSAGE: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,127}")

Known: TypeAlias = Mapping[str, Effect]
"""The effects there are; None stands for the catalogue."""


def parse_effect(text: str, known: Known | None = None) -> EffectSetting:
    """Return the setting that ``NAME.PARAMETER=VALUE`` means, as ``--effect`` takes it.

    An effect that is either on or off is its name alone. Raises HarnessError naming the nearest
    effect or parameter, or what the value should be.
    """
    known = catalogue() if known is None else known
    if text.strip() in known and not known[text.strip()].parameters:
        return EffectSetting(text.strip(), ())
    name, equals, written = text.partition("=")
    effect_name, dot, parameter_name = name.strip().partition(".")
    if not (equals and dot and parameter_name and written.strip()):
        raise HarnessError(f"effect {shorten(text)}: {_FORM}")
    try:
        effect = _effect(effect_name, known)
        parameter = _parameter(effect, parameter_name)
        value = _checked(parameter, _number_or_text(written.strip()))
    except HarnessError as error:
        raise HarnessError(f"effect {shorten(text)}: {error}") from None
    return EffectSetting(effect.name, ((parameter.name, value),))


def load_effects(path: str | Path, known: Known | None = None) -> tuple[EffectSetting, ...]:
    """Return the settings in a TOML file with one table per effect: ``[gyro_bias] bias = 0.005``.

    Beside a number its 95 % interval may stand: ``bias_ci95 = [0.004, 0.006]``. Raises HarnessError
    with file, line and what would be right.
    """
    return effects_from_toml(load_toml(path), known=known)


def read_effects(
    texts: Iterable[str], files: Iterable[str | Path] = (), known: Known | None = None
) -> tuple[EffectSetting, ...]:
    """Return what a person gives: texts ``NAME.PARAMETER=VALUE`` and TOML files.

    A later file overrides an earlier one, and a text any file, parameter by parameter. Raises
    HarnessError for what `parse_effect` and `load_effects` refuse, and for a text given twice.
    """
    return combine_effects(
        *(load_effects(path, known) for path in files),
        [parse_effect(text, known) for text in texts],
        known=known,
    )


def effects_from_toml(
    source: TomlSource, table: KeyPath = (), *, known: Known | None = None
) -> tuple[EffectSetting, ...]:
    """Return the settings in the *table* of *source*, which holds one table per effect."""
    known = catalogue() if known is None else known
    tables = source.value_at(table)
    if not isinstance(tables, dict):
        raise source.error(table, f"{dotted(table)} = {toml_text(tables)}: expected {_TABLES}")
    found = []
    for name, values in tables.items():
        path = (*table, name)
        try:
            effect = _effect(name, known)
        except HarnessError as error:
            raise source.error(path, f"{dotted(path)}: {error}") from None
        if not isinstance(values, dict):
            raise source.error(path, f"{dotted(path)} = {toml_text(values)}: expected {_TABLES}")
        found.append(_checked_table(source, path, effect, values))
    return tuple(found)


def _checked_table(
    source: TomlSource, path: KeyPath, effect: Effect, values: Mapping[str, object]
) -> EffectSetting:
    checked = {}
    intervals = {}
    for key, value in values.items():
        at = (*path, key)
        stem = key.removesuffix(INTERVAL)
        number = values.get(stem)
        if stem != key and isinstance(number, int | float):
            intervals[stem] = _interval(source, at, value, number)
            continue
        try:
            parameter = _parameter(effect, key)
        except HarnessError as error:
            raise source.error(at, f"{dotted(at)}: {error}") from None
        try:
            checked[key] = _checked(parameter, value)
        except HarnessError as error:
            raise source.error(at, f"{dotted(at)} = {toml_text(value)}: {error}") from None
    order = [parameter.name for parameter in effect.settable]
    return EffectSetting(
        effect.name,
        tuple((name, checked[name]) for name in order if name in checked),
        tuple((name, intervals[name]) for name in order if name in intervals),
    )


def _interval(source: TomlSource, at: KeyPath, given: object, value: float) -> tuple[float, float]:
    """Return a 95 % interval: two numbers, and the value between them."""
    if isinstance(given, list) and len(given) == 2:
        low, high = given
        are_numbers = all(isinstance(one, int | float) for one in given)
        is_finite = (
            are_numbers and not {type(low), type(high)} & {bool} and math.isfinite(high - low)
        )
        if is_finite and low <= value <= high:
            return float(low), float(high)
    raise source.error(
        at,
        f"{dotted(at)} = {toml_text(given)}: expected a 95 % interval [low, high] around {value:g}",
    )


def combine_effects(
    *sources: Iterable[EffectSetting], known: Known | None = None
) -> tuple[EffectSetting, ...]:
    """Return one setting per effect, in the catalogue's order.

    A later source overrides an earlier one, parameter by parameter (the command line overrides
    the scenario). Within one source a parameter may be given only once: HarnessError otherwise.
    """
    values: dict[str, dict[str, Value]] = {}
    for source in sources:
        given: set[tuple[str, str]] = set()
        for setting in source:
            for name, value in setting.values:
                if (setting.effect, name) in given:
                    raise HarnessError(f"effect {setting.effect}.{name} is given twice")
                given.add((setting.effect, name))
                values.setdefault(setting.effect, {})[name] = value
            values.setdefault(setting.effect, {})
    return tuple(
        EffectSetting(
            name,
            tuple(
                (p.name, values[name][p.name]) for p in effect.settable if p.name in values[name]
            ),
        )
        for name, effect in (catalogue() if known is None else known).items()
        if name in values
    )


def apply_effects(settings: Iterable[EffectSetting], known: Known | None = None) -> Settings:
    """Return what *settings* add up to, applied in the catalogue's order whatever theirs is.

    An effect with `start_s` or `stop_s` is in the `later` settings that hold in its window.

    Raises HarnessError for an unknown effect or parameter, and for one given twice.
    """
    known = catalogue() if known is None else known
    checked = combine_effects(
        (_checked_setting(setting, known) for setting in settings), known=known
    )
    windows = [_window(known[setting.effect], setting) for setting in checked]
    edges = sorted({edge for window in windows for edge in window if math.isfinite(edge)})
    pieces = [
        _sum(
            [s for s, (start, stop) in zip(checked, windows, strict=True) if start <= at < stop],
            known,
        )
        for at in (-math.inf, *edges)
    ]
    return replace(pieces[0], later=tuple(zip(edges, pieces[1:], strict=True)))


def _sum(settings: Iterable[EffectSetting], known: Known) -> Settings:
    result = Settings()
    for setting in settings:
        effect = known[setting.effect]
        given = {name: value for name, value in setting.values if name in effect.neutral()}
        result = effect.apply(result, effect.neutral() | given)
    return result


def _window(effect: Effect, setting: EffectSetting) -> tuple[float, float]:
    """Return from when to when an effect acts, as far as it has not a window of its own."""
    own = effect.neutral()
    given = {name: value for name, value in setting.values if name not in own}
    if given and effect.name == "clock_skew":
        raise HarnessError(
            f"effect clock_skew.{next(iter(given))}: a clock has one rate for the whole log: "
            "expected no start_s and no stop_s"
        )
    if given and effect.stage == "setup":
        raise HarnessError(
            f"effect {effect.name}.{next(iter(given))}: a mistake of the set-up holds for the "
            "whole log: expected no start_s and no stop_s"
        )
    return float(given.get("start_s", -math.inf)), float(given.get("stop_s", math.inf))


def _checked_setting(setting: EffectSetting, known: Known) -> EffectSetting:
    effect = _effect(setting.effect, known)
    values = []
    for name, value in setting.values:
        parameter = _parameter(effect, name)
        try:
            values.append((name, _checked(parameter, value)))
        except HarnessError as error:
            raise HarnessError(f"effect {effect.name}.{name}={value}: {error}") from None
    return EffectSetting(effect.name, tuple(values))


def _effect(name: str, known: Known) -> Effect:
    if name not in known:
        raise HarnessError(f"no such effect: {did_you_mean(name, known)}")
    return known[name]


def _parameter(effect: Effect, name: str) -> EffectParameter:
    try:
        return effect.parameter(name)
    except KeyError:
        names = [parameter.name for parameter in effect.parameters]
        raise HarnessError(
            f"{effect.name} has no such parameter: {did_you_mean(name, names)}"
        ) from None


def _number_or_text(written: str) -> Value:
    for read in (int, float):
        try:
            return read(written)
        except ValueError:
            continue
    return written


def _checked(parameter: EffectParameter, value: object) -> Value:
    """Return *value* as the parameter's type; raise HarnessError with what was expected."""
    if parameter.kind == "choice":
        if isinstance(value, str) and value in parameter.choices:
            return value
    elif parameter.kind == "message":
        if isinstance(value, str) and _MESSAGE.fullmatch(value):
            return value
    elif isinstance(value, int | float) and not isinstance(value, bool):
        in_range = parameter.minimum <= value <= parameter.maximum
        if in_range and (abs(value) <= _LARGEST or value == parameter.neutral):
            if parameter.kind == "real":
                return float(value)
            if isinstance(value, int):
                return value
    raise HarnessError(f"expected {parameter.expected()}")
