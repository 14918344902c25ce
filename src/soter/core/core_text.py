"""Core as text that a person reads.

Purpose: `core_text` writes everything that is lowered of a system, a line a statement, for
`soter show --core` and for the tests of lowering. Every temporary has its type; before an
operation that may fault stands `checked`, and `guard KIND` names it; a topic is `topic(NAME)`, a
plant's state `state(PLANT.NAME)`, and 2.5 that the source calls GAIN is `2.5'GAIN`.
Non-goals: reading such text again; source lines; what a back end makes of Core.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.core import core
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    IntType,
    ListType,
    RecordType,
    write_ns,
)
from soter.language.model.values import Table

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from typing import Any

    from soter.language.model.system import System
    from soter.language.model.types import Type, Value

ELEMENTS_MAX = 8
"""Elements of an array or list that a constant shows; it tells how many more there are."""
UNARY = {"neg": "-{}", "not": "!{}"}


def core_text(system: System, lowered: core.CoreSystem) -> str:
    """Gives the functions, steps and predicates of a system as text, in the order of Core."""
    text = _Text(system)
    parts = [text.function_lines(f) for f in lowered.functions]
    parts += [text.node_lines(step) for step in lowered.nodes.values()]
    parts += [text.plant_lines(step) for step in lowered.plants.values()]
    parts += [text.predicate_lines(name, p) for name, p in _named_predicates(system, lowered)]
    return "\n\n".join([f"system {system.name}", *map("\n".join, parts)]) + "\n"


def _named_predicates(
    system: System, lowered: core.CoreSystem
) -> Iterator[tuple[str, core.Predicate]]:
    for d in lowered.decisions:
        symbol, name = system.modules[d.module].symbol, system.modules[d.module].name
        for word, p, known in (("ttf", d.ttf, symbol.ttf), ("safer", d.safer, symbol.safer)):
            yield f"{word} {name}{'' if known else ', until a proof computes it'}", p
        yield from ((f"good {name}, plan {k}", p) for k, p in enumerate(d.goods))
    for k, p in enumerate(lowered.properties):
        yield f"property {k}, {system.properties[k].kind}", p
    yield from ((f"property {k}, premise", p) for k, p in enumerate(lowered.premises) if p)
    for k, timed in enumerate(lowered.timed):
        yield from ((f"timed property {k}, premise", p) for p in (timed.premise,) if p)
        yield f"timed property {k}", timed.condition
    yield from zip((f"measure {m.name}" for m in system.measures), lowered.measures, strict=True)


def changed_part(s: core.Set | core.Push) -> core.Expr:
    """Gives the part of a temporary that a statement changes, as an expression that reads it."""
    e: core.Expr = core.Var(s.type, s.name)
    for step in s.path:
        t: Any = e.type
        if isinstance(step, core.Expr):
            e = core.Element(getattr(t, "element", t), e, step)
        else:
            known = isinstance(t, RecordType) and 0 <= step < len(t.fields)
            e = core.Field(t.fields[step][1] if known else t, e, step)
    return e


def _indented(lines: Iterable[str]) -> Iterator[str]:
    return (f"  {line}" for line in lines)


class _Text:
    """The text of each node of Core; indices of topics and components become names."""

    def __init__(self, system: System) -> None:
        self.system = system

    # ------------------------------------------------------------ expressions

    def expr_text(self, e: core.Expr) -> str:
        """Gives the text of an expression, in parentheses unless it is a single term."""
        if isinstance(e, core.Const):
            value = _constant_text(e.type, e.value)
            return value if e.name in (None, value) else f"{value}'{e.name}"
        if isinstance(e, core.Var):
            return e.name
        if isinstance(e, core.Get):
            return self.cell_text(e.cell)
        if isinstance(e, core.Fact):
            return self._fact_text(e)
        if isinstance(e, core.Unary):
            return UNARY.get(e.op, e.op + "({})").format(self.expr_text(e.operand))
        if isinstance(e, core.Binary):
            return f"({self.expr_text(e.left)} {e.op} {self.expr_text(e.right)})"
        if isinstance(e, core.Extreme):
            return f"{e.op}({self.expr_text(e.left)}, {self.expr_text(e.right)})"
        if isinstance(e, core.Select):
            return "({} ? {} : {})".format(*map(self.expr_text, (e.condition, e.then, e.otherwise)))
        return self._text_of_parts_or_literal(e)

    def whole_text(self, e: core.Expr) -> str:
        """Gives the text of an expression without parentheses around the whole."""
        text = self.expr_text(e)
        return text[1:-1] if isinstance(e, (core.Binary, core.Select)) else text

    def _text_of_parts_or_literal(self, e: core.Expr) -> str:
        if isinstance(e, core.Field):
            assert isinstance(e.target.type, RecordType), e
            return f"{self.expr_text(e.target)}.{e.target.type.fields[e.index][0]}"
        if isinstance(e, core.Element):
            return f"{self.expr_text(e.target)}[{self.expr_text(e.index)}]"
        if isinstance(e, core.Length):
            return f"len({self.expr_text(e.target)})"
        assert isinstance(e, core.Make), e
        return _text_of_aggregate(e.type, [self.expr_text(x) for x in e.elements])

    def cell_text(self, cell: core.Cell) -> str:
        owner = "" if cell.kind == "topic" else f"{self.system.components[cell.owner].name}."
        return f"{cell.kind}({owner}{cell.name})"

    def _fact_text(self, e: core.Fact) -> str:
        if e.fact == "mode":
            return f"mode({self.system.modules[e.index].name})"
        if e.fact == "age":
            return f"age({self.system.topics[e.index].name})"
        return f"published({e.index})" if e.fact == "published" else e.fact

    # ------------------------------------------------------------ statements

    def block_lines(self, statements: tuple[core.Stmt, ...]) -> Iterator[str]:
        for s in statements:
            yield from self.statement_lines(s)

    def statement_lines(self, s: core.Stmt) -> Iterator[str]:
        if isinstance(s, core.If):
            yield f"if {self.whole_text(s.condition)}"
            yield from _indented(self.block_lines(s.then))
            if s.otherwise:
                yield "else"
                yield from _indented(self.block_lines(s.otherwise))
        elif isinstance(s, core.Loop):
            yield f"for {s.variable} in {s.low} .. {s.high}"
            yield from _indented(self.block_lines(s.body))
        elif isinstance(s, core.Guard):
            yield f"guard {s.kind.name} {self.whole_text(s.condition)}"
        elif isinstance(s, core.Publish):
            limit = "" if s.limit is None else f", {s.limit} at most"
            yield f"publish {s.output} = {self.whole_text(s.value)}{limit}"
        elif isinstance(s, core.Set):
            yield f"set {self.expr_text(changed_part(s))} = {self.whole_text(s.value)}"
        elif isinstance(s, core.Push):
            yield f"push {self.expr_text(changed_part(s))}, {self.whole_text(s.value)}"
        else:
            yield self._text_of_new_temporary(s)

    def _text_of_new_temporary(self, s: core.Stmt) -> str:
        if isinstance(s, core.Let):
            word = "var" if s.mutable else "let"
            return f"{word} {s.name}: {s.value.type} = {self.whole_text(s.value)}"
        if isinstance(s, core.Checked):
            limit = "" if s.limit is None else f" < {self.expr_text(s.limit)}"
            operands = ", ".join(map(self.expr_text, s.operands))
            return f"let {s.name}: {s.type} = checked {s.op}({operands}){limit}"
        if isinstance(s, core.Choose):
            ages = "" if s.ages is None else f", ages {s.ages}"
            return f"let {s.name}: {s.type} = choose {s.count} from {s.low}{ages}"
        assert isinstance(s, core.Call), s
        arguments = ", ".join(map(self.expr_text, s.arguments))
        return f"let {s.name}: {s.type} = call {s.function}({arguments})"

    # ------------------------------------------------------------ functions, steps, predicates

    def function_lines(self, f: core.Function) -> Iterator[str]:
        parameters = ", ".join(f"{p.name}: {p.type}" for p in f.parameters)
        kind = f"{', extern' * (f.result is None)}{', may fault' * f.can_fault}"
        yield f"function {f.name}({parameters}): {f.result_type}{kind}"
        if f.result is not None:
            yield from _indented(self.block_lines(f.body))
            yield f"  result {self.whole_text(f.result)}"

    def node_lines(self, step: core.NodeStep) -> Iterator[str]:
        yield f"node {self.system.components[step.component].name}"
        yield from self._copy_lines(step.locals)
        yield from self._output_lines(step.outputs)
        yield from self._section_lines("takeover", step.takeover)
        yield from self._section_lines("step", step.body)
        if step.shield is not None:
            yield from self._section_lines("shield", step.shield.body)
            kept = [(step.shield.cell, step.shield.name)]
            kept += [] if step.shield.proposed is None else [step.shield.proposed[:2]]
            yield from (f"    store {self.cell_text(cell)} = {name}" for cell, name in kept)
        yield from self._footprint_lines(step.footprint)

    def plant_lines(self, step: core.PlantStep) -> Iterator[str]:
        yield f"plant {self.system.components[step.component].name}{' extern' * step.extern}"
        yield from self._copy_lines(step.states)
        for name, t, draws in step.disturbances:
            yield f"  disturbance {name}: {t} = {', '.join(map(_draw_text, draws))}"
        yield from self._output_lines(step.outputs)
        for output, leaf, draw in step.noise:
            yield f"  error of output {output}, number {leaf} = {_draw_text(draw)}"
        for name in ("choose", "integrate", "publish"):
            yield from self._section_lines(name, getattr(step, name))
        yield from self._footprint_lines(step.footprint)

    def predicate_lines(self, name: str, p: core.Predicate) -> Iterator[str]:
        yield name
        yield from _indented(self.block_lines(p.body))
        yield f"  value {self.whole_text(p.value)}"
        yield from self._footprint_lines(p.footprint)

    def _section_lines(self, name: str, statements: tuple[core.Stmt, ...]) -> Iterator[str]:
        if statements:
            yield f"  {name}"
            yield from _indented(_indented(self.block_lines(statements)))

    def _copy_lines(self, copies: tuple[core.LocalCopy, ...]) -> Iterator[str]:
        for c in copies:
            stored = ", stored" if c.written else ""
            yield f"  load {c.name}: {c.type} = {self.cell_text(c.cell)}{stored}"

    def _output_lines(self, outputs: tuple[core.Output, ...]) -> Iterator[str]:
        for k, o in enumerate(outputs):
            ends = ["any" if b is None else f"[{b.low!r}, {b.high!r}]" for b in o.bounds]
            inside = f" in {', '.join(ends)}" if any(o.bounds) else ""
            topic = f"topic({self.system.topics[o.topic].name})"
            yield f"  output {k}: {o.type}{inside} to {topic}{', several' * o.burst}"

    def _footprint_lines(self, footprint: core.Footprint) -> Iterator[str]:
        modules, topics = self.system.modules, self.system.topics
        reads = sorted(map(self.cell_text, footprint.reads))
        reads += [f"mode({modules[m].name})" for m in sorted(footprint.modes)]
        reads += [f"stamp({topics[t].name})" for t in sorted(footprint.stamps)]
        for name, cells in (
            ("reads", reads),
            ("writes", sorted(map(self.cell_text, footprint.writes))),
        ):
            if cells:
                yield f"  {name} {', '.join(cells)}"


def _constant_text(t: Type, value: Value) -> str:
    if isinstance(t, BoolType):
        return "true" if value else "false"
    if isinstance(t, EnumType):
        return f"{t.name}.{t.members[value]}"
    if isinstance(t, RecordType):
        return _text_of_aggregate(
            t, [_constant_text(f, v) for (_, f), v in zip(t.fields, value, strict=True)]
        )
    if isinstance(t, (ArrayType, ListType)):
        first = [_constant_text(t.element, value[i]) for i in range(min(len(value), ELEMENTS_MAX))]
        more = len(value) - len(first)
        kind = "table " if isinstance(value, Table) else ""
        return kind + _text_of_aggregate(t, [*first, f"{more} more"] if more else first)
    return str(int(value)) if isinstance(t, IntType) else repr(value)


def _text_of_aggregate(t: Type, elements: list[str]) -> str:
    if not isinstance(t, RecordType):
        return f"[{', '.join(elements)}]"
    fields = [f"{n}: {text}" for (n, _), text in zip(t.fields, elements, strict=True)]
    return f"{{ {', '.join(fields)} }}"


def _draw_text(draw: core.Draw) -> str:
    held = f", held {write_ns(draw.hold_ns)}" if draw.hold_ns > 0 else ""
    return f"draw({draw.stream} in [{draw.low!r}, {draw.high!r}]{held})"
