"""The re-checker's terms: what code computes, as linear forms over inputs and nonlinear atoms.

Purpose: `Terms` builds a `Linear` (a linear form with a radius for the rounding of the program) or
a `Proposition` for each expression that is read; an `Atom` is an input, or what is not linear.
Linear combinations cancel here, once, before any cell is looked at: nothing is evaluated yet.
Non-goals: reading programs (`symbolic_reading.py`), enclosing terms (`compile_terms.py`).

A term stands for the number the *machine* computes: every operation of the program adds
|result| 2^-53 + 2^-1074 to the radius, the result being bounded over the whole domain; its range
over a cell is that of the exact result there, rounded. Plants are built with `rounded=False`: they
are exact.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import (
    ONE,
    TINIEST,
    UNIT_ROUNDOFF,
    ZERO,
    exact,
    hull,
    larger,
    line_function,
    lower,
    magnitude,
    smaller,
    upper,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flint import arb

LARGEST = exact(2.0**1023)
"""Numbers of a program stay below: what a machine rounds to infinity is no number here."""


@dataclass(eq=False)
class Linear:
    """A term: const + sum terms[a] * atom a, +- radius; over the whole domain in [low, high]."""

    const: arb
    terms: dict[int, arb]
    radius: arb
    low: arb
    high: arb
    nonnegative: bool = False
    """Known not to be negative although rounding hides it: a sum of squares. The number that the
    machine has is not; the bounds of its enclosure may be."""
    beyond: tuple[Proposition, ...] = ()
    """What must hold so that the machine has no infinity of its sign in its place."""
    rests: tuple[Proposition, ...] = ()
    """What must hold so that all this is so: elsewhere the machine may have any number, or none."""
    rounds: Linear | None = None
    """The term whose nearest double, or an infinity, it is: its range is that of it, rounded."""

    @property
    def is_constant(self) -> bool:
        """Whether the term depends on no input."""
        return not self.terms

    @property
    def atom(self) -> int:
        """The index of the single atom in the term of a new input or a new atom."""
        (index,) = self.terms
        return index


@dataclass(eq=False)
class Atom:
    """An input, or a nonlinear part of a term.

    kind: "state", "box" (an input with fixed range), a function that has lines, "product", "choice"
    (condition ? arguments[0] : arguments[1]; arguments[2] is their difference), "spread" (anything
    within the sum of weights times |argument|), "table" (values at the whole numbers that are the
    arguments), "min" and "max" (of arguments[0] and arguments[2], which differ by arguments[1] if
    that is chosen), "apart" (arguments[0], the difference of the others), "any" (one of several
    alternatives; then the gaps between the first and each other). `values`: the table, in C order
    over `shape`.
    """

    kind: str
    arguments: tuple[Linear, ...] = ()
    condition: Proposition | None = None
    low: arb = ZERO
    high: arb = ZERO
    weights: tuple[arb, ...] = ()
    values: tuple[float, ...] = ()
    shape: tuple[int, ...] = ()
    extra: arb = ZERO
    """The error of a prelude function, with a share of its value: a spread added to its line."""
    share: arb = ZERO
    name: str = ""


@dataclass(eq=False)
class Proposition:
    """A proposition of some kind; "below" means argument < 0, or <= 0 if not `strict`."""

    kind: Literal["constant", "below", "not", "and", "or"]
    parts: tuple[Proposition, ...] = ()
    argument: Linear | None = None
    value: bool = False
    strict: bool = True


TRUE = Proposition("constant", value=True)
FALSE = Proposition("constant", value=False)
ANYTHING = Linear(ZERO, {}, ONE, -ONE, ONE)
"""Of its sign nothing is known."""


def negation(a: Proposition) -> Proposition:
    """The proposition "not `a`", simplified where `a` is known."""
    if a.kind == "constant":
        return FALSE if a.value else TRUE
    if a.kind == "not":
        return a.parts[0]
    return Proposition("not", (a,))


def and_of(a: Proposition, b: Proposition) -> Proposition:
    """The proposition "`a` and `b`", simplified if one of them is known."""
    if a.kind == "constant":
        return b if a.value else a
    if b.kind == "constant":
        return a if b.value else b
    return Proposition("and", (a, b))


def or_of(a: Proposition, b: Proposition) -> Proposition:
    """The proposition "`a` or `b`", simplified if one of them is known."""
    if a.kind == "constant":
        return a if a.value else b
    if b.kind == "constant":
        return b if b.value else a
    return Proposition("or", (a, b))


def choice_of_truths(c: Proposition, a: Proposition, b: Proposition) -> Proposition:
    """The proposition `c ? a : b`, simplified if one of its parts is known.

    It is also true if both a and b hold: then it does not matter whether c is certain.
    """
    if a.kind == "constant":
        return or_of(c, b) if a.value else and_of(negation(c), b)
    if b.kind == "constant":
        return or_of(negation(c), a) if b.value else and_of(c, a)
    return or_of(or_of(and_of(c, a), and_of(negation(c), b)), and_of(a, b))


def conjuncts(a: Proposition) -> list[Proposition]:
    """The parts, each once, whose conjunction is the proposition."""
    found, todo = [], [(a, True)]  # whether it holds, or does not
    for x, yes in todo:
        if x.kind in ("not", "and" if yes else "or"):
            parts = [(p, yes != (x.kind == "not")) for p in dict.fromkeys(x.parts)]
            todo += [part for part in parts if part not in todo]
        elif x.kind != "constant" or x.value != yes:
            found.append(x if yes else negation(x))
    return found


@dataclass(eq=False)
class Terms:
    """Builds terms over a shared list of atoms; each input has a range, its domain."""

    atoms: list[Atom] = field(default_factory=list)
    obligations: list[Proposition] = field(default_factory=list)
    """The propositions that must hold so that no step fault and no NaN arises."""
    path: Proposition = TRUE
    """Under which condition the code being read runs."""
    limit: int = 20_000
    outside: int | None = None
    """The state that lies outside of its grid: how it compares with the end there is certain."""
    compared: set[int] = field(default_factory=set)
    """States that are compared with numbers by themselves where a rate may jump."""
    turning: set[int] = field(default_factory=set)
    """Inputs that stand for angles any number of turns further (`extras/left_out_states.py`)."""

    def add_obligation(self, truth: Proposition) -> None:
        """Adds the obligation that `truth` holds wherever the code being read runs."""
        demand = or_of(negation(self.path), truth)
        known = demand.kind == "constant" and demand.value
        if not known and demand not in self.obligations:
            self.obligations.append(demand)

    # ------------------------------------------------------------ atoms

    def add_input(self, kind: str, name: str, low: arb, high: arb) -> Linear:
        """The term of a new input, a "state" or "box", that ranges over [low, high]."""
        return self.add_atom(Atom(kind, low=low, high=high, name=name))

    def add_atom(self, atom: Atom, *, nonnegative: bool = False) -> Linear:
        """The term of a new atom. Raises NotRecheckedError if the atoms become too many."""
        if len(self.atoms) >= self.limit:
            raise NotRecheckedError("the step is too large to be read as one formula")
        self.atoms.append(atom)
        index = len(self.atoms) - 1
        return Linear(ZERO, {index: ONE}, ZERO, atom.low, atom.high, nonnegative)

    def apply_function(self, name: str, *arguments: Linear, nonnegative: bool = False) -> Linear:
        """The term of a function that has lines, over real numbers."""
        ends: list[arb] = []
        for x in arguments:
            ends += (larger(x.low, ZERO) if x.nonnegative else x.low), x.high
        *_, least, most = line_function(name)(*ends)
        return self.add_atom(Atom(name, arguments, low=least, high=most), nonnegative=nonnegative)

    def is_outside_state(self, x: Linear) -> bool:
        """Whether x is the state outside its grid; that state is never at the end of the grid."""
        return self.outside in x.terms and len(x.terms) == 1 and x.radius.is_zero()

    # ------------------------------------------------------------ linear operations

    def constant(self, value: float) -> Linear:
        """The term of a number of the program."""
        x = exact(value)
        return Linear(x, {}, ZERO, x, x, nonnegative=value >= 0)

    def rounded_term(self, x: Linear) -> Linear:
        """The term `x` as a machine rounds it to the nearest double.

        If it may overflow, `beyond` of the result has the conditions under which it does not.
        """
        relative = UNIT_ROUNDOFF * (1 + UNIT_ROUNDOFF)
        if beyond := self.no_overflow_conditions(x):
            enclosure = self.combine(((ONE, x), (ONE, self.term_within_sizes([relative], [x]))))
            enclosure.nonnegative, enclosure.rounds = x.nonnegative, x
            return replace(enclosure, radius=enclosure.radius + TINIEST, beyond=beyond)
        error = magnitude(x.low).max(magnitude(x.high)) * relative + TINIEST
        ends = exact(lower(x.low)), exact(upper(x.high))  # rounding is monotone
        return Linear(x.const, x.terms, x.radius + error, *ends, x.nonnegative, rounds=x)

    def no_overflow_conditions(self, x: Linear) -> tuple[Proposition, ...]:
        """Conditions under which a machine that computes `x` with rounding gets no infinity."""
        if magnitude(x.low).max(magnitude(x.high)) < LARGEST:
            return ()
        return tuple(self.below_zero(self.combine(((s, x),), -LARGEST)) for s in (ONE, -ONE))

    def combine(self, parts: Sequence[tuple[arb, Linear]], offset: arb = ZERO) -> Linear:
        """The term sum of factor * part, plus offset, with no rounding."""
        const, radius, low, high = offset, ZERO, offset, offset
        terms: dict[int, arb] = {}
        for factor, x in parts:
            const += factor * x.const
            radius += abs(factor) * x.radius
            ends = (factor * x.low, factor * x.high)
            low += ends[0].min(ends[1])
            high += ends[0].max(ends[1])
            for atom, coefficient in x.terms.items():
                terms[atom] = terms.get(atom, ZERO) + factor * coefficient
        terms = {a: c for a, c in terms.items() if not c.is_zero()}
        combination = Linear(const, terms, radius, low, high)
        if len(parts) > 1:
            self._narrow_range(combination)
        return combination

    def _narrow_range(self, x: Linear) -> None:
        """Narrows the range of a combination by its atoms' ranges, as some may have cancelled."""
        low, high = x.const - x.radius, x.const + x.radius
        for index, coefficient in x.terms.items():
            atom = self.atoms[index]
            ends = (coefficient * atom.low, coefficient * atom.high)
            low += ends[0].min(ends[1])
            high += ends[0].max(ends[1])
        x.low, x.high = larger(low, x.low), smaller(high, x.high)

    def add(self, a: Linear, b: Linear) -> Linear:
        """The sum `a + b`."""
        total = self.combine(((ONE, a), (ONE, b)))
        total.nonnegative = a.nonnegative and b.nonnegative
        return total

    def subtract(self, a: Linear, b: Linear) -> Linear:
        """The difference `a - b`; 0 if both are the same number."""
        if is_same_number(a, b):
            return self.constant(0.0)
        return self.combine(((ONE, a), (-ONE, b)))

    def multiply(self, a: Linear, b: Linear) -> Linear:
        """The product `a * b`; it is marked nonnegative if both factors are."""
        kept = a.nonnegative and b.nonnegative
        if a.is_constant and a.radius.is_zero():
            return replace(self.combine(((a.const, b),)), nonnegative=kept)
        if b.is_constant and b.radius.is_zero():
            return replace(self.combine(((b.const, a),)), nonnegative=kept)
        if is_same_number(a, b):
            return self.apply_function("square", a, nonnegative=True)
        x = hull(a.low, a.high) * hull(b.low, b.high)
        return self.add_atom(
            Atom("product", (a, b), low=x.lower(), high=x.upper()), nonnegative=kept
        )

    def divide(self, a: Linear, b: Linear) -> Linear:
        """The quotient a / b, with the obligation that b is not 0."""
        if b.is_constant and b.radius.is_zero() and not b.const.is_zero():
            return self.combine(((1 / b.const, a),))
        self.add_obligation(or_of(self.below_zero(b), self.below_zero(self.combine(((-ONE, b),)))))
        return self._soft_sign_quotient(a, b) or self.multiply(a, self.apply_function("inverse", b))

    def _soft_sign_quotient(self, a: Linear, b: Linear) -> Linear | None:
        """The quotient a / b if b = k |y| + c, k, c > 0, and a is y times something; else None.

        y / b is a soft sign of k y / c over k, at most 1 / k; y times an inverse would be more.
        """
        if len(b.terms) != 1 or not b.radius.is_zero():
            return None
        ((index, k),) = b.terms.items()
        if self.atoms[index].kind != "abs" or not (k > 0 and b.const > 0):
            return None
        (y,) = self.atoms[index].arguments
        if is_same_number(a, y):
            scaled = self.combine(((k / b.const, y),))
            return self.combine(((1 / k, self.apply_function("soft_sign", scaled)),))
        if len(a.terms) != 1 or not (a.const.is_zero() and a.radius.is_zero()):
            return None
        ((index, factor),) = a.terms.items()
        atom = self.atoms[index]
        if factor != 1:
            found = self._soft_sign_quotient(
                Linear(ZERO, {index: ONE}, ZERO, atom.low, atom.high), b
            )
            return found and self.combine(((factor, found),))
        for x, other in zip(atom.arguments, atom.arguments[::-1], strict=True):
            if atom.kind == "product" and (found := self._soft_sign_quotient(x, b)):
                return self.multiply(found, other)
        return None

    def minimum(self, a: Linear, b: Linear, *, tight: bool = False) -> Linear:
        """min(a, b) = b - max(b - a, 0): exact, as the machine's is, and never above a number b.

        `tight`: also never above a, which costs another atom.
        """
        if a.is_constant:
            a, b = b, a
        rest = self.apply_function("max0", self.subtract(b, a))
        difference = self.combine(((ONE, b), (-ONE, rest)))
        if not tight:
            return difference
        low = larger(a.low.min(b.low), difference.low)
        high = smaller(a.high.min(b.high), difference.high)
        return self.add_atom(Atom("min", (b, rest, a), low=low, high=high))

    def maximum(self, a: Linear, b: Linear, *, tight: bool = False) -> Linear:
        """max(a, b) = b + max(a - b, 0), never below a number b; `tight`: never below a, either."""
        if a.is_constant:
            a, b = b, a
        rest = self.apply_function("max0", self.subtract(a, b))
        total = self.combine(((ONE, b), (ONE, rest)))
        total.nonnegative = a.nonnegative or b.nonnegative
        if not tight:
            return total
        low = larger(a.low.max(b.low), total.low)
        high = smaller(a.high.max(b.high), total.high)
        atom = Atom("max", (b, rest, a), low=low, high=high)
        return self.add_atom(atom, nonnegative=total.nonnegative)

    def choose(self, c: Proposition, a: Linear, b: Linear) -> Linear:
        """The term `c ? a : b`."""
        if c.kind == "constant":
            return a if c.value else b
        if is_same_number(a, b):
            return a
        difference = self.subtract(a, b)
        low, high = a.low.min(b.low), a.high.max(b.high)
        return self.add_atom(
            Atom("choice", (a, b, difference), c, low, high),
            nonnegative=a.nonnegative and b.nonnegative,
        )

    def term_within_sizes(self, weights: Sequence[arb], arguments: Sequence[Linear]) -> Linear:
        """A term for any number of size up to sum weight |argument|; 0 if all weights are 0."""
        kept = [(w, x) for w, x in zip(weights, arguments, strict=True) if not w.is_zero()]
        if not kept:
            return self.constant(0.0)
        parts = (magnitude(w) * magnitude(x.low).max(magnitude(x.high)) for w, x in kept)
        size = sum(parts, ZERO)
        atom = Atom("spread", tuple(x for _, x in kept), low=-size, high=size)
        atom.weights = tuple(magnitude(w) for w, _ in kept)
        return self.add_atom(atom)

    # ------------------------------------------------------------ propositions

    def below_zero(self, x: Linear, *, strict: bool = True) -> Proposition:
        """The proposition `x < 0`, or `x <= 0` if not `strict`."""
        if x.high < 0 or (not strict and x.high <= 0):
            return TRUE
        if x.low > 0 or (strict and x.low >= 0):
            return FALSE
        if strict and x.nonnegative:
            return FALSE
        return Proposition("below", argument=x, strict=strict)

    def compare(self, op: str, a: Linear, b: Linear) -> Proposition:
        """The proposition `a op b` about two machine numbers."""
        if op in (">", ">="):
            return self.compare({">": "<", ">=": "<="}[op], b, a)
        if op == "!=":
            return negation(self.compare("==", a, b))
        if is_same_number(a, b):  # however it was rounded; that it is no NaN is an obligation
            return FALSE if op == "<" else TRUE
        if op == "==":
            return and_of(self._less_than(a, b, strict=False), self._less_than(b, a, strict=False))
        return self._less_than(a, b, strict=op == "<")

    def _less_than(self, a: Linear, b: Linear, *, strict: bool) -> Proposition:
        difference = self.subtract(a, b)
        less = self.below_zero(difference, strict=strict)
        plain = (a.is_constant or b.is_constant) and (a.rounds or b.rounds) is None
        kept = a.terms.keys() | b.terms.keys() == difference.terms.keys()
        if plain or not kept or less.kind == "constant":
            return less
        apart = Atom("apart", (difference, a, b), low=difference.low, high=difference.high)
        return replace(less, argument=self.add_atom(apart))


