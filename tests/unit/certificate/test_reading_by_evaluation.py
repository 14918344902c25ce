"""What is read of code, evaluated at points, beside what the interpreter computes there.

The terms are evaluated by a plain second definition: sums of factors times atoms, each atom what
its kind says in Python's numbers. A step that faults, or computes what is no number, breaks an
obligation of its terms at that point, and no other step does.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

from soter.certificate.reading import symbolic_reading
from soter.certificate.reading.symbolic_operations import Operations, in_range
from soter.certificate.reading.symbolic_reading import CallFrame, Surroundings, SymbolicReader
from soter.certificate.reading.symbolic_values import Rows, SymbolicInt
from soter.certificate.terms.arb_balls import ONE, exact
from soter.certificate.terms.terms import (
    FALSE,
    TRUE,
    Linear,
    NotRecheckedError,
    Proposition,
    Terms,
    negation,
)
from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.statements import Environment, Evaluator
from soter.language.front_end import check_file
from soter.language.model.types import FLOAT
from soter.language.prelude.function_error_bounds import BOUNDS, ErrorBound

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

Point = Sequence[float] | Mapping[int, float]
FUNCTIONS: dict[str, Callable[[float], float]] = {
    "max0": lambda x: max(x, 0.0),
    "square": lambda x: x * x,
    "inverse": lambda x: 1 / x,
    "soft_sign": lambda x: x / (1 + abs(x)),
    "abs": abs,
    "floor": math.floor,
    "sqrt": lambda x: math.sqrt(max(x, 0.0)),
}


def at(terms: Terms, x: Linear | float, point: Point) -> float:
    """The value of a form at a point of the first inputs, its radius left out."""
    if not isinstance(x, Linear):
        return float(x)
    total = float(x.const.mid())
    for k, factor in x.terms.items():
        total += float(factor.mid()) * atom_at(terms, k, point)
    return total


def atom_at(terms: Terms, k: int, point: Point) -> float:
    atom = terms.atoms[k]
    if atom.kind in ("state", "box"):
        return point[k]
    of = atom.arguments
    if atom.kind == "spread":
        return 0.0
    if atom.kind == "choice":
        assert atom.condition is not None
        return at(terms, of[0 if holds(terms, atom.condition, point) else 1], point)
    if atom.kind == "product":
        return at(terms, of[0], point) * at(terms, of[1], point)
    if atom.kind in ("min", "max"):
        ends = at(terms, of[0], point), at(terms, of[2], point)
        return min(ends) if atom.kind == "min" else max(ends)
    if atom.kind == "table":
        place = 0
        for x, size in zip(of, atom.shape, strict=True):
            index = round(at(terms, x, point))
            place = place * size + min(max(index, 0), size - 1)
        return atom.values[place]
    function = FUNCTIONS.get(atom.kind) or getattr(math, atom.kind)
    try:
        return float(function(at(terms, of[0], point)))
    except (ValueError, ZeroDivisionError):
        return math.nan


def holds(terms: Terms, of: Any, point: Point) -> bool:
    if of.kind == "constant":
        return bool(of.value)
    if of.kind == "below":
        assert of.argument is not None
        x = at(terms, of.argument, point)
        return x < 0 if of.strict else x <= 0
    if of.kind == "not":
        return not holds(terms, of.parts[0], point)
    parts = (holds(terms, p, point) for p in of.parts)
    return all(parts) if of.kind == "and" else any(parts)


CODE = """soter 1;
type P = { a: float, b: float };
const TABLE: float[3] = [1.0, -2.0, 0.5];
const WHOLE: int[3] = [4, -1, 7];
const GRID: float[2][3] = [[1.0, 2.0], [-1.0, 0.0], [6.0, 5.0]];
const PARTS: P[2] = [{ a: 1.0, b: 2.0 }, { b: 4.0, a: 3.0 }];
fun one(x: float): float { if x > 1.0 { return 2.0; } return 1.0; }
fun two(v: float[2]): float { return v[0] - 2.0 * v[1]; }
fun swap(p: P): P { return { b: p.a, a: p.b }; }
"""
BODIES = {
    "arms": """var z = 1.0;
  if x > 2.0 { z = y; } elseif x > 0.0 { z = 2.0 * y; } elseif y > 0.0 { z = 3.0; }
  else { let w = x * y; z = w; }
  return z + x;""",
    "returns": """if x > 1.0 { if y > 1.0 { return 1.0; } } elseif y < -1.0 { return x; }
  var z = y;
  if x > 0.0 { z = z + 1.0; }
  return z;""",
    "for_each": """var z = 0.0;
  for v in [x, 2.0, y] { if v > 0.0 { z = z + v; } }
  for i in 1..3 { z = z - float(i) * x; }
  return z;""",
    "asserted": """assert x < 2.0;
  if y > 0.0 { assert x > -1.0; } else { assert y > -4.0; }
  return x;""",
    "fault_of_a_branch": """var z = y;
  let i = 3;
  if x > 1.0 { z = TABLE[i]; } else { z = 2.0; }
  return z;""",
    "fault_of_the_other": """var z = y;
  let i = -1;
  if x > 1.0 { z = 2.0; } else { z = TABLE[i]; }
  return z + 1.0;""",
    "fault_and_return": """let i = 3;
  if x > 1.0 { return TABLE[i]; }
  return y;""",
    "fault_of_a_choice": """let i = 3;
  let first = x > 0.0 ? TABLE[i] : y;
  return first + (y > 1.0 ? x : 1.0);""",
    "fault_of_the_other_choice": """let i = 3;
  return x > 0.0 ? y : TABLE[i];""",
    "fault_behind_and": """let i = 3;
  let c = x > 0.0 && TABLE[i] > 0.0;
  return c ? 1.0 : y;""",
    "fault_behind_or": """let i = 3;
  let c = x > 0.0 || TABLE[i] > 0.0;
  return c ? x : y;""",
    "truths": """let a = x > 0.0;
  let b = y > 1.0;
  let known = 2.0 > 1.0;
  let c = (a && !b) || (b && !a && known) || (x > 3.0 && y > 2.0);
  return (c ? 1.0 : 0.0) + (a == b ? 2.0 : 0.0) + (a != known ? 4.0 : 0.0)
    + (a == known ? 8.0 : 0.0) + (known != b ? 16.0 : 0.0) + (known || a ? 32.0 : x)
    + (known && b ? 64.0 : 0.0) + (!known || a ? 128.0 : 0.0);""",
    "compared": """return (x < y ? 1.0 : 0.0) + (x <= y ? 2.0 : 0.0) + (x > y ? 4.0 : 0.0)
    + (x >= y ? 8.0 : 0.0) + (x == y ? 16.0 : 0.0) + (x != y ? 32.0 : 0.0)
    + (1.0 < 2.0 ? 64.0 : 0.0) + (2 <= 1 ? 128.0 : 0.0) + (2 >= 2 ? 256.0 : 0.0);""",
    "arithmetic": "return (x + 2.0) * (y - 3.0) / (x - 7.0) - -x / 4.0 + 2.0 / (y * y + 1.0);",
    "divided": "return x / (y - 1.0);",
    "roots": "return sqrt(x) + sqrt(x * x + y * y) + sqrt(4.0) + norm([x, y]);",
    "extremes": """return min(x, y) + 2.0 * max(x, y) + min(1.0, x) + max(y, 0.5) + min(2.0, 3.0)
    + max(2.0, 3.0) + float(min(int(floor(x)), 2)) + float(max(1, 2));""",
    "parts_of_numbers": """return abs(x) + floor(y) + float(int(x)) + float(int(-y)) + abs(-2.0)
    + floor(-2.5) + float(int(-2.5)) + float(abs(-3)) + seconds(20ms);""",
    "truncated": "return float(int(x * x)) + float(int(floor(y))) - float(int(abs(y) - 9.0));",
    "not_negative": "return sqrt(abs(x) + y * y) + float(int(abs(x)));",
    "whole": """let i = int(floor(x));
  let j = 3 * i + 2 - i;
  let k = -j;
  return float(k + (y > 0.0 ? i : 2)) + (j == 2 ? 0.5 : 0.25) + (i < 1 ? 0.125 : 0.0);""",
    "tables": """let i = int(floor(x));
  return TABLE[i] + float(WHOLE[i]) + TABLE[1];""",
    "tables_of_tables": """let i = int(floor(x));
  let j = int(floor(y));
  return GRID[i][j] + 2.0 * GRID[1][j] + 4.0 * GRID[i][1];""",
    "rows": """let i = int(floor(x));
  let row = GRID[i];
  return row[0] - row[1] + PARTS[min(1, max(0, i))].b + two(GRID[i]);""",
    "vectors": """let v = 2.0 * [x, y] - [y, 1.0] / 2.0 + [1.0, x] * 3.0;
  let w = -v;
  return w[0] + 2.0 * dot(v, [y, 2.0]) - saturate(w, 1.5)[1] + saturate(x, 2.0);""",
    "records": """var p: P = { b: x, a: y };
  p.a = p.a + 1.0;
  let q = swap(p);
  var many: P[2] = [p, q];
  many[1].b = 5.0;
  many[0] = q;
  return p.a - 2.0 * q.a + 3.0 * many[0].b + 7.0 * many[1].b + 11.0 * many[1].a;""",
    "lengths": """let v = [x, y, x];
  return float(v.len) + TABLE[v.len - 1] + float(GRID.len);""",
    "calls": "return one(x) + one(y - 1.0) * one(0.0) + two([x, y]);",
    "joined_wholes": """let i = x > 0.0 ? 2 : 3;
  let j = y > 0.0 ? 1 : 1;
  let t = x > 1.0 ? [x, 1.0] : [y, 1.0];
  return TABLE[min(i, 2)] + TABLE[j] + t[0] + t[1];""",
}
POINTS = [-5.5, -2.25, -1.25, -0.5, 0.25, 0.75, 1.5, 2.75, 5.25]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Any:
    lines = [f"fun f_{n}(x: float, y: float): float {{\n  {b}\n}}" for n, b in BODIES.items()]
    path = tmp_path_factory.mktemp("read") / "read.soter"
    path.write_text(CODE + "\n".join(lines) + "\n")
    checked = check_file(str(path))
    assert checked.program is not None
    assert checked.ok, checked.diagnostics
    return checked.program


def inputs_of(terms: Terms, *ends: tuple[float, float]) -> list[Linear]:
    return [terms.input("state", f"x{k}", exact(a), exact(b)) for k, (a, b) in enumerate(ends)]


@pytest.mark.parametrize("rounded", [True, False])
@pytest.mark.parametrize("name", BODIES)
def test_code_is_what_it_computes(program: Any, name: str, rounded: bool) -> None:
    fun, terms = program.funs[f"f_{name}"], Terms()
    inputs = inputs_of(terms, (-6.0, 6.0), (-6.0, 6.0))
    reader = SymbolicReader(terms, Surroundings({}, {}), rounded=rounded)
    value = reader.called(fun, inputs)
    evaluate = Evaluator({}).function(fun)
    fine = 0
    for point in itertools.product(POINTS, repeat=2):
        try:
            wanted = evaluate(Environment(), point)
        except StepFault:
            wanted = math.nan
        well = all(holds(terms, o, point) for o in terms.obligations)
        assert well is math.isfinite(wanted)
        if well:
            fine += 1
            found = at(terms, value, point)
            assert abs(found - wanted) < 1e-9
            if isinstance(value, Linear):
                assert float(value.low) - 1e-9 <= found <= float(value.high) + 1e-9
                assert value.radius.is_zero() or rounded
    assert fine
    assert terms.path is TRUE


# ---------------------------------------------------------------- single operations

NUMBERS = (-2.5, -1.0, 0.0, 0.5, 3.0)


def point_value(x: Any) -> float:
    """Of what was made of inputs that are points."""
    if isinstance(x, Linear):
        low, high = float(x.low), float(x.high)
        assert high - low < 1e-9
        return (low + high) / 2
    return float(x)


@pytest.mark.parametrize("rounded", [True, False])
def test_operators_of_numbers_and_terms(rounded: bool) -> None:
    for (a, b), kinds in itertools.product(
        itertools.product(NUMBERS, repeat=2), itertools.product((True, False), repeat=2)
    ):
        terms = Terms()
        make = Operations(terms, rounded=rounded)
        x, y = (
            inputs_of(terms, (v, v))[0] if term else v
            for v, term in zip((a, b), kinds, strict=True)
        )
        wanted = {"+": a + b, "-": a - b, "*": a * b} | ({"/": a / b} if b else {})
        for op, of in wanted.items():
            found = make.arithmetic(op, x, y)
            assert abs(point_value(found) - of) < 1e-9
            assert isinstance(found, Linear) is (any(kinds) or not rounded)
            assert not isinstance(found, SymbolicInt)
        for name, of in (("min", min(a, b)), ("max", max(a, b))):
            assert abs(point_value(make.extreme(name, x, y)) - of) < 1e-9
        for op, holds_so in (("<", a < b), ("<=", a <= b), (">", a > b), (">=", a >= b)):
            assert make.compared(op, x, y) is holds_so
        if a != b or not any(kinds):
            assert make.compared("==", x, y) is (a == b)
            assert make.compared("!=", x, y) is (a != b)


def test_operators_of_ints() -> None:
    for a, b, kinds in itertools.product(
        (-7, -1, 0, 3), (-2, 1, 4), ((True, False), (False, True))
    ):
        terms = Terms()
        make = Operations(terms, rounded=True)
        x, y = (
            make.whole(inputs_of(terms, (v, v))[0]) if term else v
            for v, term in zip((a, b), kinds, strict=True)
        )
        for op, of in (("+", a + b), ("-", a - b), ("*", a * b)):
            found = make.arithmetic(op, x, y)
            assert isinstance(found, SymbolicInt)
            assert found.radius.is_zero()
            assert point_value(found) == of
            assert make.arithmetic(op, a, b) == of
        for name, of in (("min", min(a, b)), ("max", max(a, b))):
            found = make.extreme(name, x, y)
            assert isinstance(found, SymbolicInt)
            assert point_value(found) == of
            assert make.extreme(name, a, b) == of
        for op in "/%":
            with pytest.raises(NotRecheckedError, match="ints that depend"):
                make.arithmetic(op, x, y)
        assert make.arithmetic("/", a, b) == math.trunc(a / b)
        assert make.arithmetic("%", a, b) == a - b * math.trunc(a / b)
        assert isinstance(make.negated(make.whole(inputs_of(terms, (1.0, 2.0))[0])), SymbolicInt)


def test_an_int_of_inputs_is_exact_up_to_two_to_53() -> None:
    for low, high in ((-1.0, 2.0**53), (-(2.0**53), 1.0), (2.0**53, 2.0**53)):
        terms = Terms()
        (x,) = inputs_of(terms, (low, high))
        with pytest.raises(NotRecheckedError, match="2\\^53"):
            Operations(terms, rounded=True).whole(x)
    terms = Terms()
    (x,) = inputs_of(terms, (1 - 2.0**53, 2.0**53 - 1))
    assert isinstance(Operations(terms, rounded=True).whole(x), SymbolicInt)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_no_term(wrong: float) -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (0.0, 1.0))
    for a, b in ((x, wrong), (wrong, x)):
        for of in (make.arithmetic, make.compared, make.extreme):
            name = {"arithmetic": "+", "compared": "<", "extreme": "min"}[of.__name__]
            with pytest.raises(NotRecheckedError, match="infinite or undefined"):
                of(name, a, b)
    for a, b in ((wrong, 1.0), (1.0, wrong), (wrong, wrong)):
        if math.isnan(wrong):
            for of, name in ((make.compared, "<"), (make.extreme, "min")):
                with pytest.raises(NotRecheckedError, match="NaN"):
                    of(name, a, b)
        else:
            assert make.compared("<", a, b) is (a < b)
            assert make.extreme("min", a, b) == min(a, b)


def test_known_truths_are_compared() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (-1.0, 1.0))
    c = terms.below(x)
    for op, known, other in itertools.product(("==", "!="), (True, False), (True, False)):
        found = make.compared(op, *((c, known) if other else (known, c)))
        for v in (-0.5, 0.5):
            same = (v < 0) == known
            assert holds(terms, found, [v]) is (same if op == "==" else not same)
    for a, b in itertools.product((True, False), repeat=2):
        assert make.both(a, b) is (a and b)
        assert make.one_of(a, b) is (a or b)
        assert make.negation(a) is (not a)


def test_both_sides_of_a_branch_are_joined() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (-1.0, 1.0))
    c = terms.below(x)
    i = make.whole(x)
    for a, b in ((1, 2), (1, 1.0), (0.0, -0.0), (i, 2), (3, i), (x, 2.0), (1.0, x), (x, i)):
        found: Any = make.join(FLOAT, c, a, b)
        whole = any(isinstance(v, (int, SymbolicInt)) for v in (a, b))
        assert isinstance(found, SymbolicInt) is whole
        for v in (-0.5, 0.5):
            side = a if v < 0 else b
            wanted = v if isinstance(side, Linear) else side
            assert abs(at(terms, found, [v]) - wanted) < 1e-12
    for a, b in itertools.product((True, False, c, negation(c)), repeat=2):
        found = make.join(FLOAT, c, a, b)
        for v in (-0.5, 0.5):
            side = a if v < 0 else b
            wanted_truth = side if isinstance(side, bool) else holds(terms, side, [v])
            truth = found if isinstance(found, bool) else holds(terms, found, [v])
            assert truth is wanted_truth
    pair = make.join(FLOAT, c, (1.0, (2, True)), (1.0, (2, True)))
    assert pair == (1.0, (2, True))
    with pytest.raises(NotRecheckedError, match="length"):
        make.join(FLOAT, c, (1.0,), (1.0, 2.0))


def test_a_function_of_the_prelude_has_its_domain_and_its_bound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bound = ErrorBound(((-1.0, 1.0),), ulps=1.0, values=(-0.75, 0.5))
    monkeypatch.setitem(BOUNDS, "atan", bound)
    for (low, high), inside in {
        (-1.0, 1.0): True,
        (-1.5, 1.0): False,
        (-1.0, 1.5): False,
        (0.0, 0.5): True,
    }.items():
        terms = Terms()
        (x,) = inputs_of(terms, (low, high))
        value = Operations(terms, rounded=True).prelude("atan", x)
        assert (not terms.obligations) is inside
        for v in (-1.25, -0.75, 0.25, 1.25):
            if low <= v <= high:
                assert all(holds(terms, o, [v]) for o in terms.obligations) is (abs(v) <= 1)
        off = terms.atoms[-1].extra
        largest = math.atan(max(-low, high))
        assert abs(float(off) - largest * 2.0**-52) < 1e-3 * largest * 2.0**-52
        assert abs(float(value.low) - max(math.atan(low), -0.75)) < 1e-8
        assert abs(float(value.high) - min(math.atan(high), 0.5)) < 1e-8
    monkeypatch.setitem(BOUNDS, "atan", ErrorBound(((-1.0, 1.0),), relative=2.0))
    with pytest.raises(NotRecheckedError, match="another kind"):
        Operations(terms, rounded=True).prelude("atan", x)


def test_what_a_function_may_be_off_counts_ulps_and_what_is_absolute(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for ulps, absolute in itertools.product((0.0, 1.0, 3.0), (0.0, 0.25)):
        bound = ErrorBound(((-math.inf, math.inf),), ulps=ulps, absolute=absolute)
        monkeypatch.setitem(BOUNDS, "exp", bound)
        for low, high in ((-1.0, 2.0), (-3.0, 1.0)):
            terms = Terms()
            (x,) = inputs_of(terms, (low, high))
            Operations(terms, rounded=True).prelude("exp", x)
            largest = math.exp(high)
            wanted = ulps * 2.0**-52 * largest + absolute
            assert abs(float(terms.atoms[-1].extra) - wanted) <= 1e-3 * wanted + 1e-30
            assert not terms.obligations


def test_a_function_that_may_leave_the_doubles_is_bounded_where_it_is_used() -> None:
    for high, within in ((600.0, True), (709.0, True), (720.0, False), (2000.0, False)):
        terms = Terms()
        (x,) = inputs_of(terms, (0.0, high))
        value = Operations(terms, rounded=True).prelude("exp", x)
        assert (not terms.obligations) is within
        for v in (1.0, 700.0, 708.0, 711.0):
            if v <= high and v < 709:
                assert all(holds(terms, o, [v]) for o in terms.obligations)
                assert math.isclose(at(terms, value, [v]), math.exp(v), rel_tol=1e-12)
        if not within:
            assert value.radius > 0
            assert terms.atoms[-1].kind == "spread" or value.terms


def test_a_value_is_narrowed_to_where_it_has_to_be() -> None:
    for low, high in ((0, 3), (-2, 2), (1, 1)):
        terms = Terms()
        make = Operations(terms, rounded=True)
        i = make.whole(inputs_of(terms, (-4.0, 4.0))[0])
        assert make.narrowed(i, low, high) is i
        for v in range(-4, 5):
            inside = low <= v <= high
            assert all(holds(terms, o, [float(v)]) for o in terms.obligations) is inside
            if inside:
                assert make.narrowed(v, low, high) == v
            else:
                with pytest.raises(StepFault):
                    make.narrowed(v, low, high)
        assert len(terms.obligations) == 2


def test_an_index_is_one_that_there_is() -> None:
    for index, size in itertools.product(range(-2, 4), range(4)):
        if index in range(size):
            assert in_range(index, size) == index
        else:
            with pytest.raises(StepFault):
                in_range(index, size)


@pytest.mark.parametrize(
    ("elements", "fine"),
    [
        ([1.0, 2.0, 3.0], True),
        ([1, 2, 3], True),
        ([1.0, 2.0, True], False),
        ([(1.0, 2.0)] * 3, True),
        ([(1, 2)] * 3, True),
        ([(True, 2.0)] * 3, False),
        ([((1.0, 3.0), 2.0)] * 3, True),
        ([1.0, 2.0, None], False),
    ],
)
def test_what_is_selected_is_numbers(elements: list[Any], fine: bool) -> None:
    def asked() -> Any:
        terms = Terms()
        make = Operations(terms, rounded=True)
        found = make.selected(elements, inputs_of(terms, (1.0, 1.0))[0])
        return make.row(found) if isinstance(found, Rows) else found

    def kinds(x: Any) -> Any:
        if isinstance(x, tuple):
            return tuple(map(kinds, x))
        if isinstance(x, Rows):
            return tuple(float for _ in x.elements[0])
        return int if isinstance(x, (int, SymbolicInt)) else float

    if fine:
        assert kinds(asked()) == kinds(elements[0])
    else:
        with pytest.raises(NotRecheckedError, match="indexed by an input"):
            asked()


def test_rows_are_alike_or_refused() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (0.0, 1.0))
    unlike = [(1.0, 2.0), (3.0,)]
    for of in (make.row, lambda rows: make.selected_twice(rows, 0)):
        with pytest.raises(NotRecheckedError, match="indexed by an input"):
            of(Rows(unlike, x))
    with pytest.raises(NotRecheckedError, match="indexed by an input"):
        make.selected_twice(Rows([(1.0, 2), (3.0, 4)], x), 0)
    for first in ((1.0, 2.0), (1, 2)):
        rows = Rows([first, first], x)
        found = make.selected_twice(rows, 1)
        assert isinstance(found, SymbolicInt) is isinstance(first[0], int)
        assert at(terms, found, [1.0]) == 2.0


def test_a_table_of_one_entry_and_rows_of_unlike_parts() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (0.0, 0.0))
    assert at(terms, make.selected([5.0], x), [0.0]) == 5.0
    assert at(terms, make.selected_twice(Rows([(1.0, 6.0)], x), 1), [0.0]) == 6.0
    assert [at(terms, v, [0.0]) for v in make.row(Rows([(1.0, 6.0)], x))] == [1.0, 6.0]
    first, rows = make.selected([(1.0, (2.0, 3.0)), (4.0, (5.0, 6.0))], x)
    assert at(terms, first, [0.0]) == 1.0
    assert isinstance(rows, Rows)


def test_the_least_int_has_no_opposite_and_no_size() -> None:
    make = Operations(Terms(), rounded=True)
    for of in (make.negated, lambda x: make.builtin("abs", x)):
        with pytest.raises(StepFault):
            of(-(2**63))
    assert make.negated(2**63 - 1) == 1 - 2**63
    assert str(make.builtin("abs", -0.0)) == "0.0"


@pytest.mark.parametrize("rounded", [True, False])
def test_only_a_machine_rounds(rounded: bool) -> None:
    terms = Terms()
    make = Operations(terms, rounded=rounded)
    x, y = inputs_of(terms, (1.0, 2.0), (1.0, 3.0))
    values: list[Any] = [make.arithmetic(op, x, y) for op in "+-*/"] + [make.builtin("sqrt", x)]
    assert [v.radius > 0 for v in values] == [rounded] * 5


def test_a_root_and_a_size_are_not_negative() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (0.0, 4.0))
    assert make.builtin("sqrt", x).nonnegative
    assert make.builtin("abs", x).nonnegative


@pytest.mark.parametrize(
    ("low", "high", "nonnegative", "made"),
    [(0.0, 3.0, False, 1), (0.5, 3.0, False, 1), (-0.5, 3.0, True, 1), (-0.5, 3.0, False, 4)],
)
def test_what_is_not_negative_is_cut_off_by_floor(
    low: float, high: float, nonnegative: bool, made: int
) -> None:
    """Else there are two floors, their difference where one is chosen, and the choice."""
    terms = Terms()
    (x,) = inputs_of(terms, (low, high))
    x.nonnegative = nonnegative
    Operations(terms, rounded=True).builtin("int", x)
    assert len(terms.atoms) - 1 <= made
    assert (len(terms.atoms) == 2) is (made == 1)


def test_a_function_may_be_off_near_zero_and_beyond_the_doubles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    terms = Terms()
    (x,) = inputs_of(terms, (0.0, 0.0))
    Operations(terms, rounded=True).prelude("atan", x)
    assert terms.atoms[-1].extra > 0
    bound = ErrorBound(((-math.inf, math.inf),), ulps=1.0, absolute=0.25)
    monkeypatch.setitem(BOUNDS, "exp", bound)
    (x,) = inputs_of(terms, (0.0, 2000.0))
    assert Operations(terms, rounded=True).prelude("exp", x).radius > 0.2


def test_floor_of_floor_is_no_more() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (-3.0, 3.0))
    down: Any = make.builtin("floor", x)
    for of, same in (
        (down, True),
        (terms.combine(((exact(2.0), down),)), False),
        (terms.combine(((ONE, down),), exact(0.5)), False),
        (terms.combine(((ONE, down), (ONE, x))), False),
        (x, False),
        (terms.constant(2.0), False),
    ):
        before = len(terms.atoms)
        whole: Any = make.builtin("int", of)
        assert isinstance(whole, SymbolicInt)
        assert (len(terms.atoms) == before) is same
        for v in (-2.25, -0.5, 0.75, 2.5):
            assert at(terms, whole, [v]) == math.trunc(at(terms, of, [v]))
    assert type(make.builtin("float", whole)) is Linear
    assert isinstance(make.builtin("abs", whole), SymbolicInt)
    assert not isinstance(make.builtin("abs", x), SymbolicInt)
    with pytest.raises(NotRecheckedError, match="`seconds`"):
        make.builtin("seconds", x)


# ---------------------------------------------------------------- statements and steps


def test_so_long_a_step_is_read(monkeypatch: pytest.MonkeyPatch, program: Any) -> None:
    fun = program.funs["one"]
    needed = next(n for n in itertools.count() if _reads(monkeypatch, fun, n))
    assert not _reads(monkeypatch, fun, needed - 1)
    assert needed == 6  # `if`, its condition and two sides of that, `return`, its value


def _reads(monkeypatch: pytest.MonkeyPatch, fun: Any, most: int) -> bool:
    monkeypatch.setattr(symbolic_reading, "STEPS_MAX", most)
    try:
        SymbolicReader(Terms(), Surroundings({}, {})).called(fun, [2.0])
    except NotRecheckedError:
        return False
    return True


STEP = """soter 1;
topic x: float;
topic u: float;
topic w: float;
node N period 10ms {{
  subscribes x;
  publishes u, w;
  step {{ {body} }}
}}
"""


@pytest.mark.parametrize(
    ("body", "refused"),
    [
        ("publish u = x; publish w = 1.0;", ""),
        ("if x > 0.0 { publish u = 1.0; } else { publish u = x; } publish w = dt;", ""),
        ("publish u = 3.0; if x > 0.0 { publish u = 1.0; } publish w = 2.0;", ""),
        ("publish w = x; if x > 0.0 { publish u = 1.0; } publish u = 4.0;", ""),
        ("if x > 0.0 { publish u = 1.0; } publish w = x;", "one side only"),
        ("publish w = x; if x > 0.0 { } else { publish u = 1.0; }", "one side only"),
        ("assert x < 0.0; publish u = [x][1 + int(floor(2.5))];", "faults wherever"),
    ],
)
def test_a_step_publishes_on_both_sides(tmp_path: Path, body: str, refused: str) -> None:
    path = tmp_path / "step.soter"
    path.write_text(STEP.format(body=body))
    checked = check_file(str(path))
    assert checked.program is not None
    node = checked.program.nodes["N"]
    terms = Terms()
    (x,) = inputs_of(terms, (-2.0, 2.0))
    (topic,) = (s.topic for s in node.subscribes)
    reader = SymbolicReader(terms, Surroundings({}, {topic: x}, 0.01))
    if refused:
        with pytest.raises(NotRecheckedError, match=refused):
            reader.step(node.step, {})
        return
    published = {t.name: v for t, v in reader.step(node.step, {}).items()}
    for v in (-1.0, 1.0):
        wanted = {
            "publish u = x; p": (v, 1.0),
            "if x > 0.0 { pub": (1.0 if v > 0 else v, 0.01),
            "publish u = 3.0;": (1.0 if v > 0 else 3.0, 2.0),
            "publish w = x; i": (4.0, v),
        }[body[:16]]
        found = [published[n] for n in "uw"]
        values = [at(terms, f, [v]) if isinstance(f, Linear) else f for f in found]
        assert values == [pytest.approx(w, abs=1e-12) for w in wanted]


def test_what_is_not_understood_is_refused(program: Any) -> None:
    reader = SymbolicReader(Terms(), Surroundings({}, {}))
    frame = CallFrame({})
    strange: Any = SimpleNamespace(type=FLOAT)
    with pytest.raises(NotRecheckedError, match="SimpleNamespace"):
        reader.value(strange, frame)
    with pytest.raises(NotRecheckedError, match="simplenamespace"):
        reader._simple(strange, frame)
    fun = program.funs["one"]
    (parameter,) = fun.parameters
    read: Any = SimpleNamespace(variable=parameter)
    with pytest.raises(NotRecheckedError, match="where it is read"):
        reader._variable(read, frame)
    assert reader._variable(read, CallFrame({parameter: 2.0})) == 2.0
    for body, words in ((None, "extern"), ((), "not rechecked yet")):
        extern: Any = SimpleNamespace(
            body=body, name="f", parameters=(), result=FLOAT, prelude=False
        )
        with pytest.raises(NotRecheckedError, match=words):
            reader.called(extern, ())


@pytest.mark.parametrize("known", [TRUE, FALSE])
def test_a_condition_is_left_behind(known: Proposition) -> None:
    """Whatever happens below, the path is the one before."""
    terms = Terms()
    reader = SymbolicReader(terms, Surroundings({}, {}))
    (x,) = inputs_of(terms, (-1.0, 1.0))
    before = terms.below(x)
    terms.path = before

    def fails() -> Any:
        raise StepFault(FaultKind.ASSERT)

    assert reader.tried(known.value, fails) == (False, None)
    assert terms.path is before
    assert len(terms.obligations) == (1 if known is TRUE else 0)
    assert reader.tried(True, lambda: 3) == (True, 3)
