"""Everything that somebody else's programs, scripts and firmware may rely on, a line each.

    .venv/bin/python tests/public_surface.py          writes public_surface.txt

Purpose: the public surface of Soter as docs/stability.md promises it, read off the package: what
`import soter`, `soter.gym` and `soter.remote` give, command lines, exit codes, JSON documents, the
grammar, the C that ships, keys of mappings, versions of files. `test_public_surface.py` compares.
Non-goals: what any of it means; the words of messages, which are not promised.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import soter
from soter.cli.main import COMMANDS, command_parser
from soter.cli.terminal import command_outcome
from soter.language.syntax.parsing.parser import EDITION

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[1]
CORPUS = ROOT / "tests" / "compatibility"
RECORD = CORPUS / "public_surface.txt"
SCHEMAS = ROOT / "docs" / "schemas"
RUNTIME = Path(soter.__file__).parent / "runtime"
HEADERS = (
    *("soter_firmware.h", "soter_grant.h", "soter_lease.h", "soter_check.h"),
    *("posix/soter_actuator.h", "posix/soter_channel.h", "posix/soter_outside.h"),
    *("posix/soter_status.h", "cortex_m/soter_board.h"),
)
"""What docs/deploy.md, real-time.md and bare-metal.md tell somebody to include or to define."""
OF_SOTER_H = ("enum soter_fault:", "enum soter_mode:")
"""What these need of `soter.h`; the rest of it is between generated C and its run-time."""
BUILT = CORPUS / "0.1.0" / "programs" / "wall"
GENERATED = {
    ("shuttle_firmware", "c"): ("Vehicle_firmware.h", "shuttle_firmware_lease.h"),
    ("remote", "posix"): ("remote_channels.h",),
}
"""By program and target, the generated headers that somebody includes: each stands for its kind."""
OF_A_BUILD = re.compile(r"_LAYOUT|[0-9a-f]{16}")
"""What is another one with every version: hashes of how a state lies in memory."""
EXITS = (
    *("FINE", "DIAGNOSTICS", "USAGE", "VIOLATED", "UNDECIDED", "NOT_RECHECKED"),
    *("INTERNAL", "INTERRUPTED"),
)
FORMATS = {
    "certificate": "soter.certificate.reading.folder.FORMAT",
    "trace": "soter.explore.trace.SCHEMA",
    "campaign.json": "soter.campaign.store.SCHEMA",
    "channels.json": "soter.targets.CHANNELS_SCHEMA",
    "JSON documents": "soter.cli.terminal.command_outcome.SCHEMA",
}
MAPPING = "soter.mapping"
KEYS = {
    "the mapping": "read_mapping.KEYS",
    "time": "read_mapping.TIME_KEYS",
    "mavlink": "mavlink_dialects.KEYS",
    "a topic": "topic_mapping_parser.TOPIC_KEYS",
    "a source": "topic_mapping_parser.SOURCE_KEYS",
    "stamp": "topic_mapping_parser.STAMP_KEYS",
    "qos": "topic_mapping_parser.KEYS",
    "a row of fields": "leaf_mapping_parser.LEAF_KEYS",
    "a vector of fields": "leaf_mapping_parser.VECTOR_KEYS",
}


def named(path: str) -> Any:
    """What a module has under a name."""
    module, _, name = path.rpartition(".")
    return getattr(import_module(module), name)


# ---------------------------------------------------------------- Python


def python() -> Iterator[str]:
    """Names, parameters and defaults of what three modules give."""
    for name in ("soter", "soter.remote", "soter.gym"):
        module = import_module(name)
        for public in sorted(module.__all__):
            thing = getattr(module, public)
            if inspect.isclass(thing):
                yield from of_class(f"{name}.{public}", thing)
            elif callable(thing):
                yield from of_function(f"{name}.{public}", thing)
            else:
                yield f"{name}.{public}"


def of_class(path: str, cls: type) -> Iterator[str]:
    """A class with its bases of this package: how it is made, and what it has."""
    own = [c for c in cls.__mro__ if c.__module__.split(".")[0] == "soter"]
    names = {n for c in own for n in (*vars(c), *getattr(c, "__annotations__", {}))}
    yield f"{path} ({', '.join(b.__name__ for b in cls.__bases__)})"
    if "__init__" in names:
        yield from of_function(path, cls)
    for name in sorted(n for n in names if not n.startswith("_")):
        member = inspect.getattr_static(cls, name, None)
        if hasattr(member, "__get__") and not isinstance(member, property):
            member = getattr(cls, name)
        if inspect.isroutine(member):
            yield from of_function(f"{path}.{name}", member)
        else:
            yield f"{path}.{name}"


def of_function(path: str, function: Any) -> Iterator[str]:
    """A function, a line for it and one for each parameter; `*`: by its name alone."""
    yield f"{path}()"
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name not in ("self", "cls"):
            yield f"{path}({parameter_text(parameter)})"


def parameter_text(parameter: inspect.Parameter) -> str:
    """A parameter with its default."""
    by_name = "*, " if parameter.kind == parameter.KEYWORD_ONLY else ""
    kind = parameter.kind
    stars = "*" * (1 if kind == kind.VAR_POSITIONAL else 2 if kind == kind.VAR_KEYWORD else 0)
    default = "" if parameter.default is parameter.empty else f" = {parameter.default!r}"
    return f"{by_name}{stars}{parameter.name}{default}"


# ---------------------------------------------------------------- commands


def commands() -> Iterator[str]:
    """Every option and argument of every command, as its parser has it."""
    for name in (n for n in COMMANDS if n != "help"):
        for action in command_parser(name)._actions:
            what = "/".join(action.option_strings) or str(action.dest).upper()
            takes = "" if action.nargs is None else f" nargs {action.nargs}"
            among = f" {{{','.join(map(str, action.choices))}}}" if action.choices else ""
            value = f" {action.metavar}" if action.metavar and action.option_strings else ""
            default = "" if action.default in (None, "==SUPPRESS==") else f" = {action.default}"
            yield f"soter {name} {what}{value}{among}{takes}{default}"


def exits() -> Iterator[str]:
    """Exit codes, by what they are called."""
    for name in EXITS:
        yield f"{getattr(command_outcome, name)} {name}"


# ---------------------------------------------------------------- documents, grammar, files


def documents() -> Iterator[str]:
    """The fields of docs/schemas with their types; `?`: not always there.

    What several documents refer to stands in each of them: no name of a schema is promised.
    """
    parts = {p.name: json.loads(p.read_text(encoding="utf-8")) for p in SCHEMAS.glob("*.json")}
    inner = set(re.findall(r'"\$ref": "(.*?)"', json.dumps(parts)))
    for name in sorted(parts.keys() - inner):
        yield from of_schema(name.removesuffix(".json"), resolved(parts[name], parts))


def resolved(schema: Any, parts: dict[str, Any]) -> Any:
    """A schema with what it refers to in its place."""
    if isinstance(schema, list):
        return [resolved(one, parts) for one in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return resolved(parts[schema["$ref"]], parts)
    return {name: resolved(part, parts) for name, part in schema.items()}


def of_schema(path: str, schema: dict[str, Any]) -> Iterator[str]:
    """The fields below a place of a document; `[]`: of each entry, `.*`: of each value."""
    for other in schema.get("anyOf", ()):
        yield from of_schema(path, other)
    for name, inner in schema.get("properties", {}).items():
        mark = "" if name in schema.get("required", ()) else "?"
        yield f"{path}.{name}{mark}: {type_text(inner)}"
        yield from of_schema(f"{path}.{name}", inner)
    yield from of_schema(f"{path}[]", schema["items"]) if "items" in schema else ()
    if isinstance(schema.get("additionalProperties"), dict):
        yield from of_schema(f"{path}.*", schema["additionalProperties"])


def type_text(schema: dict[str, Any]) -> str:
    """What a value is."""
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(map(type_text, schema["anyOf"])))
    if "enum" in schema or "const" in schema:
        return " | ".join(map(json.dumps, schema.get("enum", [schema.get("const")])))
    given = schema.get("type", "anything")
    inner = schema.get("items", schema.get("additionalProperties"))
    of = f" of {type_text(inner)}" if isinstance(inner, dict) else ""
    kinds = [given] if isinstance(given, str) else given
    return " or ".join(f"{k}{of}" if k in ("array", "object") else k for k in kinds)


def grammar() -> Iterator[str]:
    """The edition, and every rule of docs/grammar.ebnf on a line."""
    yield f"edition {EDITION}"
    text = (ROOT / "docs" / "grammar.ebnf").read_text(encoding="utf-8")
    for rule in re.split(r"\s;\s*\n", re.sub(r"\(\*.*?\*\)", "", text, flags=re.DOTALL)):
        if rule.strip():
            yield " ".join(rule.split())


def mappings() -> Iterator[str]:
    """What each table of a mapping may say."""
    for table, path in KEYS.items():
        yield from (f"{table}: {key}" for key in named(f"{MAPPING}.{path}"))


def files() -> Iterator[str]:
    """Versions of the files that one Soter writes and another one reads."""
    for name, path in FORMATS.items():
        yield f"{name}: {named(path)}"


# ---------------------------------------------------------------- C


def c() -> Iterator[str]:
    """Macros, types, fields, prototypes of the headers that somebody includes."""
    for name in HEADERS:
        text = (RUNTIME / name).read_text(encoding="utf-8")
        yield from (f"{name}: {line}" for line in of_header(text))
    own = of_header((RUNTIME / "soter.h").read_text(encoding="utf-8"))
    yield from (f"soter.h: {line}" for line in own if line.startswith(OF_SOTER_H))
    for (program, target), names in GENERATED.items():
        with TemporaryDirectory() as folder:
            soter.load(BUILT / f"{program}.soter").build(target, folder)
            for name in names:
                text = (Path(folder) / name).read_text(encoding="utf-8")
                lines = (line for line in of_header(text) if not OF_A_BUILD.search(line))
                yield from (f"generated {name}: {line}" for line in lines)


def of_header(text: str) -> Iterator[str]:
    """What a header declares; a struct or an enum has a line for each member."""
    text = re.sub(r"/\*.*?\*/", " ", text, flags=re.DOTALL).replace("\\\n", " ")
    text = re.sub(r'extern "C" \{|#ifdef __cplusplus\n\}\n#endif', "", text)
    for line in re.findall(r"^#define (?!\w+_H$).*$", text, flags=re.MULTILINE):
        yield " ".join(line.split())
    text = re.sub(r"^#.*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"(\b(?:inline|SOTER_INLINE)\b[^;{]*)\{(?:[^{}]|\{[^{}]*\})*\}", r"\1;", text)
    for found in re.finditer(r"([^;{}]*)(?:\{([^{}]*)\}([^;{}]*))?;", text):
        head, body, tail = (" ".join((part or "").split()) for part in found.groups())
        if not body:
            yield head
            continue
        owner = f"{head} {tail}".removeprefix("typedef ")
        members = (part.strip() for part in re.split(r"[;,]" if "enum" in head else ";", body))
        yield from (f"{owner}: {member}" for member in members if member)


SECTIONS = {
    "Python": python,
    "commands": commands,
    "exit codes": exits,
    "JSON documents": documents,
    "grammar": grammar,
    "mapping files": mappings,
    "C interface": c,
    "versions of files": files,
}


def surface() -> dict[str, list[str]]:
    """The lines by kind of surface."""
    return {kind: list(dict.fromkeys(lines())) for kind, lines in SECTIONS.items()}


def recorded(text: str) -> dict[str, list[str]]:
    """The same of a record."""
    parts = re.split(r"^\[(.*)\]\n", text, flags=re.MULTILINE)
    return {k: lines.split("\n")[:-2] for k, lines in zip(parts[1::2], parts[2::2], strict=True)}


def text_of(lines: dict[str, list[str]]) -> str:
    """A record."""
    return "".join(f"[{kind}]\n" + "\n".join((*those, "", "")) for kind, those in lines.items())


if __name__ == "__main__":
    made = surface()
    RECORD.write_text(text_of(made), encoding="utf-8")
    sys.stdout.write(f"{sum(map(len, made.values()))} lines\n")
