"""Propositions against tables of truths, and what terms depend on."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from soter.certificate.cell_predicates import influence_of_inputs
from soter.certificate.extras.resting import TermsBesideZero
from soter.certificate.terms.compile_terms import (
    compile_step,
    compile_truths,
    form_of_box,
)
from soter.certificate.terms.linear_enclosures import ONE, ZERO, exact
from soter.certificate.terms.terms import (
    FALSE,
    TRUE,
    Linear,
    Proposition,
    Terms,
    and_of,
    atoms_under,
    choice_of_truths,
    conjuncts,
    input_atoms,
    is_same_number,
    negation,
    or_of,
)
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    Of = Callable[[float, float], float]
    Pair = tuple[Linear, Of]


def two_inputs() -> Any:
    terms = Terms()
    return terms, *(terms.add_input("state", n, exact(-6.0), exact(6.0)) for n in "xy")


def at_points(terms: Terms, value: Linear) -> Callable[[float, float], tuple[float, float]]:
    """What it is at points, compiled once."""
    step = compile_step(terms, [0, 1], 2, [value], ranges=[value])

    def at(x: float, y: float) -> tuple[float, float]:
        found: Any = step(form_of_box([(exact(v), exact(v)) for v in (x, y)], symbols=True))
        return found[1]  # type: ignore[no-any-return]

    return at


def image(terms: Terms, value: Linear, box: Sequence[tuple[float, float]]) -> Any:
    step = compile_step(terms, [0, 1], 2, [value], ranges=[value])
    return step(form_of_box([(exact(a), exact(b)) for a, b in box], symbols=True))


def ends(terms: Terms, value: Linear, x: float, y: float = 0.0) -> tuple[float, float]:
    """At a point."""
    return at_points(terms, value)(x, y)


def bits(terms: Terms, truth: Proposition, box: Sequence[tuple[float, float]]) -> int:
    of = compile_truths(terms, [0, 1], [truth], {})
    found: int = of(form_of_box([(exact(a), exact(b)) for a, b in box], symbols=False))[0]
    return found


def holds(terms: Terms, truth: Proposition, x: float, y: float = 0.0) -> bool:
    """At a point, where it is certain."""
    found = bits(terms, truth, [(x, x), (y, y)])
    assert found in (1, 2)
    return found == 2


def meaning(truth: Proposition, known: dict[int, bool]) -> bool:
    """By the truth of the propositions in it that are about numbers."""
    of = [meaning(p, known) for p in truth.parts]
    if truth.kind == "below":
        return known[id(truth)]
    return {"constant": truth.value, "and": all(of), "or": any(of), "not": not all(of)}[truth.kind]


def test_propositions_are_what_they_say_and_constants_do_not_stay_in_them() -> None:
    terms, x, y = two_inputs()
    p, q = terms.below_zero(x), terms.below_zero(y, strict=False)
    cases = list(itertools.product((True, False), repeat=2))
    written = [TRUE, FALSE, p, q, negation(p), and_of(p, q), negation(or_of(p, negation(q)))]
    written += [or_of(p, q)]

    def values(truth: Proposition) -> list[bool]:
        return [meaning(truth, {id(p): a, id(q): b}) for a, b in cases]

    def check(made: Proposition, wanted: Sequence[bool]) -> None:
        assert values(made) == list(wanted)
        assert not any(part.kind == "constant" for part in made.parts)
        parts = conjuncts(made)
        assert all(c.kind != "and" and c is not TRUE for c in parts)
        assert not any(c.kind == "not" and c.parts[0].kind == "or" for c in parts)
        together = [all(v) for v in zip(*map(values, parts), strict=True)]
        assert (together or [True] * 4) == list(wanted)

    for m, n in itertools.product(written, repeat=2):
        pairs = list(zip(values(m), values(n), strict=True))
        check(and_of(m, n), [a and b for a, b in pairs])
        check(or_of(m, n), [a or b for a, b in pairs])
        if TRUE in (m, n):
            assert and_of(m, n) is (n if m is TRUE else m)
        if FALSE in (m, n):
            assert or_of(m, n) is (n if m is FALSE else m)
        for c in written:
            three = zip(values(c), pairs, strict=True)
            check(choice_of_truths(c, m, n), [a if k else b for k, (a, b) in three])
    for m in written:
        check(negation(m), [not a for a in values(m)])
        assert (negation(negation(m)) is m) is (m.kind != "not")
        assert values(choice_of_truths(TRUE, p, m)) == values(p)
        assert values(choice_of_truths(FALSE, p, m)) == values(m)
    assert conjuncts(FALSE) == [FALSE]


def test_bits_of_propositions_at_points_and_on_boxes() -> None:
    terms, x, y = two_inputs()
    p, q = terms.below_zero(x), terms.below_zero(y, strict=False)
    table: list[tuple[Proposition, Callable[[bool, bool], bool]]] = [
        (p, lambda a, _: a),
        (q, lambda _, b: b),
        (negation(p), lambda a, _: not a),
        (and_of(p, q), lambda a, b: a and b),
        (or_of(p, negation(q)), lambda a, b: a or not b),
        (TRUE, lambda *_: True),
        (FALSE, lambda *_: False),
    ]
    for (of_a, a), (of_b, b) in itertools.product(
        (({True}, (-2.0, -1.0)), ({False}, (0.0, 1.0)), ({True, False}, (-1.0, 0.0))),
        (({True}, (-1.0, 0.0)), ({False}, (0.5, 1.0)), ({True, False}, (-1.0, 0.5))),
    ):
        for truth, of in table:
            may = {of(m, n) for m in of_a for n in of_b}
            assert bits(terms, truth, [a, b]) == 2 * (True in may) + (False in may)
    # p open, q certain: what it is in either case needs no p
    for sure, box in ((True, (-1.0, 0.0)), (False, (0.5, 1.0))):
        known = TRUE if sure else FALSE
        for truth in (choice_of_truths(p, known, q), choice_of_truths(p, q, known)):
            assert bits(terms, truth, [(-1.0, 0.0), box]) == (2 if sure else 1)


def test_a_proposition_is_strict_and_false_unless_it_says_else() -> None:
    made = Proposition("below")
    assert made.strict is True
    assert made.value is False


def test_a_demand_is_made_where_the_code_runs() -> None:
    terms, x, y = two_inputs()
    terms.path = p = terms.below_zero(x)
    terms.add_obligation(TRUE)
    assert terms.obligations == []
    terms.add_obligation(terms.below_zero(y))
    (demand,) = terms.obligations
    for a, b in itertools.product((-1.0, 1.0), repeat=2):
        assert holds(terms, demand, a, b) is (a >= 0 or b < 0)
    terms.path = TRUE
    terms.add_obligation(FALSE)
    assert terms.obligations[1:] == [FALSE]
    terms.path = FALSE
    terms.add_obligation(p)
    assert len(terms.obligations) == 2


OPERATORS: dict[str, Callable[[float, float], bool]] = {
    "<": lambda a, b: a < b, "<=": lambda a, b: a <= b, ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b, "==": lambda a, b: a == b, "!=": lambda a, b: a != b,
}  # fmt: skip


@pytest.mark.parametrize("op", OPERATORS)
def test_numbers_compared(op: str) -> None:
    of = OPERATORS[op]
    terms, x, y = two_inputs()
    truth = terms.compare(op, x, y)
    for a, b in itertools.product((-1.0, 0.0, 0.5), repeat=2):
        assert holds(terms, truth, a, b) is of(a, b)
    for alike in (x, terms.combine(((ONE, x),))):
        assert terms.compare(op, x, alike) is (TRUE if of(0, 0) else FALSE)
    rounded = terms.rounded_term(x)
    assert terms.compare(op, rounded, replace(rounded)).kind != "constant"
    for a, b in itertools.product((1.0, 2.0), repeat=2):
        known = terms.compare(op, terms.constant(a), terms.constant(b))
        assert known is (TRUE if of(a, b) else FALSE)


def test_what_is_not_negative_is_not_below_zero() -> None:
    terms, x, _ = two_inputs()
    kept = replace(x, nonnegative=True)
    assert terms.below_zero(kept) is FALSE
    assert terms.below_zero(kept, strict=False).kind == "below"
    assert terms.below_zero(x).strict is True
    assert terms.below_zero(x, strict=False).strict is False
    zero = terms.constant(0.0)
    assert terms.below_zero(zero) is FALSE
    assert terms.below_zero(zero, strict=False) is TRUE


def test_which_numbers_are_certainly_the_same() -> None:
    terms, x, y = two_inputs()
    two, half = exact(2.0), exact(0.5)
    a = terms.combine(((two, x), (ONE, y)), ONE)
    assert is_same_number(a, a)
    assert is_same_number(a, replace(a, terms=dict(a.terms)))
    assert is_same_number(replace(a, radius=half), a) is False
    assert is_same_number(a, replace(a, radius=half)) is False
    noisy = replace(a, radius=half)
    assert is_same_number(noisy, noisy)
    assert is_same_number(noisy, replace(noisy)) is False
    for other in (
        replace(a, const=two),
        replace(a, terms={0: two}),
        replace(a, terms={0: two, 1: two}),
        replace(a, terms={0: ONE, 1: ONE}),
        replace(a, terms={}),
    ):
        assert is_same_number(a, other) is False
        assert is_same_number(other, a) is False


# ---------------------------------------------------------------- what terms depend on


def test_what_a_term_depends_on() -> None:
    terms, x, y = two_inputs()
    z = terms.add_input("box", "z", ZERO, ONE)
    truth = and_of(
        terms.below_zero(x),
        negation(
            terms.below_zero(
                terms.combine(((ONE, terms.apply_function("square", z)),), exact(-0.5))
            )
        ),
    )
    square = len(terms.atoms) - 1
    chosen = terms.choose(truth, y, terms.constant(1.0))
    atom = len(terms.atoms) - 1
    assert atoms_under(terms, [chosen]) == {0, 1, 2, square, atom}
    assert input_atoms(terms, [chosen]) == {0, 1, 2}
    assert input_atoms(terms, [truth]) == {0, 2}
    assert input_atoms(terms, [TRUE]) == set()
    assert input_atoms(terms, [x, y]) == {0, 1}
    assert atoms_under(terms, []) == set()


def test_how_much_inputs_move_what_is_compared() -> None:
    terms, x, y = two_inputs()
    z = terms.add_input("box", "z", exact(1.0), exact(2.0))
    line = terms.below_zero(terms.combine(((exact(-2.0), x), (ONE, y))))
    product = terms.below_zero(terms.combine(((exact(3.0), terms.multiply(x, z)),)))
    table: list[tuple[Proposition, list[int], float]] = [
        (line, [0], 24.0), (line, [1], 12.0), (line, [0, 1], 36.0), (line, [2], 0.0),
        (product, [0], 36.0), (product, [2], 3.0), (product, [0, 2], 39.0),
        (and_of(line, product), [0], 60.0), (negation(line), [1], 12.0), (TRUE, [0], 0.0),
    ]  # fmt: skip
    for truth, inputs, most in table:
        assert float(influence_of_inputs(terms, truth, inputs)) == most


@all_rows("seed", range(40))
def test_an_input_that_lacks_an_end_decides_what_is_only_so_there(seed: int) -> None:
    """A comparison that is decided holds of every value that the inputs may have."""
    chance = np.random.default_rng(seed)
    terms = TermsBesideZero()
    signs = [int(s) for s in chance.integers(-1, 2, 2)]
    ends = {-1: (-2.0, 0.0), 0: (0.0, 0.0), 1: (0.0, 2.0)}
    inputs = [terms.add_input("state", f"x{k}", *map(exact, ends[s])) for k, s in enumerate(signs)]
    for x, sign in zip(inputs, signs, strict=True):
        (index,) = x.terms
        terms.excluded[index] = sign
    factors = [float(f) for f in chance.integers(-2, 3, 2)]
    offset = float(chance.integers(-1, 2)) * float(chance.integers(0, 2))
    pairs = zip(factors, inputs, strict=True)
    sum_ = terms.combine([(exact(f), x) for f, x in pairs], exact(offset))
    values = [
        sign * np.array([2.0, 1.0, 2.0**-60, 5e-324]) if sign else np.zeros(1) for sign in signs
    ]
    all_of = [offset + factors[0] * a + factors[1] * b for a in values[0] for b in values[1]]
    for strict in (True, False):
        said = terms.below_zero(sum_, strict=strict)
        held = [x < 0.0 if strict else x <= 0.0 for x in all_of]
        if said.kind == "constant":
            assert said.value == all(held) == any(held)
        elif not any(factors[k] and signs[k] for k in (0, 1)):
            pytest.fail("a number is compared with 0, and nothing is said")


def test_above_its_lower_end_it_is_above_and_below_its_upper_one_below() -> None:
    for sign, low, high in ((1, 0.0, 2.0), (-1, -2.0, 0.0)):
        terms = TermsBesideZero()
        x = terms.add_input("state", "x", exact(low), exact(high))
        zero = terms.constant(0.0)
        terms.excluded[x.atom] = sign
        for op, held in ((">", sign > 0), (">=", sign > 0), ("<", sign < 0), ("<=", sign < 0)):
            said = terms.compare(op, x, zero)
            assert (said.kind, said.value) == ("constant", held), op
