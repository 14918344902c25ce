"""The JSON Schemas in docs/schemas, from the lists of fields and the types of the records.

    .venv/bin/python docs/site/json_schemas.py          writes them

Purpose: a file `NAME.json` for every document that `soter` makes of a `JsonObject`, and for every
object of it that has a name.
Non-goals: what the fields mean (docs/json.md); the schemas of `BY_HAND`.
"""

from __future__ import annotations

import ast
import json
import re
import sys
import textwrap
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from importlib import import_module
from inspect import get_annotations, getattr_static
from pathlib import Path
from typing import Any, TypeAlias

from soter.diagnostics.command_records import JsonObject, Shape

Hint: TypeAlias = Any
"""A type, as annotations have it."""
FOLDER = Path(__file__).resolve().parents[1] / "schemas"
DIALECT = "https://json-schema.org/draft/2020-12/schema"
DOCUMENTS = {
    **{
        name: f"soter.cli.{name}"
        for name in (
            "check",
            "test",
            "recheck",
            "verify",
            "campaign",
            "monitor",
            "replay",
            "diff",
            "identify",
        )
    },
    "measure": "soter.api.measuring",
    "run": "soter.simulate.run_fields",
}
"""Name of a schema -> the module that has its `DOCUMENT`."""
WIDTH = 120
TYPES = {str: "string", bool: "boolean", int: "integer", float: "number", type(None): "null"}


def schemas() -> dict[str, dict[str, Any]]:
    """The schemas by name."""
    made: dict[str, dict[str, Any]] = {}
    for name, module in DOCUMENTS.items():
        document = import_module(module).DOCUMENT
        made[name] = of_object(document)
        for part in named(document):
            made[part.named] = of_object(part)
    return made


def named(document: JsonObject) -> Iterator[JsonObject]:
    """The objects of a document that have a schema of their own."""
    for shape in document.shapes.values():
        if isinstance(shape, JsonObject):
            if shape.named:
                yield shape
            yield from named(shape)


def of_object(what: JsonObject) -> dict[str, Any]:
    """The schema of an object: all its fields are there, but those that a command may add."""
    record = class_of(what.record)
    others = of_object(what.also)["properties"] if what.also else {}
    properties = {}
    for name, path in what.paths.items():
        hint = returned(what.made[name]) if name in what.made else type_at(record, path)
        properties[name] = of_type(hint, what.shapes.get(name), f"{record.__name__}.{name}")
    beside = {n.rstrip("?"): of_type(t, None, n) for n, t in what.beside.items()}
    required = [*(n for n in what.beside if not n.endswith("?")), *properties]
    return {
        "type": "object",
        "properties": {**beside, **properties, **others},
        "required": required,
    }


def class_of(record: type | str) -> type:
    """The class of a record."""
    if isinstance(record, type):
        return record
    module, _, name = record.rpartition(".")
    found: type = getattr(import_module(module), name)
    return found


def type_at(record: type, path: str) -> Hint:
    """The type of what stands at a path of a record; with None where a part of it may be none."""
    empty = path.endswith("?")
    hint: Hint = record
    for name in path.rstrip("?*").removesuffix("/s").split("."):
        inner, none = without_none(hint)
        empty = empty or none
        hint = member(inner, name)
    if path.endswith("/s"):
        empty, hint = empty or without_none(hint)[1], float
    if path.endswith("*"):
        hint = Mapping[str, typing.get_args(typing.get_args(hint)[0])[1]]  # type: ignore[misc]
    return hint | None if empty else hint


def without_none(hint: Hint) -> tuple[Hint, bool]:
    """A type without None, and whether it had it."""
    parts = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    left = [p for p in parts if p is not type(None)]
    return (left[0] if len(left) == 1 else hint), len(left) < len(parts)


