"""A polytope group as numbers: x' = A x + B u + drift, the linear part of SC's law, errors, times.

Purpose: `linear_group` reads a `LinearGroup` off the enclosures of a problem. Whatever is not
linear, the influence of other groups and the error of the simulator's scheme count as drift, or as
remainder of the law; a bad choice of matrices gives useless sets, never wrong ones.
Non-goals: sets (`proofs.py`), C (`claims.py`).

How it is done. A form says that a value lies in c + sum g_i eps_i + [-r, r] for inputs x_i = m_i +
r_i eps_i. With a_i = fl(g_i / r_i) it lies in sum a_i x_i + [low, high]; these two are computed in
rationals and rounded outward. The law is clamped, hence linear only between two values of z = K y +
k: K is taken from a small box near rest, and the law is then enclosed over all inputs with z
between the two values, by letting z itself be an input in place of one of the others: what the law
gives beyond z is the remainder. Clamps within it (a cascade) are clear of their ends in a box about
rest only: where the law is not linear over all ranges, C becomes smaller, a box in which it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from soter.verify.enclose.compiled_enclosures import FORM, affine_inputs
from soter.verify.enclose.scheme_error import (
    LINEAR,
    STIFF_HINT,
    SchemeSolution,
    SimulatedFlow,
    scheme_solution,
)
from soter.verify.grid.group_model import OUTSET
from soter.verify.polytope.linear_group import LinearGroup
from soter.verify.polytope.matrices import inverse_of, pivots_of
from soter.verify.problem.inputs import errors_of
from soter.verify.problem.verification_system import sc_reads

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.core.layout import Floats
    from soter.verify.enclose.compiled_enclosures import CompiledEnclosures
    from soter.verify.problem.problem import Group, Problem

    Ranges = Sequence[tuple[float, float]]
    Given = tuple[Floats, Floats, Floats, Floats, Sequence[int]]
    """Gain, offset, value at rest and bounds of commands, and which commands."""

F = Fraction
NEAR = 2.0**-12
"""How small the box near rest is, relative to the ranges, from which the gain is taken."""
SMALL = 1e-6
"""A share of U: where the law's remainder is larger, it counts as clamped."""
HALVINGS = 40
BOX_HALVINGS = 9
"""How many bisections find a box in which the law is linear, along each axis."""


class NotLinearError(Exception):
    """A group has no linear model; the text says why, `hint` what would help."""

    def __init__(self, text: str, hint: str) -> None:
        super().__init__(text)
        self.hint = hint


@dataclass(frozen=True, eq=False)
class ExtractedGroup:
    """The linear group, and whether one step of the simulator's scheme is a solution of it.

    `law` and the controls that move the group are what a certificate says of SC.
    """

    group: LinearGroup
    covers_scheme: bool
    law: AffineLaw
    commands: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class AffineLaw:
    """SC's law: u = gain xi + offset up to `remainder` where that is in [low, high]; xi: inputs."""

    gain: Floats
    offset: Floats
    remainder: Floats
    low: Floats
    high: Floats


def linear_group(
    problem: Problem, forms: CompiledEnclosures, group: Group, limits: Ranges
) -> ExtractedGroup:
    """The group with C inside the box `limits` of its states; `NotLinearError` where it is none."""
    _supported(problem, group)
    own = [a.state for a in group.axes]
    n, m = len(problem.states), len(problem.controls)
    domain = forms.whole.copy()
    margin = (domain[:n, 1] - domain[:n, 0]) * OUTSET
    domain[:n, 0] -= margin
    domain[:n, 1] += margin
    rates = forms.affine("derivative", affine_inputs(domain, len(domain)), n)
    if rates is None:
        raise NotLinearError("the plants may fault in the group's ranges", "smaller ranges")
    commands = [a for a in range(m) if np.any(rates[own, FORM + n + a] != 0.0)]
    if not commands:
        raise NotLinearError("no command moves this group", "a `grid`")
    moving = [*own, *(n + a for a in commands)]
    parts = [affine_parts(rates[s], domain, moving) for s in own]
    matrix = np.array([p[0] for p in parts])
    drift = np.array([(p[1], p[2]) for p in parts])
    by_scheme = _scheme_solution(problem, forms, domain, own)
    if by_scheme.stiff:
        raise NotLinearError(by_scheme.stiff, STIFF_HINT)
    extra = by_scheme.error
    if extra is not None:
        drift[:, 0] = np.nextafter(drift[:, 0] - extra, -np.inf)
        drift[:, 1] = np.nextafter(drift[:, 1] + extra, np.inf)
    law, linear = _linear_law(problem, forms, domain, commands, own)
    error = np.array([errors_of(problem).get(s, 0.0) for s in own])
    offset, remainder = _law_on_estimates(problem, law, domain, own, error)
    k, times = len(own), problem.times
    bounds = np.array([(problem.controls[a].low, problem.controls[a].high) for a in commands])
    low, high = np.array(limits, dtype=np.float64).T
    if linear is not domain:
        low, high = np.maximum(low, linear[own, 0]), np.minimum(high, linear[own, 1])
    return ExtractedGroup(
        LinearGroup(
            state=matrix[:, :k],
            control=matrix[:, k:],
            drift_low=drift[:, 0],
            drift_high=drift[:, 1],
            control_low=bounds[:, 0],
            control_high=bounds[:, 1],
            error=error,
            gain=law.gain[:, own],
            offset=offset,
            remainder=remainder,
            law_low=law.low,
            law_high=law.high,
            low=low,
            high=high,
            rows=np.zeros((0, k)),
            bounds=np.zeros(0),
            delta_ns=times.delta_sc,
            jitter_ns=times.jitter_sc,
            delay_ns=times.delay_sc,
        ),
        extra is not None,
        law,
        tuple(commands),
    )


