"""A graph of real expressions in which equal expressions are one node.

Purpose: `Expressions` makes nodes, takes factors out and differentiates along a direction. Nothing
is rounded: an expression means the exact real function, and each form that encloses it
(`forms.soter`) also encloses what the machine rounds.
Non-goals: reading Core (`module_expressions.py`), printing (`generated_functions.py`).
"""

from __future__ import annotations

import operator
from dataclasses import dataclass
from fractions import Fraction
from math import inf
from typing import TYPE_CHECKING, Any

from soter.verify.tubes.problem import FARTHEST, rounded_up

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from soter.verify.problem.problem import Interval


LARGEST = 1e300
"""Forms do not compute with larger numbers (`forms.soter`)."""
PARTIAL = frozenset({"sqrt", "tan", "inverse", "limit", "log", "asin", "acos"})
"""The functions that are not defined for all numbers."""
POWER_MAX = 16
MAY_FAULT = (
    "a command or a disturbance may make a plant fault: a divisor be 0, or a function beyond its "
    "domain, as far as is seen (`max(x, 0.1)` and `1.0 + x * x` are never 0)"
)
CONDITIONS = frozenset(
    {"known", "and", "or", "positive", "not negative", "inside", "sign", "branch"}
)
"""`sign`: x > 0, undecided at 0. `branch`: a condition that a step decides, by its number."""


class NoExpressionError(Exception):
    """Core computes something that no real expression describes; the text says what."""


@dataclass(frozen=True, eq=False, slots=True)
class Node:
    """An operator `op` with operands `of`; for "number", "known" and "input" these are values.

    `Expressions` makes each node only once, so equal expressions are the same object.
    """

    op: str
    of: tuple[Any, ...]


Value = Any
"""A `Node` for a float or a bool, an int that is known, a tuple of these."""


