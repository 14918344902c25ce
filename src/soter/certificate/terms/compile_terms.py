"""Terms become straight-line programs over Arb balls: one call encloses a step over a whole cell.

Purpose: `compile_step`: a function from the form of a set of states to the forms of what a step
makes of it, with the ranges wanted and the propositions that must hold; `compile_lines`: to rows
over the states that hold all over the form; `compile_truths`: to what is known of propositions.
Non-goals: reading programs (`symbolic_reading.py`), which sets to check (`sc_chains.py`,
`predicates.py`).

The form of a set is a flat tuple: for each state an interval l, h; then for each the centre m, the
coefficients g on the symbols of the cell, the radius b of the rest:

    x in { m + sum g[k] eps_k + b beta : eps_k, beta in [-1, 1] }   and   x in [l, h]

eps_k are shared by all states, beta is its own for each state. With no symbols it is a box. States
may be followed by *memories*, commands that still act: what they have in common with the betas of
the states stands in coefficients a, and only their remainder has a beta of its own:

    u in { m + sum g[k] eps_k + sum a[i] b[i] beta_i + b beta }
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.terms.affine_forms import AffineForms
from soter.certificate.terms.arb_balls import HALF, ZERO, larger, smaller
from soter.certificate.terms.atom_values import demand, make_atoms, truth_of
from soter.certificate.terms.straight_line import Function, applied

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flint import arb

    from soter.certificate.terms.terms import Linear, Proposition, Terms

    Step = Callable[[tuple[arb, ...]], "tuple[tuple[arb, ...], tuple[float, ...]] | None"]


TAIL = 4
"""Behind the coefficients of a row: constant, spread, low, high."""


def compile_step(
    terms: Terms,
    states: Sequence[int],
    symbols: int,
    outputs: Sequence[Linear],
    *,
    ranges: Sequence[Linear] = (),
    must: Sequence[Proposition] = (),
    boxes: Mapping[int, tuple[arb, arb]] | None = None,
) -> Step:
    """`form -> (form of the outputs, (low, high) of each of `ranges`)`.

    None where something in `must` is not certain. `states`: atoms that the form describes, every
    other input ranges over `boxes`, or its domain where nothing is said there.
    """
    forms = AffineForms(terms, states, symbols, boxes or {})
    make_atoms(forms, [*outputs, *ranges, *must])
    demand(forms, must)
    flat = [end for x in outputs for end in forms.range_of(x)]
    centres, rows, rests = zip(*(forms.over_form(forms.row(x)) for x in outputs), strict=True)
    flat += [*centres, *(g for row in rows for g in row), *rests]
    ends = [
        applied(name, end)
        for x in ranges
        for name, end in zip(("below", "above"), forms.range_of(x), strict=True)
    ]
    return Function(forms.make, forms.length, [*flat, *ends], after=len(flat))


def compile_lines(
    terms: Terms,
    inputs: Sequence[int],
    symbols: int,
    outputs: Sequence[Linear],
    must: Sequence[Proposition],
    boxes: Mapping[int, tuple[arb, arb]],
    *,
    noisy: bool = False,
) -> Function:
    """`form -> rows`, one after the other; None where something in `must` is not certain.

    For every point of the form: output = sum coefficient * input + constant +- spread, and the
    output lies in [low, high]. Inputs that the form does not describe range over `boxes`, or over
    their domains. `noisy`: behind the form stands by how much each input may be off its point;
    coefficients are those on the point, and the ends of the form are those of the input.
    """
    forms = AffineForms(terms, inputs, symbols, boxes, noisy=noisy)
    make_atoms(forms, [*outputs, *must])
    demand(forms, must)
    entries = []
    for x in outputs:
        row, constant, spread = forms.row(x)
        ends = forms.within(*forms.range_of(x), *forms.natural(x))
        entries += [*(row.get(a, forms.make.zero) for a in inputs), constant, spread, *ends]
    return Function(forms.make, forms.length, entries)


def compile_truths(
    terms: Terms,
    states: Sequence[int],
    truths: Sequence[Proposition],
    boxes: Mapping[int, tuple[arb, arb]],
) -> Function:
    """`form of a box -> truths`: bit 0: may be false, bit 1: may be true."""
    forms = AffineForms(terms, states, 0, boxes)
    make_atoms(forms, truths)
    return Function(forms.make, forms.length, [truth_of(forms, x) for x in truths])


def form_of_box(box: Sequence[tuple[arb, arb]], *, symbols: bool) -> tuple[arb, ...]:
    """The form of a box; each axis has a symbol of its own where `symbols`."""
    centres = [(low + high) * HALF for low, high in box]
    radii = [(high - low) * HALF for low, high in box]
    form = [end for interval in box for end in interval] + centres
    if symbols:
        n = len(box)
        form += [radii[i] if i == k else ZERO for i in range(n) for k in range(n)]
        form += [ZERO] * n
    else:
        form += radii
    return tuple(form)


def states_of(length: int, n: int) -> int:
    """How many states and memories a form has: 4 + n entries each, n more for a memory."""
    return (length + n * n) // (4 + 2 * n)


def halved(form: tuple[arb, ...], n: int, axis: int, side: arb) -> tuple[arb, ...]:
    """The part of a form in which the beta of one state lies on one side of 0.

    beta = side + beta'/2 with side = 1/2 or -1/2: centres move by what they have of it.
    """
    count = states_of(len(form), n)
    new = list(form)
    centre, symbols = 2 * count, 3 * count
    rest = symbols + count * n
    common = rest + count
    b = form[rest + axis]
    new[centre + axis] += side * b
    new[rest + axis] = b * HALF
    for k in range(count - n):
        new[centre + n + k] += side * b * form[common + k * n + axis]
    radius = new[rest + axis]
    for k in range(n):
        radius += abs(form[symbols + axis * n + k])
    new[2 * axis] = larger(new[centre + axis] - radius, form[2 * axis])
    new[2 * axis + 1] = smaller(new[centre + axis] + radius, form[2 * axis + 1])
    return tuple(new)
