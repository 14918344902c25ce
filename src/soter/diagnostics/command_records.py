"""Records of commands: each option described once, in its field, and results as JSON objects.

A command has two records: that of its options, and that of its result. The file describes both.
Purpose: *a result*, first in the file: a `JsonObject` makes from one list of fields a JSON document
and its schema. *Options*, behind it: an `Option` has range, unit, words and flag in one place.
`make_record` makes the record from keywords, or reports every mistake as U001; `takes` gives the
method that accepts them its signature and docstring. `NEEDS` of a record says which of its options
do nothing without others, and `unused_options` reports them; `GONE` says which a version before
had, and `removed_flags` what to do.
Non-goals: which options there are (each room's record), command lines
(`cli/terminal/command_line.py`), the schema, which `docs/site/json_schemas.py` reads off these
lists.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from importlib import import_module
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeGuard, TypeVar, cast

from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    Record = TypeVar("Record")
    Method = TypeVar("Method", bound=Callable[..., Any])


Made = Mapping[str, Callable[[Any], object]]
Shape: TypeAlias = "JsonObject | dict[str, object] | tuple[JsonObject, dict[str, object]]"


def one_of(*values: object) -> dict[str, object]:
    """The JSON schema of a field that has one of these values."""
    return {"enum": list(values)}


class JsonObject:
    """The fields of a JSON object, and how to compute each from a record."""

    def __init__(
        self,
        record: type | str,
        fields: str,
        made: Made | None = None,
        named: str = "",
        beside: Mapping[str, object] | None = None,
        also: JsonObject | None = None,
        shapes: Mapping[str, Shape] | None = None,
        **more: Shape,
    ) -> None:
        """`record`: its class, or `room.file.Class` where importing it is heavy.

        `fields`: words, each `name` or `name=a.b` (the path to it in the record; None on the way
        gives null, a list gives a list) and a mark: `?` empty becomes null, `*` pairs become an
        object, `/s` ns become seconds. `made`: by name, functions of the record that give a field.
        `shapes`, `more`: by name, the JsonObject of its values, also within lists and mappings, or
        a schema, or both. `named`: the name of its schema. `beside`: fields that the command adds,
        with types; `name?`: those it may add. `also`: a record whose fields may be there, too.
        """
        self.record, self.made, self.named = record, made or {}, named
        pairs = [text.partition("=") for text in fields.split()]
        self.paths = {name.rstrip("?*"): path or name for name, _, path in pairs}
        self.beside, self.shapes = beside or {}, {**(shapes or {}), **more}
        self.also = also

    def of(self, record: object) -> dict[str, object]:
        """The JSON object for a record."""
        values = {n: self.made.get(n, _path_reader(path))(record) for n, path in self.paths.items()}
        return {name: _json_value(value, self.shapes.get(name)) for name, value in values.items()}


def _path_reader(path: str) -> Callable[[Any], object]:
    """A function that reads the value at a path of `JsonObject.fields` from a record."""

    def value(record: Any) -> object:  # noqa: ANN401 - any record
        for name in path.rstrip("?*").removesuffix("/s").split("."):
            record = _field_value(record, name)
        if path.endswith("/s"):
            return None if record is None else record / 1e9
        if path.endswith("*"):
            return dict(record)
        return (record or None) if path.endswith("?") else record

    return value


def _field_value(record: object, name: str) -> object:
    """A field of a record; for a list of records, the list of that field; None for None."""
    if _is_list(record):
        return [_field_value(one, name) for one in record]
    return None if record is None else getattr(record, name)


def _is_list(value: object) -> TypeGuard[Sequence[object]]:
    """Whether a value is a list or tuple, but not a named tuple, which is a record."""
    return isinstance(value, (list, tuple)) and not hasattr(value, "_fields")


def _json_value(value: object, shape: Shape | None) -> object:
    """The JSON for a value of a record; TypeError if JSON has no form for its type."""
    if isinstance(value, Mapping):
        return {str(name): _json_value(part, shape) for name, part in value.items()}
    if _is_list(value):
        return [_json_value(part, shape) for part in value]
    shape = shape[0] if isinstance(shape, tuple) else shape
    if isinstance(shape, JsonObject) and value is not None:
        return shape.of(value)
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, (str, int, float)):
        return value
    raise TypeError(f"no JSON has a {type(value).__name__}")


POWERS = {2**63: "2^63", 2**64 - 1: "2^64 - 1"}
SHOWN = 40
"""Characters of a wrong value that a message quotes."""
UNITS = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}
_SIZE = re.compile(r"([0-9]{1,15}(?:\.[0-9]{1,9})?)\s*([KMGT]?)(?:i?B)?", re.IGNORECASE)


@dataclass(frozen=True)
class Kind:
    """A kind of option, and its values. `text`: the reader for a command line, a name or function.

    `allowed`: the range in words; `fits`: a test of a value; `read`: converts a value that fits.
    `in_python`: a pattern for the option's help in Python, where it has to state the unit.
    """

    text: str | Callable[[str], Any] = ""
    allowed: str = ""
    fits: Callable[[Any], bool] = lambda _: True
    read: Callable[[Any], Any] = lambda value: value
    in_python: str = "{}"
    names: tuple[str, ...] = ()


ANYTHING = Kind()
"""Any value, unchecked: whoever uses it checks it."""
SEVERAL, SWITCH = Kind("several"), Kind("switch")


def read_by(function: Callable[[str], Any]) -> Kind:
    """The kind of option whose text `function` reads; wrong text raises ArgumentTypeError."""
    return Kind(function)


def choice(*names: str) -> Kind:
    """The kind of option whose value is one of these names."""
    return Kind(
        "", f"{', '.join(names[:-1])} or {names[-1]}", lambda value: value in names, names=names
    )


def whole(low: int, high: int, text: str = "whole", in_python: str = "{}") -> Kind:
    """The kind of option whose value is a whole number from `low` to `high`."""

    def fits(value: Any) -> bool:  # noqa: ANN401 - whatever a caller gives
        return hasattr(value, "__index__") and not isinstance(value, bool) and low <= value <= high

    return Kind(
        text, f"a whole number from {low} to {POWERS.get(high, high)}", fits, index, in_python
    )


def seconds(low: str, high: int, *, optional: bool = False) -> Kind:
    """The kind of option for seconds up to `high`; `low`: the lower end, "from 0 ..." allows 0."""

    def fits(value: object) -> bool:
        if value is None or isinstance(value, bool) or not isinstance(value, (int, float)):
            return value is None and optional
        return 0 <= value <= high and (value > 0 or low.startswith("from 0"))

    return Kind("seconds", f"seconds, {low} {high:,}", fits, in_python="seconds {}")


def size(low: int) -> Kind:
    """The kind of option for a size of at least `low` bytes, as a number or text like `512M`."""
    return Kind(
        "size",
        "write it as 512M or 2G; 1M at least",
        lambda value: low <= (bytes_of(value) or 0) < 2**63,
        bytes_of,
    )


def bytes_of(size_: int | str) -> int | None:
    """The bytes that a number or a text like `512M` means; None for anything else."""
    if isinstance(size_, int):
        return None if isinstance(size_, bool) else size_
    match = _SIZE.fullmatch(size_.strip()) if isinstance(size_, str) else None
    return None if match is None else int(float(match[1]) * UNITS[match[2].upper()])


@dataclass(frozen=True)
class Option:
    """The description of one option, which is a field of a record.

    `flags`: its form on a command line, "" if it has none: flags, then one word for its value. `-o
    --output DIR`: a value after either flag. `FILE`: no flag, the position decides. `--diff`: a
    switch, as it has no word for a value. `--format {a,b}`: the value is one of these. `FILE...`:
    at least one value; `[LOG...]`: any number of values. `[SIZE]`: it may be left out; after a
    flag, as in `--report [PATH]`, the value is then "". `default`: the default as a caller writes
    it, Ellipsis if a value is required. `words`: its help, with `{default}`, and `{text}` for the
    form of a text. `json_name`: its field in the JSON document of a result. `keyword`: whether
    callers in Python have the option, too.
    """

    flags: str
    default: Any
    words: str
    kind: Kind
    json_name: str
    keyword: bool

    @property
    def dashed(self) -> bool:
        """Whether a command line names the option by a flag, not by its position."""
        return self.flags.startswith("-")

    @property
    def flag(self) -> str:
        """The option's name on a command line: its long flag, or its first word if it has none."""
        words = self.flags.split()
        return next((w for w in words if w.startswith("--")), words[0]).strip("[].")

    def help(self, text: str = "") -> str:
        """The help for a command line; `text`: the form of its value's text."""
        return self.words.format(default=self.default, text=text)

    @property
    def meaning(self) -> str:
        """The help for callers in Python, which states the unit of the value."""
        return self.kind.in_python.format(self.help())


