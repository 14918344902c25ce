"""SC's law and a group's flow as linear functions, with what these leave out as a spread.

Purpose: `linear_law`: SC commands u = z = K y + k while z lies between two limits. It makes a
`CommandLaw` of SC's terms and of the z and limits that a certificate names; all that z does not say
of u is its spread, and what must hold for SC not to fault is shown, too. `enclosed_flow`: how far
the rates of a group are from A x + B u + c, A, B and c being those that a certificate names,
wherever the states are in their ranges: x' = A x + B u + c + W w, |w| <= 1.
Non-goals: whether z keeps within the limits (`polytope_check.py`); believing A, B, c: others give a
useless W, never a wrong one; linear flows (`reading/linear_flows.py`).

Argument. Over the ranges X of all states f(x, u, d) = A x + B u + c + r with |r| <= R entry by
entry. Let r' be r cut to [-R, R]: f' = A x + B u + c + r' is what is enclosed wherever the state
is, and f wherever it lies in X. f' is Lipschitz where f is. What is shown of every solution of f'
is that it stays in X: so it solves f, and is the only one that does (an assumption, printed where a
flow is not linear). That the simulator's scheme follows it is assumed, too.

The terms are enclosed once (`terms/compile_terms.py`), over the inputs in their ranges *with every
z in its limits*: so a clamp at the limits is seen not to act. Over their ranges inputs are x = m +
G eps, eps in [-1, 1]. There z = e_0 + e eps, and a z in its limits is c + r zeta, zeta in [-1, 1]:
solved for the eps_p that moves z most, that is eps_p = (c + r zeta - e_0 - the others) / e_p, and
zeta takes its place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.certificate.reading.case_model import control_inputs
from soter.certificate.reading.linear_flows import LinearFlow
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.compile_terms import (
    TAIL,
    AffineForms,
    compile_lines,
    demand,
    form_of_box,
    make_atoms,
)
from soter.certificate.terms.linear_enclosures import HALF, ONE, ZERO, exact, magnitude
from soter.certificate.terms.straight_line import Function
from soter.certificate.terms.terms import Linear, inputs_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flint import arb

    from soter.certificate.polytope.certificate_tables import ClaimedLaw, ClaimedRates
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.compile_terms import Ends
    from soter.certificate.terms.terms import Proposition, Terms

    Ranges = list[tuple[arb, arb]]


SPLITS = 6
"""The number of times that ranges are halved, along the inputs that rates are not linear in."""


def _control_row(claimed: Sequence[float], acting: Sequence[int], controls: int) -> list[arb]:
    made = [ZERO] * controls
    for k, x in zip(acting, claimed, strict=True):
        made[k] = exact(float(x))
    return made


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
    b = [
        _control_row(row, acting, len(controls))
        for _, row in zip(members, claimed.control, strict=True)
    ]
    constant = [exact(float(x)) for x in claimed.constant]
    rests = []
    for at, i in enumerate(members):
        parts = [(ONE, rates[i])]
        parts += [(-x, states[k]) for k, x in zip(members, a[at], strict=True)]
        parts += [(-x, u) for u, x in zip(controls, b[at], strict=True)]
        rests.append(terms.combine(parts, -constant[at]))
    inputs = [x.atom for x in (*states, *controls, *disturbances)]
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

    bent = _nonlinear_inputs(terms, rests)
    noise = _largest_sizes(ranges, [at for at, k in enumerate(inputs) if k in bent], sizes, SPLITS)
    columns = [[x if i == k else ZERO for k, x in enumerate(noise)] for i in range(len(members))]
    limits = tuple((exact(c.low), exact(c.high)) for c in model.facts.controls)
    return LinearFlow(tuple(members), a, b, constant, columns, limits)


def _nonlinear_inputs(terms: Terms, values: Sequence[Linear]) -> set[int]:
    """The inputs in which values are not linear."""
    roots: list[Linear | Proposition] = []
    for atom in (terms.atoms[k] for x in values for k in x.terms):
        roots += atom.arguments
        roots += [] if atom.condition is None else [atom.condition]
    return inputs_of(terms, roots)


def _largest_sizes(
    box: Ranges, axes: Sequence[int], sizes: Callable[[Ranges], list[arb]], splits: int
) -> list[arb]:
    """The largest sizes on parts of the box, halved so often along these axes, in turns."""
    if not splits or not axes:
        return sizes(box)
    axis, *others = axes
    low, high = box[axis]
    middle = ((low + high) * HALF).mid()
    found = [
        _largest_sizes([*box[:axis], half, *box[axis + 1 :]], [*others, axis], sizes, splits - 1)
        for half in ((low, middle), (middle, high))
    ]
    return [x.max(y) for x, y in zip(*found, strict=True)]


@dataclass(frozen=True, eq=False)
class CommandLaw:
    """SC commands gain x + offset up to `spread`, x being the group's states that it read.

    Errors and all other inputs are in `spread`. It holds while z lies in [low, high], and z does
    where gain x + offset +- spread does.
    """

    controls: tuple[int, ...]
    gain: list[list[arb]]
    offset: list[arb]
    spread: list[arb]
    low: list[arb]
    high: list[arb]


def _middle_without(
    own: Sequence[int], z: Linear, rest: arb, ranges: Mapping[int, tuple[arb, arb]]
) -> tuple[arb, arb]:
    """The middle of z without the atoms `own`, and how far that part is off it, `rest` included."""
    if not rest.is_finite():
        raise RejectedError("SC's law is not linear between its limits")
    constant = z.const
    for atom in z.terms.keys() - set(own):
        centre, radius = _middle_and_radius(*ranges[atom])
        constant += z.terms[atom] * centre
        rest += abs(z.terms[atom]) * radius
    return constant, rest


def linear_law(model: CaseModel, members: Sequence[int], claimed: ClaimedLaw) -> CommandLaw:
    """The law of a group; `RejectedError` where it is not linear within the limits."""
    names = [c.name for c in model.facts.controls]
    if sorted({*claimed.controls} & {*names}) != sorted(claimed.controls):
        raise RejectedError("the law of a polytope group is of unknown controls")
    controls = tuple(map(names.index, claimed.controls))
    terms, states = model.new_terms()
    commands = model.commands(terms, states)
    ranges = {i: (a.low, a.high) for i, a in enumerate(terms.atoms) if a.kind == "box"}
    for x, (least, most) in zip(states, model.extents, strict=True):
        ranges[x.atom] = exact(least), exact(most)
    zs = _claimed_laws(model, terms, states, claimed)
    low, high = ([exact(float(x)) for x in ends] for ends in (claimed.low, claimed.high))
    form = _form_within_limits(ranges, zs, list(zip(low, high, strict=True)))
    rests = [
        terms.combine(((ONE, commands[c]), (-ONE, z))) for c, z in zip(controls, zs, strict=True)
    ]
    forms = _ByBothRanges(terms, list(ranges), len(ranges), {})
    make_atoms(forms, [*rests, *terms.obligations])
    demand(forms, terms.obligations)
    ends = [end for x in rests for end in forms.range_of(x)]
    found = Function(forms.make, forms.length, ends)(form)
    if found is None:
        raise RejectedError("SC is not certain to step within its sets where it is linear")
    own = [states[i].atom for i in members]
    gain, offset, spread = [], [], []
    for z, least, most in zip(zs, found[::2], found[1::2], strict=True):
        constant, rest = _middle_without(own, z, magnitude(least).max(magnitude(most)), ranges)
        gain.append([z.terms.get(atom, ZERO) for atom in own])
        offset.append(constant)
        spread.append(rest)
    return CommandLaw(controls, gain, offset, spread, low, high)


def _claimed_laws(
    model: CaseModel, terms: Terms, states: Sequence[Linear], claimed: ClaimedLaw
) -> list[Linear]:
    """Each z, over the inputs of the manifest: states, controls, disturbances, errors, others."""
    facts = model.facts
    boxes = {a.name: i for i, a in enumerate(terms.atoms) if a.kind == "box"}
    places: list[int | None] = [x.atom for x in states]
    places += [None] * (len(facts.controls) + len(facts.disturbances))
    places += [boxes.get(e.name) for e in (*facts.errors, *facts.others)]
    zs = []
    for row, offset in zip(claimed.gain.tolist(), claimed.offset.tolist(), strict=True):
        parts = []
        for factor, place in ((f, at) for f, at in zip(row, places, strict=True) if f != 0.0):
            if place is None:
                raise RejectedError("the law of a polytope group has inputs that SC does not read")
            atom = terms.atoms[place]
            parts.append((exact(factor), Linear(ZERO, {place: ONE}, ZERO, atom.low, atom.high)))
        zs.append(terms.combine(parts, exact(offset)))
    return zs


def _middle_and_radius(low: arb, high: arb) -> tuple[arb, arb]:
    return (low + high) * HALF, (high - low) * HALF


def _form_within_limits(
    ranges: dict[int, tuple[arb, arb]], zs: Sequence[Linear], limits: Sequence[tuple[arb, arb]]
) -> tuple[arb, ...]:
    """The form (`terms/compile_terms.py`) of all inputs in their ranges with each z in its limits.

    A z that nothing certainly moves says nothing.
    """
    places = {atom: k for k, atom in enumerate(ranges)}
    centres, radii = zip(*(_middle_and_radius(*ends) for ends in ranges.values()), strict=True)
    centre = list(centres)
    symbols = [[r if i == k else ZERO for k in places.values()] for i, r in enumerate(radii)]
    free = set(places.values())
    for z, limit in zip(zs, limits, strict=True):
        row = [(x, places[atom]) for atom, x in z.terms.items()]
        constant = z.const + sum((x * centre[i] for x, i in row), ZERO)
        e = [sum((x * symbols[i][k] for x, i in row), ZERO) for k in places.values()]
        movers = [k for k in free if e[k] != 0]
        if not movers:
            continue
        pivot = max(movers, key=lambda k: float(magnitude(e[k])))
        free.discard(pivot)
        c, r = _middle_and_radius(*limit)
        for i, own in enumerate(symbols):
            share = own[pivot] / e[pivot]
            centre[i] += share * (c - constant)
            symbols[i] = [x - share * y for x, y in zip(own, e, strict=True)]
            symbols[i][pivot] = share * r
    ends = [end for interval in ranges.values() for end in interval]
    return (*ends, *centre, *(x for row in symbols for x in row), *(ZERO for _ in places))


class _ByBothRanges(AffineForms):
    """`AffineForms` with ranges no wider than the intervals of their atoms make them."""

    def _make_range(self, x: Linear) -> Ends:
        return self.tighter_ends(*super()._make_range(x), *self.range_by_atoms(x))
