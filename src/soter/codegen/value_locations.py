"""Chooses where the values of a body lie in C, and emits how a large one gets there.

Purpose: `Places`, the base of `Body`, gives each temporary, output and result its place by the
body's plan, passes large arguments by address, and writes values into places. Two functions find
comparisons of which compilers would warn; `body.py` puts `soter_plain` around their operands.
Non-goals: the plan (`storage_plan.py`), what expressions and statements are (`codegen/body.py`).
"""

from __future__ import annotations

from collections import Counter
from contextlib import contextmanager
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_names import field_name, local_name
from soter.codegen.storage_plan import RESULT, PlannedBody, StoragePlan, has_address, plan_storage
from soter.core import core
from soter.core.core import output_name
from soter.core.core_walks import walk
from soter.core.layout import LENGTH, scalar, storage_range, struct_of
from soter.language.model.types import ArrayType, EnumType, FloatType, IntType, ListType, RecordType

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.codegen.c_types import TypeTable
    from soter.language.model.types import Type


LOGICAL = frozenset(("&&", "||"))
STORED = (core.Get, core.Field, core.Element, core.Fact)


def has_known_result(op: str, value: core.Expr, other: core.Expr) -> bool:
    """Whether a compiler may know the result of an int comparison, and would then warn.

    A compiler knows it if a stored value meets a constant at or beyond the limits of its storage,
    and perhaps if a choice between constants is compared.
    """
    if isinstance(value, core.Select):
        return True
    if not isinstance(other, core.Const) or isinstance(value, (core.Var, core.Const)):
        return False
    s = scalar(LENGTH if isinstance(value, core.Length) else value.type)
    if s is None or not isinstance(value.type, (IntType, EnumType)):
        return False
    low, high = storage_range(s)
    if op in {"==", "!="}:
        return not low <= other.value <= high
    return not low < other.value < high


def twice_compared(condition: core.Expr) -> list[core.Expr]:
    """The stored values that a condition compares with different constants by == or !=.

    If no value can equal all of the constants, a compiler knows the result, and warns.
    """
    comparisons: list[tuple[core.Expr, object]] = []
    for part in _equalities(condition):
        for value, other in ((part.left, part.right), (part.right, part.left)):
            exact = isinstance(value, STORED) and not isinstance(value.type, FloatType)
            if exact and isinstance(other, core.Const):
                comparisons.append((value, other.value))
    return [v for v, x in comparisons if any(w == v and y != x for w, y in comparisons)]


def _equalities(condition: core.Expr) -> Iterator[core.Binary]:
    """Yields the parts of a condition that are `==` or `!=`, the last one first."""
    parts = [condition]
    while parts:
        part = parts.pop()
        if isinstance(part, core.Unary) and part.op == "not":
            parts.append(part.operand)
        elif isinstance(part, core.Binary) and part.op in LOGICAL:
            parts += (part.left, part.right)
        elif isinstance(part, core.Binary) and part.op in {"==", "!="}:
            yield part


MADE = c.Unary("*", c.Name("made"))
"""Where a function puts a large result: its caller passes the address as `made`."""


