"""What is printed is the real function: folding, limits, functions of the prelude, times."""

from __future__ import annotations

import operator
import random
import re
from dataclasses import replace
from fractions import Fraction
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from soter.verify.tubes import tube_check
from soter.verify.tubes.expression_graph import Expressions, NoExpressionError
from soter.verify.tubes.generated_functions import (
    Caller,
    fun_text,
    sure_text,
)
from soter.verify.tubes.module_expressions import ModuleExpressions
from soter.verify.tubes.problem import TubeProblem, TubeTimes
from soter.verify.tubes.sc_step import ScStep
from soter.verify.tubes.tube_check import TubeCheck
from soter.verify.tubes.tube_precision import Precision
from unit.verify.tubes.random_plants import drawn_module
from unit.verify.tubes.test_rest_claims import FOLLOW

if TYPE_CHECKING:
    from collections.abc import Callable

WHOLE = """
const LISTED: float[2] = [0.5, 0.25];
fun first(i: int): int { return i; }
fun narrow(i: int): int { var k: int in [0, 1] = 0; k = i; return k; }
"""


def printed(e: object) -> str:
    return fun_text("f", "x: Forms", [e], {("x", 0): "x[0]"}, "Forms")  # type: ignore[list-item]


def law_of(answer: str) -> str:
    """The printed law of an SC that answers so."""
    text = drawn_module(random.Random(1)).text  # noqa: S311 - drawn examples
    before, sc = (text + WHOLE).split("node Sc")
    first = re.sub(r"u0: clamp\(.*?, -2\.0, 2\.0\)(?=[ ,])", f"u0: {answer}", sc, count=1)
    assert first != sc
    flat = system_to_prove(check_file("law.soter", before + "node Sc" + first), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    module = ModuleExpressions(problem)
    return fun_text(
        "law",
        "y: Forms",
        ScStep(module).commands,
        {("y", k): f"y[{k}]" for k in range(3)},
        "Controls",
    )


def test_constants_are_folded_only_where_that_is_exact() -> None:
    make = Expressions()
    x, tenth, fifth = make.input("x", 0), make.constant(0.1), make.constant(0.2)
    assert make.add(make.constant(0.5), make.constant(0.25)) is make.constant(0.75)
    assert make.mul(make.constant(0.5), make.constant(0.25)) is make.constant(0.125)
    assert make.add(tenth, fifth).op == "add"
    assert make.mul(tenth, fifth).op == "mul"
    slope = make.slope_along(make.mul(make.mul(x, tenth), fifth), {x: make.constant(1.0)}, {})
    assert "let t0 = f_number(0.2);\n  let t1 = f_times(t0, 0.1);" in printed(slope)


def test_a_number_that_forms_do_not_compute_with_is_refused() -> None:
    for wild in (1e300, -1e308, float("inf"), float("nan")):
        with pytest.raises(NoExpressionError):
            Expressions().constant(wild)


@pytest.mark.parametrize(
    ("inner", "k", "outer", "v", "is_clamp"),
    [
        ("max", 2.0, "min", 1.0, False),
        ("max", 1.0, "min", 1.0, False),
        ("max", 1.0, "min", 2.0, True),
        ("min", 1.0, "max", 2.0, False),
        ("min", 2.0, "max", 1.0, True),
    ],
)
def test_limits_that_cross_give_the_last_one(
    inner: str, k: float, outer: str, v: float, is_clamp: bool
) -> None:
    make = Expressions()
    e = make.extreme(
        outer, make.extreme(inner, make.input("x", 0), make.constant(k)), make.constant(v)
    )
    assert (e.op == outer) is is_clamp
    assert is_clamp or e is make.constant(v)


def test_what_compares_a_number_with_itself_is_known() -> None:
    make = Expressions()
    x = make.input("x", 0)
    assert [make.compare(op, x, x) for op in ("<", ">", "<=", ">=")] == [
        make.false, make.false, make.true, make.true,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("answer", "form"),
    [
        ("tanh(pose.s0)", "f_tanh(y[0])"),
        ("atan(pose.s0)", "f_atan(y[0])"),
        ("clamp(exp(pose.s0), -2.0, 2.0)", "f_exp(y[0])"),
        ("clamp(wrap_angle(pose.s0), -2.0, 2.0)", "f_wrap_angle(y[0])"),
        ("clamp(hypot(pose.s0, pose.s1), -2.0, 2.0)", "f_sqrt("),
        ("clamp(log(2.0 + pose.s0), -2.0, 2.0)", "f_log("),
        ("clamp(atan2(pose.s0, pose.s1), -2.0, 2.0)", "f_atan2(y[0], y[1])"),
        ("asin(clamp(pose.s0, -1.0, 1.0))", "f_asin("),
        ("clamp(acos(clamp(pose.s0, -1.0, 1.0)), -2.0, 2.0)", "f_acos("),
        ("clamp(pow(2.0, pose.s0), -2.0, 2.0)", "f_exp("),
        ("clamp(pow(pose.s0, 3.0), -2.0, 2.0)", "f_square(y[0])"),
        ("clamp(pow(pose.s0, 2.5), -2.0, 2.0)", "f_log(y[0])"),
        ("clamp(pose.s0, -abs(pose.s1), abs(pose.s1))", "f_limit(y[0], "),
        ("min(max(pose.s0, 1.0), 0.5)", "f_number(0.5)"),
        ("LISTED[first(2) - 1]", "f_number(0.25)"),
    ],
)
def test_functions_have_forms_of_their_own(answer: str, form: str) -> None:
    assert form in law_of(answer)


@pytest.mark.parametrize(
    "answer",
    [
        "clamp(pose.s0, 1.0, 0.5)", "clamp(floor(pose.s0), -2.0, 2.0)",
        "LISTED[first(1) - 2]", "LISTED[first(2)]",
        "LISTED[first(4611686018427387904) + first(4611686018427387904)]",
        "LISTED[narrow(first(9))]",
    ],
)  # fmt: skip
def test_functions_without_a_form_are_refused(answer: str) -> None:
    """They jump, or are of whole numbers that fault."""
    with pytest.raises(NoExpressionError):
        law_of(answer)


def test_reads_go_back_no_further_than_the_holds_whose_rates_are_kept() -> None:
    """Read n may be of n delta - j - d, counted from the first complete output; hold 0 begins there
    and not j before. With d = delta one hold is too few: a_0 = t_0 + j, a_1 = t_0 + delta, and the
    read of output 1 is of t_0, before a_0, where any command acted.
    """
    for period in range(2, 12):
        for jitter in range(period // 2 + 1):
            for delay in range(4 * period):
                times = TubeTimes(0, 0, 0, delay, jitter, period, 9)
                depth = times.depth
                for n in range(depth, 9):  # before that the rates of any command are among them
                    begins = (n - depth) * period - (jitter if n > depth else 0)
                    assert begins <= n * period - jitter - delay
                assert depth == 1 or (depth - 1) * period < 2 * jitter + delay
                # output n reads what is so old; n - p - 1 acts until n - p does; before output 0,
                # complete at 0, any command acts: that time is cut into periods
                for n, p in product(range(1, 9), range(1, 9)):
                    oldest = n * period - jitter - delay
                    ends = (n - p) * period + jitter * (n > p)
                    begins = (n - p - 1) * period - jitter * (n > p + 1)
                    assert ends - max(begins, oldest) <= times.earlier_command_ns(p)
                    assert p < depth or ends <= oldest


def test_times_and_ranges_are_covered_by_their_doubles(monkeypatch: pytest.MonkeyPatch) -> None:
    module = drawn_module(random.Random(1))  # noqa: S311 - drawn examples
    flat = system_to_prove(check_file("times.soter", module.text), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    check = TubeCheck(problem)
    controls = check.problem.controls
    rng = random.Random(5)  # noqa: S311 - drawn examples
    unit = Fraction(2) ** -52
    for _ in range(40):
        period, d = rng.randrange(10**6, 10**9), rng.randrange(10**9)
        jitter, first = rng.randrange(period // 2), rng.randrange(10**9)
        latest = first + rng.randrange(10**8)
        times = TubeTimes(first, latest, latest, d, jitter, period, 20)
        free, steps = rng.randrange(1, 9), rng.randrange(1, 4)
        monkeypatch.setattr(tube_check, "FREE", free)
        one = Precision(6, shares=True, steps=steps)
        monkeypatch.setattr(tube_check, "PRECISIONS", (one,))
        low, high = sorted((rng.uniform(-3, 3), rng.uniform(-3, 3)))
        check.problem.controls = tuple(replace(c, low=low, high=high) for c in controls)
        check.times = times
        made = check.text_in_flight({})

        def of(name: str, text: str = made) -> Fraction:
            return Fraction(
                float(text.split(f"const {name}: float = ")[1].split(";", maxsplit=1)[0])
            )

        exact = {
            "FREE_STEP": Fraction(first, free),
            "WINDOW": Fraction(times.latest - first),
            "JITTER": Fraction(jitter),
            "FIRST_STEP": Fraction(period - jitter, steps),
            "LATER_STEP": Fraction(period - 2 * jitter, steps),
        }
        for name, ns in exact.items():
            assert abs(of(name) - ns / 10**9) <= unit * ns / 10**9
        assert of("LATE_READ") >= Fraction(d, 10**9)
        middle = Fraction(float(made.split("ANY_COMMAND: Controls = [{ c: ")[1].split(",", 1)[0]))
        most = made.split("const ANY: Wide = [")[1].split("]")[0].split(",")
        half = Fraction(float(most[1]))
        assert middle - half <= Fraction(low)
        assert middle + half >= Fraction(high)


def test_more_symbols_than_sums_allow_for_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    module = drawn_module(random.Random(1))  # noqa: S311 - drawn examples
    flat = system_to_prove(check_file("many.soter", module.text), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    check = TubeCheck(problem)
    many = Precision(6, shares=True, steps=2000)
    monkeypatch.setattr(tube_check, "PRECISIONS", (many,))
    with pytest.raises(SoterError, match="symbols"):
        check.text_in_flight({})


MEANT: dict[str, Callable[[bool, bool], bool]] = {
    "and": operator.and_,
    "or": operator.or_,
    "same": operator.eq,
}
RANGE = """type Range = { lo: float, hi: float };
type Point = { at: Range[6] };
fun f_neg(a: Range): Range { return { lo: -a.hi, hi: -a.lo }; }
"""


def test_conditions_that_are_met_again_are_written_once_and_mean_the_same() -> None:
    """Each is made of the one before twice, which doubles a text at each of the signs."""
    rng = random.Random(5)  # noqa: S311 - drawn conditions
    for _ in range(20):
        make = Expressions()
        above = [make.compare(">", make.input("x", k), make.constant(0.0)) for k in range(6)]
        said = above[0]
        ops: list[str] = []
        for k in range(1, 6):
            ops.append(op := rng.choice(["and", "or", "same"]))
            other = above[k]
            if op == "same":
                both = make.join("and", said, other)
                said = make.join(
                    "or", both, make.join("and", make.negation(said), make.negation(other))
                )
            else:
                said = make.join(op, said, other)
        inputs = {("x", k): f"x.at[{k}]" for k in range(6)}
        text = "\n".join(
            sure_text(name, "x: Point", said, inputs, truth=whether)
            for name, whether in (("holds", True), ("fails", False))
        )
        caller = Caller(RANGE + text)
        for signs in product((-1.0, 1.0), repeat=6):
            point = (tuple((s, s) for s in signs),)
            truth = signs[0] > 0.0
            for op, sign in zip(ops, signs[1:], strict=True):
                truth = MEANT[op](truth, sign > 0.0)
            assert caller.returns_true("holds", point) is truth
            assert caller.returns_true("fails", point) is not truth


def test_many_obstacles_in_a_loop_are_a_text_of_their_number() -> None:
    """`free = free && ...` is a condition once more in what follows, and what is not."""
    lengths = []
    for count in (4, 8, 16):
        make = Expressions()
        free = make.true
        for k in range(count):
            clear = make.compare(">", make.input("x", k), make.constant(0.0))
            free = make.join(
                "or", make.join("and", free, clear), make.join("and", make.negation(free), clear)
            )
        text = sure_text("f", "x: Point", free, {("x", k): f"x[{k}]" for k in range(count)})
        lengths.append(len(text))
    assert lengths[2] - lengths[1] < 3 * (lengths[1] - lengths[0])


def test_a_loop_over_boxes_asks_of_each_once() -> None:
    """`free && clear` is no choice between `clear` and `free`."""
    flat = system_to_prove(check_file(str(Path(__file__).with_name("turning_car.soter"))), None)
    problem = extract(flat, flat.modules[0])
    assert isinstance(problem, TubeProblem)
    safe = TubeCheck(problem).text_in_flight({}).split("fun safe(", 1)[1].split("\n}\n", 1)[0]
    assert safe.count(".lo > 0.0") == 20


@pytest.mark.parametrize("op", ["||", "&&"])
def test_a_condition_in_a_function_is_asked_as_one_that_is_written_out(op: str) -> None:
    """Core calls the function only where the left side does not decide."""
    fun = "\nfun slow(v: float): bool { return v < 3.0; }\nplant "

    def safe(right: str) -> str:
        text = FOLLOW.read_text(encoding="utf-8").replace("\nplant ", fun)
        asked = text.replace("safe sight.gap > 0.0", f"safe (sight.gap > 0.0 {op} {right})")
        assert asked != text
        flat = system_to_prove(check_file("follow.soter", asked), None)
        problem = extract(flat, flat.modules[0])
        assert isinstance(problem, TubeProblem)
        return TubeCheck(problem).text_in_flight({}).split("fun safe(", 1)[1].split("\n}\n", 1)[0]

    assert safe("slow(sight.v)") == safe("sight.v < 3.0")
