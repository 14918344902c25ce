"""Core over first-order forms: C that encloses what step functions may do.

Purpose: `law`, `derivative` or `next`, `safe`, `constraint`, `core`, `ttf`, `safer`, `drives` of
one module over the forms of `verify/engine/soter_form.h` (docs/verification.md, section 2).
Non-goals: sets and fixpoints (`verify/engine/soter_reach.c`).

What a function does not read as an input ranges over its declared set, without a symbol.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_printer import print_file
from soter.language.model.tree_walk import PARTS_MAX, conjuncts
from soter.verify.enclose.enclosed_operations import EnclosureOperations
from soter.verify.enclose.enclosed_steps import Enclosed
from soter.verify.enclose.enclosure_emitter import (
    Emitter,
    EnclosureError,
    framed,
    given,
    names_in,
)
from soter.verify.problem.supported_constructs import ttf_of_states

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from soter.core import core as core_ir
    from soter.language.model.system import Module, System
    from soter.language.model.typed import TypedExpr
    from soter.verify.problem.problem import Quantities

__all__ = ["EnclosureError", "EnclosureUnit", "generate_enclosures"]

PARAMETERS = (
    ("const soter_form ", "in[]"),
    ("const int64_t ", "param[]"),
    ("soter_form ", "out[]"),
)
CONTROLS_MAX = 8
"""So many controls have a function of their own each."""
PREDICATE_PARAMETERS = (*PARAMETERS[:2], ("soter_truth ", "out[]"))


@dataclass(frozen=True)
class EnclosureUnit:
    """C text of one module's enclosures, and what they rest on."""

    source: str
    prelude: tuple[str, ...]
    """Prelude functions whose error bounds were used: tested
    (`language/prelude/function_error_bounds.py`)."""
    functions: tuple[str, ...]
    """Names of the functions that were emitted: `soter_law`, `soter_derivative`, ..."""
    reads: Mapping[str, frozenset[int]]
    """The float inputs that each of them reads, by its name without `soter_`."""
    boundless: frozenset[str]
    """Those that read a number of which nothing is known, as a state that is no input."""
    of_turns: frozenset[str]
    """Those that hang on how many turns a state has made that is read modulo a full turn."""


def generate_enclosures(
    system: System,
    core: core_ir.CoreSystem,
    module: Module,
    quantities: Quantities,
    core_hint: core_ir.Predicate | None = None,
    hint_functions: Mapping[str, core_ir.Function] | None = None,
    back: TypedExpr | None = None,
    *,
    apart: bool = False,
) -> EnclosureUnit:
    """The enclosures of a module in its verification system.

    `core_hint` is the predicate of `core e;`; functions it calls that are not in `core` stand in
    `hint_functions`; `back` is what P2b takes for `safer`, where that is something else. `apart`:
    the derivative of each state is a function of its own, too: `derivative_K`.
    EnclosureError says for people why something cannot be enclosed.
    """
    unit = _Unit(system, core, module, quantities)
    unit.run(core_hint, hint_functions or {}, back)
    if apart:
        unit.derivatives()
    prelude, boundless = tuple(sorted(unit.prelude)), frozenset(unit.boundless)
    of_turns = frozenset(unit.of_turns)
    return EnclosureUnit(unit.text(), prelude, tuple(unit.names), unit.reads, boundless, of_turns)


