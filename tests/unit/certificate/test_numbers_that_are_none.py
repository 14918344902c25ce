"""Numbers that are none and only compared, written twice, of one error, or chosen by a truth."""

from __future__ import annotations

import itertools
import math
from functools import reduce
from typing import TYPE_CHECKING, Any

import pytest

import soter
from soter.certificate import rechecker
from soter.certificate.cell_predicates import influence_of_inputs
from soter.certificate.extras.prelude_functions import nearest_whole, prelude_function
from soter.certificate.reading.symbolic_operations import Operations
from soter.certificate.reading.symbolic_reading import Surroundings, SymbolicReader
from soter.certificate.terms.compile_terms import (
    compile_lines,
    compile_step,
    compile_truths,
    form_of_box,
)
from soter.certificate.terms.linear_enclosures import ONE, exact
from soter.certificate.terms.straight_line import CERTAIN
from soter.certificate.terms.terms import TRUE, Linear, Terms, and_of, choice_of_truths, conjuncts
from soter.language.evaluate.arithmetic import StepFault
from soter.language.front_end import check_file
from soter.language.model import typed
from soter.language.model.types import FLOAT
from work import work_of

if TYPE_CHECKING:
    from pathlib import Path

FALSE_BITS, EITHER = 1, 3
PROGRAM = """soter 1;
fun low(v: float): bool {{ return v < 0.25; }}
fun whole(v: float): int {{ return int(v); }}
fun root(v: float): int {{ let y = sqrt(v); return int(y); }}
fun sure(v: float): float {{ let y = sqrt(v); assert y >= 0.0; return y; }}
fun side(v: float): float {{
  let y = sqrt(v);
  if y >= 0.0 {{ return 1.0; }} else {{ assert false; }}
  return 2.0;
}}
fun f(x: float, e: float): {kind} {{ {body} }}
"""


def read(folder: Path, body: str, *, kind: str = "bool", reach: float = 2.0) -> Any:
    """(terms, what the function f gives of two inputs in [-reach, reach])."""
    path = folder / "one.soter"
    text = body if "return" in body else f"return {body};"
    path.write_text(PROGRAM.format(kind=kind, body=text), encoding="utf-8")
    program = check_file(str(path)).program
    assert program is not None
    fun, terms = program.funs["f"], Terms()
    inputs = [terms.add_input("state", n, exact(-reach), exact(reach)) for n in "xe"]
    reads = tuple(typed.VarRead(p.type, p.span, p) for p in fun.parameters)
    call = typed.TypedCall(fun.result, fun.span, fun, reads)
    value = SymbolicReader(terms, Surroundings({}, {})).evaluate(
        call, dict(zip(fun.parameters, inputs, strict=True))
    )
    return terms, value


def bits(terms: Terms, truth: Any, x: tuple[float, float]) -> int:
    """The bits of a truth where the first input lies in a range, the other one at 0."""
    if isinstance(truth, bool):
        return CERTAIN if truth else FALSE_BITS
    form = form_of_box([(exact(x[0]), exact(x[1])), (exact(0.0), exact(0.0))], symbols=False)
    (found,) = compile_truths(terms, [0, 1], [truth], {})(form)
    return int(found)


def demanded(terms: Terms, x: tuple[float, float]) -> bool:
    """Whether everything that is demanded is certain there."""
    return all(bits(terms, o, x) == CERTAIN for o in terms.obligations)