class Places:
    """Gives values their places in C, for one body at a time; `plan_body` begins a body."""

    def __init__(self, types: TypeTable) -> None:
        self.types = types
        self.outputs: tuple[str, ...] = ()
        """Names of the outputs of the step that is being emitted."""
        self.plan = StoragePlan()
        self.certain: frozenset[int] = frozenset()
        """Numbers of the outputs that the step being emitted always publishes."""
        self.in_place: frozenset[str] = frozenset()
        """Locals that the step being emitted changes where they lie in the state."""
        self._new_places = 0

    def expr(self, e: core.Expr) -> c.CExpr:
        """The C of a Core expression (`Body`)."""
        raise NotImplementedError

    def c_name(self, name: str) -> str:
        """The C name of a temporary."""
        return local_name(name, self.types.prefix)

    @contextmanager
    def plan_body(
        self,
        task: PlannedBody | None,
        certain: frozenset[int] = frozenset(),
        in_place: frozenset[str] = frozenset(),
    ) -> Iterator[None]:
        """Plans a body's storage in this block; `certain`: outputs that are always published."""
        self.plan = StoragePlan() if task is None else plan_storage(task)
        self.certain = certain
        self.in_place = in_place
        self._new_places = 0
        try:
            yield
        finally:
            self.plan = StoragePlan()
            self.certain = frozenset()
            self.in_place = frozenset()

    def names_used(self, root: object) -> set[str]:
        """The temporaries that code in `root` reads; ignores reads by idle stores."""
        read_counts = Counter(x.name for x in walk(root) if isinstance(x, core.Var))
        for s in walk(root):
            if id(s) in self.plan.idle:
                read_counts.subtract(x.name for x in walk(s) if isinstance(x, core.Var))
        return {name for name, times in read_counts.items() if times > 0}

    def is_pointer(self, name: str) -> bool:
        """Whether a temporary is a C pointer to the place of its value."""
        return name in self.plan.references or name in self.in_place

    def has_place(self, name: str) -> bool:
        """Whether a name has a place of its own."""
        return self.plan.home_name(name) == name

    def place_of(self, name: str) -> c.CExpr:
        """The C place of a temporary, an output or the result."""
        home, path = self.plan.homes.get(name, (name, ()))
        place = self._own_place(home)
        for part in path:
            place = c.Member(place, field_name(part))
        return place

    def _own_place(self, name: str) -> c.CExpr:
        if name == RESULT:
            return MADE
        for k, output in enumerate(self.outputs):
            if name == output_name(k):
                return c.Name(f"out_{output}")
        c_name = c.Name(self.c_name(name))
        return c.Unary("*", c_name) if self.is_pointer(name) else c_name

    # ------------------------------------------------------------ locals in place

    def changed_flag(self, name: str) -> c.Name:
        """The C flag that is true if a step has changed a local in place."""
        return c.Name(f"given_{self.c_name(name)}_changed")

    def value_before(self, name: str) -> c.Name:
        """The C variable with the value that a local changed in place had before the step."""
        return c.Name(f"given_{self.c_name(name)}_before")

    def with_saved_value(self, s: core.Stmt, made: list[c.CStmt]) -> list[c.CStmt]:
        """The C of `s`, after code that saves a local before its first change in place."""
        name = output_name(s.output) if isinstance(s, core.Publish) else getattr(s, "name", None)
        home = self.plan.home_name(name) if isinstance(name, str) else ""
        if home not in self.in_place or all(isinstance(x, c.Unused) for x in made):
            return made
        changed = self.changed_flag(home)
        aside = (
            c.Assign(self.value_before(home), self.place_of(home)),
            c.Assign(changed, c.Name("true")),
        )
        return [c.IfStmt(c.Unary("!", changed), aside), *made]

    # ------------------------------------------------------------ calls

    def c_parameters(self, parameters: tuple[core.Parameter, ...]) -> list[tuple[str, str]]:
        """C types and names of parameters; large ones are passed by address."""
        return [(self.parameter_type(p.type), self.c_name(p.name)) for p in parameters]

    def parameter_type(self, t: Type) -> str:
        """The C type of a parameter."""
        work = self.types.work_type(t)
        return f"const {work} *" if self.types.is_large(t) else work

    def function_to_plan(self, f: core.Function, result: core.Expr) -> PlannedBody:
        """The body of a function, as input of `plan_storage`."""
        large = self.types.is_large
        fixed = tuple(p.name for p in f.parameters if large(p.type))
        return PlannedBody(code=f.body, is_large=large, fixed=fixed, result=result, leave=f.leave)

    def c_arguments(self, arguments: tuple[core.Expr, ...]) -> tuple[list[c.CStmt], list[c.CExpr]]:
        """The statements that must stand before a call, and the C arguments of the call."""
        pairs = [self._argument(e) for e in arguments]
        return [s for before, _ in pairs for s in before], [argument for _, argument in pairs]

    def _argument(self, e: core.Expr) -> tuple[list[c.CStmt], c.CExpr]:
        """Statements before the call, and one C argument: the address of a large value."""
        if not self.types.is_large(e.type):
            return [], self.expr(e)
        if has_address(e):
            return [], c.address_of(self.expr(e))
        before, value = self._write_to_new_place(e)
        return before, c.address_of(value)

    # ------------------------------------------------------------ large values

    def write_into(self, target: c.CExpr, root: str, t: Type, e: core.Expr) -> list[c.CStmt]:
        """Writes a value of type `t` to `target`, which is place `root` or a part of it.

        A large record, array or list is written piece by piece, so that it needs no second place,
        unless it may read a piece from the place that is written.
        """
        if isinstance(e, core.Select) and self.types.is_large(t):
            then = self.write_into(target, root, t, e.then)
            otherwise = self.write_into(target, root, t, e.otherwise)
            return [c.IfStmt(self.expr(e.condition), tuple(then), tuple(otherwise))]
        in_pieces = isinstance(e, core.Make) and self.types.is_large(t)
        if not in_pieces or not isinstance(e, core.Make):
            if self._lies_in(e, target):
                return []
            return [c.Assign(target, self.types.as_stored(t, self.expr(e)))]
        if self._may_read_target(target, root, e):
            before, value = self._write_to_new_place(e)
            return [*before, c.Assign(target, value)]
        if isinstance(t, RecordType):
            return self._write_fields(target, root, t, e)
        assert isinstance(t, (ArrayType, ListType))
        if isinstance(t, ArrayType) and not self.types.is_large(t.element):
            return [c.Assign(target, self.expr(e))]
        return self._write_elements(target, root, t, e)

    def _write_elements(
        self, target: c.CExpr, root: str, t: ArrayType | ListType, e: core.Make
    ) -> list[c.CStmt]:
        items = c.Member(target, "at" if isinstance(t, ArrayType) else "items")
        statements: list[c.CStmt] = []
        if isinstance(t, ListType):
            statements.append(c.Assign(target, self.types.default_constant(t)))
        for k, element in enumerate(e.elements):
            place = c.IndexExpr(items, c.Number(str(k)))
            statements += self.write_into(place, root, t.element, element)
        if isinstance(t, ListType) and e.elements:
            statements.append(c.Assign(c.Member(target, "len"), c.Number(str(len(e.elements)))))
        return statements

    def _write_fields(
        self, target: c.CExpr, root: str, t: RecordType, e: core.Make
    ) -> list[c.CStmt]:
        statements = [
            made
            for (name, of), element in zip(t.fields, e.elements, strict=True)
            for made in self.write_into(c.Member(target, field_name(name)), root, of, element)
        ]
        if struct_of(t).padding:
            byte = c.IndexExpr(c.Member(target, "pad_"), c.Name("pad"))
            zero = (c.Assign(byte, c.Number("0")),)
            count = c.Number(str(struct_of(t).padding))
            statements.append(c.For("pad", c.Number("0"), count, zero))
        return statements

    def _lies_in(self, e: core.Expr, target: c.CExpr) -> bool:
        """Whether the value of `e` already lies in `target`."""
        return isinstance(e, core.Var) and self.place_of(self.plan.referred_name(e.name)) == target

    def _may_read_target(self, target: c.CExpr, root: str, e: core.Make) -> bool:
        """Whether a piece of `e`, which is written to `target`, may be read from place `root`."""
        unchanged: set[str] = set()
        others = list(e.elements)
        if isinstance(e.type, RecordType):
            for (name, _), element in zip(e.type.fields, e.elements, strict=True):
                if self._lies_in(element, c.Member(target, field_name(name))):
                    assert isinstance(element, core.Var)
                    unchanged.add(self.plan.referred_name(element.name))
                    others.remove(element)
        reads = self.plan.names_read(*others) - unchanged
        return any(self.plan.home_name(x) == self.plan.home_name(root) for x in reads)

    def _write_to_new_place(self, e: core.Expr) -> tuple[list[c.CStmt], c.CExpr]:
        """Statements that write a value to a new place, and that place."""
        self._new_places += 1
        made = c.Name(f"given_{self._new_places}")
        declared = c.Declare(self.types.work_type(e.type), made.text, None)
        return [declared, *self.write_into(made, made.text, e.type, e)], made