def option(
    flags: str,
    default: Any,  # noqa: ANN401 - a field of whatever type
    words: str,
    kind: Kind = ANYTHING,
    json_name: str = "",
    *,
    keyword: bool = True,
) -> Any:  # noqa: ANN401 - the same
    """A field for a record of options; its metadata is the `Option` that describes it."""
    known = Option(flags, default, words, kind, json_name, keyword)
    value = default if default in (None, ...) else kind.read(default)
    return field(default=value, metadata={"option": known})


def options_of(record: type, *, keyword: bool = False) -> dict[str, Option]:
    """The options of a record by name, in order; with `keyword`, only those that Python has."""
    return {
        f.name: f.metadata["option"]
        for f in fields(record)
        if f.metadata and (f.metadata["option"].keyword or not keyword)
    }


def unused_options(
    record: type, values: Mapping[str, object], written: Collection[str], *, flags: bool
) -> tuple[Diagnostic, ...]:
    """A U001 for each written option that has no effect, according to `record.NEEDS`.

    Each row of `NEEDS` has a condition and names of options. `a|b`: one of these is written;
    `a=x,y`: it has one of these values; `!a` and `!a=x`: the contrary. `values`: the values of all
    options; `written`: names of the written ones; `flags`: name options as a command line does.
    """
    options, problems = options_of(record), list[Diagnostic]()

    def named(name: str) -> str:
        return options[name].flag if flags else name

    for need, names in getattr(record, "NEEDS", ()):
        negated, ways = need.startswith("!"), need.lstrip("!").split("|")
        parts = [(n, e, v.split(",")) for n, e, v in (way.partition("=") for way in ways)]
        holds = [str(values[n]) in wanted if e else n in written for n, e, wanted in parts]
        words = [named(n) + f" {' or '.join(v) or '(no path)'}" * bool(e) for n, e, v in parts]
        problem = f"does nothing {'beside' if negated else 'without'} `{'` or `'.join(words)}`"
        if any(holds) == negated:
            idle = [n for n in names.split() if n in written]
            problems += [Diagnostic("U001", f"`{named(n)}` {problem}") for n in idle]
    return tuple(problems)


