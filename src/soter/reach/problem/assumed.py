"""What a proof takes for granted, in words.

Purpose: the assumptions of one problem; they are printed with every verdict.
Non-goals: checking them (`monitor/membership.py`, `soter run`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.prelude.bounds import BOUNDS
from soter.program.meaning.starts import start_behind
from soter.program.model.durations import show_ns
from soter.program.model.types import FloatType, leaves
from soter.program.model.walk import calls_in, topic_reads
from soter.reach.induction.handover import handovers
from soter.reach.problem.problem import SCHEME, Jumps
from soter.reach.time.timing import DELAYS, WORDS, read_by_dm, read_by_sc, undeclared

if TYPE_CHECKING:
    from soter.program.model import typed
    from soter.program.model.system import Component
    from soter.reach.problem.inputs import Inputs
    from soter.reach.problem.place import Place
    from soter.reach.problem.problem import Times
    from soter.reach.time.routes import Route, Routes

EXACT = ("clamp", "sign", "quat_conj")
"""Prelude functions without an error of their own."""
BEHIND = {
    "in_step": "in the thread of the module, started when SC has published, however late that is; "
    "what they make of a command belongs to the plants of the proof",
    "counted": "pass a command on at their next step, which is counted; what they make of it "
    "belongs to the plants of the proof",
    "inner": "between commands and plants, with sensors of their own: they and their delays belong "
    "to the plants of the proof",
}
NO_DROPOUT = (
    "sensors never drop out: where one does the DM hands over to SC, which then reads what is "
    "too old for its own proof (`dropout` covers a silence)"
)


def assumptions_of(
    place: Place, inputs: Inputs, times: Times, routes: Routes, kind: str, jumps: Jumps
) -> list[str]:
    """Every assumption; SCHEME is taken out again where the scheme turns out to be covered."""
    found = [
        *_environment(place, inputs, jumps),
        *_ways(place, routes),
        *_timing(place, times, routes, kind),
    ]
    if kind == "flow":
        found += _of_one_instant(place)
        found.append(SCHEME)
    found.append("P2b: what the DM reads is fresh, and no gate fault keeps AC out")
    if inputs.parameters:
        names = ", ".join(p.name for p in inputs.parameters)
        found.append(
            f"{names} changes only while the estimate lies in S_0 of the new value, whichever "
            "mode; DM and SC read the new value from that instant on"
        )
    found += _arithmetic(place)
    return found


def jumps_of(place: Place) -> Jumps:
    """Of all abstractions of a module."""
    found: list[str] = []
    entered: dict[str, str] = {}
    unkept: list[str] = []
    for link in place.module.symbol.verify.abstracts:
        given = {h.topic: h for h in handovers(place.flat, place.home, link)}
        kept = [h for h in given.values() if not h.why]
        rest = [t for t in topic_reads(link.value) if t not in {h.topic for h in kept}]
        if rest:
            read = ", ".join(t.name for t in rest)
            found.append(
                f"where {read} change, on which the state of {link.name} rests, that state moves "
                f"as {link.plant.name} does, or jumps while the estimate lies in S_0 of where it "
                "jumps to, whichever mode; DM and SC read what shows it from that instant on"
            )
        for h in kept:
            assert place.home.whole is not None
            enters = place.home.whole.verify.enters
            assert enters is not None
            fact = (
                f"wherever `{' '.join(enters.span.text.split())}` holds of what {h.node} reads and "
                f"publishes in one step, the state of {link.name} lies in R(H) of where it jumps to"
            )
            alone = (
                f"{h.node} changes what it rests on of {h.topic.name} in no other step, and shows "
                "it to DM and SC in the same one"
            )
            found.append(f"{fact} ({alone}: proved)")
            entered[found[-1]] = f"{fact}; {alone}: proved"
        unkept += [
            f"`enters` shows nothing of {h.topic.name}, on which {link.name} rests: {h.why}"
            for h in ([] if kept else given.values())
        ]
    return Jumps((*found, *unkept), entered, unkept[0] if unkept else "")


def _judged(place: Place) -> list[str]:
    """Topics that `safe` reads and neither the DM nor SC: nobody follows who publishes them."""
    followed = {*read_by_dm(place), *read_by_sc(place)}
    found = []
    for symbol in topic_reads(place.module.symbol.safe):
        index = place.module.scope.topics.get(symbol, -1)
        if index in place.driven and index not in followed:
            found.append(
                f"what `safe` says of {place.system.topics[index].name} is judged on what "
                f"{place.driven[index].name} drives: what is published there is not looked at"
            )
    return found


def _start(place: Place, link: typed.AbstractionLink) -> str:
    """From where on: what flies starts where `inputs.py` has it, if that is known."""
    if start_behind(place.flat, place.home, link) is None:
        return f"the initial states of {link.name}"
    return f"the start of {link.instance}"


def _environment(place: Place, inputs: Inputs, jumps: Jumps) -> list[str]:
    found = [
        f"{link.instance} behaves like {link.name} ({link.plant.name}) for some disturbance "
        f"within its bounds, from {_start(place, link)} on"
        for link in place.module.symbol.verify.abstracts
    ]
    found += jumps.told
    if place.abstract:
        found += _judged(place)
    names = ", ".join(c.name for c in place.plants)
    if not place.abstract:
        found.append(f"the world behaves like {names} for some disturbance within its bounds")
    of_others = {i.name(place.system) for i in place.influences}
    drawn = zip(inputs.disturbances, inputs.disturbance_ranges, strict=True)
    said = [(d.name in of_others, f"{d.name} in [{r.low:g}, {r.high:g}]") for d, r in drawn]
    for others, what in (
        (False, "disturbances stay within their bounds"),
        (True, "what others publish and what moves these plants stays in its declared set"),
    ):
        bounds = ", ".join(text for of, text in said if of is others)
        found += [f"{what}: {bounds}"] if bounds else []
    if inputs.errors:
        pairs = zip(inputs.errors, inputs.error_ranges, strict=True)
        bounds = ", ".join(f"{e.name} within {r.high:g}" for e, r in pairs)
        exact = _exact(place, inputs)
        rest = f"; exact: {', '.join(exact)}" if exact else ""
        found.append(f"measurement errors stay within their bounds: {bounds}{rest}")
    measured = {(e.owner, e.path) for e in inputs.errors}
    if place.driven and not measured:
        found.append("estimates are exact: no measurement error is declared")
    bounded = _published(place)
    if bounded:
        names = ", ".join(bounded)
        found.append(f"what plants publish lies in the declared sets: {names} (else they stop)")
    if inputs.others:
        names = ", ".join(o.name for o in inputs.others)
        found.append(f"{names}: any value of the declared set, at any time")
    return found


def _published(place: Place) -> list[str]:
    """Topics of which nothing shows that what plants publish lies in their sets.

    Of a plant that flies in the place of one of the proof: all. Else C is no more than what it can
    publish, but for lists, and arrays too long to be numbered.
    """
    if place.abstract:
        names = {place.around + link.instance for link in place.module.symbol.verify.abstracts}
        plants = [c for c in place.flat.components if c.name in names and c.plant is not None]
        topics = [place.flat.topics[c.scope.topics[t]] for c in plants for t in driven_by(c)]
        return list(dict.fromkeys(t.name for t in topics if t.set_declared))
    topics = [place.system.topics[c.scope.topics[t]] for c in place.plants for t in driven_by(c)]
    return [
        t.name
        for t in topics
        if t.set_declared and any(p in ("[]", "[*]") for path, _ in leaves(t.type) for p in path)
    ]


def driven_by(c: Component) -> list[typed.TopicSymbol]:
    """The topics that a plant drives."""
    return [] if c.plant is None else [t for t, _ in c.plant.drives]


def _ways(place: Place, routes: Routes) -> list[str]:
    """What stands between plant and module is followed in time, not in value."""
    found: list[str] = []
    if not place.abstract:
        return found
    for route in dict.fromkeys([*routes.by_dm, *routes.by_sc]):
        shown = place.shown_by(next(i for i in place.driven if _is(place, i, route)))
        through = ", ".join(_filter(n) for n in route.nodes)
        if route.source:
            first = route.nodes[0].name
            text = (
                f"what {first} publishes, on which {route.topic.name} rests, is its own, and the "
                "defaults of its topics are what it would have published before its first step"
            )
        elif route.sensor is None or route.sensor.name != shown:
            who = "the world" if route.sensor is None else route.sensor.name
            text = f"{route.topic.name} rests on {who}, too, whose age is followed"
        elif not route.nodes:
            text = f"{route.topic.name} shows the state of {shown} at the instant of publication"
        else:
            text = (
                f"{route.topic.name} shows, within the errors declared, the state of {shown} that "
                f"{through} read (how old that is, is followed)"
            )
        found.append(text)
    topics: dict[str, list[str]] = {}
    for topic, who in routes.beside:
        topics.setdefault(who, []).append(topic)
    found += [
        f"{who}, of which the proof knows nothing, is heard by nodes behind {', '.join(read)}: "
        "whatever it says, and however old that is, these show the plants of the proof"
        for who, read in topics.items()
    ]
    for kind, words in BEHIND.items():
        nodes = list(dict.fromkeys(n for w in routes.ways for n in getattr(w, kind)))
        if nodes:
            found.append(f"{', '.join(_filter(n) for n in nodes)}: {words}")
    on_the_way = [*routes.nodes, *routes.behind, *(n for w in routes.ways for n in w.in_step)]
    if on_the_way:
        names = ", ".join(dict.fromkeys(n.name for n in on_the_way))
        found.append(f"no step of {names} faults (a node that does is silent from then on)")
    return list(dict.fromkeys(found))


def _is(place: Place, index: int, route: Route) -> bool:
    return place.system.topics[index] is route.topic


def _filter(node: Component) -> str:
    assert node.node is not None
    kept = ", ".join(v.name for v in node.node.locals)
    return f"{node.name} (which keeps {kept})" if kept else node.name


def _exact(place: Place, inputs: Inputs) -> list[str]:
    """Leaves of what the DM and SC read of plants for which no error is declared."""
    measured = {(e.owner, e.path) for e in inputs.errors}
    found = []
    for index in dict.fromkeys([*read_by_dm(place), *read_by_sc(place)]):
        topic = place.system.topics[index]
        paths = [path for path, t in leaves(topic.type) if isinstance(t, FloatType)]
        found += [".".join((topic.name, *p)) for p in paths if (index, p) not in measured]
    return found


def _of_one_instant(place: Place) -> list[str]:
    """An estimate is the state at one instant plus an error, also when it comes in parts."""
    found = []
    for who, topics in (("the DM", read_by_dm(place)), ("SC", read_by_sc(place))):
        if len(topics) > 1:
            names = ", ".join(place.system.topics[t].name for t in topics)
            found.append(f"what {who} reads together shows the plants at one instant: {names}")
    return found


def _timing(place: Place, times: Times, routes: Routes, kind: str) -> list[str]:
    verify = place.module.symbol.verify
    found = []
    if not times.schedule.dropout and times.schedule.read_by_sc:
        found.append(NO_DROPOUT)
    if kind == "map":
        words = "plant, DM and SC run in the same instant, in this order, and commands act in it"
        return [*found, words]
    if times.schedule.dropout:
        found.append(
            f"a sensor is silent for at most {show_ns(times.schedule.dropout)} longer than its "
            "period, and never at its first release"
        )
    if times.age_sc:
        found.append(
            f"what SC reads is at most {show_ns(times.age_sc)} old (for SC no runtime enforces it)"
        )
    declared = [n for n in DELAYS if n in times.declared]
    if declared:
        shown = ", ".join(f"{n.replace('_', ' ')} {show_ns(getattr(times, n))}" for n in declared)
        found.append(f"times as declared: {shown}")
    nodes = sorted({*verify.late_of, *verify.response_of})
    if nodes:
        found.append(f"times as declared, too: of {', '.join(nodes)}")
    absent = [WORDS[n] for n in DELAYS if n not in times.declared]
    lasting = {n.name: n.takes_ns for n in (*routes.nodes, *routes.behind) if n.takes_ns}
    found += [
        f"{n} takes {show_ns(high)} a step at most, as it says" for n, (_, high) in lasting.items()
    ]
    absent += [
        f"{n} is on time" if n in lasting else f"{n} is on time and takes none"
        for n in undeclared(place, routes)
    ]
    if absent:
        found.append(f"undeclared times are zero: {', '.join(absent)}")
    found += times.rests
    found.append("SC waits for the DM, in one thread, and no release is skipped")
    found.append("commands of AC and SC act in the order in which they were published")
    return found


def _arithmetic(place: Place) -> list[str]:
    sc = place.sc.node
    found = []
    symbol = place.module.symbol
    roots: list[object] = [*(sc.step if sc is not None else ()), *symbol.predicates]
    for c in place.plants:
        assert c.plant is not None
        roots += [e for _, e in c.plant.lets]
        roots += [*c.plant.der.values(), *c.plant.next.values(), *(e for _, e in c.plant.drives)]
    inexact = sorted(n for n in _prelude_calls(roots) & set(BOUNDS) if n not in EXACT)
    if inexact:
        found.append(
            f"error bounds of {', '.join(inexact)}: tested, not proved; the libm that encloses "
            "them is within 8 units in the last place"
        )
    found.append("the compiler and the hardware compute binary64 as IEEE 754 says")
    return found


def _prelude_calls(roots: list[object]) -> set[str]:
    """Names of the prelude functions that are called, directly or through others."""
    found: set[str] = set()
    seen: set[typed.FunSymbol] = set()
    todo: list[object] = list(roots)
    while todo:
        for call in calls_in(todo.pop()):
            if call.fun in seen:
                continue
            seen.add(call.fun)
            if call.fun.prelude:
                found.add(call.fun.name)
            todo += call.fun.body or ()
    return found
