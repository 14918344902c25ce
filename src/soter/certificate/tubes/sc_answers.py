"""Whether SC answers all that it may read, checked again (condition 3 of "Decisions by tubes").

Purpose: `show_answers` evaluates one step of SC over everything that its topics and its variables
may hold.
Non-goals: what SC leads to (`rest_claims.py`, `tube_chains.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.extras.left_out_states import THIRD
from soter.certificate.extras.sc_locals_and_modes import combinations_of_locals
from soter.certificate.reading.case_model import command_term, sc_step_reader
from soter.certificate.reading.module_facts import topics_read_by_sc
from soter.certificate.reading.symbolic_values import value_of_leaves
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.compile_terms import all_certain
from soter.certificate.terms.linear_enclosures import exact
from soter.certificate.terms.terms import Terms
from soter.certificate.tubes.rest_problem import LARGEST, states_shown
from soter.language.model.types import FloatType, leaves

if TYPE_CHECKING:
    from soter.certificate.tubes.rest_problem import RestProblem


def show_answers(problem: RestProblem) -> None:
    """Shows that SC faults on no values that its topics may hold, and answers within its sets.

    The locals of SC may have any value in their ranges, and must stay there; a leaf without a set
    is at most `LARGEST`. Raises NotRecheckedError if this is not shown, or if SC reads non-floats.
    """
    facts, terms, known = problem.facts, Terms(), {}
    shown = states_shown(facts)
    for symbol in topics_read_by_sc(facts.sc):
        index = facts.sc.scope.topics[symbol]
        topic, parts = facts.system.topics[index], []
        for k, ((_, of), b) in enumerate(zip(leaves(topic.type), topic.bounds, strict=True)):
            if not isinstance(of, FloatType):
                raise NotRecheckedError(f"SC reads what is no float of `{topic.name}`")
            s = shown.get((index, k), -1)
            most = 3 * THIRD + problem.max_error(s) if s in facts.turning else LARGEST
            ends = (-most, most) if b is None else (b.low, b.high)
            parts.append(terms.add_input("box", topic.name, *map(exact, ends)))
        known[symbol] = value_of_leaves(topic.type, parts)
    assert facts.sc.node is not None
    step = sc_step_reader(terms, facts.sc, known, {}, facts.local_ranges)
    for values_of_locals in combinations_of_locals(terms, facts.sc.node.locals, facts.local_ranges):
        published = step(values_of_locals)
        for control in facts.controls:
            command_term(terms, control, [published])
    if not all_certain(terms, terms.obligations):
        raise NotRecheckedError(
            "P2a: SC may fault on something that it may read, or answer outside of its sets, or"
            " keep a number outside of its range"
        )
