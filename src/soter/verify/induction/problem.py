"""Makes the problem of a module that is proved by induction from its program.

Purpose: `extract_induction` finds the nodes that the proof has to follow, how late they may be, and
the claims to prove. It refuses (R030, R031, R032) a module that induction is not for.
Non-goals: the transition relation itself (`transition_relation.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from soter.core.steps import lower
from soter.diagnostics.diagnostic import Diagnostics
from soter.language.check.constants_and_types import Calculator
from soter.language.elaborate import derived_systems
from soter.language.model import typed
from soter.language.model.assumption_words import in_words
from soter.language.model.system import Property
from soter.language.model.tree_walk import calls_in, margin_reads, mode_reads, nodes, topic_reads
from soter.language.model.types import show_ns
from soter.verify.induction.calendar import ComponentCalendar
from soter.verify.problem.problem import (
    FRESH,
    NO_MODES,
    NODES,
    Assumption,
    Problem,
    Quantities,
    Times,
    latch_assumptions,
)
from soter.verify.problem.problem_times import AssumedTimes, check_deployed_times
from soter.verify.problem.schedule import Releases, Schedule
from soter.verify.problem.supported_constructs import identified_assumptions

if TYPE_CHECKING:
    from soter.core.core import Predicate
    from soter.language.model.system import Component, Module, Scope, System
    from soter.verify.problem.problem import Modes

OF_MODES = (
    "modes of others may stand in SC, `ttf` and `safer`; another mode may change at any instant, "
    "so `safe` and lemmas have to hold in all of them"
)
OTHERS = (
    "groups",
    "abstracts",
    "commands",
    "core",
    "horizon",
    "levels",
    "acts",
    "dropout",
    "age",
    "enters",
)
"""Clauses of a `verify` block that only proofs by sets use, and that `induction` refuses."""
WORDS = {"groups": "grid", "acts": "acts within"}


@dataclass(eq=False, kw_only=True)
class InductionProblem(Problem):
    """A module with the nodes that the proof follows, and the times of these nodes.

    `system` holds only the components of the proof.
    """

    clocks: tuple[ComponentCalendar, ...]
    """The times of all components as the proof follows them: SC waits for the DM's verdict."""
    declared: tuple[ComponentCalendar, ...]
    """The times of all components as they are declared."""
    undeclared: tuple[str, ...]
    """The names of times that are not declared, and count as zero."""
    safe: Predicate
    lemmas: tuple[Predicate, ...]
    lemma_texts: tuple[str, ...]
    progress: tuple[Predicate, ...]
    """The conditions of `progress_texts`, lowered to Core."""
    any_value: dict[str, str] = field(default_factory=dict)
    """For each topic that may hold any value of its set, by name, why nothing more is known."""
    heard: frozenset[int] = frozenset()
    """Topics of `any_value` that P2b assumes constant: their nodes hear plants or other modules."""
    waited: frozenset[int] = frozenset()
    """Topics that hold a mode which `safer` reads: P2b assumes that these modes are AC."""
    first_ns: int = 0
    """The first instant at which a component of the flying system runs, or an input arrives."""

    @cached_property
    def outputs(self) -> dict[int, list[int]]:
        """The topics that each component publishes, by the index of the component."""
        topics_by_component = {}
        for c in self.system.components:
            if c.node is not None:
                topics_by_component[c.index] = c.writes
        return topics_by_component


def _properties_to_show(module: Module) -> list[Property]:
    progress = module.symbol.verify.progress
    asked = (module.symbol.safe, *module.symbol.verify.lemmas, *progress)
    return [
        Property(
            k,
            "progress" if e in progress else "always",
            e,
            module.scope,
            e.span.text_on_one_line,
            e.span,
        )
        for k, e in enumerate(asked)
    ]


