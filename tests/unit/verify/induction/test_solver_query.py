"""A question to the solver: each way of searching, and what is said when none comes to an end."""

from __future__ import annotations

import random
from typing import Any

import pytest

from soter.verify.induction import solver_terms
from soter.verify.induction.solver_terms import Query

z3 = pytest.importorskip("z3", reason="the extra is absent: pip install 'soter-rta[prove]'")


def _pigeons(n: int) -> Query:
    """n + 1 pigeons in n holes: cannot be met, and takes some work to see."""
    query = Query(z3)
    inside = [[z3.Bool(f"pigeon {p} in {h}") for h in range(n)] for p in range(n + 1)]
    query.add(True, *[z3.Or(*row) for row in inside])
    for h in range(n):
        query.add(z3.AtMost(*[row[h] for row in inside], 1))
    return query


def test_values_that_meet_the_constraints_are_of_the_context_that_asked() -> None:
    x, query = z3.Int("x"), Query(z3)
    query.add(x * x == 49, x < 0, True)
    assert query.check() == z3.sat
    assert query.model().eval(x, model_completion=True).as_long() == -7


def test_the_solver_gives_up_after_so_much_work(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _pigeons(4).check() == z3.unsat
    monkeypatch.setattr(solver_terms, "QUERY_WORK", 200)
    assert _pigeons(4).check() == z3.unknown


@pytest.mark.parametrize("way", ["_with_equations_solved", "_with_default_solver", "_with_simplex"])
def test_each_way_of_searching_answers_by_itself(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for other in ("_with_equations_solved", "_with_default_solver", "_with_simplex"):
        if other != way:
            monkeypatch.setattr(Query, other, getattr(Query, way))
    assert _pigeons(4).check() == z3.unsat
    query = Query(z3)
    query.add(z3.Int("y") > 3)
    assert query.check() == z3.sat


def test_random_constraints_are_answered_as_one_plain_solver_answers_them() -> None:
    """With uninterpreted functions, equations that are solved away, and values that meet all."""
    draw = random.Random(0)  # noqa: S311 - the same constraints each time
    sort = z3.DeclareSort("value")
    f, g = z3.Function("f", sort, z3.IntSort(), sort), z3.Function("g", sort, z3.IntSort())
    numbers, values = z3.Ints("a b c d"), z3.Consts("p q r", sort)
    answers = set()
    for _ in range(60):

        def number() -> Any:
            return draw.choice(numbers) * draw.randint(-2, 2) + g(value())

        def value() -> Any:
            inner = draw.choice(values)
            return inner if draw.random() < 0.5 else f(inner, draw.choice(numbers))

        def truth() -> Any:
            left, right = (number(), number()) if draw.random() < 0.5 else (value(), value())
            held = left <= right if z3.is_int(left) and draw.random() < 0.6 else left == right
            return z3.Not(held) if draw.random() < 0.4 else held

        given = [z3.Or(truth(), truth()) if draw.random() < 0.5 else truth() for _ in range(9)]
        query, plain = Query(z3), z3.SimpleSolver()
        query.add(*given)
        plain.add(*given)
        answers.add(str(query.check()))
        assert str(query.check()) == str(plain.check())
        if query.check() == z3.sat:
            model = query.model()
            assert all(z3.is_true(model.eval(x, model_completion=True)) for x in given)
    assert answers == {"sat", "unsat"}
