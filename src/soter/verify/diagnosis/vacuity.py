"""Finds proofs that say little, as AC can never, or hardly ever, have control.

Purpose: `worst_vacuity` computes, for each group and combination of parameter values, the share of
K (the states that SC keeps) on which `ttf` and `safer` let AC have control. It puts the least share
into words for a headline if it is zero or tiny. *Never* is shown by enclosures, for every state.
*Hardly ever* is measured as a share of cells, or of states drawn from K.
Non-goals: verdicts: a proof about an empty set is a proof.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from soter.language.elaborate.passes.read_ages import fresh_ages_ns
from soter.language.evaluate.topic_ranges import reader_with_limits, truth_by_parts
from soter.language.model.tree_walk import nodes, topic_reads
from soter.language.model.typed import AgeRead
from soter.language.model.types import show_ns
from soter.verify.claims.product_sets import points_to_try
from soter.verify.claims.results import PROVED, Vacuity
from soter.verify.problem.inputs import errors_by_state

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.core.layout import Floats
    from soter.verify.claims.results import ModuleResult
    from soter.verify.grid.case import Case
    from soter.verify.grid.claims import GridProof
    from soter.verify.problem.problem import Problem


RARE_SHARE = 0.01
"""Below this share of a group's K (of C_g for K itself) a headline says so: decision 45."""
DRAWN = 2000
ENOUGH = 0.1
"""Drawing ends early if this share of at least `FEW` states lets AC have control."""
FEW = 100
ANCHORS_MAX = 4
LETS = {"ttf": 1, "safer": 2}
"""The bit of a predicate's truth which says that AC may have control."""
OF_NOTHING, EVERY_VALUE = "of nothing: ", "every parameter value"
NEVER, HARDLY_EVER, NOT_SHOWN = "never", "hardly ever", "not shown"
OF_FRESH = "of whatever is fresh"
HOLDS_ANYWAY = "`safe` holds of all values that its topics may have: it says nothing"


def worst_vacuity(done: Sequence[Case]) -> Vacuity | None:
    """The worst vacuity of all cases; None if no proof is vacuous, as AC can have control."""
    if done and (nothing := _vacuous_safe(done[0].problem)):
        return nothing
    every = [(case, case_vacuity) for case in done for case_vacuity in _vacuities_of_case(case)]
    if not every:
        return _vacuity_without_return(done)
    worst = min((v for _, v in every), key=lambda v: (v.how_often != NEVER, v.share))
    if len(done) == 1:
        return worst
    bad = {id(case) for case, _ in every}
    case = next(c for c, v in every if v is worst)
    named = _parameter_values(case) if len(bad) < len(done) else EVERY_VALUE
    also = f" and {len(bad) - 1} more of {len(done)}" if 1 < len(bad) < len(done) else ""
    return Vacuity(
        worst.how_often,
        worst.what,
        worst.share,
        f"with {named}{also} {worst.text}",
        tuple(zip((p.name for p in case.problem.parameters), case.parameter, strict=True)),
    )


def vacuity_of_nodes(problem: Problem, never: str) -> Vacuity | None:
    """The vacuity of a proof by induction, or None; `never`: the field of `Induction`."""
    if nothing := _vacuous_safe(problem):
        return nothing
    if never == "fails":
        return Vacuity(NEVER, "safe", 0.0, HOLDS_ANYWAY)
    if never == "gets":
        text = "AC never has control (at no decision does `safer` hold of what is fresh)"
        return Vacuity(NEVER, "safer", 0.0, text)
    if never == "keeps":
        span = show_ns(problem.times.delta_dm)
        text = f"AC never keeps control (`ttf` holds at every decision: {span} at a time at most)"
        return Vacuity(NEVER, "ttf", 0.0, text)
    return None


def vacuity_of_rest(problem: Problem, at_the_start: str) -> Vacuity | None:
    """The vacuity of a proof by tubes; `at_the_start` says why AC starts without control, or ""."""
    text = f"nothing says that AC ever gets control ({at_the_start}, and P2b is not shown)"
    never = Vacuity(NOT_SHOWN, "safer", 0.0, text) if at_the_start else None
    return _vacuous_safe(problem) or never


def mention_vacuity_in_claim(result: ModuleResult) -> None:
    """Changes the text of a claim that is proved, but about nothing, so that it says so."""
    vacuity, rows = result.vacuity, {"safe": "P2a", "ttf": "ttf", "safer": "safer"}
    if vacuity is None or vacuity.how_often != NEVER or vacuity.what not in rows:
        return
    finding = result.findings[rows[vacuity.what]]
    if finding.verdict == PROVED and (not vacuity.parameters or EVERY_VALUE in vacuity.text):
        finding.text = f"{OF_NOTHING}{vacuity.text}"


