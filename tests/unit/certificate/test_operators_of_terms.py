"""Single operators of what depends on inputs beside those of Python's numbers."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest

from soter.certificate.extras import array_elements
from soter.certificate.extras.prelude_functions import prelude_function
from soter.certificate.reading.symbolic_operations import Operations
from soter.certificate.reading.symbolic_values import Rows, SymbolicInt, index_in_range
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import ONE, exact
from soter.certificate.terms.terms import Linear, Terms, negation
from soter.language.evaluate.arithmetic import StepFault
from soter.language.model.types import FLOAT
from soter.language.prelude.function_error_bounds import BOUNDS, ErrorBound
from unit.certificate.test_reading_by_evaluation import at, holds, inputs_of

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
            assert abs(point_value(make.min_or_max(name, x, y)) - of) < 1e-9
        for op, holds_so in (("<", a < b), ("<=", a <= b), (">", a > b), (">=", a >= b)):
            assert make.compare(op, x, y) is holds_so
        if a != b or not any(kinds):
            assert make.compare("==", x, y) is (a == b)
            assert make.compare("!=", x, y) is (a != b)


def test_operators_of_ints() -> None:
    for a, b, kinds in itertools.product(
        (-7, -1, 0, 3), (-2, 1, 4), ((True, False), (False, True))
    ):
        terms = Terms()
        make = Operations(terms, rounded=True)
        x, y = (
            make.as_int(inputs_of(terms, (v, v))[0]) if term else v
            for v, term in zip((a, b), kinds, strict=True)
        )
        for op, of in (("+", a + b), ("-", a - b), ("*", a * b)):
            found = make.arithmetic(op, x, y)
            assert isinstance(found, SymbolicInt)
            assert found.radius.is_zero()
            assert point_value(found) == of
            assert make.arithmetic(op, a, b) == of
        for name, of in (("min", min(a, b)), ("max", max(a, b))):
            found = make.min_or_max(name, x, y)
            assert isinstance(found, SymbolicInt)
            assert point_value(found) == of
            assert make.min_or_max(name, a, b) == of
        for op in "/%":
            with pytest.raises(NotRecheckedError, match="ints that depend"):
                make.arithmetic(op, x, y)
        assert make.arithmetic("/", a, b) == math.trunc(a / b)
        assert make.arithmetic("%", a, b) == a - b * math.trunc(a / b)
        assert isinstance(make.negate(make.as_int(inputs_of(terms, (1.0, 2.0))[0])), SymbolicInt)


def test_an_int_of_inputs_is_exact_up_to_two_to_53() -> None:
    for low, high in ((-1.0, 2.0**53), (-(2.0**53), 1.0), (2.0**53, 2.0**53)):
        terms = Terms()
        (x,) = inputs_of(terms, (low, high))
        with pytest.raises(NotRecheckedError, match="2\\^53"):
            Operations(terms, rounded=True).as_int(x)
    terms = Terms()
    (x,) = inputs_of(terms, (1 - 2.0**53, 2.0**53 - 1))
    assert isinstance(Operations(terms, rounded=True).as_int(x), SymbolicInt)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_no_term(wrong: float) -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (0.0, 1.0))
    for a, b in ((x, wrong), (wrong, x)):
        for of in (make.arithmetic, make.compare, make.min_or_max):
            name = {"arithmetic": "+", "compare": "<", "min_or_max": "min"}[of.__name__]
            with pytest.raises(NotRecheckedError, match="infinite or undefined"):
                of(name, a, b)
    for a, b in ((wrong, 1.0), (1.0, wrong), (wrong, wrong)):
        if math.isnan(wrong):
            for of, name in ((make.compare, "<"), (make.min_or_max, "min")):
                with pytest.raises(NotRecheckedError, match="NaN"):
                    of(name, a, b)
        else:
            assert make.compare("<", a, b) is (a < b)
            assert make.min_or_max("min", a, b) == min(a, b)


def test_known_truths_are_compared() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (-1.0, 1.0))
    c = terms.below_zero(x)
    for op, known, other in itertools.product(("==", "!="), (True, False), (True, False)):
        found = make.compare(op, *((c, known) if other else (known, c)))
        for v in (-0.5, 0.5):
            same = (v < 0) == known
            assert holds(terms, found, [v]) is (same if op == "==" else not same)
    for a, b in itertools.product((True, False), repeat=2):
        assert make.and_of(a, b) is (a and b)
        assert make.or_of(a, b) is (a or b)
        assert make.negation(a) is (not a)


def test_both_sides_of_a_branch_are_joined() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (-1.0, 1.0))
    c = terms.below_zero(x)
    i = make.as_int(x)
    for a, b in ((1, 2), (1, 1.0), (0.0, -0.0), (i, 2), (3, i), (x, 2.0), (1.0, x), (x, i)):
        found: Any = make.choice_of(FLOAT, c, a, b)
        whole = any(isinstance(v, (int, SymbolicInt)) for v in (a, b))
        assert isinstance(found, SymbolicInt) is whole
        for v in (-0.5, 0.5):
            side = a if v < 0 else b
            wanted = v if isinstance(side, Linear) else side
            assert abs(at(terms, found, [v]) - wanted) < 1e-12
    for a, b in itertools.product((True, False, c, negation(c)), repeat=2):
        found = make.choice_of(FLOAT, c, a, b)
        for v in (-0.5, 0.5):
            side = a if v < 0 else b
            wanted_truth = side if isinstance(side, bool) else holds(terms, side, [v])
            truth = found if isinstance(found, bool) else holds(terms, found, [v])
            assert truth is wanted_truth
    pair = make.choice_of(FLOAT, c, (1.0, (2, True)), (1.0, (2, True)))
    assert pair == (1.0, (2, True))
    with pytest.raises(NotRecheckedError, match="length"):
        make.choice_of(FLOAT, c, (1.0,), (1.0, 2.0))


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
        value = prelude_function(Operations(terms, rounded=True), "atan", x)
        assert not terms.obligations
        assert (not value.rests) is inside
        for v in (-1.25, -0.75, 0.25, 1.25):
            if low <= v <= high:
                assert all(holds(terms, o, [v]) for o in value.rests) is (abs(v) <= 1)
        assert 2.0**-52 < terms.atoms[-1].share < 2.0**-52 * (1 + 2.0**-50)
        assert abs(float(value.low) - max(math.atan(low), -0.75)) < 1e-8
        assert abs(float(value.high) - min(math.atan(high), 0.5)) < 1e-8
    monkeypatch.setitem(BOUNDS, "atan", ErrorBound(((-1.0, 1.0),), relative=2.0))
    with pytest.raises(NotRecheckedError, match="another kind"):
        prelude_function(Operations(terms, rounded=True), "atan", x)


def test_what_a_function_may_be_off_counts_ulps_and_what_is_absolute(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for ulps, absolute in itertools.product((0.0, 1.0, 3.0), (0.0, 0.25)):
        bound = ErrorBound(((-math.inf, math.inf),), ulps=ulps, absolute=absolute)
        monkeypatch.setitem(BOUNDS, "exp", bound)
        for low, high in ((-1.0, 2.0), (-3.0, 1.0)):
            terms = Terms()
            (x,) = inputs_of(terms, (low, high))
            prelude_function(Operations(terms, rounded=True), "exp", x)
            share = ulps * exact(2.0**-52)
            assert share <= terms.atoms[-1].share <= share * (1 + exact(2.0**-50))
            assert abs(float(terms.atoms[-1].extra) - absolute) <= 1e-300
            assert not terms.obligations


def test_a_function_that_may_leave_the_doubles_is_bounded_where_it_is_used() -> None:
    for high, within in ((600.0, True), (709.0, True), (720.0, False), (2000.0, False)):
        terms = Terms()
        (x,) = inputs_of(terms, (0.0, high))
        value = prelude_function(Operations(terms, rounded=True), "exp", x)
        assert terms.obligations == []
        assert (not value.beyond) is within
        for v in (1.0, 700.0, 708.0, 711.0):
            if v <= high and v < 709:
                assert all(holds(terms, o, [v]) for o in value.beyond)
                assert math.isclose(at(terms, value, [v]), math.exp(v), rel_tol=1e-12)
        if not within:
            assert terms.atoms[value.atom].share > 0


def test_a_value_is_narrowed_to_where_it_has_to_be() -> None:
    for low, high in ((0, 3), (-2, 2), (1, 1)):
        terms = Terms()
        make = Operations(terms, rounded=True)
        i = make.as_int(inputs_of(terms, (-4.0, 4.0))[0])
        assert make.demand_between(i, low, high) is i
        for v in range(-4, 5):
            inside = low <= v <= high
            assert all(holds(terms, o, [float(v)]) for o in terms.obligations) is inside
            if inside:
                assert make.demand_between(v, low, high) == v
            else:
                with pytest.raises(StepFault):
                    make.demand_between(v, low, high)
        assert len(terms.obligations) == 2


def test_an_index_is_one_that_there_is() -> None:
    for index, size in itertools.product(range(-2, 4), range(4)):
        if index in range(size):
            assert index_in_range(index, size) == index
        else:
            with pytest.raises(StepFault):
                index_in_range(index, size)


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
        found = array_elements.element_at(make, elements, inputs_of(terms, (1.0, 1.0))[0])
        return array_elements.row_values(make, found) if isinstance(found, Rows) else found

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
    with pytest.raises(NotRecheckedError, match="indexed by an input"):
        array_elements.row_values(make, Rows(unlike, x))
    with pytest.raises(NotRecheckedError, match="indexed by an input"):
        array_elements.element_of_table(make, Rows(unlike, x), 0)
    with pytest.raises(NotRecheckedError, match="indexed by an input"):
        array_elements.element_of_table(make, Rows([(1.0, 2), (3.0, 4)], x), 0)
    for first in ((1.0, 2.0), (1, 2)):
        rows = Rows([first, first], x)
        found = array_elements.element_of_table(make, rows, 1)
        assert isinstance(found, SymbolicInt) is isinstance(first[0], int)
        assert at(terms, found, [1.0]) == 2.0


def test_a_table_of_one_entry_and_rows_of_unlike_parts() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (0.0, 0.0))
    assert at(terms, array_elements.element_at(make, [5.0], x), [0.0]) == 5.0
    assert at(terms, array_elements.element_of_table(make, Rows([(1.0, 6.0)], x), 1), [0.0]) == 6.0
    assert [
        at(terms, v, [0.0]) for v in array_elements.row_values(make, Rows([(1.0, 6.0)], x))
    ] == [
        1.0,
        6.0,
    ]
    first, rows = array_elements.element_at(make, [(1.0, (2.0, 3.0)), (4.0, (5.0, 6.0))], x)
    assert at(terms, first, [0.0]) == 1.0
    assert isinstance(rows, Rows)


def test_the_least_int_has_no_opposite_and_no_size() -> None:
    make = Operations(Terms(), rounded=True)
    for of in (make.negate, lambda x: make.result_of_builtin("abs", x)):
        with pytest.raises(StepFault):
            of(-(2**63))
    assert make.negate(2**63 - 1) == 1 - 2**63
    assert str(make.result_of_builtin("abs", -0.0)) == "0.0"


@pytest.mark.parametrize("rounded", [True, False])
def test_only_a_machine_rounds(rounded: bool) -> None:
    terms = Terms()
    make = Operations(terms, rounded=rounded)
    x, y = inputs_of(terms, (1.0, 2.0), (1.0, 3.0))
    values: list[Any] = [make.arithmetic(op, x, y) for op in "+-*/"] + [
        make.result_of_builtin("sqrt", x)
    ]
    assert [v.radius > 0 for v in values] == [rounded] * 5


def test_a_root_and_a_size_are_not_negative() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (0.0, 4.0))
    assert make.result_of_builtin("sqrt", x).nonnegative
    assert make.result_of_builtin("abs", x).nonnegative


@pytest.mark.parametrize(
    ("low", "high", "nonnegative", "wanted"),
    [
        (0.5, 3.0, False, (0, 3)),
        (-0.5, 3.0, True, (0, 3)),
        (-0.5, 3.0, False, (0, 3)),
        (-0.9, 0.9, False, (0, 0)),
        (-2.5, -0.5, False, (-2, 0)),
        (-3.0, 1.0, False, (-3, 1)),
    ],
)
def test_an_int_of_a_float_is_cut_off_towards_zero(
    low: float, high: float, nonnegative: bool, wanted: tuple[int, int]
) -> None:
    terms = Terms()
    (x,) = inputs_of(terms, (low, high))
    x.nonnegative = nonnegative
    whole: Any = Operations(terms, rounded=True).result_of_builtin("int", x)
    assert (whole.low, whole.high) == wanted
    assert len(terms.atoms) == 2


def test_a_number_less_itself_is_zero_however_it_was_rounded() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (-3.0, 3.0))
    y = terms.rounded_term(x)
    assert float(make.arithmetic("-", y, y).high) <= 5e-324
    assert at(terms, make.result_of_builtin("int", make.arithmetic("-", y, y)), [0.7]) == 0
    assert float(make.arithmetic("-", y, terms.rounded_term(x)).high) > 5e-324  # only alike


def test_a_function_may_be_off_near_zero_and_beyond_the_doubles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    terms = Terms()
    (x,) = inputs_of(terms, (0.0, 0.0))
    prelude_function(Operations(terms, rounded=True), "atan", x)
    assert terms.atoms[-1].extra > 0
    bound = ErrorBound(((-math.inf, math.inf),), ulps=1.0, absolute=0.25)
    monkeypatch.setitem(BOUNDS, "exp", bound)
    (x,) = inputs_of(terms, (0.0, 2000.0))
    value = prelude_function(Operations(terms, rounded=True), "exp", x)
    assert terms.atoms[value.atom].extra > 0.2


def test_floor_of_floor_is_no_more() -> None:
    terms = Terms()
    make = Operations(terms, rounded=True)
    (x,) = inputs_of(terms, (-3.0, 3.0))
    down: Any = make.result_of_builtin("floor", x)
    for of, same in (
        (down, True),
        (terms.combine(((exact(2.0), down),)), False),
        (terms.combine(((ONE, down),), exact(0.5)), False),
        (terms.combine(((ONE, down), (ONE, x))), False),
        (x, False),
        (terms.constant(2.0), False),
    ):
        before = len(terms.atoms)
        whole: Any = make.result_of_builtin("int", of)
        assert isinstance(whole, SymbolicInt)
        assert (len(terms.atoms) == before) is same
        for v in (-2.25, -0.5, 0.75, 2.5):
            assert at(terms, whole, [v]) == math.trunc(at(terms, of, [v]))
    assert type(make.result_of_builtin("float", whole)) is Linear
    assert isinstance(make.result_of_builtin("abs", whole), SymbolicInt)
    assert not isinstance(make.result_of_builtin("abs", x), SymbolicInt)
    with pytest.raises(NotRecheckedError, match="`seconds`"):
        make.result_of_builtin("seconds", x)