class Expressions:
    """Makes nodes of expressions; it folds constants if no rounding is involved."""

    def __init__(self) -> None:
        self._nodes: dict[tuple[object, ...], Node] = {}
        self._negated: dict[Node, Node] = {}
        self._most: dict[Node, float] = {}
        self.hidden: dict[Node, None] = {}
        """Conditions that what constants replace, as 0.0 `0.0 * sqrt(x)`, is a finite number."""
        self.true, self.false = self._node("known", True), self._node("known", False)

    def _node(self, op: str, *of: object) -> Node:
        e = self._nodes.setdefault((op, *of), Node(op, of))
        if e not in self._most:
            self._most[e] = _bound_by_operands(
                e, [self._most[x] for x in of if isinstance(x, Node)]
            )
        return e

    def constant(self, value: float) -> Node:
        """The node of a constant; raises `NoExpressionError` for a value that forms cannot hold."""
        if not abs(value) < LARGEST:
            raise NoExpressionError("a constant that is too large")
        return self._node("number", float(value))

    def _folded_constant(self, op: Callable[[Any, Any], Any], a: Node, b: Node) -> Node | None:
        """The node of the exact result of `op` on two constants; None: not constant, or rounded."""
        if a.op != "number" or b.op != "number":
            return None
        exact = op(Fraction(a.of[0]), Fraction(b.of[0]))
        value = op(a.of[0], b.of[0])
        return self.constant(value) if abs(value) < LARGEST and exact == Fraction(value) else None

    def _constant_for(self, constant: Node, *operands: Node) -> Node:
        """The node `constant`; adds to `hidden` the conditions that its operands are finite."""
        for x in operands:
            if not self._most[x] < LARGEST:
                self.hidden[self.in_range(x, -LARGEST, LARGEST)] = None
        return constant

    def input(self, kind: str, index: int) -> Node:
        """The node of an input, by kind ("x" state, "u" control, "w" disturbance) and number."""
        return self._node("input", kind, index)

    def add(self, a: Node, b: Node) -> Node:
        """The node of the sum a + b."""
        if (known := self._folded_constant(operator.add, a, b)) is not None:
            return known
        if a.op == "number":
            a, b = b, a
        if b == self.constant(0.0):
            return a
        if b.op == "neg":
            return self._node("sub", a, b.of[0])
        return self._node("add", a, b)

    def neg(self, a: Node) -> Node:
        """The node of -a."""
        if a.op == "number":
            return self.constant(-a.of[0])
        return a.of[0] if a.op == "neg" else self._node("neg", a)

    def sub(self, a: Node, b: Node) -> Node:
        """The node of the difference a - b."""
        return self._constant_for(self.constant(0.0), a) if a is b else self.add(a, self.neg(b))

    def mul(self, a: Node, b: Node) -> Node:
        """The node of the product a b."""
        if a.op == "number":
            a, b = b, a
        if (known := self._folded_constant(operator.mul, a, b)) is not None:
            return known
        if b.op == "number":
            k = b.of[0]
            if k in (0.0, 1.0, -1.0):
                zero = k == 0.0
                return self._constant_for(b, a) if zero else a if k == 1.0 else self.neg(a)
            return self._node("mul", a, b)
        return self._node("square", a) if a is b else self._node("mul", a, b)

    def div(self, a: Node, b: Node) -> Node:
        """The node of the quotient a / b."""
        if b.op == "number" and b.of[0]:
            if _is_power_of_two(b.of[0]):
                return self.mul(a, self.constant(1.0 / b.of[0]))
            return self._node("over", a, b)
        if b.op == "add" and b.of[0].op == "abs" and b.of[1].op == "number" and b.of[1].of[0] > 0.0:
            x, k = b.of[0].of[0], b.of[1]
            if (p := self.factor(a, x)) is not None:
                return self.mul(p, self._node("friction", x, k))
        return self.mul(a, self._node("inverse", b))

    def factor(self, e: Node, x: Node) -> Node | None:
        """A node p with e = x p for all values of the inputs; None if no such node is found."""
        if e is x:
            return self.constant(1.0)
        if e is self.constant(0.0):
            return e
        if e.op == "friction" and e.of[0] is x:
            return self.function_node("inverse", self.add(self.function_node("abs", x), e.of[1]))
        if e.op == "square":
            return x if e.of[0] is x else None
        if e.op in ("add", "sub"):
            a, b = (self.factor(y, x) for y in e.of)
            return None if a is None or b is None else getattr(self, e.op)(a, b)
        if e.op in ("neg", "over"):
            p = self.factor(e.of[0], x)
            if p is None:
                return None
            return self.neg(p) if e.op == "neg" else self.div(p, e.of[1])
        if e.op == "mul":
            a, b = e.of
            return self._factor_of_product(a, b, x)
        return None

    def _factor_of_product(self, a: Node, b: Node, x: Node) -> Node | None:
        if (p := self.factor(a, x)) is not None:
            return self.mul(p, b)
        p = self.factor(b, x)
        return None if p is None else self.mul(a, p)

    def split_off_factor(self, e: Node, x: Node) -> tuple[Node, Node]:
        """A pair (p, rest) with e = x p + rest."""
        if (p := self.factor(e, x)) is not None:
            return p, self.constant(0.0)
        if e.op in ("add", "sub"):
            a, b = (self.split_off_factor(y, x) for y in e.of)
            join = getattr(self, e.op)
            return join(a[0], b[0]), join(a[1], b[1])
        if e.op == "neg":
            p, rest = self.split_off_factor(e.of[0], x)
            return self.neg(p), self.neg(rest)
        return self.constant(0.0), e

    def extreme(self, op: str, a: Node, b: Node) -> Node:
        """The node of `min` or `max` (`op`) of two nodes; a constant if the result is certain."""
        if a.op == "number" and b.op == "number":
            return self.constant((min if op == "min" else max)(a.of[0], b.of[0]))
        if a.op == "number":
            a, b = b, a
        if b.op == "number" and a.op in ("min", "max") and a.op != op and a.of[1].op == "number":
            low, high = (a.of[1], b) if op == "min" else (b, a.of[1])
            if low.of[0] >= high.of[0]:  # the result is always the outer constant
                return self._constant_for(b, a)
        return a if a is b else self._node(op, a, b)

    def clamp(self, x: Node, low: Node, high: Node) -> Node:
        """The node of `x` limited to [low, high]; NoExpressionError if constants low > high."""
        if low.op == "number" and high.op == "number":
            if low.of[0] > high.of[0]:
                raise NoExpressionError("a limit whose ends are the wrong way round")
            return self.extreme("min", self.extreme("max", x, low), high)
        return self._node("limit", x, low, high)

    def function_node(self, name: str, *of: Node) -> Node:
        """The node of a function, such as `sin`, `sqrt` or `atan2`, applied to these nodes."""
        return self._node(name, *of)

    def power(self, a: Node, by: Node) -> Node:
        """The node of a^by: products for a small whole `by`, else exp(by log a) for a > 0."""
        if by.op == "number" and by.of[0].is_integer() and 2 <= abs(by.of[0]) <= POWER_MAX:
            made = self.constant(1.0)
            for bit in f"{int(abs(by.of[0])):b}":
                made = self.mul(self.mul(made, made), a if bit == "1" else self.constant(1.0))
            return made if by.of[0] > 0.0 else self.function_node("inverse", made)
        return self.function_node("exp", self.mul(by, self.function_node("log", a)))

    def compare(self, op: str, a: Node, b: Node) -> Node:
        """The condition `a op b`, written as a difference that is positive or not negative."""
        if op in ("<", "<="):
            a, b = b, a
        if a is b or (a.op == "number" and b.op == "number"):
            above = a is not b and a.of[0] > b.of[0]
            equal = a is b or a.of[0] == b.of[0]
            known = self.true if above or (equal and op in ("<=", ">=")) else self.false
            return self._constant_for(known, a)
        ahead = self.sub(a, b)
        if is_positive(ahead) or is_positive(self.neg(ahead)):
            return self._constant_for(self.true if is_positive(ahead) else self.false, ahead)
        return self._node("positive" if op in ("<", ">") else "not negative", ahead)

    def positive_condition(self, a: Node) -> Node:
        """The condition `a > 0`, which is undecided if a is 0."""
        return self._node("sign", a)

    def in_range(self, a: Node, low: float, high: float) -> Node:
        """The condition `low <= a <= high`."""
        return self._node("inside", a, low, high)

    def negation(self, a: Node) -> Node:
        """The negation of a condition, made once per condition; a > 0 becomes -a >= 0."""
        if a not in self._negated:
            self._negated[a] = self._new_negation(a)
        return self._negated[a]

    def _new_negation(self, a: Node) -> Node:
        if a.op == "known":
            return self.false if a is self.true else self.true
        if a.op in ("and", "or"):
            other = "or" if a.op == "and" else "and"
            return self._node(other, *[self.negation(x) for x in a.of])
        assert a.op != "inside"
        other = {"sign": "sign", "positive": "not negative"}.get(a.op, "positive")
        return self._node(other, self.neg(a.of[0]))

    def join(self, op: str, a: Node, b: Node) -> Node:
        """The conjunction (`op` "and") or disjunction ("or") of two conditions."""
        ends, goes_on = (self.false, self.true) if op == "and" else (self.true, self.false)
        if ends in (a, b):
            return ends
        if a is goes_on or a is b:
            return b
        return a if b is goes_on else self._node(op, a, b)

    def select(self, condition: Node, a: Node, b: Node) -> Node:
        """The node that equals `a` if the condition holds, and `b` otherwise."""
        if condition.op == "known":
            return a if condition is self.true else b
        return a if a is b else self._node("select", condition, a, b)

    def substituted(self, e: Node, known: dict[Node, Node]) -> Node:
        """The node `e` with each key of `known` replaced by its value; adds results to `known`."""
        if e not in known:
            known[e] = self._rebuilt_node(e, known)
        return known[e]

    def _rebuilt_node(self, e: Node, known: dict[Node, Node]) -> Node:
        below = [self.substituted(x, known) if isinstance(x, Node) else x for x in e.of]
        if e.op == "neg":
            return self.neg(below[0])
        if e.op in ("add", "sub", "mul", "square"):
            return {"add": self.add, "sub": self.sub}.get(e.op, self.mul)(below[0], below[-1])
        if e.op in ("and", "or"):
            return self.join(e.op, *below)
        if e.op in ("min", "max"):
            return self.extreme(e.op, *below)
        if e.op in ("limit", "select"):
            return self.clamp(*below) if e.op == "limit" else self.select(*below)
        if e.op in ("positive", "not negative") and below[0].op == "number":
            return self.compare(">" if e.op == "positive" else ">=", below[0], self.constant(0.0))
        return self._node(e.op, *below)

    def rates_by_branch(self, rates: Sequence[Node]) -> tuple[list[Node], list[Node], list[Node]]:
        """The rates over sign conditions, the rates over numbered branches, and the conditions.

        Where a rate jumps, a plant may continue with any rate between both sides, so a sign is
        undecided at 0. In the second list a `branch` with a number replaces each condition. Raises
        `NoExpressionError` for a condition that is no comparison with 0.
        """
        signs = {
            c: self.positive_condition(c.of[0])
            for c in in_order(rates)
            if c.op in ("positive", "not negative")
        }
        if any(c.op == "inside" for c in in_order(rates)):
            raise NoExpressionError("its rate hangs on a condition that is not one of signs")
        rates = [self.substituted(e, signs) for e in rates]
        conditions = list({e.of[0]: None for e in in_order(rates) if e.op == "select"})
        places = {c: self._node("branch", k) for k, c in enumerate(conditions)}
        return rates, [self.substituted(e, places) for e in rates], conditions

    def slope_along(self, e: Node, direction: Mapping[Node, Node], known: dict[Node, Node]) -> Node:
        """The derivative of `e` if each input moves at its speed in `direction`, or stands still.

        For `min` and `max` it is the derivative of the operand taken; of equal ones any in between.
        For `select` it is that of the operand taken too; the caller has to add the effect of a
        jump. Raises `NoExpressionError` for any other jump. `known` remembers results.
        """
        if e not in known:
            known[e] = self._new_derivative(e, direction, known)
        return known[e]

    def _new_derivative(
        self, e: Node, direction: Mapping[Node, Node], known: dict[Node, Node]
    ) -> Node:
        zero = self.constant(0.0)
        if e.op in ("number", "input"):
            return direction.get(e, zero)
        if e.op == "select":
            taken = (self.slope_along(x, direction, known) for x in e.of[1:])
            return self.select(e.of[0], *taken)
        parts = [self.slope_along(x, direction, known) for x in e.of]
        if all(x is zero for x in parts):
            return zero
        if e.op in ("wrap_angle", "atan2"):
            raise NoExpressionError(f"its rate jumps (`{e.op}`)")
        (d, *rest), a = parts, e.of[0]
        if e.op in ("add", "sub"):
            return {"add": self.add, "sub": self.sub}[e.op](d, rest[0])
        if e.op == "neg":
            return self.neg(d)
        if e.op == "mul":
            return self.add(self.mul(d, e.of[1]), self.mul(a, rest[0]))
        if e.op == "over":
            return self._node("over", d, e.of[1])
        if e.op == "limit":
            within = self.extreme("min", self.extreme("max", a, e.of[1]), e.of[2])
            return self.slope_along(within, direction, known)
        if e.op in ("min", "max"):
            ahead = self.sub(a, e.of[1]) if e.op == "max" else self.sub(e.of[1], a)
            return self.add(rest[0], self.mul(self._node("share", ahead), self.sub(d, rest[0])))
        return self.mul(self._derivative_of_function(e, a), d)

    def _derivative_of_function(self, e: Node, a: Node) -> Node:
        """The derivative of the function `e` of one node `a`, with respect to `a`."""
        one, two = self.constant(1.0), self.constant(2.0)
        if e.op == "square":
            return self.mul(two, a)
        if e.op == "abs":
            return self.sub(self.mul(two, self._node("share", a)), one)
        if e.op == "inverse":
            return self.neg(self.mul(e, e))
        if e.op == "friction":
            k = e.of[1]
            size = self.add(self.function_node("abs", a), k)
            return self.mul(self._node("square", self._node("inverse", size)), k)
        if e.op in ("sin", "real_sin"):
            return self.function_node(e.op.replace("sin", "cos"), a)
        if e.op in ("cos", "real_cos"):
            return self.neg(self.function_node(e.op.replace("cos", "sin"), a))
        if e.op == "exp":
            return e
        if e.op == "sqrt":
            return self.mul(self.constant(0.5), self._node("inverse", e))
        if e.op == "tan":
            return self.add(one, self.mul(e, e))
        if e.op == "tanh":
            return self.sub(one, self.mul(e, e))
        if e.op == "log":
            return self._node("inverse", a)
        if e.op in ("asin", "acos"):
            beside = self.function_node("sqrt", self.sub(one, self._node("square", a)))
            slope = self._node("inverse", beside)
            return slope if e.op == "asin" else self.neg(slope)
        assert e.op == "atan", e.op
        return self._node("inverse", self.add(one, self.mul(a, a)))


