"""Records as JSON objects: one list of fields makes the document and its schema.

Purpose: which fields of a record a document has, under which names, and the object that they make.
Non-goals: the schema: `docs/site/json_schemas.py` reads it off these lists and the records' types.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias, TypeGuard

Made = Mapping[str, Callable[[Any], object]]
Shape: TypeAlias = "JsonObject | dict[str, object]"


def one_of(*values: object) -> dict[str, object]:
    """The schema of what is one of some values, where a type does not say so."""
    return {"enum": list(values)}


class JsonObject:
    """A record as an object."""

    def __init__(
        self,
        record: type | str,
        fields: str,
        made: Made | None = None,
        named: str = "",
        beside: Mapping[str, object] | None = None,
        shapes: Mapping[str, Shape] | None = None,
        **more: Shape,
    ) -> None:
        """`record`: its class, or `room.file.Class` where that is heavy.

        `fields`: each `name`, or `name=path` where the record has it at another place (None on the
        way is null; behind a list or tuple it is that of every entry); with `?` at the end what is
        empty is null, with `*` pairs are an object. `made`: those that a function of the record
        makes. `shapes`, `more`: the objects that values are, also in tuples and mappings, or
        schemas. `named`: its own block in the page. `beside`: what the command adds, with types, or
        may add (`name?`).
        """
        self.record, self.made, self.named = record, made or {}, named
        pairs = [text.partition("=") for text in fields.split()]
        self.paths = {name.rstrip("?*"): path or name for name, _, path in pairs}
        self.beside, self.shapes = beside or {}, {**(shapes or {}), **more}

    def of(self, record: object) -> dict[str, object]:
        """The object."""
        values = {n: self.made.get(n, _at(path))(record) for n, path in self.paths.items()}
        return {name: _plain(value, self.shapes.get(name)) for name, value in values.items()}


def _at(path: str) -> Callable[[Any], object]:
    def value(record: Any) -> object:  # noqa: ANN401 - any record
        for name in path.rstrip("?*").split("."):
            record = _part(record, name)
        if path.endswith("*"):
            return dict(record)
        return (record or None) if path.endswith("?") else record

    return value


def _part(record: object, name: str) -> object:
    if _lists(record):
        return [_part(one, name) for one in record]
    return None if record is None else getattr(record, name)


def _lists(value: object) -> TypeGuard[Sequence[object]]:
    """Whether it is a list of others; a named tuple is a record."""
    return isinstance(value, (list, tuple)) and not hasattr(value, "_fields")


def _plain(value: object, shape: Shape | None) -> object:
    if isinstance(value, Mapping):
        return {str(name): _plain(part, shape) for name, part in value.items()}
    if _lists(value):
        return [_plain(part, shape) for part in value]
    if isinstance(shape, JsonObject) and value is not None:
        return shape.of(value)
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, (str, int, float)):
        return value
    raise TypeError(f"no JSON has a {type(value).__name__}")
