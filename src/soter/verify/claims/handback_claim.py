"""Where the module above gives control back the state lies in R(H) (docs/proof.md, Towers).

Purpose: what stands in the place of `start` for a module below another one: the set part of a
hand-over, and an SC that faults on nothing it may read while it has no control.
Non-goals: H, which covers the way until SC's first output after a hand-back (`time/schedule.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.language.model.durations import show_ns
from soter.verify.claims.handover_claim import not_entered, reach_of
from soter.verify.claims.product_sets import law_within
from soter.verify.claims.results import ASSUMED, PROVED
from soter.verify.time.sc_on_default_inputs import fault_on_defaults

if TYPE_CHECKING:
    from soter.verify.claims.case import Case
    from soter.verify.claims.results import Finding
    from soter.verify.problem.problem import Problem

NARROWER = "a `safer` above that gives control back at fewer states, or a wider grid"
SETS = "declare the sets of what plants drive, and let SC answer all of them"


def handed_back(case: Case) -> None:
    """For every value of the parameters, as the module above may give control back at any time."""
    wrong_read = fault_on_defaults(case.problem)
    if wrong_read:
        hint = "let SC step only after what it reads was published: `phase`"
        case.fail("start", wrong_read, hint=hint)
        return
    why = not_entered(case)
    if why:
        text = f"{case.problem.above} gives control back outside R(H), or may: {why}"
        case.fail("start", text, hint=NARROWER)
        return
    box = np.array(case.forms.whole)
    box[: len(case.problem.states)] = reach_of(case.problem)
    why = law_within(case.problem, case.forms, box)
    if why:
        text = f"while {case.problem.above} is in SC, whatever is published: {why}"
        case.fail("start", text, hint=SETS)


def shown(problem: Problem) -> str:
    """What is proved, one sentence."""
    return (
        f"wherever {problem.above} may give control back the state lies in "
        f"R({show_ns(problem.times.horizon_ns)}); SC answers all that may be published before"
    )


def while_in_ac(problem: Problem, finding: Finding) -> None:
    """P2b of a module below another one is about times at which that one stays in AC."""
    if problem.above and finding.verdict == PROVED:
        text = f"{finding.text} while {problem.above} is in AC: not proved"
        finding.rest_on(ASSUMED, text)


def notes(problem: Problem) -> list[str]:
    """Of a module above another one what is assumed of that one: next to nothing."""
    text = "{} stands in the place of AC: nothing is assumed of it, its controllers and its DM, "
    text += "but that what they publish lies in the declared sets, which each step checks"
    return [text.format(name) for name in problem.below[:1]]