def _is_power_of_two(x: float) -> bool:
    return x.hex().lstrip("-").startswith(("0x1.0p", "0x1.0000000000000p"))


def _bound_by_operands(e: Node, of: Sequence[float]) -> float:
    """A bound of |e| for operands bounded by `of`, inputs by `FARTHEST`; inf: it may be NaN."""
    if e.op in CONDITIONS:
        return 0.0
    if e.op in PARTIAL or e.op == "exp" or inf in of:
        return inf
    if e.op in ("number", "input"):
        return abs(e.of[0]) if e.op == "number" else FARTHEST
    if e.op in ("add", "sub"):
        return of[0] + of[1]
    if e.op in ("mul", "square"):
        return of[0] * of[-1]
    return of[0] / abs(e.of[1].of[0]) if e.op == "over" else max(1e9, *of)


def is_positive(e: Node) -> bool:
    """Whether the form of `e` shows that it is above 0, even rounded, as 1 + x^2 but not exp(x)."""
    if e.op == "number":
        return bool(e.of[0] > 0.0)
    if e.op in ("min", "max"):
        return (all if e.op == "min" else any)(map(is_positive, e.of))
    if e.op == "add" and is_positive(e.of[1]):
        return e.of[0].op in ("abs", "square") or is_positive(e.of[0])
    return False


