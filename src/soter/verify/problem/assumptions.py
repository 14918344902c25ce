"""The assumptions of a verification problem, in words.

Purpose: `assumptions_of` writes all that a proof of one problem takes for granted; every verdict is
printed with them.
Non-goals: checking them (`monitor/model_membership.py`, `soter run`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.elaborate.views_for_proofs import start_of_proof_plant
from soter.language.model.assumption_words import in_words
from soter.language.model.tree_walk import calls_in, topic_reads
from soter.language.model.types import FloatType, leaf_name, leaves, show_ns
from soter.language.prelude.function_error_bounds import BOUNDS
from soter.verify.induction.handover import jumping_topics
from soter.verify.problem.problem import FRESH, SCHEME, Assumption, Jumps, latch_assumptions
from soter.verify.problem.problem_times import DELAYS, nodes_without_times
from soter.verify.problem.supported_constructs import identified_assumptions, map_assumptions
from soter.verify.problem.verification_system import read_by_dm, read_by_sc

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model import typed
    from soter.language.model.system import Component
    from soter.verify.problem.cause_effect_chains import CauseEffectChain, CauseEffectChains
    from soter.verify.problem.inputs import Inputs
    from soter.verify.problem.problem import Leaf, ProblemKind, Times
    from soter.verify.problem.verification_system import VerificationSystem

EXACT = ("clamp", "sign", "quat_conj")
"""Prelude functions that are exact, so that no error bound is assumed."""
BEHIND = {
    "in_step": "in the thread of the module, started when SC has published, however late that is; "
    "what they make of a command belongs to the plants of the proof",
    "counted": "pass a command on at their next step, which is counted; what they make of it "
    "belongs to the plants of the proof",
    "inner": "between commands and plants, with sensors of their own; what they make of a command "
    "belongs to the plants of the proof, and no wait of theirs is counted beside `acts within`",
}


def assumptions_of(
    place: VerificationSystem,
    inputs: Inputs,
    times: Times,
    chains: CauseEffectChains,
    kind: ProblemKind,
    jumps: Jumps,
) -> list[Assumption]:
    """The assumptions of a problem; a proof may later show SCHEME and some assumptions on jumps."""
    assumptions = [
        *_world_assumptions(place, inputs, jumps),
        *map_assumptions(place),
        *identified_assumptions(place.flat.program),
        *_node_assumptions(place, chains),
        *_timing_assumptions(place, times, chains, kind),
    ]
    if kind == "flow":
        assumptions.append(SCHEME)
    assumptions += [FRESH, *latch_assumptions(place.module.symbol)]
    changing = [p.name for p in inputs.parameters]
    assumptions += [Assumption(f"changes {name}", in_words("changes", name)) for name in changing]
    assumptions += _arithmetic_assumptions(place)
    return assumptions


def _declared_enters(place: VerificationSystem) -> typed.TypedExpr:
    assert place.home.whole is not None
    enters = place.home.whole.verify.enters
    assert enters is not None
    return enters


def jumps_of(place: VerificationSystem) -> Jumps:
    """The assumptions about jumps in the states of all abstractions of a module."""
    assumptions: list[Assumption] = []
    entered: dict[str, str] = {}
    unkept: list[Assumption] = []
    for link in place.module.symbol.verify.abstracts:
        jumps_by_topic = {h.topic: h for h in jumping_topics(place.flat, place.home, link)}
        kept = [h for h in jumps_by_topic.values() if not h.why]
        unproved = [t for t in topic_reads(link.value) if t not in {h.topic for h in kept}]
        if unproved:
            read = ", ".join(t.name for t in unproved)
            text = (
                f"where {read} change, on which the state of {link.name} rests, that state moves "
                f"as {link.plant.name} does, or jumps while the estimate lies in S_0 of where it "
                "jumps to, whichever mode; DM and SC read what shows it from that instant on"
            )
            assumptions.append(Assumption(f"jumps {link.name}", text))
        for h in kept:
            enters = _declared_enters(place)
            fact = (
                f"wherever `{' '.join(enters.span.text.split())}` holds of what {h.node} reads and "
                f"publishes in one step, the state of {link.name} lies in R(H) of where it jumps to"
            )
            alone = (
                f"{h.node} changes what it rests on of {h.topic.name} in no other step, and shows "
                "it to DM and SC in the same one"
            )
            key = f"enters {link.name} {h.topic.name}"
            assumptions.append(Assumption(key, f"{fact} ({alone}: proved)"))
            entered[key] = f"{fact}; {alone}: proved"
        unkept += [
            Assumption(
                f"unkept {link.name} {h.topic.name}",
                f"`enters` shows nothing of {h.topic.name}, on which {link.name} rests: {h.why}",
            )
            for h in ([] if kept else jumps_by_topic.values())
        ]
    return Jumps((*assumptions, *unkept), entered, unkept[0].text if unkept else "")


def _judged_assumptions(place: VerificationSystem) -> list[Assumption]:
    """The assumptions about plants' topics that `safe` reads but DM and SC do not read."""
    followed = {*read_by_dm(place), *read_by_sc(place)}
    assumptions = []
    for symbol in topic_reads(place.module.symbol.safe):
        index = place.module.scope.topics.get(symbol, -1)
        if index in place.driven and index not in followed:
            topic, plant = place.system.topics[index].name, place.driven[index].name
            text = in_words("judged", topic, plant)
            assumptions.append(Assumption(f"judged {topic} {plant}", text))
    return assumptions