def extract_induction(flat: System, module: Module, modes: Modes = NO_MODES) -> InductionProblem:
    """The problem of a module of a flat system; raises `SoterError` R030, R031 or R032.

    `modes` has the modes of other modules that the module reads, as topics that nobody publishes.
    """
    diagnostics = Diagnostics()
    _refuse_unsupported(flat, module, diagnostics)
    diagnostics.raise_errors()
    nodes, any_value, heard = _followed_nodes(flat, module, modes)
    kept = [module.dm, module.sc, module.ac, *nodes]
    system = derived_systems.bare_system(flat, kept)
    index = next(i for i, m in enumerate(system.modules) if m.name == module.name)
    proved_module = system.modules[index]
    assert not any(c.extern for c in system.components if c.role in ("sc", "node"))
    times, clocks, declared, absent = _times_of_components(system, proved_module, diagnostics)
    rests = _time_assumptions(flat, module, system, declared, diagnostics)
    diagnostics.raise_errors()
    lemmas_, properties = proved_module.symbol.verify.lemmas, _properties_to_show(proved_module)
    texts = tuple(p.text for p in properties)
    core = lower(derived_systems.with_properties(system, properties))
    safe, *others = core.properties
    recover = proved_module.symbol.verify.recover
    calculator = Calculator(diagnostics, proved_module.scope.params)
    problem = InductionProblem(
        system=system,
        core=core,
        module=proved_module,
        quantities=Quantities((), (), (), (), (), ()),
        kind=NODES,
        plant_period_ns=0,
        states=(),
        initial=(),
        controls=(),
        disturbances=(),
        errors=(),
        others=(),
        parameters=(),
        groups=(),
        times=times,
        name=module.name,
        recover_ns=None if recover is None else int(calculator.value(recover, "") or 0),
        clocks=clocks,
        declared=declared,
        undeclared=tuple(absent),
        safe=safe,
        lemmas=tuple(others[: len(lemmas_)]),
        lemma_texts=texts[1 : 1 + len(lemmas_)],
        progress=tuple(others[len(lemmas_) :]),
        progress_texts=texts[1 + len(lemmas_) :],
        any_value=any_value,
        modes=modes if modes.topics or modes.margins else None,
        waited=frozenset(
            proved_module.scope.topics[t] for t, n in modes.topics.items() if n in modes.waits
        ),
        heard=frozenset(i for i in heard if not flat.topics[i].queues),
        first_ns=min([c.phase_ns for c in flat.components] + [0 for _ in flat.inputs]),
    )
    problem.assumptions = (*_induction_assumptions(problem, absent), *rests, *modes.assumptions)
    return problem


def _refuse_unsupported(flat: System, module: Module, diagnostics: Diagnostics) -> None:
    symbol = module.symbol
    clauses = [n for n in OTHERS if getattr(symbol.verify, n)]
    for name in clauses:
        diagnostics.error(
            "R031",
            f"`{WORDS.get(name, name)}` says nothing to a proof by induction",
            symbol.verify.span or symbol.span,
            also=((symbol.verify.induction or symbol.span, "asked for here"),),
            helps=("leave one of the two out",),
        )
    if symbol.ttf is None or symbol.safer is None:
        diagnostics.error(
            "R032",
            f"module `{module.name}` leaves `ttf` and `safer` to be computed",
            symbol.span,
            notes=("they are computed from sets of states, and induction has none",),
            helps=("write both",),
        )
    _refuse_controller(flat, module, diagnostics)
    for topic in topic_reads(symbol.safe):
        index = module.scope.topics[topic]
        writers = [c for c in flat.components if index in c.writes]
        if not writers or any(c.plant is not None for c in writers):
            who = f"plant `{writers[0].name}`" if writers else "the environment"
            diagnostics.error(
                "R030",
                f"`safe` of module `{module.name}` speaks of `{flat.topics[index].name}`, which "
                f"{who} drives",
                symbol.safe.span,
                also=((topic.span, "the topic"),),
                notes=("induction is about what nodes publish",),
                helps=("prove it on sets of states: `grid` in place of `induction`",),
            )


def _refuse_controller(flat: System, module: Module, diagnostics: Diagnostics) -> None:
    """Reports externs, modes of other modules and margins in SC and in predicates as errors."""
    symbol, sc = module.symbol, flat.components[module.sc]
    if sc.extern:
        diagnostics.error(
            "R003",
            f"SC of module `{module.name}` is extern: what it does is not known",
            sc.span,
            helps=("write it in Soter",),
        )
    assert sc.node is not None
    takeover = sc.node.takeover or ()
    for call in _extern_calls(*symbol.predicates_and_lemmas, *sc.node.step, *takeover):
        diagnostics.error(
            "R003",
            f"module `{module.name}` rests on the extern function `{call.fun.name}`",
            call.span,
            also=((call.fun.span, "declared here"),),
            helps=("write it in Soter",),
        )
    modules_known = {**sc.scope.modules, **module.scope.modules}
    for where, read in mode_reads(*symbol.predicates_and_lemmas, *sc.node.step, *takeover).items():
        if modules_known.get(where) != module.index:
            diagnostics.error(
                "R030",
                f"module `{module.name}` speaks of the mode of another module",
                read.span,
                notes=(OF_MODES,),
            )
    for node in nodes(symbol.predicates_and_lemmas):
        if isinstance(node, typed.MarginRead):
            diagnostics.error(
                "R030",
                f"module `{module.name}` speaks of a margin",
                node.span,
                notes=("a margin says what the proof of a module shows, and proves nothing",),
            )


