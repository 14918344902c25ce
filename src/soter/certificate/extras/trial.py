"""Says whether a certificate would be re-checked; `soter verify` asks while it makes one.

Purpose: `why_not_recheckable` says for the headline of `verify` why a module would be *not
re-checked* (decision 278): it reads the problem as a re-check does and makes ready what each claim
needs, but it looks only at a few cells.
Non-goals: verdicts: no re-check calls this.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from soter.certificate.case_check import CaseCheck, narrowed_extents
from soter.certificate.cell_sets import Cells
from soter.certificate.grid.group_claims import FREE_PIECES, PIECES, FreeCheck
from soter.certificate.proof_methods import MODULES
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.folder import FREE, OF_SETS, Certificate
from soter.certificate.reading.module_facts import bounded_topics
from soter.certificate.rechecker import read_claims, read_problem, reason_in_words
from soter.certificate.report import RejectedError
from soter.diagnostics.current_phase import shares_to
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from soter.certificate.grid.grid_group import GridCheck
    from soter.language.model.system import System

CELLS_TRIED, HOLDS_TRIED = 3, 2
"""From so many cells of K a trial follows SC, for so many holds: the first, a middle, the last."""


def why_not_recheckable(flat: System, entry: dict[str, Any], files: dict[str, bytes]) -> str:
    """Why a module could not be re-checked; "" if nothing prevents it.

    `flat`: the module's system, as it is proved; `entry`: the module in the manifest; `files`: the
    files that the entry names.
    """
    try:
        methods = [m for key, m in MODULES.items() if key in entry]
        if methods:
            methods[0]().read(flat, entry)
        else:
            _try_sets(flat, entry, Certificate(Path(), {}, files, set()))
    except (RejectedError, SoterError) as error:
        return f"the re-checker finds something else: {error}"
    except Exception as error:  # noqa: BLE001 - as a re-check does
        return reason_in_words(error)
    return ""


def _try_sets(flat: System, entry: dict[str, Any], certificate: Certificate) -> None:
    facts = read_problem(flat, entry)
    claimed, values = read_claims(certificate, facts, entry), list(facts.parameter_combinations())
    for k in sorted({0, len(values) - 1}):  # the first and the last
        groups = claimed.groups[k]
        ranges = narrowed_extents(facts.extents, [g.tables for g in groups])
        model = CaseModel(facts, values[k], ranges)
        case = CaseCheck(model, groups, set(), entry, 1)
        with shares_to(None):
            case.show_claims()
        for expr in filter(None, (facts.symbol.safe, facts.ttf, facts.symbol.safer)):
            terms, states = model.new_terms()
            model.truth_of(terms, states, expr, errors=True)
        for topic in bounded_topics(facts):
            terms, states = model.new_terms()
            model.topic_in_set(terms, states, topic)
        for check in case.checks if claimed.claims & OF_SETS else ():
            follow_few_cells(check, claimed.claims)


def follow_few_cells(check: GridCheck, claims: set[str]) -> None:
    """Follows SC, and any command, from a few cells of K, only to see whether it raises."""
    everywhere = Cells(check.grid, np.ones(check.grid.shape, dtype=np.bool_))
    free = FreeCheck(check.model, check.tables, check.model.facts.times["H_ns"])
    cells = np.argwhere(check.kernel.members)
    places = np.linspace(0, max(len(cells) - 1, 0), min(CELLS_TRIED, len(cells)))
    for cell in (tuple(map(int, cells[k])) for k in dict.fromkeys(map(int, places))):
        box = check.grid.box_of(tuple((i, i + 1) for i in cell))
        holds = min(int(check.tables.core[cell]), HOLDS_TRIED)
        check.chains.leads_to(box, holds, everywhere, everywhere.contains, PIECES[0])
        if claims & FREE:
            free.stays_in(box, everywhere, FREE_PIECES[0])
