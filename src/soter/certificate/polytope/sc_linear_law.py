"""SC's law where it is linear: u = z = K y + k, as long as z lies between two limits.

Purpose: `linear_law`: from SC's terms and the z and limits that a certificate names to
`CommandLaw`, with everything that z does not say about u as spread; what must hold for SC not to
fault is shown, too.
Non-goals: whether z keeps within the limits (`polytope_check.py`).

The terms are swept once. Each atom becomes a linear form over the inputs with a radius that holds
for all inputs in their ranges *with every z in its limits*: bounds of a form F are those of
F - alpha z over the box, plus alpha times the limits, for any alpha; the alpha that removes the
input which moves z most is tried. So a clamp at the limits is seen not to act.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from flint import arb

from soter.certificate.format.errors import RejectedError
from soter.certificate.terms.arb_balls import HALF, ONE, UNIVARIATE, ZERO, exact, magnitude
from soter.certificate.terms.terms import NotRecheckedError, closure

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.certificate.polytope.certificate_tables import ClaimedLaw
    from soter.certificate.reading.case_model import CaseModel
    from soter.certificate.terms.terms import Atom, Linear, Proposition, Terms

FALSE, TRUE, UNKNOWN = 1, 2, 3


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


@dataclass(frozen=True, eq=False)
class LinearForm:
    """Sum terms[i] input i + const +- radius."""

    terms: dict[int, arb]
    const: arb
    radius: arb

    def plus(self, other: LinearForm, factor: arb) -> LinearForm:
        """With a multiple of another form."""
        terms = dict(self.terms)
        for i, x in other.terms.items():
            terms[i] = terms.get(i, ZERO) + factor * x
        radius = self.radius + abs(factor) * other.radius
        return LinearForm(terms, self.const + factor * other.const, radius)


NOTHING = LinearForm({}, ZERO, ZERO)


def linear_law(model: CaseModel, members: Sequence[int], claimed: ClaimedLaw) -> CommandLaw:
    """The law of a group; `RejectedError` where it is not linear within the limits."""
    facts = model.facts
    names = [c.name for c in facts.controls]
    if len(set(claimed.controls)) < len(claimed.controls) or not set(claimed.controls) <= set(
        names
    ):
        raise RejectedError("the law of a polytope group is of unknown controls")
    controls = tuple(names.index(c) for c in claimed.controls)
    terms, states = model.new_terms()
    commands = model.commands(terms, states)
    places = _places(model, terms, states)
    zs = [_z(row, offset, places) for row, offset in zip(claimed.gain, claimed.offset, strict=True)]
    low, high = ([exact(float(x)) for x in ends] for ends in (claimed.low, claimed.high))
    sweep = _Sweep(terms, _ranges(model, terms, states), zs, list(zip(low, high, strict=True)))
    sweep.run([*commands, *terms.obligations])
    for what in terms.obligations:
        if sweep.truth(what) != TRUE:
            raise RejectedError("SC is not certain to step within its sets where it is linear")
    own = {next(iter(states[i].terms)): k for k, i in enumerate(members)}
    gain, offset, spread = [], [], []
    for z, control in zip(zs, controls, strict=True):
        rest = sweep.size(sweep.form(commands[control]).plus(z, -ONE))
        if not rest.is_finite():
            raise RejectedError("SC's law is not linear between its limits")
        row, constant = [ZERO] * len(members), z.const
        for atom, factor in z.terms.items():
            if atom in own:
                row[own[atom]] = factor
                continue
            first, last = sweep.ranges[atom]
            constant += factor * (first + last) * HALF
            rest += abs(factor) * (last - first) * HALF
        gain.append(row)
        offset.append(constant)
        spread.append(rest)
    return CommandLaw(controls, gain, offset, spread, low, high)


def _places(model: CaseModel, terms: Terms, states: Sequence[Linear]) -> list[int | None]:
    """The atom of every input of the manifest, in its order; None where SC does not read it."""
    facts = model.facts
    boxes = {a.name: i for i, a in enumerate(terms.atoms) if a.kind == "box"}
    atoms: list[int | None] = [next(iter(x.terms)) for x in states]
    atoms += [None] * (len(facts.controls) + len(facts.disturbances))
    return atoms + [boxes.get(e.name) for e in (*facts.errors, *facts.others)]


def _ranges(model: CaseModel, terms: Terms, states: Sequence[Linear]) -> dict[int, tuple[arb, arb]]:
    """Every input over everything it may be: states within C or their grids."""
    range_by_atom = {i: (a.low, a.high) for i, a in enumerate(terms.atoms) if a.kind == "box"}
    for x, (low, high) in zip(states, model.extents, strict=True):
        range_by_atom[next(iter(x.terms))] = (exact(low), exact(high))
    return range_by_atom


def _z(row: Sequence[float], offset: float, places: Sequence[int | None]) -> LinearForm:
    terms = {}
    for factor, place in zip(row, places, strict=True):
        if float(factor) != 0.0:
            if place is None:
                raise RejectedError("the law of a polytope group has inputs that SC does not read")
            terms[place] = exact(float(factor))
    return LinearForm(terms, exact(float(offset)), ZERO)


class _Sweep:
    """Forms of all atoms, with every z in its limits."""

    def __init__(
        self,
        terms: Terms,
        ranges: Mapping[int, tuple[arb, arb]],
        zs: Sequence[LinearForm],
        limits: Sequence[tuple[arb, arb]],
    ) -> None:
        self.terms, self.ranges = terms, ranges
        self.forms: dict[int, LinearForm] = {}
        self.limited = []
        for z, (low, high) in zip(zs, limits, strict=True):
            moves = {i: magnitude(x * (ranges[i][1] - ranges[i][0])) for i, x in z.terms.items()}
            pivot = max(moves, key=lambda i: float(moves[i]), default=None)
            if pivot is not None:
                self.limited.append((z, pivot, low, high))

    def run(self, roots: Sequence[Linear | Proposition]) -> None:
        """Of every atom that matters."""
        for index in sorted(closure(self.terms, roots)):
            self.forms[index] = self._atom(index, self.terms.atoms[index])

    # ------------------------------------------------------------ bounds

    def _over_box(self, f: LinearForm) -> tuple[arb, arb]:
        low, high = f.const - f.radius, f.const + f.radius
        for i, x in f.terms.items():
            a, b = self.ranges[i]
            centre, radius = x * (a + b) * HALF, abs(x) * (b - a) * HALF
            low, high = low + centre - radius, high + centre + radius
        return arb(low.lower()), arb(high.upper())

    def bounds(self, f: LinearForm) -> tuple[arb, arb]:
        """The least and the greatest value."""
        low, high = self._over_box(f)
        rest, first, last = f, ZERO, ZERO
        for z, pivot, least, most in self.limited:
            alpha = rest.terms.get(pivot, ZERO) / z.terms[pivot]
            rest = rest.plus(z, -alpha)
            ends = alpha * least, alpha * most
            first, last = first + ends[0].min(ends[1]), last + ends[0].max(ends[1])
            a, b = self._over_box(rest)
            low, high = low.max(arb((a + first).lower())), high.min(arb((b + last).upper()))
        return low, high

    def size(self, f: LinearForm) -> arb:
        """No absolute value is larger."""
        low, high = self.bounds(f)
        return magnitude(low).max(magnitude(high))

    def form(self, x: Linear) -> LinearForm:
        """A linear form over inputs and atoms, over the inputs alone."""
        total = LinearForm({}, x.const, x.radius)
        for index, factor in x.terms.items():
            if index in self.ranges:
                total = total.plus(LinearForm({index: ONE}, ZERO, ZERO), factor)
            else:
                total = total.plus(self.forms[index], factor)
        return total

    def _known(self, x: Linear) -> tuple[arb, arb]:
        """Of a form, with what is known of it over its whole domain."""
        low, high = self.bounds(self.form(x))
        return low.max(arb(x.low.lower())), high.min(arb(x.high.upper()))

    # ------------------------------------------------------------ atoms

    def _atom(self, index: int, atom: Atom) -> LinearForm:
        if index in self.ranges:
            return LinearForm({index: ONE}, ZERO, ZERO)
        arguments = [self.form(x) for x in atom.arguments]
        if atom.kind in UNIVARIATE:
            low, high = self._known(atom.arguments[0])
            slope, offset, spread, _, _ = UNIVARIATE[atom.kind](low, high)
            linear_part = NOTHING.plus(arguments[0], slope)
            return LinearForm(
                linear_part.terms,
                linear_part.const + offset,
                linear_part.radius + spread + atom.extra,
            )
        if atom.kind == "product":
            return self._product(*arguments)
        if atom.kind in ("min", "max"):
            base, rest, _ = arguments
            return base.plus(rest, -ONE if atom.kind == "min" else ONE)
        if atom.kind == "choice":
            assert atom.condition is not None
            told = self.truth(atom.condition)
            if told != UNKNOWN:
                return arguments[0 if told == TRUE else 1]
            low, high = self._known(atom.arguments[2])
            first, last = low.min(ZERO), high.max(ZERO)  # b + (0 or a - b)
            linear_part = arguments[1]
            radius = linear_part.radius + (last - first) * HALF
            return LinearForm(linear_part.terms, linear_part.const + (first + last) * HALF, radius)
        if atom.kind == "spread":
            size = ZERO
            for w, x in zip(atom.weights, arguments, strict=True):
                size += w * self.size(x)
            return LinearForm({}, ZERO, size)
        if atom.kind == "table":
            return LinearForm({}, (atom.low + atom.high) * HALF, (atom.high - atom.low) * HALF)
        raise NotRecheckedError(f"`{atom.kind}` in the law of a polytope group")

    def _product(self, a: LinearForm, b: LinearForm) -> LinearForm:
        """Of centres: a b = a_c b + b_c a - a_c b_c + (a - a_c) (b - b_c)."""
        centres, radii = [], []
        for low, high in (self.bounds(a), self.bounds(b)):
            centres.append((low + high) * HALF)
            radii.append((high - low) * HALF)
        linear_part = NOTHING.plus(b, centres[0]).plus(a, centres[1])
        const = linear_part.const - centres[0] * centres[1]
        return LinearForm(linear_part.terms, const, linear_part.radius + radii[0] * radii[1])

    # ------------------------------------------------------------ propositions

    def truth(self, x: Proposition) -> int:
        """Bit 0: may be false, bit 1: may be true."""
        if x.kind == "constant":
            return TRUE if x.value else FALSE
        if x.kind == "below":
            assert x.argument is not None
            low, high = self._known(x.argument)
            if high < 0 or (not x.strict and high <= 0):
                return TRUE
            return FALSE if low > 0 or (x.strict and low >= 0) else UNKNOWN
        parts = [self.truth(p) for p in x.parts]
        if x.kind == "not":
            return (0, TRUE, FALSE, UNKNOWN)[parts[0]]
        may_be_false, may_be_true = ([bool(p & bit) for p in parts] for bit in (FALSE, TRUE))
        if x.kind == "and":
            return FALSE * any(may_be_false) + TRUE * all(may_be_true)
        if x.kind == "or":
            return FALSE * all(may_be_false) + TRUE * any(may_be_true)
        raise NotRecheckedError(f"`{x.kind}` in the law of a polytope group")