def _followed_nodes(
    flat: System, module: Module, modes: Modes
) -> tuple[list[int], dict[str, str], list[int]]:
    """Nodes to follow, topics with any value and the reasons, and topics of nodes that hear others.

    The writers of topics that `safe` and the lemmas read are followed. Other writers are followed
    unless they hear plants or other modules; the third result has the topics of these writers.
    """
    symbol, scope = module.symbol, module.scope
    own_components = {module.dm, module.sc, module.ac}
    needed = {*_topics_read(scope, symbol.safe, *symbol.verify.lemmas)}
    todo = _topics_read(scope, *symbol.predicates_and_lemmas)
    todo += _topics_of_node(flat.components[module.sc])
    decided = {scope.topics[t]: f"decided by the DM of {name}" for t, name in modes.topics.items()}
    seen: set[int] = set()
    nodes: dict[int, None] = {}
    any_value: dict[str, str] = {}
    heard: list[int] = []
    while todo:
        index = flat.topics[todo.pop()].source
        if index in seen or index in module.outputs:
            continue
        seen.add(index)
        name = flat.topics[index].name
        writers = [c for c in flat.components if index in c.writes]
        why = decided.get(index) or _why_not_followed(flat, module, writers)
        if not why and index not in needed:
            why = _sources_in_words(flat, module, writers)
            heard += [index] if why else []
        if why:
            any_value[name] = why
            continue
        for c in writers:
            if c.index not in own_components and c.index not in nodes:
                nodes[c.index] = None
                todo += _topics_of_node(c)
    return list(nodes), any_value, heard


def _sources_in_words(flat: System, module: Module, writers: list[Component]) -> str:
    """The plant or other module on which the writers of a topic depend, in words; "" if none."""
    todo, seen = list(writers), set(module.outputs)
    while todo:
        c = todo.pop()
        if c.plant is not None or c.module not in (None, module.index):
            return f"published by {writers[0].name}, which hears {c.role} {c.name}"
        for read in () if c.extern else _topics_of_node(c):
            index = flat.topics[read].source
            if index not in seen:
                seen.add(index)
                todo += [w for w in flat.components if index in w.writes]
    return ""


def _why_not_followed(flat: System, module: Module, writers: list[Component]) -> str:
    """Why a topic may hold any value of its set at any time; "" if its writers are followed."""
    if not writers:
        return "the environment's"
    for c in writers:
        if c.plant is not None:
            return f"driven by plant {c.name}"
        if c.module is not None:
            return f"an output of module {flat.modules[c.module].name}"
        assert c.node is not None
        if c.extern:
            return f"published by extern node {c.name}"
        if _extern_calls(*c.node.step):
            return f"{c.name} calls an extern function"
        if c.node.bursts:
            return f"{c.name} publishes several messages a step"
        if _modes_read_by(c) - {module.index}:
            return f"{c.name} reads a margin, or the mode of another module"
    return ""


def _modes_read_by(c: Component) -> set[int]:
    assert c.node is not None
    margins = {-1} if margin_reads(*c.node.step) else set()  # of any module: not followed
    return {c.scope.modules.get(m, -1) for m in mode_reads(*c.node.step)} | margins


def _extern_calls(*roots: object) -> list[typed.TypedCall]:
    """The calls that reach an extern function, directly or through other functions."""
    extern_calls = []
    for call in calls_in(*roots):
        seen: set[typed.FunSymbol] = set()
        todo = [call.fun]
        while todo:
            fun = todo.pop()
            if fun not in seen:
                seen.add(fun)
                todo += [inner.fun for inner in calls_in(*(fun.body or ()))]
        if any(fun.extern for fun in seen):
            extern_calls.append(call)
    return extern_calls


def _topics_read(scope: Scope, *read: object) -> list[int]:
    return [scope.topics[t] for t in topic_reads(*read)]


def _topics_of_node(c: Component) -> list[int]:
    assert c.node is not None
    return _topics_read(c.scope, *c.node.step)


