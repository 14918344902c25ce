"""The meaning of expressions and statements, on small functions written in Soter."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.environment import BudgetExceeded, Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file
from soter.language.model import typed as t
from soter.language.model.types import INT, INT_MAX, INT_MIN

if TYPE_CHECKING:
    from collections.abc import Callable

TYPES = """soter 1;
type Vec = { x: float, y: float };
type Body = { p: Vec, v: Vec };
type Colour = enum { RED, GREEN };
param GAIN: float = 2.5;
extern fun Ask(x: Vec, n: int): float;
"""


def program(text: str) -> t.TypedProgram:
    checked = check_file("test.soter", TYPES + text)
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    assert checked.program is not None
    return checked.program


def evaluator(checked: t.TypedProgram, **options: Any) -> Evaluator:
    params = {p: Evaluator({}).value(p.default) for p in checked.params.values()}
    externs = {checked.funs[n]: f for n, f in options.pop("externs", {}).items()}
    return Evaluator(params, externs, **options)


def function(text: str, **options: Any) -> Callable[..., Any]:
    """The function `F` of a program, as a Python function of Soter values."""
    checked = program(text)
    call = evaluator(checked, **options).closure_of(checked.funs["F"])
    return lambda *arguments: call(Environment(), arguments)


def fault_of(call: Callable[[], object]) -> tuple[FaultKind, str]:
    """The kind of the fault and the source text it blames."""
    with pytest.raises(StepFault) as caught:
        call()
    assert caught.value.span is not None
    return caught.value.kind, caught.value.span.text


# ---------------------------------------------------------------- scalars


@pytest.mark.parametrize(
    ("body", "value"),
    [
        ("-7 / 2", -3),
        ("-7 % 2", -1),
        ("7 % -2", 1),
        ("2 + 3 * 4 - 5", 9),
        ("int(-2.9)", -2),
        ("abs(-3)", 3),
        ("min(3, 2)", 2),
        ("max(3, 2)", 3),
    ],
)
def test_ints(body: str, value: int) -> None:
    assert function(f"fun F(): int {{ return {body}; }}")() == value


@pytest.mark.parametrize(
    ("body", "value"),
    [
        ("1.0 - 0.9 - 0.1", (1.0 - 0.9) - 0.1),
        ("float(3) / 2.0", 1.5),
        ("sqrt(2.0)", math.sqrt(2.0)),
        ("floor(-0.5)", -1.0),
        ("abs(-0.0)", 0.0),
        ("GAIN * 2.0", 5.0),
        ("saturate(5.0, 2.0)", 2.0),
        ("saturate(-5.0, 2.0)", -2.0),
        ("1e308 * 10.0", math.inf),
        ("-(0.0)", -0.0),
    ],
)
def test_floats(body: str, value: float) -> None:
    assert function(f"fun F(): float {{ return {body}; }}")().hex() == value.hex()


@pytest.mark.parametrize(
    ("body", "kind", "blamed"),
    [
        ("9223372036854775807 + a", FaultKind.OVERFLOW, "9223372036854775807 + a"),
        ("-9223372036854775807 - a - a", FaultKind.OVERFLOW, "-9223372036854775807 - a - a"),
        ("a / (a - 1)", FaultKind.DIVIDE, "a / (a - 1)"),
        ("a % (a - 1)", FaultKind.DIVIDE, "a % (a - 1)"),
        ("int(1e19)", FaultKind.CONVERT, "int(1e19)"),
        ("int(sqrt(-1.0))", FaultKind.CONVERT, "int(sqrt(-1.0))"),
    ],
)
def test_scalar_faults_blame_their_operation(body: str, kind: FaultKind, blamed: str) -> None:
    f = function(f"fun F(a: int): int {{ return {body}; }}")
    assert fault_of(lambda: f(1)) == (kind, blamed)


def test_float_division_by_either_zero_faults() -> None:
    f = function("fun F(a: float): float { return 1.0 / a; }")
    assert fault_of(lambda: f(-0.0)) == (FaultKind.DIVIDE, "1.0 / a")


def test_the_first_fault_from_the_left_names_the_step() -> None:
    f = function("fun F(a: int): int { return int(1e30) + 1 / a; }")
    assert fault_of(lambda: f(0))[0] is FaultKind.CONVERT


def test_and_or_and_conditional_evaluate_only_what_they_need() -> None:
    f = function(
        "fun F(a: int): bool { return (a != 0 && 1 / a > 0) || (a == 0 ? true : 1 / a < 0); }"
    )
    assert f(0) is True
    assert f(1) is True


def test_a_narrowed_int_faults_outside_its_range() -> None:
    f = function("fun F(a: int): int in [0, 9] { return a; }")
    assert f(9) == 9
    assert fault_of(lambda: f(10)) == (FaultKind.OVERFLOW, "a")


def test_enums_are_their_index() -> None:
    f = function("fun F(c: Colour): Colour { return c == Colour.RED ? Colour.GREEN : Colour.RED; }")
    assert (f(0), f(1)) == (1, 0)


# ---------------------------------------------------------------- vectors and structure


def test_vectors_work_component_by_component_in_operand_order() -> None:
    f = function("fun F(a: Vec, b: Vec): Vec { return (a + b - 0.5 * a) / 2.0; }")
    assert f((1.0, 2.0), (3.0, 4.0)) == (1.75, 2.5)


def test_nested_vectors_negate_scale_and_saturate() -> None:
    f = function("fun F(b: Body): Body { return saturate(-(b * 3.0), 4.0); }")
    assert f(((1.0, 2.0), (-3.0, 0.0))) == ((-3.0, -4.0), (4.0, -0.0))


def test_dot_adds_from_the_left_without_a_zero_in_front() -> None:
    f = function("fun F(a: Body, b: Body): float { return dot(a, b); }")
    assert math.copysign(1.0, f(((-0.0, -0.0), (-0.0, -0.0)), ((1.0, 1.0), (1.0, 1.0)))) == -1.0
    assert f(((1e16, 1.0), (-1e16, 1.0)), ((1.0, 1.0), (1.0, 1.0))) == 1e16 + 1.0 - 1e16 + 1.0


@given(st.lists(st.floats(-1e3, 1e3), min_size=4, max_size=4))
def test_norm_is_the_root_of_the_dot(x: list[float]) -> None:
    a, b, c, d = x
    assert NORM(((a, b), (c, d))) == math.sqrt(a * a + b * b + c * c + d * d)


NORM = function("fun F(a: Body): float { return norm(a); }")


def test_a_vector_divided_by_zero_faults() -> None:
    f = function("fun F(a: Vec, s: float): Vec { return a / s; }")
    assert fault_of(lambda: f((1.0, 1.0), 0.0))[0] is FaultKind.DIVIDE


def test_record_fields_are_evaluated_as_written_and_stored_as_declared() -> None:
    f = function("fun F(a: float): Vec { return { y: 1.0 / a, x: float(int(1e30)) }; }")
    assert fault_of(lambda: f(0.0)) == (FaultKind.DIVIDE, "1.0 / a")
    assert fault_of(lambda: f(1.0))[0] is FaultKind.CONVERT
    g = function("fun F(): Vec { return { y: 2.0, x: 1.0 }; }")
    assert g() == (1.0, 2.0)


def test_an_index_has_to_be_inside_the_array_or_the_length_of_the_list() -> None:
    f = function("fun F(a: int[3], i: int): int { return a[i]; }")
    assert f((5, 6, 7), 2) == 7
    assert fault_of(lambda: f((5, 6, 7), 3)) == (FaultKind.INDEX, "a[i]")
    assert fault_of(lambda: f((5, 6, 7), -1)) == (FaultKind.INDEX, "a[i]")
    g = function("fun F(a: int[<=3], i: int): int { return a[i] + a.len; }")
    assert g((5, 6), 1) == 8
    assert fault_of(lambda: g((5, 6), 2)) == (FaultKind.INDEX, "a[i]")


def test_the_length_of_an_array_is_a_constant_that_evaluates_nothing() -> None:
    f = function("fun F(a: int[2][3], i: int): int { return a[i].len; }")
    assert f(((1, 2), (3, 4), (5, 6)), 99) == 2


# ---------------------------------------------------------------- statements


def test_assignment_rebuilds_only_its_own_variable() -> None:
    f = function(
        """fun F(b: Body): Body[2] {
            var all: Body[2] = [b, b];
            let before = all;
            all[1].v.y = 9.0;
            return [all[1], before[1]];
        }"""
    )
    assert f(((1.0, 2.0), (3.0, 4.0))) == (
        ((1.0, 2.0), (3.0, 9.0)),
        ((1.0, 2.0), (3.0, 4.0)),
    )


def test_indices_are_checked_before_the_value_is_evaluated() -> None:
    f = function("fun F(i: int): int { var a: int[2]; a[i] = 1 / (i - i); return a[0]; }")
    assert fault_of(lambda: f(5))[0] is FaultKind.INDEX
    assert fault_of(lambda: f(1))[0] is FaultKind.DIVIDE


def test_a_full_list_is_noticed_after_the_value() -> None:
    f = function(
        "fun F(a: int[<=1], b: int): int[<=1] { var l: int[<=1] = a; push l, 1 / b; return l; }"
    )
    assert f((), 1) == (1,)
    assert fault_of(lambda: f((7,), 0))[0] is FaultKind.DIVIDE
    assert fault_of(lambda: f((7,), 1))[0] is FaultKind.CAPACITY


def test_push_below_the_top_of_a_place() -> None:
    f = function(
        "fun F(): int[<=2][2] { var l: int[<=2][2]; push l[1], 4; push l[1], 5; return l; }"
    )
    assert f() == ((), (4, 5))


def test_loops_run_over_ranges_and_sequences() -> None:
    f = function(
        """fun F(l: int[<=4]): int {
            var sum = 0;
            for i in 0..3 { sum = sum + i; }
            for x in l { sum = sum * 10 + x; }
            return sum;
        }"""
    )
    assert f((4, 5)) == 345


def test_a_sequence_is_evaluated_once_before_its_loop() -> None:
    f = function(
        """fun F(): int {
            var l: int[<=4] = [1, 2];
            for x in l { push l, x; }
            return l.len;
        }"""
    )
    assert f() == 4


def test_return_leaves_every_loop_and_branch() -> None:
    f = function(
        """fun F(a: int): int {
            for i in 0..5 { for j in 0..5 { if i * j == a { return 10 * i + j; } } }
            return -1;
        }"""
    )
    assert (f(6), f(7)) == (23, -1)


def test_a_returned_zero_or_false_is_a_value() -> None:
    f = function("fun F(a: bool): bool { if a { return false; } return true; }")
    assert (f(True), f(False)) == (False, True)


def test_if_takes_the_first_true_arm() -> None:
    f = function(
        """fun F(a: int): int {
            if a < 0 { return 1; } elseif a < 10 { return 2; } else { return 3; }
        }"""
    )
    assert (f(-1), f(5), f(50)) == (1, 2, 3)


def test_a_failed_assert_gives_its_message() -> None:
    f = function('fun F(a: int): int { assert a > 0, "not positive"; return a; }')
    assert f(1) == 1
    with pytest.raises(StepFault) as caught:
        f(0)
    assert (caught.value.kind, caught.value.detail) == (FaultKind.ASSERT, "not positive")


def test_functions_have_their_own_variables() -> None:
    f = function(
        """fun G(x: int): int { let y = x * 2; return y; }
        fun F(x: int): int { let y = 1; let z = G(x + 1); return 100 * z + 10 * y + x; }"""
    )
    assert f(3) == 813


def test_a_fault_inside_a_call_leaves_the_callers_variables_in_place() -> None:
    checked = program("fun G(x: int): int { return 1 / x; }")
    env = Environment()
    outside = env.variables
    with pytest.raises(StepFault):
        evaluator(checked).closure_of(checked.funs["G"])(env, (0,))
    assert env.variables is outside


# ---------------------------------------------------------------- externs, budget

ASK = "fun F(x: Vec): float { return Ask(x, 3) + 1.0; }"


def test_an_extern_function_gets_and_gives_python_values() -> None:
    f = function(ASK, externs={"Ask": lambda x, n: np.float32(x.x + x.y + n)})
    assert f((1.0, 2.0)) == 7.0


@pytest.mark.parametrize("answer", [None, "one", np.zeros(1)])
def test_an_extern_function_of_the_wrong_shape_faults(answer: object) -> None:
    f = function(ASK, externs={"Ask": lambda _x, _n: answer})
    assert fault_of(lambda: f((1.0, 2.0))) == (FaultKind.EXTERN, "Ask(x, 3)")


def test_an_extern_function_that_raises_or_is_unbound_faults() -> None:
    def broken(_x: object, _n: int) -> float:
        raise ZeroDivisionError

    f = function(ASK, externs={"Ask": broken})
    assert fault_of(lambda: f((1.0, 2.0)))[0] is FaultKind.EXTERN
    checked = program(ASK)
    unbound = evaluator(checked)
    call = unbound.closure_of(checked.funs["F"])
    assert unbound.unbound == {checked.funs["Ask"]}
    assert fault_of(lambda: call(Environment(), ((1.0, 2.0),)))[0] is FaultKind.EXTERN


def test_a_budget_ends_nested_loops() -> None:
    checked = program(
        """fun F(): int {
            var n = 0;
            for i in 0..5000 { for j in 0..5000 { n = n + 1; } }
            return n;
        }
        fun Small(): int { return 7; }"""
    )
    limited = evaluator(checked, budget=10_000)
    span = checked.funs["F"].span
    with pytest.raises(BudgetExceeded):
        limited.value(t.TypedCall(INT, span, checked.funs["F"], ()))
    assert limited.value(t.TypedCall(INT, span, checked.funs["Small"], ())) == 7


def test_a_budget_counts_calls_that_double() -> None:
    functions = ["fun F0(x: int): int { return x; }"] + [
        f"fun F{i}(x: int): int {{ return F{i - 1}(x) + F{i - 1}(x); }}" for i in range(1, 20)
    ]
    checked = program("\n".join(functions))
    zero = t.Literal(INT, checked.funs["F0"].span, 0)
    with pytest.raises(BudgetExceeded):
        evaluator(checked, budget=10_000).value(
            t.TypedCall(INT, zero.span, checked.funs["F19"], (zero,))
        )


@pytest.mark.long
def test_calls_deeper_than_the_stack_exceed_any_budget() -> None:
    span = program("fun F(): int { return 0; }").funs["F"].span
    value: t.TypedExpr = t.Literal(INT, span, 7)
    for i in range(20_000):
        fun = t.FunSymbol(f"F{i}", span, (), INT, (t.TypedReturn(span, value),), False, None)
        value = t.TypedCall(INT, span, fun, ())
    with pytest.raises(BudgetExceeded):
        Evaluator({}, budget=10**9).value(value)


# ---------------------------------------------------------------- against Python's own integers


@given(a=st.integers(INT_MIN, INT_MAX), b=st.integers(INT_MIN, INT_MAX))
def test_a_polynomial_of_ints_is_exact_or_faults(a: int, b: int) -> None:
    exact = [a * a, a * a - b, (a * a - b) * 3]
    if all(INT_MIN <= e <= INT_MAX for e in exact):
        assert POLYNOMIAL(a, b) == exact[-1]
    else:
        assert fault_of(lambda: POLYNOMIAL(a, b))[0] is FaultKind.OVERFLOW


POLYNOMIAL = function("fun F(a: int, b: int): int { return (a * a - b) * 3; }")
