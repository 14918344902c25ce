"""What inductions read of code: as programs mean it, wrong constants and arrays told apart."""

from __future__ import annotations

import random
import shutil
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from generators.random_functions import FunctionMaker
from long_tests import some
from soter.api import recheck
from soter.certificate.reading.symbolic_reading import (
    CallFrame,
    CodeReader,
    Surroundings,
    SymbolicReader,
)
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.terms import Terms
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file
from tables import all_rows
from unit.certificate import small_proofs
from unit.certificate.test_recheck_induction import PLANNER, certificate

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from soter.language.model import typed

z3 = pytest.importorskip("z3")

from soter.certificate.induction.solver_steps import (  # noqa: E402 - needs the solver
    SolverReading,
    VisibleValues,
)
from soter.certificate.induction.solver_values import leaf_terms as terms_of  # noqa: E402
from soter.certificate.induction.solver_values import unknown_value  # noqa: E402

# ---------------------------------------------------------------- constants

CONSTANTS = """const EARLY: bool = false;
const LIMITS: float[2] = [0.01, 0.03];
type Of = { most: float };
const OF: Of = { most: 0.03 };
fun most(k: int): float { var sum = 0.0; for i in 0..3 { sum = sum + 0.01; } return sum; }
type Plan"""


def with_age(age: str) -> str:
    """The planner whose follower waits for so many seconds."""
    text = PLANNER.replace("type Plan", CONSTANTS, 1)
    old = "if age(candidate) > seconds(30ms)"
    assert old in text
    return text.replace(old, f"let limit = 3.0 * 0.01; if age(candidate) > {age}")


@pytest.mark.parametrize("age", ["0.1 - 0.07", "limit", "LIMITS[1]"])
def test_ages_are_compared_with_what_constants_are(tmp_path: Path, age: str) -> None:
    report = recheck(certificate(tmp_path, with_age(age)))
    assert report.accepted, report.reason


@all_rows(
    "said",
    [
        "0.1 - 0.07",
        "-(0.1 * 3.0)",
        "float(3) / 100.0",
        "2.0 * seconds(15ms) - seconds(3 * 5ms)",
        "(EARLY ? 0.01 : seconds(20ms + 10ms))",
        "max(0.01, min(0.03, 0.5))",
        "LIMITS[EARLY ? 0 : 1]",
        "OF.most + float(int(2.75))",
        "most(3) + sqrt(0.0009)",
        "exp(-3.5) * abs(floor(-0.5))",
        "limit / 7.0",
        "sum",
        "(EARLY || limit > 0.0) ? 1.0 : 2.0",
    ],
)
def test_constants_are_what_the_language_makes_of_them(tmp_path: Path, said: str) -> None:
    """To the bit, also of variables that hold constants, and behind conditions that are known."""
    path = tmp_path / "constants.soter"
    program = CONSTANTS.removesuffix("type Plan")
    path.write_text(f"""soter 1;
{program}
fun result(): float {{
  let limit = 3.0 * 0.01;
  var sum = 0.25;
  for i in 0..3 {{ if i != 1 {{ sum = sum + LIMITS[0] * float(i); }} }}
  if EARLY {{ return 0.0; }}
  return {said};
}}
""")
    checked = check_file(str(path))
    assert checked.program is not None
    assert checked.ok, checked.diagnostics
    fun = checked.program.funs["result"]
    result = SolverReading(sight_of_nothing()).result_of_call(fun, ())
    assert repr(result) == repr(Evaluator({}).closure_of(fun)(Environment(), ()))


def test_what_faults_for_sure_is_a_fault_and_no_constant(tmp_path: Path) -> None:
    path = tmp_path / "faults.soter"
    path.write_text("soter 1;\nfun faults(k: int): int { return k + 1 / (2 - 2); }\n")
    checked = check_file(str(path))
    assert checked.program is not None
    fun = checked.program.funs["faults"]
    (k,) = fun.parameters
    for given in (z3.Int("k"), 1):
        reading = SolverReading(sight_of_nothing())
        body, frame = fun.body or (), CallFrame({k: given})
        fine, _ = reading.run_under(True, partial(reading.run_block, body, frame))
        assert not fine
        assert reading.operations.fault is True


def test_of_a_function_of_constants_that_faults_nothing_is_told(tmp_path: Path) -> None:
    """It calculates with floats, so that it is not read: it may fault, and may give anything."""
    path = tmp_path / "faults.soter"
    text = "fun share(x: float): float { return 1.0 / x; }"
    path.write_text(f"soter 1;\n{text}\n")
    checked = check_file(str(path))
    assert checked.program is not None
    fun = checked.program.funs["share"]
    for given, known in ((4.0, True), (0.0, False)):
        reading = SolverReading(sight_of_nothing())
        value = reading.result_of_call(fun, (given,))
        assert (reading.operations.fault, reading.operations.doubt is False) == (False, known)
        assert value == 0.25 if known else z3.is_expr(value)


