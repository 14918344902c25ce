"""Single functions of what is read of a program, and of its terms, where they begin to say else."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from bench.recheck.small_modules import PROGRAMS
from flint import arb

from soter.certificate import rechecker
from soter.certificate.cell_sets import Grid
from soter.certificate.extras.array_elements import element_of_table
from soter.certificate.extras.prelude_functions import prelude_function
from soter.certificate.extras.sc_locals_and_modes import any_alternative
from soter.certificate.grid.chain_form_layout import FormLayout
from soter.certificate.grid.group_claims import ChainCheck, half_of_form
from soter.certificate.reading import supported_constructs
from soter.certificate.reading.folder import Certificate, _parameter_values
from soter.certificate.reading.symbolic_operations import Operations
from soter.certificate.reading.symbolic_reading import CallFrame, Surroundings, SymbolicReader
from soter.certificate.reading.symbolic_values import Rows
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.compile_terms import (
    all_certain,
    compile_step,
    compile_truths,
    form_of_box,
)
from soter.certificate.terms.linear_enclosures import ONE, exact
from soter.certificate.terms.straight_line import CERTAIN, OPERATIONS, Builder
from soter.certificate.terms.terms import FALSE, TRUE, Linear, Terms
from soter.language.front_end import check_file
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


# ---------------------------------------------------------------- terms


def inputs_of_two(terms: Terms) -> list[Linear]:
    return [terms.add_input("state", name, exact(-6.0), exact(6.0)) for name in "xy"]


def image(terms: Terms, value: Linear, box: Sequence[tuple[float, float]]) -> Any:
    """The form of a value over a box of the first two inputs, and its ends."""
    step = compile_step(terms, [0, 1], 2, [value], ranges=[value])
    return step(form_of_box([(exact(a), exact(b)) for a, b in box], symbols=True))


@pytest.mark.parametrize("factor", [arb(-0.5, 0.5), arb(0.5, 0.5), arb(0, 1)])
def test_a_factor_whose_sign_is_only_nearly_certain(factor: arb) -> None:
    terms = Terms()
    x, _ = inputs_of_two(terms)
    low, high = image(terms, terms.combine(((factor, x),)), [(1.0, 2.0), (0.0, 1.0)])[1]
    for f in (factor.lower(), factor.upper()):
        assert low <= f.mid() * 2 <= high


def test_one_of_several_is_any_of_them() -> None:
    terms = Terms()
    x, y = inputs_of_two(terms)
    others = [terms.combine(((ONE, x), (exact(c), y)), exact(d)) for c, d in ((1.0, 0.5), (3, -2))]
    value = any_alternative(terms, [x, *others])
    form, (low, high) = image(terms, value, [(0.5, 1.5), (1.0, 2.0)])
    for a, b in itertools.product((0.5, 1.0, 1.5), (1.0, 2.0)):
        for v in (a, a + b + 0.5, a + 3 * b - 2):
            assert low <= v <= high
            off = exact(v) - (form[2] + form[3] * (a - 1) * 2 + form[4] * (b - 1.5) * 2)
            assert not abs(off) > form[5]


def test_a_limit_that_is_a_number_takes_one_kink() -> None:
    """What never exceeds a number needs no more; of two that vary either is a limit."""
    for constant in (True, False):
        terms = Terms()
        x, y = inputs_of_two(terms)
        Operations(terms, rounded=True).min_or_max("min", 1.0 if constant else y, x)
        kinds = [a.kind for a in terms.atoms[2:]]
        assert kinds == (["max0"] if constant else ["max0", "min"])


@pytest.mark.parametrize("rounded", [True, False])
def test_a_function_is_off_by_its_bound_where_numbers_are_rounded(rounded: bool) -> None:
    terms = Terms()
    x, _ = inputs_of_two(terms)
    prelude_function(Operations(terms, rounded=rounded), "sin", x)
    assert terms.atoms[-1].extra.is_zero() is not rounded


def test_what_is_known_on_both_sides_of_a_branch_stays_known() -> None:
    terms = Terms()
    x, _ = inputs_of_two(terms)
    operations, of = Operations(terms, rounded=True), Any
    c = terms.below_zero(x)
    for known in (2, 2.5, True):
        assert operations.choice_of(of, c, known, known) is known  # type: ignore[arg-type]
    one = operations.choice_of(of, c, 1.0, x)  # type: ignore[arg-type]
    assert isinstance(one, Linear)
    assert isinstance(operations.choice_of(of, c, x, 1.0), Linear)  # type: ignore[arg-type]


def test_a_range_that_ends_at_a_limit_is_inside() -> None:
    def inside(*ends: float) -> int:
        bits: int = OPERATIONS["inside"](*map(exact, ends))
        return bits

    for low, high in itertools.product((-0.25, 0.0, 0.25), (0.75, 1.0, 1.25)):
        assert (inside(low, high, 0.0, 1.0) == 2) == (low >= 0.0 and high <= 1.0)


def test_a_root_asks_that_there_is_one() -> None:
    terms = Terms()
    x, _ = inputs_of_two(terms)
    operations = Operations(terms, rounded=True)
    square = terms.apply_function("square", x, nonnegative=True)
    assert terms.multiply(x, x).nonnegative
    assert not operations.result_of_builtin("sqrt", square).rests
    root = operations.result_of_builtin("sqrt", x)
    assert root.rests
    assert not terms.obligations
    operations.demand_finite(root)
    assert terms.obligations == list(root.rests)


@pytest.mark.parametrize("n", [1, 2])
@pytest.mark.parametrize("memories", [0, 1, 2])
def test_halves_of_a_form_are_that_form(n: int, memories: int) -> None:
    """Every state of it is in one of them, at twice what its beta is off the half's middle."""
    draw = np.random.default_rng(19)
    count = n + memories
    centre, symbols, rest, common = (count * k for k in (2, 3, 3 + n, 4 + n))
    for _ in range(60):
        numbers = draw.uniform(-1, 1, count * (4 + n) + memories * n)
        numbers[rest:common] = abs(numbers[rest:common])
        numbers[: 2 * count] = np.tile([-9.0, 9.0], count)
        form = tuple(exact(float(v)) for v in numbers)
        for axis, side in itertools.product(range(n), (0.5, -0.5)):
            half = half_of_form(form, n, axis, exact(side))
            eps, beta = draw.choice([-1.0, 1.0], n), draw.choice([-1.0, 1.0], count)
            ours = draw.uniform(-0.5, 0.5) + side
            new_beta, beta[axis] = beta.copy(), ours
            new_beta[axis] = 2 * (ours - side)
            for of, b in ((form, beta), (half, new_beta)):
                states = []
                for i in range(count):
                    x = of[centre + i] + of[rest + i] * b[i]
                    x += sum(of[symbols + i * n + k] * eps[k] for k in range(n))
                    for k in range(n) if i >= n else ():
                        x += of[common + (i - n) * n + k] * of[rest + k] * b[k]
                    states.append(x)
                if of is form:
                    expected = states
            for i, (x, y) in enumerate(zip(expected, states, strict=True)):
                assert abs(x - y) < 1e-12
                assert half[2 * i] - 1e-12 <= x <= half[2 * i + 1] + 1e-12


