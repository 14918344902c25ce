"""Core executed over sets of possible values, the plainest domain there is.

Of one value a set is a run of the program; of several it must hold what every run gives.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import pytest

from soter.core import core
from soter.core.execution import NO, Execution, TooManyStatementsError

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from soter.core.core import CoreSystem
    from soter.core.execution import Join
    from soter.language.model.system import System

    Lowered = Callable[[str], tuple[System, CoreSystem]]
    Values = frozenset[Any]

PROGRAM = """
input topic a: int in [0, 3] = 0; input topic b: int in [0, 3] = 0; input topic c: bool;
type Pair = { low: int, high: int };
topic pair: Pair; topic kept: int[<=3]; topic one: int; topic every: int;
fun first(p: Pair, n: int): int {
  let a = p.low;
  for i in 0..3 { if i + a >= n { return i; } }
  return 9;
}
node N period 10ms {
  subscribes a, b, c; publishes pair, kept, one, every;
  var count: int;
  step {
    var p: Pair = { low: a, high: b };
    var list: int[<=3] = [];
    if c && a > b { p.low = b; p.high = a; if a > 2 { publish one = p.high; } }
    for k in 0..3 { if k < p.high { push list, k * p.low; } }
    let found = first(p, 3);
    count = c ? found : a - b;
    publish pair = p; publish kept = list; publish every = found + p.low;
  }
}
system S { node N; until 1s; }
"""
INTS: dict[str, Callable[..., Any]] = {
    "+": lambda a, b: a + b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "==": lambda a, b: a == b,
    "&&": lambda a, b: a and b,
    "||": lambda a, b: a or b,
    "not": lambda a: not a,
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
}


class PossibleValues(Execution["Values"]):
    """Every value a frozen set; `inputs` by name."""

    def __init__(self, lowered: CoreSystem, inputs: dict[str, Values]) -> None:
        super().__init__({f.name: f for f in lowered.functions})
        self.inputs = inputs
        self.where = ()

    def _operation_value(self, e: core.Expr, *operands: Values) -> Values:
        if isinstance(e, core.Const):
            return frozenset({e.value})
        if isinstance(e, core.Get):
            return self.inputs[e.cell.name]
        if isinstance(e, core.Select):
            return operands[1] | operands[2]
        return frozenset(_value(e, *given) for given in product(*operands))

    def _decided_truth(self, condition: Values) -> bool | None:
        return next(iter(condition)) if len(condition) == 1 else None

    def _where_in_side(self, where: Any, _: Values, truth: bool) -> Any:
        return (*where, truth)

    def _join_function(self, _: Values, *where: Any) -> Join[Values]:
        assert [path[-1] for path in where] == [True, False]
        return lambda a, b, _t: (a or frozenset()) | (b or frozenset())

    def _checked_value(self, s: core.Checked, operands: list[Values], _: Values | None) -> Values:
        return frozenset(INTS[s.op](*given) for given in product(*operands))

    def _chosen_value(self, s: core.Choose) -> Values:
        raise NotImplementedError

    def _guard(self, condition: Values) -> None:
        raise NotImplementedError

    def _with_part(
        self, s: core.Set | core.Push, old: Values, path: list[int | Values], value: Values
    ) -> Values:
        if not path:
            both = product(old, value)
            return frozenset((*x, y) for x, y in both) if isinstance(s, core.Push) else value
        (k,) = path
        assert isinstance(k, int)
        return frozenset((*x[:k], y, *x[k + 1 :]) for x, y in product(old, value))


def _value(e: core.Expr, *given: Any) -> Any:
    if isinstance(e, (core.Binary, core.Unary)):
        return INTS[e.op](*given)
    if isinstance(e, core.Field):
        return given[0][e.index]
    assert isinstance(e, core.Make), e
    return given


def expected(a: int, b: int, *, c: bool) -> dict[str, object]:
    """The step of N, said once more."""
    swapped = c and a > b
    low, high = (b, a) if swapped else (a, b)
    found = next((i for i in range(3) if i + low >= 3), 9)
    return {
        "pair": (low, high),
        "kept": tuple(k * low for k in range(3) if k < high),
        "one": high if swapped and a > 2 else None,
        "every": found + low,
        "count": found if c else a - b,
    }


def executed(
    lowered: tuple[System, CoreSystem], a: set[int], b: set[int], c: set[bool]
) -> dict[str, Values]:
    """What the step of N leaves; for `one` None among the values where it may not be published."""
    system, program = lowered
    (step,) = program.nodes.values()
    inputs = {"a": frozenset(a), "b": frozenset(b), "c": frozenset(c)}
    execution = PossibleValues(program, inputs)
    for x in step.locals:
        execution.bind(x.name, x.type, frozenset({0}))
    execution.run(step.body)
    outputs = execution.frame.outputs
    result = {x.cell.name: execution.frame.variables[x.name] for x in step.locals}
    for k, output in enumerate(step.outputs):
        nothing: Values = frozenset()
        whether, value, _ = outputs.get(k, (execution.expr(NO), nothing, output.type))
        result[system.topics[output.topic].name] = value | ({None} if False in whether else set())
    return result


def test_with_one_value_of_every_input_it_is_a_run(lowered: Lowered) -> None:
    program = lowered(PROGRAM)
    for a, b, c in product(range(4), range(4), (False, True)):
        run = {name: {value} for name, value in expected(a, b, c=c).items()}
        assert executed(program, {a}, {b}, {c}) == run, (a, b, c)


@pytest.mark.parametrize("c", [{True}, {False, True}])
def test_with_several_values_it_holds_every_run(lowered: Lowered, c: set[bool]) -> None:
    program = lowered(PROGRAM)
    some = [{0, 3}, {1, 2}, {0, 1, 2, 3}]
    for a, b in product(some, some):
        every = executed(program, a, b, c)
        for x, y, z in product(a, b, c):
            for name, value in expected(x, y, c=z).items():
                assert value in every[name], (name, x, y, z)


def test_only_so_many_statements_are_followed(lowered: Lowered) -> None:
    _, program = lowered(PROGRAM)
    (step,) = program.nodes.values()
    one = frozenset({1})
    execution = PossibleValues(program, {"a": one, "b": one, "c": frozenset({True})})
    execution.left = 10
    with pytest.raises(TooManyStatementsError):
        execution.run(step.body)
