"""What a re-check would not know, asked before anybody asks for one.

Purpose: `beyond`: why a certificate that is just being made would be *not re-checked*: its problem
is read as for a re-check, and of the claims everything is made ready, but only a few cells are
looked at. `soter verify` says so in its headline (decision 278).
Non-goals: checking: that nothing stands in the way says nothing of any claim.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.certificate.case_check import CaseCheck, narrowed
from soter.certificate.format.claimed_parts import OF_SETS
from soter.certificate.format.errors import RejectedError
from soter.certificate.format.folder import Certificate
from soter.certificate.proof_methods import MODULES
from soter.certificate.reading.case_model import CaseModel
from soter.certificate.reading.module_facts import bounded_topics
from soter.certificate.rechecker import facts_of, in_words, read_claimed
from soter.diagnostics.current_phase import telling
from soter.diagnostics.diagnostic import SoterError

if TYPE_CHECKING:
    from soter.certificate.reading.module_facts import Facts
    from soter.language.model.system import System


def beyond(flat: System, entry: dict[str, Any], files: dict[str, bytes]) -> str:
    """Why a module would not be re-checked; "": nothing stands in the way.

    `flat`: the system that has it, as it is proved; `entry`: the module in the manifest; `files`:
    those that it names.
    """
    try:
        whole = [of for key, of in MODULES.items() if key in entry]
        if whole:
            whole[0].read(flat, entry)
        else:
            _over_sets(flat, entry, Certificate(Path(), {}, files, set()))
    except (RejectedError, SoterError) as error:
        return f"the re-checker finds something else: {error}"
    except Exception as error:  # noqa: BLE001 - as a re-check does
        return in_words(error)
    return ""


def _over_sets(flat: System, entry: dict[str, Any], certificate: Certificate) -> None:
    facts = facts_of(flat, entry)
    claimed, values = read_claimed(certificate, facts, entry), list(facts.cases())
    for k in sorted({0, len(values) - 1}):  # the first and the last
        groups = claimed.groups[k]
        ranges = narrowed(facts.extents, [g.part(errors=False) for g in groups])
        model = CaseModel(facts, values[k], ranges)
        case = CaseCheck(model, groups, set(), entry, 1)
        with telling(None):
            case.check()
        _predicates(model)
        for check in case.checks if claimed.claims & OF_SETS else ():
            check.tried(claimed.claims)


def _predicates(model: CaseModel) -> None:
    """Everything that is asked of estimates or states is read."""
    facts: Facts = model.facts
    symbol = facts.symbol
    for expr in (symbol.safe, facts.ttf, symbol.safer):
        if expr is not None:
            terms, states = model.new_terms()
            model.predicate(terms, states, expr, errors=True)
    for topic in bounded_topics(facts):
        terms, states = model.new_terms()
        model.in_set(terms, states, topic)
