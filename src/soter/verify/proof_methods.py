"""The methods of proof, in one table.

Purpose: which `Method` proves the groups of which kind; groups, and what a DM holds of them, in the
order of that table.
Non-goals: what a method is asked (`claims/case.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.verify.grid.claims import Grids
from soter.verify.polytope.claims import Polytopes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.verify.claims.case import Case, GroupProof, Method
    from soter.verify.claims.results import CaseSets
    from soter.verify.problem.problem import Group, Problem
    from soter.verify.tables.level_table import LevelTable

    Pairs = list[object]

METHODS: dict[str, Method] = {m.kind: m for m in (Grids(), Polytopes())}


def method_of(group: Group) -> Method:
    """The method that proves a group."""
    return METHODS[group.representation]


def in_order(groups: Sequence[Group]) -> list[Group]:
    """Groups in the order of the methods."""
    order = list(METHODS)
    return sorted(groups, key=lambda g: order.index(g.representation))


def by_method(case: Case) -> Iterator[tuple[Method, list[GroupProof]]]:
    """Each method that a case has groups for, with its proofs."""
    for method in METHODS.values():
        proofs = [p for p in case.proofs if method_of(p.group) is method]
        if proofs:
            yield method, proofs


def pairs_of(case: CaseSets) -> Pairs:
    """(S_0, S_(m-2)) of the groups of a case that have them."""
    return [p.pair for p in case.proofs if p.pair is not None]


def tables(problem: Problem, cases: Sequence[Pairs]) -> list[LevelTable]:
    """A table for each group, in order, from its pair in every case: what holds in all of them."""
    every = zip(in_order(problem.groups), zip(*cases, strict=True), strict=True)
    return [method_of(g).table(problem, g, pairs) for g, pairs in every]