@pytest.mark.parametrize(
    ("body", "defined", "holds"),
    [
        ("sqrt(x) < 0.5", (0.0, 0.2), (0.5, 2.0)),
        ("log(x) < -1.0", (0.01, 0.3), (0.5, 2.0)),
        ("asin(x) < 0.5", (-1.0, 0.4), (0.5, 1.0)),
        ("acos(x) > 1.5", (-1.0, 0.0), (0.1, 1.0)),
        ("pow(x, 1.5) < 0.25", (0.0, 0.3), (0.5, 2.0)),
        ("clamp(0.0, 0.0, x) == 0.0", (0.0, 1.0), (math.inf, math.inf)),
        ("exp(800.0 * x) > 1.0", (0.01, 0.02), (-2.0, -0.01)),
        ("x * 1.0e308 * 10.0 < 1.0", (-0.05, -0.01), (0.01, 0.05)),
    ],
)
def test_a_comparison_has_a_value_also_where_a_number_may_be_none(
    tmp_path: Path, body: str, defined: tuple[float, float], holds: tuple[float, float]
) -> None:
    """Where it is one the comparison is known as ever; where it may be none nothing is known."""
    terms, truth = read(tmp_path, body)
    assert terms.obligations == []
    assert bits(terms, truth, defined) == CERTAIN
    if holds[0] < math.inf:
        assert bits(terms, truth, holds) == FALSE_BITS
    for outside in ((-2.0, 2.0), (-2.0, -0.5), (1.25, 2.0)):
        value = soter.load(tmp_path / "one.soter").function("f")
        ends = {bool(value(x, 0.0)) for x in (*outside, sum(outside) / 2)}
        found = bits(terms, truth, outside)
        assert found == EITHER or (found == CERTAIN) is ends.pop()


@pytest.mark.parametrize(
    "body",
    [
        "int(sqrt(x)) < 3",
        "1.0 / (x * x - 1.0) < 3.0",
        "x > 0.5 ? sqrt(x) < 0.5 : int(sqrt(x)) == 0",
        "whole(sqrt(x)) > 3",
        "root(x) > 3",
        "sure(x) > 3.0",
        "side(x) > 3.0",
        "float(whole(asin(x - 0.5))) < log(x)",
        "1.0 / (1.0 / (exp(2000.0 * x) - exp(2000.0 * x))) > 3.0",
        "1.0 / (2.0 + sqrt(x)) > 3.0 && log(x) > float(root(x))",
    ],
)
def test_what_makes_a_step_fault_is_demanded(tmp_path: Path, body: str) -> None:
    """An int of no number is a fault, so is a division by 0, wherever what it is of was made."""
    terms, _ = read(tmp_path, body)
    assert terms.obligations
    assert not demanded(terms, (-1.5, 1.5))
    function = soter.load(tmp_path / "one.soter").function("f")
    for k in range(-6, 7):
        try:
            function(k / 4.0, 0.0)
        except StepFault:
            assert not demanded(terms, (k / 4.0, k / 4.0))


@pytest.mark.parametrize("body", ["low(sqrt(x))", "let y = sqrt(x); return y < 0.25;"])
def test_a_number_that_is_none_goes_anywhere_until_it_is_compared(
    tmp_path: Path, body: str
) -> None:
    terms, truth = read(tmp_path, body)
    assert terms.obligations == []
    for x, known in ((-1.0, EITHER), (0.01, CERTAIN), (1.0, FALSE_BITS)):
        assert bits(terms, truth, (x, x)) == known


@pytest.mark.parametrize("rounded", [True, False])
def test_what_is_made_of_a_number_rests_on_what_it_rests_on(rounded: bool) -> None:
    """Whatever the operation; an int of it is demanded to be one instead."""
    terms = Terms()
    make = Operations(terms, rounded=rounded)
    x, y, c = (terms.add_input("state", n, exact(-1.5), exact(2.0)) for n in "xyc")
    root = make.result_of_builtin("sqrt", x)
    (rests,) = root.rests
    made = [
        make.arithmetic(op, *two) for op in "+-*" for two in ((root, y), (y, root), (2.0, root))
    ]
    made += [
        make.min_or_max(name, *two) for name in ("min", "max") for two in ((root, y), (1.0, root))
    ]
    made += [make.result_of_builtin(name, root) for name in ("abs", "floor", "sqrt", "float")]
    made += [
        prelude_function(make, *a) for a in (("sin", root), ("atan2", y, root), ("pow", root, 2.0))
    ]
    made += [prelude_function(make, "smoothstep", -3.0, 3.0, root), make.clamp(root, 0.0, 1.0)]
    made += [make.clamp(y, root, 3.0), make.negate(root), nearest_whole(make, root)]
    assert all(rests in value.rests for value in made)
    assert make.arithmetic("-", root, root).rests == (rests,)
    assert terms.obligations == []
    chosen = make.choice_of(FLOAT, terms.below_zero(c), root, y)
    assert len(chosen.rests) == 1
    assert rests not in chosen.rests
    assert not make.result_of_builtin("int", root).rests
    assert terms.obligations == [rests]
    make.arithmetic("/", root, terms.combine(((ONE, y),), exact(9.0)))
    assert terms.obligations == [rests]
    make.arithmetic("/", y, make.result_of_builtin("sqrt", y))
    assert len(terms.obligations) == 3