def _vacuous_safe(problem: Problem) -> Vacuity | None:
    safe = problem.module.symbol.safe
    if not topic_reads(safe):
        return Vacuity(NEVER, "safe", 0.0, "`safe` reads no topic: it says nothing of the plant")
    if truth_by_parts(safe, problem.system, problem.module.scope):
        return Vacuity(NEVER, "safe", 0.0, HOLDS_ANYWAY)
    return None


def _parameter_values(case: Case) -> str:
    pairs = zip(case.problem.parameters, case.parameter, strict=True)
    return ", ".join(f"{p.name} = {value}" for p, value in pairs)


def _vacuities_of_case(case: Case) -> Iterator[Vacuity]:
    """The vacuities found in one case; none if K is empty."""
    if case.failures_of("P2a"):
        return
    yield from _vacuities_of_small_core(case)
    free = _least_free_share(case)
    for predicate in ("safer", "ttf"):
        if predicate == "ttf" and _is_ttf_true_on_core(case):
            yield Vacuity(NEVER, "ttf", 0.0, _why_no_control(case, "ttf", empty=False, of=OF_FRESH))
            continue
        if _never_lets_control(case, predicate):
            yield Vacuity(
                NEVER, predicate, 0.0, _why_no_control(case, predicate, empty=free == 0.0)
            )
            continue
        least_share = min(_control_shares(case, predicate), default=1.0)
        if least_share < RARE_SHARE:
            yield Vacuity(HARDLY_EVER, predicate, least_share, _rarity_text(predicate, least_share))
    yield from _vacuities_without_keeping(case)


def _vacuities_without_keeping(case: Case) -> Iterator[Vacuity]:
    """The vacuities of groups in which `ttf` holds nearly everywhere that `safer` holds."""
    for proof in case.proofs:
        share, anything = proof.overlap_of_predicates or (1.0, True)
        if share < RARE_SHARE:
            how = HARDLY_EVER if anything else NEVER
            span = show_ns(case.problem.times.delta_dm)
            text = f"AC {how} keeps control longer than {span} (where `safer` holds, so does `ttf`)"
            yield Vacuity(how, "safer", share, text)


def _vacuities_of_small_core(case: Case) -> Iterator[Vacuity]:
    for proof in case.proofs:
        share = proof.core_share
        if share is not None and share < RARE_SHARE:
            text = f"SC keeps `safe` from hardly any state (K is {share:.2%} of C)"
            yield Vacuity(HARDLY_EVER, "core", share, text)


def _why_no_control(case: Case, predicate: str, *, empty: bool, of: str = "everywhere") -> str:
    times = case.problem.times
    if empty:
        within = show_ns(times.horizon_ns)
        return f"AC never has control (R(H) is empty: it could leave K within {within})"
    if predicate == "safer":
        return "AC never has control (`safer` holds nowhere)"
    span = show_ns(times.delta_dm)
    return f"AC never keeps control (`ttf` holds {of}: {span} at a time at most)"


def _rarity_text(predicate: str, share: float) -> str:
    """The words for a small share; a share of 0 of the drawn states does not prove "never"."""
    much = f"{share:.2%}" if share > 0.0 else "none of the states drawn"
    verb = "keeps" if predicate == "ttf" else "gets"
    says = "`ttf` is false" if predicate == "ttf" else "`safer` holds"
    return f"AC hardly ever {verb} control ({says} on {much} of K)"


def _least_free_share(case: Case) -> float:
    return min((p.free_share for p in case.proofs if p.free_share is not None), default=1.0)


def _never_lets_control(case: Case, predicate: str) -> bool:
    """Whether AC is proved never to get control in K; enclosures show this, not samples."""
    if any(p.never_lets_ac(predicate) for p in case.proofs):
        return True
    if case.problem.computed:
        return False  # an empty set is reported as a failure
    box = case.forms.whole.copy()
    return not case.forms.truth(predicate, box) & LETS[predicate]


