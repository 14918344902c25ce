"""Each promise of Core, broken by hand, is told; what is lowered keeps all of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from soter.core import core, steps
from soter.core.core_check import broken_promises
from soter.core.steps import lower
from soter.diagnostics.diagnostic import Source, Span
from soter.language.evaluate.arithmetic import FaultKind
from soter.language.front_end import check_file, system_of
from soter.language.model.types import BOOL, FLOAT, INT, ArrayType, IntType, ListType, RecordType
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.core.core import CoreSystem
    from soter.language.model.system import System

    Lowered = Callable[[str], tuple[System, CoreSystem]]

EXAMPLES = sorted((Path(__file__).resolve().parents[3] / "examples").rglob("*.soter"))
PROGRAM = """
topic z: float; topic alarm: int;
fun half(v: float): float { return v / 2.0; }
fun next_of(n: int): int { return n + 1; }
fun first(a: float[3]): float { for v in a { if v > 0.0 { return v; } } return 0.0; }
node N period 20ms {
  publishes z, alarm[<=2];
  var n: int; var x: float; var on: bool; var a: float[3]; var xs: float[<=2];
  var spot: { p: float, turn: int in [0, 3] };
  step {
    publish z = half(first(a)); n = next_of(n); x = 1.0; on = true; a[0] = x; push xs, x;
    spot.p = 0.0; publish alarm = n;
  }
}
plant P period 10ms { drives h_seen = h; state h: float; state still: float = 1.0; der h = still; }
topic h_seen: float;
system S { node N; p: P; always p.truth.h < 9.0; until 1s; }
"""
AT = Span(Source("hand.soter", "\n"), 0, 0)
SMALL, SPOT = IntType(0, 3), RecordType((("p", FLOAT), ("turn", IntType(0, 3))))
ARRAY, LIST = ArrayType(FLOAT, 3), ListType(FLOAT, 2)
N, X, ON = core.Var(INT, "n"), core.Var(FLOAT, "x"), core.Var(BOOL, "on")
A, XS = core.Var(ARRAY, "a"), core.Var(LIST, "xs")
ONE, TRUE = core.Const(FLOAT, 1.0), core.Const(BOOL, True)
I = core.Var(INT, "i")  # noqa: E741 - as lowering calls it


def whole(value: int) -> core.Const:
    return core.Const(INT, value)


def let(value: core.Expr, name: str = "t") -> core.Let:
    return core.Let(AT, name, value)


def index(limit: core.Expr) -> core.Checked:
    return core.Checked(AT, "i", INT, "index", (N,), limit)


def assign(name: str, t: Any, value: core.Expr, *path: int | core.Expr) -> core.Set:
    return core.Set(AT, name, t, path, value)


def nonzero(divisor: core.Expr) -> core.Guard:
    return core.Guard(
        AT, core.Binary(BOOL, "!=", divisor, core.Const(FLOAT, 0.0)), FaultKind.DIVIDE
    )


QUOTIENT = let(core.Binary(FLOAT, "/", ONE, X), "q")
ELEMENT = let(core.Element(FLOAT, A, I), "e")
IN_LIST = let(core.Element(FLOAT, XS, I), "e")
LENGTH = core.Length(INT, XS)
INSIDE = core.Binary(BOOL, "<", I, LENGTH)

FINE: list[tuple[core.Stmt, ...]] = [
    (nonzero(X), QUOTIENT),
    (index(whole(3)), ELEMENT),
    (index(LENGTH), IN_LIST),
    (core.Loop(AT, "i", 0, 3, (ELEMENT,)),),
    (core.Loop(AT, "i", 0, 9, (core.If(AT, INSIDE, (IN_LIST,), ()),)),),
    (assign("spot", SPOT, whole(3), 1), core.Push(AT, "xs", LIST, (), ONE)),
]
BROKEN: list[tuple[tuple[Any, ...], str]] = [
    ((QUOTIENT,), "a divisor that was not guarded"),
    ((nonzero(X), assign("x", FLOAT, ONE), QUOTIENT), "a divisor that was not guarded"),
    ((core.If(AT, ON, (nonzero(X),), ()), QUOTIENT), "a divisor that was not guarded"),
    (
        (nonzero(X), core.Loop(AT, "k", 0, 2, (QUOTIENT, assign("x", FLOAT, ONE)))),
        "a divisor that was not guarded",
    ),
    (
        (nonzero(X), core.If(AT, ON, (assign("x", FLOAT, ONE),), ()), QUOTIENT),
        "a divisor that was not guarded",
    ),
    ((index(whole(4)), ELEMENT), "an index that may be outside"),
    ((core.Loop(AT, "i", -1, 3, (ELEMENT,)),), "an index that may be outside"),
    ((core.Loop(AT, "i", 0, 4, (ELEMENT,)),), "an index that may be outside"),
    ((core.Loop(AT, "i", 0, 2, (IN_LIST,)),), "an index that may be outside"),
    ((index(LENGTH), assign("xs", LIST, XS), IN_LIST), "an index that may be outside"),
    ((let(core.Element(FLOAT, A, whole(3))),), "an index that may be outside"),
    ((assign("a", ARRAY, ONE, N),), "an index that may be outside"),
    ((let(core.Binary(INT, "+", N, N)),), "Var is int, not float"),
    ((core.Loop(AT, "i", 0, 2.0, ()),), "ends 0 and 2.0 of a loop"),  # type: ignore[arg-type]
    ((core.Loop(AT, "i", 2, 1, ()),), "ends 2 and 1 of a loop"),
    ((let(core.Var(FLOAT, "y")),), "`y` is used before it is defined"),
    ((core.If(AT, ON, (let(X),), ()), let(core.Var(FLOAT, "t"), "u")), "`t` is used before"),
    ((core.Loop(AT, "i", 0, 2, ()), let(I)), "`i` is used before"),
    ((let(X), let(X)), "`t` is defined twice"),
    ((let(X), assign("t", FLOAT, ONE)), "`t` is changed, which is no variable here"),
    ((assign("y", FLOAT, ONE),), "`y` is changed, which is no variable here"),
    ((let(core.Var(INT, "x")),), "Var is float, not int"),
    ((assign("x", FLOAT, N),), "Var is int, not float"),
    ((assign("spot", SPOT, ONE, 2),), "Field is None"),
    ((core.Push(AT, "x", FLOAT, (), ONE),), "Const is float, not None"),
    ((core.Push(AT, "xs", LIST, (), N),), "Var is int, not float"),
    ((core.Guard(AT, X, FaultKind.ASSERT),), "Var is float, not bool"),
    ((core.If(AT, N, (), ()),), "Var is int, not bool"),
    ((core.Checked(AT, "t", INT, "root", (N,)),), "`root` of 1 operands"),
    ((core.Checked(AT, "t", FLOAT, "add", (N, N)),), "`add` gives no float"),
    ((core.Checked(AT, "t", INT, "add", (N, X)),), "Var is float, not int"),
    ((core.Checked(AT, "t", INT, "index", (N,)),), "the limit of `index`"),
    ((core.Checked(AT, "t", INT, "index", (N,), X),), "Var is float, not int"),
    ((core.Choose(AT, "t", BOOL, 0, 0),), "a choice among 0 of bool"),
    ((core.Choose(AT, "t", FLOAT, 2, 0),), "a choice among 2 of float"),
    ((core.Choose(AT, "t", BOOL, 2, 0, "ages"),), "`ages` is changed"),
    ((core.Call(AT, "t", "absent", (), FLOAT),), "`absent` does not stand before its call"),
    ((core.Call(AT, "t", "half", (), FLOAT),), "arguments of `half`"),
    ((core.Call(AT, "t", "half", (N,), FLOAT),), "Var is int, not float"),
    ((core.Call(AT, "t", "half", (X,), INT),), "`half` gives no int"),
    ((core.Publish(AT, 0, N),), "Var is int, not float"),
    ((core.Publish(AT, 2, X),), "output 2"),
    ((core.Publish(AT, 1, N),), "output 1"),
    ((core.Publish(AT, 1, N, 3),), "output 1"),
    ((let(core.Const(FLOAT, 1)),), "Const is None, not float"),
    ((let(core.Const(SMALL, 4)),), "Const is None, not int in [0, 3]"),
    ((let(core.Get(FLOAT, core.Cell("topic", 0, "other"))),), "Get is None, not float"),
    ((let(core.Get(INT, core.Cell("topic", 0, "z"))),), "Get is float, not int"),
    ((let(core.Get(FLOAT, core.Cell("state", 0, "absent"))),), "Get is None, not float"),
    ((let(core.Get(FLOAT, core.Cell("local", 1, "x"))),), "Get is None, not float"),
    ((let(core.Fact(FLOAT, "weather")),), "Fact is None, not float"),
    ((let(core.Unary(FLOAT, "sin", X)),), "Unary is None, not float"),
    ((let(core.Unary(FLOAT, "sqrt", N)),), "Var is int, not float"),
    ((let(core.Binary(BOOL, "<", ON, ON)),), "Var is bool, not None"),
    ((let(core.Binary(BOOL, "==", N, X)),), "Var is float, not int"),
    ((let(core.Binary(BOOL, "%", N, N)),), "Var is int, not None"),
    ((let(core.Binary(BOOL, "&&", ON, X)),), "Var is float, not bool"),
    ((let(core.Binary(BOOL, "+", X, X)),), "Binary is float, not bool"),
    ((let(core.Extreme(BOOL, "min", ON, ON)),), "Extreme is None, not bool"),
    ((let(core.Extreme(FLOAT, "mid", X, X)),), "Extreme is None, not float"),
    ((let(core.Select(FLOAT, ON, X, N)),), "Var is int, not float"),
    ((let(core.Select(FLOAT, X, X, X)),), "Var is float, not bool"),
    ((let(core.Field(FLOAT, X, 0)),), "Field is None, not float"),
    ((let(core.Field(FLOAT, core.Var(SPOT, "spot"), 1)),), "Field is int in [0, 3], not float"),
    ((let(core.Element(INT, A, whole(0))),), "Element is float, not int"),
    ((let(core.Element(FLOAT, A, X)),), "Var is float, not int"),
    ((let(core.Length(INT, A)),), "Length is None, not int"),
    ((let(core.Make(ARRAY, (X, X))),), "Make is None, not float[3]"),
    ((let(core.Make(LIST, (X, X, X))),), "Make is None, not float[<=2]"),
    ((let(core.Make(SPOT, (X, X))),), "Var is float, not int in [0, 3]"),
    ((nonzero(X), X), "Var is no statement"),
    ((core.Stmt(AT),), "Stmt is no statement"),
    ((core.Push(AT, "xs", LIST, (), nonzero(X)),), "Guard is no pure expression"),  # type: ignore[arg-type]
]


def told(lowered: Lowered, part: Callable[[CoreSystem], Any]) -> list[str]:
    system, made = lowered(PROGRAM)
    return broken_promises(system, {f.name: f for f in made.functions}, part(made))


@all_rows("body", FINE)
def test_a_step_that_keeps_its_promises_is_not_told(
    lowered: Lowered, body: tuple[core.Stmt, ...]
) -> None:
    assert told(lowered, lambda made: replace(made.nodes[1], body=body)) == []


@all_rows(("body", "message"), BROKEN)
def test_a_broken_promise_of_a_step_is_told_with_its_line(
    lowered: Lowered, body: tuple[core.Stmt, ...], message: str
) -> None:
    found = told(lowered, lambda made: replace(made.nodes[1], body=body))
    assert any(message in f for f in found), found
    assert all(f.startswith("hand.soter:1: ") for f in found if "`" in message)


def function(made: CoreSystem, name: str, **changed: Any) -> core.Function:
    return replace(next(f for f in made.functions if f.name == name), **changed)


V, FLAG, DONE = core.Var(FLOAT, "v"), core.Let(AT, "done", core.Const(BOOL, False), True), "done"
LEAVE = assign(DONE, BOOL, TRUE)
UNDONE = core.Unary(BOOL, "not", core.Var(BOOL, DONE))
VARIABLE = core.Let(AT, "r", ONE, True)
EFFECT = assign("r", FLOAT, V)


@all_rows(
    ("changed", "message"),
    [
        ({"result": TRUE}, "Const is bool, not float"),
        ({"result": None, "body": (let(V),)}, "a body without a result"),
        ({"body": (nonzero(V),)}, "it may fault and does not say so"),
        ({"body": (core.Call(AT, "t", "next_of", (whole(1),), INT),)}, "it may fault and does not"),
        ({"result": core.Get(FLOAT, core.Cell("topic", 0, "z"))}, "a function reads a state cell"),
        ({"result": core.Fact(FLOAT, "time")}, "a function reads `time`"),
        ({"body": (core.Choose(AT, "t", BOOL, 2, 0),)}, "a choice among 2 of bool"),
        ({"body": (core.Publish(AT, 0, V),)}, "output 0"),
        ({"body": (FLAG, VARIABLE, LEAVE, EFFECT), "leave": DONE}, "a statement after `return`"),
        (
            {"body": (FLAG, VARIABLE, core.Loop(AT, "i", 0, 2, (EFFECT, LEAVE))), "leave": DONE},
            "a statement after `return`",
        ),
        (
            {"body": (FLAG, VARIABLE, core.If(AT, TRUE, (LEAVE,), ()), EFFECT), "leave": DONE},
            "a statement after `return`",
        ),
        (
            {"body": (FLAG, VARIABLE, LEAVE, core.If(AT, TRUE, (EFFECT,), ())), "leave": DONE},
            "a statement after `return`",
        ),
        (
            {
                "body": (FLAG, VARIABLE, LEAVE, core.If(AT, UNDONE, (), (EFFECT,))),
                "leave": DONE,
            },
            "a statement after `return`",
        ),
    ],
)
def test_a_broken_promise_of_a_function_is_told(
    lowered: Lowered, changed: dict[str, Any], message: str
) -> None:
    found = told(lowered, lambda made: function(made, "half", **changed))
    assert any(message in f for f in found), found


def test_what_runs_only_before_a_return_may_stand_behind_it(lowered: Lowered) -> None:
    body = (FLAG, VARIABLE, LEAVE, let(V), core.If(AT, UNDONE, (EFFECT,), ()))
    assert told(lowered, lambda made: function(made, "half", body=body, leave=DONE)) == []


def test_a_function_does_not_call_itself(lowered: Lowered) -> None:
    system, made = lowered(PROGRAM)
    calls = core.Call(AT, "t", "half", (V,), FLOAT)
    found = broken_promises(system, {}, function(made, "half", body=(calls,)))
    assert found == ["hand.soter:1: `half` does not stand before its call"]


def test_what_a_step_changes_is_stored(lowered: Lowered) -> None:
    def forgetful(made: CoreSystem) -> core.NodeStep:
        step = made.nodes[1]
        return replace(step, locals=tuple(replace(c, written=False) for c in step.locals))

    found = told(lowered, forgetful)
    assert [f.split("`")[1] for f in found] == ["n", "x", "on", "a", "xs", "spot"]


def test_temporaries_of_an_integration_and_of_a_takeover_end_with_it(lowered: Lowered) -> None:
    seen = (core.Publish(AT, 0, core.Var(FLOAT, "t")),)
    before = (let(ONE),)
    plant = told(lowered, lambda made: replace(made.plants[0], integrate=before, publish=seen))
    node = told(lowered, lambda made: replace(made.nodes[1], takeover=before, body=seen))
    assert plant == node == ["hand.soter:1: `t` is used before it is defined"]
    assert told(lowered, lambda m: replace(m.plants[0], choose=before, publish=seen)) == []


def test_a_predicate_is_a_truth_or_a_number(lowered: Lowered) -> None:
    system, made = lowered(PROGRAM)
    for value, count in ((TRUE, 0), (ONE, 0), (whole(1), 1)):
        assert len(broken_promises(system, {}, replace(made.properties[0], value=value))) == count


def test_lowering_asserts_that_nothing_is_broken(
    lowered: Lowered, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(steps, "broken_promises", lambda *_: ["a promise"])
    with pytest.raises(AssertionError, match="a promise"):
        lowered(PROGRAM)


@pytest.mark.long
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: f"{p.parent.name}/{p.stem}")
def test_every_example_keeps_the_promises(path: Path) -> None:
    """Lowering asserts it. A file that others import is no program by itself."""
    checked = check_file(str(path))
    for name in checked.systems if checked.ok else ():
        assert lower(system_of(checked, name)).functions is not None
