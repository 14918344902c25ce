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
from soter.certificate.reading.symbolic_reading import CallFrame, Surroundings, SymbolicReader
from soter.certificate.reading.symbolic_values import (
    as_bool,
    as_truth,
    is_identical,
    is_known,
    scalar_leaves,
    symbolic_int,
    value_of_leaves,
)
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import exact
from soter.certificate.terms.terms import FALSE, TRUE, Linear, Proposition, Terms
from soter.language.evaluate.arithmetic import FaultKind, StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file
from soter.language.model.typed import VarRead
from soter.language.model.types import FLOAT, ArrayType, ListType
from tables import all_rows

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
    "truncated": math.trunc,
    "wrap_angle": lambda x: math.remainder(x, 2 * math.pi),
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
    if atom.kind == "apart":
        return at(terms, of[0], point)
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
    "fault_behind_a_return": """let i = 3;
  if x > 1.0 { return y; }
  return TABLE[i];""",
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
    return [terms.add_input("state", f"x{k}", exact(a), exact(b)) for k, (a, b) in enumerate(ends)]


@all_rows("rounded", [True, False])
@all_rows("name", BODIES)
def test_code_is_what_it_computes(program: Any, name: str, rounded: bool) -> None:
    fun, terms = program.funs[f"f_{name}"], Terms()
    inputs = inputs_of(terms, (-6.0, 6.0), (-6.0, 6.0))
    reader = SymbolicReader(terms, Surroundings({}, {}), rounded=rounded)
    value = reader.result_of_call(fun, inputs)
    evaluate = Evaluator({}).closure_of(fun)
    fine = 0
    for point in itertools.product(POINTS, repeat=2):
        try:
            wanted = evaluate(Environment(), point)
        except StepFault:
            wanted = math.nan
        rests = value.rests if isinstance(value, Linear) else ()
        well = all(holds(terms, o, point) for o in (*terms.obligations, *rests))
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


# ---------------------------------------------------------------- statements and steps


def test_so_long_a_step_is_read(monkeypatch: pytest.MonkeyPatch, program: Any) -> None:
    fun = program.funs["one"]
    needed = next(n for n in itertools.count() if _reads(monkeypatch, fun, n))
    assert not _reads(monkeypatch, fun, needed - 1)
    assert needed == 6  # `if`, its condition and two sides of that, `return`, its value


def _reads(monkeypatch: pytest.MonkeyPatch, fun: Any, most: int) -> bool:
    monkeypatch.setattr(symbolic_reading, "STEPS_MAX", most)
    try:
        SymbolicReader(Terms(), Surroundings({}, {})).result_of_call(fun, [2.0])
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
            reader.published_by_step(node.step, {})
        return
    published = {t.name: v for t, v in reader.published_by_step(node.step, {}).items()}
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
        reader.value_of(strange, frame)
    with pytest.raises(NotRecheckedError, match="simplenamespace"):
        reader._run_simple(strange, frame)
    fun = program.funs["one"]
    (parameter,) = fun.parameters
    read: Any = SimpleNamespace(variable=parameter)
    with pytest.raises(NotRecheckedError, match="where it is read"):
        reader._variable_value(read, frame)
    assert reader._variable_value(read, CallFrame({parameter: 2.0})) == 2.0
    for body, words in ((None, "extern"), ((), "not rechecked yet")):
        extern: Any = SimpleNamespace(
            body=body, name="f", parameters=(), result=FLOAT, prelude=False
        )
        with pytest.raises(NotRecheckedError, match=words):
            reader.result_of_call(extern, ())


@pytest.mark.parametrize("known", [TRUE, FALSE])
def test_a_condition_is_left_behind(known: Proposition) -> None:
    """Whatever happens below, the path is the one before."""
    terms = Terms()
    reader = SymbolicReader(terms, Surroundings({}, {}))
    (x,) = inputs_of(terms, (-1.0, 1.0))
    before = terms.below_zero(x)
    terms.path = before

    def fails() -> Any:
        raise StepFault(FaultKind.ASSERT)

    assert reader.run_under(known.value, fails) == (False, None)
    assert terms.path is before
    assert len(terms.obligations) == (1 if known is TRUE else 0)
    assert reader.run_under(True, lambda: 3) == (True, 3)


# ---------------------------------------------------------------- what is not looked at

SIDES = """extern fun drawn(x: float): float from "c:drawn.c:drawn";
fun of_and(c: bool, x: float): bool { return c && drawn(x) > 0.0; }
fun of_or(c: bool, x: float): bool { return c || drawn(x) > 0.0; }
fun of_choice(c: bool, x: float): float { return c ? drawn(x) : x; }
fun of_if(c: bool, x: float): float { if c { return drawn(x); } return x; }
fun of_else(c: bool, x: float): float { if c { } else { return drawn(x); } return x; }
"""


@pytest.mark.parametrize(
    ("name", "looks", "other"),
    [
        ("and", True, False),
        ("or", False, True),
        ("choice", True, "x"),
        ("if", True, "x"),
        ("else", False, "x"),
    ],
)
def test_the_side_that_is_not_taken_is_not_looked_at(
    tmp_path: Path, name: str, looks: bool, other: Any
) -> None:
    """Where a condition is known: nothing is known of the function that is only asked there."""
    path = tmp_path / "sides.soter"
    path.write_text("soter 1;\n" + SIDES)
    program = check_file(str(path)).program
    assert program is not None
    terms = Terms()
    (x,) = inputs_of(terms, (-2.0, 2.0))
    fun = program.funs[f"of_{name}"]
    reader = SymbolicReader(terms, Surroundings({}, {}))
    found = reader.result_of_call(fun, [not looks, x])
    assert found is x if other == "x" else found is other
    for c in (looks, terms.below_zero(x)):
        with pytest.raises(NotRecheckedError, match="extern"):
            reader.result_of_call(fun, [c, x])