def _times_of_components(
    system: System, module: Module, diagnostics: Diagnostics
) -> tuple[Times, tuple[ComponentCalendar, ...], tuple[ComponentCalendar, ...], list[str]]:
    """The times of DM and SC, the calendars as followed and as declared, and undeclared times."""
    _refuse_times_of_others(system, module, diagnostics)
    absent: list[str] = []
    calculator = Calculator(diagnostics, module.scope.params)
    delays = {c.index: _delays_of(c, module, calculator, absent) for c in system.components}
    dm, sc = system.components[module.dm], system.components[module.sc]
    clocks, declared = [], []
    for c in system.components:
        late, response = delays[c.index]
        declared.append(ComponentCalendar(c.index, c.period_ns, c.phase_ns, late, response))
        if c.index == sc.index:
            late = max(late, sum(delays[dm.index]))  # it waits for the DM's verdict
        clocks.append(ComponentCalendar(c.index, c.period_ns, c.phase_ns, late, response))
        if late + response > c.period_ns:
            diagnostics.error(
                "R015",
                f"`{c.name}` may take {show_ns(late + response)}, longer than its period",
                c.span,
                notes=("runs of one component do not overlap",),
            )
    schedule = Schedule(
        Releases(dm.period_ns, dm.phase_ns, *delays[dm.index]),
        Releases(sc.period_ns, sc.phase_ns, *delays[sc.index]),
        (),
        (),
    )
    return Times(schedule), tuple(clocks), tuple(declared), absent


def _delays_of(
    c: Component, module: Module, calculator: Calculator, absent: list[str]
) -> tuple[int, int]:
    """The lateness and response of a component in ns; adds the undeclared ones to `absent`."""
    verify, delays = module.symbol.verify, []
    names = (c.name, c.name.rpartition(".")[2], c.node.name if c.node else c.name)
    for word in ("late", "response"):
        by_name = getattr(verify, f"{word}_of")
        expr = getattr(verify, f"{word}_{c.role}") if c.role in ("dm", "sc") else None
        expr = expr or next((by_name[n] for n in names if n in by_name), None)
        if word == "response" and c.takes_ns is not None:
            delays.append(c.takes_ns[1])
            continue
        if expr is None:
            absent.append(f"{word} of {c.name}")
        delays.append(0 if expr is None else int(calculator.value(expr, "a time") or 0))
    return delays[0], delays[1]


def _refuse_times_of_others(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Reports R031 for a time that is declared for a node outside of the proof."""
    verify = module.symbol.verify
    names_known = {n for c in system.components for n in (c.name, c.name.rpartition(".")[2])}
    names_known |= {c.node.name for c in system.components if c.node is not None}
    for name in {**verify.late_of, **verify.response_of}:
        if name not in names_known:
            diagnostics.error(
                "R031",
                f"`{name}` is no node that the proof of `{module.name}` rests on",
                verify.span or module.symbol.span,
                notes=("a time of it says nothing to this proof",),
                helps=("leave it out",),
            )


def _time_assumptions(
    flat: System,
    module: Module,
    system: System,
    declared: tuple[ComponentCalendar, ...],
    diagnostics: Diagnostics,
) -> list[Assumption]:
    """The assumptions behind the times of the proof; reports R033 if the thread breaks them."""
    by_name = {system.components[c.component].name: (c.late, c.response) for c in declared}
    dm, sc = flat.components[module.dm].name, flat.components[module.sc].name
    others = [c for c in flat.components if c.name in by_name and c.role in ("node", "ac")]
    nodes = {c.name: by_name[c.name] for c in others if c.in_thread}
    elsewhere = {c.name: by_name[c.name] for c in others if not c.in_thread}
    assumed = AssumedTimes(by_name[dm], by_name[sc], nodes, elsewhere=elsewhere)
    rests = check_deployed_times(flat, module, assumed, diagnostics)
    return [Assumption("thread", text) for text in rests]


def _induction_assumptions(problem: InductionProblem, absent: list[str]) -> list[Assumption]:
    system, module = problem.system, problem.module
    ac = system.components[module.ac].name
    assumptions = [Assumption(f"any {ac}", in_words("ac", ac))]
    for c in problem.clocks:
        if c.late or c.response:
            name = system.components[c.component].name
            text = (
                f"{name} starts at most {show_ns(c.late)} after its release, and takes at most "
                f"{show_ns(c.response)}"
            )
            assumptions.append(Assumption(f"declared {name}", text))
    if absent:
        names = ", ".join(absent)
        assumptions.append(Assumption("undeclared", f"undeclared times are zero: {names}"))
    text = "no release is skipped, and what a step reads it reads at one instant"
    assumptions.append(Assumption("one instant", text))
    modes = set() if problem.modes is None else {t.name for t in problem.modes.topics}
    assumptions += [
        Assumption(f"any value {n}", f"{n}: any value of its set at any time ({w})")
        for n, w in problem.any_value.items()
        if n not in modes
    ]
    assumptions += identified_assumptions(system.program)
    assumptions += [FRESH, *latch_assumptions(problem.module.symbol)]
    if problem.heard:
        still = ", ".join(sorted(problem.system.topics[i].name for i in problem.heard))
        text = f"for P2b alone: {still} stays as it is until SC gives control back"
        assumptions.append(Assumption("still", text))
    assumptions += [Assumption(key, in_words(key)) for key in ("z3", "machine")]
    return assumptions
