"""Finds what a verification covers and what it does not: systems, modules, composition.

Purpose: `coverage_of` says of every module of other systems whether it poses the same problem or is
not covered. It also finds for each fact on which a module relies who guarantees it, such as a part
of another module's `safe` that keeps a topic in its set (docs/proof-modules.md, Composition).
`composed_assumptions_of` makes rows of a table from that and from the verdicts of a report.
Non-goals: proofs; verdicts (`claims/results.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.check.constants_and_types import Calculator
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.front_end import system_to_prove
from soter.language.model import typed
from soter.language.model.system import name_of_subsystem
from soter.language.model.tree_walk import conjuncts, topic_reads
from soter.language.model.types import RecordType, leaf_count
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import ScopeGuarantee, VerificationScope
from soter.verify.problem.verification_system import verification_system_of
from soter.verify.tubes.problem import TubeProblem

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.front_end import CheckResult
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type, Value
    from soter.verify.claims.results import VerifyReport
    from soter.verify.problem.problem import Problem


TURNED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}


def module_keeping_leaf(flat: System, topic: int, leaf: int, low: float, high: float) -> str:
    """The name of a module whose `safe` keeps a driven leaf within [low, high]; "" if none does.

    The range in `safe` must leave room for the measurement error of the published leaf.
    """
    error = sum(
        m.bound for c in flat.components for m in c.measured if (m.topic, m.leaf) == (topic, leaf)
    )
    for module in flat.modules:
        least, most = _kept_range(module, topic, leaf)
        if least - error >= low and most + error <= high:
            return module.name
    return ""


def module_proving_plant(flat: System, plant: Component) -> str:
    """The name of the module whose proof is about a flying plant; "" if no proof is.

    If the proof holds, the plant publishes within its sets, because this is part of C.
    """
    for module in flat.modules:
        verify = module.symbol.verify
        if module.forced is not None or verify.induction is not None or verify.abstracts:
            continue
        try:
            in_proof = verification_system_of(flat, module)
        except SoterError:
            continue
        if any(c.name == plant.name for c in in_proof.plants):
            return module.name
    return ""


def _kept_range(module: Module, topic: int, leaf: int) -> tuple[float, float]:
    """The range (low, high) in which the single conditions of `safe` keep a leaf."""
    symbol = module.whole or module.symbol
    low, high = -math.inf, math.inf
    calculator = Calculator(Diagnostics(), module.scope.params)
    for part in conjuncts(symbol.safe):
        if not isinstance(part, typed.TypedBinary) or part.op not in TURNED:
            continue
        for expression, op, bound in (
            (part.left, part.op, part.right),
            (part.right, TURNED[part.op], part.left),
        ):
            if _leaf_of_expression(module, expression) != (topic, leaf) or topic_reads(bound):
                continue
            value = calculator.value(bound, "a bound")
            if not isinstance(value, float):
                continue
            if op in ("<", "<="):
                high = min(high, value)
            else:
                low = max(low, value)
    return low, high


def _leaf_of_expression(module: Module, e: typed.TypedExpr) -> tuple[int, int] | None:
    """The (topic, number of the leaf) that an expression reads; None if it is not a single leaf."""
    path: list[int] = []
    while isinstance(e, typed.TypedField):
        path.append(e.index)
        e = e.target
    if not isinstance(e, typed.TopicRead) or e.topic not in module.scope.topics:
        return None
    leaf, t = 0, e.topic.type
    for index in reversed(path):
        assert isinstance(t, RecordType)
        fields: list[Type] = [f for _, f in t.fields]
        leaf, t = leaf + sum(leaf_count(f) for f in fields[:index]), fields[index]
    return (module.scope.topics[e.topic], leaf) if leaf_count(t) == 1 else None


Chosen = list[tuple["System", "Module"]]


def coverage_of(
    checked: CheckResult, chosen: Chosen, problems: list[Problem], params: Mapping[str, Value]
) -> VerificationScope:
    """The scope of a verification, with further modules that it covers and all that it does not."""
    covered, uncovered = [], []
    taken = {(flat.name, m.name) for flat, m in chosen}
    for name in checked.systems or [""]:
        flat = system_to_prove(checked, name, params, exact=False)
        for module in flat.modules:
            if (flat.name, module.name) in taken:
                continue
            where = f"{module.name} in system {flat.name}"
            if name and (of := checked.systems[name].deploys) is not None:
                says = "`soter build --cert` says what it inherits"
                uncovered.append(f"{where}: it deploys {of.name}, {says}")
                continue
            same, why = _coverage_and_reason(flat, module, problems, chosen)
            if same:
                covered.append(where)
            else:
                uncovered.append(f"{where}: {why}")
    for flat, module in chosen:
        uncovered += _unproved_contracts(flat, module)
        uncovered += _plants_beside(flat)
    used = chosen[0][0].params if chosen else {}
    guarantees = [
        g for (flat, m), p in zip(chosen, problems, strict=True) for g in _guarantees_of(flat, m, p)
    ]
    return VerificationScope(
        tuple(covered), tuple(dict.fromkeys(uncovered)), tuple(used.items()), tuple(guarantees)
    )


def _indices_of_problem(flat: System, module: Module, problems: list[Problem]) -> list[int]:
    """The indices of the problems that a module's first view poses; empty if a view poses none."""
    keys = [problem_key(extract(*seen)) for seen in systems_by_view(flat, module)]
    every = [[i for i, p in enumerate(problems) if problem_key(p) == key] for key in keys]
    return every[0] if all(every) else []


