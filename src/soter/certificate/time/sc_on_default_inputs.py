"""Checked again: an SC that steps before anything was published does not fault.

Purpose: `survives_the_start`: SC's step on the default values of its topics, or, where not all that
it reads is published at once, on anything that may be published, publishes values in their sets and
cannot fault; below another module so it does on all that may ever be published.
Non-goals: which of its outputs count (`derived_times.py`: the first one on a state does).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.reading.case_model import commanded, stepping
from soter.certificate.reading.left_out_states import all_certain
from soter.certificate.reading.module_facts import read_by_sc
from soter.certificate.reading.sc_locals_and_modes import any_mode
from soter.certificate.reading.symbolic_operations import filled
from soter.certificate.terms.arb_balls import exact
from soter.certificate.terms.terms import NotRecheckedError, Terms
from soter.language.model.types import FloatType, leaves

if TYPE_CHECKING:
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model import typed
    from soter.language.model.system import Topic

READ_EARLY = "what was published before all that it reads shows a state"
READ_ELSEWHERE = "what is published while it has no control"


def survives_the_start(facts: Facts) -> None:
    """`NotRecheckedError` where steps before all shows a state, or without control, may do harm."""
    setting = facts.setting
    if setting.first_available(0, setting.by_sc) != setting.sc.phase:
        _harmless_before(facts)
    if facts.above is not None:
        _answers_all(facts)


def _harmless_before(facts: Facts) -> None:
    """What SC reads is the default of each topic only while none of them shows a state.

    That is so of what one publisher says, each time all of it, and never before it has read a
    state itself. Otherwise a state of one topic may be read beside the default of another, and so
    each is anything of its set.
    """
    setting = facts.setting
    sc = facts.sc
    assert sc.node is not None
    if sc.node.locals:
        raise NotRecheckedError("an SC with locals that may step before anything was published")
    paths = {r.name: r.paths for r in setting.by_sc}
    every = [p for of in paths.values() for p in of]
    at_once = len({p.clocks[-1].name for p in every}) == 1
    at_once = at_once and not any(p.may_publish_nothing(setting.silent) for p in every)
    terms, known = Terms(), {}
    for symbol in read_by_sc(sc):
        topic = facts.system.topics[sc.scope.topics[symbol]]
        running = facts.flying.topics[facts.running[topic.index]].name
        only_default = at_once and running in paths
        known[symbol] = _anything(terms, topic, READ_EARLY, default=only_default)
    if not harmless(facts, terms, known):
        raise NotRecheckedError(
            "SC may step before anything was published, and fault on what it then reads"
        )


def _answers_all(facts: Facts) -> None:
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
    if not harmless(facts, terms, known):
        raise NotRecheckedError("SC may fault on what is published while it has no control")


def harmless(facts: Facts, terms: Terms, known: dict[typed.TopicSymbol, Any]) -> bool:
    """Whether a step of SC on these values surely publishes all it should, in its sets."""
    sc = facts.sc
    assert sc.node is not None
    published = stepping(terms, sc, known, any_mode(terms, sc.node.step))({})
    for control in facts.controls:
        commanded(terms, control, [published])
    return all_certain(terms, terms.obligations)


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
