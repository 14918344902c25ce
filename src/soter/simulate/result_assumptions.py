"""The assumptions of a result in words, as every result has to print them.

Purpose: `verdict_by_property` says which of the paper's properties of a module are proved;
`run_assumptions` gives a sentence for each assumption of a run.
Non-goals: proving (`verify/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.evaluate.statements import Evaluator
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
"""If more signals than this have the same bound, they are counted, not named."""


def verdict_by_property(module: Module) -> dict[str, str]:
    """The verdict (`proved` or `assumed`) on each property of a module that was not verified."""
    del module  # the same for every module
    return {**dict.fromkeys(PROVED, "proved"), **dict.fromkeys(ASSUMED, "assumed")}


def _map_assumptions(system: System, modules: Iterable[Module]) -> Iterator[str]:
    for m in modules:
        for t in topic_reads(m.symbol.safe):
            if t.static:
                name = system.topics[m.scope.topics[t]].name
                yield f"{m.name}: what {name} calls free stays free, for ever"


def code_assumptions(system: System, proofs: Mapping[str, Proof] | None = None) -> list[str]:
    """Sentences on assumptions about modules that may switch, and about trusted externs.

    `proofs`: the proof of each module by name, if exactly this system was verified.
    """
    free = [module for module in system.modules if module.forced is None]
    assumptions = _proof_sentences(system, free, proofs or {})
    assumptions += [
        _delay_note(module) for module in free if _command_delay_ns(module) > module.period_ns
    ]
    assumptions += [
        f"{module.name}: not shown, and taken for true: {module.unshown}"
        for module in free
        if module.unshown
    ]
    assumptions += _map_assumptions(system, free)
    trusted = [
        component.name
        for component in system.components
        if component.extern and component.role in ("sc", "node")
    ]
    if trusted:
        names = ", ".join(trusted)
        assumptions.append(f"{names}: extern and trusted, nothing is known about the code")
    return [*assumptions, *(text for module in free for text in _computed_notes(module))]


def _proof_sentences(system: System, free: list[Module], proofs: Mapping[str, Proof]) -> list[str]:
    """A sentence for each module on which of its properties are proved or assumed."""
    assumptions = [
        _proof_sentence(m.name, proofs[m.name]) + _unproved_code(system)
        for m in free
        if m.name in proofs
    ]
    rest = [m.name for m in free if m.name not in proofs]
    if rest:
        which = ", ".join(rest)
        sentence = f"{which}: {' '.join(ASSUMED)} assumed, not checked {_checker_of_runs(system)}"
        assumptions.append(sentence)
    return assumptions


def _command_delay_ns(m: Module) -> int:
    """The greatest delay of a module's commands in ns, by `acts within` of its `verify` block."""
    acts = m.symbol.verify.acts
    return 0 if acts is None else int(Evaluator(m.scope.params).value(acts))


def _computed_notes(m: Module) -> Iterator[str]:
    missing = [n for n in ("ttf", "safer") if getattr(m.symbol, n) is None]
    if missing:
        whence = "from the plants and the grid of its `verify` block"
        if not m.symbol.verify.groups:
            whence = "from the plants and a grid, which the program does not say (`verify --write`)"
        if m.symbol.rest is not None:
            whence = "SC is followed from each estimate to where it rests"
        yield (
            f"{m.name} has no {' and no '.join(missing)}: computed before it runs or is built, "
            f"{whence}; where they cannot be, its AC never gets control"
        )


def _delay_note(m: Module) -> str:
    late = show_ns(_command_delay_ns(m))
    return f"{m.name}: commands act at once in a run; {late} of `acts within` count in its proof"


def _proof_sentence(name: str, proof: Proof) -> str:
    """A sentence on which properties of a module are proved, assumed, undecided or refuted."""
    count = len(proof.assumptions)
    parts = []
    if shown := proof.names_with("proved", *ASSUMED):
        under = f"under {count} assumption{'' if count == 1 else 's'}"
        parts.append(f"{' '.join(shown)} proved {under} (by `soter verify`, of exactly this)")
    if taken := proof.names_with("assumed", *ASSUMED):
        parts.append(f"{' '.join(taken)} assumed")
    open_ = [(verdict, proof.names_with(verdict)) for verdict in ("undecided", "refuted")]
    parts += [f"{' '.join(missing)} {verdict}" for verdict, missing in open_ if missing]
    safe = ": not a proof of safety" if proof.open_names else ""
    return f"{name}: {', '.join(parts)}{safe}"


def _unproved_code(system: System) -> str:
    """A clause that names the extern code that no proof covers; "" if there is none."""
    names = [x.name for x in system.components if x.extern and x.role != "ac"]
    names += [f.name for f in system.program.funs.values() if f.extern]
    if not names:
        return ""
    return f"; the code of {', '.join(names)} (extern) is in no proof, and may have changed since"


