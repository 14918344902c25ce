"""C types of Soter types, constants as C values, and the helpers that types need.

Purpose: one struct definition for each type, laid out exactly as `core/layout.py` says; on demand,
a function that checks a value on its way to a topic, and one that gives every NaN its one form.
Non-goals: statements.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from soter.codegen import c_tree as c
from soter.codegen.c_names import FileNames, field_name
from soter.core.layout import image_of_table, scalar, size_of, struct_of
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    Type,
    default_value,
    leaves,
)
from soter.language.model.values import Table

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.language.model.system import Bound
    from soter.language.model.types import Value


FAULT = c.Name("fault")
LARGE = 64
"""Values of more bytes are passed by address; for such a result the caller passes the place."""


class TypeTable:
    """The C types, pooled constants and helper functions of one generated program."""

    def __init__(self, unique: FileNames) -> None:
        self.prefix = unique.prefix
        self.definitions: list[c.CTop] = []
        self.helpers: list[c.CTop] = []
        self.constants: list[c.CTop] = []
        self.unique = unique
        self._names: dict[Type, str] = {}
        self._pool: dict[tuple[Type, str], str] = {}
        self._macros: dict[tuple[str, str], str] = {}
        self._checks: dict[tuple[Type, tuple[object, ...]], str] = {}
        self._canonical: dict[Type, str] = {}

    # ------------------------------------------------------------ types

    def work_type(self, t: Type) -> str:
        """The C type of a temporary that holds a value of type `t`."""
        if isinstance(t, FloatType):
            return "double"
        if isinstance(t, BoolType):
            return "bool"
        if isinstance(t, IntType):
            return "int64_t"
        return self.stored_type(t)

    def stored_type(self, t: Type) -> str:
        """The C type of a value in memory; its first use defines the struct."""
        s = scalar(t)
        if s is not None:
            return s.c_type
        known = self._names.get(t)
        if known is not None:
            return known
        if isinstance(t, RecordType):
            members = tuple((f"{n}", f) for n, f in t.fields)
            for _, f in members:
                self.stored_type(f)
            name = self.unique(f"{self.prefix}_{t.name or 'record'}")
        elif isinstance(t, ArrayType):
            name = self.unique(f"{self.prefix}_{self._short_name(t.element)}_{t.size}")
        else:
            assert isinstance(t, ListType)
            name = self.unique(f"{self.prefix}_{self._short_name(t.element)}_list_{t.capacity}")
        self._names[t] = name
        self.definitions.append(c.StructDef(name, self._struct_members(t), str(t)))
        return name

    def _short_name(self, t: Type) -> str:
        stored = self.stored_type(t)
        return stored.removeprefix(self.prefix + "_").removesuffix("_t")

    def _struct_members(self, t: Type) -> tuple[c.StructMember, ...]:
        if isinstance(t, ArrayType):
            return (c.StructMember(self.stored_type(t.element), "at", t.size),)
        layout = struct_of(t)
        members = [
            c.StructMember(self.stored_type(t.element), "items", t.capacity)
            if isinstance(t, ListType) and m.name == "items"
            else c.StructMember(self.stored_type(m.type), field_name(m.name))
            for m in layout.members
        ]
        if layout.padding:
            members.append(c.StructMember("uint8_t", "pad_", layout.padding))
        return tuple(members)

    def is_large(self, t: Type) -> bool:
        """Whether values of a type are passed by address (decision 109)."""
        return scalar(t) is None and size_of(t) > LARGE

    # ------------------------------------------------------------ values

    def constant(self, t: Type, value: Value, name: str | None = None) -> c.CExpr:
        """The C of a constant; a constant that is no scalar is defined once, as a static object."""
        if scalar(t) is not None:
            return scalar_constant(t, value)
        key = (t, repr(value))
        known = self._pool.get(key)
        if known is None:
            known = self.unique(f"{self.prefix}_{name or 'constant'}")
            self._pool[key] = known
            if isinstance(value, Table):
                assert isinstance(t, (ArrayType, ListType))
                image = image_of_table(t, value)
                bytewise = scalar(t.element) is not None and size_of(t.element) == 1
                self.constants.append(
                    c.TableDef(self.stored_type(t), known, image, bytewise=bytewise)
                )
            else:
                initial = self.initializer(t, value)
                self.constants.append(c.VariableDef(self.stored_type(t), known, initial))
        return c.Member(c.Name(known), "value") if isinstance(value, Table) else c.Name(known)

    def named_constant(self, t: Type, value: Value, name: str | None) -> c.CExpr:
        """The C of a constant; a number keeps its name in the source: `#define cart_WALL 10.0`."""
        number = self.constant(t, value, name)
        if name is None or not isinstance(number, c.Number):
            return number
        key = (name, number.text)
        known = self._macros.get(key)
        if known is None:
            known = self._macros[key] = self.unique(f"{self.prefix}_{name}")
            text = f"({number.text})" if number.text.startswith("-") else number.text
            self.constants.append(c.Define(known, text))
        return c.Name(known)

    def initializer(self, t: Type, value: Value) -> c.CExpr:
        """The C of a constant inside an initializer."""
        if scalar(t) is not None:
            return scalar_constant(t, value)
        return aggregate_initializer(t, value, self.initializer)

    def default_constant(self, t: Type) -> c.CExpr:
        """The C of a type's default value."""
        if scalar(t) is not None:
            return scalar_constant(t, default_value(t))
        return self.constant(t, default_value(t), "default")

    def as_stored(self, t: Type, e: c.CExpr) -> c.CExpr:
        """The value of a temporary, cast to the type that it has in memory."""
        s = scalar(t)
        if s is None or s.c_type in {"double", "int64_t"} or isinstance(e, c.Number):
            return e
        if isinstance(e, c.Name) and e.text in {"true", "false"}:
            return c.Number("1" if e.text == "true" else "0")
        if isinstance(e, c.Cast) and e.type == "int64_t":
            e = e.operand
        return c.Cast(s.c_type, e)

    # ------------------------------------------------------------ canonical form

    def commit_value(self, target: c.CExpr, t: Type, e: c.CExpr) -> list[c.CStmt]:
        """Assigns a value to a place in the state, and gives each NaN in it the same bits."""
        if scalar(t) is not None:
            return [c.Assign(target, self._canonical_scalar(t, e))]
        return [c.Assign(target, e), *self._make_canonical(t, target)]

    def _canonical_scalar(self, t: Type, e: c.CExpr) -> c.CExpr:
        if isinstance(t, FloatType):
            return c.CallExpr("soter_canonical", (e,))
        return self.as_stored(t, e)

    def _make_canonical(self, t: Type, e: c.CExpr) -> list[c.CStmt]:
        """Statements that give every NaN in a stored value the same bits."""
        if isinstance(t, FloatType):
            return [c.Assign(e, self._canonical_scalar(t, e))]
        if not any(isinstance(leaf, FloatType) for _, leaf in leaves(t)):
            return []
        return [c.Do(c.CallExpr(self._canonical_function(t), (c.address_of(e),)))]

    def _canonical_function(self, t: Type) -> str:
        known = self._canonical.get(t)
        if known is not None:
            return known
        stored = self.stored_type(t)
        name = self.unique(f"{stored}_canonical")
        self._canonical[t] = name
        v = c.Unary("*", c.Name("v"))
        body: list[c.CStmt] = []
        if isinstance(t, RecordType):
            for n, f in t.fields:
                body += self._make_canonical(f, c.Member(v, field_name(n)))
        else:
            assert isinstance(t, (ArrayType, ListType))
            array = c.Member(v, "at" if isinstance(t, ArrayType) else "items")
            size = t.size if isinstance(t, ArrayType) else t.capacity
            inner = self._make_canonical(t.element, c.IndexExpr(array, c.Name("k")))
            body.append(c.For("k", c.Number("0"), c.Number(str(size)), tuple(inner)))
        self.helpers.append(
            c.FunctionDef(
                "void", name, ((f"{stored} *", "v"),), tuple(body), "NaN in one form only"
            )
        )
        return name

    # ------------------------------------------------------------ publication checks

    def check_value(self, t: Type, bounds: tuple[Bound | None, ...], e: c.CExpr) -> list[c.CStmt]:
        """Statements that raise `nonfinite` or `range` if a value may not be published."""
        if isinstance(t, FloatType):
            bound = bounds[0]
            if bound is None:
                return [c.Do(c.CallExpr("soter_check_finite", (e, FAULT)))]
            arguments = (e, float_number(bound.low), float_number(bound.high), FAULT)
            return [c.Do(c.CallExpr("soter_check_float", arguments))]
        if isinstance(t, IntType):
            bound = bounds[0]
            if bound is None:
                return []
            arguments = (
                e,
                int_number(math.ceil(bound.low)),
                int_number(math.floor(bound.high)),
                FAULT,
            )
            return [c.Do(c.CallExpr("soter_check_int", arguments))]
        if isinstance(t, (BoolType, EnumType)):
            return []
        pairs = zip(leaves(t), bounds, strict=True)
        if not any(
            isinstance(leaf, FloatType) or (isinstance(leaf, IntType) and bound is not None)
            for (_, leaf), bound in pairs
        ):
            return []
        function = self._check_function(t, bounds)
        return [c.Do(c.CallExpr(function, (c.address_of(e), FAULT)))]

    def _check_function(self, t: Type, bounds: tuple[Bound | None, ...]) -> str:
        key = (t, bounds)
        known = self._checks.get(key)
        if known is not None:
            return known
        v = c.Name("v")
        body: list[c.CStmt] = []
        if isinstance(t, RecordType):
            at = 0
            for n, f in t.fields:
                count = sum(1 for _ in leaves(f))
                part = c.Arrow(v, field_name(n))
                body += self.check_value(f, bounds[at : at + count], part)
                at += count
        elif isinstance(t, ArrayType):
            body += self._check_elements(t, bounds, v)
        else:
            assert isinstance(t, ListType)
            length, most = c.Arrow(v, "len"), c.Number(str(t.capacity))
            element = c.IndexExpr(c.Arrow(v, "items"), c.Name("k"))
            inner = self.check_value(t.element, bounds, element)
            fits = c.CallExpr("soter_check_int", (length, c.Number("0"), most, FAULT))
            used_length = c.CallExpr("soter_min_int", (length, most))
            body += [c.Do(fits), c.For("k", c.Number("0"), used_length, tuple(inner))]
        stored = self.stored_type(t)
        name = self.unique(f"{stored}_check")
        self._checks[key] = name
        self.helpers.append(
            c.FunctionDef(
                "void",
                name,
                ((f"const {stored} *", "v"), ("soter_fault *", "fault")),
                tuple(body),
                "may this value be published?",
            )
        )
        return name

    def _check_elements(
        self, t: ArrayType, bounds: tuple[Bound | None, ...], v: c.CExpr
    ) -> list[c.CStmt]:
        count = sum(1 for _ in leaves(t.element))
        groups = [bounds[i * count : (i + 1) * count] for i in range(t.size)]
        array = c.Arrow(v, "at")
        if all(g == groups[0] for g in groups):
            element = c.IndexExpr(array, c.Name("k"))
            inner = self.check_value(t.element, groups[0], element)
            return [c.For("k", c.Number("0"), c.Number(str(t.size)), tuple(inner))]
        elements = [c.IndexExpr(array, c.Number(str(i))) for i in range(t.size)]
        pairs = zip(groups, elements, strict=True)
        return [made for g, element in pairs for made in self.check_value(t.element, g, element)]


