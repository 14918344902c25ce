"""JSON documents with one thing wrong.

Purpose: a document, and every copy of it in which one place holds a wrong value or is missing.
Non-goals: which values are wrong (the tests say).
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

MISSING = "missing"
"""Instead of a value: the place is left out."""


def damaged(
    document: Any, wrong: Sequence[object]
) -> Iterator[tuple[tuple[Any, ...], object, Any]]:
    """Every place, value and copy with it there; of a list only the first element is a place."""
    for place in list(_places(document)):
        for value in wrong:
            copy = json.loads(json.dumps(document))
            inner = copy
            for part in place[:-1]:
                inner = inner[part]
            if value == MISSING:
                del inner[place[-1]]
            else:
                inner[place[-1]] = value
            yield place, value, copy


def _places(document: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if isinstance(document, dict):
        for name, value in document.items():
            yield (*path, name)
            yield from _places(value, (*path, name))
    elif isinstance(document, list) and document:
        yield (*path, 0)
        yield from _places(document[0], (*path, 0))
