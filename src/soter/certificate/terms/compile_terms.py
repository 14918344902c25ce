"""Terms become straight-line programs over Arb balls: one call encloses a step over a whole cell.

Purpose: `compile_step`: a function from the form of a set of states to the forms of what a step
makes of it, with the ranges wanted and the propositions that must hold.
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

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.certificate.terms.affine_forms import AffineForms
from soter.certificate.terms.arb_balls import HALF, ZERO, larger, smaller
from soter.certificate.terms.atom_values import demand, make_atoms, truth_of
from soter.certificate.terms.operations import grown
from soter.certificate.terms.straight_line import Function

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flint import arb

    from soter.certificate.terms.straight_line import Value
    from soter.certificate.terms.terms import Linear, Proposition, Terms

    Step = Callable[[tuple[arb, ...]], "tuple[tuple[arb, ...], tuple[float, ...]] | None"]


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweep:
    """Where the states are at some time between two instants, as one box.

    `drift`: rows over states and `arguments`, and `drift_constant`, all balls: x(t) - x(start) for
    every t between. `rate`: rows over states and `commands` (of each several that may act), and
    `rate_constant`: the derivative. Where that has one sign the ends are those of the instants.
    """

    starts: tuple[Linear, ...]
    ends: tuple[Linear, ...]
    arguments: tuple[Linear, ...]
    drift: tuple[tuple[arb, ...], ...]
    drift_constant: tuple[arb, ...]
    commands: tuple[tuple[Linear, ...], ...]
    rate: tuple[tuple[arb, ...], ...]
    rate_constant: tuple[arb, ...]
    span: arb
    """The time between the instants, in s."""

    @property
    def parts(self) -> tuple[Linear, ...]:
        """Every form in it."""
        acting = (u for alternatives in self.commands for u in alternatives)
        return (*self.starts, *self.ends, *self.arguments, *acting)


def compile_step(
    terms: Terms,
    states: Sequence[int],
    symbols: int,
    outputs: Sequence[Linear],
    *,
    ranges: Sequence[Linear | Sweep] = (),
    must: Sequence[Proposition] = (),
    boxes: Mapping[int, tuple[arb, arb]] | None = None,
    memories: tuple[int, int] = (0, 0),
) -> Step:
    """`form -> (form of the outputs, (low, high) of each of `ranges`)`.

    None where something in `must` is not certain. `states`: atoms that the form describes, every
    other input ranges over `boxes`, or its domain where nothing is said there. `memories`: how
    many of the states, and of the outputs, are memories: the last ones.
    """
    forms = AffineForms(terms, states, symbols, boxes or {}, memories[0])
    return _step(forms, outputs, ranges, must, memories[1])


def compile_truths(
    terms: Terms,
    states: Sequence[int],
    truths: Sequence[Proposition],
    boxes: Mapping[int, tuple[arb, arb]],
) -> Function:
    """`form of a box -> truths`: bit 0: may be false, bit 1: may be true."""
    return _truths(AffineForms(terms, states, 0, boxes), truths)


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


def _step(
    forms: AffineForms,
    outputs: Sequence[Linear],
    ranges: Sequence[Linear | Sweep],
    must: Sequence[Proposition],
    memories: int,
) -> Step:
    make = forms.builder
    linear = [y for x in ranges for y in (x.parts if isinstance(x, Sweep) else (x,))]
    make_atoms(forms, [*outputs, *linear, *must])
    demand(forms, must)
    made = [forms.form(x) for x in outputs]
    radii = [make.sum([*forms.betas(f[2]), f[3]]) or make.zero for f in made]
    output_ranges = [
        forms.range_of_form(x, f, b) for x, f, b in zip(outputs, made, radii, strict=True)
    ]
    flat = [end for interval in output_ranges for end in interval]
    flat += [f[0] for f in made]
    flat += [g for f in made for g in f[1]]
    leading = len(outputs) - memories
    flat += radii[:leading]
    shared = [forms.in_common(f, made[:leading]) for f in made[leading:]]
    flat += [rest for rest, _ in shared]
    flat += [a for _, row in shared for a in row]
    ends: list[Value] = []
    for x in ranges:
        ends += _swept(forms, x) if isinstance(x, Sweep) else _ends_of(forms, x)
    return Function(make, forms.length, [*flat, *ends], after=len(flat))


def _truths(forms: AffineForms, truths: Sequence[Proposition]) -> Function:
    make_atoms(forms, truths)
    return Function(forms.builder, forms.length, [truth_of(forms, x) for x in truths])


def _ends_of(forms: AffineForms, x: Linear) -> list[Value]:
    """The range of a form, in doubles."""
    low, high = forms.range_of(x)
    return [forms.builder.apply("below", low), forms.builder.apply("above", high)]


def _swept(forms: AffineForms, x: Sweep) -> list[Value]:
    """The ends of the box, one state after the other."""
    make = forms.builder
    balls = [_ball(forms, y) for y in x.starts]
    arguments = [*balls, *(_ball(forms, y) for y in x.arguments)]
    between = []
    for ball, row, constant in zip(balls, x.drift, x.drift_constant, strict=True):
        between.append(make.sum([ball, _dot(forms, row, arguments, constant)]) or make.zero)
    acting = []
    for alternatives in x.commands:
        any_of_them, *others = (_ball(forms, u) for u in alternatives)
        for other in others:
            any_of_them = make.apply("union", any_of_them, other)
        acting.append(any_of_them)
    ends: list[Value] = []
    for i, (row, constant) in enumerate(zip(x.rate, x.rate_constant, strict=True)):
        own = row[i]
        other_rates = [*row[:i], ZERO, *row[i + 1 :]]
        rest = _dot(forms, other_rates, [*between, *acting], constant)
        if rest is None and own.is_zero():
            ends += _ends_of(forms, x.starts[i])
            continue
        instants = *forms.range_of(x.starts[i]), *forms.range_of(x.ends[i])
        law = make.constant(own), make.constant(grown(own, x.span))
        ends += make.parts("swept", 2, *instants, between[i], rest or make.zero, *law)
    return ends


def _dot(
    forms: AffineForms, row: Sequence[arb], values: Sequence[Value], constant: arb
) -> Value | None:
    parts = [forms.builder.times(c, x) for c, x in zip(row, values, strict=True)]
    return forms.builder.sum(parts, constant)


def _ball(forms: AffineForms, x: Linear) -> Value:
    ball: Value = forms.cached(
        "ball", x, lambda y: forms.builder.apply("union", *forms.range_of(y))
    )
    return ball