CALLS = {
    "itself": 'extern fun asked(x: float): float from "c:drawn.c:drawn";',
    "below": "fun asked(x: float): float { return 0.5 * drawn(x); }",
    "far below": "fun asked(x: float): float { return 0.5 * half(x); }\n"
    "fun half(x: float): float { for i in 0..2 { if x > 1.0 { return drawn(x); } } return x; }",
    "in a record": "type Two = { a: float, b: float };\n"
    "fun asked(x: float): Two { return { a: x, b: drawn(x) }; }",
    "of what is exact": "fun asked(k: int): bool { return drawn(2.0) > 0.0 || k > 0; }",
}


@pytest.mark.parametrize("where", CALLS)
def test_what_ends_in_an_extern_function_is_no_function(where: str, tmp_path: Path) -> None:
    """It may give another value each time: nothing is the same for the same arguments."""
    path = tmp_path / "extern.soter"
    drawn = 'extern fun drawn(x: float): float from "c:drawn.c:drawn";'
    path.write_text(f"soter 1;\n{drawn}\n{CALLS[where]}\n")
    checked = check_file(str(path))
    assert checked.program is not None
    assert checked.ok, checked.diagnostics
    fun, sight = checked.program.funs["asked"], sight_of_nothing()
    (given,) = (unknown_value(p.type, p.name, sight.facts) for p in fun.parameters)
    with pytest.raises(NotRecheckedError, match="extern"):
        SolverReading(sight).result_of_call(fun, (given,))


@pytest.mark.parametrize("age", ["0.1 - 0.09", "0.01 / 2.0", "most(3) - 0.02", "LIMITS[1] - 0.02"])
def test_a_certificate_of_a_longer_age_is_rejected(tmp_path: Path, age: str) -> None:
    """The same shape, and a plan may be in force before the module has answered."""
    folder = certificate(tmp_path, with_age("0.1 - 0.07"))
    small_proofs.edit_program(folder, ("age(candidate) > 0.1 - 0.07", f"age(candidate) > {age}"))
    report = recheck(folder)
    assert not report.accepted
    assert "something fails in an execution" in report.reason


# ---------------------------------------------------------------- arrays

ARRAYS = """soter 1;
type Plan = enum { Hover, Around, Through };
type Route = { plans: Plan[3], count: int in [0, 3] };
topic candidate: Plan;
topic kept: Plan[2] = [Plan.Hover, Plan.Hover];
topic route: Route = { plans: [Plan.Hover, Plan.Hover, Plan.Hover], count: 0 };
topic flown: Plan;
fun good(p: Plan): bool { return p != Plan.Through; }
fun all_good(plans: Plan[3]): bool {
  var yes = true;
  for p in plans { if !good(p) { yes = false; } }
  return yes && good(plans[2]);
}
node Any period 10ms { publishes candidate; step { publish candidate = choose Plan; } }
node Hold period 10ms { publishes candidate; step { publish candidate = Plan.Hover; } }
node Keeper period 10ms phase 2ms {
  subscribes candidate;
  publishes kept, route;
  var own: Plan[2] = [Plan.Hover, Plan.Hover];
  var way: Route = { plans: [Plan.Hover, Plan.Hover, Plan.Hover], count: 0 };
  var last: int in [0, 2] = 0;
  step {
    if age(candidate) > seconds(30ms) || good(candidate) {
      own[choose [0, 1]] = candidate;
      way.plans[last] = candidate;
      last = (last + 1) % 3;
      way.count = min(way.count + 1, 3);
    }
    publish kept = own;
    publish route = way;
  }
}
node Robot period 10ms phase 4ms {
  subscribes kept, route;
  publishes flown;
  step {
    var plan = kept[0];
    for k in 0..2 { if choose bool { plan = kept[k]; } }
    if choose bool { plan = route.plans[choose [0, 2]]; }
    publish flown = plan;
  }
}
rta M {
  ac Any; sc Hold; period 20ms;
  safe good(flown); ttf !good(candidate); safer good(candidate);
  verify {
    induction;
    lemma good(kept[0]) && good(kept[1]) && all_good(route.plans);
    lemma good(candidate) || age(candidate) <= seconds(30ms);
  }
}
system S default { node Keeper; node Robot; module M; until 1s; }
"""