class _Unit:
    def __init__(
        self, system: System, core: core_ir.CoreSystem, module: Module, quantities: Quantities
    ) -> None:
        self.system = system
        self.core = core
        self.module = module
        self.quantities = quantities
        self.statics: dict[tuple[str, str], c.VariableDef] = {}
        self.prelude: set[str] = set()
        self.definitions: list[c.CTop] = []
        self.names: list[str] = []
        self.reads: dict[str, frozenset[int]] = {}
        self.boundless: set[str] = set()
        self.of_turns: set[str] = set()

    def run(
        self,
        hint: core_ir.Predicate | None,
        more: Mapping[str, core_ir.Function],
        back: TypedExpr | None,
    ) -> None:
        """Emit every function that there is something for."""
        symbol = self.module.symbol
        if not symbol.synthesized:
            self._law()
        if any(p.integrate for p in self.core.plants.values()):
            flow = Enclosed.is_flow(self.core)
            what = "derivative of every state" if flow else "every state one period later"
            name = "derivative" if flow else "next"
            self._numbers(name, what, lambda e: e.derivative() if flow else e.next())
        self._numbers("drives", "leaves of the topics that plants drive", lambda e: e.drives())
        self._truth("safe", lambda e: e.expression(symbol.safe, estimated=False))
        parts = conjuncts(symbol.safe)
        for k, part in enumerate(parts if len(parts) > 1 else []):
            self._conjunct(f"safe_{k}", part, estimated=False)
        self._constraint(symbol.safe, parts)
        if hint is not None:
            self._truth("core", lambda e: e.predicate(hint, more, estimated=False))
        ttf = ttf_of_states(symbol.ttf)
        for name, said in (("ttf", ttf), ("safer", symbol.safer), ("back", back)):
            if said is not None:
                self._estimated(name, said)
        if symbol.verify.enters is not None:
            self._if_possible("enters", symbol.verify.enters)

    def derivatives(self) -> None:
        """That of each state alone."""
        for k, leaf in enumerate(self.quantities.states):
            enclosed = self._enclosed()
            rate = given(0, enclosed.derivative()[k])
            doc = f"derivative of {leaf.name} alone"
            self._define(f"derivative_{k}", doc, PARAMETERS, enclosed.emitter, [rate])

    def _constraint(self, safe: TypedExpr, parts: list[TypedExpr]) -> None:
        """C, and its parts: those of `safe`, then what plants have to be able to publish."""
        self._truth("constraint", lambda e: e.constraint(safe))
        probe = self._enclosed()
        probe.drive()
        leaves = len(probe.published())
        numbers = [*range(leaves)] if len(parts) + leaves <= PARTS_MAX else [None]
        if len(parts) == PARTS_MAX:
            return  # it is checked as a whole
        for k, part in enumerate(parts):
            self._conjunct(f"constraint_{k}", part, estimated=False)
        for k, number in enumerate(numbers, len(parts)):
            self._truth(f"constraint_{k}", lambda e, n=number: e.publishing(n))  # type: ignore[misc]

    def _law(self) -> None:
        """All controls at once, and each alone: a group is moved by few, and asks very often.

        `law_K` leaves control K in out[K]. A fault elsewhere in SC is not seen by it: only `law`
        says that there is none.
        """
        enclosed = self._enclosed()
        results = [given(i, e) for i, e in enumerate(enclosed.law())]
        emitter = enclosed.emitter
        self._define("law", "SC's published controls", PARAMETERS, emitter, results)
        if 1 < len(results) <= CONTROLS_MAX:
            for k, result in enumerate(results):
                doc = f"{self.quantities.controls[k].name} alone; faults elsewhere are not seen"
                self._define(f"law_{k}", doc, PARAMETERS, emitter, [result], faults=False)

    def _estimated(self, name: str, said: TypedExpr) -> None:
        self._truth(name, lambda e: e.expression(said, estimated=True))
        parts = conjuncts(said)
        for k, part in enumerate(parts if len(parts) > 1 else []):
            self._conjunct(f"{name}_{k}", part, estimated=True)

    def _if_possible(self, name: str, said: TypedExpr) -> None:
        """Nothing where it cannot be enclosed: what rests on it is not shown then."""
        with suppress(EnclosureError):
            self._truth(name, lambda e: e.expression(said, estimated=True))

    def _conjunct(self, name: str, part: TypedExpr, *, estimated: bool) -> None:
        self._truth(name, lambda e: e.expression(part, estimated=estimated))

    # ------------------------------------------------------------ one function

    def _enclosed(self) -> Enclosed:
        emitter = Emitter(self.statics)
        return Enclosed(self.system, self.core, self.module, self.quantities, emitter, self.prelude)

    def _numbers(self, name: str, doc: str, make: Callable[[Enclosed], list[c.CExpr]]) -> None:
        enclosed = self._enclosed()
        results = [given(i, e) for i, e in enumerate(make(enclosed))]
        self._define(name, doc, PARAMETERS, enclosed.emitter, results)

    def _truth(self, name: str, make: Callable[[Enclosed], c.CExpr]) -> None:
        enclosed = self._enclosed()
        result = c.Assign(c.IndexExpr(c.Name("out"), _int(0)), make(enclosed))
        doc = f"`{name}` of {self.module.name}: false, true or either"
        self._define(name, doc, PREDICATE_PARAMETERS, enclosed.emitter, [result])

    def _define(
        self,
        name: str,
        doc: str,
        parameters: tuple[tuple[str, str], ...],
        emitter: Emitter,
        results: list[c.CStmt],
        *,
        faults: bool = True,
    ) -> None:
        body = framed(emitter.block, emitter.reads, results, faults=faults)
        mentioned = set(names_in(body))
        self.reads[name] = frozenset(k for k, x in emitter.reads.items() if x.text in mentioned)
        if EnclosureOperations(emitter).anything in mentioned:
            self.boundless.add(name)
        if emitter.reads_turns:
            self.of_turns.add(name)
        full = f"soter_{name}"
        self.names.append(full)
        self.definitions.append(
            c.FunctionDef("unsigned", full, parameters, body, doc, static=False)
        )

    def text(self) -> str:
        """The translation unit."""
        q = self.quantities
        counts = {
            "INPUTS": len(q.inputs),
            "STATES": len(q.states),
            "CONTROLS": len(q.controls),
            "DISTURBANCES": len(q.disturbances),
            "ERRORS": len(q.errors),
            "OTHERS": len(q.others),
            "PARAMS": len(q.parameters),
        }
        legend = [f"in[{i}] {x.name}" for i, x in enumerate(q.inputs)]
        legend += [f"param[{i}] {x.name}" for i, x in enumerate(q.parameters)]
        # no name of a system: what is equal in several is compiled, and computed with, once
        items: list[c.CTop] = [c.FileComment(("Enclosures of a module.", *legend))]
        items += [c.Define(f"SOTER_{n}", str(k)) for n, k in counts.items()]
        items.append(c.Include("soter_form.h"))
        prototypes = [
            c.FunctionDef(f.result, f.name, f.parameters, None, "", static=False)
            for f in self.definitions
            if isinstance(f, c.FunctionDef)
        ]
        used = {
            n for f in self.definitions if isinstance(f, c.FunctionDef) for n in names_in(f.body)
        }
        statics = [s for s in self.statics.values() if s.name in used]
        return print_file(c.CFile((*items, *prototypes, *statics, *self.definitions)))


def _int(value: int) -> c.CExpr:
    return c.Number(str(value))