def test_what_a_truth_chooses_of_two_that_hold_holds(tmp_path: Path) -> None:
    terms, truth = read(tmp_path, "x > 0.0 ? x < 1.0 : x > -1.0")
    for x, wanted in (((-0.5, 0.5), CERTAIN), ((1.25, 2.0), FALSE_BITS), ((0.5, 1.5), EITHER)):
        assert bits(terms, truth, x) == wanted
    made = Terms()
    one, other = (made.add_input("state", n, exact(-2.0), exact(2.0)) for n in "xy")
    c = made.below_zero(other)
    a, b = (made.below_zero(made.combine(((f, one),), exact(-1.0))) for f in (ONE, -ONE))
    for p, q in itertools.product((a, b, TRUE), repeat=2):
        truth = choice_of_truths(c, p, q)
        form = form_of_box([(exact(-0.5), exact(0.5)), (exact(-1.0), exact(1.0))], symbols=False)
        assert compile_truths(made, [0, 1], [truth], {})(form) == (CERTAIN,)


@pytest.mark.parametrize(
    ("body", "x", "known"),
    [
        ("exp(300.0 * x) < 0.5", (-1.0, -0.5), CERTAIN),
        ("exp(900.0 * x) < 0.5", (-1.0, -0.5), CERTAIN),
        ("exp(900.0 * (-x)) > max(x, x)", (-0.42, -0.33), CERTAIN),
        ("exp(900.0 * (x + 2.0)) > abs(x)", (-1.0, -0.9), CERTAIN),
        ("pow(x + 2.5, 300.0) < 0.5", (-2.0, -1.75), CERTAIN),
        ("0.0 < floor(x) / sqrt(x * x + 0.16)", (0.4, 0.45), FALSE_BITS),
        ("0.0 < floor(x) / sqrt(x * x + 0.16)", (1.0, 1.5), CERTAIN),
        ("sign(floor(x) * sqrt(x * x + 0.16)) == 0.0", (0.4, 0.45), CERTAIN),
        ("x * 1.0e300 * x > abs(x) * 3.0", (0.5, 1.0), CERTAIN),
    ],
)
def test_what_a_machine_is_off_is_a_share_of_what_it_computes_there(
    tmp_path: Path, body: str, x: tuple[float, float], known: int
) -> None:
    """And not of the largest number that it may ever compute, which may be 400 orders above."""
    terms, truth = read(tmp_path, body)
    assert bits(terms, truth, x) == known
    function = soter.load(tmp_path / "one.soter").function("f")
    for at in (x[0], sum(x) / 2, x[1]):
        assert function(at, 0.0) is (known == CERTAIN)


def chain_of(kind: str, n: int) -> str:
    """A body in which n truths, or n choices of numbers that may be none, rest on one another."""
    if kind == "and":
        return f"var s = x < 0.0; for k in 0..{n} {{ s = s && !(!s || !s); }} return s;"
    if kind == "bool":
        return "(" * n + "(x < 0.0)" + "".join(f" == (x < e + 0.{k}))" for k in range(n))
    chosen = "if x > e * float(k) { s = s + log(x + 0.01 * float(k)); }"
    return f"var s = 0.0; for k in 0..{n} {{ {chosen} }} return s;"


@pytest.mark.parametrize("kind", ["bool", "float", "and"])
def test_what_is_said_twice_is_looked_at_once(tmp_path: Path, kind: str) -> None:
    """Each level of a chain has the one before in it twice: work that doubles ends never."""

    def asked(n: int) -> None:
        terms, value = read(tmp_path, chain_of(kind, n), kind=kind.replace("and", "bool"))
        truths = [*value.rests, *value.beyond] if isinstance(value, Linear) else [value]
        compile_truths(terms, [0, 1], truths, {})
        assert (
            influence_of_inputs(terms, reduce(and_of, conjuncts(reduce(and_of, truths))), [0, 1])
            > 0
        )

    asked(1)
    works = [work_of(lambda n=n: asked(n))[1] for n in (2, 6, 10)]  # type: ignore[misc]
    assert works[2] - works[1] < 3 * (works[1] - works[0])


