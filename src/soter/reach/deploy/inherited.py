"""What a deployed system inherits of the one in which its modules were proved.

Purpose: the tables that were computed there; whether ages, delays and errors of what comes from
outside are covered by what the proof counts with, module by module; what is still assumed.
Non-goals: that both are the same program (`flatten/deployment/deployed.py`),
certificates (`api/deploying.py`).

What is compared, and why it suffices (docs/deploy.md, "What is inherited"): the theorem speaks of a
read as of one state, at most so old, within E. A value that is measured at least every e and
published at most l after it was measured is, at any time t, at most e + l old; its stamp is its
measurement or earlier. The DM enforces `max_age` itself; at a start of SC, up to Lambda after its
release, the stamp is at most e + l + Lambda old, which must not exceed `max_age` and the drop-out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.program.flatten.deployment.deployed import from_outside
from soter.program.flatten.derived import at_once, faultless
from soter.program.flatten.views import as_seen
from soter.program.model.durations import show_ns
from soter.program.model.types import FloatType, leaves
from soter.reach.induction.problem import InductionProblem
from soter.reach.problem.extract import extract

if TYPE_CHECKING:
    from soter.program.model.system import Component, External, Module, System, Topic
    from soter.reach.problem.problem import Problem

NO_ERROR = 0.0


@dataclass(eq=False)
class Inherited:
    """A module of a deployed system; `why_not`: why nothing of its proof holds here, or ""."""

    module: str
    why_not: str = ""
    covered: list[str] = field(default_factory=list)
    """What comes from outside, each with the bounds that the proof allows for."""
    assumptions: list[str] = field(default_factory=list)
    """What is assumed of the world and of the loop besides what the proof assumes."""


# ---------------------------------------------------------------- tables


def carry(here: System, there: System) -> None:
    """Gives the modules of `here` the predicates that were computed for those of `there`.

    A margin here counts until the next look and no further (`Module.looks` stays 1): that more
    looks keep AC is an argument about sensors, which may be covered or not.
    """
    for m in here.modules:
        proved = _module(there, m)
        if m.symbol.ttf is not None or proved.symbol.ttf is None:
            continue
        dm, sc = here.components[m.dm], here.components[m.sc]
        scope = {**sc.scope.topics, **m.scope.topics}
        m.symbol, m.computed = proved.symbol, proved.computed
        for topic in proved.symbol.topics_read:
            m.scope.topics.setdefault(topic, scope[topic])
            dm.scope.topics.setdefault(topic, scope[topic])
        m.inputs = tuple(scope[topic] for topic in proved.symbol.topics_read)


def _module(there: System, m: Module) -> Module:
    return next(x for x in there.modules if x.name == m.name)


# ---------------------------------------------------------------- what is covered


def inherited(here: System, there: System) -> tuple[Inherited, ...]:
    """Of every module what it inherits; `there` as it was declared, without computed predicates.

    `SoterError` D019 where something from outside is not covered.
    """
    diagnostics = Diagnostics()
    proved = faultless(at_once(there))
    _all_heard(here, there, diagnostics)
    found = [_of_module(here, m, proved, diagnostics) for m in here.modules]
    if diagnostics.has_errors:
        raise SoterError(diagnostics.items)
    return tuple(found)


def _all_heard(here: System, there: System, diagnostics: Diagnostics) -> None:
    """D019 where a plant reads what nobody takes out of the deployed system."""
    said = {here.topics[e.topic].name for e in here.externals}
    for c in there.components:
        for topic in c.plant.reads if c.plant is not None else ():
            name = there.topics[c.scope.topics[topic]].name
            if name not in said and there.topics[c.scope.topics[topic]].driver != "input":
                diagnostics.error(
                    "D019",
                    f"plant `{c.name}` reads `{name}`, and nobody takes it out of `{here.name}`",
                    here.program.systems[here.name].span,
                    also=((topic.span, "the topic"),),
                    helps=(f"add `external topic {name};`",),
                )


def _of_module(here: System, m: Module, there: System, diagnostics: Diagnostics) -> Inherited:
    found = Inherited(m.name)
    try:
        problems = [extract(*seen) for seen in as_seen(there, _module(there, m))]
    except SoterError as error:
        found.why_not = f"nothing can be proved of it: {error.diagnostics[0].message}"
        return found
    for problem in problems:
        found.why_not = found.why_not or _beyond(problem, _module(there, m))
    if found.why_not:
        return found
    for problem in problems:
        found.assumptions += [a for a in problem.assumptions if a not in found.assumptions]
    _covers(_Sensors(here, there, m), problems[0], found, diagnostics)
    return found


def _beyond(problem: Problem, module: Module) -> str:
    """Why a proof of this kind is not carried into the world."""
    if isinstance(problem, InductionProblem):
        return "a proof by induction is not carried over yet"
    if problem.kind != "flow":
        return "it was proved of plants that move in steps, and the world does not"
    if module.symbol.verify.abstracts or problem.view:
        return "a proof on verification plants (`abstracts`) is not carried over yet"
    return ""


class _Sensors:
    """What a module reads of the plants of the proved system."""

    def __init__(self, here: System, there: System, m: Module) -> None:
        self.here = here
        self.there = there
        self.said = {here.topics[e.topic].name: e for e in from_outside(here)}
        proved = _module(there, m)
        sc = there.components[proved.sc]
        read = [sc.scope.topics[s.topic] for s in sc.node.subscribes] if sc.node else []
        self.plants: dict[int, Component] = {}
        for c in there.components:
            for topic, _ in c.plant.drives if c.plant is not None else ():
                self.plants[c.scope.topics[topic]] = c
        wanted = [*read, *proved.inputs, *_of_axes(there, proved)]
        self.topics = [there.topics[i] for i in dict.fromkeys(wanted) if i in self.plants]

    def error_of(self, topic: Topic) -> list[float]:
        """What the proof allows for, leaf by leaf."""
        found = [NO_ERROR for _ in leaves(topic.type)]
        for m in self.plants[topic.index].measured:
            if m.topic == topic.index:
                found[m.leaf] = m.bound
        return found


def _of_axes(there: System, m: Module) -> list[int]:
    scope = {**there.components[m.sc].scope.topics, **m.scope.topics}
    axes = [a.topic for g in m.symbol.verify.groups for a in g.axes if a.topic is not None]
    return [scope[t] for t in axes if t in scope]


def _covers(s: _Sensors, problem: Problem, found: Inherited, diagnostics: Diagnostics) -> None:
    if len(s.topics) > 1:
        names = ", ".join(f"`{t.name}`" for t in s.topics)
        diagnostics.error(
            "D019",
            f"module `{found.module}` reads {names}, which come from outside one by one",
            s.here.program.systems[s.here.name].span,
            notes=("its proof is about reads that show the plant at one instant",),
            helps=("publish them as one topic, a record",),
        )
        return
    for topic in s.topics:
        e = s.said[topic.name]
        before = len(diagnostics.items)
        _errors(s, topic, e, diagnostics)
        _age(s, topic, e, problem, diagnostics)
        if len(diagnostics.items) == before:
            found.covered.append(_words(s, topic, e, problem))
            found.assumptions += [
                f"what moves starts where the plants of {s.there.name} do",
                f"{topic.name} is published before the first step (SOTER_UNHEARD tells)",
                "the loop runs every instant no later than `late` says (SOTER_LATE tells)",
                *(
                    f"{'.'.join((topic.name, *path))} is exactly what the plant would say"
                    for path, t in leaves(topic.type)
                    if not isinstance(t, FloatType)
                ),
            ]


def _errors(s: _Sensors, topic: Topic, e: External, diagnostics: Diagnostics) -> None:
    """The error of every float is said, and no wider than that of the plant."""
    for k, ((path, t), allowed) in enumerate(
        zip(leaves(topic.type), s.error_of(topic), strict=True)
    ):
        if not isinstance(t, FloatType):
            continue
        name = ".".join((topic.name, *path))
        own = e.errors[k]
        if own is not None and own <= allowed:
            continue
        told = f"within {own!r}" if own is not None else "nothing says how exact it is"
        diagnostics.error(
            "D019",
            f"the error of `{name}` is not covered by the proof in `{s.there.name}`",
            e.span,
            told,
            notes=(f"there its plant is `measured ... within {allowed!r}`",),
            helps=(f"write `measured {name} within {allowed!r}` or less, if that is true",),
        )


def _age(
    s: _Sensors, topic: Topic, e: External, problem: Problem, diagnostics: Diagnostics
) -> None:
    """It comes so often, and so soon, that SC never reads what is older than the proof allows."""
    if e.every_ns is None:
        diagnostics.error(
            "D019",
            f"nothing says how often `{topic.name}` comes",
            e.span,
            notes=("SC answers reads that are at most so old",),
            helps=(f"write `external topic {topic.name} every d`",),
        )
        return
    oldest, allowed = _oldest(e, problem), _allowed(topic, problem)
    if oldest <= allowed:
        return
    starts = show_ns(problem.times.schedule.start_of_sc)
    delay = show_ns(e.delay_ns or 0)
    diagnostics.error(
        "D019",
        f"`{topic.name}` may be {show_ns(oldest)} old when SC reads it",
        e.span,
        notes=(
            f"every {show_ns(e.every_ns)}, {delay} on its way, and SC starts up to {starts} late",
            f"the proof in `{s.there.name}` is about {show_ns(allowed)} (`max_age`, and `dropout`)",
        ),
        helps=("let it come more often, or prove with a larger `max_age`",),
    )


def _oldest(e: External, problem: Problem) -> int:
    assert e.every_ns is not None
    return e.every_ns + (e.delay_ns or 0) + problem.times.schedule.start_of_sc


def _allowed(topic: Topic, problem: Problem) -> int:
    return (topic.max_age_ns or 0) + problem.times.schedule.dropout


def _words(s: _Sensors, topic: Topic, e: External, problem: Problem) -> str:
    exact = [
        f"{'.'.join(path) or topic.name} within {own!r} of {allowed!r}"
        for (path, t), own, allowed in zip(
            leaves(topic.type), e.errors, s.error_of(topic), strict=True
        )
        if isinstance(t, FloatType)
    ]
    age = f"at most {show_ns(_oldest(e, problem))} old of {show_ns(_allowed(topic, problem))}"
    return f"{topic.name}: {age}, {', '.join(exact)}"
