"""Predicates with their functions inlined: the text that people read is the predicate."""

from __future__ import annotations

import random
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from long_tests import examples
from soter.api import load
from soter.api.assurance import predicate_inlining
from soter.api.assurance.predicate_inlining import expanded_predicates
from soter.language.evaluate.arithmetic import StepFault
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import Literal, TopicRead
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.language.model.system import Module, System
    from soter.language.model.typed import TypedExpr
    from soter.language.model.types import Type
    from soter.report.safety_case import ExpandedPredicate

ROOT = Path(__file__).resolve().parents[3]
POINTS = examples(60)
CORNERS = """soter 1;
const A: float = 3.0;
const LOW: int = -2;
const HERE: { x: float, y: float } = { x: 1.5, y: -0.5 };
param GAIN: float = 0.75 in [0.5, 2.0];
type Mode = enum { Off, On };
topic m: { x: float, v: float, p: { x: float, y: float }, k: int in [-3, 3], on: Mode };
topic v: float = 0.0;
topic u: float in [-1.0, 1.0];
plant P period 10ms { reads u; drives m = { x: s, v: u, p: { x: s, y: s }, k: 0, on: Mode.On };
  drives v = s; state s: float = 0.0; der s = u; }
node N period 10ms { subscribes m; publishes u; step { publish u = 0.0; } }
fun Square(x: float): float { return x * x; }
fun Need(v: float, t: float): float {
  let w = max(v, -v) + 0.05;
  return w * w / (2.0 * (A - 0.4)) - -t;
}
fun Pick(k: int, x: float): float {
  if k < 0 { let y = x - 1.0 - 2.0; return -y; } elseif k < 1 { return x; }
  let y = x / (2.0 / 4.0);
  return k > 1 ? y : k > 2 ? -(-y) : (y - (x - 1.0));
}
fun Moved(p: { x: float, y: float }, d: float): { x: float, y: float } {
  return { y: p.y - d, x: p.x + d };
}
fun Both(a: bool, b: bool): bool { return (a || b) && !(a && b); }
fun Far(p: { x: float, y: float }): float { return norm(2.0 * p - (p + HERE)) / (1.0 + GAIN); }
fun Sum(x: float): float { var s: float = 0.0; for i in 0..3 { s = s + Square(x); } return s; }
rta M {
  ac N; sc N2; period 50ms;
  safe Square(m.x - m.v) - Square(m.x) < A * (1.0 + GAIN) && !(m.v > 2.0 || m.v < -2.0)
    || Far(m.p) < 0.5;
  ttf Both(Need(m.v, 0.12) < Need(-m.v, 0.3) + Need(m.x, 0.1), Pick(m.k, m.x) > 0.0)
    == (m.on == Mode.On)
    || Square(Square(m.v) - Square(v)) > 1.0 - (A - 1.0 - 0.5);
  safer Far(Moved(m.p, 0.25)) > Pick(m.k + LOW, v)
    || Moved(Moved(m.p, 1.0), m.x).y < Sum(v) && m.x > 0.0;
}
node N2 period 10ms { subscribes m; publishes u; step { publish u = 0.0; } }
system S { p: P; module M; until 1s; }
"""
SUBJECTS = (
    *("wall/cart", "wall/lift", "wall/shuttle", "exploration/people", "drone/motion_primitive"),
    *("generality/lane", "generality/drag", "ros/ground_robot", "fleet/robot"),
)


def type_text(t: Type) -> str:
    """A type as another file says it: records by their fields."""
    if isinstance(t, RecordType):
        return "{ " + ", ".join(f"{n}: {type_text(f)}" for n, f in t.fields) + " }"
    if isinstance(t, ArrayType):
        return f"{type_text(t.element)}[{t.size}]"
    return f"p.{t}" if isinstance(t, EnumType) else str(t)