def test_the_state_with_the_widest_rest_in_cells_is_halved() -> None:
    grid = Grid(((0.0, 1.0), tuple(k / 10 for k in range(11))))
    check: Any = SimpleNamespace(group=SimpleNamespace(states=(0, 1), grid=grid))
    form = [exact(0.0)] * 12
    form[10], form[11] = exact(5.0), exact(0.6)
    halves = ChainCheck._halves_of_form(check, tuple(form))
    assert [(part[10], part[11]) for part in halves] == [(exact(5.0), exact(0.6) / 2)] * 2
    assert [part[5] for part in halves] == [-exact(0.6) / 2, exact(0.6) / 2], "one on either side"


@pytest.mark.parametrize("extra", [0.0, 0.25])
def test_what_a_function_may_be_off_is_in_its_image(extra: float) -> None:
    terms = Terms()
    x, _ = inputs_of_two(terms)
    value = terms.apply_function("exp", x)
    atom = terms.atoms[-1]
    atom.extra, atom.low, atom.high = exact(extra), atom.low - 1, atom.high + 1
    form, (low, high) = image(terms, value, [(1.0, 1.1), (0.0, 1.0)])
    assert abs(low - (math.exp(1.0) - extra)) < 0.05
    assert abs(high - (math.exp(1.1) + extra)) < 0.05
    assert extra <= form[5] < extra + 0.05


