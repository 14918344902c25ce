"""Check plants: states, disturbances, dynamics, measurements.

Purpose: `plant` and `extern plant` declarations -> `PlantSymbol`.
Non-goals: numbers (`elaborate.py`), integration (`semantics/`, `lower/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.program import typed
from soter.program.check_expr import is_error, plain
from soter.program.context import Context
from soter.program.types import (
    DURATION,
    ERROR,
    FLOAT,
    INT,
    DurationType,
    ErrorType,
    FloatType,
    RecordType,
    is_vector,
)

if TYPE_CHECKING:
    from soter.program.checker import Checker
    from soter.program.scope import FileScope
    from soter.syntax import tree


class PlantChecker:
    """Checks plants of one program."""

    def __init__(self, checker: Checker) -> None:
        self.checker = checker
        self.diagnostics = checker.diagnostics

    def signature(self, decl: tree.PlantDecl, scope: FileScope, full: str) -> object:
        """Everything but the right-hand sides."""
        expressions = self.checker.expressions
        declarations = self.checker.declarations
        context = Context(scope, f"plant `{decl.name.text}`")
        period = expressions.check(decl.period, context, DURATION)
        if is_error(period):
            period = typed.Literal(DURATION, decl.period.span, 0, "<error>")
        declarations.check_binding(decl.source, decl.source_span)
        reads: list[typed.TopicSymbol] = []
        for ref in decl.reads:
            topic = declarations.topic_ref(ref, scope)
            if topic is not None and topic not in reads:
                reads.append(topic)
        states, initial, ranges = self._states(decl, scope, context)
        disturbances = self._disturbances(decl, scope, context, states)
        substeps: typed.Expr | None = None
        method = "rk4"
        if decl.integrate is not None:
            method = decl.integrate[0]
            if decl.integrate[1] is not None:
                substeps = expressions.check(decl.integrate[1], context, INT)
                substeps = None if is_error(substeps) else substeps
        truth = RecordType(
            tuple((v.name, v.type) for v in states if not isinstance(v.type, ErrorType)),
            f"{full}.truth",
        )
        plant = typed.PlantSymbol(
            full, decl.name.span, period, decl.extern,
            declarations._located(decl.source, scope),  # noqa: SLF001 - same room
            tuple(reads), (), tuple(states), tuple(initial), tuple(ranges), tuple(disturbances),
            (), {}, {}, method, substeps, (), truth,
        )
        self.checker.later(plant, decl, scope)
        return plant

    def _states(
        self, decl: tree.PlantDecl, scope: FileScope, context: Context
    ) -> tuple[
        list[typed.Variable], list[typed.Expr | None], list[tuple[typed.Expr, typed.Expr] | None]
    ]:
        expressions = self.checker.expressions
        states: list[typed.Variable] = []
        initial: list[typed.Expr | None] = []
        ranges: list[tuple[typed.Expr, typed.Expr] | None] = []
        for s in decl.states:
            t = self.checker.type_of(s.type, scope)
            if isinstance(t, DurationType):
                self.checker._no_duration(s.type)  # noqa: SLF001 - same room
                t = ERROR
            if any(v.name == s.name.text for v in states):
                self.diagnostics.error(
                    "N002", f"state `{s.name.text}` is declared twice", s.name.span
                )
                continue
            value = expressions.check(s.initial, context, t) if s.initial else None
            interval = None
            if s.interval is not None:
                if not isinstance(t, ErrorType) and not (isinstance(t, FloatType) or is_vector(t)):
                    self.diagnostics.error(
                        "V004", f"only floats can start anywhere in an interval, not `{t}`",
                        s.interval.span,
                    )
                low = expressions.check(s.interval.low, context, FLOAT)
                high = expressions.check(s.interval.high, context, FLOAT)
                interval = None if is_error(low, high) else (low, high)
                if value is not None:
                    self.diagnostics.error(
                        "V004", "a state starts at a value or in an interval, not both", s.span
                    )
            states.append(typed.Variable(s.name.text, t, "state", s.name.span, used=True))
            initial.append(None if value is None or is_error(value) else value)
            ranges.append(interval)
        return states, initial, ranges

    def _disturbances(
        self,
        decl: tree.PlantDecl,
        scope: FileScope,
        context: Context,
        states: list[typed.Variable],
    ) -> list[typed.DisturbanceSymbol]:
        expressions = self.checker.expressions
        found: list[typed.DisturbanceSymbol] = []
        for d in decl.disturbances:
            t = self.checker.type_of(d.type, scope)
            low = expressions.check(d.interval.low, context, FLOAT)
            high = expressions.check(d.interval.high, context, FLOAT)
            hold = expressions.check(d.hold, context, DURATION) if d.hold else None
            taken = [v.name for v in states] + [x.variable.name for x in found]
            if d.name.text in taken:
                self.diagnostics.error("N002", f"`{d.name.text}` is declared twice", d.name.span)
                continue
            if isinstance(t, ErrorType):
                continue
            if not (isinstance(t, FloatType) or is_vector(t)):
                self.diagnostics.error(
                    "T018", f"a disturbance is a float or a vector, not `{t}`", d.type.span
                )
                continue
            variable = typed.Variable(d.name.text, t, "disturbance", d.name.span)
            if is_error(low, high):
                low = high = typed.Literal(FLOAT, d.span, 0.0)
            if hold is not None and is_error(hold):
                hold = None
            found.append(typed.DisturbanceSymbol(variable, low, high, hold))
        return found

    # ------------------------------------------------------------ body

    def body(self, plant: typed.PlantSymbol, decl: tree.PlantDecl, scope: FileScope) -> None:
        """Lets, dynamics, outputs and measurement errors."""
        expressions = self.checker.expressions
        frame = {v.name: v for v in plant.states}
        frame.update({d.variable.name: d.variable for d in plant.disturbances})
        context = Context(
            scope, f"plant `{decl.name.text}`", topics=set(plant.reads), has_time=True,
            has_period=True, locals=[frame],
        )
        lets: list[tuple[typed.Variable, typed.Expr]] = []
        for item in decl.lets:
            t = self.checker.type_of(item.type, scope) if item.type else None
            value = expressions.check(item.value, context, t)
            if item.name.text in frame:
                self.diagnostics.error(
                    "N002", f"`{item.name.text}` is declared twice", item.name.span
                )
            variable = typed.Variable(
                item.name.text, t if t is not None else plain(value.type), "plantlet",
                item.name.span,
            )
            frame[item.name.text] = variable
            lets.append((variable, value))
        plant.lets = tuple(lets)
        self._dynamics(plant, decl, context)
        self._drives(plant, decl, scope, context)
        plant.measured = tuple(self._measured(plant, decl, scope))
        self._warn(plant, decl, context)

    def _dynamics(self, plant: typed.PlantSymbol, decl: tree.PlantDecl, context: Context) -> None:
        states = {v.name: v for v in plant.states}
        for table, items, what in ((plant.der, decl.der, "der"), (plant.next, decl.next, "next")):
            for name, expr in items:
                variable = states.get(name.text)
                if variable is None:
                    self.checker.expressions.check(expr, context)
                    self.diagnostics.error(
                        "N001",
                        f"plant `{decl.name.text}` has no state `{name.text}`",
                        name.span,
                        helps=(f"add `state {name.text}: float;`",),
                    )
                    continue
                value = self.checker.expressions.check(expr, context, variable.type)
                if variable in plant.der or variable in plant.next:
                    self.diagnostics.error(
                        "N002", f"the dynamics of `{name.text}` are given twice", name.span
                    )
                    continue
                t = variable.type
                if what == "der" and not isinstance(t, (FloatType, ErrorType)) and not is_vector(t):
                    self.diagnostics.error(
                        "T018", f"`der` needs a float or a vector, not `{t}`", name.span,
                        helps=(f"write `next {name.text} = ...;`",),
                    )
                    continue
                table[variable] = value
        if plant.extern and (plant.der or plant.next):
            self.diagnostics.error(
                "X002", "an extern plant has no `der` or `next`: its driver moves the states",
                decl.name.span,
            )
        if not plant.extern and not plant.states:
            self.diagnostics.error(
                "M006", f"plant `{decl.name.text}` has no state", decl.name.span
            )

    def _drives(
        self, plant: typed.PlantSymbol, decl: tree.PlantDecl, scope: FileScope, context: Context
    ) -> None:
        drives: list[tuple[typed.TopicSymbol, typed.Expr]] = []
        for ref, expr in decl.drives:
            topic = self.checker.declarations.topic_ref(ref, scope)
            if expr is None:
                self.diagnostics.error(
                    "M006", f"`drives {ref.text}` needs a value: `drives {ref.text} = ...;`",
                    ref.span,
                )
                continue
            value = self.checker.expressions.check(expr, context, topic.type if topic else None)
            if topic is None:
                continue
            if any(t is topic for t, _ in drives):
                self.diagnostics.error("N002", f"`{ref.text}` is driven twice", ref.span)
                continue
            if topic.input:
                self.diagnostics.error(
                    "M011", f"`{ref.text}` is an input topic: only the environment sets it",
                    ref.span,
                )
            drives.append((topic, value))
        plant.drives = tuple(drives)

    def _measured(
        self, plant: typed.PlantSymbol, decl: tree.PlantDecl, scope: FileScope
    ) -> list[typed.MeasuredSymbol]:
        context = Context(scope, f"plant `{decl.name.text}`")
        measured: list[typed.MeasuredSymbol] = []
        taken: dict[tuple[typed.TopicSymbol, tuple[str, ...]], object] = {}
        for path, bound in decl.measured:
            within = self.checker.expressions.check(bound, context, FLOAT)
            found = self.checker.declarations.topic_path(path, scope)
            if found is None:
                continue
            topic, below, t = found
            if not any(x is topic for x, _ in plant.drives):
                self.diagnostics.error(
                    "M009", f"`{decl.name.text}` does not drive `{topic.name}`", path.span
                )
                continue
            if not isinstance(t, (FloatType, ErrorType)) and not is_vector(t):
                self.diagnostics.error(
                    "T018", f"a measurement error needs floats, not `{t}`", path.span
                )
                continue
            overlap = any(
                o is topic and (below[: len(p)] == p or p[: len(below)] == below)
                for o, p in taken
            )
            if overlap:
                self.diagnostics.error(
                    "N002", f"the error of `{path.text}` is given twice", path.span
                )
                continue
            taken[(topic, below)] = path
            if not is_error(within):
                measured.append(typed.MeasuredSymbol(topic, below, within, path.span))
        return measured

    def _warn(self, plant: typed.PlantSymbol, decl: tree.PlantDecl, context: Context) -> None:
        if context.scope.loaded.library:
            return
        for d in plant.disturbances:
            if not d.variable.used and not plant.extern:
                self.diagnostics.warning(
                    "W001", f"disturbance `{d.variable.name}` is never used", d.variable.span
                )
        for variable, _ in plant.lets:
            if not variable.used and not variable.name.startswith("_"):
                self.diagnostics.warning(
                    "W001", f"`{variable.name}` is never used", variable.span
                )
        for topic in plant.reads:
            if topic not in context.topics_read and not plant.extern:
                self.diagnostics.warning(
                    "W001", f"plant `{decl.name.text}` never reads `{topic.name}`", decl.name.span
                )