def drawn(t: Type, chance: random.Random, near: list[float]) -> Any:
    """A value, often one of the constants that the predicate names."""
    if isinstance(t, RecordType):
        return tuple(drawn(f, chance, near) for _, f in t.fields)
    if isinstance(t, ArrayType):
        return tuple(drawn(t.element, chance, near) for _ in range(t.size))
    if isinstance(t, EnumType):
        return chance.randrange(len(t.members))
    if isinstance(t, BoolType):
        return chance.random() < 0.5
    if isinstance(t, IntType):
        return chance.randint(max(t.low, -5), min(t.high, 5))
    assert isinstance(t, FloatType)
    if chance.random() < 0.05:
        return chance.choice([float("nan"), float("inf"), -0.0])
    return chance.choice(near) * chance.choice([-1.0, 0.5, 1.0]) + chance.gauss(0.0, 0.5)


def reread(
    folder: Path, told: ExpandedPredicate, topics: dict[str, Type], program: Path
) -> Callable[[list[Any]], bool]:
    """The text of an expansion, compiled anew: names are lets, topics are arguments."""
    calls = "|".join(d.name for d in told.functions) or "(?!)"

    def text_of(text: str) -> str:
        text = re.sub(rf"\b({calls})\(", r"p.\1(", text)
        return re.sub(r"\b(Mode)\.", r"p.\1.", text)

    values = [(d.name, re.sub(r'"(\w+)":', r"\1:", d.text)) for d in told.constants]
    lets = [f"let {name} = {value};" for name, value in values]
    lets += [f"let {d.name} = {text_of(d.text)};" for d in told.where]
    arguments = ", ".join(f"{name}: {type_text(t)}" for name, t in topics.items())
    source = f'soter 1;\nimport "{program}" as p;\nfun Told({arguments}): bool {{\n  '
    source += "\n  ".join([*lets, f"return {text_of(told.expanded)};"]) + "\n}\n"
    path = folder / f"{told.module}_{told.name}.soter"
    path.write_text(source)
    checked = check_file(str(path))
    assert checked.ok, checked.diagnostics
    assert checked.program is not None
    fun = checked.program.funs["Told"]
    compiled = Evaluator({}, {}).closure_of(fun)
    return lambda values: bool(compiled(Environment(), values))


def agree(folder: Path, program: Path, system: System, module: Module) -> int:
    """Compare each predicate of a module with its expansion; how often both had a value."""
    compared = 0
    predicates: dict[str, TypedExpr | None] = {
        name: getattr(module.symbol, name) for name in ("safe", "ttf", "safer")
    }
    for told in expanded_predicates(system, module):
        predicate = predicates[told.name]
        if predicate is None:
            assert (told.written, told.expanded, told.where) == ("", "", ())
            continue
        read = {n.topic: n for n in nodes([predicate]) if isinstance(n, TopicRead)}
        topics = {system.topics[module.scope.topics[t]].name: t.type for t in read}
        again = reread(folder, told, topics, program)
        written = Evaluator.for_scope(module.scope).compiled(predicate)
        near = [float(d.text) for d in told.constants if re.fullmatch(r"-?[\d.e-]+", d.text)]
        near += [
            n.value for n in nodes([predicate]) if isinstance(n, Literal) and n.type == FloatType()
        ]
        chance = random.Random(f"{told.module} {told.name}")  # noqa: S311 - no secret
        for _ in range(POINTS):
            values = [drawn(t, chance, [1.0, *near]) for t in topics.values()]
            seen: list[Any] = [None] * len(system.topics)
            for t, value in zip(read, values, strict=True):
                seen[module.scope.topics[t]] = value
            try:
                said = bool(written(Environment(topics=seen)))
                assert again(values) == said, (told.name, values)
            except StepFault:
                continue
            compared += 1
    return compared


@pytest.fixture
def corners(tmp_path: Path) -> Path:
    (tmp_path / "corners.soter").write_text(CORNERS)
    return tmp_path / "corners.soter"


def test_brackets_branches_records_and_names_keep_the_value(tmp_path: Path, corners: Path) -> None:
    system = load(corners).declared("S")
    assert agree(tmp_path, corners, system, system.modules[0]) > 2 * POINTS


