"""What SC does before anything was published: it must not fault, or it never steps again.

Purpose: `survives_the_start`: SC's step on the default values of its topics, and on what a node
makes of a default, publishes values in their sets and cannot fault; `answers_all`: so it does on
all that may ever be published.
Non-goals: which of its outputs count (`derived_times.py`: the first one on a state does).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.cells.predicates import both_all
from soter.certificate.reading.modes_of_other_modules import any_mode
from soter.certificate.reading.module_facts import read_by_sc
from soter.certificate.reading.symbolic_reading import Surroundings, SymbolicReader
from soter.certificate.reading.symbolic_values import filled, flat
from soter.certificate.terms.arb_balls import ONE, exact
from soter.certificate.terms.compile_terms import compile_truths, form_of_box
from soter.certificate.terms.terms import NotRecheckedError, Terms, inputs_of, negation
from soter.language.evaluate import arithmetic
from soter.language.model.types import FloatType, leaves

if TYPE_CHECKING:
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model import typed
    from soter.language.model.system import Topic

CERTAIN = 2
READ_EARLY = "what a node made of a default"
READ_ELSEWHERE = "what is published while it has no control"


def survives_the_start(facts: Facts) -> None:
    """`NotRecheckedError` where steps before all shows a state may do harm."""
    setting = facts.setting
    sc = facts.sc
    assert sc.node is not None
    if sc.node.locals:
        raise NotRecheckedError("an SC with locals that may step before anything was published")
    paths = {r.name: r.paths for r in setting.by_sc}
    terms, known = Terms(), {}
    for symbol in read_by_sc(sc):
        topic = facts.system.topics[sc.scope.topics[symbol]]
        running = facts.flying.topics[facts.running[topic.index]].name
        empty = any(p.may_publish_nothing(setting.silent) for p in paths.get(running, ()))
        default = running in paths and not empty
        known[symbol] = _anything(terms, topic, READ_EARLY, default=default)
    if not _harmless(facts, terms, known):
        raise NotRecheckedError(
            "SC may step before anything was published, and fault on what it then reads"
        )


def answers_all(facts: Facts) -> None:
    """Below another module SC steps wherever that one leads the state, too, and must not fault.

    `NotRecheckedError` where that is not certain for all that may be published.
    """
    sc = facts.sc
    assert sc.node is not None
    if sc.node.locals:
        raise NotRecheckedError("an SC with locals below another module")
    terms, known = Terms(), {}
    for symbol in read_by_sc(sc):
        topic = facts.system.topics[sc.scope.topics[symbol]]
        known[symbol] = _anything(terms, topic, READ_ELSEWHERE, default=False)
    if not _harmless(facts, terms, known):
        raise NotRecheckedError("SC may fault on what is published while it has no control")


def _harmless(facts: Facts, terms: Terms, known: dict[typed.TopicSymbol, Any]) -> bool:
    """Whether a step of SC on these values surely publishes all it should, in its sets."""
    sc = facts.sc
    assert sc.node is not None
    seconds, modes = arithmetic.seconds(sc.period_ns), any_mode(terms, sc.node.step)
    reader = SymbolicReader(terms, Surroundings(sc.scope.params, known, seconds, modes=modes))
    published = {
        sc.scope.topics[topic]: value for topic, value in reader.step(sc.node.step, {}).items()
    }
    for control in facts.controls:
        if control.owner not in published:
            raise NotRecheckedError(f"SC does not publish `{control.name}` in every step")
        value = flat(published[control.owner])[control.leaf]
        command = terms.constant(value) if isinstance(value, float) else value
        low = terms.combine(((ONE, command),), -exact(control.low))
        high = terms.combine(((-ONE, command),), exact(control.high))
        terms.oblige(negation(terms.below(low)))
        terms.oblige(negation(terms.below(high)))
    fine = both_all(terms.obligations)
    places = sorted(inputs_of(terms, [fine]))
    box = [(terms.atoms[i].low, terms.atoms[i].high) for i in places]
    (bits,) = compile_truths(terms, places, [fine], {})(form_of_box(box, symbols=False))
    certain: bool = bits == CERTAIN
    return certain


def _anything(terms: Terms, topic: Topic, why: str, *, default: bool) -> Any:  # noqa: ANN401  a Soter value
    """Any value of the set of a topic; just its default where that is all there may be."""
    bounded = all(
        b is not None and isinstance(of, FloatType)
        for (_, of), b in zip(leaves(topic.type), topic.bounds, strict=True)
    )
    if default or not bounded:
        if not default:
            raise NotRecheckedError(f"SC may read of `{topic.name}` {why}, and it has no set")
        return topic.default
    parts = [
        terms.input("box", topic.name, exact(b.low), exact(b.high))
        for b in topic.bounds
        if b is not None
    ]
    return filled(topic.type, parts)