def member(record: type, name: str) -> Hint:
    """The type of a field, or of what a property gives; a list of it behind a list or tuple."""
    if typing.get_origin(record) in (list, tuple):
        return list[member(typing.get_args(record)[0], name)]  # type: ignore[misc]
    for base in record.__mro__:
        text = get_annotations(base).get(name)
        if text is not None:
            return meant(text, base.__module__)
    made = getattr_static(record, name)
    return returned(made.func if isinstance(made, cached_property) else made.fget)


def returned(function: Callable[..., object]) -> Hint:
    """The type of what a function gives, or a class."""
    if isinstance(function, type):
        return function
    return meant(get_annotations(function)["return"], function.__module__)


def meant(text: str, module: str) -> Hint:
    """What an annotation of a file means."""
    holder = types.SimpleNamespace(__annotations__={"it": text})
    names = vars(import_module(module))
    return typing.get_type_hints(holder, names, ImportedNames(module))["it"]


class ImportedNames(dict[str, object]):
    """Names that a file imports for annotations only, imported when they are asked for."""

    def __init__(self, module: str) -> None:
        super().__init__()
        text = Path(str(import_module(module).__file__)).read_text(encoding="utf-8")
        self.places = {
            one.name: str(node.module)
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.ImportFrom)
            for one in node.names
        }

    def __missing__(self, name: str) -> object:
        if name not in self.places:
            raise KeyError(name)
        return getattr(import_module(self.places[name]), name)


def of_type(hint: Hint, shape: Shape | None, where: str) -> dict[str, Any]:
    """The schema of a type; `shape`: what the record or value in it is."""
    if isinstance(shape, Mapping) and "$ref" in shape:
        return dict(shape)
    inner, none = without_none(hint)
    if none:
        return or_null(of_type(inner, shape, where))
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        if args[1] is object:
            return {"type": "object"}
        return {"type": "object", "additionalProperties": of_type(args[1], shape, where)}
    if isinstance(origin, type) and issubclass(origin, Iterable):
        return {"type": "array", "items": of_type(args[0], shape, where)}
    if isinstance(shape, tuple):
        return {"anyOf": [of_type(hint, one, where) for one in shape]}
    if isinstance(shape, JsonObject):
        return {"$ref": f"{shape.named}.json"} if shape.named else of_object(shape)
    if shape is not None:
        return dict(shape)
    if hint in TYPES:
        return {"type": TYPES[hint]}
    if hint is Path:
        return {"type": "string"}
    raise TypeError(f"{where}: say what a {hint} is in a document")


def or_null(schema: dict[str, Any]) -> dict[str, Any]:
    """The same, or null."""
    if "$ref" in schema:
        return {"anyOf": [schema, {"type": "null"}]}
    if "enum" in schema:
        return {"enum": list(dict.fromkeys([*schema["enum"], None]))}
    return {**schema, "type": [schema["type"], "null"]}


def laid_out(value: object, indent: str = "", head: int = 0) -> str:
    """JSON; a part stands on one line where it fits behind `head` characters, but for objects."""
    flat = re.sub(r"\{(?=.)", "{ ", json.dumps(value)).replace("}", " }")
    object_ = isinstance(value, dict) and "properties" in value
    if len(indent) + head + len(flat) < WIDTH and not object_:
        return flat
    inner = f"{indent}  "
    if isinstance(value, list):
        lines = textwrap.wrap(flat[1:-1], WIDTH, initial_indent=inner, subsequent_indent=inner)
        return "\n".join(("[", *lines, f"{indent}]"))
    assert isinstance(value, dict)
    parts = [
        f"{inner}{json.dumps(name)}: {laid_out(part, inner, len(name) + 4)}"
        for name, part in value.items()
    ]
    return "{\n" + ",\n".join(parts) + f"\n{indent}}}"


def texts() -> dict[str, str]:
    """The text of every file by its name."""
    made = schemas()
    return {f"{n}.json": laid_out({"$schema": DIALECT, **s}) + "\n" for n, s in made.items()}


if __name__ == "__main__":
    written = texts()
    for name, text in written.items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    sys.stdout.write(f"{len(written)} schemas\n")