@pytest.fixture(scope="module")
def of_arrays(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The certificate of the module with arrays; not to be changed."""
    return certificate(tmp_path_factory.mktemp("arrays"), ARRAYS)


def test_arrays_in_inductions_are_accepted(of_arrays: Path) -> None:
    report = recheck(of_arrays)
    assert report.accepted, report.reason
    assert report.safe


FORGERIES = {
    "an element that nobody guards": ("own[choose [0, 1]] = candidate;", "own[1] = Plan.Through;"),
    "an element written before the test": (
        "    if age(candidate) > seconds(30ms) || good(candidate) {",
        "    way.plans[last] = candidate;\n    if good(candidate) {",
    ),
    "an index that there is not": ("(last + 1) % 3", "min(last + 1, 2)"),
    "a default": ("kept: Plan[2] = [Plan.Hover, Plan.Hover]", "kept: Plan[2] = [X, Plan.Hover]"),
    "the other element": ("plan = kept[k];", "plan = k == 1 ? Plan.Through : kept[k];"),
    "a longer array": ("route.plans[choose [0, 2]]", "route.plans[choose [0, 3]]"),
}


@pytest.mark.parametrize("which", FORGERIES)
def test_a_certificate_for_other_arrays_is_rejected(
    of_arrays: Path, tmp_path: Path, which: str
) -> None:
    """Programs of the same shape in which a plan gets through, or a step faults."""
    old, new = FORGERIES[which]
    folder = tmp_path / "cert"
    shutil.copytree(of_arrays, folder)
    small_proofs.edit_program(folder, (old, new.replace("X", "Plan.Through")))
    if which == "an index that there is not":
        small_proofs.edit_program(folder, ("way.plans[last]", "way.plans[last + 1]"))
    report = recheck(folder)
    assert not report.accepted
    assert "something fails in an execution" in report.reason


def test_arrays_of_which_nothing_is_told_are_not_rechecked(of_arrays: Path, tmp_path: Path) -> None:
    folder = tmp_path / "cert"
    shutil.copytree(of_arrays, folder)
    more = ("var last:", "var many: bool[65];\n  var last:")
    small_proofs.edit_program(folder, more, ("way.count = ", "many[last] = true;\n way.count = "))
    report = recheck(folder)
    assert not report.accepted
    assert "an assignment at an index of what is not told apart" in report.reason


# ---------------------------------------------------------------- against the evaluator

FUNCTIONS = """soter 1;
type Cell = { n: int, ok: bool };
type Row = { cells: Cell[2], size: int };
fun put(a: int, b: int): int { var v = [1, 2, 3]; v[a] = b; return v[0] + 10 * v[1] + 100 * v[2]; }
fun twice(a: int, b: int): int {
  var v = [4, 5];
  v[a] = v[b];
  v[b] = v[a] + 1;
  return 7 * v[0] - v[1];
}
fun nested(a: int, b: int): int {
  var m = [[1, 2, 3], [4, 5, 6]];
  m[a][b] = m[b][a] + 40;
  let row = m[a];
  return row[b] + 1000 * m[1][2] + row.len;
}
fun records(a: int, b: int): int {
  var r: Row = { cells: [{ n: 1, ok: true }, { n: 2, ok: false }], size: 2 };
  r.cells[a].n = b;
  r.cells[b] = { n: 9, ok: r.cells[a].ok };
  return r.cells[0].n + 100 * r.cells[1].n + (r.cells[0].ok ? 10000 : 0) + r.size;
}
fun each(a: int, b: int): int {
  var sum = 0;
  var v = [a, b, 3];
  for x in v { v[0] = 50; sum = 2 * sum + x; if sum > 9 { return sum; } }
  return -sum - v[0];
}
fun loops(a: int, b: int): int {
  var v: int[4];
  for i in 0..4 { if i >= a { v[i] = i * b; } }
  return v[b] + v[3] * 10;
}
fun order(a: int, b: int): int { var v = [9, -8]; v[a] = v[1 - b] / 2 - 3; return v[b] % 5; }
fun early(a: int, b: int): int {
  var v = [a, b];
  if a < b { return v[a]; }
  v[1] = 77;
  return v[b];
}
fun passed(a: int, b: int): int { let v = swapped([a, b], a); return v[0] * 100 + v[1]; }
fun swapped(v: int[2], k: int): int[2] { return [v[k], v[1 - k]]; }
"""
NAMES = ("put", "twice", "nested", "records", "each", "loops", "order", "early", "passed")


@pytest.mark.parametrize("name", NAMES)
def test_arrays_are_read_as_they_are_evaluated(tmp_path: Path, name: str) -> None:
    """Values and faults of what is read over any a and b, at some, against the evaluator."""
    path = tmp_path / "functions.soter"
    path.write_text(FUNCTIONS)
    checked = check_file(str(path))
    assert checked.program is not None
    assert checked.ok, checked.diagnostics
    fun = checked.program.funs[name]
    a, b = z3.Ints("a b")
    reading = SolverReading(sight_of_nothing())
    result = reading.result_of_call(fun, (a, b))
    (whole,), (wrong,) = terms_of(result), terms_of(reading.operations.fault)
    assert reading.operations.doubt is False
    evaluate = Evaluator({}).closure_of(fun)
    faults = 0
    for k in range(-1, 5):
        for n in range(-1, 5):
            at = [(a, z3.IntVal(k)), (b, z3.IntVal(n))]
            fault = z3.simplify(z3.substitute(wrong, *at))
            try:
                value = evaluate(Environment(), (k, n))
            except StepFault:
                assert z3.is_true(fault), (k, n)
                faults += 1
                continue
            assert z3.is_false(fault), (k, n)
            assert z3.simplify(z3.substitute(whole, *at)).as_long() == value, (k, n)
    assert 0 < faults < 36 or name == "each"


def sight_of_nothing() -> VisibleValues:
    """What a function sees: its parameters alone."""
    scope: Any = SimpleNamespace(params={}, topics={}, modules={})

    def none(_: int) -> Any:
        raise AssertionError

    return VisibleValues(scope, none, none, mode=0, module=0, in_control=True, facts=[])


# ---------------------------------------------------------------- functions that are drawn

FAULT = "it faults"
POINTS = [(a, b, c) for a in (-3, 0, 1, 2, 6) for b in (-1, 2) for c in (False, True)]
DRAWN = 6
"""Of one program."""


def functions(folder: Path, seed: int) -> list[typed.FunSymbol]:
    """Functions that are drawn; a program with an index that is outside for sure has none."""
    maker = FunctionMaker(random.Random(seed))  # noqa: S311 - no secret
    found: list[typed.FunSymbol] = []
    for _ in range(DRAWN):
        path = folder / "functions.soter"
        path.write_text(f"soter 1;\n{maker.function()}\n")
        checked = check_file(str(path))
        if checked.ok and checked.program is not None:
            found += checked.program.funs.values()
    assert found
    return found


def tried(run: Callable[[], Any]) -> Any:
    """What it gives, or that it faults."""
    try:
        return run()
    except StepFault:
        return FAULT


@pytest.mark.parametrize("seed", some(range(40), 4))
def test_what_is_known_is_what_the_evaluator_gives(seed: int, tmp_path: Path) -> None:
    for fun in functions(tmp_path, seed):
        evaluate = Evaluator({}).closure_of(fun)
        for at in POINTS:
            value = tried(lambda e=evaluate, x=at: e(Environment(), x))  # type: ignore[misc]
            terms, solver = Terms(), SolverReading(sight_of_nothing())
            readers: list[CodeReader] = [SymbolicReader(terms, Surroundings({}, {})), solver]
            for reader in readers:
                assert tried(lambda r=reader, f=fun, x=at: r.result_of_call(f, x)) == value, at  # type: ignore[misc]
            assert (terms.obligations, solver.operations.fault, solver.operations.doubt) == (
                [],
                False,
                False,
            )


@pytest.mark.parametrize("seed", some(range(40), 4))
def test_what_is_read_of_any_values_is_so_at_each(seed: int, tmp_path: Path) -> None:
    for fun in functions(tmp_path, seed):
        reader = SolverReading(sight_of_nothing())
        given = tuple(unknown_value(p.type, p.name, reader.sight.facts) for p in fun.parameters)
        _, value = reader.run_under(True, lambda r=reader, f=fun, x=given: r.result_of_call(f, x))  # type: ignore[misc]
        assert reader.operations.doubt is False
        evaluate = Evaluator({}).closure_of(fun)
        for at in POINTS:
            pairs = list(zip(terms_of(given), terms_of(at), strict=True))
            (fault,) = (z3.substitute(x, *pairs) for x in terms_of(reader.operations.fault))
            true = tried(lambda e=evaluate, x=at: e(Environment(), x))  # type: ignore[misc]
            assert z3.is_true(z3.simplify(fault)) is (true == FAULT), at
            if true != FAULT:
                (result,) = (z3.substitute(x, *pairs) for x in terms_of(value))
                assert z3.simplify(result).as_long() == true, at
