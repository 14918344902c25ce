"""What is said to hold for all values holds for each that is tried, by the reference evaluator."""

from __future__ import annotations

from itertools import product
from random import Random
from typing import TYPE_CHECKING

import pytest

from generators.vacuous_tests import program
from long_tests import examples, seed_of
from soter.explore.constant_truth import holds_always
from soter.explore.vacuous_tests import Domains
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.evaluate.topic_ranges import MOST
from soter.language.front_end import check_file, system_of_test

if TYPE_CHECKING:
    from soter.language.model.system import System

CONDITIONS = examples(200)
INTS = ("x", "u", "late", "Half(x)", "LIMIT", "3", "9", "0", "-1", "1", "min(x, u)", "abs(u)")
FLOATS = ("f", "g", "0.0", "1.0", "0.5", "sqrt(g)", "f * f", "float(x)", "max(f, g)", "abs(g)")
AT = (0.0, 1.0, 0.5, 5e-324, -1.0, MOST, -MOST, 1e200, -1e-300, 0.1)
"""Values of the float without a set; those in [0, 1] of the other one."""


def number(dice: Random, ints: bool, depth: int = 2) -> str:
    if depth == 0 or dice.random() < 0.4:
        return dice.choice(INTS if ints else FLOATS)
    left, right = number(dice, ints, depth - 1), number(dice, ints, depth - 1)
    right = left if dice.random() < 0.15 else right
    return f"({left} {dice.choice(('+', '-', '*', '/', '%') if ints else '+-*/')} {right})"


def condition(dice: Random, depth: int = 2) -> str:
    if depth and dice.random() < 0.7:
        left, right = condition(dice, depth - 1), condition(dice, depth - 1)
        form = dice.choice(("{0} && {1}", "{0} || {1}", "!{0} || {1}", "({0} ? {1} : true)"))
        return f"({form.format(left, right)})"
    if dice.random() < 0.2:
        return dice.choice(
            ("y", "(!y)", "(light == Light.Red)", "(mode(M) == Mode.AC)", "Always(x)")
        )
    ints = dice.random() < 0.6
    left = number(dice, ints)
    right = left if dice.random() < 0.15 else number(dice, ints)
    return f"({left} {dice.choice(('<', '<=', '>', '>=', '==', '!='))} {right})"


@pytest.mark.whole
@pytest.mark.parametrize("chunk", range(2))
@pytest.mark.random
def test_what_holds_for_all_values_holds_for_each(chunk: int) -> None:
    dice = Random(seed_of(chunk))  # noqa: S311 - the same conditions every time are wanted
    texts = [condition(dice) for _ in range(CONDITIONS // 2)]
    checked = check_file("small.soter", program("".join(f"always {t}; " for t in texts)))
    assert checked.ok, [(d.code, d.message) for d in checked.diagnostics.items[:3]]
    system = system_of_test(checked, "T")
    domains = Domains(system)
    held = open_ = 0
    for p, text in zip(system.properties, texts, strict=True):
        always = holds_always(p.condition, True, p.scope, domains.scalar_range)
        never = holds_always(p.condition, False, p.scope, domains.scalar_range)
        assert not (always and never), text
        held += always or never
        open_ += not always and not never
        if not always and not never:
            continue
        judge = Evaluator.for_scope(p.scope).compiled(p.condition)
        for env in environments(system, dice):
            try:
                assert judge(env) == always, (text, env.topics)
            except StepFault:
                pytest.fail(f"{text} faults at {env.topics}")
    assert held > CONDITIONS // 40
    assert open_ > CONDITIONS // 4


def environments(system: System, dice: Random) -> list[Environment]:
    """Values of all topics: ints and modes all of them, floats by chance."""
    samples = []
    names = {t.name: t.index for t in system.topics}
    for x, u, y, light, mode in product(range(10), (-1, 0, 1), (False, True), (0, 2), (0, 1)):
        topics = [t.default for t in system.topics]
        for name, value in {
            "x": x,
            "u": u,
            "y": y,
            "light": light,
            "f": dice.choice(AT[:4]),
            "g": dice.choice(AT),
        }.items():
            topics[names[name]] = value
        samples.append(Environment(topics=topics, mode=(mode,).__getitem__))
    return samples
