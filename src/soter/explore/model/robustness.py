"""How far a condition is from changing: its robustness, as Core made of Core, and as C.

Purpose: for a condition one number in place of a truth: positive where it holds, negative where it
does not, and smaller where the values are nearer to changing that. `a < b` is how far apart they
are, in parts of the widest distance seen so far; && is the least, || the greatest, ! the negation;
what has no distance is 1 or -1. Each property gets a `soter_aim` (soter_explore.h), which guides a
search.
Non-goals: what is done with it (`soter_explore_falsify.c`); what flies, which knows nothing of it.

Every bool temporary gets a float one beside it, and every function that gives a bool one that
gives its margin: so conditions keep their distance through functions, `let` and `return`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.body import Body
from soter.codegen.c_types import float_number
from soter.codegen.state_access import OK, where
from soter.codegen.storage_plan import PlannedBody
from soter.core import core
from soter.core.core_walks import walk
from soter.language.model.types import BOOL, FLOAT, FloatType, IntType
from soter.language.syntax.node import node

if TYPE_CHECKING:
    from collections.abc import Iterable
    from typing import TypeGuard

    from soter.codegen.c_types import TypeTable
    from soter.codegen.state_access import Frame
    from soter.language.model.system import System


SUFFIX = "_margin"
COMPARISONS = frozenset(("<", "<=", ">", ">=", "==", "!="))
YES, NO = core.Const(FLOAT, 1.0), core.Const(FLOAT, -1.0)


@node()
class Margin(core.Expr):
    """How far two numbers are from changing a comparison, which is `holds`.

    `site`: which comparison of the program it is; each has a scale of its own.
    """

    holds: core.Binary
    site: int


class RobustnessTable:
    """Margins of the conditions of one system; `functions` are made as they are needed.

    `sites`: how many comparisons there are. `functions`: callees first.
    """

    def __init__(self, functions: Iterable[core.Function]) -> None:
        self._plain_functions = {f.name: f for f in functions}
        self._margin_functions: dict[str, str] = {}
        self._margin_names: dict[str, str] = {}
        self.functions: list[core.Function] = []
        self.sites = 0

    def predicate_margin(self, p: core.Predicate) -> core.Predicate:
        """The margin of a predicate: its `value` is a float."""
        return replace(p, body=self._body(p.body, ()), value=self._margin(p.value))

    # ------------------------------------------------------------ expressions

    def _margin(self, e: core.Expr) -> core.Expr:
        if isinstance(e, core.Binary):
            return self._comparison_margin(e)
        if isinstance(e, core.Unary) and e.op == "not":
            return core.Unary(FLOAT, "neg", self._margin(e.operand))
        if isinstance(e, core.Select):
            then, otherwise = self._margin(e.then), self._margin(e.otherwise)
            return core.Select(FLOAT, e.condition, then, otherwise)
        if isinstance(e, core.Var) and e.name in self._margin_names:
            return core.Var(FLOAT, self._margin_names[e.name])
        if isinstance(e, core.Const):
            return YES if e.value else NO
        return core.Select(FLOAT, e, YES, NO)

    def _comparison_margin(self, e: core.Binary) -> core.Expr:
        if e.op in {"&&", "||"}:
            op = "min" if e.op == "&&" else "max"
            return core.Extreme(FLOAT, op, self._margin(e.left), self._margin(e.right))
        if isinstance(e.left.type, (FloatType, IntType)):
            self.sites += 1
            return Margin(FLOAT, e, self.sites - 1)
        return core.Select(FLOAT, e, YES, NO)

    # ------------------------------------------------------------ statements

    def _body(self, body: tuple[core.Stmt, ...], more: tuple[str, ...]) -> tuple[core.Stmt, ...]:
        """The statements of one function, each with those that keep its margins."""
        taken = {x.name for x in walk(body) if isinstance(x, (core.Let, core.Call, core.Checked))}
        taken |= {x.variable for x in walk(body) if isinstance(x, core.Loop)} | set(more)
        self._margin_names = {}
        for x in walk(body):
            if self._has_margin(x):
                self._margin_names[x.name] = _free_name(x.name + SUFFIX, taken)
        return self._block(body, None)

    def _has_margin(self, x: object) -> TypeGuard[core.Let | core.Call]:
        """Whether it makes a bool temporary with a known margin; extern functions have none."""
        if isinstance(x, core.Call):
            return x.type == BOOL and self._plain_functions[x.function].result is not None
        return isinstance(x, core.Let) and x.value.type == BOOL

    def _block(self, body: tuple[core.Stmt, ...], under: core.Expr | None) -> tuple[core.Stmt, ...]:
        """A block with margins; `under`: the condition of the `if` whose first side it is."""
        return tuple(x for s in body for x in self._statement(s, under))

    def _statement(self, s: core.Stmt, under: core.Expr | None) -> tuple[core.Stmt, ...]:
        if isinstance(s, core.Let) and s.name in self._margin_names:
            value = self._margin(s.value)
            return (s, core.Let(s.span, self._margin_names[s.name], value, s.mutable))
        if isinstance(s, core.Set) and s.name in self._margin_names and not s.path:
            name = self._margin_names[s.name]
            value = self._assigned_margin(core.Var(FLOAT, name), self._margin(s.value), s, under)
            return (core.Set(s.span, name, FLOAT, (), value), s)
        if isinstance(s, core.Call) and s.name in self._margin_names:
            function = self._margin_function(s.function)
            return (s, replace(s, name=self._margin_names[s.name], function=function, type=FLOAT))
        if isinstance(s, core.If):
            then, otherwise = self._block(s.then, s.condition), self._block(s.otherwise, None)
            return (replace(s, then=then, otherwise=otherwise),)
        if isinstance(s, core.Loop):
            return (replace(s, body=self._block(s.body, None)),)
        return (s,)

    def _assigned_margin(
        self, before: core.Expr, value: core.Expr, s: core.Set, under: core.Expr | None
    ) -> core.Expr:
        """The margin of `a && b` whose right side may fault, `if a { a = b }`: both sides count."""
        if isinstance(under, core.Var) and under.name == s.name:
            return core.Extreme(FLOAT, "min", before, value)
        if isinstance(under, core.Unary) and under.op == "not":
            operand = under.operand
            if isinstance(operand, core.Var) and operand.name == s.name:
                return core.Extreme(FLOAT, "max", before, value)
        return value

    # ------------------------------------------------------------ functions

    def _margin_function(self, name: str) -> str:
        """The name of the function that gives the margin of a function's result."""
        if name not in self._margin_functions:
            f, outside = self._plain_functions[name], self._margin_names
            assert f.result is not None
            own = _free_name(
                name + SUFFIX, set(self._plain_functions) | set(self._margin_functions.values())
            )
            self._margin_functions[name] = own
            body = self._body(f.body, tuple(p.name for p in f.parameters))
            made = replace(f, name=own, body=body, result=self._margin(f.result), result_type=FLOAT)
            self.functions.append(made)
            self._margin_names = outside
        return self._margin_functions[name]


