"""The problem of an induction, read again: which nodes, when, and what is to be shown.

Purpose: `InductionFacts`, read off the checked program by other code than the prover's, and the
comparison with what the certificate says.
Non-goals: what the nodes do (`solver_reading.py`), showing anything (`check_claims.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import lcm
from typing import TYPE_CHECKING, Any

from soter.certificate.format.errors import RejectedError
from soter.certificate.reading.sc_locals_and_modes import modes_in
from soter.certificate.terms.terms import NotRecheckedError
from soter.certificate.time.trusted_thread import delayed
from soter.diagnostics.diagnostic import Diagnostics
from soter.language.check.constants_and_types import Calculator
from soter.language.model.tree_walk import topic_reads

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from soter.language.model import typed
    from soter.language.model.system import Component, Module, System

ROLES = ("dm", "sc", "ac", "node")
REFUSED = ("groups", "abstracts", "commands", "core", "horizon", "levels", "acts", "dropout")


@dataclass(eq=False)
class InductionFacts:
    """A module, the nodes that are followed beside it, and their times in ns."""

    flying: System
    flying_module: Module
    symbol: typed.ModuleSymbol
    sc: Component
    actors: list[Component] = field(default_factory=list)
    undeclared: bool = False
    work: int = 0
    """That the solver has done, in its own units."""
    latching: bool = False
    """By the certificate: a fault of what is opaque is followed, and is not shown to be none."""
    topics: list[int] = field(default_factory=list)
    """What the actors publish: these are followed, everything else may hold anything of its set."""

    @property
    def dm(self) -> Component:
        """The decision module."""
        return self.flying.components[self.flying_module.dm]

    @property
    def turn(self) -> int:
        """All releases come again after so long."""
        return lcm(*(c.period_ns for c in self.actors))

    @property
    def settled(self) -> int:
        """From this turn on nobody has yet to be released first."""
        return -(-max(c.phase_ns for c in self.actors) // self.turn) * self.turn


def read_induction(flat: System, name: str) -> InductionFacts:
    """RejectedError where there is no such module, NotRecheckedError where it is not for this."""
    matches = [m for m in flat.modules if m.name == name]
    if len(matches) != 1:
        raise RejectedError(f"system `{flat.name}` has no module `{name}`")
    module = matches[0]
    symbol = module.symbol
    if module.forced is not None:
        raise NotRecheckedError(f"`{name}` is forced to {module.forced}: its DM never decides")
    if module.over is not None or any(m.over == module.index for m in flat.modules):
        raise NotRecheckedError(f"`{name}` stands above or below another module")
    if symbol.verify.induction is None or symbol.ttf is None or symbol.safer is None:
        raise RejectedError(f"module `{name}` does not ask for an induction")
    if any(getattr(symbol.verify, word) for word in REFUSED):
        raise NotRecheckedError("a `verify` block that speaks of sets")
    facts = InductionFacts(flat, module, symbol, flat.components[module.sc])
    _gather(facts)
    _times(facts)
    return facts


def _gather(facts: InductionFacts) -> None:
    """The module's three, and every node that what is read rests on and that can be followed."""
    flat, module, symbol = facts.flying, facts.flying_module, facts.symbol
    facts.actors = [flat.components[i] for i in (module.dm, module.ac, module.sc)]
    scope = module.scope.topics
    verify = symbol.verify
    roots = (symbol.safe, symbol.ttf, symbol.safer, *verify.lemmas, *verify.progress)
    wanted = {scope[t] for t in topic_reads(*roots)}
    assert facts.sc.node is not None
    wanted |= {facts.sc.scope.topics[t] for t in topic_reads(*facts.sc.node.step)}
    changed = True
    while changed:
        changed = False
        for c in flat.components:
            if c in facts.actors or c.role != "node" or c.node is None:
                continue
            if wanted & set(c.writes) and _plain(c):
                facts.actors.append(c)
                wanted |= {c.scope.topics[t] for t in topic_reads(*c.node.step)}
                changed = True
    facts.topics = _published(facts.actors)
    for index in facts.topics:
        _published_here_only(facts, index)


def _published(actors: list[Component]) -> list[int]:
    return sorted({i for c in actors for i in c.writes})


def _plain(c: Component) -> bool:
    """A node of Soter code that publishes one value a step: any other may publish anything."""
    assert c.node is not None
    return not c.extern and not c.node.bursts and len(modes_in(c.node.step)) < 2