def is_same_number(a: Linear, b: Linear) -> bool:
    """Whether two terms are certainly the same number; rounded terms only if the same object."""
    if a is b:
        return True
    if not (a.radius.is_zero() and b.radius.is_zero() and a.const == b.const):
        return False
    return a.terms.keys() == b.terms.keys() and all(c == b.terms[i] for i, c in a.terms.items())


def input_atoms(terms: Terms, roots: Sequence[Linear | Proposition]) -> set[int]:
    """The indices of the inputs that terms and propositions depend on."""
    return {i for i in atoms_under(terms, roots) if terms.atoms[i].kind in ("state", "box")}


def atoms_under(terms: Terms, roots: Sequence[Linear | Proposition]) -> set[int]:
    """The indices of all atoms in the roots, including atoms inside other atoms."""
    indices: set[int] = set()
    todo: list[Linear | Proposition] = list(roots)
    while todo:
        x = todo.pop()
        if isinstance(x, Proposition):
            todo.extend(p.argument for p in subpropositions(x) if p.argument is not None)
            continue
        for index in x.terms.keys() - indices:
            indices.add(index)
            atom = terms.atoms[index]
            todo += [*atom.arguments, *([atom.condition] if atom.condition else [])]
    return indices


def subpropositions(x: Proposition) -> list[Proposition]:
    """A proposition and all its parts, each once; shared parts are the same object."""
    todo, known = [x], {id(x)}
    for p in todo:
        new = {id(q): q for q in p.parts if id(q) not in known}
        known |= new.keys()
        todo += new.values()
    return todo
