"""The robustness of every property of a test, as C functions of the state.

Purpose: `soter_aim` (soter_explore.h) for each property of configurations: what guides a search
towards a violation (`soter_explore_falsify.c`). They are the explorer's own, beside the predicates:
what flies knows nothing of them.
Non-goals: what a margin is (`robustness.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.codegen.body import Body
from soter.codegen.c import tree as c
from soter.codegen.c.types import float_number
from soter.codegen.function_context import OK, where
from soter.codegen.storage.storage_plan import PlannedBody
from soter.core import core
from soter.explore.model.robustness import Margin, RobustnessTable

if TYPE_CHECKING:
    from soter.codegen.c.types import TypeTable
    from soter.codegen.function_context import Frame
    from soter.language.model.system import System

SCALE = c.Name("soter_scale")
"""No temporary of a program is called so (`codegen/c/names.py`)."""
APART = 8
"""Guides of one property, at most."""
WORST = float_number(-1.0)


@dataclass(frozen=True)
class Aim:
    """What a guide is of: `what` and `index` of `soter_broken`.

    `flat`: no numbers are compared in it, so it leads nowhere.
    """

    what: int
    index: int
    flat: bool


class Guides:
    """Emits the guides of one system."""

    def __init__(self, system: System, lowered: core.CoreSystem, frame: Frame) -> None:
        self._system = system
        self._core = lowered
        self._frame = frame
        self._types: TypeTable = frame.types
        self._margins = RobustnessTable(lowered.functions)
        self._body = _Body(frame.types, dict(frame.body.functions), frame.cell)
        self.aims: list[Aim] = []

    def emit(self) -> tuple[list[c.CTop], list[c.CExpr]]:
        """The functions, and the rows of the table; `aims` says what these are of."""
        assert self._system.test is not None
        own: list[c.CTop] = []
        rows: list[c.CExpr] = []
        for p, predicate in zip(self._system.properties, self._core.properties, strict=True):
            if p.component is None:
                name, never = f"margin_{p.index}", p.kind == "never"
                for value in _apart(predicate.value, "||" if never else "&&"):
                    part, before = replace(predicate, value=value), self.sites
                    of = self._guide(own, part, name, f"{p.kind} {p.text}", negate=never)
                    aim = Aim(0, p.index, flat=self.sites == before)
                    rows.append(self._row(aim, c.Name("NULL"), of))
        for t, lowered in zip(self._system.test.timed, self._core.timed, strict=True):
            premise: c.CExpr = c.Name("NULL")
            if lowered.premise is not None:
                name = f"margin_timed_{t.index}_premise"
                premise = self._guide(own, lowered.premise, name, f"premise of {t.text}")
            of = self._guide(own, lowered.condition, f"margin_timed_{t.index}", t.text)
            rows.append(self._row(Aim(3, t.index, flat=False), premise, of))
        return [*(self._function(f) for f in self._margins.functions), *own], rows

    @property
    def sites(self) -> int:
        """How many comparisons have a scale."""
        return self._margins.sites

    # ------------------------------------------------------------ C

    def _guide(
        self, own: list[c.CTop], p: core.Predicate, name: str, text: str, *, negate: bool = False
    ) -> c.CExpr:
        """The margin of a predicate as a function of the state; after a fault the worst."""
        made = self._margins.of(p)
        self._learn()
        name = self._types.unique(name)
        body: list[c.CStmt] = [self._frame.state_pointer(const=True), c.Unused("s")]
        body += [c.Unused(SCALE.text), *self._frame.fault_pointer(), c.Unused("fault")]
        task = PlannedBody(code=made.body, is_large=self._types.is_large, result=made.value)
        with self._body.planned(task):
            body += self._body.block(made.body, made.value)
            value = self._body.expr(made.value)
        body.append(c.IfStmt(c.Binary("!=", c.Name("status"), OK), (c.Return(WORST),)))
        body.append(c.Return(c.Unary("-", value) if negate else value))
        parameters = (("const void *", "state"), ("double *", SCALE.text))
        doc = f"how far from a violation: {text}, {where(p.span)}"
        own.append(c.FunctionDef("double", name, parameters, tuple(body), doc))
        return c.Name(name)

    def _row(self, aim: Aim, premise: c.CExpr, of: c.CExpr) -> c.CExpr:
        self.aims.append(aim)
        return c.Initializer(
            (
                ("what", c.Number(f"{aim.what}U")),
                ("index", c.Number(f"{aim.index}U")),
                ("flat", c.Name("true" if aim.flat else "false")),
                ("premise", premise),
                ("of", of),
            )
        )

    def _learn(self) -> None:
        """Name the functions that were made since."""
        for f in self._margins.functions:
            if f.name not in self._body.functions:
                self._body.functions[f.name] = (self._types.unique(f"{f.name}_fn"), f.can_fault)
                self._body.scaled.add(f.name)

    def _function(self, f: core.Function) -> c.FunctionDef:
        assert f.result is not None
        name, faults = self._body.functions[f.name]
        parameters = [*self._body.parameters(f.parameters), ("double *", SCALE.text)]
        unused = [c.Unused(n) for _, n in parameters]
        if faults:
            parameters.append(("soter_fault *", "fault"))
            unused.append(c.Unused("fault"))
        with self._body.planned(self._body.task(f, f.result)):
            body = self._body.block(f.body, f.result)
            result = c.Return(self._body.expr(f.result))
        doc = f"how far {f.source_name} is from changing, {where(f.span)}"
        return c.FunctionDef(
            "double", name, tuple(parameters), (*unused, *body, result), doc, inline=True
        )


class _Body(Body):
    """Bodies in which margins stand; `scaled`: functions that take the scales too."""

    def __init__(self, *args: object) -> None:
        super().__init__(*args)  # type: ignore[arg-type]
        self.scaled: set[str] = set()

    def expr(self, e: core.Expr) -> c.CExpr:
        """A pure expression, or a margin."""
        if not isinstance(e, Margin):
            return super().expr(e)
        of, plain = e.holds, super().expr
        left, right = c.Cast("double", plain(of.left)), c.Cast("double", plain(of.right))
        function = "soter_equal_margin" if of.op in {"==", "!="} else "soter_margin"
        holds = plain(of)
        if of.op == "!=":
            holds = c.Unary("!", holds)
        margin = c.CallExpr(function, (holds, left, right, self._scale(e)))
        return c.Unary("-", margin) if of.op == "!=" else margin

    def _scale(self, e: Margin) -> c.CExpr:
        return c.Binary("+", SCALE, c.Number(str(e.site)))

    def statement(self, s: core.Stmt, used: set[str]) -> list[c.CStmt]:
        """One statement; what gives a margin is told the scales."""
        if isinstance(s, core.Call) and s.function in self.scaled:
            name, faults = self.functions[s.function]
            before, given = self.arguments(s.arguments)
            call = c.CallExpr(name, (*given, SCALE, c.Name("fault")) if faults else (*given, SCALE))
            made = self._declare(s.name, s.type, call, const=True)
            return [*before, *self._marked(made, s.name, used)]
        return super().statement(s, used)


def _apart(e: core.Expr, op: str) -> list[core.Expr]:
    """The conditions of which each alone can be violated: followed together they hide each other.

    All in one where they are too many.
    """
    conditions, todo = [], [e]
    while todo:
        x = todo.pop()
        if isinstance(x, core.Binary) and x.op == op:
            todo += [x.right, x.left]
        else:
            conditions.append(x)
    return conditions if len(conditions) <= APART else [e]