def in_order(roots: Sequence[Node]) -> list[Node]:
    """All nodes of these expressions, each after its operands."""
    seen: dict[Node, None] = {}
    todo = [(root, False) for root in reversed(roots)]
    while todo:
        e, below_seen = todo.pop()
        if below_seen:
            seen[e] = None
        elif e not in seen:
            todo.append((e, True))
            todo += [(x, False) for x in reversed(e.of) if isinstance(x, Node)]
    return list(seen)


def middle(r: Interval) -> float:
    """The middle of a range, rounded to the nearest double."""
    return 0.5 * r.low + 0.5 * r.high


def half_width(r: Interval) -> float:
    """The largest distance of a number in the range from the range's middle, rounded up."""
    m = Fraction(middle(r))
    return rounded_up(max(Fraction(r.high) - m, m - Fraction(r.low)))


def reads_kind(e: Node, kind: str) -> bool:
    """Whether an input of this kind occurs in `e`."""
    return any(x.op == "input" and x.of[0] == kind for x in in_order([e]))


def deciding_nodes(roots: Iterable[Node]) -> set[Node]:
    """The nodes in the conditions of `select`, which decide the branch that is taken."""
    return {*in_order([e.of[0] for e in in_order(list(roots)) if e.op == "select"])}


def states_read(roots: Iterable[Node]) -> set[int]:
    """The numbers of the states in these expressions, both true states (x) and SC's reads (y)."""
    return {e.of[1] for e in in_order(list(roots)) if e.op == "input" and e.of[0] in "xy"}


def states_read_through(asked: Iterable[Node], rates: Sequence[Node]) -> list[int]:
    """The numbers of the states that `asked` reads, directly or through rates of such states."""
    asked, found = [*asked], set[int]()
    while (new := states_read([*asked, *(rates[s] for s in found)])) - found:
        found |= new
    return sorted(found)
