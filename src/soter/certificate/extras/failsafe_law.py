"""Checks again the fail-safe law of a module, which takes the place of SC: an extra.

The fail-safe law: the constants that act on the plants once the trusted part stops (docs/proof.md,
"When the trusted part stops"). K_fs, its core: a set of states that the law never leaves.
Purpose: `read_law` reads what a certificate says of it; `make_law_problem` makes the problem of
which K_fs is a core: the same module, plants and times, with the constants for what SC computes.
`check_law` shows that the law keeps K_fs, in which SC has to stay.
Non-goals: sharing code with the prover's `verify/problem/verification_system.py`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from soter.certificate.case_check import CaseCheck
from soter.certificate.extras.left_out_states import leave_out_states
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.module_facts import DiffersError
from soter.certificate.reading.problem import read_facts
from soter.certificate.reading.supported_constructs import require_supported
from soter.certificate.report import RejectedError, missing_properties
from soter.diagnostics.current_phase import shares_to
from soter.language.model import typed

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.certificate.cell_sets import Cells
    from soter.certificate.grid.grid_group import GridGroup
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model.system import Component, Module, System


BEGINS = ("P1c", "P2a", "P3", "start")
"""The claims by which the law begins in K; P1c may rest on assumed times, as it may for SC."""


class FailsafeLaw(NamedTuple):
    """The fail-safe law of a module, as a certificate claims it.

    `facts`: the problem with the law instead of SC. `groups`: for each combination of parameter
    values, its groups with K_fs.
    """

    facts: Facts
    groups: list[list[GridGroup]]


def read_law(
    facts: Facts,
    entry: dict[str, Any],
    claims: set[str],
    read: Callable[[dict[str, Any]], list[GridGroup]],
) -> FailsafeLaw:
    """Reads the law and its groups from the entry of a module; `read` gives a case's groups.

    Raises RejectedError if no claim says that the law begins in K, or its cells are not SC's.
    """
    if {*BEGINS} & {*missing_properties(entry["claims"], [*claims])}:
        raise RejectedError("failsafe: nothing says that the law begins where it keeps `safe`")
    if [c["parameter"] for c in entry["law"]] != [list(c) for c in facts.parameter_combinations()]:
        raise RejectedError("the cases of the law are not those of the module")
    groups = [read(case) for case in entry["law"]]
    for of_case in groups:
        for g in of_case:
            g.cells_kept_by_law(of_case)
    return FailsafeLaw(make_law_problem(facts), groups)


def check_law(law: FailsafeLaw, k: int, of_sc: CaseCheck) -> list[Cells]:
    """Shows that the law keeps K_fs in case k, and returns K_fs of each group of `of_sc`."""
    groups = law.groups[k]
    with shares_to(None):
        model = CaseModel(law.facts, of_sc.model.parameter, of_sc.model.extents)
        CaseCheck(model, groups, {"P2a"}, of_sc.entry, of_sc.workers).show_claims()
    return [g.cells_kept_by_law(groups) for g in of_sc.groups]


def _topics_of_node(flying: System, c: Component) -> set[int | None]:
    """The topics that a node subscribes to, including those that feed its queues."""
    read = [] if c.node is None else c.reads
    return {*read, *(flying.topics[index].queue_of for index in read)}


def make_law_problem(facts: Facts) -> Facts:
    """Makes the problem of the law, with the module's times; raises DiffersError if it has no law.

    The law reads nothing, so ages of reads do not matter; its outputs act in windows no longer than
    those of SC.
    """
    flying, module = facts.flying, facts.flying_module
    law = facts.symbol.failsafe
    if not law or facts.sc.node is None or set(law) != set(facts.sc.node.publishes):
        raise DiffersError(f"`{module.name}` declares no fail-safe law")
    for c in flying.components:
        if c.index not in (module.ac, module.sc) and _topics_of_node(flying, c) & {*module.outputs}:
            raise DiffersError(f"`{c.name}` reads the module's outputs: the law is not what acts")
    if any(x.of_others for x in facts.disturbances):
        raise DiffersError("others move the plants: nobody keeps what they publish where all stops")
    if facts.kind != "flow":
        raise DiffersError("the plants move in steps: when a lease ends there is not settled")
    system, name = _system_under_law(flying, module, law)
    law_facts = read_facts(system, name, facts.view)
    leave_out_states(law_facts, [s.name for s in facts.left_out])
    require_supported(law_facts)
    of_law, of_sc = ([(s.name, s.low, s.high) for s in x.states] for x in (law_facts, facts))
    if of_law != of_sc:
        raise DiffersError("the fail-safe law is not about the states of the module")
    law_facts.times, law_facts.turning = dict(facts.times), set(facts.turning)
    return law_facts


def _system_under_law(
    flying: System, module: Module, law: Mapping[typed.TopicSymbol, typed.TypedExpr]
) -> tuple[System, str]:
    """A system whose SC only publishes the law and reads nothing, and the module's name."""
    sc = flying.components[module.sc]
    assert sc.node is not None
    node = replace(
        sc.node,
        subscribes=(),
        failsafe={},
        locals=(),
        initial=(),
        assumes=(),
        guarantees=(),
        takeover=None,
        step=tuple(typed.TypedPublish(value.span, topic, value) for topic, value in law.items()),
    )
    components = list(flying.components)
    components[module.sc] = replace(sc, node=node, initial=(), failsafe={})
    modules = list(flying.modules)
    at, replaced = next((i, m) for i, m in enumerate(modules) if m.index == module.index)
    modules[at] = replace(replaced, symbol=replace(replaced.symbol, sc=node))
    return replace(flying, components=tuple(components), modules=tuple(modules)), replaced.name
