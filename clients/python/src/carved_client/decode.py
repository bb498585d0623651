"""Converts JSON into dataclasses by their type hints.

Unknown keys are ignored, so that a newer daemon does not break an older client. For the same reason a value outside a
`Literal` is passed on unchanged. A missing key or a wrong type is an error that names the place.
"""

from __future__ import annotations

import dataclasses
import types
from functools import cache
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from .errors import MalformedAnswer

T = TypeVar("T")


def decode(cls: type[T], value: object, at: str = "") -> T:
    """Makes a `cls` from parsed JSON."""
    result: T = _decode(cls, value, at)
    return result


@cache
def _hints(cls: type) -> dict[str, Any]:
    return get_type_hints(cls)


def _decode(hint: Any, value: object, at: str) -> Any:
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return _decode_class(hint, value, at)
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        if value is None and type(None) in arguments:
            return None
        return _decode(next(a for a in arguments if a is not type(None)), value, at)
    if origin is Literal:
        return _require(value, str, at)
    if origin is tuple:
        items = _require(value, list, at)
        return tuple(_decode(arguments[0], item, f"{at}/{i}") for i, item in enumerate(items))
    if origin is list:
        items = _require(value, list, at)
        return [_decode(arguments[0], item, f"{at}/{i}") for i, item in enumerate(items)]
    if origin is dict:
        fields = _require(value, dict, at)
        return {key: _decode(arguments[1], item, f"{at}/{key}") for key, item in fields.items()}
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if hint in (Any, object):
        return value
    return _require(value, hint, at)


def _require(value: object, wanted: type[T], at: str) -> T:
    if not isinstance(value, wanted) or (isinstance(value, bool) and wanted is not bool):
        raise MalformedAnswer(f"{at or '/'}: expected {wanted.__name__}, found {value!r:.80}")
    return value


def _decode_class(cls: type, value: object, at: str) -> Any:
    fields = _require(value, dict, at)
    found: dict[str, Any] = {}
    for field in dataclasses.fields(cls):
        if field.name in fields:
            found[field.name] = _decode(_hints(cls)[field.name], fields[field.name], f"{at}/{field.name}")
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise MalformedAnswer(f"{at}/{field.name} is missing")
    return cls(**found)
