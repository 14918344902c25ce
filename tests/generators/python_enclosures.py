"""Functions of a program as enclosures, called from Python.

Purpose: emit any Core function over inputs that are its scalar parameters, compile many of them in
one call, evaluate them on boxes, and say whether an enclosure holds a value.
Non-goals: making programs, what modules are (`verify/enclose/compiled_enclosures.py` does that).
"""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import cffi

from generators.engine_comparison import call_compiler
from soter.codegen import c_tree as c
from soter.codegen.c_printer import print_file
from soter.language.model.types import (
    BOOL,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    Type,
    leaf_count,
)
from soter.native.shared_library import CHECK_FAILED
from soter.verify.enclose.compiled_enclosures import PARAMETERS
from soter.verify.enclose.core_enclosure import EnclosureBody
from soter.verify.enclose.enclosed_operations import EnclosureOperations, kind_of
from soter.verify.enclose.enclosure_emitter import (
    AggregateParts,
    Constant,
    EmittedInts,
    EmittedTruth,
    Emitter,
    Form,
    Item,
    Sequence,
    address,
    as_parts,
    function_body,
    names_in,
    result_statement,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from soter.core import core
    from soter.language.model.types import Value

INPUTS = 24
"""Of every compiled unit: functions with fewer parameters leave some unused."""
DECLARATIONS = f"""
typedef struct {{ double lo, hi, c, r; double g[{INPUTS}]; }} soter_form;
"""


SIGNATURE = "(const soter_form in[], const int64_t param[], soter_form out[])"


def seeded(key: int | str) -> random.Random:
    """Random numbers, always the same ones."""
    return random.Random(key)  # noqa: S311 - test data


def scalars(t: Type) -> Iterator[Type]:
    """All scalars of a full value, the length of a list before its places."""
    if isinstance(t, RecordType):
        for _, f in t.fields:
            yield from scalars(f)
    elif isinstance(t, (ArrayType, ListType)):
        if isinstance(t, ListType):
            yield IntType(0, t.capacity)
        for _ in range(t.size if isinstance(t, ArrayType) else t.capacity):
            yield from scalars(t.element)
    else:
        yield t


def value_of(t: Type, numbers: Iterator[float]) -> Value:
    """A Soter value from the numbers of its scalars."""
    if isinstance(t, RecordType):
        return tuple(value_of(f, numbers) for _, f in t.fields)
    if isinstance(t, ArrayType):
        return tuple(value_of(t.element, numbers) for _ in range(t.size))
    if isinstance(t, ListType):
        length = int(next(numbers))
        return tuple(value_of(t.element, numbers) for _ in range(t.capacity))[:length]
    number = next(numbers)
    if isinstance(t, FloatType):
        return number
    return bool(number) if isinstance(t, BoolType) else int(number)


def numbers_of(t: Type, value: Value) -> Iterator[float | None]:
    """The numbers of a value's scalars; None beyond the length of a list."""
    if isinstance(t, RecordType):
        for (_, f), v in zip(t.fields, value, strict=True):
            yield from numbers_of(f, v)
    elif isinstance(t, ArrayType):
        for v in value:
            yield from numbers_of(t.element, v)
    elif isinstance(t, ListType):
        yield len(value)
        for v in value:
            yield from numbers_of(t.element, v)
        yield from (None for _ in range(leaf_count(t.element) * (t.capacity - len(value))))
    else:
        yield value


@dataclass(eq=False)
class Enclosure:
    """One function, emitted."""

    name: str
    definition: c.FunctionDef
    parameters: tuple[Type, ...]
    """Scalars, in order: the inputs."""
    result: Type
    prelude: set[str]


Statics = dict[tuple[str, str], c.VariableDef]
"""Constants of a unit that several functions share."""


def enclosure(
    name: str, functions: Mapping[str, core.Function], function: core.Function, statics: Statics
) -> Enclosure:
    """A Core function whose inputs are the scalars of its parameters."""
    emitter = Emitter(statics)
    ops = EnclosureOperations(emitter)
    prelude: set[str] = set()

    def no_cell(_cell: core.Cell, _type: Type) -> Item:
        raise AssertionError

    body = EnclosureBody(emitter, functions, no_cell, prelude)
    places = iter(range(INPUTS))
    arguments = tuple(_argument(ops, p.type, places) for p in function.parameters)
    result = body.result_of(function, arguments)
    out: list[c.CStmt] = []
    for v in _flat(result):
        form = ops.form_of(v if kind_of(v) == "form" else ops.float_of_int(v))
        out.append(result_statement(len(out), form))
    whole = function_body(emitter.block, emitter.reads, out)
    types = tuple(t for p in function.parameters for t in scalars(p.type))
    definition = c.FunctionDef("unsigned", name, PARAMETERS, whole, static=False)
    return Enclosure(name, definition, types, function.result_type, prelude)


def _argument(ops: EnclosureOperations, t: Type, places: Iterator[int]) -> Item:
    if isinstance(t, RecordType):
        return AggregateParts(tuple(_argument(ops, f, places) for _, f in t.fields))
    if isinstance(t, ArrayType):
        return AggregateParts(tuple(_argument(ops, t.element, places) for _ in range(t.size)))
    if isinstance(t, ListType):
        length = _argument(ops, IntType(0, t.capacity), places)
        assert isinstance(length, EmittedInts)
        return Sequence(length, tuple(_argument(ops, t.element, places) for _ in range(t.capacity)))
    number = next(places)
    if isinstance(t, FloatType):
        return Form(ops.emitter.input_variable(number))
    place = c.IndexExpr(c.Name("in"), c.Number(str(number)))
    if t == BOOL:
        return EmittedTruth(ops.emitter.emit("truth", "soter_truth_input", address(place)))
    low, high = (t.low, t.high) if isinstance(t, IntType) else (0, _members(t) - 1)
    ends = (c.Number(f"INT64_C({x})") if x > -(2**63) else c.Name("INT64_MIN") for x in (low, high))
    return EmittedInts(ops.emitter.emit("ints", "soter_ints_input", address(place), *ends))


def _members(t: Type) -> int:
    assert isinstance(t, EnumType)
    return len(t.members)


def _flat(v: Item) -> Iterator[Item]:
    v = as_parts(v) if isinstance(v, Constant) else v
    if isinstance(v, AggregateParts):
        for x in v.items:
            yield from _flat(x)
    elif isinstance(v, Sequence):
        yield v.length
        for x in v.items:
            yield from _flat(x)
    else:
        yield v


class Compiled:
    """Enclosures in one library."""

    def __init__(
        self, enclosures: list[Enclosure], statics: Statics, folder: Path, *flags: str
    ) -> None:
        used = {n for e in enclosures for n in names_in(e.definition.body)}
        items: list[c.CTop] = [c.Define("SOTER_INPUTS", str(INPUTS)), c.Include("soter_form.h")]
        items += [
            c.FunctionDef("unsigned", e.name, PARAMETERS, None, static=False) for e in enclosures
        ]
        items += [s for s in statics.values() if s.name in used]
        items += [e.definition for e in enclosures]
        source = folder / "enclosures.c"
        source.write_text(print_file(c.CFile(tuple(items))), encoding="utf-8")
        library = folder / "enclosures.so"
        call_compiler(
            folder, *(flags or ("-O1",)), "-fPIC", "-shared", "-o", str(library),
            str(source), str(CHECK_FAILED), "-lm",
        )  # fmt: skip
        self.ffi = cffi.FFI()
        self.ffi.cdef(DECLARATIONS)
        for e in enclosures:
            self.ffi.cdef(f"unsigned {e.name}{SIGNATURE};")
        self.library: Any = self.ffi.dlopen(str(library))

    def inputs(self, boxes: list[tuple[float, float]]) -> Any:
        """Forms of a box, one symbol each."""
        forms = self.ffi.new("soter_form[]", INPUTS)
        for i, (low, high) in enumerate(boxes):
            set_input(forms[i], i, low, high)
        return forms

    def result_of(self, e: Enclosure, forms: Any) -> tuple[Any, int]:
        """The result's forms, and whether a fault is possible."""
        out = self.ffi.new("soter_form[]", max(1, leaf_count(e.result)))
        fault = getattr(self.library, e.name)(forms, self.ffi.NULL, out)
        return out, fault


def set_input(form: Any, i: int, low: float, high: float) -> None:
    """The form of one input over [low, high]."""
    form.lo, form.hi = low, high
    if math.isinf(high - low) or not math.isfinite(low + high):
        form.c, form.r = 0.0, math.inf
        return
    middle = 0.5 * low + 0.5 * high
    half = max(Fraction(high) - Fraction(middle), Fraction(middle) - Fraction(low))
    slope = float(half)
    form.c, form.r = middle, 0.0
    form.g[i] = slope if Fraction(slope) >= half else math.nextafter(slope, math.inf)


def holds(form: Any, value: float, forms: Any, point: list[float]) -> bool:
    """Whether a form encloses `value` at the point the inputs have these values."""
    if math.isnan(value):
        return bool(form.lo == -math.inf and form.hi == math.inf and form.r == math.inf)
    if not form.lo <= value <= form.hi:
        return False
    if form.r == math.inf:
        return True
    if math.isinf(value):
        return False
    linear = Fraction(form.c)
    for i, x in enumerate(point):
        slope = form.g[i]
        if slope != 0.0:
            own = forms[i]
            if own.r == math.inf:
                return False
            if own.g[i] != 0.0:
                linear += Fraction(slope) * (Fraction(x) - Fraction(own.c)) / Fraction(own.g[i])
    return bool(abs(Fraction(value) - linear) <= Fraction(form.r))
