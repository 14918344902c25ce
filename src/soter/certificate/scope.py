"""What a re-checked certificate is not about.

Purpose: `parameters_of`, `uncovered`: the values that were checked; other systems that hold a
module, other modules, other values, and what nothing here looks at.
Non-goals: assumptions (`assumptions.py`), which are about what is covered.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from soter.certificate.reading.module_facts import Facts
from soter.certificate.report import RecheckAssumption
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import system_to_prove
from soter.language.model.system import holder_of
from soter.language.model.types import DurationType, show_ns

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.certificate.report import Said
    from soter.language.front_end import CheckResult
    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import ModuleSymbol, TypedProgram
    from soter.language.model.types import Value


class Covered(Protocol):
    """What is read of a module by whatever method it is proved."""

    flying: System
    flying_module: Module
    sc: Component

    @property
    def symbol(self) -> ModuleSymbol:
        """Its declaration."""


def parameters_of(system: System) -> dict[str, str]:
    """Every parameter of the program with the value that it has in a system."""
    return {name: _said(system.program, name, value) for name, value in system.params.items()}


def _said(program: TypedProgram, name: str, value: Value) -> str:
    param = program.param(name)
    assert param is not None
    plain = show_ns(int(value)) if isinstance(param.type, DurationType) else str(value).lower()
    return plain if isinstance(value, (bool, int)) else repr(value)


def otherwise_in_program(checked: CheckResult, system: System) -> tuple[dict[str, str], bool]:
    """Parameters that the program by itself gives another value in a system, with that value.

    Whether for one of them the system, or a part of it, says so (`set`): then it is no default.
    """
    try:
        own = system_to_prove(checked, system.name, {}, exact=False)
    except SoterError:
        return {}, False  # with its own values it is no program
    program, value_by_name, contradicted = system.program, {}, False
    for name, value in system.params.items():
        param = program.param(name)
        assert param is not None
        default = getattr(param.default, "value", None)
        said = own.params.get(name, own.params.get(param.name))
        if repr(said) != repr(value):
            value_by_name[name] = _said(program, name, said)
            contradicted |= repr(said) != repr(default)
    return value_by_name, contradicted


def uncovered(
    checked: CheckResult, overrides: Mapping[str, Any], covered: Sequence[Covered]
) -> list[RecheckAssumption]:
    """Everything that a reader might think is covered, and is not."""
    gaps = [*_modules(checked, overrides, covered)]
    if values := {n: v for f in covered for n, v in parameters_of(f.flying).items()}:
        shown = ", ".join(f"{n} = {v}" for n, v in values.items())
        gaps.append(("parameters", f"values of parameters other than {shown}"))
    for facts in covered:
        gaps += _of(facts)
    gaps += _plants_of_no_claim(covered)
    gaps.append(("compiled", "the code that a decision module is compiled to"))
    return [RecheckAssumption(key, text) for key, text in dict.fromkeys(gaps)]


def _modules(
    checked: CheckResult, overrides: Mapping[str, Any], covered: Sequence[Covered]
) -> Said:
    """Modules of any system of the program that the certificate is not about."""
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


def _modelled_of(system: System, covered: Sequence[Covered]) -> set[str]:
    own = (f for f in covered if f.flying is system and not (isinstance(f, Facts) and f.above))
    return {name for f in own for name in _modelled(f)}


def _plants_of_no_claim(covered: Sequence[Covered]) -> Said:
    """Plants that a value outside of a declared set stops, and that no claim is about."""
    for system in dict.fromkeys(f.flying for f in covered):
        modelled = _modelled_of(system, covered)
        for c in system.components:
            if c.plant is None or c.name in modelled:
                continue
            topics = [system.topics[c.scope.topics[t]] for t, _ in c.plant.drives]
            names = ", ".join(t.name for t in topics if t.set_declared)
            text = f"plant {c.name} of system {system.name}, which stops where what it drives"
            if names:
                key = f"plant {system.name} {c.name}"
                yield key, f"{text} leaves its declared set: {names}"


def _modelled(facts: Covered) -> set[str]:
    """Names in the system that flies of plants that claims, or abstractions of them, are about."""
    around = holder_of(facts.flying, facts.flying_module)
    names = {link.instance for link in facts.symbol.verify.abstracts}
    if isinstance(facts, Facts):
        names |= {c.name for c in facts.plants}
    return {*names, *(f"{around}.{name}" for name in names if around)}


def _of(facts: Covered) -> Said:
    """What is left open about a module that is covered."""
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
    said = system.program.systems.get(system.name)
    if said is not None and said.faults:
        text = f"runs of system {system.name} in which its `faults` go wrong"
        yield f"faults {system.name}", text
