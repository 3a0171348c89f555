"""From a TOML document to a pydantic model, with every problem said in one line for people."""

import json
import math
import re
from collections.abc import Iterator, Mapping
from enum import Enum
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, TypeVar, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen, MultipleOf
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticUndefined

from hil_harness.errors import HarnessError
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
        wanted = _wanted(field)
        return (*above, name), above, f"{dotted((*above, name))} is missing: {wanted}"
    path = _real_path(source, table, location)
    shown = dotted(path)
    if kind == "extra_forbidden":
        known = _known_keys(model, path[len(table) : -1])
        return path, path, f"{shown}: unknown key: {did_you_mean(str(path[-1]), known)}"
    found = _found(source, path)
    subject = f"{shown}{found}: " if shown else ""
    if kind in _OWN_WORDS:
        return path, path, subject + _PYDANTIC_PREFIX.sub("", problem["msg"])
    wanted = _wanted(_field_at(model, path[len(table) :]))
    return path, path, subject + (wanted or problem["msg"][:1].lower() + problem["msg"][1:])


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
        owner = next((one for one in _models(annotation) if part in _keys(one)), None)
        if owner is None and get_origin(annotation) is dict:
            annotation = get_args(annotation)[1]
            field = FieldInfo.from_annotation(annotation)
            continue
        if owner is None:
            return None
        field = _keys(owner)[part]
        annotation = field.annotation
    return field


def _known_keys(model: type[BaseModel], path: KeyPath) -> set[str]:
    field = _field_at(model, path) if path else None
    annotation: Any = model if not path else (field.annotation if field else None)
    return {key for one in _models(annotation) for key in _keys(one)}


def _keys(model: type[BaseModel]) -> dict[str, FieldInfo]:
    return {field.alias or name: field for name, field in model.model_fields.items()}


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


def _wanted(field: FieldInfo | None) -> str:
    """Return ``expected …, for example …`` for *field*; empty when nothing is known."""
    if field is None:
        return ""
    words = expected(field)
    if not words:
        return ""
    examples = field.examples or []
    if not examples and field.default not in (PydanticUndefined, None):
        examples = [field.default]
    if not examples or isinstance(examples[0], BaseModel | tuple | list | dict):
        return f"expected {words}"
    example = toml_text(_plain(examples[0]))
    if words.startswith("one of") or words == example:
        return f"expected {words}"
    return f"expected {words}, for example {example}"


def expected(field: FieldInfo) -> str:
    """Return what *field* takes, in words: ``a whole number from 1 to 65535``.

    A text field with a pattern says in its ``description`` what the pattern means.
    """
    bounds = _bounds(field)
    if "pattern" in bounds:
        return field.description or f"text that matches {bounds['pattern']}"
    return _words(field.annotation, bounds)


def _plain(value: object) -> object:
    return value.value if isinstance(value, Enum) else value


def _bounds(field: FieldInfo) -> dict[str, Any]:
    bounds: dict[str, Any] = {}
    for item in field.metadata:
        match item:
            case Ge():
                bounds["ge"] = item.ge
            case Gt():
                bounds["gt"] = item.gt
            case Le():
                bounds["le"] = item.le
            case Lt():
                bounds["lt"] = item.lt
            case MinLen():
                bounds["min_length"] = item.min_length
            case MaxLen():
                bounds["max_length"] = item.max_length
            case MultipleOf():
                bounds["multiple_of"] = item.multiple_of
            case _:
                for name in ("allow_inf_nan", "pattern"):
                    if getattr(item, name, None) is not None:
                        bounds[name] = getattr(item, name)
    return bounds


def _words(annotation: Any, bounds: Mapping[str, Any]) -> str:
    origin = get_origin(annotation)
    if origin is Annotated:
        inner = FieldInfo.from_annotation(annotation)
        if "pattern" in _bounds(inner):
            return expected(inner)
        return _words(inner.annotation, {**_bounds(inner), **bounds})
    if origin in {Union, UnionType}:
        members = [member for member in get_args(annotation) if member is not NoneType]
        return " or ".join(dict.fromkeys(_words(member, bounds) for member in members))
    if origin is Literal:
        return _one_of([_plain(value) for value in get_args(annotation)])
    if origin in {tuple, list, set, frozenset}:
        return _list_words(get_args(annotation), bounds)
    if isinstance(annotation, type):
        if issubclass(annotation, Enum):
            return _one_of([member.value for member in annotation])
        if issubclass(annotation, BaseModel):
            return f"a table with {', '.join(_keys(annotation))}"
        return _scalar_words(annotation, bounds)
    return ""


def _scalar_words(annotation: type, bounds: Mapping[str, Any]) -> str:
    if annotation is bool:
        return "true or false"
    if annotation is int:
        return _number_words("a whole number", bounds)
    if annotation is float:
        return _number_words("a number", bounds)
    if annotation is str:
        longest = bounds.get("max_length")
        return "text" if longest is None else f"text of at most {longest} characters"
    return "a table" if annotation is dict else ""


def _one_of(values: list[object]) -> str:
    shown = [toml_text(value) for value in values]
    return shown[0] if len(shown) == 1 else f"one of {', '.join(shown)}"


def _list_words(arguments: tuple[Any, ...], bounds: Mapping[str, Any]) -> str:
    item = _words(arguments[0], {}) if arguments else "values"
    fixed = len(arguments) if arguments and arguments[-1] is not Ellipsis else 0
    if fixed > 1:
        return f"a list of {fixed} values, each {item}"
    least, most = bounds.get("min_length"), bounds.get("max_length")
    count = f" {_range(least, most)}" if least is not None or most is not None else ""
    return f"a list of{count} values, each {item}"


def _range(least: object, most: object) -> str:
    if least is None:
        return f"at most {most}"
    return f"at least {least}" if most is None else f"{least} to {most}"


def _number_words(noun: str, bounds: Mapping[str, Any]) -> str:
    if "multiple_of" in bounds:
        noun = f"{noun}, a multiple of {bounds['multiple_of']},"
    low, high = bounds.get("ge"), bounds.get("le")
    if low is not None and high is not None:
        return f"{noun} from {_number(low)} to {_number(high)}"
    limits = []
    if low is not None:
        limits.append(f"of at least {_number(low)}")
    if "gt" in bounds:
        limits.append(f"above {_number(bounds['gt'])}")
    if high is not None:
        limits.append(f"of at most {_number(high)}")
    if "lt" in bounds:
        limits.append(f"below {_number(bounds['lt'])}")
    if not limits and bounds.get("allow_inf_nan") is False:
        return noun.replace("a number", "a finite number")
    return f"{noun} {' and '.join(limits)}" if limits else noun


def _number(value: float) -> str:
    if isinstance(value, float) and value.is_integer() and math.fabs(value) < 1e15:
        return str(int(value))
    return str(value)
