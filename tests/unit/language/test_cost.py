"""What a step costs at worst: counted by hand, never below an execution, refused (T007)."""

from __future__ import annotations

import pytest

from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import CheckResult, check_file
from soter.language.model import typed
from tables import all_rows

LIMIT = 10**12


def check(text: str) -> CheckResult:
    return check_file("test.soter", "soter 1;\n" + text)


def codes(text: str) -> list[str]:
    return [d.code for d in check(text).diagnostics.items if d.code[0] != "W"]


def cost_of_step(step: str, before: str = "") -> typed.Cost:
    checked = check(
        f"{before}\ntopic u: float;\nnode A period 10ms {{ publishes u; step {{ {step} }} }}\n"
    )
    assert checked.program is not None
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    return checked.program.costs[checked.program.nodes["A"]]


def chain(count: int) -> str:
    """`f63` takes 2^63 evaluations of `f0`, without any loop."""
    functions = ["fun f0(x: float): float { return x + 1.0; }"]
    functions += [
        f"fun f{i}(x: float): float {{ let a = f{i - 1}(x); return f{i - 1}(a); }}"
        for i in range(1, count)
    ]
    return "\n".join(functions) + "\n"


TWICE = "fun twice(x: float): float { return 2.0 * x; }"
WIDE = "type W = float[9];\nfun first(w: W): float { return w[0]; }"
VECTOR = "type V = float[3];\nfun g(v: V): V { return v + v; }"


@pytest.mark.parametrize(
    ("step", "before", "operations", "numbers"),
    [
        ("publish u = 1.0;", "", 1, 1),
        ("publish u = 1.0 + 2.0 * 3.0;", "", 3, 1),
        ("let a = 1.0; publish u = a;", "", 2, 2),
        ("publish u = twice(1.0);", TWICE, 1 + 2 + 2, 1 + 2),  # published; called; its own
        ("publish u = twice(twice(1.0));", TWICE, 1 + 2 * (2 + 2), 1 + 2),
        ("var s = 0.0; for i in 0..10 { s = s + 1.0; }", "", 1 + 1 + 10 * 3, 1 + 2),
        ("if true { publish u = 1.0; } else { publish u = -u0 * 2.0; }",
         "param u0: float = 1.0;", 1 + 3, 1),
        ("publish u = true ? 1.0 : twice(1.0);", TWICE, 1 + 1 + 4, 1 + 2),
        ("let v: V = g([1.0, 2.0, 3.0]);", VECTOR, 3 + 3 + (1 + 3) + (3 + 3), 1 + 3 + 6),
        ("for x in [1.0, 2.0] { publish u = x; }", "", 1 + 2 + 2 * 2, 1 + 1 + 2),
        # What is larger than eight numbers is passed by address.
        ("var w: W; publish u = first(w);", WIDE, 9 + 1 + (1 + 8) + (1 + 1), 9 + 1 + (8 + 1)),
    ],
)  # fmt: skip
def test_what_a_step_costs(step: str, before: str, operations: int, numbers: int) -> None:
    assert cost_of_step(step, before) == (operations, 8 * numbers, ())


def test_the_stack_is_that_of_the_deepest_calls_not_of_all() -> None:
    functions = (
        "fun small(x: float): float { return x; }\n"
        "fun large(x: float): float { let a: float[10] = [x, x, x, x, x, x, x, x, x, x]; "
        "return a[0] + small(x); }\n"
    )
    step = "publish u = small(1.0) + large(2.0) + small(3.0);"
    assert cost_of_step(step, functions).bytes == 8 * (1 + (2 + 10) + 2)


def test_externs_are_named_and_not_counted() -> None:
    functions = (
        'extern fun far(x: float): float from "c:far.c:far";\n'
        "fun near(x: float): float { return far(x); }"
    )
    assert cost_of_step("publish u = near(1.0);", functions) == (1 + 2 + (1 + 2), 8 * 5, ("far",))


