"""Systems that stand in the world: topics of the outside, and what a deployed system must share.

Purpose: which topics come from outside, how late components may be; that a system which `deploys`
another one has its modules, nodes, parameters, periods and topics, so that what was proved there is
about the same code.
Non-goals: whether ages, delays and errors from outside are covered
(`verify/deploy/proof_transfer.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics
from soter.language.check.constants_and_types import Calculator

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.language.model import typed
    from soter.language.model.system import Component, External, Module, System, Topic


DIFFERENCES_SHOWN = 8


# ---------------------------------------------------------------- the world outside


def check_external(system: System, read: set[int], diagnostics: Diagnostics) -> None:
    """M024 for an external topic that no part of the system publishes or reads.

    Also for one that a part publishes and of which is said how it comes from outside.
    """
    for e in system.externals:
        topic = system.topics[e.topic]
        if topic.driver not in {"", "input"}:
            _goes_out(system, e, diagnostics)
            continue
        if e.topic in read:
            continue
        diagnostics.error(
            "M024",
            f"no part of system `{system.name}` publishes or reads `{topic.name}`",
            e.span,
            also=((topic.symbol.span, "the topic"),),
            notes=("an external topic is where a system meets the world",),
            helps=("leave it out, or add the node or module that it belongs to",),
        )


def _goes_out(system: System, e: External, diagnostics: Diagnostics) -> None:
    """M024 where something is said of the coming of what does not come."""
    said = [
        word
        for word, given in (
            ("every", e.every_ns is not None),
            ("delayed", e.delay_ns is not None),
            ("measured", any(x is not None for x in e.errors)),
        )
        if given
    ]
    if not said:
        return
    topic = system.topics[e.topic]
    words = ", ".join(f"`{w}`" for w in said)
    diagnostics.error(
        "M024",
        f"`{topic.name}` does not come from outside: {topic.driver} publishes it",
        e.span,
        f"{words} said here",
        also=((topic.symbol.span, "the topic"),),
        notes=("`every`, `delayed` and `measured` are about what somebody outside publishes",),
        helps=(f"write `external topic {topic.symbol.name};`",),
    )


def from_outside(system: System) -> tuple[External, ...]:
    """Those of its external topics that somebody outside publishes."""
    return tuple(e for e in system.externals if system.topics[e.topic].driver == "input")


def allowed_lateness(system: System) -> dict[int, int]:
    """Component -> how late it may start after its release, in ns, as `verify` blocks declare.

    A DM or SC whose module says nothing may not be late at all: proofs assume so. Others are in it
    where a block names them; of several blocks the strictest counts.
    """
    lateness_by_component: dict[int, int] = {}
    for m in system.modules:
        block = m.symbol.verify
        prefix = m.name[: len(m.name) - len(m.name.rpartition(".")[2])]
        calculator = Calculator(Diagnostics(), m.scope.params)
        said = [(m.dm, block.late_dm), (m.sc, block.late_sc)]
        names = {c.name: c.index for c in system.components}
        said += [(names[prefix + n], e) for n, e in block.late_of.items() if prefix + n in names]
        for index, expr in said:
            late = 0 if expr is None else int(calculator.value(expr, "`late`") or 0)
            lateness_by_component[index] = min(late, lateness_by_component.get(index, late))
    return lateness_by_component


# ---------------------------------------------------------------- the same system


def check_deployed(here: System, symbol: typed.SystemSymbol, diagnostics: Diagnostics) -> None:
    """M025 where `here` is not the system that it deploys, `proved`, without its plants."""
    there = here.proved
    if there is None or symbol.deploys is None:
        return
    differences = list(_differences(here, there))
    if not differences:
        return
    more = len(differences) - DIFFERENCES_SHOWN
    shown = differences[:DIFFERENCES_SHOWN] + ([f"and {more} more"] if more > 0 else [])
    diagnostics.error(
        "M025",
        f"system `{symbol.name}` is not `{there.name}` without its plants",
        symbol.span,
        also=((symbol.deploys.span, "said to be deployed"),),
        notes=tuple(shown),
        helps=(
            "let both have the same modules, nodes, parameters and topics",
            "what was proved holds for that system; verify a system like this one and deploy it",
        ),
    )


def _differences(here: System, there: System) -> Iterator[str]:
    yield from _plants(here)
    yield from _components(here, there)
    theirs = {m.name: m for m in there.modules}
    for m in here.modules:
        if m.name in theirs:
            yield from _module(here, m, there, theirs[m.name])
    topics = {t.name: t for t in there.topics}
    for t in here.topics:
        if t.queue_of is None and not t.held and t.name in topics:
            yield from _topic(t, topics[t.name])
    yield from _outside(here, there)


def _components(here: System, there: System) -> Iterator[str]:
    mine = {c.name: c for c in here.components if c.plant is None}
    proved = {c.name: c for c in there.components if c.plant is None}
    for name in [*proved, *(n for n in mine if n not in proved)]:
        if name not in mine:
            yield f"`{name}` is missing"
        elif name not in proved:
            yield f"`{name}` is not part of `{there.name}`"
        else:
            yield from _component(here, mine[name], there, proved[name])
    if mine.keys() == proved.keys() and list(mine) != list(proved):
        yield f"its parts step in another order: {', '.join(mine)}; there {', '.join(proved)}"


def _plants(here: System) -> Iterator[str]:
    for c in here.components:
        if c.plant is not None:
            yield f"it has a plant, `{c.name}`: the world itself takes its place"
    for drive in here.inputs:
        yield f"it draws `{here.topics[drive.topic].name}`: somebody outside publishes it"
    if here.faults or here.shuffled:
        yield "it has `faults`, which only runs have"


def _topics_of(system: System, c: Component) -> dict[str, str]:
    """What it calls its topics -> what they are called in the system."""
    return {t.name: system.topics[i].name for t, i in c.scope.topics.items()}


def _params(c: Component | Module) -> dict[str, str]:
    return {p.name: repr(v) for p, v in c.scope.params.items()}


def _component(here: System, mine: Component, there: System, proved: Component) -> Iterator[str]:
    pairs: tuple[tuple[str, object, object], ...] = (
        ("another declaration", mine.node, proved.node),
        ("another role", mine.role, proved.role),
        ("another period", mine.period_ns, proved.period_ns),
        ("another phase", mine.phase_ns, proved.phase_ns),
        ("other times of a step", mine.takes_ns, proved.takes_ns),
        ("another thread (`inline`)", mine.inline, proved.inline),
        ("other first values", repr(mine.initial), repr(proved.initial)),
        ("other parameters", _params(mine), _params(proved)),
        ("other topics", _topics_of(here, mine), _topics_of(there, proved)),
        ("other fail-safe values", _failsafe(here, mine), _failsafe(there, proved)),
        ("other modes to read", _modes(here, mine), _modes(there, proved)),
    )
    for what, a, b in pairs:
        if a != b:
            yield f"`{mine.name}` has {what} there"


def _failsafe(system: System, c: Component) -> dict[str, str]:
    return {system.topics[i].name: repr(v) for i, v in c.failsafe.items()}


def _modes(system: System, c: Component) -> dict[str, str]:
    return {
        m if isinstance(m, str) else m.name: system.modules[i].name
        for m, i in c.scope.modules.items()
    }


def _module(here: System, mine: Module, there: System, proved: Module) -> Iterator[str]:
    def over(system: System, m: Module) -> str:
        return "" if m.over is None else system.modules[m.over].name

    def around(m: Module) -> dict[str, str]:
        return {p.name: repr(v) for p, v in m.around.items()}

    def cells(m: Module) -> int:
        return 0 if m.shield is None else m.shield.cells

    pairs: tuple[tuple[str, object, object], ...] = (
        ("another declaration", mine.symbol, proved.symbol),
        ("another period", mine.period_ns, proved.period_ns),
        ("another `clean`", mine.clean, proved.clean),
        ("another `shield`", cells(mine), cells(proved)),
        ("other parameters", (_params(mine), around(mine)), (_params(proved), around(proved))),
        ("another module in the place of AC", over(here, mine), over(there, proved)),
    )
    for what, a, b in pairs:
        if a != b:
            yield f"module `{mine.name}` has {what} there"
    for name, forced in ((here.name, mine.forced), (there.name, proved.forced)):
        if forced is not None:
            yield f"module `{mine.name}` is forced to {forced.upper()} in `{name}`"


def _topic(mine: Topic, proved: Topic) -> Iterator[str]:
    pairs: tuple[tuple[str, object, object], ...] = (
        ("another declaration", mine.symbol, proved.symbol),
        ("another set", repr(mine.bounds), repr(proved.bounds)),
        ("another `max_age`", mine.max_age_ns, proved.max_age_ns),
        ("another first value", repr(mine.default), repr(proved.default)),
    )
    for what, a, b in pairs:
        if a != b:
            yield f"topic `{mine.name}` has {what} there"


def _outside(here: System, there: System) -> Iterator[str]:
    """What comes from outside was published by a plant or the environment there."""
    proved = {t.name: t for t in there.topics}
    for e in from_outside(here):
        name = here.topics[e.topic].name
        if name not in proved:
            yield f"topic `{name}` is not part of `{there.name}`"
        elif not (proved[name].driver == "input" or proved[name].driver.startswith("plant")):
            yield f"topic `{name}` is published by {proved[name].driver} there"