def test_of_what_is_not_negative_a_function_is_taken_from_zero_on() -> None:
    terms = Terms()
    x, _ = inputs_of_two(terms)
    for nonnegative, least in ((True, 1.0), (False, math.exp(-6.0))):
        value = terms.apply_function("exp", replace(x, nonnegative=nonnegative))
        assert abs(value.low - least) < 1e-5


@pytest.mark.parametrize("strict", [True, False])
def test_what_is_below_zero_is_known_from_its_ends(strict: bool) -> None:
    for low, high in itertools.combinations_with_replacement((-1.0, 0.0, 1.0), 2):
        terms = Terms()
        x = terms.add_input("state", "x", exact(low), exact(high))
        certain, never = (high < 0, low >= 0) if strict else (high <= 0, low > 0)
        expected = "certain" if certain else "never" if never else "open"
        truth = terms.below_zero(x, strict=strict)
        assert expected == ("certain" if truth is TRUE else "never" if truth is FALSE else "open")


def test_what_is_never_so_is_not_certain() -> None:
    terms = Terms()
    inputs_of_two(terms)
    for truth, certain in ((TRUE, True), (FALSE, False)):
        assert all_certain(terms, [truth]) is certain
        (bits,) = compile_truths(terms, [0], [truth], {})(form_of_box([(ONE, ONE)], symbols=False))
        assert (bits == CERTAIN) is certain


def test_a_table_of_one_column_is_read() -> None:
    terms = Terms()
    x, y = inputs_of_two(terms)
    operations = Operations(terms, rounded=True)
    for width in (1, 2):
        rows = Rows([tuple(float(10 * r + c) for c in range(width)) for r in range(3)], x)
        value: Any = element_of_table(operations, rows, y)
        low, high = image(terms, value, [(2.0, 2.0), (width - 1.0, width - 1.0)])[1]
        assert abs(low - (20 + width - 1)) < 1e-9
        assert abs(high - low) < 1e-9


def test_minus_a_number_is_no_int() -> None:
    operations = Operations(Terms(), rounded=True)
    for x in (1e300, -2.5, 0.0, 3, -(2**62)):
        assert operations.negate(x) == -x
    assert str(operations.negate(0.0)) == "-0.0"


def test_only_equal_constants_are_one() -> None:
    make, table = Builder(), np.array([1.0, 2.0])
    equal: list[Any] = [2, 2.0, exact(0.5), arb(0.5, 0.25), table, (ONE, 3), True, arb("inf")]
    for x, y in itertools.product(equal, repeat=2):
        assert (make.constant(x) is make.constant(y)) is (x is y)
    for x, y in ((exact(0.5), arb(0.5)), (2, 1 + 1), (0.5, 1 / 2)):
        assert make.constant(x) is make.constant(y)
    assert make.constant(0.0) is not make.constant(-0.0)
    assert make.constant(arb("nan")) is not make.constant(arb("nan"))


