"""Options as fields of a record: range, unit, words and flag in one place; all readers ask it.

Purpose: kinds of values; a record made of keywords, or U001 with every mistake; the signature and
docstring of a method that takes them.
Non-goals: which options there are (each room's record), command lines (`cli/terminal/parser.py`).
"""

from __future__ import annotations

import inspect
import re
from dataclasses import dataclass, field, fields
from importlib import import_module
from operator import index
from typing import TYPE_CHECKING, Any, TypeVar, cast

from soter.diagnostics.diagnostic import Diagnostic, SoterError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    Record = TypeVar("Record")
    Method = TypeVar("Method", bound=Callable[..., Any])

POWERS = {2**63: "2^63", 2**64 - 1: "2^64 - 1"}
SHOWN = 40
"""Characters of a wrong value that a message quotes."""
UNITS = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}
_SIZE = re.compile(r"([0-9]{1,15}(?:\.[0-9]{1,9})?)\s*([KMGT]?)(?:i?B)?", re.IGNORECASE)


@dataclass(frozen=True)
class Kind:
    """What values an option takes. `text`: how a command line reads one; `allowed`: the range.

    `in_python`: what its words say where no command line is, with the unit.
    """

    text: str = ""
    allowed: str = ""
    fits: Callable[[Any], bool] = lambda _: True
    read: Callable[[Any], Any] = lambda given: given
    in_python: str = "{}"


ANYTHING = Kind()
"""Taken as it is: whoever uses it checks it."""
SEVERAL, SWITCH = Kind("several"), Kind("switch")


def choice(*names: str) -> Kind:
    """One of some names."""
    said = f"{', '.join(names[:-1])} or {names[-1]}"
    return Kind("", said, lambda given: given in names)


def whole(low: int, high: int, text: str = "whole", in_python: str = "{}") -> Kind:
    """A whole number."""

    def fits(given: Any) -> bool:  # noqa: ANN401 - whatever a caller gives
        return hasattr(given, "__index__") and not isinstance(given, bool) and low <= given <= high

    return Kind(
        text, f"a whole number from {low} to {POWERS.get(high, high)}", fits, index, in_python
    )


def seconds(low: str, high: int, *, optional: bool = False) -> Kind:
    """A length of time in seconds; `low`: in words, where 0 is one with what it means."""

    def fits(given: object) -> bool:
        if given is None or isinstance(given, bool) or not isinstance(given, (int, float)):
            return given is None and optional
        return 0 <= given <= high and (given > 0 or low.startswith("from 0"))

    return Kind("seconds", f"seconds, {low} {high:,}", fits, in_python="seconds {}")


def size(low: int) -> Kind:
    """Bytes, or a text such as `512M`."""
    said = "write it as 512M or 2G; 1M at least"
    return Kind("size", said, lambda given: low <= (bytes_of(given) or 0) < 2**63, bytes_of)


def bytes_of(given: int | str) -> int | None:
    """Bytes, from a number or a text such as `512M`; None where it is none."""
    if isinstance(given, int):
        return None if isinstance(given, bool) else given
    match = _SIZE.fullmatch(given.strip()) if isinstance(given, str) else None
    return None if match is None else int(float(match[1]) * UNITS[match[2].upper()])


@dataclass(frozen=True)
class Option:
    """What is known of a field of a record.

    `flags`: as a command line has them, with what stands for a value; none where it has none.
    `given`: the default as a caller writes it; `words` may quote it (`{default}`), and how a text
    is written (`{text}`). `told`: its field in the JSON document of a result. `keyword`: whether
    callers in Python have it, too.
    """

    flags: str
    given: Any
    words: str
    kind: Kind
    told: str
    keyword: bool

    def help(self, text: str = "") -> str:
        """The words for a command line; `text`: how a text is written, where one is read."""
        return self.words.format(default=self.given, text=text)

    @property
    def meaning(self) -> str:
        """The words for who gives the value itself: with its unit."""
        return self.kind.in_python.format(self.help())


def option(
    flags: str,
    given: Any,  # noqa: ANN401 - a field of whatever type
    words: str,
    kind: Kind = ANYTHING,
    told: str = "",
    *,
    keyword: bool = True,
) -> Any:  # noqa: ANN401 - the same
    """A field of a record of options."""
    known = Option(flags, given, words, kind, told, keyword)
    default = given if given is None else kind.read(given)
    return field(default=default, metadata={"option": known})


def options_of(record: type, *, keyword: bool = False) -> dict[str, Option]:
    """The options of a record by name, in order, or the keywords of them."""
    known = {f.name: f.metadata["option"] for f in fields(record) if f.metadata}
    return {name: o for name, o in known.items() if o.keyword or not keyword}


def made(record: type[Record], given: Mapping[str, object]) -> Record:
    """The record of keywords; `SoterError` U001 with all mistakes at once, TypeError as a call."""
    options, problems = options_of(record, keyword=True), []
    for name, value in given.items():
        if name not in options:
            raise TypeError(f"got an unexpected keyword argument '{name}'")
        kind = options[name].kind
        if not kind.fits(value):
            message = f"`{name}` cannot be `{str(value)[:SHOWN]}`"
            problems.append(Diagnostic("U001", message, helps=(kind.allowed,)))
    if problems:
        raise SoterError(tuple(problems))
    return record(**{name: options[name].kind.read(value) for name, value in given.items()})


class takes:  # noqa: N801 - a decorator
    """A method with `**options` of a record, `room.file.Class`, shows them: defaults, words.

    The record is imported when somebody asks for the method.
    """

    def __init__(self, record: str) -> None:
        self.record = record

    def __call__(self, method: Method) -> Method:
        """The method, described when it is looked up."""
        self.method = method
        return cast("Method", self)

    def __get__(self, one: object, owner: type | None = None) -> Any:  # noqa: ANN401 - a method
        """The method."""
        if self.record:
            module, _, name = self.record.rpartition(".")
            _describe(self.method, options_of(getattr(import_module(module), name), keyword=True))
            self.record = ""
        return self.method.__get__(one, owner)


def _describe(method: Any, known: Mapping[str, Option]) -> None:  # noqa: ANN401 - as above
    signature = inspect.signature(method)
    own = [p for p in signature.parameters.values() if p.kind != p.VAR_KEYWORD]
    own += [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=o.given)
        for name, o in known.items()
        if name not in signature.parameters
    ]
    method.__signature__ = signature.replace(parameters=own)
    lines = [f"`{name}`: {o.meaning}." for name, o in known.items()]
    method.__doc__ = "\n".join((inspect.cleandoc(method.__doc__ or ""), "", *lines))