def _supported(problem: Problem, group: Group) -> None:
    """`NotLinearError` where the problem does not fulfil what the proofs presuppose."""
    times = problem.times
    if problem.kind != "flow":
        raise NotLinearError("`polytope` groups are flows, and this plant is a map", "a `grid`")
    if 2 * times.jitter_sc > times.delta_sc:
        raise NotLinearError(
            "SC acts later than half its period", "less lateness, or a longer period of SC"
        )
    if not all(np.isfinite(a.edges).all() for a in group.axes):
        raise NotLinearError("an axis has no range", "`polytope a in [low, high];`")
    if times.delay_sc > 0 and len(_topics_with_states(problem, group)) > 1:
        raise NotLinearError(
            "SC sees the states of this group in several topics, of different ages",
            "one topic with all of them",
        )


def _topics_with_states(problem: Problem, group: Group) -> set[int]:
    """The topics that plants drive and SC reads, but for those that only show other groups."""
    own = {a.state for a in group.axes}
    sc = problem.system.components[problem.module.sc]
    assert sc.node is not None
    driven = {
        c.scope.topics[topic]
        for c in problem.system.components
        if c.plant is not None
        for topic, _ in c.plant.drives
    }
    shown: dict[int, list[int]] = {}
    for s, (topic, _) in problem.topic_leaf_of_state.items():
        shown.setdefault(topic, []).append(s)
    topics = set()
    for symbol in sc_reads(sc.node):
        topic = sc.scope.topics[symbol]
        states = shown.get(topic, [])
        foreign = len(states) == len(problem.system.topics[topic].bounds) and not own & set(states)
        if topic in driven and not foreign:
            topics.add(topic)
    return topics


# ---------------------------------------------------------------- forms


def _centred(box: Floats) -> tuple[Floats, Floats]:
    middle = box[:, 0] / 2 + box[:, 1] / 2
    radius = np.nextafter(np.maximum(box[:, 1] - middle, middle - box[:, 0]), np.inf)
    point = box[:, 0] == box[:, 1]
    return np.where(point, box[:, 0], middle), np.where(point, 0.0, radius)


def affine_parts(form: Floats, box: Floats, chosen: Sequence[int]) -> tuple[Floats, float, float]:
    """(a, low, high): a form's value lies in sum a_i x_i + [low, high] over the chosen inputs.

    `form` (4 + inputs,), `box` (inputs, 2), a (chosen,).
    """
    middle, radius = _centred(box)
    g = form[FORM : FORM + len(box)]
    tiny = LINEAR * float(np.abs(g).sum())
    a = np.array([g[i] / radius[i] if radius[i] > 0 and abs(g[i]) > tiny else 0.0 for i in chosen])
    centre, spread = F(form[2]), F(form[3])
    spread += sum(abs(F(g[i])) for i in range(len(box)) if i not in set(chosen))
    for i, slope in zip(chosen, a, strict=True):
        centre -= F(slope) * F(middle[i])
        spread += abs(F(g[i]) - F(slope) * F(radius[i]))
    return a, rounded_down(centre - spread), rounded_up(centre + spread)


def rounded_down(x: Fraction) -> float:
    """A double that is at most x."""
    double = float(x)
    return double if F(double) <= x else float(np.nextafter(double, -np.inf))


def rounded_up(x: Fraction) -> float:
    """A double that is at least x."""
    return -rounded_down(-x)


