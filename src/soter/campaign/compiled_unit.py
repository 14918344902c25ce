"""The C of a system that a campaign flies: its program and its measures.

Purpose: `generate_measured` adds to the generated program the table `<prefix>_measured`
(soter_batch.h), and has it remember the results of calls whose arguments have not changed
(decision 108).
Non-goals: what else is needed to fly it (`recipe.py`), flying (`batch_flights.py`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen import decisions
from soter.codegen.c_tree import without_branches
from soter.codegen.c_types import float_number, int_number
from soter.codegen.state_access import S
from soter.codegen.unit import UnitBuilder
from soter.codegen.value_locations import MADE
from soter.core.core import Call, Fact
from soter.core.core_walks import operations_by_name, walk
from soter.core.layout import size_of
from soter.core.steps import lower

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.core.core import CoreSystem, Function, Predicate
    from soter.language.model.system import Metric, Property, System

NEVER = c.Name("SOTER_NEVER")
NODES = ("node ", "module ")
"""The beginnings of `Topic.driver` for topics that nodes publish."""


def generate_measured(
    system: System, core: CoreSystem | None = None, *, remembers: bool = True
) -> Unit:
    """The compiled unit of a system, with its measures.

    `remembers`: a call with unchanged arguments is not computed again.
    """
    return MeasuredUnitBuilder(system, core or lower(system), remembers=remembers).build_unit()


OPERATIONS_PER_WORD = 16
"""A DM's call is remembered if it may take more operations for each word of its arguments."""


class MeasuredUnitBuilder(UnitBuilder):
    """Builds the unit of a system that is flown many times."""

    def __init__(self, system: System, core: CoreSystem, *, remembers: bool = True) -> None:
        super().__init__(system, core, None)
        self.remembers = remembers
        self.remembered = _expensive_functions(core) if remembers else frozenset()
        self.frame.works_in_place = True

    def function_definitions(self, f: Function) -> list[c.CTop]:
        """The C of a function, which may remember its last arguments and result."""
        made = without_branches(self._function_definition(f))
        if f.name not in self.remembered:
            return [made]
        anew = f"{made.name}_anew"
        result = self.types.work_type(f.result_type)
        return [replace(made, name=anew), *_remembering_function(made, anew, result)]

    def property_function(self, p: Property, predicate: Predicate) -> c.FunctionDef:
        """The C that judges a property, anew only when a topic that it reads was published."""
        made = super().property_function(p, predicate)
        topics = self._topics_read(predicate) if self.remembers else ()
        if p.component is not None or not topics or made.body is None:
            return made
        ct = c.Member(c.Arrow(S, "header"), "ct")
        stamps = [c.IndexExpr(c.Arrow(S, "stamps"), c.Number(str(t))) for t in topics]
        old: c.CExpr | None = None
        for stamp in stamps:
            new = c.Binary("||", c.Binary("==", stamp, ct), c.Binary("==", stamp, NEVER))
            one = c.Unary("!", new)
            old = one if old is None else c.Binary("&&", old, one)
        assert old is not None
        property_state = c.IndexExpr(c.Arrow(S, "properties"), c.Number(str(p.index)))
        active = c.Binary("!=", c.Member(property_state, "active"), c.Number("0U"))
        first, *rest = made.body
        return replace(made, body=(first, c.IfStmt(old, (c.Return(active),)), *rest))

    def _topics_read(self, predicate: Predicate) -> tuple[int, ...]:
        """The topics that a predicate reads; () if it reads anything but topics of nodes."""
        cells = predicate.footprint.reads
        if not cells or predicate.footprint.modes or predicate.footprint.stamps:
            return ()
        if any(isinstance(x, Fact) for x in walk((*predicate.body, predicate.value))):
            return ()
        for cell in cells:
            topic = self.system.topics[cell.owner] if cell.kind == "topic" else None
            if topic is None or topic.queue_of is not None or topic.held:
                return ()
            if not topic.driver.startswith(NODES):
                return ()
        return tuple(sorted({cell.owner for cell in cells}))

    @staticmethod
    def added_names(system: System) -> tuple[str, ...]:
        """The C names of the tables and of the functions of all measures."""
        return ("measured", "measures", *(f"measure_{k}" for k in range(len(system.measures))))

    def added_definitions(self) -> list[c.CTop]:
        """The C of the measures, and of the table that lists them."""
        declarations: list[c.CTop] = [c.Include("soter_batch.h")]
        rows: list[tuple[None, c.CExpr]] = []
        for k, (measure, value) in enumerate(
            zip(self.system.measures, self.core.measures, strict=True)
        ):
            name = f"{self.prefix}_measure_{k}"
            doc = f"measure {measure.name}"
            declarations.append(decisions.number_function(self.frame, value, name, doc))
            rows.append((None, _measure_row(measure, name)))
        table = f"{self.prefix}_measures"
        if rows:
            declarations.append(
                c.VariableDef("soter_measure", table, c.Initializer(tuple(rows)), True)
            )
        declared = c.VariableDef("soter_measured", f"{self.prefix}_measured", None)
        count, first = c.Number(f"{len(rows)}U"), c.Name(table if rows else "NULL")
        table_value = c.named_fields(count=count, measure=first)
        defined = c.VariableDef(
            "soter_measured", f"{self.prefix}_measured", table_value, static=False
        )
        return [*declarations, declared, defined]


