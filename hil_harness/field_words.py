"""What a pydantic field takes, in words for people: ``a whole number from 1 to 65535``."""

import math
from collections.abc import Mapping
from enum import Enum
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen, MultipleOf
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from hil_harness.toml_source import toml_text


def wanted(field: FieldInfo | None) -> str:
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
    if origin is dict:
        return "a table"
    if origin in {tuple, list, set, frozenset}:
        return _list_words(get_args(annotation), bounds)
    if isinstance(annotation, type):
        if issubclass(annotation, Enum):
            return _one_of([member.value for member in annotation])
        if issubclass(annotation, BaseModel):
            return f"a table with {', '.join(keys_of(annotation))}"
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


def keys_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of *model* by the keys under which they stand in a file."""
    return {field.alias or name: field for name, field in model.model_fields.items()}
