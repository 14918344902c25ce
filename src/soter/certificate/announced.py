"""What a re-check would not know, asked before anybody asks for one.

Purpose: `beyond`: why a certificate that is just being made would be *not re-checked*: its problem
is read as for a re-check, and of the claims everything is made ready, but only a few cells are
looked at. `soter verify` says so in its headline (decision 278).
Non-goals: checking: that nothing stands in the way says nothing of any claim.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.allowed_claims import claimed_of, static_claims
from soter.certificate.case_check import CaseCheck
from soter.certificate.format.claimed_parts import FREE, OF_SETS
from soter.certificate.format.errors import RejectedError
from soter.certificate.format.folder import Certificate
from soter.certificate.inclusions.cell_sets import Cells
from soter.certificate.inclusions.dm_tables import compare_tables
from soter.certificate.inclusions.group_claims import FREE_PIECES, PIECES, ChainCheck, FreeCheck
from soter.certificate.inclusions.shield import cells_of
from soter.certificate.induction.check_claims import read_all
from soter.certificate.polytope.predicates_on_boxes import narrowed
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.failsafe_law import law_of
from soter.certificate.reading.module_facts import DiffersError, bounded_topics
from soter.certificate.reading.view_predicates import ttf_of_states
from soter.certificate.rechecker import compare, groups_of
from soter.certificate.report import GIVING_UP, in_words
from soter.certificate.understood import facts_of
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.certificate.inclusions.cell_sets import Block
    from soter.certificate.inclusions.group_claims import GroupTables
    from soter.certificate.reading.problem import Facts
    from soter.language.model.system import System

CELLS_TRIED = 3
"""Of K of a grid: the first, one in the middle, the last."""
HOLDS_TRIED = 2
"""For so many holds SC is followed from each of them."""
CASES_TRIED = 2
"""Of the combinations of the parameters' values: the first and the last."""


def beyond(flat: System, entry: dict[str, Any], files: dict[str, bytes]) -> str:
    """Why a module would not be re-checked; "": nothing stands in the way.

    `flat`: the system that has it, as it is proved; `entry`: the module in the manifest; `files`:
    those that it names.
    """
    try:
        if "induction" in entry:
            read_all(flat, entry)
        else:
            _over_sets(flat, entry, Certificate(Path(), {}, files, set()))
    except GIVING_UP as error:
        return in_words(error)
    except (RejectedError, DiffersError, SoterError) as error:
        return f"the re-checker finds something else: {error}"
    return ""


def _over_sets(flat: System, entry: dict[str, Any], certificate: Certificate) -> None:
    facts, claims = facts_of(flat, entry), claimed_of(entry["claims"])
    extents = compare(facts, entry)
    static_claims(facts, entry["claims"])
    values = list(facts.cases())
    tables = [groups_of(certificate, facts, extents, case["groups"]) for case in entry["cases"]]
    if facts.computed:
        grids = [of for of, _ in tables]
        compare_tables(certificate, facts, grids, entry["tables"][: len(grids[0])])
        if facts.symbol.shield is not None:
            cells_of(facts)
    for k in sorted({0, len(values) - 1})[:CASES_TRIED]:
        groups, polytopes = tables[k]
        model = CaseModel(facts, values[k], narrowed(extents, polytopes))
        case = CaseCheck(model, groups, set(), entry, lambda _: None, 1, polytopes)
        case.begin()
        _predicates(model)
        assert len(case.half_spaces) == len(polytopes)
        for group in groups if claims & OF_SETS else ():
            _grid(model, group, claims)
    if "failsafe" in claims:
        law_of(facts)


def _predicates(model: CaseModel) -> None:
    """Everything that is asked of estimates or states is read."""
    facts: Facts = model.facts
    symbol = facts.symbol
    for expr in (symbol.safe, ttf_of_states(symbol.ttf), symbol.safer):
        if expr is not None:
            terms, states = model.new_terms()
            model.predicate(terms, states, expr, errors=True)
    for topic in bounded_topics(facts):
        terms, states = model.new_terms()
        model.in_set(terms, states, topic)


def _grid(model: CaseModel, group: GroupTables, claims: set[str]) -> None:
    """SC, and any command, are followed from a few cells, wherever that leads."""
    grid = group.grid
    everywhere = Cells(grid, np.ones(grid.shape, dtype=np.bool_))
    chains = ChainCheck(model, group)
    free = FreeCheck(model, group, model.facts.times["H_ns"])
    for cell in _some(group):
        box = grid.box(cell)
        holds = min(int(group.core[tuple(a for a, _ in cell)]), HOLDS_TRIED)
        chains.leads(box, holds, everywhere, everywhere.contains, PIECES[0])
        if claims & FREE:
            free.stays(box, everywhere, FREE_PIECES[0])


def _some(group: GroupTables) -> Iterator[Block]:
    """A few cells of K."""
    cells = np.argwhere(group.core > 0)
    places = np.linspace(0, max(len(cells) - 1, 0), min(CELLS_TRIED, len(cells)))
    for k in dict.fromkeys(map(int, places)):
        yield tuple((int(i), int(i) + 1) for i in cells[k])
