"""Checks whether a module's own `safe` holds on its topics at the end of an instant.

Purpose: `CompiledSafe` evaluates the predicates in C, beside a program that runs natively;
`InterpretedSafe` evaluates them in Python, for other runs. `SafeTally` counts the looks (steps) of
each DM after whose instant `safe` was false, that is, after the nodes behind the DM have stepped.
Non-goals: properties, which are judged on the truth; why a DM decided (`explain_decision.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from soter.codegen import c_tree as c
from soter.codegen import decisions
from soter.codegen.unit import UnitBuilder
from soter.core.core import Call
from soter.core.core_walks import walk
from soter.core.lower_statements import FunctionTable
from soter.core.steps import lower_predicate
from soter.language.model.system import environment_topics
from soter.language.model.tree_walk import topic_reads
from soter.native.c_interface import address
from soter.semantics.configuration import NEVER
from soter.simulate.explain_decision import Explainer

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy.typing as npt

    from soter.core.core import CoreSystem, Predicate
    from soter.core.layout import StateLayout
    from soter.language.model.system import Module, System
    from soter.native.loaded_program import Library

    States = npt.NDArray[Any]


class SafeJudge(Protocol):
    """Evaluates `safe` of modules on states."""

    def false_flags(self, module: int, states: States, rows: Sequence[int]) -> list[bool] | None:
        """For each of `rows` of the states, (n,), whether `safe` is false; a fault counts as false.

        None if `safe` calls an extern function, which only the run itself may call.
        """


# ---------------------------------------------------------------- in C


class JudgedUnit(UnitBuilder):
    """Builds the C of a system with a table `<prefix>_safe`: a row for each module in `judged`."""

    def __init__(self, system: System, core: CoreSystem) -> None:
        table = FunctionTable(system)
        table.by_name.update((f.name, f) for f in core.functions)
        every = {
            m.index: lower_predicate(table, system, m.scope, m.symbol.safe, m.symbol.safe.span)
            for m in system.modules
        }
        whole = replace(core, functions=tuple(table.by_name.values()))
        super().__init__(system, whole, None)
        extern = extern_functions(whole)
        self.judged = {m: p for m, p in every.items() if not _called_functions(p) & extern}

    @staticmethod
    def added_names(system: System) -> tuple[str, ...]:
        """The names that are added to the C: of the table, and of each module's predicate."""
        return ("safe", *(f"safe_{m.index}" for m in system.modules))

    def added_definitions(self) -> list[c.CTop]:
        """The C definitions of the predicates and of the table that lists them."""
        functions: list[c.CTop] = []
        rows: list[tuple[None, c.CExpr]] = []
        for module, predicate in self.judged.items():
            name = f"{self.prefix}_safe_{module}"
            doc = f"`safe` of {self.system.modules[module].name} is false"
            function = decisions.predicate_function
            functions.append(function(self.frame, predicate, name, doc, unsafe=True, negate=True))
            rows.append((None, c.named_fields(violated=c.Name(name))))
        if not rows:
            return []
        table, kind = f"{self.prefix}_safe", "soter_property_info"
        initializer = c.Initializer(tuple(rows))
        return [*functions, c.VariableDef(kind, table, initializer, array=True, static=False)]


def _called_functions(p: Predicate) -> set[str]:
    return {x.function for x in walk((*p.body, p.value)) if isinstance(x, Call)}


def extern_functions(core: CoreSystem) -> set[str]:
    """The names of functions that are extern or call an extern function."""
    extern: set[str] = set()
    for f in core.functions:
        called = {x.function for x in walk(f.body) if isinstance(x, Call)}
        if f.result is None or called & extern:
            extern.add(f.name)
    return extern


class CompiledSafe:
    """The predicates of a `JudgedUnit`, compiled and loaded."""

    def __init__(self, library: Library, path: Path, unit: JudgedUnit) -> None:
        self._ffi = library.ffi
        self._row = {module: k for k, module in enumerate(unit.judged)}
        self._table: Any = None
        if unit.judged:
            name = f"{unit.prefix}_safe"
            self._table = address(library.ffi, path, name, "const soter_property_info *")

    def false_flags(self, module: int, states: States, rows: Sequence[int]) -> list[bool] | None:
        """The flags that `SafeJudge.false_flags` describes; `states`, (n,), are contiguous."""
        if module not in self._row:
            return None
        judge, size = self._table[self._row[module]].violated, states.dtype.itemsize
        first = self._ffi.cast("const uint8_t *", states.ctypes.data)
        return [judge(first + row * size) for row in rows]


# ---------------------------------------------------------------- by the evaluator


class InterpretedSafe:
    """The predicates of a system, evaluated in Python."""

    def __init__(self, system: System, layout: StateLayout) -> None:
        explainer = Explainer(system, layout)
        self._holds = [explainer.safe_predicate(m.index) for m in system.modules]

    def false_flags(self, module: int, states: States, rows: Sequence[int]) -> list[bool] | None:
        """The flags that `SafeJudge.false_flags` describes, for `states`, (n,)."""
        holds = self._holds[module]
        return None if holds is None else [not holds(states[row].tobytes()) for row in rows]


# ---------------------------------------------------------------- counting


@dataclass(frozen=True)
class SafeLooks:
    """How many looks of a module's DM had fresh reads, and in how many `safe` was false.

    `outside`, the second number, is None if `safe` was not judged.
    """

    looks: int = 0
    outside: int | None = None
    first_outside_s: float | None = None


class SafeTally:
    """Counts for each module the looks of its DM after which `safe` was false."""

    def __init__(self, system: System, judge: SafeJudge) -> None:
        self._judge = judge
        self._inputs = [_reads_with_defaults(system, m) for m in system.modules]
        self.looks = [SafeLooks() for _ in system.modules]

    def count_looks(self, states: States, due: npt.NDArray[np.bool_]) -> None:
        """Counts the looks in the next n states; `due` (n, modules) marks the DMs that looked."""
        fresh = due & (states["modules"]["stale"] == 0)
        for module, needed in enumerate(self._inputs):
            looked = fresh[:, module]
            if needed:
                looked = looked & (states["stamps"][:, needed] != NEVER).all(axis=1)
            rows = np.flatnonzero(looked).tolist()
            false = self._judge.false_flags(module, states, rows)
            if false is not None:
                before = self.looks[module]
                first_s = before.first_outside_s
                if first_s is None and True in false:
                    first_s = int(states["header"]["ct"][rows[false.index(True)]]) / 1e9
                outside = (before.outside or 0) + sum(false)
                self.looks[module] = SafeLooks(before.looks + len(rows), outside, first_s)


def _reads_with_defaults(system: System, m: Module) -> list[int]:
    """The topics that `safe` reads and components publish; at first they hold only defaults."""
    read = {m.scope.topics[t] for t in topic_reads(m.symbol.safe)}
    return sorted(read - set(environment_topics(system)))