def _coverage_and_reason(
    flat: System, module: Module, problems: list[Problem], chosen: Chosen
) -> tuple[bool, str]:
    """Whether a chosen module poses the same problem as this module; if not, the reason."""
    symbols = {p.module.symbol.name for p in problems}
    if module.forced is not None:
        return False, f"it is forced to {module.forced.upper()} there, its DM does not switch"
    try:
        posed = _indices_of_problem(flat, module, problems)
    except SoterError as error:
        codes = ", ".join(dict.fromkeys(d.code for d in error.diagnostics))
        return False, f"it poses no problem that can be proved ({codes})"
    if posed and (module.symbol.verify.abstracts or module.symbol.verify.views):
        key = flying_key(flat, module)
        if not any(flying_key(*chosen[i]) == key for i in posed):
            return False, "another vehicle, or other nodes around the module, not verified there"
    if posed:
        return True, ""
    if module.symbol.name in symbols:
        return False, "another problem there, not verified (`--system`)"
    return False, "not verified"


def problem_key(problem: Problem) -> object:
    """A key that is equal for two modules that pose the same problem.

    It has everything from which sets and claims are computed. Components are compared by their
    declaration and all their numbers, except AC, whose code no proof reads.
    """
    ac = problem.module.ac
    components = tuple(
        _ac_key(problem.system, c) if c.index == ac else component_key(problem.system, c)
        for c in problem.system.components
    )
    forced = problem.module.forced
    symbol = problem.module.symbol if problem.whole is None else problem.whole.modules[0].symbol
    return (
        components,
        forced,
        problem.module.symbol.name,
        problem.view,
        symbol.safe,
        symbol.ttf,
        symbol.safer,
        problem.module.period_ns,
        problem.module.clean,
        symbol.latch,
        problem.times,
        problem.groups,
        problem.initial,
        problem.parameter_starts,
        problem.levels,
        problem.recover_ns,
        problem.assumptions,
        problem.law_unread,
        None if problem.law is None else _law_key(problem),
        tuple(map(problem_key, problem.plans)) if isinstance(problem, TubeProblem) else (),
    )


def _law_key(problem: Problem) -> object:
    """A key of the fail-safe law; with the problem it determines the law's problem."""
    law = problem.module.law
    return tuple(sorted((problem.system.topics[i].name, repr(v)) for i, v in law.items()))


def flying_key(flat: System, module: Module) -> object:
    """A key of the whole flying system of a module whose plants are abstractions."""
    return (
        module.name,
        tuple((c.name, component_key(flat, c)) for c in flat.components),
        tuple((d.topic, d.every_ns, d.values) for d in flat.inputs),
    )


