"""The half-spaces that a DM with computed predicates holds, against the sets that were shown.

Purpose: whatever estimate the DM's comparisons let through lies in S_0 (S_(m-2)) of every case; and
from which real half-spaces on it surely gives control back, which is what P2b may count on.
Non-goals: the sets themselves (`case_check.py`), tables of grids (`dm_tables.py`).

The DM compares the estimate with a box and then, for every half-space, the computed r x with a
threshold. A sum of n products, in any order, is off by at most n u / (1 - n u) sum |r_i| |x_i| and
what underflows (u = 2^-53): so r x <= threshold + err wherever it passes, and it passes wherever
r x <= threshold - err, err taken over the box.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.certificate.format.errors import RejectedError
from soter.certificate.polytope.certificate_tables import read_half_spaces
from soter.certificate.terms.arb_balls import TINIEST, UNIT_ROUNDOFF, ZERO, exact

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from flint import arb

    from soter.certificate.format.folder import Certificate
    from soter.certificate.polytope.certificate_tables import HalfSpaces, PolytopeTables
    from soter.certificate.reading.problem import Facts

    Rows = dict[tuple[float, ...], arb]


def compare_half_spaces(
    certificate: Certificate,
    facts: Facts,
    cases: Sequence[Sequence[PolytopeTables]],
    entries: Sequence[dict[str, Any]],
) -> None:
    """`RejectedError` where a DM would let AC keep or get control otherwise than by the sets."""
    if len(entries) != len(cases[0]):
        raise RejectedError("the half-spaces of the DM are not one set for each polytope group")
    for k, entry in enumerate(entries):
        same = [case[k] for case in cases]
        names = [facts.states[i].name for i in same[0].states]
        if entry.keys() != {"states", "outer", "inner"} or entry["states"] != names:
            raise RejectedError("half-spaces of the DM are not as they should be")
        n = len(names)
        outer, inner = (read_half_spaces(certificate, entry[p], n) for p in ("outer", "inner"))
        for group in same:
            if group.states != same[0].states or not group.levels:
                raise RejectedError("the cases have other polytopes, and the DM has one for all")
            _only(outer, group.levels[0], [outer])
            _only(inner, group.levels[-1], [outer, inner])
            group.leaves, group.gives_back = _surely([outer]), _surely([outer, inner])


def _error(row: Sequence[float], box: HalfSpaces) -> arb:
    """How far a computed product may be off on the box."""
    n, size = len(row), ZERO
    for r, low, high in zip(row, box.low, box.high, strict=True):
        size += abs(exact(r)) * max((abs(exact(low)), abs(exact(high))), key=float)
    share = n * UNIT_ROUNDOFF / (1 - n * UNIT_ROUNDOFF)
    return share * size + 2 * n * TINIEST


def _least(parts: Iterable[tuple[tuple[float, ...], arb]]) -> Rows:
    """Per row the smallest limit."""
    limit_by_row: Rows = {}
    for row, limit in parts:
        known = limit_by_row.get(row)
        if known is None or limit < known:
            limit_by_row[row] = limit
    return limit_by_row


def _only(box: HalfSpaces, claimed: HalfSpaces, held: Sequence[HalfSpaces]) -> None:
    """What passes every comparison in `held` lies in the claimed set; `box` is passed, too."""
    if not box.boxed_in(claimed):
        raise RejectedError("the DM's box is larger than that of its set")
    passed = _least(
        (row, exact(limit) + _error(row, p))
        for p in held
        for row, limit in zip(p.rows, p.bounds, strict=True)
    )
    for row, bound in zip(claimed.rows, claimed.bounds, strict=True):
        if row not in passed or not passed[row] <= exact(bound):
            raise RejectedError("the DM does not hold the half-spaces of its sets")


def _surely(held: Sequence[HalfSpaces]) -> list[tuple[tuple[float, ...], arb]]:
    """Half-spaces of real estimates in all of which the DM gives control back."""
    half_spaces = []
    for p in held:
        count = len(p.rows)
        faces, limits = p.faces
        for k, (row, limit) in enumerate(zip(faces, limits, strict=True)):
            # the box is compared as it is; what is outside it is not let through
            half_spaces.append((row, exact(limit) - (_error(row, p) if k < count else ZERO)))
    return half_spaces


def returned(tables: PolytopeTables, errors: Sequence[arb]) -> None:
    """Every estimate of a state in the target lies where the DM surely gives control back.

    RejectedError where that is not certain.
    """
    assert tables.target is not None
    if tables.gives_back is None:
        raise RejectedError("a claim needs the half-spaces of the DM, which are not there")
    faces, limits = tables.target.faces
    known = _least(zip(faces, (exact(x) for x in limits), strict=True))
    for row, limit in tables.gives_back:
        off = sum((abs(exact(a)) * e for a, e in zip(row, errors, strict=True)), ZERO)
        if row not in known or not known[row] + off <= limit:
            raise RejectedError("the DM is not certain to give control back where P2b returns to")
