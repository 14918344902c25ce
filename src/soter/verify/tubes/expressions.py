"""Real expressions of what Core computes: a graph in which equal expressions are one node.

Purpose: `Expressions` makes nodes and differentiates them along a direction; `ExpressionReading`
executes Core over them (`core/abstract_execution.py`): plants' rates, a law, a predicate. Nothing
is rounded: an expression is the real function that the operations stand for, and every form of it
(`forms.soter`) holds what the machine rounds as well.
Non-goals: whether a step faults (asked offline, of all that it may read), printing
(`print_forms.py`).
"""

from __future__ import annotations

import operator
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from soter.core import core
from soter.core.abstract_execution import Execution
from soter.language.model.types import (
    INT_MAX,
    INT_MIN,
    ArrayType,
    FloatType,
    IntType,
    ListType,
    RecordType,
)
from soter.verify.enclose.prelude import is_prelude
from soter.verify.tubes.factors import Node, factor

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.core.abstract_execution import Join
    from soter.language.model.types import Type

FUNCTIONS = frozenset({"sin", "cos", "exp", "tan", "atan", "tanh", "wrap_angle"})
"""Functions of the prelude with forms of their own."""
NO_FUNCTIONS = frozenset({"asin", "acos", "atan2", "log", "pow"})
"""Those whose bodies are no real function of the same meaning: they look at how floats round. The
bodies of all others are executed."""
LARGEST = 1e300
"""Above it no form computes (`forms.soter`)."""
COMPARED = {"<", "<=", ">", ">="}


class NoExpressionError(Exception):
    """What Core does here is no expression of reals; the text says what, for people."""


Value = Any
"""A `Node` for a float or a bool, an int that is known, a tuple of these."""


