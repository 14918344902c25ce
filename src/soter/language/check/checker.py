"""Makes a checked program of the loaded files.

Purpose: `Checker` checks the head of each declaration once, when needed, then all bodies.
Non-goals: numbers of a particular system (`system_numbers.py`), the paper's P1 (`wellformed.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.language.check.checker_interface import CallGraph, UnusedDeclarations, entries_by_need
from soter.language.check.constants_and_types import ConstantChecker, TypeChecker
from soter.language.check.declarations import DeclChecker
from soter.language.check.expr import ExprChecker
from soter.language.check.scope import Entry, FileScope, Meanings, Names
from soter.language.check.statements import StmtChecker
from soter.language.model import typed
from soter.language.model.tree_walk import count_costs

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.load.loader import LoadedProgram
    from soter.language.syntax import tree

NAMES_IN_CYCLE = 8


class Checker:
    """Checks one loaded program; the other checkers reach it through the protocol `Shared`."""

    def __init__(
        self, loaded: LoadedProgram, diagnostics: Diagnostics, meanings: Meanings | None = None
    ) -> None:
        self.loaded = loaded
        self.diagnostics = diagnostics
        self.names = Names(diagnostics, meanings)
        self.unused = UnusedDeclarations(diagnostics)
        self.calls = CallGraph(diagnostics, self._check_fun_body)
        expressions = ExprChecker(self)
        constants = ConstantChecker(self, loaded)
        self.declarations = DeclChecker(self, constants)
        self.resolve_type = TypeChecker(self).resolve_type
        self.check_expr = expressions.check
        self.check_block = StmtChecker(self, expressions).check_block
        self.const_value = constants.const_value
        self.evaluate = constants.evaluate
        self.check_number = constants.check_number
        self.topic_of_ref = self.declarations.topic_of_ref
        self.topic_of_path = self.declarations.topic_of_path
        self.topics_of_system = self.declarations.topics_of_system
        self.lost: dict[typed.SystemSymbol, frozenset[str]] = {}
        self.published: dict[typed.NodeSymbol, set[typed.TopicSymbol]] = {}
        self.damaged: set[object] = set()
        self.stand_ins: dict[typed.TopicSymbol, tuple[tuple[str, ...], typed.TopicSymbol]] = {}
        self._known_stand_ins: dict[tuple[int, tuple[str, ...], int], typed.TopicSymbol] = {}
        self._bodies: list[tuple[object, tree.Decl, FileScope]] = []
        self._late_bodies: list[tuple[object, tree.Decl, FileScope]] = []
        self._resolving: list[Entry] = []
        self._absorbed = [0, 0]

    def check_program(self) -> typed.TypedProgram:
        """Checks all declarations; gives the program, which is incomplete after errors."""
        for prelude in self.loaded.prelude:
            self.names.add_prelude(prelude)
        main = self.names.add_program(self.loaded.main)
        entries = [e for scope in self.names.scopes for e in scope.entries.values()]
        ordered, circles = entries_by_need(entries, self.names)
        for circle, span in circles:
            if all(e.state == "new" for e in circle):
                self._report_cycle(circle, span)
                circle[0].state = "done"
        for entry in ordered:
            self.resolve(entry, entry.decl.name.span, use=False)
        self._check_bodies()
        self.calls.report_recursion()
        program = typed.TypedProgram(str(self.loaded.main.path), "")
        for entry in entries:
            _register_symbol(program, entry)
        if not self.diagnostics.has_errors:
            count_costs(program, self.diagnostics)
        self.unused.warn_of_declarations(main)
        self.unused.report_kept()
        program.stand_ins = self.stand_ins
        program.damaged = self.damaged
        program.incomplete = any(e.symbol is None for e in main.entries.values()) or bool(
            main.broken
        )
        program.identified = self.loaded.identified
        program.sha256 = self.loaded.digest.hexdigest()
        return program

    def _check_bodies(self) -> None:
        self.calls.check_bodies()
        for bodies in (self._bodies, self._late_bodies):
            for symbol, decl, scope in bodies:
                self.declarations.check_body(symbol, decl, scope)
                self.calls.check_bodies()

    def _check_fun_body(self, fun: typed.FunSymbol, decl: tree.FunDecl, scope: FileScope) -> bool:
        before = self.damage_counts()
        self.declarations.check_fun_body(fun, decl, scope)
        return self.damage_counts() == before

    def check_body_later(self, symbol: object, decl: tree.Decl, scope: FileScope) -> None:
        """Queues a body to be checked once every signature is known; systems come last."""
        late = isinstance(symbol, (typed.SystemSymbol, typed.TestSymbol))
        (self._late_bodies if late else self._bodies).append((symbol, decl, scope))

    def damage_counts(self) -> tuple[int, int]:
        """Gives the counts of errors and losses; both grow when a declaration has errors."""
        errors, losses = self._absorbed
        return self.diagnostics.error_count - errors, self.names.losses - losses

    def absorb_damage(self, before: tuple[int, int]) -> None:
        """Subtracts from the damage counts the damage that has been counted since `before`."""
        now = self.damage_counts()
        self._absorbed[0] += now[0] - before[0]
        self._absorbed[1] += now[1] - before[1]

    # ------------------------------------------------------------ resolution on demand

    def resolve(self, entry: Entry, span: Span, *, use: bool = True) -> object:
        """Gives the symbol of a declaration, which it checks first if necessary; or None."""
        if use:
            entry.used = True
        if entry.state == "resolving":
            self._report_cycle(self._resolving[self._resolving.index(entry) :], span)
        elif entry.state == "new":
            self._resolve_entry(entry)
        if entry.symbol is None:
            self.names.losses += 1
        return entry.symbol

    def _resolve_entry(self, entry: Entry) -> None:
        entry.state = "resolving"
        self._resolving.append(entry)
        outer, self.calls.current = self.calls.current, None
        before = self.damage_counts()
        symbol = self.declarations.checked_symbol(entry)
        if symbol is not None and (
            self.damage_counts() != before or entry.decl.name.text in entry.scope.broken
        ):
            self.damaged.add(symbol)
            if isinstance(symbol, typed.FunSymbol):
                self.calls.mark_invalid(symbol)
        self.absorb_damage(before)
        self.calls.current = outer
        self._resolving.pop()
        entry.symbol = symbol
        entry.state = "done"

    def _report_cycle(self, circle: list[Entry], span: Span) -> None:
        """Reports T012 for entries that need each other in a circle, closed at `span`."""
        entry = circle[0]
        names = [e.decl.name.text for e in (*circle, entry)]
        names[0:1] = [f"{names[0]}` needs `{names[1]}"]
        del names[1]
        if len(names) > NAMES_IN_CYCLE:
            names[3:-3] = ["..."]
        name = entry.decl.name
        self.diagnostics.error(
            "T012",
            f"{entry.kind} `{name.text}` is defined by itself",
            name.span,
            "this needs itself",
            also=((span, "needed again here"),) if span != name.span else (),
            notes=(", which needs ".join(f"`{n}`" if n != "..." else n for n in names),)
            if len(circle) > 1
            else (),
        )

    def topic_of_instance(
        self, system: typed.SystemSymbol, prefix: list[str], topic: typed.TopicSymbol, span: Span
    ) -> typed.TopicSymbol:
        """Gives the symbol of a topic of the sub-system at `prefix`; the same one in each call."""
        key = (id(system), tuple(prefix), id(topic))
        known = self._known_stand_ins.get(key)
        if known is None:
            name = ".".join((*prefix, topic.name.rsplit(".", 1)[-1]))
            known = typed.TopicSymbol(
                name,
                span,
                topic.type,
                input=topic.input,
                values={},
                default=None,
                max_age=None,
                static=topic.static,
            )
            self._known_stand_ins[key] = known
            self.stand_ins[known] = (tuple(prefix), topic)
        return known


def _register_symbol(program: typed.TypedProgram, entry: Entry) -> None:
    tables: dict[type, dict[str, Any]] = {
        typed.ConstSymbol: program.consts,
        typed.ParamSymbol: program.params,
        typed.FunSymbol: program.funs,
        typed.TopicSymbol: program.topics,
        typed.NodeSymbol: program.nodes,
        typed.ModuleSymbol: program.modules,
        typed.PlantSymbol: program.plants,
        typed.SystemSymbol: program.systems,
        typed.TestSymbol: program.tests,
    }
    if (table := tables.get(type(entry.symbol))) is not None:
        table[entry.full_name] = entry.symbol


def check(loaded: LoadedProgram, diagnostics: Diagnostics) -> typed.TypedProgram:
    """Checks a loaded program; errors go into `diagnostics`."""
    return Checker(loaded, diagnostics).check_program()


__all__ = ["Checker", "check"]
