"""The fail-safe law of a module in the place of its SC.

Purpose: `law_of`: the problem of the law, of which K_fs is a core (docs/proof.md, "When the trusted
part stops"): the same module, plants and times, with constants for what SC computes.
Non-goals: what K_fs is good for (`rechecker.py`); sharing code with the prover's
`verify/problem/failsafe_problem.py`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.certificate.reading.module_facts import DiffersError
from soter.certificate.reading.problem import read_facts
from soter.certificate.reading.supported_constructs import check_supported
from soter.language.model import typed

if TYPE_CHECKING:
    from soter.certificate.reading.module_facts import Facts


def law_of(facts: Facts) -> Facts:
    """The problem of the law, held to the times of the module; DiffersError where there is none.

    Nothing is read by the law, so how old its reads are says nothing; its outputs act in windows
    that are no longer than SC's.
    """
    flying, module = facts.flying, facts.flying_module
    law = facts.symbol.failsafe
    outputs = set() if facts.sc.node is None else set(facts.sc.node.publishes)
    if not law or set(law) != outputs:
        raise DiffersError(f"`{module.name}` declares no fail-safe law")
    for c in flying.components:
        if c.node is None or c.index in (module.ac, module.sc):
            continue
        read = [flying.topics[c.scope.topics[s.topic]] for s in c.node.subscribes]
        if any(t.index in module.outputs or t.queue_of in module.outputs for t in read):
            raise DiffersError(f"`{c.name}` reads the module's outputs: the law is not what acts")
    if any(x.of_others for x in facts.disturbances):
        raise DiffersError("others move the plants: nobody keeps what they publish where all stops")
    if facts.kind != "flow":
        raise DiffersError("the plants move in steps: when a lease ends there is not settled")
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
    own = next(m for m in flying.modules if m.index == module.index)
    ruled = replace(own, symbol=replace(own.symbol, sc=node))
    modules = tuple(ruled if m.index == own.index else m for m in flying.modules)
    system = replace(flying, components=tuple(components), modules=modules)
    law_facts = read_facts(system, own.name, facts.view)
    check_supported(law_facts)
    if [(s.name, s.low, s.high) for s in law_facts.states] != [
        (s.name, s.low, s.high) for s in facts.states
    ]:
        raise DiffersError("the fail-safe law is not about the states of the module")
    law_facts.times = dict(facts.times)
    return law_facts
