"""The assumptions of a result, and what it does not show: assumptions are output.

Purpose: `verdicts` says which of the paper's properties of a module are proved; `of_run` puts
everything that a run takes for granted into words.
Non-goals: proving (`verify/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.statements import Evaluator
from soter.language.model.system import claims_nothing, modules_above
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import FloatType, IntType, leaf_name, leaves, show_ns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from soter.language.model.proof_verdicts import Proof
    from soter.language.model.system import Component, Module, System
    from soter.language.model.types import Type


PROVED = ("P1a", "P1b")
ASSUMED = ("P1c", "P2a", "P2b", "P3")
NAMED_MAX = 2
"""If a bound is that of more signals than this, the others are only counted."""


def verdicts(module: Module) -> dict[str, str]:
    """`proved` or `assumed` for each property; an ill-formed program never gets this far."""
    del module  # all alike: nothing is proved here
    return {**dict.fromkeys(PROVED, "proved"), **dict.fromkeys(ASSUMED, "assumed")}


def _stays_free(system: System, modules: Iterable[Module]) -> Iterator[str]:
    for m in modules:
        for t in topic_reads(m.symbol.safe):
            if t.static:
                name = system.topics[m.scope.topics[t]].name
                yield f"{m.name}: what {name} calls free stays free, for ever"


def unproved(system: System, proofs: Mapping[str, Proof] | None = None) -> list[str]:
    """Assumptions about code: modules that may switch, externs that are trusted.

    `proofs`: by module, where exactly this system was verified.
    """
    free = [m for m in system.modules if m.forced is None]
    assumptions = _proof_sentences(system, free, proofs or {})
    assumptions += [_at_once(m) for m in free if _acts_ns(m) > m.period_ns]
    assumptions += [
        f"{m.name}: not shown, and taken for true: {m.unshown}" for m in free if m.unshown
    ]
    assumptions += _stays_free(system, free)
    trusted = [x.name for x in system.components if x.extern and x.role in ("sc", "node")]
    if trusted:
        names = ", ".join(trusted)
        assumptions.append(f"{names}: extern and trusted, nothing is known about the code")
    return [*assumptions, *(text for m in free for text in _computed(m))]


def _proof_sentences(system: System, free: list[Module], proofs: Mapping[str, Proof]) -> list[str]:
    """Sentences on what is proved of modules, not claimed, or assumed."""
    assumptions = [
        _proved(m.name, proofs[m.name], _modes_above(system, m)) + _outside(system)
        for m in free
        if m.name in proofs
    ]
    for m in free:
        if claims_nothing(system, m) and m.name not in proofs:
            above = modules_above(system, m.index)[0].name
            assumptions.append(f"{m.name}: nothing is claimed of it; {above} is above it")
    rest = [m for m in free if m.name not in proofs and not claims_nothing(system, m)]
    if rest:
        which = ", ".join(m.name + _modes_above(system, m) for m in rest)
        said = f"{which}: {' '.join(ASSUMED)} assumed, not checked {_checker_of_runs(system)}"
        assumptions.append(said)
    return assumptions


def _acts_ns(m: Module) -> int:
    """How late a module's commands may act, in ns, as declared for its proof."""
    acts = m.symbol.verify.acts
    return 0 if acts is None else int(Evaluator(m.scope.params).value(acts))


def _computed(m: Module) -> Iterator[str]:
    missing = [n for n in ("ttf", "safer") if getattr(m.symbol, n) is None]
    if missing:
        whence = "from the plants and the grid of its `verify` block"
        if m.symbol.rest is not None:
            whence = "SC is followed from each estimate to where it rests"
        yield (
            f"{m.name} has no {' and no '.join(missing)}: computed before it runs or is built, "
            f"{whence}; where they cannot be, its AC never gets control"
        )


def _at_once(m: Module) -> str:
    late = show_ns(_acts_ns(m))
    return f"{m.name}: commands act at once in a run; {late} of `acts within` count in its proof"


def _modes_above(system: System, m: Module) -> str:
    """Words on when a claim about a module below others holds; "": always."""
    names = " and ".join(x.name for x in modules_above(system, m.index))
    return f" (while {names} is in AC)" if names else ""


def _proved(name: str, proof: Proof, whilst: str) -> str:
    """A sentence on what is proved of a module, and what is still assumed."""
    count = len(proof.assumptions)
    parts = []
    if shown := proof.of("proved", *ASSUMED):
        under = f"under {count} assumption{'' if count == 1 else 's'}"
        parts.append(f"{' '.join(shown)} proved {under} (by `soter verify`, of exactly this)")
    if taken := proof.of("assumed", *ASSUMED):
        parts.append(f"{' '.join(taken)} assumed")
    open_ = [(verdict, proof.of(verdict)) for verdict in ("undecided", "refuted")]
    parts += [f"{' '.join(missing)} {verdict}" for verdict, missing in open_ if missing]
    safe = ": not a proof of safety" if proof.open else ""
    return f"{name}{whilst}: {', '.join(parts)}{safe}"