def _ac_key(system: System, c: Component) -> object:
    assert c.node is not None
    published = tuple((t, _topic_key(system, c.scope.topics[t])) for t in c.node.publishes)
    held = tuple(c.failsafe.items())
    return (c.role, c.name, published, held, c.period_ns, c.phase_ns, c.wcet_ns, c.jitter_ns)


def component_key(system: System, c: Component) -> object:
    """A key of a component, made of its declaration and all of its numbers."""
    return (
        c.role,
        c.plant or c.node,
        c.period_ns,
        c.phase_ns,
        c.initial,
        c.initial_range,
        c.substeps,
        tuple((d.low, d.high) for d in c.disturbances),
        tuple((m.leaf, m.bound, _topic_key(system, m.topic)) for m in c.measured),
        tuple((s.name, _topic_key(system, i)) for s, i in c.scope.topics.items()),
        tuple((s.name, v) for s, v in c.scope.params.items()),
    )


def _topic_key(system: System, index: int) -> object:
    topic = system.topics[index]
    return (topic.name, topic.bounds, topic.default, topic.max_age_ns, topic.driver)


def _unproved_contracts(flat: System, module: Module) -> list[str]:
    sc = flat.components[module.sc].node
    judged = "judged in runs and tests, no part of the proof"
    gaps = []
    if module.symbol.contract:
        gaps.append(f"the contract of {module.symbol.name}: {judged}")
    if sc is not None and (sc.assumes or sc.guarantees):
        gaps.append(f"contracts of {sc.name}: {judged}")
    return gaps


def _plants_beside(flat: System) -> list[str]:
    """Texts on plants without a proof that stop when a value leaves its declared set."""
    abstracted = {
        m.name.rpartition(".")[0] + "." * ("." in m.name) + link.instance
        for m in flat.modules
        for link in m.symbol.verify.abstracts
    }
    gaps = []
    for plant in (c for c in flat.components if c.plant and c.name not in abstracted):
        sets = [t.name for t in (flat.topics[i] for i in plant.writes) if t.set_declared]
        if sets and not module_proving_plant(flat, plant):
            gaps.append(
                f"plant {plant.name} of system {flat.name}, which stops where what it drives "
                f"leaves its declared set: {', '.join(sets)}"
            )
    return gaps


def _set_guarantees(flat: System, module: Module, problem: Problem) -> list[ScopeGuarantee]:
    guarantees = []
    for index in dict.fromkeys(o.owner for o in problem.quantities.others):
        topic = problem.system.topics[index]
        flying = [t for t in flat.topics if t.symbol is topic.symbol]
        flying.sort(key=lambda t: not t.name.startswith(name_of_subsystem(module)))
        by = (flying[0] if flying else topic).driver or "nobody (its default)"
        text = f"{topic.name} lies in its declared set"
        guarantees.append(ScopeGuarantee(problem.name, text, by, "enforced"))
    return guarantees


def _guarantees_of(flat: System, module: Module, problem: Problem) -> list[ScopeGuarantee]:
    """The facts outside a module on which the module relies, each with who guarantees it."""
    guarantees = _set_guarantees(flat, module, problem)
    guarantees += _mode_guarantees(problem)
    guarantees += _influence_guarantees(flat, problem)
    for link in module.symbol.verify.abstracts:
        line = f"{link.instance} behaves like {link.plant.name}, whatever others do"
        guarantees.append(ScopeGuarantee(problem.name, line, link.instance, "assumed"))
    for parameter in problem.parameters:
        line = f"{parameter.name} changes only inside S_0 of the new value"
        guarantees.append(ScopeGuarantee(problem.name, line, "whoever changes it", "assumed"))
    for text in problem.progress_texts:
        line = f"progress, for P2b alone: {text}"
        by = "the program: proved by nobody"
        guarantees.append(ScopeGuarantee(problem.name, line, by, "assumed"))
    plants = [c.name for c in problem.system.components if c.plant is not None]
    if plants and not module.symbol.verify.abstracts:
        moved = " and what is said of others" if problem.influences else ""
        line = f"{', '.join(plants)} moved by {module.name}, the declared disturbances{moved} alone"
        guarantees.append(ScopeGuarantee(problem.name, line, "the equations", "enforced"))
    if problem.quantities.disturbances:
        line = "disturbances within their ranges"
        guarantees.append(ScopeGuarantee(problem.name, line, "the world", "declared"))
    return guarantees


