"""Limits that `safe` and the properties of a system set to single signals.

Purpose: `abs(motion.x) < WALL`, also inside of functions that only return it, as two levels of the
signal `motion.x`, so that a report can draw them on its axis.
Non-goals: limits of several signals together: what is no bound of one signal is left out, and so a
report that shows no limit says nothing. Nothing is decided here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.predicates import conjuncts, returned
from soter.language.evaluate.statements import Evaluator
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import FloatType, IntType, RecordType, leaf_name

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model.system import Scope, System

BELOW, ABOVE = {"<", "<="}, {">", ">="}
OPENED_MAX = 8
"""Functions inside functions that are opened."""


@dataclass(frozen=True)
class Limit:
    """`signal` (`motion.x`, `c.x`) may not pass `value`; `by` says who demands it."""

    signal: str
    value: float
    by: str


@dataclass(frozen=True)
class _ScaledSignal:
    """`scale * signal + offset`, or with `folded` of the amount of the signal."""

    signal: str
    scale: float
    offset: float
    folded: bool = False


def limits(system: System) -> list[Limit]:
    """The limits of every module's `safe` and of every property `always`, each once."""
    unique_limits: dict[Limit, None] = {}
    for m in system.modules:
        for limit in _LimitReader(system, m.scope).limits(m.symbol.safe, f"safe of {m.name}"):
            unique_limits[limit] = None
    for p in system.properties:
        if p.kind == "always":
            for limit in _LimitReader(system, p.scope).limits(p.condition, "always"):
                unique_limits[limit] = None
    return list(unique_limits)


class _LimitReader:
    """Reads bounds off predicates of one scope."""

    def __init__(self, system: System, scope: Scope) -> None:
        self.system = system
        self.scope = scope
        self.evaluator = Evaluator.of(scope)

    def limits(self, predicate: typed.TypedExpr, by: str) -> Iterator[Limit]:
        """The limits of single signals among the parts of a predicate."""
        for part in conjuncts(_opened(predicate)):
            opened = _opened(part)
            parts = conjuncts(opened) if opened is not part else [part]
            for each in parts:
                if isinstance(each, typed.TypedBinary) and each.op in BELOW | ABOVE:
                    yield from self._comparison(each, by)

    def _comparison(self, e: typed.TypedBinary, by: str) -> Iterator[Limit]:
        left, right = self._line(e.left), self._line(e.right)
        if left is None or right is None or bool(left.signal) == bool(right.signal):
            return
        line, constant = (left, right.offset) if left.signal else (right, left.offset)
        below = (e.op in BELOW) == bool(left.signal)
        if not line.scale:
            return
        value = (constant - line.offset) / line.scale
        if not line.folded:
            yield Limit(line.signal, value, by)
        elif below == (line.scale > 0) and value >= 0:
            yield Limit(line.signal, -value, by)
            yield Limit(line.signal, value, by)

    def _line(self, e: typed.TypedExpr) -> _ScaledSignal | None:
        """A side of a comparison as a line over one signal; over none where it is constant."""
        e = _opened(e)
        constant = self._constant(e)
        if constant is not None:
            return _ScaledSignal("", 0.0, constant)
        signal = self._signal(e)
        if signal is not None:
            return _ScaledSignal(signal, 1.0, 0.0)
        if isinstance(e, typed.TypedUnary) and e.op == "-":
            return _scaled(self._line(e.operand), -1.0)
        if isinstance(e, typed.Builtin) and e.name == "abs":
            inner = self._line(e.arguments[0])
            plain = inner is not None and not inner.folded and inner.offset == 0.0
            return (
                _ScaledSignal(inner.signal, abs(inner.scale), 0.0, True)
                if inner and plain
                else None
            )
        if isinstance(e, typed.TypedBinary) and e.op in {"+", "-", "*"}:
            return self._combined(e)
        return None

    def _combined(self, e: typed.TypedBinary) -> _ScaledSignal | None:
        left, right = self._line(e.left), self._line(e.right)
        if left is None or right is None or (left.signal and right.signal):
            return None
        if e.op == "*":
            line, factor = (left, right.offset) if left.signal else (right, left.offset)
            return _scaled(line, factor)
        right = right if e.op == "+" else _scaled(right, -1.0)
        assert right is not None
        line, other = (left, right) if left.signal else (right, left)
        return _ScaledSignal(line.signal, line.scale, line.offset + other.offset, line.folded)

    def _constant(self, e: typed.TypedExpr) -> float | None:
        """The value of an expression that reads nothing but parameters."""
        fixed = (
            typed.Literal, typed.ParamRead, typed.TypedUnary, typed.TypedBinary, typed.Builtin,
            typed.TypedField, typed.Index, typed.TypedLength, typed.Conditional, typed.Narrow,
        )  # fmt: skip
        number = isinstance(e.type, (FloatType, IntType))
        if not number or not all(isinstance(n, fixed) for n in nodes([e])):
            return None
        try:
            return float(self.evaluator.expression(e)(Environment()))
        except StepFault:
            return None

    def _signal(self, e: typed.TypedExpr) -> str | None:
        """The name of a leaf of a topic or of the truth of a plant, as reports call it."""
        path: list[str] = []
        while isinstance(e, (typed.TypedField, typed.Index)):
            if isinstance(e, typed.TypedField):
                assert isinstance(e.target.type, RecordType)
                path.insert(0, e.target.type.fields[e.index][0])
            elif isinstance(e.index, typed.Literal):
                path.insert(0, f"[{e.index.value}]")
            else:
                return None
            e = e.target
        if isinstance(e, typed.TopicRead):
            root = self.system.topics[self.scope.topics[e.topic]].name
        elif isinstance(e, typed.TruthRead):
            root = self.system.components[self.scope.plants[e.instance]].name
        else:
            return None
        return leaf_name(root, path)


def _scaled(line: _ScaledSignal | None, by: float) -> _ScaledSignal | None:
    if line is None:
        return None
    return _ScaledSignal(line.signal, line.scale * by, line.offset * by, line.folded)


def _opened(e: typed.TypedExpr) -> typed.TypedExpr:
    """What calls of functions that only return something stand for."""
    for _ in range(OPENED_MAX):
        inner = returned(e) if isinstance(e, typed.TypedCall) else None
        if inner is None:
            return e
        e = inner
    return e
