"""From a TOML document to a pydantic model, with every problem said in one line for people."""

import json
import re
from collections.abc import Iterator, Mapping
from types import UnionType
from typing import Annotated, Any, Final, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from hil_harness.errors import HarnessError
from hil_harness.field_words import keys_of, wanted
from hil_harness.nearest import did_you_mean
from hil_harness.toml_lines import Path as KeyPath
from hil_harness.toml_source import TomlSource, toml_text

Model = TypeVar("Model", bound=BaseModel)

_OWN_WORDS: Final = frozenset({"value_error", "assertion_error"})
_PYDANTIC_PREFIX: Final = re.compile(r"^(?:Value error|Assertion failed), ")


def validate(
    source: TomlSource,
    model: type[Model],
    table: KeyPath = (),
    *,
    data: Mapping[str, Any] | None = None,
) -> Model:
    """Return the *table* of *source* as a *model*, read strictly (``"3"`` is not a number).

    *data* replaces what stands in the file at *table*: the part of a file that one package
    answers for. Raises HarnessError with all problems in the order of their lines, each of the
    form ``robot.toml:14: encoder.ticks_per_rev = "2048 ticks": expected a whole number from 1
    to 65535, for example 2048``. What is expected is read from the model: its types, bounds,
    choices and ``examples``.
    """
    content = source.value_at(table) if data is None else dict(data)
    try:
        return model.model_validate_json(json.dumps(content, default=_no_json), strict=True)
    except ValidationError as error:
        raise _in_words(source, model, table, error) from None


def _no_json(value: object) -> dict[str, str]:
    """Stand in for TOML's dates by something that no field of ours takes."""
    return {"date": str(value)}


def _in_words(
    source: TomlSource, model: type[BaseModel], table: KeyPath, error: ValidationError
) -> HarnessError:
    found: dict[KeyPath, tuple[int, str]] = {}
    for problem in error.errors(include_url=False, include_context=True):
        path, line_key, message = _problem(source, model, table, problem)
        if path not in found:  # a union reports one problem per member: say the field once
            found[path] = (source.line_of(line_key) or 0, f"{source.where(line_key)}: {message}")
    deepest = [
        problem
        for path, problem in found.items()
        # where text or a table may stand, a table's own problem says more than "expected text"
        if not any(len(other) > len(path) and other[: len(path)] == path for other in found)
    ]
    lines = tuple(text for _, text in sorted(deepest, key=lambda problem: problem[0]))
    rest = len(lines) - 1
    more = f" (and {rest} more problem{'s' if rest > 1 else ''})" if rest else ""
    return HarnessError(lines[0] + more, lines)


def _problem(
    source: TomlSource, model: type[BaseModel], table: KeyPath, problem: ErrorDetails
) -> tuple[KeyPath, KeyPath, str]:
    """Return the path of the problem, the key at whose line it stands, and the message."""
    kind, location = problem["type"], problem["loc"]
    if kind == "missing":
        name = str(location[-1])
        above = _real_path(source, table, location[:-1])
        field = _field_at(model, (*above[len(table) :], name))
        key = dotted((*above, name))
        words = wanted(field) or f"expected a table [{key}]"
        return (*above, name), above, f"{key} is missing: {words}"
    path = _real_path(source, table, location)
    shown = dotted(path)
    if kind == "extra_forbidden":
        known = _known_keys(model, path[len(table) : -1])
        return path, path, f"{shown}: unknown key: {did_you_mean(str(path[-1]), known)}"
    found = _found(source, path)
    subject = f"{shown}{found}: " if shown else ""
    if kind in _OWN_WORDS:
        said = _PYDANTIC_PREFIX.sub("", problem["msg"])
        return path, source.key_named_in(said, path), subject + said
    words = wanted(_field_at(model, path[len(table) :]))
    return path, path, subject + (words or problem["msg"][:1].lower() + problem["msg"][1:])


def _found(source: TomlSource, path: KeyPath) -> str:
    """Return `` = value`` for a value, nothing for a table (its line says where it is)."""
    try:
        value = source.value_at(path)
    except KeyError:
        return ""
    return "" if isinstance(value, dict) else f" = {toml_text(value)}"


def _real_path(source: TomlSource, table: KeyPath, location: tuple[int | str, ...]) -> KeyPath:
    """Return *location* without the names of union members that pydantic puts into it."""
    path = table
    for part in location:
        try:
            source.value_at((*path, part))
        except KeyError:
            continue
        path = (*path, part)
    return path


def dotted(path: KeyPath) -> str:
    """Return *path* as a person would write it: ``segments[2].v_m_s`` (items from 1)."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            bare = re.fullmatch(r"[A-Za-z0-9_-]{1,64}", part)
            text += ("." if text else "") + (part if bare else toml_text(part))
    return text


def _field_at(model: type[BaseModel], path: KeyPath) -> FieldInfo | None:
    """Return the model field at *path* (for a list item, a field of the item's type)."""
    field: FieldInfo | None = None
    annotation: Any = model
    for part in path:
        if isinstance(part, int):
            annotation = next(iter(_item_types(annotation)), None)
            field = None if annotation is None else FieldInfo.from_annotation(annotation)
            continue
        owner = next((one for one in _models(annotation) if part in keys_of(one)), None)
        if owner is None and get_origin(annotation) is dict:
            annotation = get_args(annotation)[1]
            field = FieldInfo.from_annotation(annotation)
            continue
        if owner is None:
            return None
        field = keys_of(owner)[part]
        annotation = field.annotation
    return field


def _known_keys(model: type[BaseModel], path: KeyPath) -> set[str]:
    field = _field_at(model, path) if path else None
    annotation: Any = model if not path else (field.annotation if field else None)
    return {key for one in _models(annotation) for key in keys_of(one)}


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    elif get_origin(annotation) in {Union, UnionType, Annotated}:
        for member in get_args(annotation):
            yield from _models(member)


def _item_types(annotation: Any) -> Iterator[Any]:
    origin = get_origin(annotation)
    if origin in {tuple, list, frozenset, set}:
        yield get_args(annotation)[0]
    elif origin in {Union, UnionType, Annotated}:
        for member in get_args(annotation):
            yield from _item_types(member)