def test_one_part_of_a_value_is_made_new() -> None:
    """That at the indices, and only where they are known and there is such a part."""
    terms = Terms()
    (x,) = inputs_of(terms, (0.0, 1.0))
    reader = SymbolicReader(terms, Surroundings({}, {}))
    many = ArrayType(ArrayType(FLOAT, 2), 3)
    old = ((1.0, 2.0), (3.0, 4.0), (5.0, 6.0))
    assert reader.replace_part(many, old, [], 9.0) == 9.0
    for i, k in itertools.product(range(3), range(2)):
        rows = [list(row) for row in old]
        rows[i][k] = 9.0
        assert reader.replace_part(many, old, [i, k], 9.0) == tuple(map(tuple, rows))
    unknown: list[list[Any]] = [[x, 0], [0, x], [symbolic_int(x), 0]]
    for keys in unknown:
        with pytest.raises(NotRecheckedError, match="an assignment at an index that depends"):
            reader.replace_part(many, old, keys, 9.0)
    for beyond in ([3, 0], [0, 2], [-1, 0]):
        with pytest.raises(StepFault):
            reader.replace_part(many, old, beyond, 9.0)


def test_a_value_is_known_where_all_of_it_is() -> None:
    terms = Terms()
    (x,) = inputs_of(terms, (0.0, 1.0))
    unknown = (x, symbolic_int(x), terms.below_zero(x))
    for known in (True, False, 0, 2, -0.0, (), (1.0, (2, True)), ((), 3.0)):
        assert is_known(known)
        for y in unknown:
            assert not is_known(y)
            assert not is_known((known, y))
            assert not is_known((y, known))
            assert not is_known((known, (known, y)))
    for a, b in itertools.product((0.0, -0.0, 1.0, 1, 0, True, False), repeat=2):
        same = type(a) is type(b) and math.copysign(1.0, a) == math.copysign(1.0, b) and a == b
        assert is_identical(a, b) is same


@pytest.mark.parametrize("kind", ["term", "whole", "number", "pair", "nothing"])
def test_a_bool_is_known_or_a_proposition(tmp_path: Path, kind: str) -> None:
    """Whatever else is in its place is refused, as a condition, a value, or a part of `for`."""
    path = tmp_path / "bools.soter"
    path.write_text("soter 1;\nfun same(c: bool): bool { return c; }\n")
    program = check_file(str(path)).program
    assert program is not None
    terms = Terms()
    (x,) = inputs_of(terms, (-1.0, 1.0))
    strange: dict[str, Any] = {
        "term": x,
        "whole": symbolic_int(x),
        "number": 1.0,
        "pair": (True, True),
        "nothing": None,
    }
    reader = SymbolicReader(terms, Surroundings({}, {}))
    for fine in (True, False, terms.below_zero(x)):
        assert reader.result_of_call(program.funs["same"], [fine]) is fine
        truth = as_truth(fine)
        assert truth is (fine if isinstance(fine, Proposition) else TRUE if fine else FALSE)
        assert as_bool(truth) is fine
    for refuses in (lambda y: reader.result_of_call(program.funs["same"], [y]), as_truth):
        with pytest.raises(NotRecheckedError, match="such a bool"):
            refuses(strange[kind])


def test_a_loop_goes_over_what_is_known_to_be_there() -> None:
    terms = Terms()
    (x,) = inputs_of(terms, (-1.0, 1.0))
    reader = SymbolicReader(terms, Surroundings({}, {}))
    variable: Any = object()
    sequence: Any = VarRead(ListType(FLOAT, 3), None, variable)  # type: ignore[arg-type]
    each: Any = SimpleNamespace(type=FLOAT)
    loop: Any = SimpleNamespace(sequence=sequence, variable=each, body=(), span=None)
    for count in range(3):
        frame = CallFrame({variable: (x,) * count})
        assert len(reader._unrolled_loop(loop, frame)) == count
    with pytest.raises(NotRecheckedError, match="such a `for`"):
        reader._unrolled_loop(loop, CallFrame({variable: x}))


def test_leaves_make_a_value_of_their_type_and_none_is_left() -> None:
    of = ArrayType(ArrayType(FLOAT, 2), 2)
    assert value_of_leaves(of, [1.0, 2.0, 3.0, 4.0]) == ((1.0, 2.0), (3.0, 4.0))
    assert scalar_leaves(value_of_leaves(of, [1.0, 2.0, 3.0, 4.0])) == [1.0, 2.0, 3.0, 4.0]
    assert value_of_leaves(FLOAT, [7.0]) == 7.0
    assert scalar_leaves(7.0) == [7.0]
    for more in ([1.0] * 5, [1.0] * 9):
        with pytest.raises(NotRecheckedError, match="a list on a topic"):
            value_of_leaves(of, more)
    with pytest.raises(NotRecheckedError, match="a list on a topic"):
        value_of_leaves(ListType(FLOAT, 3), [1.0])