@pytest.mark.parametrize("given", [True, False])
def test_each_old_command_is_as_far_off_as_its_range_is_wide(given: bool) -> None:
    n, q = 2, 3
    layout = FormLayout(n, q, 1)
    count = n + q if given else n
    form: list[Any] = [exact(0.0)] * ((4 + n) * count + n * (count - n))
    ends = [(exact(float(k)), exact(3.0 * k + 2)) for k in range(q)]
    for k, (low, high) in enumerate(ends if given else ()):
        form[2 * (n + k)], form[2 * (n + k) + 1] = low, high
        form[2 * count + n + k] = (low + high) / 2
        form[(3 + n) * count + n + k] = (high - low) / 2
    opened = layout.take_apart(tuple(form), None if given else ends)
    symbols = set()
    for k, (low, high) in enumerate(ends):
        row = opened.z[n + k]
        assert row[0] == (low + high) / 2
        (at,) = [i for i, x in enumerate(row) if i and not x.is_zero()]
        assert row[at] == (high - low) / 2
        assert at < len(row) - q  # the last are left to the commands that answer
        symbols.add(at)
        assert opened.ranges[n + k] == (low, high)
    assert len(symbols) == q


# ---------------------------------------------------------------- reading


CODE = """soter 1;
topic there: float;
topic unknown: float;
fun Truths(x: float, y: float): float { return (x > 0.0) == (y > 0.0) ? 1.0 + x : -1.0 - y; }
fun Others(x: float, y: float): float { return (x > 0.0) != (y > 1.0) ? 1.0 + x : -1.0 - y; }
fun Counts(x: float, y: float): float { return float(2 * int(floor(x)) + 1) + y; }
fun Of(v: float[3], i: int): float { return v[i]; }
fun Known(x: float, y: float): float {
  let v: float[3] = [x, y, x + y];
  let i: int = 2;
  return Of(v, i) - v[1] + [x, y][0];
}
type Pair = { a: float, b: float };
fun Nested(x: float, y: float): float {
  var p: Pair[2] = [{ a: 1.0, b: y }, { a: 2.0, b: y }];
  p[1].a = x;
  p[0].b = p[0].b + p[1].a;
  return p[1].a + p[0].b - p[1].b + p[0].a;
}
fun Long(x: float, y: float): float {
  var sum = 0.0;
  for i in 0..24 {
    if x > float(i) - 12.0 {
      sum = sum + y;
    }
  }
  return sum;
}
"""


def read(folder: Path, name: str, terms: Terms) -> Linear:
    path = folder / "code.soter"
    path.write_text(CODE)
    checked = check_file(str(path))
    assert checked.program is not None, checked.diagnostics
    fun = checked.program.funs[name]
    frame = CallFrame(dict(zip(fun.parameters, inputs_of_two(terms), strict=True)))
    value = SymbolicReader(terms, Surroundings({}, {})).run_block(fun.body or (), frame)
    assert isinstance(value, Linear)
    return value


@pytest.mark.parametrize(
    ("name", "of"),
    [
        ("Truths", lambda x, y: 1.0 + x if (x > 0) == (y > 0) else -1.0 - y),
        ("Others", lambda x, y: 1.0 + x if (x > 0) != (y > 1) else -1.0 - y),
        ("Counts", lambda x, y: 2 * math.floor(x) + 1 + y),
        ("Known", lambda x, _: 2 * x),
        ("Nested", lambda x, _: 2 * x + 1),
        ("Long", lambda x, y: y * sum(x > i - 12.0 for i in range(24))),
    ],
)
def test_what_is_read_is_what_is_written(tmp_path: Path, name: str, of: Any) -> None:
    """Truths compared, ints of inputs beside known ones; and no branch is followed twice."""
    terms = Terms()
    value = read(tmp_path, name, terms)
    for x, y in itertools.product((-1.75, -0.25, 0.25, 1.5), (-1.25, 0.5, 1.75)):
        low, high = image(terms, value, [(x, x), (y, y)])[1]
        assert low - 1e-9 <= of(x, y) <= high + 1e-9
        assert high - low < 1e-9


