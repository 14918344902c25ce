"""The schemas of docs/schemas, and whether a document keeps to them.

Purpose: one place that reads them, so that what is documented is what is tested.
Non-goals: all of JSON Schema; only the words that they use.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "schemas"
SCHEMAS: dict[str, dict[str, Any]] = {
    path.name: json.loads(path.read_text(encoding="utf-8")) for path in FOLDER.glob("*.json")
}
MADE = (
    *("check", "test", "recheck", "verify", "run", "campaign", "monitor", "replay", "measure"),
    *("diff", "identify"),
)
"""Documents whose schemas `docs/site/json_schemas.py` makes: they have all fields."""
TYPES: dict[str, tuple[type, ...]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "boolean": (bool,),
    "integer": (int,),
    "number": (int, float),
    "null": (type(None),),
}


def problems_of(document: dict[str, Any]) -> list[str]:
    """What is wrong with a document, whichever command it is of; nothing undocumented is in it."""
    problems = list(_check(SCHEMAS["common.json"], document, ""))
    known = set(SCHEMAS["common.json"]["properties"]) | {"file"}
    name = document.get("command") or ""
    several = name == "check" and "files" in document
    schema = SCHEMAS.get("check_several.json" if several else f"{name}.json")
    if schema is not None:
        known |= set(schema["properties"])
        done = document["exit"] in (0, 3, 4, 130) and "help" not in document
        if done and not _nothing_reached(document):
            problems += _check(schema, document, "", strict=name in MADE)
        else:
            problems += _check({**schema, "required": []}, document, "")
    problems += [f"{name}: not documented" for name in set(document) - known]
    return problems


def problems_of_fields(document: dict[str, Any]) -> list[str]:
    """The fields of a document of another version that are not documented, or of another type."""
    schema = SCHEMAS[f"{document['command']}.json"]
    known = {"file", *SCHEMAS["common.json"]["properties"], *schema["properties"]}
    told = [f".{name}: not documented" for name in set(document) - known]
    told += _check(SCHEMAS["common.json"], document, "", strict=True)
    told += _check(schema, document, "", strict=True)
    return [problem for problem in told if not problem.endswith(": missing")]


def _nothing_reached(document: dict[str, Any]) -> bool:
    return document["exit"] == 130 and "interrupted" not in document


def _check(schema: dict[str, Any], value: object, path: str, *, strict: bool = False) -> Any:
    """What is wrong; `strict`: so is a field that the schema of an object in it has not."""
    if "$ref" in schema:
        yield from _check(SCHEMAS[schema["$ref"]], value, path, strict=strict)
        return
    if "anyOf" in schema:
        problems = [list(_check(s, value, path, strict=strict)) for s in schema["anyOf"]]
        yield from min(problems, key=len)
        return
    if "const" in schema and value != schema["const"]:
        yield f"{path}: {value!r} is not {schema['const']!r}"
    if "enum" in schema and value not in schema["enum"]:
        yield f"{path}: {value!r} is not one of {schema['enum']}"
    if "type" in schema and not _is(schema["type"], value):
        yield f"{path}: {value!r} is no {schema['type']}"
        return
    if isinstance(value, dict):
        properties = schema.get("properties", {})
        yield from (f"{path}.{n}: missing" for n in schema.get("required", []) if n not in value)
        if strict and path and properties:
            yield from (f"{path}.{n}: not documented" for n in value if n not in properties)
        for name, part in value.items():
            inner = properties.get(name, schema.get("additionalProperties", {}))
            yield from _check(inner, part, f"{path}.{name}", strict=strict)
    if isinstance(value, list):
        for index, part in enumerate(value):
            yield from _check(schema.get("items", {}), part, f"{path}[{index}]", strict=strict)


def _is(wanted: str | list[str], value: object) -> bool:
    names = [wanted] if isinstance(wanted, str) else wanted
    if isinstance(value, bool):
        return "boolean" in names
    return any(isinstance(value, TYPES[name]) for name in names)
