"""Gives a record of a program as a text that does not depend on places in its files.

Purpose: two records have the same text where nothing but places, names of files and comments
differs, so that `soter diff` compares declarations, and what proofs and code are made of them.
Non-goals: what may differ without consequence (`verify/posed_problems.py`); text for people.
"""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Source, Span
from soter.language.model.typed import TypedProgram

if TYPE_CHECKING:
    from collections.abc import Callable

PLACES = (Span, Source, TypedProgram)
"""Types of parts that are left out: places in files, and the program around a record."""
PLAIN = (bool, int, float, str, bytes, type(None))
"""Types of which two different values have different texts by `repr`."""


def canonical_text(record: object, instead: Callable[[object], object] = lambda part: part) -> str:
    """Gives the text of a record and all of its parts in declared order, with sorted sets.

    A record that occurs again is written as a number, so circular references end. `instead` maps
    each part to the object that is written for it. Raises TypeError for a part of an unknown type.
    """
    numbers: dict[int, int] = {}
    kept: list[object] = []  # so that no number of an object is given to another one
    written: list[str] = []
    todo: list[tuple[bool, object]] = [(False, record)]
    while todo:
        is_text, part = todo.pop()
        if is_text:
            written.append(str(part))
            continue
        part = instead(part)
        if isinstance(part, PLACES):
            continue
        if isinstance(part, Mapping):
            inner = [x for pair in part.items() for x in pair]
        elif isinstance(part, (tuple, list)):
            inner = list(part)
        elif isinstance(part, AbstractSet):
            inner = [(True, text) for text in sorted(canonical_text(x, instead) for x in part)]
            todo += [(True, "}"), *inner[::-1], (True, "{")]
            continue
        elif is_dataclass(part) and not isinstance(part, type):
            if id(part) in numbers:
                written.append(f"#{numbers[id(part)]} ")
                continue
            numbers[id(part)] = len(numbers)
            kept.append(part)
            written.append(type(part).__name__)
            inner = [getattr(part, f.name) for f in fields(part)]
        elif not isinstance(part, PLAIN):
            raise TypeError(f"no text is known of a {type(part).__name__}")
        else:
            written.append(f"{part!r} ")
            continue
        todo += [(True, ")"), *((False, x) for x in inner[::-1]), (True, "(")]
    return "".join(written)