def test_a_decision_costs_what_its_predicates_do() -> None:
    checked = check(
        "topic x: float in [0.0, 1.0]; topic u: float in [0.0, 1.0];\n"
        "plant P period 10ms { reads u; drives x = s; state s: float = 0.5; der s = u; }\n"
        "node A period 10ms { subscribes x; publishes u; step { publish u = x; } }\n"
        "node B period 10ms { subscribes x; publishes u; step { publish u = x; } }\n"
        "rta M { ac A; sc B; period 10ms; safe x < 2.0; ttf x > 0.5; safer x < 0.1; }\n"
        "rta N { ac A; sc B; period 10ms; safe x < 2.0; }\n"
    )
    program = checked.program
    assert program is not None
    costs = {s.name: cost.operations for s, cost in program.costs.items()}
    assert costs == {"A": 1, "B": 1, "M": 4}  # what is computed for N is not known yet


# ---------------------------------------------------------------- never below an execution

WORK = """
fun sums(n: int): float {
  var s = 0.0;
  for i in 0..50 {
    for j in 0..20 { if j < n { s = s + float(i * j); } else { s = s - 1.0; } }
  }
  return s;
}
fun moved(n: int): float[40] {
  var v: float[40];
  for i in 0..30 { v = v + v * 0.5; }
  return v;
}
fun both(n: int): float {
  let v = moved(n);
  return (n > 0 ? sums(n) : sums(1 - n)) + dot(v, v) + norm(v);
}
fun listed(n: int): int {
  let found: int[<=30] = [n, n + 1, n + 2, n + 3, n + 4, n + 5, n + 6, n + 7, n + 8, n + 9];
  var sum = 0;
  for x in found { sum = sum + x; }
  return sum;
}
"""


@all_rows("name", ["sums", "moved", "both", "listed"])
@all_rows("argument", [-3, 0, 7, 100])
def test_no_execution_takes_more_than_the_bound(name: str, argument: int) -> None:
    step = f"let found = {name}({argument});"
    text = f"topic u: float;\nnode A period 10ms {{ publishes u; step {{ {step} }} }}"
    checked = check(WORK + text)
    assert checked.program is not None
    node = checked.program.nodes["A"]
    declare = node.step[0]
    assert isinstance(declare, typed.TypedDeclare)
    evaluator = Evaluator({}, None, LIMIT)
    evaluator.value(declare.value)
    assert 0 < evaluator.operations_spent <= checked.program.costs[node].operations


# ---------------------------------------------------------------- refused


def test_calls_of_calls_of_calls_are_refused_once() -> None:
    diagnostics = check(chain(64)).diagnostics.items
    assert [d.code for d in diagnostics] == ["T007"]
    assert "`f26` may take 536 870 906 operations" in diagnostics[0].message


def test_long_chains_of_single_calls_are_fine() -> None:
    functions = ["fun f0(x: float): float { return x + 1.0; }"]
    functions += [f"fun f{i}(x: float): float {{ return f{i - 1}(x); }}" for i in range(1, 3000)]
    assert codes("\n".join(functions)) == []


DEAR = "fun dear(x: float): float { var s = x; for i in 0..1000000 { s = s + x; } return s; }\n"
DEAR += (
    "fun dearer(x: float): float { var s = x; for i in 0..120 { s = s + dear(x); } return s; }\n"
)
TOPIC = "\ninput topic x: float in [0.0, 1.0];\ntopic u: float;\n"


def test_what_is_judged_is_counted_too() -> None:
    sum_ = "dearer(x) + dearer(x) > 0.0"
    node = "node A period 10ms {{ subscribes x; publishes u; {} step {{ publish u = x; }} }}\n"
    plain = node.format("")
    system = "system S {{ node A; input x in {{ 0.5 }} every 10ms; {} until 1s; }}"
    assert codes(DEAR + TOPIC + plain + system.format("")) == []
    assert codes(DEAR + TOPIC + plain + system.format(f"always {sum_};")) == ["T007"]
    assert codes(DEAR + TOPIC + node.format(f"assumes {sum_};") + system.format("")) == ["T007"]
