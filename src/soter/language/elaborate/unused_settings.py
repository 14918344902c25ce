"""Warns of settings of instances that change nothing.

Purpose: W010 for `set K` of an instance in which nothing reads K.
Non-goals: values (`system_numbers.py`); settings of a whole system, which may be for later parts.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from soter.language.model import typed

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.elaborate.instantiate import PlacedInstance, SubSystem
    from soter.language.model.system import Topic

    Reads = frozenset[typed.ParamSymbol]


class Idle:
    """Collects which parameters the instances of a flat system read, by their paths."""

    def __init__(self) -> None:
        self._reads: dict[str, set[typed.ParamSymbol]] = {}
        self._known: dict[object, Reads] = {}

    def enter(
        self, parts: Iterable[SubSystem], placed: Iterable[PlacedInstance], topics: Iterable[Topic]
    ) -> None:
        """Enters what all parts of a system read."""
        for part in parts:
            self._enter(part.prefix[:-1], params_read(part.system.properties, part.system.inputs))
        for p in placed:
            self._enter(p.name, self._of(p.symbol).union(*map(self._of, p.replaced.values())))
        for t in topics:
            home = t.name.removesuffix(t.symbol.name).rstrip(".")
            self._enter(home, params_read(t.symbol.values, t.symbol.default, t.symbol.max_age))

    def report(self, sets: Iterable[typed.SetSymbol], diagnostics: Diagnostics) -> None:
        """Warns W010 of each of these settings, with full paths, that nothing there reads.

        Of settings in a loop it warns once, of the first one.
        """
        told: set[Span] = set()
        for item in sets:
            if item.param in self._reads.get(item.path, ()) or item.span in told:
                continue
            told.add(item.span)
            diagnostics.warning(
                "W010",
                f"nothing in `{item.path}` reads the parameter `{item.param.name}`",
                item.span,
                "this changes nothing",
                also=((item.param.span, "the parameter"),),
                notes=("the sets of topics belong to the system that they stand in",),
            )

    def _of(self, symbol: object) -> Reads:
        if symbol not in self._known:
            self._known[symbol] = params_read(symbol)
        return self._known[symbol]

    def _enter(self, path: str, reads: Reads) -> None:
        """Enters reads for the instance at `path` and all around it."""
        while path:
            self._reads.setdefault(path, set()).update(reads)
            path = path.rpartition(".")[0]


def params_read(*roots: object) -> Reads:
    """Parameters that parts of a checked program read, also in the functions that they call.

    What a topic's own declaration reads does not count for a part that reads the topic.
    """
    params: set[typed.ParamSymbol] = set()
    seen: set[int] = set()
    todo = list(roots)
    while todo:
        node = todo.pop()
        kind: Any = type(node)
        if isinstance(node, (tuple, list)):
            todo.extend(node)
        elif isinstance(node, dict):
            todo.extend(node.values())
        elif isinstance(node, typed.ParamRead):
            params.add(node.param)
        elif _is_code(kind) and id(node) not in seen:
            seen.add(id(node))
            todo.extend(vars(node).values())
    return frozenset(params)


@cache
def _is_code(kind: type) -> bool:
    return kind.__module__ == typed.__name__ and not issubclass(kind, typed.TopicSymbol)
