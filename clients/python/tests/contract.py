"""Compares the types of the package with `docs/openapi.json`, the contract that the daemon serves.

    class of an answer       each property of the schema is a field, which accepts every value that the schema allows
    class of a request       as above; a required property has no default
    Literal                  the same values as the schema's enum

An answer of a newer daemon may have more properties than its class: the client ignores them.
"""

from __future__ import annotations

import dataclasses
import types
from collections.abc import Iterator
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

REFERENCE = "#/components/schemas/"
#: The Python type of each JSON type.
SIMPLE: dict[str, Any] = {"string": str, "integer": int, "number": float, "boolean": bool}


def aliases_of(module: types.ModuleType) -> dict[str, Any]:
    """The `Literal` types of a module by their names."""
    return {name: value for name, value in vars(module).items() if get_origin(value) is Literal}


def classes_of(*modules: types.ModuleType) -> list[type]:
    """The dataclasses that the modules define."""
    return [
        value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type) and dataclasses.is_dataclass(value) and value.__module__ == module.__name__
    ]


class Contract:
    """The schemas of the contract, and the differences from them."""

    def __init__(self, document: dict[str, Any]) -> None:
        self.schemas: dict[str, dict[str, Any]] = document["components"]["schemas"]

    def alias(self, name: str, alias: Any) -> Iterator[str]:
        """Differences between a `Literal` and the enum of the same name."""
        found = set(self.schemas.get(name, {}).get("enum", ()))
        if found != set(get_args(alias)):
            yield f"{name}: the contract has {sorted(found)}, the client {sorted(get_args(alias))}"

    def answer(self, cls: type, schema_name: str | None = None) -> Iterator[str]:
        """Differences that would keep the client from reading an answer."""
        name = schema_name or cls.__name__
        schema = self.schemas.get(name)
        if schema is None:
            yield f"{name} is not in the contract"
            return
        if schema_name is None:
            for missing in sorted(set(schema["properties"]) - {field.name for field, _ in _fields(cls)}):
                yield f"{cls.__name__} has no {missing}: {schema['properties'][missing]}"
        for field, hint in _fields(cls):
            at = f"{cls.__name__}.{field.name} of {name}"
            has_default = _has_default(field)
            served = schema["properties"].get(field.name)
            if served is None:
                # In a class for several kinds of answers, some fields belong to only some of them.
                if schema_name is None or not has_default:
                    yield f"{at} is not in the contract"
                continue
            if not has_default and field.name not in schema.get("required", ()):
                yield f"{at} may be missing, and the client demands it"
            yield from self._compare(at, hint, served, optional=has_default)

    def request(self, cls: type) -> Iterator[str]:
        """Differences that would make the daemon refuse a request, or keep a client from making it."""
        schema = self.schemas[cls.__name__]
        names = {field.name for field, _ in _fields(cls)}
        for name in sorted(names ^ set(schema["properties"])):
            yield f"{cls.__name__}.{name} is only in {'the client' if name in names else 'the contract'}"
        for field, hint in _fields(cls):
            at = f"{cls.__name__}.{field.name}"
            must = field.name in schema.get("required", ())
            if must == _has_default(field):
                yield f"{at} {'must' if must else 'need not'} be sent, and the client has it otherwise"
            if field.name in schema["properties"]:
                # The client omits values that are None.
                yield from self._compare(at, hint, schema["properties"][field.name], optional=not must)

    def _compare(self, at: str, hint: Any, schema: dict[str, Any], *, optional: bool) -> Iterator[str]:
        """With `optional`, None in the hint may also mean that the property is missing."""
        if hint is Any:
            return
        wanted, takes_none = _without_none(hint)
        served, nullable = _without_null(schema)
        if nullable and not takes_none:
            yield f"{at} may be null, and the client does not accept it"
        if takes_none and not nullable and not optional:
            yield f"{at} is never null, and the client says that it may be"
        if not self._fits(wanted, served):
            yield f"{at} is {served} in the contract and {wanted} in the client"

    def _fits(self, hint: Any, schema: dict[str, Any]) -> bool:
        name = schema.get("$ref", "").removeprefix(REFERENCE)
        target = self.schemas[name] if name else schema
        origin, arguments = get_origin(hint), get_args(hint)
        if origin is dict:
            return target.get("type") == "object"
        if dataclasses.is_dataclass(hint) and isinstance(hint, type):
            return bool(name == hint.__name__)
        if "enum" in target:
            return origin is Literal and set(arguments) == set(target["enum"])
        if target.get("type") == "array":
            return origin in (tuple, list) and self._fits(arguments[0], target["items"])
        return SIMPLE.get(str(target.get("type"))) is hint


def _fields(cls: type) -> list[tuple[Any, Any]]:
    hints = get_type_hints(cls)
    return [(field, hints[field.name]) for field in dataclasses.fields(cls)]


def _has_default(field: dataclasses.Field[Any]) -> bool:
    return field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING


def _without_none(hint: Any) -> tuple[Any, bool]:
    if get_origin(hint) not in (Union, types.UnionType):
        return hint, False
    parts = [part for part in get_args(hint) if part is not type(None)]
    return (parts[0] if len(parts) == 1 else hint), len(parts) < len(get_args(hint))


def _without_null(schema: dict[str, Any]) -> tuple[dict[str, Any], bool]:
    if "oneOf" in schema:
        parts = [part for part in schema["oneOf"] if part != {"type": "null"}]
        return (parts[0] if len(parts) == 1 else schema), len(parts) < len(schema["oneOf"])
    if isinstance(schema.get("type"), list):
        parts = [part for part in schema["type"] if part != "null"]
        return {**schema, "type": parts[0] if len(parts) == 1 else parts}, "null" in schema["type"]
    return schema, False