def width(terms: Terms, value: Linear, x: tuple[float, float]) -> float:
    """How wide a number's row is where the first input is known, the other one anywhere."""
    lines: Any = compile_lines(terms, [0], 1, [value], [], {1: (exact(-0.5), exact(0.5))})
    form = form_of_box([(exact(x[0]), exact(x[1]))], symbols=True)
    (_, _, spread, _, _) = lines(form)
    return 2 * float(spread)


@pytest.mark.parametrize(
    "body",
    [
        "min(2.0 * x, 1.0 - 0.27 * abs(sin(exp(x))))",
        "max(0.27 * abs(sin(exp(-x))) - 1.0, 2.0 * x)",
    ],
)
def test_of_two_numbers_whose_ranges_are_apart_one_is_the_lesser_and_one_the_greater(
    tmp_path: Path, body: str
) -> None:
    """Though a line over their difference does not say so."""
    terms, value = read(tmp_path, f"{body} - 2.0 * x", kind="float")
    assert width(terms, value, (-0.366, 0.366)) < 1e-9
    assert width(terms, value, (-0.4, 0.4)) > 1e-4


@pytest.mark.parametrize(
    ("body", "alone"),
    [
        ("max(x + e, -1.9) - e", 0.0),
        ("max(x + e, -1.9) - max(x + e, -1.8)", 0.0),
        ("sin(x + e) - 0.9 * e", 0.35),
        ("hypot(x + e, 1.0) + 0.2 * (x - e)", 0.5),
    ],
)
def test_of_one_error_that_comes_several_ways_a_part_may_cancel(
    tmp_path: Path, body: str, alone: float
) -> None:
    terms, value = read(tmp_path, body, kind="float")
    assert width(terms, value, (0.3, 0.3)) <= alone + 1e-9


@pytest.mark.parametrize(
    ("body", "width_"),
    [
        ("sin(x) * sin(x)", (0.0, 1.0)),
        ("atan2(x, 2.0) - atan2(x, 2.0)", (0.0, 0.0)),
        ("clamp(x, -e, 1.0) - clamp(x, -e, 1.0)", (0.0, 0.0)),
        ("(x < 0.5 ? x : 1.0) - (x < 0.5 ? x : 1.0)", (0.0, 0.0)),
        ("(x + 0.1) * (x + 0.1)", (0.0, 4.5)),
    ],
)
def test_what_is_written_twice_is_one_number(
    tmp_path: Path, body: str, width_: tuple[float, float]
) -> None:
    _, value = read(tmp_path, body, kind="float")
    assert width_[0] - 1e-9 <= float(value.low)
    assert float(value.high) <= width_[1] + 1e-9


def test_what_is_rounded_otherwise_is_another_number(tmp_path: Path) -> None:
    """(a + b) + c and a + (b + c) may differ by what is rounded, though they are alike."""
    _, value = read(tmp_path, "((x + 0.1) + 0.2) - (x + (0.1 + 0.2))", kind="float")
    assert float(value.high) > 1e-17


SC = "clamp(-2.0 * x, -1.0, 1.0)"
MODULE = """soter 1;
topic x: float in [-3.0, 3.0] max_age 20ms;
topic u: float in [-1.0, 1.0] = 0.0;
plant P period 10ms {
  reads u; drives x = p; state p: float in [-0.1, 0.1]; der p = u; measured x within 0.02;
}
node Fast period 50ms { publishes u; step { publish u = 1.0; } }
node Slow period 50ms { subscribes x; publishes u; step { publish u = SC; } }
rta M {
  ac Fast; sc Slow; period 100ms; safe abs(x) < 1.0; ttf abs(x) > 0.5; safer abs(x) < 0.4;
  verify { grid x in [-1.25, 1.25] / 25; }
}
system S default { p: P; module M; until 10s; }
"""