def test_what_nobody_says_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "code.soter"
    path.write_text(CODE)
    topics = {s.name: s for s in check_file(str(path)).program.topics.values()}  # type: ignore[union-attr]
    reader = SymbolicReader(Terms(), Surroundings({}, {topics["there"]: 1.0}))
    expression: Any = SimpleNamespace(topic=topics["there"])
    assert reader._topic_value(expression, CallFrame({})) == 1.0
    expression.topic, expression.module = topics["unknown"], "M"
    for of in (reader._topic_value, reader._period_value, reader._mode_value):
        with pytest.raises(NotRecheckedError):
            of(expression, CallFrame({}))


def test_a_field_that_the_list_does_not_have_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclass
    class Part:
        known: int
        added: int

    for names in ("known", "", None):
        entries: Any = {} if names is None else {Part: names}
        monkeypatch.setattr(supported_constructs, "ELABORATED", entries)
        with pytest.raises(NotRecheckedError, match="not known here"):
            supported_constructs._require_known_fields(Part)
    entries = {Part: "known added", int: ""}
    monkeypatch.setattr(supported_constructs, "ELABORATED", entries)
    for of in entries:
        supported_constructs._require_known_fields(of)
    with pytest.raises(NotRecheckedError, match="not known here"):
        supported_constructs._require_known_fields(float)


def test_a_state_is_followed_through_names(tmp_path: Path) -> None:
    text = PROGRAMS["written"]
    plain = small_proofs.facts_of(_written(tmp_path, text), "S", "M").leaves
    (driven,) = [x for x in text.splitlines() if "drives" in x]
    value = driven.split("drives")[1].split("=")[1].strip(" ;")
    named = text.replace(driven, driven.replace(value, "again") + f" let again = {value};")
    assert small_proofs.facts_of(_written(tmp_path, named), "S", "M").leaves.keys() == plain.keys()


def _written(folder: Path, text: str) -> Path:
    path = folder / "small.soter"
    path.write_text(text)
    return path


def test_a_parameter_that_the_program_does_not_have_is_rejected(tmp_path: Path) -> None:
    checked = check_file(str(_written(tmp_path, f"{PROGRAMS['written']}\nparam of: float = 1.0;")))
    assert checked.program is not None, checked.diagnostics
    for name, fine in (("of", True), ("S.nowhere.of", False), ("other", False)):
        given = Certificate(tmp_path, {"params": {name: (2.0).hex()}}, {}, set())
        if fine:
            assert _parameter_values(given, checked.program) == {name: 2.0}
        else:
            with pytest.raises(RejectedError, match="no parameter"):
                _parameter_values(given, checked.program)


@pytest.mark.parametrize(("most", "fine"), [(1, True), (0, False)])
def test_as_many_cases_as_are_gone_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, fine: bool
) -> None:
    facts = small_proofs.facts_of(_written(tmp_path, PROGRAMS["written"]), "S", "M")
    monkeypatch.setattr(rechecker, "CASES_MAX", most)
    monkeypatch.setattr(rechecker, "compare_numbers", lambda *_: None)
    monkeypatch.setattr(rechecker, "check_static_claims", lambda *_: None)
    entry = {"claims": {"P2a": "proved"}, "cases": []}
    with pytest.raises(RejectedError if fine else NotRecheckedError, match="combinations"):
        rechecker.read_claims(Certificate(tmp_path, {}, {}, set()), facts, entry)


def test_a_module_has_tables_where_its_predicates_are_computed_and_else_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    facts = small_proofs.facts_of(_written(tmp_path, PROGRAMS["written"]), "S", "M")
    for name in (
        "compare_numbers",
        "check_static_claims",
        "refuse_parts_without_claim",
    ):
        monkeypatch.setattr(rechecker, name, lambda *_, **__: None)
    monkeypatch.setattr(rechecker, "read_groups", lambda *_: [])
    case: Any = {"parameter": [], "groups": []}
    entry: Any = {"claims": {"P2a": "proved"}, "cases": [case], "tables": []}
    with pytest.raises(RejectedError, match="has tables of its DM"):
        rechecker.read_claims(Certificate(tmp_path, {}, {}, set()), facts, entry)