def _start_in_words(place: VerificationSystem, link: typed.AbstractionLink) -> str:
    """The instant from which an abstraction holds, in words."""
    if start_of_proof_plant(place.flat, place.home, link) is None:
        return f"the initial states of {link.name}"
    return f"the start of {link.instance}"


def _world_assumptions(place: VerificationSystem, inputs: Inputs, jumps: Jumps) -> list[Assumption]:
    assumptions = [
        Assumption(
            f"conforms {link.instance} {link.name}",
            in_words(
                "conforms", link.instance, link.name, link.plant.name, _start_in_words(place, link)
            ),
        )
        for link in place.module.symbol.verify.abstracts
    ]
    assumptions += jumps.assumptions
    if place.abstract:
        assumptions += _judged_assumptions(place)
    names = ", ".join(c.name for c in place.plants)
    if not place.abstract:
        assumptions.append(Assumption(f"world {names}", in_words("world", names)))
    assumptions += [*_bound_assumptions(place, inputs), *_error_assumptions(place, inputs)]
    named = [
        *(("set", name) for name in _topics_with_unproved_sets(place)),
        *(("left out", x.name) for x in inputs.left_out),
        *(("other", o.name) for o in inputs.others),
    ]
    assumptions += [Assumption(f"{kind} {name}", in_words(kind, name)) for kind, name in named]
    return assumptions


def _bound_assumptions(place: VerificationSystem, inputs: Inputs) -> Iterator[Assumption]:
    """The assumptions on bounds of disturbances, and of topics by which others move plants."""
    of_others = {i.name_in_proofs(place.system) for i in place.influences}
    drawn = zip(inputs.disturbances, inputs.disturbance_ranges, strict=True)
    for d, r in drawn:
        kind = "others" if d.name in of_others else "disturbance"
        bounds = f"{d.name} in [{r.low:g}, {r.high:g}]"
        yield Assumption(f"disturbance {bounds}", in_words(kind, f"{bounds}{_unit_text(d)}"))


def _error_assumptions(place: VerificationSystem, inputs: Inputs) -> Iterator[Assumption]:
    """The assumptions about errors of estimates, and about the leaves that are exact."""
    for e, r in zip(inputs.errors, inputs.error_ranges, strict=True):
        text = in_words("error", f"{e.name} within {r.high:g}{_unit_text(e)}")
        yield Assumption(f"error {e.name} {r.high:g}", text)
    for name in _exact_leaf_names(place, inputs):
        yield Assumption(f"exact {name}", in_words("exact", name))


def _unit_text(leaf: Leaf) -> str:
    return f" {leaf.unit}" if leaf.unit else ""


