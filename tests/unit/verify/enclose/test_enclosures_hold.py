"""Functions of random programs: what the evaluator gives lies in the enclosure.

Every function of a random program (branches, loops, lists, ints, prelude; sometimes wild floats) is
emitted over forms. Random boxes of its arguments are enclosed once, and the evaluator's results at
corners and inside are looked for: in the interval, and in the first-order part at their eps. Where
the evaluator faults, the enclosure must say that a fault is possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from generators.engine_comparison import subject
from generators.python_enclosures import (
    INPUTS,
    Compiled,
    Enclosure,
    enclosure,
    holds,
    numbers_of,
    seeded,
    value_of,
)
from generators.random_programs import program
from soter.core.lower_statements import FunctionTable
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file, system_of
from soter.language.model.types import BoolType, EnumType, FloatType, IntType, leaf_count

if TYPE_CHECKING:
    import random
    from collections.abc import Callable, Iterator

    from generators.python_enclosures import Statics
    from soter.language.model.system import System
    from soter.language.model.typed import FunSymbol
    from soter.language.model.types import Type

FIRST, PROGRAMS, BOXES, POINTS = 1, 30, 25, 10
MORE_BOXES = 250
EVERY_STATEMENT = Path(__file__).parent / "every_statement.soter"
WILD = (
    0.0, -0.0, 1e308, -1e300, 5e-324, 1e-310, 2.0**53, 1e16, math.inf, -math.inf,
    4503599627370495.5, 1.0,
)  # fmt: skip
EXACT_INT = 2**53


@dataclass
class Subject:
    """A function with its enclosure and its meaning."""

    number: int
    enclosure: Enclosure
    fun: FunSymbol
    call: Callable[..., Any]


def functions(
    system: System, statics: Statics
) -> Iterator[tuple[FunSymbol, Callable[..., Any], Any]]:
    """Functions of a program that have few enough scalars."""
    table = FunctionTable(system)
    params = {p: system.params[p.name] for p in system.program.params.values()}
    evaluator = Evaluator(params)
    for fun in system.program.funs.values():
        if fun.body is None or fun.span.source.name.startswith("<prelude>"):
            continue
        if sum(leaf_count(p.type) for p in fun.parameters) <= INPUTS:
            lowered = table.lowered_function(fun, params)

            def made(name: str, table: FunctionTable = table, lowered: Any = lowered) -> Enclosure:
                return enclosure(name, table.by_name, lowered, statics)

            yield fun, evaluator.closure_of(fun), made


def box(rng: random.Random, t: Type) -> tuple[float, float]:
    """A range for one scalar."""
    if isinstance(t, FloatType):
        kind = rng.random()
        if kind < 0.1:
            x = rng.choice(WILD)
            return x, x
        if kind < 0.15:
            low, high = sorted((rng.choice(WILD), rng.choice(WILD)))
            return low, high
        middle = rng.choice((0.0, 0.0, rng.uniform(-5, 5), rng.uniform(-100, 100)))
        width = 10.0 ** rng.uniform(-6, 1.5)
        return middle - width * rng.random(), middle + width * rng.random()
    if isinstance(t, BoolType):
        return rng.choice(((0.0, 0.0), (1.0, 1.0), (0.0, 1.0)))
    assert isinstance(t, (IntType, EnumType))
    low, high = (t.low, t.high) if isinstance(t, IntType) else (0, len(t.members) - 1)
    low, high = max(low, -(2**62)), min(high, 2**62)
    if rng.random() < 0.9 and max(low, -12) <= min(high, 12):
        low, high = max(low, -12), min(high, 12)
    a, b = sorted((rng.randint(low, high), rng.randint(low, high)))
    return float(a), float(a if rng.random() < 0.4 else b)


def point(rng: random.Random, t: Type, low: float, high: float) -> float:
    """A value in a range: an end or anything."""
    if not isinstance(t, FloatType):
        return float(rng.randint(int(low), int(high)))
    kind = rng.random()
    if kind < 0.5 or low == high:
        return low if kind < 0.25 else high
    if math.isinf(high - low):
        return 0.0 if low <= 0.0 <= high else low
    return min(max(low + (high - low) * rng.random(), low), high)


def said(form: Any, number: float, forms: Any, at: list[float]) -> bool:
    """Whether an enclosure holds a result; ints beyond 2^53 have no first-order part to test."""
    if isinstance(number, int) and abs(number) > EXACT_INT:
        return bool(form.lo <= number <= form.hi)
    return holds(form, float(number), forms, at)


def missed(compiled: Compiled, s: Subject, rng: random.Random, tally: dict[str, int]) -> list[str]:
    """What an enclosure got wrong on one box."""
    boxes = [box(rng, t) for t in s.enclosure.parameters]
    forms = compiled.inputs(boxes)
    out, fault = compiled.result_of(s.enclosure, forms)
    wrong = []
    for _ in range(POINTS):
        at = [point(rng, t, *b) for t, b in zip(s.enclosure.parameters, boxes, strict=True)]
        numbers = iter(at)
        arguments = [value_of(p.type, numbers) for p in s.fun.parameters]
        try:
            result = s.call(Environment(), arguments)
        except StepFault:
            tally["faults"] += 1
            if not fault:
                wrong.append(f"program {s.number}, {s.fun.name}{arguments}: a fault")
            continue
        for i, number in enumerate(numbers_of(s.fun.result, result)):
            if number is None:
                continue
            tally["results"] += 1
            tally["of first order"] += out[i].r < math.inf
            tally["decided"] += fault == 0
            if not said(out[i], number, forms, at):
                wrong.append(f"program {s.number}, {s.fun.name}{arguments}: {i} is {number!r}")
    return wrong


def test_results_of_random_functions_lie_in_their_enclosures(tmp_path: Path) -> None:
    statics: Statics = {}
    subjects: list[Subject] = []
    for number in range(FIRST, FIRST + PROGRAMS):
        system = subject(f"p{number}", program(number), 1, 3).system
        for fun, call, made in functions(system, statics):
            subjects.append(Subject(number, made(f"soter_f{len(subjects)}"), fun, call))
    compiled = Compiled([s.enclosure for s in subjects], statics, tmp_path)
    rng = seeded(FIRST)
    tally = {"results": 0, "faults": 0, "of first order": 0, "decided": 0}
    wrong: list[str] = []
    for s in subjects:
        for _ in range(BOXES):
            wrong += missed(compiled, s, rng, tally)
    assert not wrong, "\n".join(wrong[:10])
    assert len(subjects) >= PROGRAMS
    assert tally["results"] > 10_000, tally
    assert tally["faults"] > 50, tally
    assert tally["of first order"] > tally["results"] / 2, tally
    assert tally["decided"] > tally["results"] / 2, tally


def test_every_statement_is_enclosed(tmp_path: Path) -> None:
    """Each function of a program written for it, on many boxes."""
    statics: Statics = {}
    system = system_of(check_file(str(EVERY_STATEMENT), EVERY_STATEMENT.read_text("utf-8")), None)
    subjects = [
        Subject(k, made(f"soter_f{k}"), fun, call)
        for k, (fun, call, made) in enumerate(functions(system, statics))
    ]
    compiled = Compiled([s.enclosure for s in subjects], statics, tmp_path)
    rng = seeded(2)
    for s in subjects:
        tally = {"results": 0, "faults": 0, "of first order": 0, "decided": 0}
        wrong: list[str] = []
        for _ in range(MORE_BOXES):
            wrong += missed(compiled, s, rng, tally)
        assert not wrong, "\n".join(wrong[:10])
        assert tally["results"] > MORE_BOXES, (s.fun.name, tally)
        assert tally["decided"] > 0, (s.fun.name, tally)
