"""Terms as rows over their inputs: the local linear models of what is not linear.

Purpose: `compile_lines`: a function from a form (`certificate/terms/compile_terms.py`) to, for each
output, a row of coefficients over the inputs, a constant, a spread and a range, that hold all over
the form.
Non-goals: what is done with them (`nonlinear_flow.py`, `nonlinear_chains.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.terms.affine_forms import AffineForms
from soter.certificate.terms.atom_values import demand, make_atoms
from soter.certificate.terms.straight_line import Function

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flint import arb

    from soter.certificate.terms.straight_line import Value
    from soter.certificate.terms.terms import Linear, Proposition, Terms

TAIL = 4
"""Behind the coefficients of a row: constant, spread, low, high."""


def compile_lines(
    terms: Terms,
    inputs: Sequence[int],
    symbols: int,
    outputs: Sequence[Linear],
    must: Sequence[Proposition],
    boxes: Mapping[int, tuple[arb, arb]],
) -> Function:
    """`form -> rows`, one after the other; None where something in `must` is not certain.

    For every point of the form: output = sum coefficient * input + constant +- spread, and the
    output lies in [low, high]. Inputs that the form does not describe range over `boxes`, or over
    their domains.
    """
    forms = AffineForms(terms, inputs, symbols, boxes)
    make_atoms(forms, [*outputs, *must])
    demand(forms, must)
    zero, entries = forms.builder.zero, []
    for x in outputs:
        row, constant, spread = forms.row(x)
        entries += [forms.builder.coefficient(row[a]) if a in row else zero for a in forms.place]
        entries += [constant or zero, spread or zero, *_both_ranges(forms, x)]
    return Function(forms.builder, forms.length, entries)


def _both_ranges(forms: AffineForms, x: Linear) -> tuple[Value, Value]:
    """The range by the row and that by the intervals of the atoms, whichever is tighter."""
    low, high = forms.range_of(x)
    natural = forms.natural(x, *forms.parts(x))
    return (
        forms.builder.apply("larger", low, natural[0]),
        forms.builder.apply("smaller", high, natural[1]),
    )