def _topics_with_unproved_sets(place: VerificationSystem) -> list[str]:
    """The names of topics for which no proof shows that plants publish within the declared sets.

    For an abstraction these are all topics that the flying plant drives; otherwise only topics with
    lists, or with arrays too long to be numbered.
    """
    if place.abstract:
        names = {place.home_prefix + link.instance for link in place.module.symbol.verify.abstracts}
        plants = [c for c in place.flat.components if c.name in names and c.plant is not None]
        topics = [place.flat.topics[c.scope.topics[t]] for c in plants for t in topics_driven_by(c)]
        return list(dict.fromkeys(t.name for t in topics if t.set_declared))
    topics = [
        place.system.topics[c.scope.topics[t]] for c in place.plants for t in topics_driven_by(c)
    ]
    return [
        t.name
        for t in topics
        if t.set_declared and any({"[]", "[*]"} & {*path} for path, _ in leaves(t.type))
    ]


def topics_driven_by(c: Component) -> list[typed.TopicSymbol]:
    """The topics that a plant drives."""
    return [] if c.plant is None else [t for t, _ in c.plant.drives]


def _node_assumptions(place: VerificationSystem, chains: CauseEffectChains) -> list[Assumption]:
    """The assumptions on nodes between plants and module; proofs follow only their times."""
    assumptions: list[Assumption] = []
    if not place.abstract:
        return assumptions
    followed = dict.fromkeys([*chains.by_dm, *chains.by_sc])
    assumptions += [
        Assumption(f"shows {c.topic.name}", _source_in_words(place, c)) for c in followed
    ]
    topics: dict[str, list[str]] = {}
    for topic, who in chains.beside:
        topics.setdefault(who, []).append(topic)
    assumptions += [
        Assumption(
            f"beside {who}",
            f"{who}, of which the proof knows nothing, is heard by nodes behind {', '.join(read)}: "
            "whatever it says, and however old that is, these show the plants of the proof",
        )
        for who, read in topics.items()
    ]
    for kind, words_of_kind in BEHIND.items():
        nodes = list(dict.fromkeys(n for w in chains.ways for n in getattr(w, kind)))
        if nodes:
            text = f"{', '.join(_node_in_words(n) for n in nodes)}: {words_of_kind}"
            assumptions.append(Assumption(kind.replace("_", " "), text))
    on_the_way = [*chains.nodes, *chains.behind, *(n for w in chains.ways for n in w.in_step)]
    if on_the_way:
        names = ", ".join(dict.fromkeys(n.name for n in on_the_way))
        text = f"no step of {names} faults (a node that does is silent from then on)"
        assumptions.append(Assumption("nodes run", text))
    return list(dict.fromkeys(assumptions))


def _source_in_words(place: VerificationSystem, chain: CauseEffectChain) -> str:
    """The words that say which plant's state a topic of the module shows."""
    shown = place.plant_shown_by(
        next(i for i in place.driven if place.system.topics[i] is chain.topic)
    )
    through = ", ".join(_node_in_words(n) for n in chain.nodes)
    if chain.source:
        return (
            f"what {chain.nodes[0].name} publishes, on which {chain.topic.name} rests, is its own, "
            "and the defaults of its topics are what it would have published before its first step"
        )
    if chain.sensor is None or chain.sensor.name != shown:
        who = "the world" if chain.sensor is None else chain.sensor.name
        return f"{chain.topic.name} rests on {who}, too, whose age is followed"
    if not chain.nodes:
        return f"{chain.topic.name} shows the state of {shown} at the instant of publication"
    return (
        f"{chain.topic.name} shows, within the errors declared, the state of {shown} that "
        f"{through} read (how old that is, is followed)"
    )


def _node_in_words(node: Component) -> str:
    assert node.node is not None
    kept = ", ".join(v.name for v in node.node.locals)
    return f"{node.name} (which keeps {kept})" if kept else node.name


def _exact_leaf_names(place: VerificationSystem, inputs: Inputs) -> list[str]:
    """The names of the leaves of plants that DM and SC read without a declared error."""
    measured = {(e.owner, e.path) for e in inputs.errors}
    leaf_names = []
    for index in dict.fromkeys([*read_by_dm(place), *read_by_sc(place)]):
        topic = place.system.topics[index]
        paths = [path for path, t in leaves(topic.type) if isinstance(t, FloatType)]
        leaf_names += [leaf_name(topic.name, p) for p in paths if (index, p) not in measured]
    return leaf_names