def _mode_guarantees(problem: Problem) -> list[ScopeGuarantee]:
    """The guarantees on modes of other modules, and those for P2b that some of them are in AC."""
    if problem.modes is None:
        return []
    guarantees = [
        ScopeGuarantee(problem.name, f"mode({name}) is SC or AC", f"the DM of {name}", "enforced")
        for name in problem.modes.topics.values()
    ]
    return guarantees + [
        ScopeGuarantee(problem.name, f"for P2b alone: {name} in AC", name, "assumed")
        for name in problem.modes.waits
    ]


def _influence_guarantees(flat: System, problem: Problem) -> list[ScopeGuarantee]:
    """The guarantees that topics by which others move the plants stay in their sets."""
    guarantees = []
    for i in problem.influences:
        index, by = _flying_topic(flat, problem, i.topic)
        text = f"{i.name_in_proofs(problem.system)} in [{i.low:g}, {i.high:g}]"
        plant = next((c for c in flat.components if c.plant and index in c.writes), None)
        if plant is None:
            guarantees.append(
                ScopeGuarantee(problem.name, text, by or "nobody (its default)", "enforced")
            )
            continue
        keeper, how = module_keeping_leaf(flat, index, i.leaf, i.low, i.high), "guaranteed"
        if not keeper:
            keeper, how = module_proving_plant(flat, plant), "published"
        guarantees.append(
            ScopeGuarantee(problem.name, text, keeper or by, how if keeper else "assumed")
        )
    return guarantees


def _flying_topic(flat: System, problem: Problem, index: int) -> tuple[int, str]:
    """The flying system's index of a topic of the verification system, and the topic's driver."""
    topic = problem.system.topics[index]
    flying = [t for t in flat.topics if t.symbol is topic.symbol]
    home = problem.module.name.rpartition(".")[0]
    flying.sort(key=lambda t: (t.name != topic.name, not t.name.startswith(home)))
    counterpart = flying[0] if flying else topic
    return counterpart.index, counterpart.driver


@dataclass(frozen=True)
class ComposedAssumption:
    """A row of the table of assumptions: `module` relies on `what`; `why` says who guarantees it.

    `open` says that nothing shows it; `promised` that another module should guarantee it.
    """

    module: str
    what: str
    why: str
    open: bool
    promised: bool = False


def composed_assumptions_of(report: VerifyReport) -> list[ComposedAssumption]:
    """The table rows of a report; a module that is proved in views has them once."""
    views = {m.name: m.problem.view for m in report.modules}
    verdicts = {m.name.removesuffix(f" as {views[m.name]}"): m.verdict for m in report.modules}
    rows = []
    for g in report.coverage.guarantees:
        module = g.module.removesuffix(f" as {views.get(g.module, '')}")
        rows.append(ComposedAssumption(module, g.what, *_why_open_and_promised(g, verdicts)))
    return list(dict.fromkeys(rows))


def _why_open_and_promised(g: ScopeGuarantee, verdicts: dict[str, str]) -> tuple[str, bool, bool]:
    if g.how == "guaranteed":
        verdict = verdicts.get(g.by, "not verified here")
        return f"`safe` of {g.by}: {verdict}", verdict != "proved", True
    if g.how == "published":
        verdict = verdicts.get(g.by, "not verified here")
        return f"its plant can publish no more, by {g.by}: {verdict}", verdict != "proved", True
    if g.how == "assumed":
        return f"assumed of {g.by}", True, False
    return f"{g.how}: {g.by}", False, False
