"""Elements of arrays at an index that depends on inputs.

Purpose: `element_at`, `row_values` and `element_of_table` make terms of such elements;
`enclose_element` and `range_of_table` enclose them: by all between the possible positions.
Non-goals: arrays at an index that is known (`reading/symbolic_reading.py`).
"""

from __future__ import annotations

import math
from math import isfinite
from typing import TYPE_CHECKING

import numpy as np

from soter.certificate.reading.symbolic_operations import remembered_with_doubts
from soter.certificate.reading.symbolic_values import NOT_HERE, Rows
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import HALF, ONE, exact
from soter.certificate.terms.terms import Atom, negation

if TYPE_CHECKING:
    from collections.abc import Sequence

    from flint import arb
    from numpy.typing import NDArray

    from soter.certificate.reading.symbolic_operations import Operations
    from soter.certificate.reading.symbolic_values import Value
    from soter.certificate.terms.compile_terms import AffineForms, Ends, Row
    from soter.certificate.terms.terms import Linear, Terms


def row_values(make: Operations, rows: Rows) -> Value:
    """All numbers of a row whose index depends on inputs.

    Raises NotRecheckedError if rows differ in length.
    """
    if len({len(row) for row in rows.elements}) != 1:
        raise NotRecheckedError(f"such an array, indexed by an input, {NOT_HERE}")
    width = range(len(rows.elements[0]))
    return tuple(element_at(make, [row[k] for row in rows.elements], rows.index) for k in width)


@remembered_with_doubts
def element_at(make: Operations, elements: Sequence[Value], index: Linear) -> Value:
    """The element at an index that depends on inputs; NotRecheckedError if they are no numbers."""
    first = elements[0]
    if isinstance(first, tuple) and all(type(x) in (float, int) for x in first):
        return Rows(elements, index)
    if isinstance(first, tuple):
        parts = range(len(first))
        return tuple(element_at(make, [e[k] for e in elements], index) for k in parts)
    if not all(type(e) in (float, int) for e in elements):
        raise NotRecheckedError(f"such an array, indexed by an input, {NOT_HERE}")
    values = [float(e) for e in elements]
    return make.int_if_any(term_of_table(make.terms, values, (index,), (len(elements),)), first)


@remembered_with_doubts
def element_of_table(make: Operations, rows: Rows, index: Value) -> Value:
    """An element of a table with two indices. NotRecheckedError if rows differ in length."""
    first = rows.elements[0]
    if len({len(row) for row in rows.elements}) != 1 or len({type(v) for v in first}) != 1:
        raise NotRecheckedError(f"such an array, indexed by an input, {NOT_HERE}")
    values = [float(v) for row in rows.elements for v in row]
    shape = (len(rows.elements), len(first))
    indices = rows.index, make.finite_term(index)
    return make.int_if_any(term_of_table(make.terms, values, indices, shape), first[0])


def term_of_table(
    terms: Terms, values: Sequence[float], indices: Sequence[Linear], shape: Sequence[int]
) -> Linear:
    """The term values[index, ...]; adds the obligation that this element exists.

    Raises NotRecheckedError if a value is not finite.
    """
    if not all(isfinite(v) for v in values):
        raise NotRecheckedError("a table with a number that is not finite")
    for index, size in zip(indices, shape, strict=True):
        terms.add_obligation(negation(terms.below_zero(index)))
        terms.add_obligation(terms.below_zero(terms.combine(((ONE, index),), exact(float(-size)))))
    atom = Atom("table", tuple(indices), low=exact(min(values)), high=exact(max(values)))
    atom.values, atom.shape = tuple(values), tuple(shape)
    return terms.add_atom(atom)


def range_of_table(values: NDArray[np.float64], *ends: float) -> tuple[arb, arb]:
    """The range of a table's numbers at positions between `ends`, which are whole numbers.

    `values`: shaped as the table (n_1, ..., n_k); `ends`: the low and high position for each axis.
    """
    part = []
    for axis, size in enumerate(values.shape):
        low, high = ends[2 * axis], ends[2 * axis + 1]
        first = 0 if not low > 0 else min(math.ceil(low), size - 1)
        last = size - 1 if not high < size - 1 else max(math.floor(high), 0)
        part.append(slice(first, last + 1) if first <= last else slice(None))
    touched = values[tuple(part)]
    return exact(float(touched.min())), exact(float(touched.max()))


def enclose_element(forms: AffineForms, atom: Atom) -> tuple[Row, Ends]:
    """The row and range of an element that may have any position between two ends."""
    make = forms.make
    values = make.constant(np.array(atom.values).reshape(atom.shape))
    positions: list[Value] = []
    for low, high in (forms.term_ends(x) for x in atom.arguments):
        positions += [make.apply("below", low), make.apply("above", high)]
    low, high = make.apply_for_parts("range_of_table", 2, values, *positions)
    return ({}, (low + high) * HALF, (high - low) * HALF), (low, high)