def _scheme_solution(
    problem: Problem, forms: CompiledEnclosures, domain: Floats, own: Sequence[int]
) -> SchemeSolution:
    """Whether the simulator's steps solve the model of the group's states, by how much more."""
    n = len(problem.states)

    def rates(low: Floats, high: Floats) -> tuple[Floats, Floats] | None:
        given = affine_inputs(np.stack([low, high], axis=1), len(domain))
        derivatives = forms.affine("derivative", given, n)
        return None if derivatives is None else (derivatives, np.diag(given[:, FORM:]))

    names = tuple(s.name for s in problem.quantities.states)
    stepped = SimulatedFlow(rates, names, problem.schemes, len(problem.controls))
    return scheme_solution(stepped, domain[:, 0], domain[:, 1], own)


# ---------------------------------------------------------------- the law


def _linear_law(
    problem: Problem,
    forms: CompiledEnclosures,
    domain: Floats,
    commands: Sequence[int],
    own: Sequence[int],
) -> tuple[AffineLaw, Floats]:
    """The linear part of SC's law, and the box of inputs over which it is that.

    The box is `domain` itself, or smaller in the group's `own` states.
    """
    every = len(problem.controls)
    chosen = list(range(len(domain)))
    bounds = np.array([(problem.controls[a].low, problem.controls[a].high) for a in commands])
    width = bounds[:, 1] - bounds[:, 0]
    for point in rest_points(problem, domain):
        near = _box_near(domain, point)
        affine_law = forms.affine("law", affine_inputs(near, len(domain)), every)
        if affine_law is None:
            continue
        parts = [affine_parts(affine_law[a], near, chosen) for a in commands]
        gain = np.array([p[0] for p in parts])
        offset = np.array([p[1] / 2 + p[2] / 2 for p in parts])
        spread = np.array([p[2] - p[1] for p in parts])
        if not np.all(spread <= SMALL * width):
            continue
        rest = np.clip(gain @ point + offset, bounds[:, 0], bounds[:, 1])

        given = gain, offset, rest, bounds, commands
        law = _law_within_limits(forms, domain, *given, closer=True)
        if law is not None:
            return law, domain
        box = _where_linear(forms, domain, near, own, given)
        law = _law_within_limits(forms, box, *given, closer=False)
        if law is not None:
            return law, box
    raise NotLinearError(
        "SC's law is not linear near rest",
        "a law that is linear there, at most clamped; or a `grid`",
    )


def rest_points(problem: Problem, domain: Floats) -> list[Floats]:
    """Points, (inputs,) each, near which SC may be linear: the start, zero, the middle.

    `domain`: the ranges of the inputs, (inputs, 2).
    """
    middle = domain[:, 0] / 2 + domain[:, 1] / 2
    start = middle.copy()
    start[: len(problem.initial)] = [i.low / 2 + i.high / 2 for i in problem.initial]
    return [np.clip(p, domain[:, 0], domain[:, 1]) for p in (start, np.zeros_like(middle), middle)]


def _box_near(domain: Floats, point: Floats) -> Floats:
    reach = (domain[:, 1] - domain[:, 0]) * NEAR
    low, high = np.maximum(domain[:, 0], point - reach), np.minimum(domain[:, 1], point + reach)
    return np.stack([low, high], axis=1)


def _where_linear(
    forms: CompiledEnclosures, domain: Floats, near: Floats, own: Sequence[int], given: Given
) -> Floats:
    """A large box (inputs, 2) between `near` and `domain` on which the law is linear.

    It grows in the states `own`: first in the proportions of the ranges, then axis by axis.
    """
    box: Floats = domain.copy()
    box[own] = near[own]
    ends = [(s, side) for s in own for side in range(2)]
    for some in ([*ends], *([end] for end in ends)):
        at = tuple(np.array(some).T)
        least, most = box[at], domain[at]
        good, bad = 0.0, 1.0
        for share in (1.0, *([None] * BOX_HALVINGS)):
            middle = good / 2 + bad / 2 if share is None else share
            tried = box.copy()
            tried[at] = least + middle * (most - least)
            fine = _law_within_limits(forms, tried, *given, closer=False) is not None
            good, bad = (middle, bad) if fine else (good, middle)
            if good == 1.0:
                break
        box[at] = least + good * (most - least)
    return box


def _law_within_limits(
    forms: CompiledEnclosures,
    domain: Floats,
    gain: Floats,
    offset: Floats,
    rest: Floats,
    bounds: Floats,
    commands: Sequence[int],
    *,
    closer: bool,
) -> AffineLaw | None:
    """The law with the widest limits, as a share of U around `rest`, and a small remainder.

    Without `closer` only limits that are U, or nearly, are tried.
    """
    width = bounds[:, 1] - bounds[:, 0]

    def tried(share: float) -> AffineLaw | None:
        low = rest - share * (rest - bounds[:, 0])
        high = rest + share * (bounds[:, 1] - rest)
        if not np.all(low < high):
            return None
        rem = remainder_of(forms, domain, gain, offset, low, high, commands)
        fine = rem is not None and np.all(rem <= SMALL * width)
        return AffineLaw(gain, offset, rem, low, high) if fine and rem is not None else None

    best = tried(1.0) or tried(1.0 - 2.0**-20)
    if best is not None or not closer:
        return best
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        share = low / 2 + high / 2
        law = tried(share)
        best, low, high = (law, share, high) if law is not None else (best, low, share)
    return best


