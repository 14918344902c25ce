"""Modules proved on an abstraction of their plants (`abstracts`), read again: an extra.

Purpose: `abstracted`: the system of the module and its `abstracts` plants; `as_it_runs`: that the
module is the same there as in the system that flies; where runs of it begin.
Non-goals: what the plants do (`problem.py`, `case_model.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.reading.module_facts import DiffersError, driven_topics, read_by
from soter.certificate.report import NotRecheckedError
from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.derived_systems import without_held_topics
from soter.language.elaborate.elaborator import Elaborator
from soter.language.elaborate.views_for_proofs import start_behind
from soter.language.model import typed
from soter.language.model.system import holder_of
from soter.language.model.tree_walk import topic_reads

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.report import Said
    from soter.language.model.system import Component, Module, System


def abstracted(system: System, module: Module) -> tuple[System, Module, tuple[Component, ...]]:
    """The system to prove in, the module there, and its plants.

    SoterError where a system of the module and its `abstracts` plants cannot be elaborated.
    """
    symbol = module.symbol
    ac, sc = (system.components[i].node for i in (module.ac, module.sc))
    assert ac is not None
    assert sc is not None
    parts: list[tuple[str, Any]] = [(link.name, link.plant) for link in symbol.verify.abstracts]
    parts.append((symbol.name, _with_controllers(symbol, ac, sc)))
    instances = tuple(typed.InstanceSymbol(n, what, {}, {}, symbol.span) for n, what in parts)
    made = typed.SystemSymbol(
        name="recheck",
        span=symbol.span,
        default=False,
        instances=instances,
        sets=_own_parameters(module, instances),
    )
    diagnostics = Diagnostics()
    around = {p.name: v for p, v in module.around.items()}
    elaborator = Elaborator(system.program, made, around, diagnostics)
    elaborator.partial = True
    flattened = elaborator.run()
    if flattened is None or diagnostics.has_errors:
        raise SoterError(diagnostics.items)
    flattened = without_held_topics(flattened)
    plants = tuple(c for c in flattened.components if c.role == "plant")
    return flattened, flattened.modules[0], plants


def flown(facts: Facts, name: str) -> Sequence[Any] | None:
    """The states of a plant of the proof at the start of a run, by its map; None: not known."""
    for link in facts.symbol.verify.abstracts:
        if link.name == name:
            return start_behind(facts.flying, facts.flying_module, link)
    return None


def seen_from_what_is_abstracted(facts: Facts, topics: set[int]) -> None:
    """Check that each topic comes from the plant whose abstraction drives it.

    DiffersError where one does not.
    """
    outer = holder_of(facts.flying, facts.flying_module)
    driven = driven_topics(facts)
    for index in topics:
        model = driven[index][0].name
        real = next(n.instance for n in facts.symbol.verify.abstracts if n.name == model)
        real = f"{outer}.{real}" if outer else real
        paths = facts.ways.to(facts.running[index])
        if not any(p.sensor.name == real for p in paths):
            name = facts.system.topics[index].name
            raise DiffersError(f"`{name}` is said to show `{real}`, which is not behind it")


def assumed(facts: Facts) -> Said:
    """The assumptions that the vehicle behaves like the plants that abstract it."""
    for link in facts.symbol.verify.abstracts:
        known = start_behind(facts.flying, facts.flying_module, link) is not None
        begins = f"the start of {link.instance}" if known else f"the initial states of {link.name}"
        text = f"{link.instance} behaves like {link.name} ({link.plant.name}) for some disturbance"
        key = f"conforms {link.instance} {link.name}"
        yield key, f"{text} within its bounds, from {begins} on"


def judged(facts: Facts) -> Said:
    """Topics of `safe` that plants of the proof drive, and that no other part of it reads."""
    read = {i for of in read_by(facts) for i in of}
    driven = driven_topics(facts)
    for symbol in topic_reads(facts.symbol.safe):
        index = facts.module.scope.topics.get(symbol, -1)
        if index in driven and index not in read:
            name, plant = facts.system.topics[index].name, driven[index][0].name
            text = f"what `safe` says of {name} is judged on what {plant} drives: what is published"
            yield f"judged {name} {plant}", f"{text} there is not looked at"


def _own_parameters(
    module: Module, instances: tuple[typed.InstanceSymbol, ...]
) -> tuple[typed.SetSymbol, ...]:
    """The `set`s of the module's own parameters, repeated for each plant of its proof.

    Its topics are not its own: they keep what is set around it.
    """
    own = [(p, v) for p, v in module.scope.params.items() if repr(module.around[p]) != repr(v)]
    return tuple(typed.SetSymbol(i.name, p, v, i.span) for i in instances for p, v in own)


def _with_controllers(
    symbol: typed.ModuleSymbol, ac: typed.NodeSymbol, sc: typed.NodeSymbol
) -> typed.ModuleSymbol:
    if symbol.ac is ac and symbol.sc is sc and symbol.over is None:
        return symbol
    values = {**vars(symbol), "ac": ac, "sc": sc, "over": None}
    return typed.ModuleSymbol(**values)


def as_it_runs(facts: Facts) -> None:
    """Check that the system of the proof has the topics and periods of the running system.

    NotRecheckedError where it has not.
    """
    system, flying = facts.system, facts.flying
    module, running = facts.module, facts.flying_module
    pairs = [(module.scope, running.scope)]
    for part in ("dm", "ac", "sc"):
        a = system.components[getattr(module, part)]
        b = flying.components[getattr(running, part)]
        if (a.period_ns, a.phase_ns) != (b.period_ns, b.phase_ns) or a.node is not b.node:
            raise NotRecheckedError(f"`{b.name}` is another one where the module is proved")
        given, flown = ({p: repr(v) for p, v in x.scope.params.items()} for x in (a, b))
        if given != flown:
            raise NotRecheckedError(f"`{b.name}` has other parameters where the module is proved")
        pairs.append((a.scope, b.scope))
    for proved, runs in pairs:
        for symbol, index in proved.topics.items():
            if symbol not in runs.topics:
                raise NotRecheckedError(f"`{symbol.name}` is no topic of `{flying.name}`")
            at = runs.topics[symbol]
            one, other = system.topics[index], flying.topics[at]
            its, ours = ((t.bounds, t.max_age_ns, repr(t.default)) for t in (one, other))
            if its != ours:
                raise NotRecheckedError(
                    f"`{other.name}` has another set, default or `max_age` than `{one.name}`"
                )
            if facts.running.setdefault(index, at) != at:
                raise NotRecheckedError(f"`{one.name}` stands for two topics of `{flying.name}`")
    if {facts.running[i] for i in module.outputs} != set(running.outputs):
        raise NotRecheckedError("the module has other outputs where it is proved")