class Expressions:
    """Nodes, folded where their value is known."""

    def __init__(self) -> None:
        self._nodes: dict[tuple[object, ...], Node] = {}
        self.true, self.false = self._node("known", True), self._node("known", False)

    def _node(self, op: str, *of: object) -> Node:
        return self._nodes.setdefault((op, *of), Node(op, of))

    def number(self, value: float) -> Node:
        """A constant; `NoExpressionError` for one that forms do not hold."""
        if not abs(value) < LARGEST:
            raise NoExpressionError("a constant that is too large")
        return self._node("number", float(value))

    def _folded(self, op: Callable[[Any, Any], Any], a: Node, b: Node) -> Node | None:
        """The constant that an operation gives; None where it would be rounded."""
        if a.op != "number" or b.op != "number":
            return None
        exact = op(Fraction(a.of[0]), Fraction(b.of[0]))
        value = op(a.of[0], b.of[0])
        return self.number(value) if abs(value) < LARGEST and exact == Fraction(value) else None

    def input(self, kind: str, index: int) -> Node:
        """A state, a control, a disturbance, ... by its number."""
        return self._node("input", kind, index)

    def add(self, a: Node, b: Node) -> Node:
        """The sum."""
        if (known := self._folded(operator.add, a, b)) is not None:
            return known
        if a.op == "number":
            a, b = b, a
        if b == self.number(0.0):
            return a
        if b.op == "neg":
            return self._node("sub", a, b.of[0])
        return self._node("add", a, b)

    def neg(self, a: Node) -> Node:
        """The negative."""
        if a.op == "number":
            return self.number(-a.of[0])
        return a.of[0] if a.op == "neg" else self._node("neg", a)

    def sub(self, a: Node, b: Node) -> Node:
        """The difference."""
        return self.number(0.0) if a is b else self.add(a, self.neg(b))

    def mul(self, a: Node, b: Node) -> Node:
        """The product."""
        if a.op == "number":
            a, b = b, a
        if (known := self._folded(operator.mul, a, b)) is not None:
            return known
        if b.op == "number":
            k = b.of[0]
            if k in (0.0, 1.0, -1.0):
                return b if k == 0.0 else a if k == 1.0 else self.neg(a)
            return self._node("mul", a, b)
        return self._node("square", a) if a is b else self._node("mul", a, b)

    def div(self, a: Node, b: Node) -> Node:
        """The quotient."""
        if b.op == "number" and b.of[0]:
            if _is_power_of_two(b.of[0]):
                return self.mul(a, self.number(1.0 / b.of[0]))
            return self._node("over", a, b)
        if b.op == "add" and b.of[0].op == "abs" and b.of[1].op == "number" and b.of[1].of[0] > 0.0:
            x, k = b.of[0].of[0], b.of[1]
            if (p := factor(self, a, x)) is not None:
                return self.mul(p, self._node("friction", x, k))
        return self.mul(a, self._node("inverse", b))

    def extreme(self, op: str, a: Node, b: Node) -> Node:
        """`min` or `max`; of one and a number that the other bounds a clamp."""
        if a.op == "number" and b.op == "number":
            return self.number((min if op == "min" else max)(a.of[0], b.of[0]))
        if a.op == "number":
            a, b = b, a
        if b.op == "number" and a.op in ("min", "max") and a.op != op and a.of[1].op == "number":
            low, high = (a.of[1], b) if op == "min" else (b, a.of[1])
            if low.of[0] >= high.of[0]:  # no clamp: the last of the two is all there is
                return b
        return a if a is b else self._node(op, a, b)

    def clamp(self, x: Node, low: Node, high: Node) -> Node:
        """`x` limited to [low, high]; NoExpressionError where that is empty, so that it is NaN."""
        if low.op == "number" and high.op == "number":
            if low.of[0] > high.of[0]:
                raise NoExpressionError("a limit whose ends are the wrong way round")
            return self.extreme("min", self.extreme("max", x, low), high)
        return self._node("limit", x, low, high)

    def function(self, name: str, a: Node) -> Node:
        """`sin`, `sqrt`, ..."""
        return self._node(name, a)

    # ------------------------------------------------------------ conditions

    def compare(self, op: str, a: Node, b: Node) -> Node:
        """`a op b`; "not below" and "positive" of the difference: `positive`: a > 0."""
        if op in ("<", "<="):
            a, b = b, a
        if a is b or (a.op == "number" and b.op == "number"):
            above = a is not b and a.of[0] > b.of[0]
            equal = a is b or a.of[0] == b.of[0]
            return self.true if above or (equal and op in ("<=", ">=")) else self.false
        return self._node("positive" if op in ("<", ">") else "not negative", self.sub(a, b))

    def inside(self, a: Node, low: float, high: float) -> Node:
        """`low <= a <= high`."""
        return self._node("inside", a, low, high)

    def not_(self, a: Node) -> Node:
        """The negation: of a > 0 it is -a >= 0."""
        if a.op == "known":
            return self.false if a is self.true else self.true
        if a.op in ("and", "or"):
            other = "or" if a.op == "and" else "and"
            return self._node(other, *[self.not_(x) for x in a.of])
        assert a.op != "inside"
        other = "not negative" if a.op == "positive" else "positive"
        return self._node(other, self.neg(a.of[0]))

    def join(self, op: str, a: Node, b: Node) -> Node:
        """`and`, `or`."""
        ends, goes_on = (self.false, self.true) if op == "and" else (self.true, self.false)
        if ends in (a, b):
            return ends
        if a is goes_on or a is b:
            return b
        return a if b is goes_on else self._node(op, a, b)

    def select(self, condition: Node, a: Node, b: Node) -> Node:
        """One of two."""
        if condition.op == "known":
            return a if condition is self.true else b
        return a if a is b else self._node("select", condition, a, b)

    def replaced(self, e: Node, known: dict[Node, Node]) -> Node:
        """An expression with others in the place of some nodes; `known` learns what is made."""
        if e not in known:
            known[e] = self._replaced(e, known)
        return known[e]

    def _replaced(self, e: Node, known: dict[Node, Node]) -> Node:
        below = [self.replaced(x, known) if isinstance(x, Node) else x for x in e.of]
        if e.op == "neg":
            return self.neg(below[0])
        if e.op in ("add", "sub", "mul", "square"):
            return {"add": self.add, "sub": self.sub}.get(e.op, self.mul)(below[0], below[-1])
        return self._node(e.op, *below)

    # ------------------------------------------------------------ derivatives

    def along(self, e: Node, direction: Mapping[Node, Node], known: dict[Node, Node]) -> Node:
        """The derivative of a node where its inputs move as `direction` says; others stand still.

        Of `min`, `max` and `select` it is that of the one that is taken; where both are equal,
        anything between. NoExpressionError where there is none, as of a jump.
        """
        if e not in known:
            known[e] = self._along(e, direction, known)
        return known[e]

    def _along(self, e: Node, direction: Mapping[Node, Node], known: dict[Node, Node]) -> Node:
        zero = self.number(0.0)
        if e.op == "number":
            return zero
        if e.op == "input":
            return direction.get(e, zero)
        if e.op == "select":
            msg = "its rate jumps or has branches"
            raise NoExpressionError(msg)
        parts = [self.along(x, direction, known) for x in e.of]
        if all(x is zero for x in parts):
            return zero
        d, *rest = parts
        a = e.of[0]
        if e.op in ("add", "sub"):
            return self.add(d, rest[0]) if e.op == "add" else self.sub(d, rest[0])
        if e.op == "neg":
            return self.neg(d)
        if e.op == "mul":
            return self.add(self.mul(d, e.of[1]), self.mul(a, rest[0]))
        if e.op == "over":
            return self._node("over", d, e.of[1])
        if e.op == "limit":
            within = self.extreme("min", self.extreme("max", a, e.of[1]), e.of[2])
            return self.along(within, direction, known)
        if e.op in ("min", "max"):
            ahead = self.sub(a, e.of[1]) if e.op == "max" else self.sub(e.of[1], a)
            first = self._node("share", ahead)
            return self.add(rest[0], self.mul(first, self.sub(d, rest[0])))
        return self.mul(self._slope(e, a), d)

    def _slope(self, e: Node, a: Node) -> Node:
        """The derivative of a function of one number."""
        one, two = self.number(1.0), self.number(2.0)
        if e.op == "square":
            return self.mul(two, a)
        if e.op == "abs":
            return self.sub(self.mul(two, self._node("share", a)), one)
        if e.op == "inverse":
            return self.neg(self.mul(e, e))
        if e.op == "friction":
            k = e.of[1]
            size = self.add(self.function("abs", a), k)
            return self.mul(self._node("square", self._node("inverse", size)), k)
        if e.op == "sin":
            return self.function("cos", a)
        if e.op == "cos":
            return self.neg(self.function("sin", a))
        if e.op == "exp":
            return e
        if e.op == "sqrt":
            return self.mul(self.number(0.5), self._node("inverse", e))
        if e.op == "tan":
            return self.add(one, self.mul(e, e))
        if e.op == "tanh":
            return self.sub(one, self.mul(e, e))
        if e.op == "wrap_angle":
            raise NoExpressionError("its rate jumps")
        assert e.op == "atan", e.op
        return self._node("inverse", self.add(one, self.mul(a, a)))


def _is_power_of_two(x: float) -> bool:
    return x.hex().lstrip("-").startswith(("0x1.0p", "0x1.0000000000000p"))


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


CONDITIONS = frozenset({"known", "and", "or", "positive", "not negative", "inside"})