def _rounded(centre: F, parts: Sequence[F]) -> tuple[float, float, list[float]]:
    """A form in doubles: its middle, a bound of the rounding, its coefficients."""
    rounded = [float(x) for x in parts]
    loss = abs(centre - F(float(centre)))
    loss += sum(abs(x - F(y)) for x, y in zip(parts, rounded, strict=True))
    return float(centre), rounded_up(loss), rounded


def remainder_of(
    forms: CompiledEnclosures,
    domain: Floats,
    gain: Floats,
    offset: Floats,
    low: Floats,
    high: Floats,
    commands: Sequence[int],
) -> Floats | None:
    """Bounds (m,) of |law - z| while every z = gain xi + offset lies in [low, high].

    For each independent row one input is replaced: xi_P = M (z - offset - gain_N xi_N), in
    rationals. None where SC may fault there.
    """
    count = forms.library.inputs
    given = affine_inputs(domain, len(domain))
    middle, radius = _centred(domain)
    z_mid, z_rad = _centred(np.stack([low, high], axis=1))
    rows, pivots = pivots_of(gain, radius)
    inverse = inverse_of([[F(gain[a, p]) for p in pivots] for a in rows])
    free = [i for i in range(len(domain)) if i not in pivots]
    for i, p in enumerate(pivots):
        exact = [F(0)] * len(domain)
        centre = F(0)
        for weight, a in zip(inverse[i], rows, strict=True):
            known = sum((F(gain[a, f]) * F(middle[f]) for f in free), F(0))
            centre += weight * (F(z_mid[a]) - F(offset[a]) - known)
            exact[pivots[rows.index(a)]] += weight * F(z_rad[a])
            for f in free:
                exact[f] -= weight * F(gain[a, f]) * F(radius[f])
        given[p, 2], given[p, 3], given[p, FORM:] = _rounded(centre, exact)
    affine_law = forms.affine("law", given, max(commands) + 1)
    if affine_law is None:
        return None
    result = []
    for k, a in enumerate(commands):
        g = [F(x) for x in affine_law[a, FORM : FORM + count]]
        centre = F(affine_law[a, 2])
        if k in rows:
            g[pivots[rows.index(k)]] -= F(z_rad[k])
            gap = abs(centre - F(z_mid[k]))
        else:  # z follows from the others, or is constant: compare with it as it is
            gap, g = _difference_from_row(gain[k], offset[k], given, centre, g)
        result.append(rounded_up(gap + sum((abs(x) for x in g), F(0)) + F(affine_law[a, 3])))
    return np.array(result)


def _difference_from_row(
    row: Floats, offset: float, given: Floats, centre: Fraction, g: list[Fraction]
) -> tuple[Fraction, list[Fraction]]:
    """The form (centre, g) minus that of row xi + offset over the forms `given`."""
    gap, rest = centre - F(offset), list(g)
    slack = F(0)
    for weight, form in zip(row, given, strict=True):
        gap -= F(weight) * F(form[2])
        slack += abs(F(weight)) * F(form[3])
        for i, x in enumerate(form[FORM:]):
            rest[i] -= F(weight) * F(x)
    return abs(gap) + slack, rest


def _law_on_estimates(
    problem: Problem, law: AffineLaw, domain: Floats, own: Sequence[int], error: Floats
) -> tuple[Floats, Floats]:
    """(offset, remainder) of the law as a function of the group's estimates, all else at worst."""
    middle, radius = _centred(domain)
    first = len(problem.states) + len(problem.controls) + len(problem.disturbances)
    errors = range(first, first + len(problem.errors))
    offsets, remainders = [], []
    for row, constant, rest in zip(law.gain, law.offset, law.remainder, strict=True):
        exact, spread = F(constant), F(rest)
        for i, weight in enumerate(row):
            if i in own:
                continue
            exact += F(weight) * F(middle[i])
            if i not in errors:
                spread += abs(F(weight)) * F(radius[i])
        wrong = sum((abs(F(row[i])) * F(radius[i]) for i in errors), F(0))
        known = sum((abs(F(row[s])) * F(e) for s, e in zip(own, error, strict=True)), F(0))
        spread += max(F(0), wrong - known)
        offset = float(exact)
        offsets.append(offset)
        remainders.append(rounded_up(spread + abs(exact - F(offset))))
    return np.array(offsets), np.array(remainders)
