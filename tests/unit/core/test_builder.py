"""Core as it is built: what may fault is a statement in order, the rest an expression."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.core import core
from soter.core.core_walks import walk
from soter.core.lower_expressions import positions_and_types, rebuild, select
from soter.language.model.types import BOOL, FLOAT, INT, ArrayType, RecordType

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.core import CoreSystem
    from soter.language.model.system import System

    Lowered = Callable[[str], tuple[System, CoreSystem]]


def kinds(statements: tuple[core.Stmt, ...]) -> list[str]:
    """What the statements are: `add` for a checked sum, else the class."""
    return [s.op if isinstance(s, core.Checked) else type(s).__name__ for s in statements]


def body(lowered: Lowered, step: str, *, extra: str = "") -> tuple[core.Stmt, ...]:
    """The statements of a node that has ints `n`, `m`, floats `x`, `y` and an array `a`."""
    _, made = lowered(
        f"""topic z: float; {extra}
        node N period 20ms {{
          publishes z; var n: int; var m: int; var x: float; var y: float; var a: float[3];
          step {{ {step} }}
        }}
        system S {{ node N; until 1s; }}"""
    )
    return made.nodes[0].body


@pytest.mark.parametrize(
    ("step", "expected"),
    [
        ("publish z = x + y * 2.0;", ["Publish"]),
        ("n = n + m * 2 - 1;", ["mul", "add", "sub", "Set"]),
        ("n = (n + 1) * (m + 2);", ["add", "add", "mul", "Set"]),
        ("n = -n; m = abs(m);", ["neg", "Set", "abs", "Set"]),
        ("publish z = x / 2.0;", ["Publish"]),
        ("publish z = x / y;", ["Guard", "Publish"]),
        ("n = int(x);", ["to_int", "Set"]),
        ("publish z = a[2];", ["Publish"]),
        ("publish z = a[n];", ["index", "Publish"]),
        ("a[n] = float(n / m);", ["index", "div", "Set"]),
        ("assert n > 0;", ["Guard"]),
        ("publish z = dt + time;", ["Publish"]),
    ],
)
def test_what_may_fault_is_a_statement_before_its_use(
    lowered: Lowered, step: str, expected: list[str]
) -> None:
    assert kinds(body(lowered, step)) == expected


def test_operands_are_evaluated_from_left_to_right(lowered: Lowered) -> None:
    first, second, product, _ = body(lowered, "n = (n + 1) * (m + 2);")
    assert isinstance(first, core.Checked)
    assert isinstance(second, core.Checked)
    assert isinstance(product, core.Checked)
    names = [o.name for o in product.operands if isinstance(o, core.Var)]
    assert names == [first.name, second.name]
    assert first.operands[0] == core.Var(INT, "n")


def test_a_branch_is_evaluated_only_where_it_is_taken(lowered: Lowered) -> None:
    (pure,) = body(lowered, "publish z = x > 0.0 ? x : y;")
    assert isinstance(pure, core.Publish)
    assert isinstance(pure.value, core.Select)
    chosen, branch, publish = body(lowered, "publish z = x > 0.0 ? a[n] : y;")
    assert isinstance(chosen, core.Let)
    assert isinstance(branch, core.If)
    assert (kinds(branch.then), kinds(branch.otherwise)) == (["index", "Set"], ["Set"])
    assert isinstance(publish, core.Publish)
    both = body(lowered, "if x > 0.0 && a[n] > 1.0 { publish z = 1.0; }")
    guarded = [s for s in both if isinstance(s, core.If) and "index" in kinds(s.then)]
    assert len(guarded) == 1
    assert "index" not in kinds(both)


def test_a_period_and_a_parameter_are_constants(lowered: Lowered) -> None:
    statements = body(lowered, "publish z = dt + GAIN;", extra="param GAIN: float = 2.5;")
    constants = {n.name: n.value for n in walk(statements) if isinstance(n, core.Const)}
    assert constants == {"dt": 0.02, "GAIN": 2.5}


# ---------------------------------------------------------------- functions

FUNCTIONS = """
fun inner(v: float): float { return v + 1.0; }
fun risky(n: int): int { return n + 1; }
fun outer(v: float): float { if v > 0.0 { return inner(v); } return inner(inner(v)); }
fun first(xs: float[3]): float { for x in xs { if x > 0.0 { return x; } } return 0.0; }
fun unused(v: float): float { return v; }
"""


def functions(lowered: Lowered, step: str) -> dict[str, core.Function]:
    _, made = lowered(
        f"""topic z: float; {FUNCTIONS}
        node N period 20ms {{ publishes z; var n: int; var a: float[3]; step {{ {step} }} }}
        system S {{ node N; until 1s; }}"""
    )
    return {f.name: f for f in made.functions}


def test_functions_are_lowered_once_callees_first_and_only_where_they_are_used(
    lowered: Lowered,
) -> None:
    function_by_name = functions(lowered, "publish z = outer(inner(outer(1.0)));")
    assert list(function_by_name) == ["inner", "outer"]


def test_only_functions_that_may_fault_say_so(lowered: Lowered) -> None:
    function_by_name = functions(lowered, "n = risky(n); publish z = outer(first(a));")
    assert {name: f.can_fault for name, f in function_by_name.items()} == {
        "risky": True, "inner": False, "first": False, "outer": False,
    }  # fmt: skip


def test_early_returns_become_one_exit(lowered: Lowered) -> None:
    function_by_name = functions(lowered, "publish z = outer(first(a));")
    outer, first = function_by_name["outer"], function_by_name["first"]
    assert kinds(outer.body) == ["Let", "If"]
    assert isinstance(outer.result, core.Var)
    split = outer.body[1]
    assert isinstance(split, core.If)
    assert (kinds(split.then), kinds(split.otherwise)) == (["Call", "Set"], ["Call", "Call", "Set"])
    assert kinds(function_by_name["inner"].body) == []
    # a loop goes on, but does nothing once a flag says that the function has returned
    (flag,) = [s.name for s in first.body if isinstance(s, core.Let) and s.value.type == BOOL]
    (loop,) = [s for s in first.body if isinstance(s, core.Loop)]
    conditions = [n.condition for n in walk(loop.body) if isinstance(n, core.If)]
    assert core.Unary(BOOL, "not", core.Var(BOOL, flag)) in conditions


# ---------------------------------------------------------------- shapes

PLACE = RecordType((("at", ArrayType(FLOAT, 2)), ("turn", FLOAT)), "Place")


def test_leaves_are_selected_and_put_together_again() -> None:
    paths = [path for path, _ in positions_and_types(PLACE)]
    assert paths == [(0, 0), (0, 1), (1,)]
    variable = core.Var(PLACE, "p")
    copy = rebuild(PLACE, lambda path: select(variable, path))
    assert isinstance(copy, core.Make)
    for path in paths:
        leaf = select(copy, path)  # through a Make no field is read
        assert leaf == select(variable, path)
        assert leaf.type == FLOAT
    field = core.Field(ArrayType(FLOAT, 2), variable, 0)
    assert select(variable, (0, 1)) == core.Element(FLOAT, field, core.Const(INT, 1))