def _outside(system: System) -> str:
    """Words on what in the system no proof covers."""
    names = [x.name for x in system.components if x.extern and x.role != "ac"]
    names += [f.name for f in system.program.funs.values() if f.extern]
    if not names:
        return ""
    return f"; the code of {', '.join(names)} (extern) is in no proof, and may have changed since"


def _checker_of_runs(system: System) -> str:
    if system.proved is None:
        return "(`soter verify` does)"
    return f"(`soter build --cert` carries what was proved of {system.proved.name})"


def forced(system: System) -> list[str]:
    """Sentences on modules that are forced, as the control arm of an experiment."""
    return [
        f"{m.name} is forced to {m.forced.upper()}: it protects nothing in this system"
        for m in system.modules
        if m.forced is not None
    ]


def of_environment(system: System) -> list[str]:
    """Assumptions about the plants and the inputs of a system."""
    assumptions = []
    for x in system.components:
        if x.plant is not None:
            assumptions += _plant(system, x)
    driven = {d.topic for d in system.inputs}
    inputs = [t for t in system.topics if t.driver == "input" and t.queue_of is None]
    still = [t.name for t in inputs if t.index not in driven]
    if still:
        unless = " unless somebody outside publishes it" if system.externals else ""
        assumptions.append(
            f"{', '.join(still)} {'keep' if len(still) > 1 else 'keeps'} the default value{unless}"
        )
    for d in system.inputs:
        name, every = system.topics[d.topic].name, show_ns(d.every_ns)
        which = f"its {len(d.values)} declared values" if d.values else "its set"
        assumptions.append(f"{name} changes every {every} to a value drawn evenly from {which}")
    return assumptions


def of_steps(system: System) -> list[str]:
    """Assumptions about how long steps take."""
    return [
        f"{x.name} takes {_interval(*x.takes_ns)} a step, drawn evenly; what it publishes counts "
        "then, and releases meanwhile are lost"
        for x in system.components
        if x.takes_ns is not None
    ]


def _interval(low: int, high: int) -> str:
    return show_ns(low) if low == high else f"{show_ns(low)} to {show_ns(high)}"


def of_faults(system: System) -> list[str]:
    """Sentences on declared faults, and whether proofs permit them."""
    said: dict[str, bool] = {}
    for f in system.faults:
        if f.on is None:
            said[f.text] = said.get(f.text, True) and f.inside is not None
    inside = [f"`{text}`" for text, kept in said.items() if kept]
    beyond = [f"`{text}`" for text, kept in said.items() if not kept]
    beyond += ["`order any`"] if system.shuffled else []
    assumptions = (
        [f"goes wrong inside of what proofs assume: {', '.join(inside)}"] if inside else []
    )
    if beyond:
        assumptions.append(f"goes wrong outside of what proofs assume: {', '.join(beyond)}")
    return assumptions


def of_run(system: System, proofs: Mapping[str, Proof] | None = None) -> list[str]:
    """All assumptions of a run of this system; `proofs` as in `unproved`."""
    taken = [*unproved(system, proofs), *forced(system), *of_steps(system), *of_environment(system)]
    return [*taken, *of_faults(system)]


def _plant(system: System, x: Component) -> list[str]:
    if x.extern:
        return [f"{x.name} is an extern plant: a simulation of somebody else's"]
    assumptions = []
    if x.disturbances:
        terms = [
            f"{d.variable.name} in [{d.low:g}, {d.high:g}]{_unit(d.variable.type)}"
            for d in x.disturbances
        ]
        assumptions.append(f"{x.name}: {', '.join(terms)}, drawn evenly")
    if x.measured:
        said = _errors(system, x)
        assumptions.append(f"{x.name}: measurement errors within {said}, drawn evenly")
    return assumptions


def _errors(system: System, x: Component) -> str:
    """Words for each error bound with its unit and, if there are several, its signals."""
    signals: dict[str, list[str]] = {}
    for m in x.measured:
        topic = system.topics[m.topic]
        path, leaf = list(leaves(topic.type))[m.leaf]
        bound = f"{m.bound:g}{_unit(leaf)}"
        signals.setdefault(bound, []).append(leaf_name(topic.name, path))
    if len(signals) == 1:
        return next(iter(signals))
    return ", ".join(
        f"{bound} of {' and '.join(names) if len(names) <= NAMED_MAX else f'{len(names)} signals'}"
        for bound, names in signals.items()
    )


def _unit(t: Type) -> str:
    """The unit to write behind a number; "" for a type with several leaves."""
    return f" {t.unit}" if isinstance(t, (FloatType, IntType)) and t.unit else ""
