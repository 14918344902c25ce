"""Flows that are not linear as linear ones with noise, over the box of C of all groups at once.

Purpose: `enclosed_flow`: for A, B and c that a certificate names, how far the rates of a group are
from A x + B u + c wherever the states are in their ranges: x' = A x + B u + c + W w, |w| <= 1.
Non-goals: believing A, B, c: others give a useless W, never a wrong one; linear flows
(`linear_flows.py`).

Argument. Over the ranges X of all states f(x, u, d) = A x + B u + c + r with |r| <= R entry by
entry. Let r' be r cut to [-R, R]: f' = A x + B u + c + r' is what is enclosed wherever the state
is, and f wherever it lies in X. f' is Lipschitz where f is. What is shown of every solution of f'
is that it stays in X: so it solves f, and is the only one that does (an assumption, printed where a
flow is not linear). That the simulator's scheme follows it is assumed, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.reading.case_model import control_inputs
from soter.certificate.reading.linear_flows import LinearFlow
from soter.certificate.terms.arb_balls import HALF, ONE, ZERO, exact, magnitude
from soter.certificate.terms.compile_terms import TAIL, compile_lines, form_of_box
from soter.certificate.terms.terms import NotRecheckedError, inputs_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from flint import arb

    from soter.certificate.polytope.certificate_tables import ClaimedRates
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.terms import Linear, Proposition, Terms

    Ranges = list[tuple[arb, arb]]

SPLITS = 6
"""How often the ranges are halved, along what the rates are not linear in."""


def enclosed_flow(
    model: CaseModel, members: Sequence[int], acting: Sequence[int], claimed: ClaimedRates
) -> LinearFlow:
    """The flow of a group over the ranges of all states; `acting`: the controls of `claimed`.

    What is not linear, disturbances, and what other groups do to it are noise. NotRecheckedError
    where a rate is not certainly defined on all of the ranges.
    """
    terms, states = model.new_terms()
    controls = control_inputs(model.facts, terms)
    rates, disturbances = model.rates(terms, states, controls)
    a = [[exact(float(x)) for x in row] for row in claimed.state]
    b = [[ZERO] * len(controls) for _ in members]
    for to, row in zip(b, claimed.control, strict=True):
        for k, x in zip(acting, row, strict=True):
            to[k] = exact(float(x))
    constant = [exact(float(x)) for x in claimed.constant]
    rests = []
    for at, i in enumerate(members):
        parts = [(ONE, rates[i])]
        parts += [(-x, states[k]) for k, x in zip(members, a[at], strict=True)]
        parts += [(-x, u) for u, x in zip(controls, b[at], strict=True)]
        rests.append(terms.combine(parts, -constant[at]))
    inputs = [next(iter(x.terms)) for x in (*states, *controls, *disturbances)]
    ranges = [(terms.atoms[k].low, terms.atoms[k].high) for k in inputs]
    ranges[: len(states)] = [(exact(low), exact(high)) for low, high in model.extents]
    lines = compile_lines(terms, inputs, 0, rests, terms.obligations, {})
    width = len(inputs) + TAIL

    def sizes(box: Ranges) -> list[arb]:
        found = lines(form_of_box(box, symbols=False))
        if found is None:
            raise NotRecheckedError("a flow that is not certainly defined all over the box of C")
        ends = [found[(at + 1) * width - 2 : (at + 1) * width] for at in range(len(members))]
        return [magnitude(low).max(magnitude(high)) for low, high in ends]

    bent = _bent(terms, rests)
    noise = _largest(ranges, [at for at, k in enumerate(inputs) if k in bent], sizes, SPLITS)
    columns = [[x if i == k else ZERO for k, x in enumerate(noise)] for i in range(len(members))]
    limits = tuple((exact(c.low), exact(c.high)) for c in model.facts.controls)
    return LinearFlow(tuple(members), a, b, constant, columns, limits)


def _bent(terms: Terms, values: Sequence[Linear]) -> set[int]:
    """The inputs in which values are not linear."""
    roots: list[Linear | Proposition] = []
    for atom in (terms.atoms[k] for x in values for k in x.terms):
        roots += atom.arguments
        roots += [] if atom.condition is None else [atom.condition]
    return inputs_of(terms, roots)


def _largest(
    box: Ranges, axes: Sequence[int], sizes: Callable[[Ranges], list[arb]], splits: int
) -> list[arb]:
    """The largest sizes on parts of the box, halved so often along these axes, in turns."""
    if not splits or not axes:
        return sizes(box)
    axis, *others = axes
    low, high = box[axis]
    middle = ((low + high) * HALF).mid()
    found = [
        _largest([*box[:axis], half, *box[axis + 1 :]], [*others, axis], sizes, splits - 1)
        for half in ((low, middle), (middle, high))
    ]
    return [x.max(y) for x, y in zip(*found, strict=True)]