def aggregate_initializer(
    t: Type,
    elements: Sequence[Value],
    part: Callable[[Type, Any], c.CExpr],
    name: str | None = None,
) -> c.CExpr:
    """The initializer of a record, array or list; a compound literal if `name` is set.

    `name` is the name of the C type; `part` makes the C of an element from its type and value.
    """
    if isinstance(t, RecordType):
        pairs = zip(t.fields, elements, strict=True)
        return c.Initializer(tuple((field_name(n), part(f, v)) for (n, f), v in pairs), name)
    assert isinstance(t, (ArrayType, ListType))
    items = c.Initializer(tuple((None, part(t.element, v)) for v in elements))
    if isinstance(t, ArrayType):
        return c.Initializer((("at", items),), name)
    length: tuple[str, c.CExpr] = ("len", c.Number(str(len(elements))))
    return c.Initializer((("items", items), length) if elements else (length,), name)


def scalar_constant(t: Type, value: Value) -> c.CExpr:
    """The C of a scalar constant."""
    if isinstance(t, FloatType):
        return float_number(value)
    if isinstance(t, BoolType):
        return c.Name("true" if value else "false")
    return int_number(int(value))


def int_number(value: int) -> c.CExpr:
    """The C literal of an integer, right as an int64_t."""
    if value == -(2**63):
        return c.Name("INT64_MIN")
    if -(2**31) < value < 2**31:
        return c.Number(str(value))
    sign = "-" if value < 0 else ""
    return c.Number(f"{sign}INT64_C({abs(value)})")


def float_number(value: float) -> c.CExpr:
    """The C literal of a double; reading it gives the same bits."""
    if value != value:  # noqa: PLR0124 - NaN
        return c.Cast("double", c.Name("NAN"))
    if math.isinf(value):
        return c.Name("(double)INFINITY") if value > 0 else c.Name("(-(double)INFINITY)")
    return c.Number(repr(float(value)))
