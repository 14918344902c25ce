"""Core, read as real expressions: plants' rates, a law, a predicate.

Purpose: `ExpressionReading` executes Core over expressions (`core/core_walks.py`).
Non-goals: whether a step faults (asked offline, of all that it may read), what an expression is
(`expressions.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core_walks import Execution
from soter.language.model.types import (
    INT_MAX,
    INT_MIN,
    ArrayType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.verify.enclose.core_enclosure import is_prelude
from soter.verify.tubes.expressions import CONDITIONS, Expressions, Node, NoExpressionError, Value

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.core.core_walks import Join
    from soter.language.model.types import Type

FUNCTIONS = frozenset({"sin", "cos", "exp", "tan", "atan", "tanh", "wrap_angle"})
"""Functions of the prelude with forms of their own."""
NO_FUNCTIONS = frozenset({"asin", "acos", "atan2", "log", "pow"})
"""Those whose bodies are no real function of the same meaning: they look at how floats round. The
bodies of all others are executed."""
COMPARED = {"<", "<=", ">", ">="}


class ExpressionReading(Execution["Value"]):
    """Core executed over expressions; `cell` says what a cell holds."""

    def __init__(
        self,
        make: Expressions,
        functions: Mapping[str, core.Function],
        cell: Callable[[core.Cell, Type], Value],
    ) -> None:
        super().__init__(functions)
        self.make, self.cell = make, cell
        self.where = None
        self.guards: list[Node] = []
        """What has to hold so that nothing faults, wherever it stands."""
        self.computed: dict[Node, None] = {}
        """Every number on the way, whether or not the result hangs on it: an endless one may become
        NaN."""

    def _known(self, condition: Value) -> bool | None:
        return condition.of[0] if condition.op == "known" else None

    def _reached(self, where: object, condition: Value, truth: bool) -> object:
        del condition, truth
        return where

    def _join(self, condition: Value, *where: object) -> Join[Value]:
        del where

        def join(a: Value | None, b: Value | None, _: Type) -> Value:
            if a is None or b is None:
                return b if a is None else a
            return self._select(condition, a, b)

        return join

    def _select(self, condition: Node, a: Value, b: Value) -> Value:
        if a is b:
            return a
        if isinstance(a, Node):
            if b is condition:  # `condition && a`
                return self.make.join("and", condition, a)
            if a is condition:  # `condition || b`
                return self.make.join("or", condition, b)
            if a.op in CONDITIONS or b.op in CONDITIONS:
                yes = self.make.join("and", condition, a)
                no = self.make.join("and", self.make.not_(condition), b)
                return self.make.join("or", yes, no)
            return self.make.select(condition, a, b)
        if isinstance(a, tuple) and len(a) == len(b):
            return tuple(self._select(condition, x, y) for x, y in zip(a, b, strict=True))
        if a == b:
            return a
        msg = "a whole number, or the length of a list, that hangs on what is measured"
        raise NoExpressionError(msg)

    def _checked(self, s: core.Checked, operands: list[Value], limit: Value | None) -> Value:
        whole: dict[str, Callable[..., int]] = {
            "add": int.__add__,
            "sub": int.__sub__,
            "mul": int.__mul__,
            "neg": int.__neg__,
        }
        if s.op == "number":
            return operands[0]
        if s.op in whole or s.op in ("index", "narrow"):
            value = whole[s.op](*operands) if s.op in whole else operands[0]
            low, high = INT_MIN, INT_MAX
            if s.op == "index":
                assert limit is not None
                low, high = 0, limit - 1
            if s.op == "narrow":
                assert isinstance(s.type, IntType)
                low, high = s.type.low, s.type.high
            if low <= value <= high:
                return value
            raise NoExpressionError("a whole number that faults")
        msg = f"`{s.op}` of whole numbers"
        raise NoExpressionError(msg)

    def _choose(self, _: core.Choose) -> Value:
        raise NoExpressionError("`choose`")

    def _guard(self, condition: Value) -> None:
        self.guards.append(condition)

    def _changed(
        self, s: core.Set | core.Push, old: Value, path: list[Value], value: Value
    ) -> Value:
        if not path:
            return value if isinstance(s, core.Set) else (*old, value)
        k, *rest = path
        return (*old[:k], self._changed(s, old[k], rest, value), *old[k + 1 :])

    def _number(self, e: Node) -> Node:
        """What is computed, noted."""
        self.computed[e] = None
        return e

    def call(self, f: core.Function, arguments: tuple[Value, ...]) -> Value:
        """The result of a function; NoExpressionError where it is extern."""
        if is_prelude(f) and f.source_name in FUNCTIONS:
            return self._number(self.make.function(f.source_name, arguments[0]))
        if is_prelude(f) and f.source_name == "clamp":
            return self._number(self.make.clamp(*arguments))
        if is_prelude(f) and f.source_name == "hypot":
            x, y = (self.make.mul(a, a) for a in arguments)
            return self._number(self.make.function("sqrt", self.make.add(x, y)))
        if is_prelude(f) and f.source_name in NO_FUNCTIONS:
            raise NoExpressionError(f"`{f.source_name}`, of which no form is known")
        if f.result is None:
            msg = f"`{f.source_name}` is extern"
            raise NoExpressionError(msg)
        return super().call(f, arguments)

    # ------------------------------------------------------------ expressions

    def _operation(self, e: core.Expr, *operands: Value) -> Value:
        make = self.make
        if isinstance(e, core.Const):
            return self.constant(e.type, e.value)
        if isinstance(e, core.Get):
            return self.cell(e.cell, e.type)
        if isinstance(e, core.Fact):
            return make.input(e.fact, e.index)
        if isinstance(e, core.Select):
            return self._select(*operands)
        if isinstance(e, (core.Field, core.Element)):
            return operands[0][e.index if isinstance(e, core.Field) else operands[1]]
        if isinstance(e, core.Length):
            return len(operands[0])
        if isinstance(e, core.Make):
            return tuple(operands)
        if isinstance(operands[0], int):
            return self._of_whole(e, *operands)
        if isinstance(e, core.Extreme):
            return make.extreme(e.op, *operands)
        if isinstance(e, core.Unary):
            return self._unary(e.op, *operands)
        assert isinstance(e, core.Binary), e
        return self._binary(e.op, *operands)

    def constant(self, t: Type, value: object) -> Value:
        """A constant of any type."""
        if isinstance(value, bool):
            return self.make.true if value else self.make.false
        if isinstance(t, FloatType):
            return self.make.number(value)  # type: ignore[arg-type]
        if isinstance(t, RecordType):
            pairs = zip(t.fields, value, strict=True)  # type: ignore[call-overload]
            return tuple(self.constant(f, v) for (_, f), v in pairs)
        if isinstance(t, (ArrayType, ListType)):
            return tuple(self.constant(t.element, v) for v in value)  # type: ignore[attr-defined]
        return value

    def _of_whole(self, e: core.Expr, *operands: int) -> Value:
        make = self.make
        op = getattr(e, "op", "")
        if op == "to_float":
            return make.number(operands[0])
        if isinstance(e, core.Extreme):
            return (min if op == "min" else max)(operands)
        holds = {
            "<": int.__lt__, "<=": int.__le__, ">": int.__gt__, ">=": int.__ge__,
            "==": int.__eq__, "!=": int.__ne__,
        }  # fmt: skip
        if op not in holds:
            msg = f"`{op}` of whole numbers"
            raise NoExpressionError(msg)
        return make.true if holds[op](*operands) else make.false

    def _unary(self, op: str, a: Node) -> Node:
        make = self.make
        if op == "not":
            return make.not_(a)
        if op == "neg":
            return make.neg(a)
        if op == "abs":
            return make.number(abs(a.of[0])) if a.op == "number" else make.function("abs", a)
        if op == "sqrt":
            return self._number(make.function("sqrt", a))
        msg = f"`{op}`, which jumps"
        raise NoExpressionError(msg)

    def _binary(self, op: str, a: Node, b: Node) -> Node:
        make = self.make
        if op in ("&&", "||"):
            return make.join("and" if op == "&&" else "or", a, b)
        if op in COMPARED:
            return make.compare(op, a, b)
        if op in ("==", "!="):
            if a.op in CONDITIONS:
                same = self._select(a, b, make.not_(b))
            else:
                same = make.join("and", make.compare("<=", a, b), make.compare(">=", a, b))
            return same if op == "==" else make.not_(same)
        by = {"+": make.add, "-": make.sub, "*": make.mul, "/": make.div}
        return self._number(by[op](a, b))
