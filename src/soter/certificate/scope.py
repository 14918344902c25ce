"""What a re-checked verdict is about: values and systems, and the assumptions that it rests on.

Purpose: `param_values` names the values that were checked, `open_questions` what a reader might
think is covered: other systems, modules and values, and what nothing here looks at.
`assumptions_of` and `confirmed_facts` derive assumptions again from the program: keys for programs,
texts for people.
Non-goals: what a manifest says about them: nothing is read there. What hand-overs, modes and nodes
on the way rest on is said where that is (`extras/`).

The argument: each part of the problem that the claims do not show is named here: the world and the
inputs with their ranges, the times, the machine. An assumption that is always made is always said.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from soter.certificate.extras import extras
from soter.certificate.reading.module_facts import (
    Facts,
    bounded_topics,
    const_value,
    topics_read,
)
from soter.certificate.reading.module_times import DELAYS
from soter.certificate.reading.supported_constructs import code_parts, plant_code
from soter.certificate.report import RecheckAssumption
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import system_to_prove
from soter.language.model.assumption_words import in_words
from soter.language.model.system import name_of_subsystem
from soter.language.model.typed import FunSymbol
from soter.language.model.types import DurationType, FloatType, leaf_name, leaves, show_ns
from soter.language.prelude.function_error_bounds import BOUNDS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.certificate.reading.module_facts import Input
    from soter.certificate.report import Said
    from soter.language.front_end import CheckResult
    from soter.language.model import typed
    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import ModuleSymbol, TypedProgram
    from soter.language.model.types import Value


WITHOUT_ERROR = ("clamp", "sign", "quat_conj")
"""Functions of the prelude that compute what they say."""


class Covered(Protocol):
    """The attributes that the facts of every covered module have, whatever the method of proof."""

    flying: System
    flying_module: Module
    sc: Component

    @property
    def symbol(self) -> ModuleSymbol:
        """The declaration of the module."""


def param_values(system: System) -> dict[str, str]:
    """Maps every parameter of the program to its value in a system."""
    return {name: _value_text(system.program, name, value) for name, value in system.params.items()}


def _value_text(program: TypedProgram, name: str, value: Value) -> str:
    param = program.param(name)
    assert param is not None
    plain = show_ns(int(value)) if isinstance(param.type, DurationType) else str(value).lower()
    return plain if isinstance(value, (bool, int)) else repr(value)


def other_values_in_program(checked: CheckResult, system: System) -> tuple[dict[str, str], bool]:
    """Parameters with other values in the program, by name, and whether a `set` gives one of these.

    The values that were checked are those of `system`.
    """
    try:
        own_values = system_to_prove(checked, system.name, {}, exact=False)
    except SoterError:
        return {}, False  # with its own values it is no program
    program, value_by_name, contradicted = system.program, {}, False
    for name, value in system.params.items():
        param = program.param(name)
        assert param is not None
        default = getattr(param.default, "value", None)
        flown = own_values.params.get(name, own_values.params.get(param.name))
        if repr(flown) != repr(value):
            value_by_name[name] = _value_text(program, name, flown)
            contradicted |= repr(flown) != repr(default)
    return value_by_name, contradicted


def open_questions(
    checked: CheckResult, overrides: Mapping[str, Any], covered: Sequence[Covered]
) -> list[RecheckAssumption]:
    """The assumptions about matters that a reader might wrongly think are covered."""
    gaps = [*_uncovered_modules(checked, overrides, covered)]
    if values := {n: v for f in covered for n, v in param_values(f.flying).items()}:
        shown = ", ".join(f"{n} = {v}" for n, v in values.items())
        gaps.append(("parameters", f"values of parameters other than {shown}"))
    for facts in covered:
        gaps += _questions_about_module(facts)
    gaps += _plants_of_no_claim(covered)
    gaps.append(("compiled", "the code that a decision module is compiled to"))
    return [RecheckAssumption(key, text) for key, text in dict.fromkeys(gaps)]


def _uncovered_modules(
    checked: CheckResult, overrides: Mapping[str, Any], covered: Sequence[Covered]
) -> Said:
    """Yields the modules of all systems of the program that the certificate does not cover."""
    known = {(f.flying.name, f.flying_module.name) for f in covered}
    for name in checked.systems:
        try:
            system = system_to_prove(checked, name, overrides, exact=False)
        except SoterError:
            yield f"system {name}", f"system {name}, which has errors with these parameters"
            continue
        for module in (m for m in system.modules if (name, m.name) not in known):
            forced = f" (forced to {module.forced})" if module.forced else ""
            text = f"module {module.name} of system {name}{forced}"
            yield f"module {name} {module.name}", text


def _modelled_plants_in(system: System, covered: Sequence[Covered]) -> set[str]:
    facts_of_system = (f for f in covered if f.flying is system)
    return {name for f in facts_of_system for name in _modelled_plants(f)}


def _plants_of_no_claim(covered: Sequence[Covered]) -> Said:
    """The plants that no claim is about; each stops where what it drives leaves a declared set."""
    for system in dict.fromkeys(f.flying for f in covered):
        modelled = _modelled_plants_in(system, covered)
        for c in system.components:
            if c.plant is None or c.name in modelled:
                continue
            topics = [system.topics[c.scope.topics[t]] for t, _ in c.plant.drives]
            names = ", ".join(t.name for t in topics if t.set_declared)
            text = f"plant {c.name} of system {system.name}, which stops where what it drives"
            if names:
                key = f"plant {system.name} {c.name}"
                yield key, f"{text} leaves its declared set: {names}"


def _modelled_plants(facts: Covered) -> set[str]:
    """The names, in the flying system, of the plants that claims are about, also if abstracted."""
    around = name_of_subsystem(facts.flying_module)
    names = {link.instance for link in facts.symbol.verify.abstracts}
    if isinstance(facts, Facts):
        names |= {c.name for c in facts.plants}
    return {*names, *(f"{around}.{name}" for name in names if around)}


def _questions_about_module(facts: Covered) -> Said:
    """Yields the questions that the claims about a module leave open, as keys and texts."""
    name, system, symbol = facts.flying_module.name, facts.flying, facts.symbol
    for link in symbol.verify.abstracts:
        text = f"whether {link.instance} of system {system.name} conforms to {link.plant.name}"
        yield f"conformance {system.name} {link.instance}", text
    if symbol.verify.dropout is None and symbol.verify.induction is None:
        yield f"dropout {name}", f"runs of {name} in which a sensor drops out"
    if symbol.contract:
        yield f"contract of {name}", f"the contract of {name}: assumes, guarantees"
    sc = facts.sc.node
    if sc is not None and (sc.assumes or sc.guarantees):
        yield f"contracts {sc.name}", f"the contracts of {sc.name}: assumes, guarantees"
    if any(p.component is None for p in system.properties):
        text = f"what system {system.name} says under `always` and `never`"
        yield f"properties {system.name}", f"{text}: only `safe` of {name} is covered"
    own_system = system.program.systems.get(system.name)
    if own_system is not None and own_system.faults:
        text = f"runs of system {system.name} in which its `faults` go wrong"
        yield f"faults {system.name}", text


def assumptions_of(facts: Facts, jumps: Mapping[str, Any] | None = None) -> list[RecheckAssumption]:
    """The assumptions about a module; `jumps`: the hand-overs for which a proof was tried."""
    links, axes = facts.symbol.verify.abstracts, facts.open_ends or facts.left_out or facts.turning
    parts = (
        extras.views.conformance_assumptions(facts) if links else (),
        extras.handovers.jump_assumptions(facts, jumps or {}) if facts.view else (),
        _plant_assumptions(facts),
        _input_assumptions(facts),
        extras.sc_locals_and_modes.mode_assumptions(facts) if facts.reads_any_mode else (),
        extras.node_paths.node_assumptions(facts.ways) if facts.ways.notes else (),
        _timing_assumptions(facts),
        _machine_assumptions(facts),
        extras.views.assumptions_on_topics_of_safe(facts) if links else (),
        extras.left_out_states.axis_assumptions(facts) if axes else (),
        fitted_number_assumptions(facts),
    )
    return [RecheckAssumption(key, text) for part in parts for key, text in part]


def fitted_number_assumptions(facts: Covered) -> Said:
    """Yields the assumptions that numbers fitted to logs are right."""
    for name, held_out in facts.flying.program.identified.items():
        yield f"identified {name}", in_words("identified", name, held_out, held_out + 1)


def confirmed_facts(facts: Facts, jumps: Mapping[str, Any]) -> list[RecheckAssumption]:
    """Lists confirmed facts besides the claims: sets that topics keep to, and hand-overs."""
    entries = []
    for index in facts.in_sets:
        if not facts.symbol.verify.abstracts:
            name = facts.system.topics[index].name
            text = f"what plants publish lies in the declared set of {name} for every state that "
            entries.append((f"set {name}", text + "SC keeps, errors included"))
    entries += extras.handovers.confirmed_jumps(facts, jumps) if jumps else ()
    return [RecheckAssumption(key, text) for key, text in entries]


# ---------------------------------------------------------------- the world


def _plant_assumptions(facts: Facts) -> Said:
    if not facts.symbol.verify.abstracts:
        names = ", ".join(c.name for c in facts.plants)
        yield f"world {names}", in_words("world", names)
    if facts.kind == "flow":
        yield "scheme", in_words("every solution" if facts.at_rest else "scheme")
    for p in facts.parameters:
        yield f"changes {p.name}", in_words("changes", p.name)


def _range_text(x: Input) -> str:
    return f"{x.name} in [{x.low:g}, {x.high:g}]"


def _unit_text(x: Input) -> str:
    return f" {x.unit}" if x.unit else ""


def _input_assumptions(facts: Facts) -> Said:
    for d in facts.disturbances:
        kind = "others" if d.of_others else "disturbance"
        text = in_words(kind, f"{_range_text(d)}{_unit_text(d)}")
        yield f"disturbance {_range_text(d)}", text
    for e in facts.errors:
        text = in_words("error", f"{e.name} within {e.high:g}{_unit_text(e)}")
        yield f"error {e.name} {e.high:g}", text
    measured = {(e.owner, e.leaf) for e in facts.errors}
    by_dm, by_sc = topics_read(facts)
    for index in dict.fromkeys([*by_dm, *by_sc]):
        topic = facts.system.topics[index]
        for k, (path, leaf_type) in enumerate(leaves(topic.type)):
            name = leaf_name(topic.name, path)
            if isinstance(leaf_type, FloatType) and (index, k) not in measured:
                yield f"exact {name}", in_words("exact", name)
    for name in dict.fromkeys(_unproved_sets(facts)):
        yield f"set {name}", in_words("set", name)
    for name in dict.fromkeys(o.name for o in facts.others):
        yield f"other {name}", in_words("other", name)


def _unproved_sets(facts: Facts) -> Iterator[str]:
    """Yields the names of driven topics that are not shown to stay in their declared sets.

    These include all topics of abstracted plants and of plants outside the proof.
    """
    links, names = facts.symbol.verify.abstracts, {c.name for c in facts.plants}
    for index in bounded_topics(facts):
        if links or index not in facts.in_sets:
            yield facts.system.topics[index].name
    for c in facts.flying.components:
        if c.plant is not None and (links or c.name not in names):
            driven = [facts.flying.topics[c.scope.topics[t]] for t, _ in c.plant.drives]
            yield from (t.name for t in driven if any(b is not None for b in t.bounds))


# ---------------------------------------------------------------- time


def _delay_assumptions(facts: Facts) -> Said:
    verify = facts.symbol.verify
    for key, (delay, name) in DELAYS.items():
        if getattr(verify, name) is not None:
            time = show_ns(facts.times[key])
            if key == "L_ns" and verify.acts_least is not None:
                time = f"{show_ns(const_value(facts, verify.acts_least))} to {time}"
            yield f"declared {delay} {time}", in_words("declared", f"{delay} {time}")
        elif facts.kind == "flow":
            yield f"undeclared {delay}", in_words("undeclared", delay)


def _timing_assumptions(facts: Facts) -> Said:
    for name in facts.ways.undeclared:
        yield f"undeclared {name}", in_words("undeclared", f"lateness or response of {name}")
    if facts.kind == "map":
        yield "one instant", in_words("one instant")
        if facts.symbol.shield is not None:
            yield "one instant of AC", in_words("one instant of AC")
    # a chain lets each command begin by itself, and what rests is shown by chains alone
    if facts.jitter_ns and len(facts.controls) > 1 and facts.symbol.rest is None:
        names = ", ".join(c.name for c in facts.controls)
        yield f"together {names}", in_words("together", names)
    yield from _delay_assumptions(facts)
    if facts.thread:
        yield f"thread {facts.thread}", facts.thread
    if facts.kind == "flow":
        yield "sensors on time", in_words("sensors on time")
    yield from ((key, in_words(key)) for key in ("wait", "order"))
    if facts.setting.silent:
        silent = show_ns(facts.setting.silent)
        text = f"sensors are silent for {silent} longer than their periods at most"
        yield f"dropout {silent}", text
    else:  # nothing declared, or `dropout 0ms`
        yield "no dropout", in_words("no dropout")
    if facts.symbol.failsafe:
        yield "lease", in_words("lease", show_ns(facts.times["L_ns"]))
    yield "fresh", in_words("fresh")
    yield from acknowledgement_assumption(facts.symbol)


def acknowledgement_assumption(symbol: typed.ModuleSymbol) -> Said:
    """The assumption that is made where a DM gives control back only after a press."""
    if symbol.latch is not None and symbol.latch.topic is not None:
        name = symbol.latch.topic.name
        yield f"acknowledged {name}", in_words("acknowledged", name)


def _machine_assumptions(facts: Facts) -> Said:
    """Yields the assumptions about binary64 and about the prelude functions in use."""
    assert facts.sc.node is not None
    code: list[object] = [*facts.sc.node.step, *facts.symbol.predicates]
    code += [e for c in facts.plants if c.plant is not None for e in plant_code(c.plant)]
    functions = {f for f in code_parts(code) if isinstance(f, FunSymbol) and f.prelude}
    for name in sorted({f.name for f in functions} & BOUNDS.keys() - {*WITHOUT_ERROR}):
        yield f"bound of {name}", f"the error bound of {name}: tested, not proved"
    yield "binary64", in_words("binary64")