@pytest.mark.parametrize("law", [SC, "clamp(-1.0e308 * x * 10.0 + 1.0, -1.0, 1.0)"])
def test_an_infinite_number_that_a_limit_catches_does_no_harm(tmp_path: Path, law: str) -> None:
    (tmp_path / "p.soter").write_text(MODULE.replace("SC;", f"{law};", 1))
    (module,) = soter.load(tmp_path / "p.soter").verify(cert=tmp_path / "c", refute=False).modules
    assert module.verdict == "proved"
    assert rechecker.recheck(tmp_path / "c", 1).verdict == "accepted"


HUGE = "x * 1.0e308"


@pytest.mark.parametrize(
    ("body", "demanded_"),
    [
        (f"clamp({HUGE}, -1.0, 1.0)", False),
        (f"clamp(-({HUGE}), -1.0, 1.0)", False),
        (f"clamp({HUGE} * 2.0, -1.0, 1.0)", False),
        (f"clamp(-3.0 * ({HUGE}), -1.0, 1.0)", False),
        (f"clamp({HUGE} + e, -1.0, 1.0)", False),
        (f"clamp(e - {HUGE}, -1.0, 1.0)", False),
        (f"clamp(x > 0.0 ? {HUGE} : e, -1.0, 1.0)", False),
        (f"clamp(4.0 * ({HUGE}){' - 4.4e307' * 7}, -1.0, 1.0)", True),
        (f"clamp({HUGE}, -1.0e300, 1.0e300)", True),
        ("smoothstep(-1.7e308, 1.7e308, x)", True),
        (f"smoothstep({HUGE}, 1.7e308, e)", True),
        (f"clamp({HUGE} * 0.5, -1.0, 1.0)", True),
        (f"clamp({HUGE} * e, -1.0, 1.0)", True),
        (f"clamp({HUGE} - e * 1.0e308, -1.0, 1.0)", True),
        (f"clamp({HUGE} + 1.0e308, -1.0, 1.0)", True),
        (f"clamp(1.0 / (abs({HUGE}) + 1.0), -1.0, 1.0)", True),
        (f"clamp(({HUGE}) / 3.0, -1.0, 1.0)", True),
        (f"sin(clamp({HUGE}, e * 1.0e308, 1.0e308))", True),
        (f"tanh({HUGE})", True),
        (f"let y = {HUGE}; return x < 0.5 ? clamp(y, -1.0, 1.0) : 0.5 * y;", True),
        (f"let y = x < 0.5 ? {HUGE} : x; return x > 0.6 ? 0.5 * y : 0.0;", False),
    ],
)
def test_what_is_made_of_an_infinite_number_is_as_large_or_that_it_is_none_is_demanded(
    tmp_path: Path, body: str, demanded_: bool
) -> None:
    """Whatever is not demanded is enclosed: the machine's value lies in the range of the term."""
    terms, value = read(tmp_path, body, kind="float")
    function, fine = soter.load(tmp_path / "one.soter").function("f"), True
    for k in range(-32, 33):
        x = k / 16.0
        form = form_of_box([(exact(x), exact(x)), (exact(0.5), exact(0.5))], symbols=False)
        truths = compile_truths(
            terms, [0, 1], [*terms.obligations, *value.beyond, *value.rests], {}
        )(form)
        if any(t != CERTAIN for t in truths):
            fine = False
            continue
        step: Any = compile_step(terms, [0, 1], 2, [value], ranges=[value])
        _, (low, high) = step(form_of_box([(exact(v), exact(v)) for v in (x, 0.5)], symbols=True))
        assert low <= function(x, 0.5) <= high
    assert fine is not demanded_


@pytest.mark.parametrize("reach", [2.0, 40.0, 1e9])
def test_what_is_not_chosen_may_be_infinite(tmp_path: Path, reach: float) -> None:
    """A division by what may be 0, on the way that is not taken: 0 times infinite is nothing."""
    body = "x > 0.1 ? 2.0 / x : 1.0 / (x * x * e)"
    terms, value = read(tmp_path, body, kind="float", reach=reach)
    form = form_of_box([(exact(0.5), exact(1.0)), (exact(-0.1), exact(0.1))], symbols=False)
    lines = compile_lines(terms, [0, 1], 0, [value], (), {})(form)
    assert lines is not None
    *_, low, high = lines
    assert 1.5 < float(low) <= 2.0
    assert 4.0 <= float(high) < 5.0
    assert all(x.is_finite() for x in lines)
