"""What a re-checked verdict rests on and is not about, derived again from the program.

Purpose: `assumptions_of`, `confirmed_of`: keys for programs, and texts for people.
Non-goals: what a manifest says about them: nothing is read there. What an extra rests on is said
where that is (`module_above.py`, `handover.py`, `reading/`, `time/node_paths.py`).

The argument: each part of the problem that the claims do not show is named here: the world and the
inputs with their ranges, the times, the machine. An assumption that is always made is always said.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate import handover, module_above
from soter.certificate.reading import sc_locals_and_modes, verification_system
from soter.certificate.reading.module_facts import bounded_topics, number_of, read_by
from soter.certificate.reading.supported_constructs import equations, parts_of
from soter.certificate.report import RecheckAssumption
from soter.certificate.time import node_paths
from soter.certificate.time.module_times import DELAYS
from soter.language.model.typed import FunSymbol
from soter.language.model.types import FloatType, leaf_name, leaves, show_ns
from soter.language.prelude.function_error_bounds import BOUNDS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.certificate.handover import Jumps
    from soter.certificate.reading.module_facts import Facts, Input
    from soter.certificate.report import Said
    from soter.language.model import typed

WITHOUT_ERROR = ("clamp", "sign", "quat_conj")
"""Functions of the prelude that compute what they say."""
UNDECLARED = "undeclared times are zero:"


def p1c_of(facts: Facts) -> str:
    """P1c rests on declared times or on assumed ones; H >= H* itself is checked elsewhere."""
    verify = facts.symbol.verify
    declared = all(getattr(verify, name) is not None for _, name in DELAYS.values())
    declared = declared and (facts.above is None or facts.above.declared)
    return "proved" if declared and not facts.ways.undeclared else "assumed"


def assumptions_of(facts: Facts, jumps: Jumps | None = None) -> list[RecheckAssumption]:
    """Everything that is taken for granted about one module; `jumps`: what was tried to confirm."""
    links = bool(facts.symbol.verify.abstracts)
    parts = (
        verification_system.assumed(facts) if links else (),
        handover.assumed(facts, jumps or {}) if facts.view else (),
        _world(facts),
        _inputs(facts),
        sc_locals_and_modes.assumed(facts) if facts.modes else (),
        node_paths.assumed(facts.ways) if facts.ways.notes else (),
        _timing(facts),
        _machine(facts),
        verification_system.judged(facts) if links else (),
        _open(facts),
        _left_out(facts),
        _turning(facts),
        module_above.assumed(facts.above) if facts.above is not None else (),
    )
    return [RecheckAssumption(key, text) for part in parts for key, text in part]


def confirmed_of(facts: Facts, jumps: Jumps) -> list[RecheckAssumption]:
    """What is confirmed beside the claims, and no assumption any more."""
    entries = []
    for index, inside in facts.in_sets.items():
        if inside and not facts.symbol.verify.abstracts:
            name = facts.system.topics[index].name
            text = f"what plants publish lies in the declared set of {name} for every state that "
            entries.append((f"set {name}", text + "SC keeps, errors included"))
    entries += handover.confirmed(facts, jumps) if jumps else ()
    return [RecheckAssumption(key, text) for key, text in entries]


# ---------------------------------------------------------------- the world


def _world(facts: Facts) -> Said:
    if not facts.symbol.verify.abstracts:
        names = ", ".join(c.name for c in facts.plants)
        text = f"the world behaves like {names} for some disturbance within its bounds"
        yield f"world {names}", text
    if facts.kind == "flow":
        which = (
            "any absolutely continuous solution of its differential equation, with any rate "
            "between those on both sides where its right-hand side jumps"
            if facts.at_rest
            else "the only solution of its differential equation (where the right-hand side "
            "jumps: with any rate between those on both sides)"
        )
        yield "scheme", f"the plant is {which}; not the simulator's scheme"
    for p in facts.parameters:
        text = f"{p.name} changes only while the estimate lies in S_0 of the new value, whichever"
        yield f"changes {p.name}", f"{text} mode; DM and SC read the new value from that instant on"


def _open(facts: Facts) -> Said:
    for state in sorted(facts.open_ends):
        name, end = facts.states[state].name, facts.axes[state][1]
        text = f"no run gets beyond an open end, of which nothing is proved: {name} below {end!r}"
        yield f"open {name} {end!r}", text


def _left_out(facts: Facts) -> Said:
    for s in facts.left_out:
        text = "left out, as nothing that is proved depends on it, below 1e+308, and where"
        yield f"left out {s.name}", f"{text} functions in its rate are defined: {s.name}"


def _turning(facts: Facts) -> Said:
    for name in (facts.states[i].name for i in sorted(facts.turning)):
        text = "read modulo a full turn, so that its axis wraps around, and within 16,384 rad of 0"
        yield f"turns {name}", f"{text}: {name}"


def _range(x: Input) -> str:
    return f"{x.name} in [{x.low:g}, {x.high:g}]"


def _unit(x: Input) -> str:
    return f" {x.unit}" if x.unit else ""


def _inputs(facts: Facts) -> Said:
    for d in facts.disturbances:
        what = "disturbances stay within their bounds"
        if d.of_others:
            what = "what others publish and what moves these plants stays in its declared set"
        yield f"disturbance {_range(d)}", f"{what}: {_range(d)}{_unit(d)}"
    for e in facts.errors:
        text = f"measurement errors stay within their bounds: {e.name} within {e.high:g}{_unit(e)}"
        yield f"error {e.name} {e.high:g}", text
    measured = {(e.owner, e.leaf) for e in facts.errors}
    by_dm, by_sc = read_by(facts)
    for index in dict.fromkeys([*by_dm, *by_sc]):
        topic = facts.system.topics[index]
        for k, (path, of) in enumerate(leaves(topic.type)):
            name = leaf_name(topic.name, path)
            if isinstance(of, FloatType) and (index, k) not in measured:
                yield f"exact {name}", f"estimates are exact: {name}"
    for name in dict.fromkeys(_sets(facts)):
        yield (
            f"set {name}",
            f"what plants publish lies in the declared sets: {name} (else they stop)",
        )
    for who, topics in (("the DM", by_dm), ("SC", by_sc)):
        if len(topics) > 1 and facts.kind == "flow":
            names = ", ".join(facts.system.topics[i].name for i in topics)
            text = f"what {who} reads together shows the plants at one instant: {names}"
            yield f"one instant {who}: {names}", text
    for name in dict.fromkeys(o.name for o in facts.others):
        yield f"other {name}", f"{name}: any value of the declared set, at any time"


def _sets(facts: Facts) -> Iterator[str]:
    """Topics with a declared set that plants drive, of which it is not shown that they keep to it.

    Of a plant that is abstracted, and of one that is no part of the proof, nothing is shown.
    """
    links, own = facts.symbol.verify.abstracts, {c.name for c in facts.plants}
    for index in bounded_topics(facts):
        if links or not facts.in_sets.get(index, False):
            yield facts.system.topics[index].name
    for c in facts.flying.components:
        if c.plant is not None and (links or c.name not in own):
            driven = [facts.flying.topics[c.scope.topics[t]] for t, _ in c.plant.drives]
            yield from (t.name for t in driven if any(b is not None for b in t.bounds))


# ---------------------------------------------------------------- time


def _delays(facts: Facts) -> Said:
    verify = facts.symbol.verify
    for key, (words, name) in DELAYS.items():
        if getattr(verify, name) is not None:
            text = f"{words} {show_ns(facts.times[key])}"
            if key == "L_ns" and verify.acts_least is not None:
                text = f"{text}, and {show_ns(number_of(facts, verify.acts_least))} at least"
            yield f"declared {text}", f"times as declared: {text}"
        elif facts.kind == "flow":
            yield f"undeclared {words}", f"{UNDECLARED} {words}"


def _timing(facts: Facts) -> Said:
    for name in facts.ways.undeclared:
        yield f"undeclared {name}", f"{UNDECLARED} lateness or response of {name}"
    if facts.kind == "map":
        text = "plant, DM and SC run in the same instant, in this order, and commands act in it"
        yield "one instant", text
        if facts.symbol.shield is not None:
            text = "AC runs in that instant, too: no command that it replaces there acts any more"
            yield "one instant of AC", text
    # a chain lets each command begin by itself, and what rests is shown by chains alone
    if facts.jitter_ns and len(facts.controls) > 1 and facts.symbol.rest is None:
        names = ", ".join(c.name for c in facts.controls)
        text = f"what SC publishes begins to act in all of these at one instant: {names}"
        yield f"together {names}", text
    yield from _delays(facts)
    if facts.thread:
        yield f"thread {facts.thread}", facts.thread
    if facts.kind == "flow":
        text = "sensors publish exactly at their releases, before anybody reads in that instant"
        yield "sensors on time", text
    yield "wait", "SC waits for the DM, in one thread, and no release is skipped"
    yield "order", "commands of AC and SC act in the order in which they were published"
    if facts.setting.silent:
        silent = show_ns(facts.setting.silent)
        text = f"sensors are silent for {silent} longer than their periods at most"
        yield f"dropout {silent}", text
    else:  # nothing declared, or `dropout 0ms`
        yield "no dropout", "sensors never drop out: for SC no runtime enforces an age"
    if facts.symbol.failsafe:
        held = "the actuators hold the law from the end of the lease on: all of them at one instant"
        late = f"within {show_ns(facts.times['L_ns'])}, and they take nothing that comes later"
        yield "lease", f"{held}, {late}"
    yield "fresh", "P2b: what the DM reads is fresh, and no gate fault keeps AC out"
    yield from acknowledged(facts.symbol)


def acknowledged(symbol: typed.ModuleSymbol) -> Said:
    """Of a DM that does not give control back by itself."""
    if symbol.latch is not None and symbol.latch.topic is not None:
        name = symbol.latch.topic.name
        text = f"P2b: a press of {name} is in force as `safer` holds: an operator acknowledges"
        yield f"acknowledged {name}", text


def _machine(facts: Facts) -> Said:
    """Of prelude functions that SC, a predicate or a plant calls, directly or through others."""
    assert facts.sc.node is not None
    code: list[object] = [*facts.sc.node.step, *facts.symbol.predicates]
    code += [e for c in facts.plants if c.plant is not None for e in equations(c.plant)]
    functions = {f for f in parts_of(code) if isinstance(f, FunSymbol) and f.prelude}
    for name in sorted({f.name for f in functions} & BOUNDS.keys() - {*WITHOUT_ERROR}):
        yield f"bound of {name}", f"the error bound of {name}: tested, not proved"
    yield "binary64", "the compiler and the hardware compute binary64 as IEEE 754 says"