def refuse_needless(so: str, **options: bool) -> None:
    """Raises SoterError U001 for each true keyword, which a method without a record ignores.

    `so`: the condition under which it ignores them, such as "beside `log`".
    """
    if idle := [n for n, is_given in options.items() if is_given]:
        raise SoterError(tuple(Diagnostic("U001", f"`{n}` does nothing {so}") for n in idle))


def removed_flags(record: type, flags: Sequence[str]) -> tuple[Diagnostic, ...]:
    """U001 for each flag in `record.GONE`, which older versions had, with what to do instead."""
    remedies = {flag: remedy for row, remedy in getattr(record, "GONE", ()) for flag in row.split()}
    asked = dict.fromkeys(flag for flag in flags if flag in remedies)
    return tuple([Diagnostic("U001", f"`{f}` is gone", helps=(remedies[f],)) for f in asked])


def make_record(record: type[Record], keywords: Mapping[str, object]) -> Record:
    """A record from keywords; SoterError U001 with all wrong values, TypeError for wrong names.

    A keyword with the default as its value counts as left out.
    """
    options, problems = options_of(record, keyword=True), []
    for name, value in keywords.items():
        if name not in options:
            if gone_flags := removed_flags(record, ("--" + name.replace("_", "-"),)):
                raise SoterError(gone_flags)
            raise TypeError(f"got an unexpected keyword argument '{name}'")
        kind = options[name].kind
        if not kind.fits(value):
            message = f"`{name}` cannot be `{str(value)[:SHOWN]}`"
            problems.append(Diagnostic("U001", message, helps=(kind.allowed,)))
    values = {name: o.default for name, o in options_of(record).items()}
    written = {name for name, value in keywords.items() if value != values[name]}
    problems = problems or [*unused_options(record, {**values, **keywords}, written, flags=False)]
    if problems:
        raise SoterError(tuple(problems))
    return record(**{name: options[name].kind.read(value) for name, value in keywords.items()})


class takes:  # noqa: N801 - a decorator
    """Gives a method with `**options` the signature and docstring of a record's options.

    The record `room.file.Class` is imported when a program first looks the method up.
    """

    def __init__(self, record: str) -> None:
        self.record = record

    def __call__(self, method: Method) -> Method:
        """Keeps the method until a program looks it up."""
        self.method = method
        return cast("Method", self)

    def __get__(self, one: object, owner: type | None = None) -> Any:  # noqa: ANN401 - a method
        """The method, with its signature and docstring."""
        if self.record:
            module, _, name = self.record.rpartition(".")
            _set_signature_and_doc(
                self.method, options_of(getattr(import_module(module), name), keyword=True)
            )
            self.record = ""
        return self.method.__get__(one, owner)


def _set_signature_and_doc(method: Any, known: Mapping[str, Option]) -> None:  # noqa: ANN401 - as above
    signature = inspect.signature(method)
    parameters = [p for p in signature.parameters.values() if p.kind != p.VAR_KEYWORD]
    parameters += [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=o.default)
        for name, o in known.items()
        if name not in signature.parameters
    ]
    method.__signature__ = signature.replace(parameters=parameters)
    lines = [f"`{name}`: {o.meaning}." for name, o in known.items()]
    method.__doc__ = "\n".join((inspect.cleandoc(method.__doc__ or ""), "", *lines))