def _published_here_only(facts: InductionFacts, index: int) -> None:
    flat = facts.flying
    for c in flat.components:
        if c not in facts.actors and index in c.writes:
            raise NotRecheckedError(f"`{flat.topics[index].name}` has a second publisher")
    if index in {d.topic for d in flat.inputs}:
        raise NotRecheckedError(f"`{flat.topics[index].name}` is drawn as an input, too")


def modes_of_others(facts: InductionFacts) -> list[str]:
    """Modules whose modes the actors and the module's predicates read."""
    flat, own = facts.flying, facts.flying_module
    asked: list[tuple[Any, Sequence[object]]]
    asked = [(own.scope, (facts.symbol.ttf, facts.symbol.safer))]
    asked += [(c.scope, c.node.step) for c in facts.actors if c.node and c.role != "ac"]
    read = {scope.modules.get(m, own.index) for scope, code in asked for m in modes_in(code)}
    return [flat.modules[i].name for i in sorted(read - {own.index})]


def nanoseconds(facts: InductionFacts, expr: typed.TypedExpr | None) -> int:
    """A time of the `verify` block; 0 where there is none."""
    calculator = Calculator(Diagnostics(), facts.flying_module.scope.params)
    return 0 if expr is None else int(calculator.value(expr, "a time") or 0)


def _without_times(facts: InductionFacts, *said: Iterable[str]) -> bool:
    """Whether one of the times is not said of an AC or node."""
    for c in facts.actors:
        names = {c.name, c.name.rpartition(".")[2], c.node.name if c.node else c.name}
        if c.role in ("ac", "node") and any(names.isdisjoint(word) for word in said):
            return True
    return False


def _times(facts: InductionFacts) -> None:
    verify = facts.symbol.verify
    said = [verify.late_dm, verify.late_sc, verify.response_dm, verify.response_sc]
    facts.undeclared = any(e is None for e in said)
    for expr in (*said, *verify.late_of.values(), *verify.response_of.values()):
        if nanoseconds(facts, expr):
            raise NotRecheckedError("steps that are late, or take time: not rechecked yet")
    if any(c.wcet_ns is not None for c in facts.flying.components):
        raise NotRecheckedError("declared execution times: not rechecked yet beside an induction")
    late = any(c.jitter_ns for c in facts.flying.components)
    if late and (who := delayed(facts.flying, facts.actors)):
        raise NotRecheckedError(f"releases that are late (`jitter`), and with them `{who}`")
    if any(c.takes_ns is not None for c in facts.actors):
        raise NotRecheckedError("steps that are late, or take time: not rechecked yet")
    facts.undeclared |= _without_times(facts, verify.late_of, verify.response_of)
    for c in facts.actors:
        if c.role not in ROLES:
            raise NotRecheckedError(f"`{c.name}` is a {c.role}")


# ---------------------------------------------------------------- the certificate


def _without(facts: InductionFacts, followed: object) -> None:
    """Leaves out nodes beside the module that a certificate does without.

    What they publish may then be anything of its set, at any time: that holds of more.
    """
    if not isinstance(followed, dict):
        raise RejectedError("`clocks` are not as they should be")
    facts.actors = [c for c in facts.actors if c.role != "node" or c.name in followed]
    facts.topics = _published(facts.actors)


def compare(facts: InductionFacts, given: Any) -> tuple[int, int]:  # noqa: ANN401 - any JSON
    """K and the hyperperiods of P2b; RejectedError where a figure is another in the program."""
    names = ("k", "returns", "hyperperiod_ns", "lemmas", "progress", "latching", "clocks")
    if not isinstance(given, dict) or set(given) != set(names):
        raise RejectedError("`induction` is not as it should be")
    verify = facts.symbol.verify
    for name, said in (("lemmas", verify.lemmas), ("progress", verify.progress)):
        if given[name] != [" ".join(e.span.text.split()) for e in said]:
            raise RejectedError(f"`{name}`: the program says something else")
    if type(given["latching"]) is not bool:
        raise RejectedError("`latching` is no truth")
    facts.latching = given["latching"]
    _without(facts, given["clocks"])
    clocks = {c.name: [c.period_ns, c.phase_ns, 0, 0] for c in facts.actors}
    if given["clocks"] != clocks:
        raise RejectedError("the nodes, or their times, are others in the program")
    if given["hyperperiod_ns"] != facts.turn:
        raise RejectedError(f"the hyperperiod is {facts.turn} ns by the program")
    for key in ("k", "returns"):
        if type(given[key]) is not int or not 0 <= given[key] <= 64:
            raise RejectedError(f"`{key}` of the induction is no number of hyperperiods")
    return given["k"], given["returns"]