@pytest.mark.parametrize("name", SUBJECTS)
def test_the_expansion_of_an_example_has_the_value_of_its_predicate(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(predicate_inlining, "VALUE_MAX", 10**6)
    path = ROOT / "examples" / f"{name}.soter"
    system = load(path).declared()
    compared = sum(agree(tmp_path, path, system, m) for m in system.modules)
    assert compared > POINTS // 2


def test_no_call_of_an_own_function_is_left_but_those_with_their_text(corners: Path) -> None:
    system = load(corners).declared("S")
    own = set(system.program.funs)
    for told in expanded_predicates(system, system.modules[0]):
        calls = set(
            re.findall(r"(\w+)\(", " ".join([told.expanded, *(d.text for d in told.where)]))
        )
        assert calls & own == ({"Sum"} if told.name == "safer" else set())
        texts = {d.name: d.text for d in told.functions}
        assert list(texts) == (["Sum", "Square"] if told.name == "safer" else [])
        if texts:
            assert texts["Square"] == "Square(x: float): float { return x * x; }"
            assert texts["Sum"].endswith("return s; }")


def test_constants_and_topics_come_with_values_and_units() -> None:
    system = load(ROOT / "examples" / "wall" / "cart.soter").declared()
    safe, ttf, _ = expanded_predicates(system, system.modules[0])
    assert (safe.expanded, ttf.expanded) == (
        "abs(motion.x) < WALL",
        "Room < 0.0 || abs(motion.v) > FAST",
    )
    assert [(d.name, d.text) for d in safe.constants] == [("WALL", "10.0")]
    assert [(d.name, d.unit) for d in ttf.read] == [("motion.v", "m/s"), ("motion.x", "m")]


def test_a_parameter_has_the_value_of_its_system(corners: Path) -> None:
    system = load(corners).declared("S", {"GAIN": 1.5})
    safe, *_ = expanded_predicates(system, system.modules[0])
    assert {d.name: d.text for d in safe.constants}["GAIN"] == "1.5"


PART = """soter 1;
const LIMIT: float = 3.0;
param GAIN: float = 2.0;
fun Scaled(x: float): float {
  var s: float = 0.0; for i in [0, 1] { s = s + GAIN * x; } return s;
}
fun Sum(x: float): float {
  /* } */ var s: float = 0.0; // {
  for i in [0, 2] { s = s + LIMIT * Scaled(x); assert s < 9.0, "}"; }
  return s; /* the end */
}
"""
BOTH = """soter 1;
import "left.soter" as left;
import "right.soter" as right;
const LIMIT: float = 10.0;
topic x: float;
topic u: float in [0.0, 1.0];
plant P period 10ms { reads u; drives x = s; state s: float; der s = u; }
node N period 10ms { publishes u; step { publish u = 0.0; } }
node N2 period 10ms { publishes u; step { publish u = 1.0; } }
rta M {
  ac N2; sc N; period 50ms; safe left.Sum(x) < LIMIT && right.Sum(x) < LIMIT;
  ttf x > 1.0; safer x < 0.0;
}
system S { p: P; module M; until 1s; }
"""


def test_functions_of_two_imports_are_told_apart_with_the_values_that_each_reads(
    tmp_path: Path,
) -> None:
    (tmp_path / "left.soter").write_text(PART)
    right = PART.replace("= 3.0", "= 7.0").replace("= 2.0", "= 5.0")
    (tmp_path / "right.soter").write_text(right)
    (tmp_path / "both.soter").write_text(BOTH)
    system = load(tmp_path / "both.soter").declared("S")
    safe, *_ = expanded_predicates(system, system.modules[0])
    assert safe.expanded == "Sum(x) < LIMIT_2 && Sum_2(x) < LIMIT_2"
    assert {d.name: d.text for d in safe.constants} == {
        "LIMIT": "3.0",
        "GAIN": "2.0",
        "LIMIT_2": "10.0",
        "LIMIT_3": "7.0",
        "GAIN_2": "5.0",
    }
    texts = {d.name: d.text for d in safe.functions}
    assert list(texts) == ["Sum", "Scaled", "Sum_2", "Scaled_2"]
    assert texts["Sum"].endswith("/* the end */\n}")
    assert texts["Sum_2"].endswith("}  // LIMIT is LIMIT_3, Scaled is Scaled_2")
    assert texts["Scaled_2"].endswith("return s;\n}  // GAIN is GAIN_2")
