"""`choose`: what the checker makes of it, and how it is evaluated."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file, system_of
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.model.types import ArrayType, IntType

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

NODE = """soter 1;
type Move = enum {{ Left, Stay, Right }};
type Small = int in [-2, 2];
topic t : {type};
node A period 10ms {{ publishes t; var n: int; step {{ {before} publish t = {value}; }} }}
system S {{ node A; until 1s; }}
"""


class Picks:
    """Answers choices in order, and remembers between how many they were."""

    def __init__(self, *picks: int) -> None:
        self.picks: Iterator[int] = iter(picks)
        self.counts: list[int] = []

    def __call__(self, count: int) -> int:
        self.counts.append(count)
        return next(self.picks)


def step(
    choose: Callable[[int], int] | None, of: str, value: str, before: str = ""
) -> tuple[object, dict[str, object]]:
    """What the node publishes, and its locals after the step."""
    text = NODE.format(type=of, value=value, before=before)
    system = system_of(check_file("test.soter", text), "S")
    component = system.component("A")
    assert component.node is not None
    variables = dict(zip(component.node.locals, component.initial, strict=True))
    env = Environment(variables, choose=choose)
    Evaluator.for_scope(component.scope).compiled_block(component.node.step)(env)
    return env.published[0], {v.name: env.variables[v] for v in component.node.locals}


@pytest.mark.parametrize(
    ("of", "value", "found"),
    [
        ("bool", "choose bool", [False, True]),
        ("Move", "choose Move", [0, 1, 2]),
        ("Small", "choose Small", [-2, -1, 0, 1, 2]),
        ("int", "choose [3, 3 + 2]", [3, 4, 5]),
        ("float", "choose { 0, 0.5, -n }".replace("-n", "float(n)"), [0.0, 0.5, 0.0]),
        ("{ a: int, b: bool }", "choose { { a: 1, b: true }, { b: false, a: 2 } }",
         [(1, True), (2, False)]),
        ("Move", "fair choose Move", [0, 1, 2]),
    ],
)  # fmt: skip
def test_the_value_is_the_picked_alternative(of: str, value: str, found: list[object]) -> None:
    for pick, expected in enumerate(found):
        asked = Picks(pick)
        published, _ = step(asked, of, value)
        assert published == expected
        assert type(published) is type(expected)
        assert asked.counts == [len(found)]


def test_options_are_evaluated_from_left_to_right_before_the_choice() -> None:
    asked = Picks(2, 4, 1)
    published, _ = step(asked, "int", "choose { choose [0, 2], 10 + choose [0, 4] }")
    assert asked.counts == [3, 5, 2]
    assert published == 14


def test_a_side_that_is_not_evaluated_chooses_nothing() -> None:
    asked = Picks(0, 1)
    published, _ = step(asked, "int", "n > 0 && choose bool ? 1 : choose { 7, 8 } + choose [0, 1]")
    assert asked.counts == [2, 2]
    assert published == 8


def test_a_fair_choice_remembers_what_it_took() -> None:
    _, after = step(Picks(2), "Move", "fair choose Move")
    assert after["fair 1"] == (1, 1, 0)


def test_a_fair_choice_asks_only_among_what_is_allowed() -> None:
    asked = Picks(0, 0, 0, 0, 0)
    before = "for i in 0..5 { if fair choose bool { n = n + 1; } }"
    _, after = step(asked, "int", "n", before)
    assert asked.counts == [2, 2, 2, 1, 2]
    assert after["n"] == 1


def test_each_fair_choice_has_a_hidden_local_of_its_own() -> None:
    _, after = step(Picks(0, 1), "int", "fair choose [0, 1] + fair choose [0, 2]")
    assert list(after) == ["n", "fair 1", "fair 2"]
    assert after["fair 1"] == (0, 1)
    assert after["fair 2"] == (1, 0, 1)
    checked = check_file(
        "test.soter", NODE.format(type="Move", value="fair choose Move", before="")
    )
    assert checked.program is not None
    (_, ages) = checked.program.nodes["A"].locals
    assert ages.type == ArrayType(IntType(0, 255), 3)


def test_nobody_chooses_where_nobody_was_named() -> None:
    with pytest.raises(RuntimeError, match="nobody chooses between 2 alternatives"):
        step(None, "bool", "choose bool")


def test_walks_see_the_options_of_a_choice() -> None:
    text = NODE.format(type="int", value="choose { n, 2 * n }", before="")
    checked = check_file("test.soter", text)
    assert checked.program is not None
    kinds = [type(n) for n in nodes(checked.program.nodes["A"].step)]
    assert kinds.count(typed.VarRead) == 2