def _measure_row(measure: Metric, name: str) -> c.CExpr:
    return c.named_fields(
        every_ns=int_number(measure.every_ns),
        low=float_number(measure.low),
        high=float_number(measure.high),
        bins=c.Number(f"{measure.bins}U"),
        value=c.Name(name),
    )


def _expensive_functions(core: CoreSystem) -> frozenset[str]:
    """The functions called by DM predicates that take long for the size of their arguments.

    A DM calls them in every period, often with the same arguments, such as a plan.
    """
    functions = {f.name: f for f in core.functions}
    called = {
        x.function
        for d in core.decisions
        for predicate in (d.ttf, d.safer)
        for x in walk(predicate.body)
        if isinstance(x, Call)
    }
    known = operations_by_name(core.functions)
    words = {n: sum(size_of(p.type) for p in functions[n].parameters) / 8 for n in called}
    computed = [n for n in called if functions[n].source is None and words[n]]
    return frozenset(n for n in computed if known[n] > OPERATIONS_PER_WORD * words[n])


def _remembering_function(made: c.FunctionDef, anew: str, result: str) -> list[c.CTop]:
    """The C of `made` that reuses a thread's last result for equal arguments, else calls `anew`.

    Arguments are compared as bytes: structs have no holes. Large ones go by address (decision 109).
    """
    kept, last = f"{made.name}_kept", c.Name("last")
    remembered = [
        (t.removeprefix("const ").removesuffix(" *"), c.Unary("*", c.Name(n)))
        if t.startswith("const ")
        else (t, c.Name(n))
        for t, n in made.parameters
        if n not in {"fault", "made"}
    ]
    names = {n for _, n in made.parameters}
    faults, large = "fault" in names, "made" in names
    members = [c.StructMember("bool", "known"), c.StructMember("soter_fault", "status")]
    members += [c.StructMember(t, f"given_{k}") for k, (t, _) in enumerate(remembered)]
    members.append(c.StructMember(result, "result"))
    status, answer = c.Member(last, "status"), c.Member(last, "result")
    known: c.CExpr = c.Member(last, "known")
    for k, (_, value) in enumerate(remembered):
        kept_value = c.Unary("&", c.Member(last, f"given_{k}"))
        size = c.CallExpr("sizeof", (value,))
        same = c.CallExpr("memcmp", (kept_value, c.address_of(value), size))
        known = c.Binary("&&", known, c.Binary("==", same, c.Number("0")))
    arguments: list[c.CExpr] = [c.Name(n) for _, n in made.parameters if n not in {"fault", "made"}]
    arguments += [c.Unary("&", answer)] if large else []
    arguments += [c.Unary("&", status)] if faults else []
    call = c.CallExpr(anew, tuple(arguments))
    compute = (
        *(c.Assign(c.Member(last, f"given_{k}"), value) for k, (_, value) in enumerate(remembered)),
        c.Assign(status, c.Name("SOTER_OK")),
        c.Do(call) if large else c.Assign(answer, call),
        c.Assign(c.Member(last, "known"), c.Name("true")),
    )
    body: list[c.CStmt] = [
        c.Declare(f"static SOTER_OF_THREAD {kept}", "last", None),
        c.IfStmt(c.Unary("!", known), compute),
    ]
    if faults:
        raised = c.Do(c.CallExpr("soter_raise", (c.Name("fault"), status)))
        body.append(c.IfStmt(c.Binary("!=", status, c.Name("SOTER_OK")), (raised,)))
    body.append(c.Assign(MADE, answer) if large else c.Return(answer))
    return [
        c.Include("string.h", system=True),
        c.Include("soter_batch.h"),
        c.StructDef(kept, tuple(members), f"a call of {anew}"),
        replace(made, body=tuple(body)),
    ]