def _checker_of_runs(system: System) -> str:
    if system.proved is None:
        return "(`soter verify` does)"
    return f"(`soter build --cert` carries what was proved of {system.proved.name})"


def forced_module_notes(system: System) -> list[str]:
    """A sentence for each module that the system forces into one mode."""
    return [
        f"{m.name} is forced to {m.forced.upper()}: it protects nothing in this system"
        for m in system.modules
        if m.forced is not None
    ]


def environment_assumptions(system: System) -> list[str]:
    """Sentences on assumptions about the plants and the inputs of a system."""
    assumptions = []
    for component in system.components:
        if component.plant is not None:
            assumptions += _plant_assumptions(system, component)
    driven = {drive.topic for drive in system.inputs}
    inputs = [
        topic for topic in system.topics if topic.driver == "input" and topic.queue_of is None
    ]
    still = [topic.name for topic in inputs if topic.index not in driven]
    if still:
        unless = " unless somebody outside publishes it" if system.externals else ""
        assumptions.append(
            f"{', '.join(still)} {'keep' if len(still) > 1 else 'keeps'} the default value{unless}"
        )
    for drive in system.inputs:
        name, every = system.topics[drive.topic].name, show_ns(drive.every_ns)
        which = f"its {len(drive.values)} declared values" if drive.values else "its set"
        assumptions.append(f"{name} changes every {every} to a value drawn evenly from {which}")
    return assumptions


def step_assumptions(system: System) -> list[str]:
    """Sentences on how long steps take, one for each component that declares it."""
    return [
        f"{x.name} takes {_interval_text(*x.takes_ns)} a step, drawn evenly; what it publishes "
        "counts then, and releases meanwhile are lost"
        for x in system.components
        if x.takes_ns is not None
    ]


def _interval_text(low: int, high: int) -> str:
    return show_ns(low) if low == high else f"{show_ns(low)} to {show_ns(high)}"


def fault_assumptions(system: System) -> list[str]:
    """Sentences on the declared faults: those that proofs allow for, and all others."""
    inside_by_text: dict[str, bool] = {}
    for fault in system.faults:
        if fault.on is None:
            inside_by_text[fault.text] = (
                inside_by_text.get(fault.text, True) and fault.inside is not None
            )
    inside = [f"`{text}`" for text, kept in inside_by_text.items() if kept]
    beyond = [f"`{text}`" for text, kept in inside_by_text.items() if not kept]
    beyond += ["`order any`"] if system.shuffled else []
    assumptions = (
        [f"goes wrong inside of what proofs assume: {', '.join(inside)}"] if inside else []
    )
    if beyond:
        assumptions.append(f"goes wrong outside of what proofs assume: {', '.join(beyond)}")
    return assumptions


def run_assumptions(system: System, proofs: Mapping[str, Proof] | None = None) -> list[str]:
    """A sentence for each assumption of a run; `proofs` is that of `code_assumptions`."""
    taken = [
        *code_assumptions(system, proofs),
        *forced_module_notes(system),
        *step_assumptions(system),
        *environment_assumptions(system),
    ]
    return [*taken, *fault_assumptions(system)]


def _plant_assumptions(system: System, x: Component) -> list[str]:
    if x.extern:
        return [f"{x.name} is an extern plant: a simulation of somebody else's"]
    assumptions = []
    if x.disturbances:
        terms = [
            f"{d.variable.name} in [{d.low:g}, {d.high:g}]{_unit_suffix(d.variable.type)}"
            for d in x.disturbances
        ]
        assumptions.append(f"{x.name}: {', '.join(terms)}, drawn evenly")
    if x.measured:
        bounds = _error_bounds(system, x)
        assumptions.append(f"{x.name}: measurement errors within {bounds}, drawn evenly")
    return assumptions


def _error_bounds(system: System, x: Component) -> str:
    """The error bounds of a plant in words, with units, and with signal names if it has several."""
    signals: dict[str, list[str]] = {}
    for m in x.measured:
        topic = system.topics[m.topic]
        path, leaf = list(leaves(topic.type))[m.leaf]
        bound = f"{m.bound:g}{_unit_suffix(leaf)}"
        signals.setdefault(bound, []).append(leaf_name(topic.name, path))
    if len(signals) == 1:
        return next(iter(signals))
    return ", ".join(
        f"{bound} of {' and '.join(names) if len(names) <= NAMED_MAX else f'{len(names)} signals'}"
        for bound, names in signals.items()
    )


def _unit_suffix(t: Type) -> str:
    """The unit to write after a number; "" for a type without a single unit."""
    return f" {t.unit}" if isinstance(t, (FloatType, IntType)) and t.unit else ""