def _free_name(name: str, taken: set[str]) -> str:
    while name in taken:
        name += "_"
    taken.add(name)
    return name


SCALE = c.Name("soter_scale")
"""No temporary of a program is called so (`codegen/c_names.py`)."""
APART = 8
"""The most guides of one property."""
WORST = float_number(-1.0)


@dataclass(frozen=True)
class Aim:
    """What a guide is for: `what` and `index` of `soter_broken`.

    `flat`: it compares no numbers, so it leads nowhere.
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
        self._body = _MarginBody(frame.types, dict(frame.body.functions), frame.cell)
        self.aims: list[Aim] = []

    def emit(self) -> tuple[list[c.CTop], list[c.CExpr]]:
        """The functions, and the rows of the table; `aims` says what these are of."""
        assert self._system.test is not None
        own: list[c.CTop] = []
        rows: list[c.CExpr] = []
        for prop, predicate in zip(self._system.properties, self._core.properties, strict=True):
            if prop.component is None:
                name, never = f"margin_{prop.index}", prop.kind == "never"
                for value in _operands(predicate.value, "||" if never else "&&"):
                    part, before = replace(predicate, value=value), self.sites
                    of = self._guide_function(
                        own, part, name, f"{prop.kind} {prop.text}", negate=never
                    )
                    aim = Aim(0, prop.index, flat=self.sites == before)
                    rows.append(self._guide_row(aim, c.Name("NULL"), of))
        for timed, lowered in zip(self._system.test.timed, self._core.timed, strict=True):
            premise: c.CExpr = c.Name("NULL")
            if lowered.premise is not None:
                name = f"margin_timed_{timed.index}_premise"
                premise = self._guide_function(
                    own, lowered.premise, name, f"premise of {timed.text}"
                )
            of = self._guide_function(
                own, lowered.condition, f"margin_timed_{timed.index}", timed.text
            )
            rows.append(self._guide_row(Aim(3, timed.index, flat=False), premise, of))
        return [*(self._emit_function(f) for f in self._margins.functions), *own], rows

    @property
    def sites(self) -> int:
        """How many comparisons have a scale."""
        return self._margins.sites

    # ------------------------------------------------------------ C

    def _guide_function(
        self,
        own: list[c.CTop],
        predicate: core.Predicate,
        name: str,
        text: str,
        *,
        negate: bool = False,
    ) -> c.CExpr:
        """The margin of a predicate as a function of the state; after a fault the worst."""
        made = self._margins.predicate_margin(predicate)
        self._register_functions()
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
        doc = f"how far from a violation: {text}, {where(predicate.span)}"
        own.append(c.FunctionDef("double", name, parameters, tuple(body), doc))
        return c.Name(name)

    def _guide_row(self, aim: Aim, premise: c.CExpr, margin: c.CExpr) -> c.CExpr:
        self.aims.append(aim)
        return c.Initializer(
            (
                ("what", c.Number(f"{aim.what}U")),
                ("index", c.Number(f"{aim.index}U")),
                ("flat", c.Name("true" if aim.flat else "false")),
                ("premise", premise),
                ("of", margin),
            )
        )

    def _register_functions(self) -> None:
        """Names the functions that were made since the last call."""
        for f in self._margins.functions:
            if f.name not in self._body.functions:
                self._body.functions[f.name] = (self._types.unique(f"{f.name}_fn"), f.can_fault)
                self._body.scaled.add(f.name)

    def _emit_function(self, f: core.Function) -> c.FunctionDef:
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


class _MarginBody(Body):
    """Bodies in which margins stand; `scaled`: functions that take the scales too."""

    def __init__(self, *args: object) -> None:
        super().__init__(*args)  # type: ignore[arg-type]
        self.scaled: set[str] = set()

    def expr(self, expression: core.Expr) -> c.CExpr:
        """A pure expression, or a margin."""
        if not isinstance(expression, Margin):
            return super().expr(expression)
        comparison, plain = expression.holds, super().expr
        left, right = (
            c.Cast("double", plain(comparison.left)),
            c.Cast("double", plain(comparison.right)),
        )
        function = "soter_equal_margin" if comparison.op in {"==", "!="} else "soter_margin"
        holds = plain(comparison)
        if comparison.op == "!=":
            holds = c.Unary("!", holds)
        scale = c.Binary("+", SCALE, c.Number(str(expression.site)))
        margin = c.CallExpr(function, (holds, left, right, scale))
        return c.Unary("-", margin) if comparison.op == "!=" else margin

    def statement(self, s: core.Stmt, used: set[str]) -> list[c.CStmt]:
        """One statement; what gives a margin is told the scales."""
        if isinstance(s, core.Call) and s.function in self.scaled:
            name, faults = self.functions[s.function]
            before, given = self.arguments(s.arguments)
            call = c.CallExpr(name, (*given, SCALE, c.Name("fault")) if faults else (*given, SCALE))
            made = self._declare(s.name, s.type, call, const=True)
            return [*before, *self._marked(made, s.name, used)]
        return super().statement(s, used)


def _operands(e: core.Expr, op: str) -> list[core.Expr]:
    """The operands of a chain of `op`, each with a guide, as the nearest would hide the others.

    It is the whole condition where there are more than `APART`.
    """
    conditions, todo = [], [e]
    while todo:
        operand = todo.pop()
        if isinstance(operand, core.Binary) and operand.op == op:
            todo += [operand.right, operand.left]
        else:
            conditions.append(operand)
    return conditions if len(conditions) <= APART else [e]