def _timing_assumptions(
    place: VerificationSystem, times: Times, chains: CauseEffectChains, kind: ProblemKind
) -> list[Assumption]:
    assumptions = [Assumption(key, in_words(key)) for key in ("wait", "order")]
    if not times.schedule.dropout and times.schedule.read_by_sc:
        assumptions.append(Assumption("no dropout", in_words("no dropout")))
    if kind == "map":
        keys = ["one instant", *["one instant of AC"] * (place.module.symbol.shield is not None)]
        return assumptions + [Assumption(key, in_words(key)) for key in keys]
    if times.schedule.dropout:
        text = (
            f"a sensor is silent for at most {show_ns(times.schedule.dropout)} longer than its "
            "period, and never at its first release"
        )
        assumptions.append(Assumption("dropout", text))
    if times.age_sc:
        age = show_ns(times.age_sc)
        text = f"what SC reads is at most {age} old (for SC no runtime enforces it)"
        assumptions.append(Assumption("age", text))
    assumptions += [*_declared_time_assumptions(place, times, chains)]
    assumptions += [Assumption("thread", text) for text in times.rests]
    return [*assumptions, Assumption("sensors on time", in_words("sensors on time"))]


def _declared_time_assumptions(
    place: VerificationSystem, times: Times, chains: CauseEffectChains
) -> Iterator[Assumption]:
    """The assumptions about times that the program declares, and about times that it leaves out."""
    verify = place.module.symbol.verify
    for name in DELAYS:
        kind, text = "undeclared", name.replace("_", " ") + " within" * (name == "acts")
        if name in times.declared:
            kind, text = "declared", f"{text} {_declared_time_in_words(times, name)}"
        yield Assumption(f"{kind} {text}", in_words(kind, text))
    if nodes := sorted({*verify.late_of, *verify.response_of}):
        yield Assumption("declared of nodes", f"times as declared, too: of {', '.join(nodes)}")
    lasting = {n.name: n.takes_ns for n in (*chains.nodes, *chains.behind) if n.takes_ns}
    for name, (_, high) in lasting.items():
        yield Assumption(
            f"takes {name}", f"{name} takes {show_ns(high)} a step at most, as it says"
        )
    for name in nodes_without_times(place, chains):
        text = in_words("undeclared", f"lateness or response of {name}")
        yield Assumption(f"undeclared {name}", text)


def _declared_time_in_words(times: Times, name: str) -> str:
    """A declared time in words; for `acts` the range from the least to the longest."""
    least = times.acts_least if name == "acts" else 0
    return f"{show_ns(least)} to " * bool(least) + show_ns(getattr(times, name))


def _arithmetic_assumptions(place: VerificationSystem) -> list[Assumption]:
    sc = place.sc.node
    assumptions = []
    symbol = place.module.symbol
    roots: list[object] = [*(sc.step if sc is not None else ()), *symbol.predicates]
    for c in place.plants:
        assert c.plant is not None
        roots += [e for _, e in c.plant.lets]
        roots += [*c.plant.der.values(), *c.plant.next.values(), *(e for _, e in c.plant.drives)]
    inexact = sorted(n for n in _prelude_calls(roots) & set(BOUNDS) if n not in EXACT)
    if inexact:
        text = (
            f"error bounds of {', '.join(inexact)}: tested, not proved; the libm that encloses "
            "them is within 8 units in the last place"
        )
        assumptions.append(Assumption("prelude", text))
    assumptions.append(Assumption("binary64", in_words("binary64")))
    return assumptions


def _prelude_calls(roots: list[object]) -> set[str]:
    """The names of the prelude functions that expressions call, directly or through others."""
    names: set[str] = set()
    seen: set[typed.FunSymbol] = set()
    todo: list[object] = list(roots)
    while todo:
        for call in calls_in(todo.pop()):
            if call.fun in seen:
                continue
            seen.add(call.fun)
            if call.fun.prelude:
                names.add(call.fun.name)
            todo += call.fun.body or ()
    return names
