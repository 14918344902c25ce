"""Packs configurations into rows of bits: the bodies of `pack` and `unpack` in C.

Purpose: a `Packing` builds both bodies together, field by field, as straight-line C with constant
shifts, and loops for long arrays. Each call adds a field to both, so that they agree.
Non-goals: which fields there are (`explorer_model.py`).

A field is never cut: its width comes from its type and the known bounds of its values; a value
without bounds gets 64 bits.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_names import field_name
from soter.codegen.c_types import int_number
from soter.core.layout import scalar
from soter.language.model.types import (
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    leaf_count,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from soter.explore.model.footprints import Label
    from soter.language.model.system import Bound
    from soter.language.model.types import Type, Value

    Hull = tuple[int, int] | None
    """Smallest and largest value of an int leaf; None for other leaves."""

UNROLLED = 16
"""Arrays of more scalars than this are packed in a loop."""
WORD = 64
WORDS = c.Name("words")
ALL_ONES = 2**64 - 1


def u64(value: int) -> c.CExpr:
    """A constant in C of type uint64_t."""
    return c.Number(f"UINT64_C({value})" if value < 2**31 else f"UINT64_C(0x{value:x})")


def small_constant(value: int) -> c.CExpr:
    """A C constant for use beside a uint64_t: a mask, an index or a shift."""
    return c.Number(f"{value}U") if value < 2**31 else u64(value)


def as_u64(e: c.CExpr) -> c.CExpr:
    """A cast of an expression to uint64_t."""
    return c.Cast("uint64_t", e)


# ---------------------------------------------------------------- the values of a leaf


def int_hulls(t: Type, bounds: Sequence[Bound | None], values: Iterable[Value]) -> list[Hull]:
    """For each leaf of `leaves(t)`, the range of its ints: its set, `values`, 0 in unused items."""
    leaf_hulls: list[Hull] = []
    for (path, leaf), bound in zip(leaves(t), bounds, strict=True):
        if not isinstance(leaf, IntType):
            leaf_hulls.append(None)
            continue
        low, high = leaf.low, leaf.high
        if bound is not None:
            low, high = max(low, math.ceil(bound.low)), min(high, math.floor(bound.high))
        if "[]" in path:
            low, high = min(low, 0), max(high, 0)
        leaf_hulls.append((low, high))
    for value in values:
        leaf_hulls = [
            hull and (min([hull[0], *leaf_range]), max([hull[1], *leaf_range]))
            for hull, leaf_range in zip(leaf_hulls, leaf_values(t, value), strict=True)
        ]
    return leaf_hulls


def leaf_values(t: Type, value: Value) -> list[list[Value]]:
    """The values that each leaf of `leaves(t)` has in `value`; within a list it has several."""
    if isinstance(t, RecordType):
        return [x for (_, f), v in zip(t.fields, value, strict=True) for x in leaf_values(f, v)]
    if isinstance(t, ArrayType):
        return [x for v in value for x in leaf_values(t.element, v)]
    if isinstance(t, ListType):
        merged: list[list[Value]] = [[] for _ in leaves(t.element)]
        for v in value:
            for into, x in zip(merged, leaf_values(t.element, v), strict=True):
                into.extend(x)
        return merged
    return [[value]]


def _shared_hulls(hulls: Sequence[Hull], count: int) -> list[Hull]:
    """For each leaf of an element, the hull of its values in all elements of an array."""
    element_hulls: list[Hull] = []
    for i in range(count):
        same = [h for h in hulls[i::count] if h is not None]
        element_hulls.append((min(h[0] for h in same), max(h[1] for h in same)) if same else None)
    return element_hulls


# ---------------------------------------------------------------- the two bodies


class Packing:
    """Builds the C of `pack` and `unpack` together; `bits`: how many bits are packed so far."""

    def __init__(self) -> None:
        self.pack: list[c.CStmt] = []
        self.unpack: list[c.CStmt] = []
        self.bits = 0
        self.label: Label = ("", 0)
        """The label of the fields that follow."""
        self.labelled: list[tuple[Label, int, int]] = []
        """The label, first bit and width of every field so far."""
        self._names = 0

    def new_name(self, stem: str) -> str:
        """A new name for a C variable, which begins with `stem`."""
        self._names += 1
        return f"{stem}{self._names}"

    @property
    def word_count(self) -> int:
        """How many words of 64 bits the fields take."""
        return -(-self.bits // WORD)

    def add_field(self, value: c.CExpr, width: int) -> c.CExpr:
        """Packs the low `width` bits of `value`; returns the C by which `unpack` reads them."""
        if width == 0:
            return u64(0)
        value = self._declare_value(value) if self.bits % WORD + width > WORD else value
        at = self.bits
        self.labelled.append((self.label, at, width))
        self._write_field(value, width)
        return self._read_field(at, width)

    def _declare_value(self, value: c.CExpr) -> c.CExpr:
        name = self.new_name("v")
        self.pack.append(c.Declare("uint64_t", name, value, const=True))
        return c.Name(name)

    def _write_field(self, value: c.CExpr, width: int) -> None:
        offset = self.bits % WORD
        w = c.Name("w")
        shifted = c.Binary("<<", value, small_constant(offset)) if offset else value
        self.pack.append(c.Assign(w, c.Binary("|", w, shifted) if offset else shifted))
        index = self.bits // WORD
        self.bits += width
        if offset + width >= WORD:
            self.pack.append(c.Assign(c.IndexExpr(WORDS, small_constant(index)), w))
        if offset + width > WORD:
            self.pack.append(c.Assign(w, c.Binary(">>", value, small_constant(WORD - offset))))

    def _read_field(self, at: int, width: int) -> c.CExpr:
        index, offset = divmod(at, WORD)
        e: c.CExpr = c.IndexExpr(WORDS, small_constant(index))
        if offset:
            e = c.Binary(">>", e, small_constant(offset))
        if offset + width > WORD:
            rest = c.IndexExpr(WORDS, small_constant(index + 1))
            e = c.Binary("|", e, c.Binary("<<", rest, small_constant(WORD - offset)))
        masked = width < WORD and offset + width != WORD
        return c.Binary("&", e, small_constant((1 << width) - 1)) if masked else e

    def align_to_word(self) -> None:
        """Fills up the current word, so that the next field begins a new word."""
        self.store_last_word()
        self.bits += -self.bits % WORD

    def mask_words(self, wanted: Callable[[Label], bool]) -> list[int]:
        """Words whose bits are 1 in the fields of wanted labels; call it after the last field."""
        mask = 0
        for label, at, width in self.labelled:
            if wanted(label):
                mask |= ((1 << width) - 1) << at
        return [mask >> (WORD * i) & ALL_ONES for i in range(self.word_count)]

    # ------------------------------------------------------------ values of a type

    def append_value(
        self, place: c.CExpr, t: Type, hulls: Sequence[Hull], present: c.CExpr | None = None
    ) -> None:
        """Packs and unpacks a value of type `t`; packs zeros in its place if `present` is 0."""
        if isinstance(t, RecordType):
            at = 0
            for name, field_type in t.fields:
                count = sum(1 for _ in leaves(field_type))
                self.append_value(
                    c.Member(place, field_name(name)), field_type, hulls[at : at + count], present
                )
                at += count
        elif isinstance(t, (ArrayType, ListType)):
            self._pack_sequence(place, t, hulls, present)
        else:
            packed = self.add_field(
                _scalar_to_word(place, t, hulls[0], present), scalar_width(t, hulls[0])
            )
            self.unpack.append(c.Assign(place, _word_to_scalar(packed, t, hulls[0])))

    def _pack_sequence(
        self,
        place: c.CExpr,
        t: ArrayType | ListType,
        hulls: Sequence[Hull],
        present: c.CExpr | None,
    ) -> None:
        listed = isinstance(t, ListType)
        if listed:
            self.append_value(c.Member(place, "len"), _LENGTH, [(0, _capacity(t))], present)
        items = c.Member(place, "items" if listed else "at")
        count = sum(1 for _ in leaves(t.element))
        if leaf_count(t) <= UNROLLED:
            for number in range(_capacity(t)):
                hull = hulls if listed else hulls[number * count : (number + 1) * count]
                self.append_value(
                    c.IndexExpr(items, c.Number(str(number))), t.element, hull, present
                )
            return
        hull = hulls if listed else _shared_hulls(hulls, count)
        self.align_to_word()
        first = self.bits // WORD
        width = _value_width(t.element, hull)
        self.labelled.append((self.label, self.bits, width * _capacity(t)))
        self.bits += width * _capacity(t)
        index = self.new_name("k")
        writes: list[c.CStmt] = []
        reads: list[c.CStmt] = []
        at = c.Binary("+", u64(first * WORD), c.Binary("*", as_u64(c.Name(index)), u64(width)))
        element = c.IndexExpr(items, c.Name(index))
        self._pack_in_loop(
            element, t.element, hull, at, 0, present=present, writes=writes, reads=reads
        )
        low, size = c.Number("0"), c.Number(str(_capacity(t)))
        zero = c.Assign(c.IndexExpr(WORDS, c.Name(index)), u64(0))
        self.pack.append(
            c.For(index, c.Number(str(first)), c.Number(str(self.word_count)), (zero,))
        )
        self.pack.append(c.For(index, low, size, tuple(writes)))
        self.unpack.append(c.For(index, low, size, tuple(reads)))
        self.bits += -self.bits % WORD

    def _pack_in_loop(
        self,
        place: c.CExpr,
        t: Type,
        hulls: Sequence[Hull],
        base: c.CExpr,
        at: int,
        *,
        present: c.CExpr | None,
        writes: list[c.CStmt],
        reads: list[c.CStmt],
    ) -> int:
        """Adds a value, `at` bits after `base`, to a loop's body; returns the next free bit."""
        if isinstance(t, RecordType):
            first = 0
            for name, field_type in t.fields:
                count = sum(1 for _ in leaves(field_type))
                inner, hull = (c.Member(place, field_name(name)), hulls[first : first + count])
                at = self._pack_in_loop(
                    inner, field_type, hull, base, at, present=present, writes=writes, reads=reads
                )
                first += count
            return at
        if isinstance(t, (ArrayType, ListType)):
            hull = list(hulls)
            if isinstance(t, ListType):
                length, size = c.Member(place, "len"), (0, _capacity(t))
                at = self._pack_in_loop(
                    length, _LENGTH, [size], base, at, present=present, writes=writes, reads=reads
                )
            else:
                hull = _shared_hulls(hulls, sum(1 for _ in leaves(t.element)))
            items = c.Member(place, "items" if isinstance(t, ListType) else "at")
            width = _value_width(t.element, hull)
            index = self.new_name("k")
            step = c.Binary("*", as_u64(c.Name(index)), u64(width))
            inside_w: list[c.CStmt] = []
            inside_r: list[c.CStmt] = []
            place = c.IndexExpr(items, c.Name(index))
            start = c.Binary("+", base, step)
            self._pack_in_loop(
                place, t.element, hull, start, at, present=present, writes=inside_w, reads=inside_r
            )
            low, high = c.Number("0"), c.Number(str(_capacity(t)))
            writes.append(c.For(index, low, high, tuple(inside_w)))
            reads.append(c.For(index, low, high, tuple(inside_r)))
            return at + width * _capacity(t)
        width = scalar_width(t, hulls[0])
        if width == 0:
            reads.append(c.Assign(place, _word_to_scalar(u64(0), t, hulls[0])))
            return at
        where = c.Binary("+", base, u64(at)) if at else base
        shown = _scalar_to_word(place, t, hulls[0], present)
        writes.append(c.Do(c.CallExpr("soter_put", (WORDS, where, small_constant(width), shown))))
        got = c.CallExpr("soter_get", (WORDS, where, small_constant(width)))
        reads.append(c.Assign(place, _word_to_scalar(got, t, hulls[0])))
        return at + width

    def store_last_word(self) -> None:
        """Stores the word of the last field, if the field has left it partly empty."""
        if self.bits % WORD:
            index = c.IndexExpr(WORDS, small_constant(self.bits // WORD))
            self.pack.append(c.Assign(index, c.Name("w")))


_LENGTH = IntType(0, 2**31 - 1)


def _capacity(t: ArrayType | ListType) -> int:
    return t.size if isinstance(t, ArrayType) else t.capacity


def scalar_width(t: Type, hull: Hull) -> int:
    """How many bits a packed scalar takes."""
    if isinstance(t, FloatType):
        return WORD
    if isinstance(t, BoolType):
        return 1
    if isinstance(t, EnumType):
        return (len(t.members) - 1).bit_length()
    assert hull is not None
    return (hull[1] - hull[0]).bit_length()


def _value_width(t: Type, hulls: Sequence[Hull]) -> int:
    if isinstance(t, RecordType):
        at, total = 0, 0
        for _, f in t.fields:
            count = sum(1 for _ in leaves(f))
            total += _value_width(f, hulls[at : at + count])
            at += count
        return total
    if isinstance(t, ArrayType):
        return t.size * _value_width(
            t.element, _shared_hulls(hulls, sum(1 for _ in leaves(t.element)))
        )
    if isinstance(t, ListType):
        return scalar_width(_LENGTH, (0, t.capacity)) + t.capacity * _value_width(t.element, hulls)
    return scalar_width(t, hulls[0])


def _scalar_to_word(place: c.CExpr, t: Type, hull: Hull, present: c.CExpr | None) -> c.CExpr:
    """The C that turns a stored scalar into bits, as the distance from the low end of its hull."""
    if isinstance(t, FloatType):
        e: c.CExpr = c.CallExpr("soter_float_bits", (place,))
    else:
        e = as_u64(place)
        if hull is not None and hull[0] != 0:
            e = c.Binary("-", e, u64(hull[0] & ALL_ONES))
    return e if present is None else c.Binary("&", e, present)


def _word_to_scalar(packed: c.CExpr, t: Type, hull: Hull) -> c.CExpr:
    if isinstance(t, FloatType):
        return c.CallExpr("soter_float_of", (packed,))
    s = scalar(t)
    assert s is not None
    if hull is not None and hull[0] != 0:
        if packed == u64(0):
            return c.Cast(s.c_type, int_number(hull[0]))
        packed = c.Binary("+", packed, u64(hull[0] & ALL_ONES))
    return c.Cast(s.c_type, packed)
