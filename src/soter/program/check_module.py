"""Check RTA modules: (N_ac, N_sc, N_dm, Delta, phi_safe, phi_safer) of the paper.

Purpose: `rta` declarations -> `ModuleSymbol`, `verify` blocks included.
Non-goals: P1a and P1b (`wellformed.py`), P2 and P3 (`reach/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.check_base import is_error, sound
from soter.program.check_node import period_or_unknown
from soter.program.check_order import mentioned
from soter.program.context import Context
from soter.program.types import BOOL, DURATION, FLOAT, INT, FloatType

if TYPE_CHECKING:
    from soter.diagnostics.span import Span
    from soter.program.checker import Checker
    from soter.program.scope import FileScope
    from soter.syntax import tree


class ModuleChecker:
    """Checks modules of one program."""

    def __init__(self, checker: Checker) -> None:
        self.checker = checker
        self.diagnostics = checker.diagnostics

    def node_ref(self, ref: tree.Ref, scope: FileScope) -> typed.NodeSymbol | None:
        """The node a reference means, or None after a report."""
        entry = self.checker.names.find_ref(scope, ref, "node")
        if entry is None:
            return None
        symbol = self.checker.resolve(entry, ref.span)
        if entry.kind != "node":
            self.diagnostics.error(
                "N003",
                f"`{ref.text}` is a {entry.kind}, not a node",
                ref.span,
                also=((entry.decl.name.span, "declared here"),),
            )
            return None
        return symbol if isinstance(symbol, typed.NodeSymbol) else None

    def signature(
        self, decl: tree.RtaDecl, scope: FileScope, full: str
    ) -> typed.ModuleSymbol | None:
        """Controllers and period; None where one of them is missing."""
        context = Context(scope, f"the declaration of module `{decl.name.text}`")
        parts = {"ac": decl.ac, "sc": decl.sc, "period": decl.period, "safe": decl.safe}
        missing = [word for word, part in parts.items() if part is None]
        if missing and decl.name.text not in scope.broken:
            examples = {
                "ac": "ac Fast;",
                "sc": "sc Careful;",
                "period": "period 50ms;",
                "safe": "safe motion.x < 10.0;",
            }
            self.diagnostics.error(
                "M006",
                f"module `{decl.name.text}` has no " + " and no ".join(f"`{m}`" for m in missing),
                decl.name.span,
                notes=("a module is an advanced and a safe controller, a period and a property",),
                helps=("add " + ", ".join(f"`{examples[m]}`" for m in missing),),
            )
        number = self.checker.constants.number
        ac = self.node_ref(decl.ac, scope) if decl.ac else None
        sc = self.node_ref(decl.sc, scope) if decl.sc else None
        period = number(decl.period, context, DURATION, "a period") if decl.period else None
        clean = number(decl.clean, context, INT, "`clean`") if decl.clean else None
        if decl.ac is None or decl.sc is None or decl.safe is None:
            return None
        if ac is None or sc is None or period is None:
            return None
        if ac in self.checker.damaged or sc in self.checker.damaged:
            self.checker.names.losses += 1
        module = typed.ModuleSymbol(
            full,
            decl.name.span,
            ac,
            sc,
            period_or_unknown(period),
            typed.Literal(BOOL, decl.safe.span, True),
            None,
            None,
            sound(clean),
            (),
            (),
            None,
            None,
            ac_span=decl.ac.span,
            sc_span=decl.sc.span,
        )
        self.checker.later(module, decl, scope)
        return module

    def body(self, module: typed.ModuleSymbol, decl: tree.RtaDecl, scope: FileScope) -> None:
        """Predicates and the `verify` block."""
        assert decl.safe is not None
        check = self.checker.expressions.check
        where = f"module `{decl.name.text}`"
        context = Context(scope, where, topics="any", has_modes=True)
        module.safe = check(decl.safe, context, BOOL)
        context.topics_read = {}
        module.ttf = check(decl.ttf, context, BOOL) if decl.ttf else None
        module.safer = check(decl.safer, context, BOOL) if decl.safer else None
        module.topics_read = tuple(context.topics_read)
        if (decl.ttf is None) != (decl.safer is None) and decl.name.text not in scope.broken:
            what, other = ("ttf", "safer") if decl.ttf is None else ("safer", "ttf")
            self.diagnostics.error(
                "M006",
                f"module `{decl.name.text}` has `{other}` but no `{what}`",
                decl.name.span,
                notes=("one decides when to leave AC, the other when to return to it",),
                helps=(f"write `{what}` too, or leave both out: then they are computed",),
            )
        if decl.verify is not None:
            self._verify(module, decl.verify, scope)

    # ------------------------------------------------------------ verification

    def _verify(
        self, module: typed.ModuleSymbol, verify: tree.VerifyBlock, scope: FileScope
    ) -> None:
        number = self.checker.constants.number
        context = Context(scope, "a `verify` block")
        if verify.horizon is not None:
            module.horizon = sound(number(verify.horizon, context, DURATION, "`horizon`"))
        if verify.levels is not None:
            module.levels = sound(number(verify.levels, context, INT, "`levels`"))
        axes: dict[tuple[typed.TopicSymbol, tuple[str, ...]], typed.GridAxis] = {}
        for item in verify.grid:
            axis = self._grid_axis(item, scope, context)
            if axis is None:
                continue
            first = axes.get((axis.topic, axis.path))
            if first is not None:
                self.diagnostics.error(
                    "N002",
                    f"the axis `{item.path.text}` is given twice",
                    item.path.span,
                    "again",
                    also=((first.span, "the first time"),),
                )
                continue
            axes[(axis.topic, axis.path)] = axis
        module.grid = tuple(axes.values())
        links: list[typed.AbstractionLink] = []
        for instance, parts in verify.abstracts:
            links += self._abstractions(module, instance, parts, scope)
        module.abstracts = tuple(links)

    def _grid_axis(
        self, axis: tree.GridAxis, scope: FileScope, context: Context
    ) -> typed.GridAxis | None:
        number = self.checker.constants.number
        low = number(axis.interval.low, context, FLOAT, "a bound")
        high = number(axis.interval.high, context, FLOAT, "a bound")
        cells = number(axis.cells, context, INT, "the number of cells")
        found = self.checker.declarations.topic_path(axis.path, scope)
        if found is None:
            return None
        topic, path, t = found
        if not isinstance(t, FloatType):
            self.diagnostics.error(
                "T001",
                f"expected `float`, found `{t}`",
                axis.path.span,
                "the axis of a grid is a `float`",
                helps=("name one of its fields",),
            )
            return None
        if is_error(low, high, cells):
            return None
        return typed.GridAxis(topic, path, low, high, cells, axis.path.span)

    # ------------------------------------------------------------ abstractions

    def _abstractions(
        self,
        module: typed.ModuleSymbol,
        instance: tree.Name,
        parts: tuple[tree.Abstraction, ...],
        scope: FileScope,
    ) -> list[typed.AbstractionLink]:
        """`abstracts d by along: Axis = e`: `e` is checked where `d` is, in every system."""
        links: list[typed.AbstractionLink] = []
        homes = self._homes(module, instance, scope)
        names: dict[str, Span] = {}
        for part in parts:
            if part.name.text in names:
                self.checker.names.twice(part.name.text, part.name.span, names[part.name.text])
            names.setdefault(part.name.text, part.name.span)
            plant = self._plant(part.plant, scope)
            value = None
            for context in homes:
                wanted = plant.truth if plant is not None else None
                checked = self.checker.expressions.check(part.value, context, wanted)
                value = value or (None if is_error(checked) else checked)
            if not homes:
                self._mentioned(part.value, scope)
            if plant is not None:
                links.append(
                    typed.AbstractionLink(
                        instance.text, part.name.text, plant, value, part.value.span
                    )
                )
        return links

    def _plant(self, ref: tree.Ref, scope: FileScope) -> typed.PlantSymbol | None:
        entry = self.checker.names.find_ref(scope, ref, "plant")
        if entry is None:
            return None
        plant = self.checker.resolve(entry, ref.span)
        if entry.kind != "plant":
            self.diagnostics.error(
                "N003",
                f"`{ref.text}` is a {entry.kind}, not a plant",
                ref.span,
                also=((entry.decl.name.span, "declared here"),),
            )
        return plant if isinstance(plant, typed.PlantSymbol) else None

    def _homes(
        self, module: typed.ModuleSymbol, instance: tree.Name, scope: FileScope
    ) -> list[Context]:
        """A context in each system that has module and instance; M013 where all lack the latter."""
        found: list[Context] = []
        lacking: list[tuple[typed.SystemSymbol, dict[str, typed.InstanceSymbol]]] = []
        for home in self.checker.names.scopes:
            for entry in home.entries.values():
                system = entry.symbol
                if not isinstance(system, typed.SystemSymbol):
                    continue
                if all(i.what is not module for i in system.instances):
                    continue
                instances = {i.name: i for i in system.instances}
                if instance.text in self.checker.declarations.systems.lost.get(system, ()):
                    continue
                if instance.text in instances:
                    where = f"the abstraction of `{instance.text}`"
                    found.append(Context(scope, where, instances=instances))
                else:
                    lacking.append((system, instances))
        if lacking and not found and all(s not in self.checker.damaged for s, _ in lacking):
            system, instances = lacking[0]
            self.diagnostics.error(
                "M013",
                f"system `{system.name}` has no instance `{instance.text}`",
                instance.span,
                "abstracted here",
                also=((system.span, f"has module `{module.name}`"),),
                helps=self.checker.names.suggestion(instance.text, instances),
            )
        return found

    def _mentioned(self, expr: tree.Expr, scope: FileScope) -> None:
        """Names in an expression that nobody can check yet are used all the same."""
        for qualifier, name, _ in mentioned(expr):
            if qualifier is not None and qualifier in scope.imports:
                scope.used_imports.add(qualifier)
            elif qualifier is None:
                self.checker.names.find(scope, name)
