"""What a verdict rests on and what it is not about, derived from the program.

Purpose: `assumptions_of`, `confirmed_of`: keys for programs, and texts for people.
Non-goals: what a manifest says about them: nothing is read there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.certificate.reading.modes_of_other_modules import names_of
from soter.certificate.reading.module_facts import bounded_topics, driven_topics
from soter.certificate.time.module_times import DELAYS, read_by
from soter.language.evaluate.abstraction_start import start_behind
from soter.language.model.durations import show_ns
from soter.language.model.tree_walk import calls_in, topic_reads
from soter.language.model.types import FloatType, leaves
from soter.language.prelude.function_error_bounds import BOUNDS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.certificate.reading.module_facts import Facts, Input
    from soter.language.model import typed

WITHOUT_ERROR = ("clamp", "sign", "quat_conj")
"""Functions of the prelude that compute what they say."""


@dataclass(frozen=True)
class RecheckAssumption:
    """`key`: what it is about, the same for the same thing in every verdict."""

    key: str
    text: str


@dataclass(frozen=True)
class Jump:
    """A topic that the map of a view reads, and the node that publishes it.

    `why` it is not confirmed that the state jumps into R(H) where the topic changes; "": it is.
    """

    topic: str
    node: str
    why: str


Jumps = Mapping[str, Sequence[Jump]]
"""By the name of what abstracts; nothing where a module has no `enters`."""


def p1c_of(facts: Facts) -> str:
    """P1c rests on declared times or on assumed ones; H >= H* itself is checked elsewhere."""
    verify = facts.symbol.verify
    declared = all(getattr(verify, name) is not None for _, name in DELAYS.values())
    declared = declared and (facts.above is None or facts.above.declared)
    return "proved" if declared and not facts.ways.undeclared else "assumed"


def assumptions_of(facts: Facts, jumps: Jumps | None = None) -> list[RecheckAssumption]:
    """Everything that is taken for granted about one module; `jumps`: what was tried to confirm."""
    return [
        *_world(facts, jumps or {}),
        *_inputs(facts),
        *_way(facts),
        *_timing(facts),
        *_machine(facts),
        *_judged(facts),
        *_open(facts),
        *_while(facts),
    ]


def _while(facts: Facts) -> Iterator[RecheckAssumption]:
    """What a claim of a module below another one is about, and what it rests on."""
    if facts.above is None:
        return
    name = facts.above.name
    yield RecheckAssumption(
        f"while {name}",
        f"`safe` is kept while {name} is in AC, from each time on at which it gives control back; "
        "not before the first, and not while it is in SC",
    )
    yield RecheckAssumption(
        f"verdict of {name}",
        f"a verdict of {name} by which it gives control back is in force at most "
        f"{show_ns(facts.above.back_ns)} after the state that it is about",
    )
    yield RecheckAssumption(
        f"sets while {name}",
        f"while {name} is in SC, too, what plants publish lies in the declared sets (else they "
        "stop)",
    )


# ---------------------------------------------------------------- the world


def confirmed_of(facts: Facts, jumps: Jumps) -> list[RecheckAssumption]:
    """What is confirmed beside the claims, and no assumption any more."""
    entries = []
    for index, inside in facts.in_sets.items():
        if inside and not facts.symbol.verify.abstracts:
            name = facts.system.topics[index].name
            text = f"what plants publish lies in the declared set of {name} for every state that "
            entries.append(RecheckAssumption(f"set {name}", text + "SC keeps, errors included"))
    enters = None if facts.whole is None else facts.whole.verify.enters
    if enters is None:
        return entries
    text = " ".join(enters.span.text.split())
    return entries + [
        RecheckAssumption(
            f"enters {name} {jump.topic}",
            f"{jump.node} changes what the state of {name} rests on of {jump.topic} only in steps "
            "that show it to DM and SC, and of which, as they read and publish, "
            f"`{text}` holds; wherever that holds the state lies in R(H) of where it jumps to",
        )
        for name, entries in jumps.items()
        for jump in entries
        if not jump.why
    ]


def _world(facts: Facts, jumps: Jumps) -> Iterator[RecheckAssumption]:
    links = facts.symbol.verify.abstracts
    for link in links:
        yield RecheckAssumption(
            f"conforms {link.instance} {link.name}",
            f"{link.instance} behaves like {link.name} ({link.plant.name}) for some disturbance "
            f"within its bounds, from {_begins(facts, link)} on",
        )
    for link in links if facts.view else ():
        tried = jumps.get(link.name, ())
        kept = {j.topic for j in tried if not j.why}
        shown = ", ".join(t.name for t in topic_reads(link.value) if t.name not in kept)
        why = "; ".join(f"{j.topic}: {j.why}" for j in tried if j.why)
        if shown:
            yield RecheckAssumption(
                f"jumps {link.name}",
                f"where {shown} change, on which the state of {link.name} rests, that state moves "
                f"as {link.plant.name} does, or jumps while the estimate lies in S_0 of where it "
                "jumps to, whichever mode; DM and SC read what shows it from that instant on"
                + (f" (`enters` does not confirm it: {why})" if why else ""),
            )
    if not links:
        names = ", ".join(c.name for c in facts.plants)
        yield RecheckAssumption(
            f"world {names}",
            f"the world behaves like {names} for some disturbance within its bounds",
        )
    if facts.kind == "flow":
        yield RecheckAssumption(
            "scheme",
            "the plant is the one solution of its differential equation, whose right-hand side is "
            "Lipschitz in the state; not the simulator's scheme",
        )
    for p in facts.parameters:
        yield RecheckAssumption(
            f"changes {p.name}",
            f"{p.name} changes only while the estimate lies in S_0 of the new value, whichever "
            "mode; DM and SC read the new value from that instant on",
        )


def _begins(facts: Facts, link: typed.AbstractionLink) -> str:
    known = start_behind(facts.flying, facts.flying_module, link) is not None
    return f"the start of {link.instance}" if known else f"the initial states of {link.name}"


def _judged(facts: Facts) -> Iterator[RecheckAssumption]:
    """Topics of `safe` that plants of the proof drive, and that no other part of it reads."""
    by_dm, by_sc = read_by(facts)
    driven = driven_topics(facts)
    for symbol in topic_reads(facts.symbol.safe) if facts.symbol.verify.abstracts else ():
        index = facts.module.scope.topics.get(symbol, -1)
        if index in driven and index not in by_dm and index not in by_sc:
            name, plant = facts.system.topics[index].name, driven[index][0].name
            text = (
                f"what `safe` says of {name} is judged on what {plant} drives: what is published "
                "there is not looked at"
            )
            yield RecheckAssumption(f"judged {name} {plant}", text)


def _open(facts: Facts) -> Iterator[RecheckAssumption]:
    for state in sorted(facts.open_ends):
        name, end = facts.states[state].name, facts.axes[state][1]
        text = f"no run gets beyond an open end, of which nothing is proved: {name} below {end!r}"
        yield RecheckAssumption(f"open {name} {end!r}", text)


def _range(x: Input) -> str:
    return f"{x.name} in [{x.low:g}, {x.high:g}]"


def _unit(x: Input) -> str:
    return f" {x.unit}" if x.unit else ""


def _inputs(facts: Facts) -> Iterator[RecheckAssumption]:
    for d in facts.disturbances:
        what = "disturbances stay within their bounds"
        if d.of_others:
            what = "what others publish and what moves these plants stays in its declared set"
        yield RecheckAssumption(f"disturbance {_range(d)}", f"{what}: {_range(d)}{_unit(d)}")
    for e in facts.errors:
        text = f"measurement errors stay within their bounds: {e.name} within {e.high:g}{_unit(e)}"
        yield RecheckAssumption(f"error {e.name} {e.high:g}", text)
    measured = {(e.owner, e.leaf) for e in facts.errors}
    by_dm, by_sc = read_by(facts)
    for index in dict.fromkeys([*by_dm, *by_sc]):
        topic = facts.system.topics[index]
        for k, (path, of) in enumerate(leaves(topic.type)):
            name = ".".join((topic.name, *path))
            if isinstance(of, FloatType) and (index, k) not in measured:
                yield RecheckAssumption(f"exact {name}", f"estimates are exact: {name}")
    yield from _sets(facts)
    for who, topics in (("the DM", by_dm), ("SC", by_sc)):
        if len(topics) > 1 and facts.kind == "flow":
            names = ", ".join(facts.system.topics[i].name for i in topics)
            text = f"what {who} reads together shows the plants at one instant: {names}"
            yield RecheckAssumption(f"one instant {who}: {names}", text)
    for name in dict.fromkeys(o.name for o in facts.others):
        yield RecheckAssumption(
            f"other {name}", f"{name}: any value of the declared set, at any time"
        )
    modes, waited = names_of(facts)
    for name in modes:
        yield RecheckAssumption(
            f"mode {name}", f"mode({name}): SC or AC, anew at every step that reads it"
        )
    for name in waited:
        text = f"nothing is confirmed of P2b: `safer` waits until {name} is in AC"
        yield RecheckAssumption(f"waits {name}", text)


def _sets(facts: Facts) -> Iterator[RecheckAssumption]:
    """Declared sets of topics that plants drive, of which it is not shown that they hold all."""
    names = [
        facts.system.topics[index].name
        for index in bounded_topics(facts)
        if facts.symbol.verify.abstracts or not facts.in_sets.get(index, False)
    ]
    own = {c.name for c in facts.plants}
    for c in facts.flying.components:
        if c.plant is not None and (facts.symbol.verify.abstracts or c.name not in own):
            driven = [facts.flying.topics[c.scope.topics[t]] for t, _ in c.plant.drives]
            names += [t.name for t in driven if any(b is not None for b in t.bounds)]
    for name in dict.fromkeys(names):
        text = f"what plants publish lies in the declared sets: {name} (else they stop)"
        yield RecheckAssumption(f"set {name}", text)


def _way(facts: Facts) -> Iterator[RecheckAssumption]:
    """Nodes between the plants and the module."""
    texts = {
        "shows": "what {} publishes shows the state that it has just read, within the errors",
        "passes": "{} passes on what the module publishes at its next step, which is counted; what "
        "it makes of a command belongs to the plants of the proof",
        "in step": "{} runs in the thread of the module, behind SC in the same instant; what it "
        "makes of a command belongs to the plants of the proof, and no wait of it is counted "
        "beside `acts within`",
        "vehicle": "{} is part of the vehicle that is abstracted: its last value is its state, and "
        "what stands behind it, delays included, belongs to the abstraction",
        "extern": "{} publishes in every step",
        "beside": "{}, of which the proof knows nothing, is heard by nodes before the module: "
        "whatever it says, and however old that is, they show the plants of the proof",
    }
    for kind, name in facts.ways.notes:
        yield RecheckAssumption(f"{kind} {name}", texts[kind].format(name))
    if facts.ways.notes:
        yield RecheckAssumption(
            "nodes run", "no node between plants and module faults or skips a step"
        )
    for name in facts.ways.undeclared:
        text = f"undeclared times are zero: lateness or response of {name}"
        yield RecheckAssumption(f"undeclared {name}", text)


# ---------------------------------------------------------------- time


def _timing(facts: Facts) -> Iterator[RecheckAssumption]:
    if facts.kind == "map":
        yield RecheckAssumption(
            "one instant",
            "plant, DM and SC run in the same instant, in this order, and commands act in it",
        )
        if facts.symbol.shield is not None:
            text = "AC runs in that instant, too: no command that it replaces there acts any more"
            yield RecheckAssumption("one instant of AC", text)
    if facts.jitter_ns and len(facts.controls) > 1:
        names = ", ".join(c.name for c in facts.controls)
        text = f"what SC publishes begins to act in all of these at one instant: {names}"
        yield RecheckAssumption(f"together {names}", text)
    verify = facts.symbol.verify
    for key, (words, name) in DELAYS.items():
        if getattr(verify, name) is not None:
            text = f"{words} {show_ns(facts.times[key])}"
            yield RecheckAssumption(f"declared {text}", f"times as declared: {text}")
        elif facts.kind == "flow":
            yield RecheckAssumption(f"undeclared {words}", f"undeclared times are zero: {words}")
    if facts.thread:
        yield RecheckAssumption(f"thread {facts.thread}", facts.thread)
    yield RecheckAssumption("wait", "SC waits for the DM, in one thread, and no release is skipped")
    yield RecheckAssumption(
        "order", "commands of AC and SC act in the order in which they were published"
    )
    if not facts.setting.silent:  # nothing declared, or `dropout 0ms`
        yield RecheckAssumption(
            "no dropout", "sensors never drop out: for SC no runtime enforces an age"
        )
    else:
        silent = show_ns(facts.setting.silent)
        text = f"sensors are silent for {silent} longer than their periods at most"
        yield RecheckAssumption(f"dropout {silent}", text)
    if facts.symbol.failsafe:
        text = (
            "the actuators hold the law from the end of the lease on: all of them at one instant, "
        )
        text += f"within {show_ns(facts.times['L_ns'])}, and they take nothing that comes later"
        yield RecheckAssumption("lease", text)
    yield RecheckAssumption(
        "fresh", "P2b: what the DM reads is fresh, and no gate fault keeps AC out"
    )
    yield from acknowledged(facts.symbol)


def acknowledged(symbol: typed.ModuleSymbol) -> Iterator[RecheckAssumption]:
    """Of a DM that does not give control back by itself."""
    if symbol.latch is not None and symbol.latch.topic is not None:
        name = symbol.latch.topic.name
        text = f"P2b: a press of {name} is in force as `safer` holds: an operator acknowledges"
        yield RecheckAssumption(f"acknowledged {name}", text)


def _machine(facts: Facts) -> Iterator[RecheckAssumption]:
    inexact = sorted(n for n in _prelude(facts) & set(BOUNDS) if n not in WITHOUT_ERROR)
    for name in inexact:
        yield RecheckAssumption(
            f"bound of {name}", f"the error bound of {name}: tested, not proved"
        )
    yield RecheckAssumption(
        "binary64", "the compiler and the hardware compute binary64 as IEEE 754 says"
    )


def _prelude(facts: Facts) -> set[str]:
    """Prelude functions that SC, a predicate or a plant calls, directly or through others."""
    assert facts.sc.node is not None
    todo: list[object] = [*facts.sc.node.step, *facts.symbol.predicates]
    for c in facts.plants:
        assert c.plant is not None
        todo += [e for _, e in (*c.plant.lets, *c.plant.drives)]
        todo += [*c.plant.der.values(), *c.plant.next.values()]
    names: set[str] = set()
    seen: set[typed.FunSymbol] = set()
    while todo:
        for call in calls_in(todo.pop()):
            if call.fun not in seen:
                seen.add(call.fun)
                if call.fun.prelude:
                    names.add(call.fun.name)
                todo += call.fun.body or ()
    return names
