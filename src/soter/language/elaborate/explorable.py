"""Reports what makes the exploration of a test impossible.

Purpose: reports code that the explorer cannot run, too many actors or steps, a quantum or an order
that does not fit to faults of time, deadlines behind the horizon, and systems in the world.
Non-goals: exploring (`explore/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.elaborate.wellformed import topics_from_outside
from soter.language.model.tree_walk import calls_in
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.elaborate.passes.flattening import Flattening
    from soter.language.model import typed
    from soter.language.model.system import Component, System, TestPlan

MAX_ACTORS = 64
"""Most components and inputs of a tested system: a set of them is one machine word."""
MAX_STEPS = 10_000_000
"""Most releases up to the horizon; with more even one execution would take too long."""


def check_explorable(
    flat: Flattening, test: typed.TestSymbol, system: System, *, sound: bool
) -> None:
    """Reports why a test (`system.test`) cannot be explored; `sound` if no part has errors."""
    plan = system.test
    assert plan is not None
    if sound:
        _check_code(test, system, flat.diagnostics)
    _check_size(flat, test, system, plan.horizon_ns)
    _check_quantum(test, plan, flat.diagnostics)
    _check_order(test, plan, flat.diagnostics)
    if plan.horizon_ns:
        _check_deadlines(plan, flat.diagnostics)


def _check_code(test: typed.TestSymbol, system: System, diagnostics: Diagnostics) -> None:
    for c in system.components:
        if c.extern:
            _report_extern(test, c, diagnostics)
    externs: dict[typed.FunSymbol, typed.TypedCall] = {}
    for root in _code_that_may_run(system):
        _add_externs(root, externs)
    for fun, call in externs.items():
        diagnostics.error(
            "E006",
            f"test `{test.name}` would call the extern function `{fun.name}`",
            test.span,
            also=((call.span, "called here"), (fun.span, "declared here")),
            notes=("the explorer runs Soter code: it repeats each step in many states",),
            helps=("replace the node by one that chooses what the function may answer",),
        )


def _report_extern(test: typed.TestSymbol, c: Component, diagnostics: Diagnostics) -> None:
    symbol = c.node or c.plant
    assert symbol is not None
    kind = "plant" if c.plant is not None else "node"
    may = " that may do anything, with `choose`" if c.plant is None else ""
    name = c.name.rpartition(".")[2] if c.module is not None else c.name
    diagnostics.error(
        "E005",
        f"test `{test.name}` leaves the extern {kind} `{c.name}` in",
        test.span,
        also=((symbol.span, "extern"),),
        notes=(f"the explorer runs Soter code only: replace it by a {kind} of Soter code{may}",),
        helps=(f"write `replace {name} by ...;`",),
    )


def _check_size(flat: Flattening, test: typed.TestSymbol, system: System, horizon: int) -> None:
    """Reports E011 for too many actors, E008 for too many steps up to `horizon`, in ns."""
    actors = [(c.phase_ns, c.period_ns) for c in system.components]
    actors += [(0, i.every_ns) for i in system.inputs]
    if len(actors) > MAX_ACTORS:
        flat.diagnostics.error(
            "E011",
            f"test `{test.name}` has {len(actors)} actors",
            test.span,
            f"at most {MAX_ACTORS} are possible",
            notes=("actors are plants, nodes, decision modules and driven inputs",),
            helps=("test a smaller system: composed modules are safe one by one",),
        )
    if not horizon or test.horizon is None or flat.unknown:
        return
    steps = sum((horizon - phase) // period + 1 for phase, period in actors if phase <= horizon)
    if steps > MAX_STEPS:
        flat.diagnostics.error(
            "E008",
            f"the horizon of test `{test.name}` can never be exhausted",
            test.horizon.span,
            f"{steps} steps lie before it, in each execution",
            notes=(f"at most {MAX_STEPS} are possible",),
            helps=("choose a horizon of a few hyperperiods",),
        )


def _check_quantum(test: typed.TestSymbol, plan: TestPlan, diagnostics: Diagnostics) -> None:
    """Warns W008 of a quantum that is longer than the greatest lateness of a step in the test."""
    expr = test.quantum
    if expr is None or plan.quantum_ns is None:
        return
    latest_ns = plan.skew_ns + max((f.by_ns for f in plan.faults), default=0)
    if plan.quantum_ns <= latest_ns:
        return
    diagnostics.warning(
        "W008",
        f"a quantum of {show_ns(plan.quantum_ns)} is coarser than the time a step may be late"
        if latest_ns
        else f"a quantum of {show_ns(plan.quantum_ns)} does nothing where no step may be late",
        expr.span,
        f"at most {show_ns(latest_ns)}" if latest_ns else "every step of this test is in time",
        notes=("a step happens as early as it can, or later, at a multiple of the quantum",),
        helps=("choose a quantum that divides the skew and the times of the faults",)
        if latest_ns
        else ("leave it out, or say `skew` or `late`",),
    )


def _check_order(test: typed.TestSymbol, plan: TestPlan, diagnostics: Diagnostics) -> None:
    late = [f for f in plan.faults if f.kind != "skip"]
    if test.order is None or not (plan.skew_ns or late):
        return
    fault = "skew" if plan.skew_ns else "takes" if late[0].least_ns else late[0].kind
    at = test.skew.span if plan.skew_ns and test.skew is not None else None
    diagnostics.error(
        "E017",
        f"`order deployed` and `{fault}` exclude each other",
        test.order,
        "steps of an instant in the deployed order",
        also=((at or late[0].span, "steps that are late"),),
        notes=("a step that is late comes after those of later instants, too",),
        helps=("leave one of them out, or write two tests",),
    )


def _check_deadlines(plan: TestPlan, diagnostics: Diagnostics) -> None:
    for p in plan.timed:
        at_start = p.kind == "leadsto" and p.within_ns == plan.horizon_ns
        if p.kind == "invariant" or (p.within_ns <= plan.horizon_ns and not at_start):
            continue
        diagnostics.error(
            "E013",
            f"this property is {'hardly ever' if at_start else 'never'} judged: "
            f"the horizon of the test is {show_ns(plan.horizon_ns)}",
            p.span,
            f"within {show_ns(p.within_ns)}",
            notes=(
                "only what holds at time 0 has its deadline before the end"
                if at_start
                else "a deadline beyond the horizon is not judged",
            ),
            helps=("raise the horizon, or shorten the deadline",),
        )


def _code_that_may_run(system: System) -> Iterator[object]:
    for c in system.components:
        if c.node is not None:
            yield from (*c.node.step, *(c.node.takeover or ()))
        if c.plant is not None:
            yield from (e for _, e in c.plant.lets)
            yield from (*c.plant.der.values(), *c.plant.next.values())
            yield from (e for _, e in c.plant.drives)
    for m in system.modules:
        yield from m.symbol.predicates
    yield from (p.condition for p in system.properties)


def _add_externs(root: object, call_by_extern: dict[typed.FunSymbol, typed.TypedCall]) -> None:
    """Adds extern function -> call, for externs that code below `root` calls, also indirectly."""
    for call in calls_in(root):
        seen: set[typed.FunSymbol] = set()
        todo = [call.fun]
        while todo:
            fun = todo.pop()
            if fun in seen:
                continue
            seen.add(fun)
            if fun.extern:
                call_by_extern.setdefault(fun, call)
            todo += [inner.fun for inner in calls_in(*(fun.body or ()))]


def refuse_systems_in_world(flat: Flattening, test: typed.TestSymbol, system: System) -> None:
    """Reports E018 for a system with `faults`, E019 for one with topics from outside."""
    outside = topics_from_outside(system)
    if outside:
        name = system.topics[outside[0].topic].name
        flat.diagnostics.error(
            "E019",
            f"test `{test.name}` is of a system in the world: `{name}` comes from outside",
            outside[0].span,
            also=((test.span, "the test"),),
            notes=("nothing is published from outside in a test, so that little is tried",),
            helps=("test the system that has plants or nodes in the place of the world",),
        )
    if flat.symbol.faults:
        flat.diagnostics.error(
            "E018",
            f"test `{test.name}` is of a system with `faults`",
            flat.symbol.faults[0].span,
            also=((test.span, "the test"),),
            notes=("chance decides on them in runs; a test tries everything that it permits",),
            helps=("test the system without them: `late`, `skip`, `replace` of the test",),
        )