def _is_ttf_true_on_core(case: Case) -> bool:
    """Whether all of `ttf`, with its parts about ages, which proofs leave out, holds on all of K.

    All ages of a fresh read are covered: up to `max_age`, and up to the proof's A.
    """
    problem, ttf = case.problem, case.problem.module.symbol.ttf
    if ttf is None or not any(isinstance(n, AgeRead) for n in nodes([ttf])):
        return False
    ages = fresh_ages_ns(problem.system, problem.module, problem.times.age_dm)
    ends = dict(enumerate(case.forms.whole.tolist()))
    off = errors_by_state(problem)
    within = {
        leaf: (ends[s][0] - off.get(s, 0.0), ends[s][1] + off.get(s, 0.0))
        for s, leaf in problem.topic_leaf_of_state.items()
    }
    read = reader_with_limits(problem.system, ages, within)
    return truth_by_parts(ttf, problem.system, problem.module.scope, read) is True


def _control_shares(case: Case, predicate: str) -> Iterator[float]:
    """Gives for each group the largest share of its K on which AC can have control."""
    for proof in case.proofs:
        share = proof.share_of_core_with_ac(case, predicate)
        if share is not None:
            yield share
    if case.problem.computed:
        return
    drawer = _StateDrawer(case, predicate)
    for proof in case.proofs:
        yield drawer.share(proof)


class _StateDrawer:
    """Draws states of K group by group, and evaluates a predicate on their estimates."""

    def __init__(self, case: Case, predicate: str) -> None:
        self.case, self.predicate = case, predicate
        self.chance = np.random.default_rng(0)
        self.groups = case.proofs
        self.drawn = {id(g): g.random_states(self.chance, DRAWN) for g in self.groups}
        self.anchors = self._anchors()

    def share(self, proof: GridProof) -> float:
        """The largest share of the group's states with control for AC, over all anchors."""
        best = 0.0
        for anchor in self.anchors:
            best = max(best, self._share_at(proof, anchor))
            if best >= RARE_SHARE:
                break
        return best

    def _share_at(self, proof: GridProof, anchor: Floats) -> float:
        states = [a.state for a in proof.group.axes]
        count = 0
        for k, values in enumerate(self.drawn[id(proof)], 1):
            point = anchor.copy()
            point[states] = values
            count += self._lets_control(point)
            if k >= FEW and count >= ENOUGH * k:
                return count / k
        return count / DRAWN

    def _lets_control(self, point: Floats) -> bool:
        """Whether AC has control at an estimate of the state, in some mode of other modules."""
        whole = self.case.forms.whole
        box = np.repeat(self.chance.uniform(whole[:, :1], whole[:, 1:]), 2, axis=1)
        box[: len(point)] = point[:, None]
        truth = self.case.forms.truth(self.predicate, box)
        wanted = LETS[self.predicate]
        return bool(truth & wanted) if self.case.problem.modes else truth & 3 == wanted

    def _anchors(self) -> list[Floats]:
        """States for the other groups: usual points, and random points where AC has control."""
        anchors = points_to_try(self.case.problem)
        if len(self.groups) < 2:
            return anchors[:1]
        for k in range(DRAWN):
            point = anchors[0].copy()
            for part in self.groups:
                point[[a.state for a in part.group.axes]] = self.drawn[id(part)][k]
            if self._lets_control(point):
                anchors.append(point)
            if len(anchors) >= len(points_to_try(self.case.problem)) + ANCHORS_MAX:
                break
        return anchors[::-1]


def _vacuity_without_return(done: Sequence[Case]) -> Vacuity | None:
    """The vacuity that SC has control at the start, and no claim says that it ever gives it."""
    if not note_on_start(done) or not (clause := done[0].problem.module.symbol.stay_clause):
        return None
    why = f"at the start `safer` does not hold, and P2b is not asked: `{clause}`"
    return Vacuity(NOT_SHOWN, "safer", 0.0, f"nothing says that AC ever gets control ({why})")


def _is_refused_at_start(case: Case) -> bool:
    """Whether the declared `safer` holds on no estimate of an initial state."""
    if case.problem.computed:
        return False
    box = case.forms.whole.copy()
    box[: len(case.problem.initial)] = [(i.low, i.high) for i in case.problem.initial]
    return not case.forms.truth("safer", box) & LETS["safer"]


def note_on_start(done: Sequence[Case]) -> str:
    """A note that AC cannot have control at the start, as `safer` does not hold; "" if it may.

    It is also "" without a K, or where a computed `safer` holds nowhere.
    """
    for case in done:
        empty = case.failures_of("P2a") or (case.problem.computed and case.failures_of("safer"))
        if empty or not case.problem.may_start_with(case.parameter):
            continue
        if any(p.waits_at_start(case) for p in case.proofs) or _is_refused_at_start(case):
            return "at the start `safer` does not hold: SC has control until the state is there"
    return ""
