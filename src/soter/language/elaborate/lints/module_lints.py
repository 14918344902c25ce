"""What is doubtful about the modules of a flat system that has no errors.

Purpose: W012 (AC and SC look exchanged), W014 (a state that nothing moves), W016 (an SC does not
publish on every path), W018 (`safe` speaks of what the module publishes), W019 (a scheme diverges
where the plant does not), W033 (several commands move one group of a shield), and the doubts of the
other files of this folder, in one call.
Non-goals: P1, P2, P3: nothing here is needed for a proof, and nothing here is one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import exchange
from soter.language.check.parts.plant import unmoved
from soter.language.elaborate.lints.contradictory_predicates import doubt_predicates, tried
from soter.language.elaborate.lints.doubtful_times import (
    doubt_age_units,
    doubt_ageless,
    doubt_ages,
    doubt_property_times,
)
from soter.language.elaborate.lints.refuted_at_once import (
    doubt_constants,
    doubt_properties,
    doubt_readers,
    doubt_start,
    doubt_trials,
)
from soter.language.elaborate.lints.step_ranges import doubt_steps
from soter.language.evaluate.integration_stability import diverging
from soter.language.model import typed
from soter.language.model.durations import show_ns, write_ns
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.typed import PeriodRead, TypedBinary, Vector
from soter.language.model.types import ArrayType, RecordType, leaf_name, positions
from soter.language.syntax.schemes import SCHEMES

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.evaluate.integration_stability import Diverging
    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import PlantSymbol, TopicSymbol

    Path = tuple[str, ...]
    Leaf = tuple[typed.PlantSymbol, typed.TypedExpr, Path]


WHOLE = RecordType, ArrayType
"""Of their parts each is followed for itself."""


def doubt_shield(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """W033 for each declared group of a module with a shield."""
    symbol = module.symbol
    if symbol.shield is None:
        return
    plants = [link.plant for link in symbol.verify.abstracts]
    plants = plants or [c.plant for c in system.components if c.plant is not None]
    outputs = {*symbol.ac.publishes, *symbol.sc.publishes}
    for group in symbol.verify.groups:
        moved = [leaf for axis in group.axes for leaf in _rates(axis, plants)]
        found = dict.fromkeys(u for p, e, path in moved for u in _felt(p, e, path, outputs))
        if len(found) > 1:
            diagnostics.warning(
                "W033",
                f"the shield of module `{symbol.name}` judges one command of a group, and "
                f"{' and '.join(f'`{u}`' for u in found)} move this one",
                group.span,
                also=((symbol.shield.span, "the shield"),),
                notes=("nothing is permitted there: AC never gets control",),
                helps=("a `grid` line for the states of each command, or leave `shield` out",),
            )


def _rates(axis: typed.TypedGridAxis, plants: Sequence[typed.PlantSymbol]) -> Iterator[Leaf]:
    """What moves the state that an axis names: the rate or the next value, and its part."""
    if axis.plant is not None:
        found = [
            (axis.plant, v, axis.path[1:]) for v in axis.plant.states if v.name == axis.path[0]
        ]
    else:
        driven = [(p, e) for p in plants for t, e in p.drives if t is axis.topic]
        found = [(p, *at) for p, e in driven if (at := _state(p, e, axis.path)) is not None]
    for plant, state, path in found:
        rate = plant.der.get(state, plant.next.get(state))
        if rate is not None:
            yield plant, rate, path


def _state(
    plant: typed.PlantSymbol, e: typed.TypedExpr, path: Path
) -> tuple[typed.Variable, Path] | None:
    """The state, and its part, that a part of an expression is."""
    if isinstance(e, typed.VarRead):
        given = dict(plant.lets).get(e.variable)
        return (e.variable, path) if given is None else _state(plant, given, path)
    inner = _part(e, path)
    return None if inner is None else _state(plant, *inner)


def _part(e: typed.TypedExpr, path: Path) -> tuple[typed.TypedExpr, Path] | None:
    """Where a part of a field, an element, a record or an array comes from."""
    if isinstance(e, typed.TypedField) and isinstance(e.target.type, RecordType):
        return e.target, (e.target.type.fields[e.index][0], *path)
    if isinstance(e, typed.Index) and isinstance(e.index, typed.Literal):
        return e.target, (f"[{e.index.value}]", *path)
    if isinstance(e, typed.Aggregate) and isinstance(e.type, WHOLE) and path:
        at = positions(e.type, path[:1])[0]
        order = e.order or tuple(range(len(e.elements)))
        return e.elements[order.index(at)], path[1:]
    return None


def _felt(
    plant: typed.PlantSymbol,
    e: typed.TypedExpr,
    path: Path,
    outputs: Iterable[typed.TopicSymbol],
) -> Iterator[str]:
    """The numbers of a command that a part of an expression certainly reads."""
    parts: list[tuple[typed.TypedExpr, Path]] = []
    inner = _part(e, path)
    if isinstance(e, typed.TopicRead):
        if e.topic in outputs:
            yield leaf_name(e.topic.name, path)
    elif inner is not None:
        parts = [inner]
    elif isinstance(e, typed.VarRead):
        given = dict(plant.lets).get(e.variable)
        parts = [] if given is None else [(given, path)]
    elif isinstance(e, (typed.Vector, typed.TypedBinary)):
        parts = [(x, path if isinstance(x.type, WHOLE) else ()) for x in (e.left, e.right)]
    elif isinstance(e, typed.TypedUnary):
        parts = [(e.operand, path)]
    elif isinstance(e, (typed.Builtin, typed.TypedCall)) and not path:
        parts = [(x, ()) for x in e.arguments if not isinstance(x.type, WHOLE)]
    for x, there in parts:
        yield from _felt(plant, x, there, outputs)


def doubt_publications(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """W016 for the safe controller of a module."""
    sc = system.components[module.sc]
    if sc.node is None or sc.extern:
        return
    publications = [n for n in nodes(sc.node.step) if isinstance(n, typed.TypedPublish)]
    if sc.node.takeover is not None or any(
        isinstance(n, typed.InControl) for n in nodes(sc.node.step)
    ):
        return  # it knows when it has control, and speaks when it means to
    for topic in sc.node.publishes:
        first = next((p for p in publications if p.topic is topic), None)
        if first is None or _always(sc.node.step, topic):
            continue
        diagnostics.warning(
            "W016",
            f"`{sc.node.name}` does not publish `{topic.name}` on every path of its step",
            first.span,
            "published here",
            also=((module.symbol.sc_span or module.symbol.span, "the safe controller"),),
            notes=("where it is silent, the last value that AC published stays in force",),
            helps=("publish on every path: what stands in an `if` also needs an `else`",),
        )


def _always(statements: tuple[typed.TypedStmt, ...], topic: typed.TopicSymbol) -> bool:
    """Whether every path through the statements publishes the topic."""
    for s in statements:
        if isinstance(s, typed.TypedPublish) and s.topic is topic:
            return True
        if isinstance(s, typed.TypedIf) and s.otherwise:
            bodies = [*(body for _, body in s.arms), s.otherwise]
            if all(_always(body, topic) for body in bodies):
                return True
        if isinstance(s, typed.ForRange) and s.low < s.high and _always(s.body, topic):
            return True
    return False


ENDS = {1: "2", 2: "2", 3: "2.51", 4: "2.78"}
"""Order of a scheme -> how much of a decay, rate times step, it follows at most."""


def doubt_scheme(system: System, component: Component, diagnostics: Diagnostics) -> None:
    """W019 for states that the scheme of a plant moves away from their solution."""
    plant = component.plant
    if plant is None:
        return
    for d in diverging(system, component):
        names = ", ".join(f"`{n}`" for n in d.names)
        end = ENDS[SCHEMES[plant.method].order]
        rate = f"rate {d.rate:.3g} per second x step {d.step_s:.3g} s = {d.rate * d.step_s:.3g}"
        diagnostics.warning(
            "W019",
            f"the scheme `{plant.method}` makes {names} of plant `{plant.name}` diverge",
            d.variable.span,
            f"every step multiplies {'it' if len(d.names) == 1 else 'them'} by {d.growth:.3g}",
            notes=(f"{rate}; `{plant.method}` follows a decay up to {end}",),
            helps=tuple(_helps(component, d)),
        )


def _helps(component: Component, d: Diverging) -> list[str]:
    plant = component.plant
    assert plant is not None
    helps = []
    if d.substeps is not None:
        shorter = component.period_ns * component.substeps // d.substeps
        helps.append(
            f"`integrate {plant.method} substeps {d.substeps};`, or a period of the plant of at "
            f"most {write_ns(max(1, shorter // component.substeps))}"
        )
    if d.other is not None:
        helps.append(f"`integrate {d.other};` in place of `{plant.method}`")
    return helps or ["leave out what is that fast: say where it comes to rest"]


TRIED_MAX = 16
"""Of so many modules the predicates are tried: some milliseconds each."""
SLOWER = 5
"""An SC whose period is so many times that of AC is hardly the one that acts at once."""


def doubt(system: System, diagnostics: Diagnostics) -> None:
    """Warn of what is doubtful in each plant, and in each module as it is declared."""
    for component in system.components:
        if component.plant is not None:
            _unmoved(component.plant, diagnostics)
            _times_dt(component.plant, diagnostics)
            doubt_scheme(system, component, diagnostics)
        _hears_itself(component, diagnostics)
    doubt_steps(system, diagnostics)
    doubt_properties(system, diagnostics)
    doubt_property_times(system, diagnostics)
    for number, module in enumerate(system.modules):
        symbol = module.symbol
        sc, ac = system.components[module.sc], system.components[module.ac]
        if sc.node is not symbol.sc or (module.over is None and ac.node is not symbol.ac):
            continue  # replaced in this system
        if module.over is None:
            _exchanged(system, module, diagnostics)
        _speaks_of_outputs(module, diagnostics)
        doubt_publications(system, module, diagnostics)
        doubt_readers(system, module, diagnostics)
        doubt_ages(system, module, diagnostics)
        doubt_ageless(system, module, diagnostics)
        doubt_age_units(system, module, diagnostics)
        doubt_shield(system, module, diagnostics)
        if number < TRIED_MAX:
            doubt_start(system, module, diagnostics)
            trials = tried(system, module)
            if not (
                doubt_constants(system, module, trials, diagnostics)
                or doubt_predicates(system, module, trials, diagnostics)
            ):
                doubt_trials(system, module, trials, diagnostics)


def _exchanged(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """W012: what is fast and written in Soter is AC, what is slow or foreign is SC.

    Of a module with `rest` a period says nothing: its DM follows each hold of SC, so there a slow
    SC acts in time, and costs less to follow.
    """
    symbol = module.symbol
    ac, sc = system.components[module.ac], system.components[module.sc]
    at_ac, at_sc = symbol.ac_span, symbol.sc_span
    if ac.extern or symbol.synthesized or at_ac is None or at_sc is None:
        return
    if sc.extern:
        label, of_ac = "an extern: no proof knows what it does", "written in Soter"
    elif symbol.rest is None and sc.period_ns >= SLOWER * ac.period_ns:
        label = f"steps every {show_ns(sc.period_ns)}"
        of_ac = f"steps every {show_ns(ac.period_ns)}"
    else:
        return
    diagnostics.warning(
        "W012",
        f"AC and SC of module `{symbol.name}` look exchanged",
        at_sc,
        label,
        also=((at_ac, of_ac),),
        notes=("the safe controller is the one that is trusted, and acts at once",),
        helps=(exchange(at_ac, at_sc, f"exchange them: `ac {at_sc.text};`, `sc {at_ac.text};`"),),
    )


def _unmoved(plant: PlantSymbol, diagnostics: Diagnostics) -> None:
    """W014: the rule was forgotten, or it is no state."""
    for state in unmoved(plant):
        diagnostics.warning(
            "W014",
            f"the state `{state.name}` of plant `{plant.name}` never changes",
            state.span,
            "no `der` and no `next`",
            notes=("what is constant is a `const`; a constant that is unknown has a set: `in`",),
            helps=(f"say how it moves: `der {state.name} = ...;` or `next {state.name} = ...;`",),
        )


def _hears_itself(component: Component, diagnostics: Diagnostics) -> None:
    """W036: one topic stands for what a plant or node reads, and for what it publishes."""
    topics, plant, node = component.scope.topics, component.plant, component.node
    reads: list[TopicSymbol] = []
    if plant is not None:
        reads = list(plant.reads)
    elif node is not None:
        reads = [s.topic for s in node.subscribes]
    written = {topics[t]: t for t in component.published}
    for topic in reads:
        out = written.get(topics[topic])
        if out is None or out is topic:
            continue
        diagnostics.warning(
            "W036",
            f"`{component.name}` reads as `{topic.name}` what it publishes itself",
            component.span,
            f"`{topic.name}` and `{out.name}` are wired to one topic",
            also=((topic.span, "what it reads"), (out.span, "what it publishes")),
            notes=("nobody else says anything on that topic",),
            helps=(f"wire `{topic.name}` to what another one publishes",),
        )


def _times_dt(plant: PlantSymbol, diagnostics: Diagnostics) -> None:
    """W032: `der x = v * dt` integrates twice over: the plant multiplies by its step itself."""
    for state, slope in plant.der.items():
        factors = [slope]
        for e in factors:
            if isinstance(e, (TypedBinary, Vector)) and e.op == "*":
                factors += [e.left, e.right]
        for e in factors:
            if isinstance(e, PeriodRead):
                diagnostics.warning(
                    "W032",
                    f"the derivative of `{state.name}` is multiplied by `dt`",
                    e.span,
                    "a time",
                    also=((state.span, "this state"),),
                    notes=("`der` says how fast a state moves: the plant integrates by itself",),
                    helps=("leave `dt` out, or say what the state is after a step: `next`",),
                )
                return


def _speaks_of_outputs(module: Module, diagnostics: Diagnostics) -> None:
    """W018: AC may publish anything of the set, so it holds always or can be lost at once."""
    symbol = module.symbol
    outputs = {t for n in (symbol.ac, symbol.sc) for t in n.publishes}
    for topic, read in topic_reads(symbol.safe).items():
        if topic not in outputs:
            continue
        diagnostics.warning(
            "W018",
            f"`safe` of module `{symbol.name}` speaks of its own output `{topic.name}`",
            read.span,
            "AC may publish any value of its set",
            also=((topic.span, "declared here"),),
            notes=("no switch prevents a command that was given: the gate bounds it by its set",),
            helps=("say it with the set of the topic; `safe` speaks of the state of the plant",),
        )
