"""Proves a module by k-induction over hyperperiods, or looks for a run that leaves `safe`.

Purpose: `prove_by_induction` proves that at all times `safe` and every lemma hold and no step
faults: in the first hyperperiods of every run, and in each one that follows k in which all held.
For P2b it then proves a bound on the hyperperiods in which SC keeps control, and it finds out
whether AC can ever have control. Where the transition relation has a run in which something fails,
`refuting_run` looks for such a run of the program by systematic testing, with an AC that may
publish anything; it counts only after the reference interpreter has replayed it.
Non-goals: the relation (`transition_relation.py`), what an execution is (docs/testing.md).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Protocol

from soter.core.execution import TooManyStatementsError
from soter.diagnostics.current_phase import share_done
from soter.language.elaborate import derived_systems
from soter.language.model import typed
from soter.language.model.system import Property, TestPlan, TimingFault
from soter.language.model.types import (
    BOOL,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    RecordType,
    default_value,
    leaves,
)
from soter.verify.induction.calendar import hyperperiod_ns, start_of_periodic_releases
from soter.verify.induction.solver_terms import SolverTerms
from soter.verify.induction.step_terms import AC, SC, ClusterView
from soter.verify.induction.transition_relation import TimeSpan
from soter.workers.interruptible_solver import ctrl_c_waits

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Span
    from soter.language.model.system import Bound, System
    from soter.language.model.types import Type, Value
    from soter.verify.induction.problem import InductionProblem
    from soter.verify.induction.solver_terms import Query, Term


DEPTHS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)
STEPS_MAX = 600
"""The most steps of components in one question to the solver."""
BUDGET_S = 60.0
"""The CPU time in seconds after which no greater depth is tried."""
HOLDS, FAILS, UNKNOWN = "holds", "fails", "unknown"


@dataclass
class Induction:
    """The result of an induction; `k` is the depth at which the module was proved."""

    hyperperiod_ns: int
    steps: int = 0
    """How many steps of components one hyperperiod has."""
    k: int = 0
    proved: bool = False
    seconds: float = 0.0
    fails_ns: int | None = None
    """The time in ns by which something fails in some run of the relation; None if in no run."""
    failure: str = ""
    """The words for what fails there: `safe`, a lemma, or a step that faults."""
    about: str = ""
    """The kind of `failure`: "safe", "lemma" or "fault"."""
    why: str = ""
    """Why neither a proof nor a failing run was found."""
    gave_up: str = ""
    """An addition to `why` if the solver gave up."""
    undecided: str = ""
    """The reason or failure of the second try, in which steps that may fault latch their nodes."""
    uninterpreted: dict[str, None] = field(default_factory=dict)
    latching: tuple[str, ...] = ()
    """The names of components whose steps may fault; the proof holds also where they do."""
    returns: int = 0
    """The number of whole hyperperiods for which SC never keeps control; 0 if none is shown."""
    returns_s: float = 0.0
    contradicted: bool = False
    """Whether no run is long enough and meets the assumptions of P2b, so that P2b says nothing."""
    never: str = ""
    """"gets": no decision gives AC control; "keeps": none leaves it control; "fails": `safe` is
    true of all values that topics may have; "": none of these."""

    @property
    def returns_ns(self) -> int:
        """T of P2b in ns, with one more hyperperiod for SC's takeover; 0 if P2b is not shown."""
        return (self.returns + 1) * self.hyperperiod_ns if self.returns else 0


@ctrl_c_waits()
def prove_by_induction(problem: InductionProblem) -> Induction:
    """Tries to prove a module by k-induction; the result says how far the proof came."""
    began = time.perf_counter()
    hyperperiod = hyperperiod_ns(problem.clocks)
    induction = Induction(hyperperiod, sum(hyperperiod // c.period for c in problem.clocks))
    if induction.steps > STEPS_MAX // 2:
        induction.why = f"a hyperperiod has {induction.steps} steps, too many to be followed"
        return induction
    try:
        _deepen_induction(problem, induction)
        if not induction.proved and induction.about != "safe":
            _prove_with_latching(problem, induction)
        if induction.proved:
            _prove_return(problem, induction)
            induction.never = _event_that_never_happens(problem, induction)
    except TooManyStatementsError:
        induction.why = "a step takes more statements than are followed"
    induction.seconds = time.perf_counter() - began
    return induction


def _prove_with_latching(problem: InductionProblem, induction: Induction) -> None:
    """Tries the proof again with steps that may fault and latch nodes, which proves as much."""
    names = _components_that_may_fault(problem)
    if not names:
        return
    other = Induction(induction.hyperperiod_ns, induction.steps, latching=names)
    _deepen_induction(problem, other)
    if other.proved or other.about == "safe":
        induction.latching, induction.k, induction.proved = names, other.k, other.proved
        induction.uninterpreted |= other.uninterpreted
    if other.about == "safe":
        induction.about, induction.failure, induction.fails_ns = (
            other.about,
            other.failure,
            other.fails_ns,
        )
    elif not other.proved:
        induction.undecided = other.why or f"{other.failure} then"


def _components_that_may_fault(problem: InductionProblem) -> tuple[str, ...]:
    """The names of the components whose steps may fault, as far as the solver's terms tell."""
    terms = SolverTerms()
    span = TimeSpan(problem, terms, hyperperiod_ns(problem.clocks))
    indices = {d.step.component for d in span.effects if d.doubt is not False}
    return tuple(problem.system.components[i].name for i in sorted(indices))


def _deepen_induction(problem: InductionProblem, induction: Induction) -> None:
    """Tries increasing depths k until base and step hold, the base fails, or time is up."""
    began = time.process_time()
    for n, k in enumerate(DEPTHS):
        share_done(n / len(DEPTHS))
        if (k + 1) * induction.steps > STEPS_MAX and n:
            induction.why = (
                f"no induction over up to {DEPTHS[n - 1]} hyperperiods{induction.gave_up}"
            )
            return
        if time.process_time() - began > BUDGET_S:
            induction.why = f"no induction within {BUDGET_S:g} s of CPU time: it was given up"
            return
        if _prove_base_case(problem, induction, k) != HOLDS:
            return
        if _prove_induction_step(problem, induction, k):
            induction.k, induction.proved = k, True
            return
    induction.why = f"no induction over up to {DEPTHS[-1]} hyperperiods{induction.gave_up}"


def _prove_base_case(problem: InductionProblem, induction: Induction, k: int) -> str:
    """Whether all claims hold until k hyperperiods after all phases: HOLDS, FAILS or UNKNOWN."""
    terms = SolverTerms()
    end = start_of_periodic_releases(problem.clocks) + k * induction.hyperperiod_ns
    span = TimeSpan(problem, terms, end, first=True, latching=bool(induction.latching))
    induction.uninterpreted |= span.uninterpreted
    bad = _failing_conditions(span, 0, end)
    query = terms.query()
    query.add(terms.any_of(*[b for b, _, _ in bad]))
    answer = query.check()
    if answer == terms.z3.unsat:
        return HOLDS
    if answer != terms.z3.sat:
        induction.why = f"the solver gave up on the first {k} hyperperiods"
        return UNKNOWN
    model = query.model()
    times = [
        (model.eval(terms.z3.IntVal(0) + at, model_completion=True).as_long(), number)
        for b, at, number in bad
        if terms.z3.is_true(model.eval(_solver_term(terms, b), model_completion=True))
    ]
    induction.fails_ns, number = min(times)
    induction.about = ("fault", "safe")[number] if number < 2 else "lemma"
    induction.failure = _property_name(problem, number)
    return FAILS


def _property_name(problem: InductionProblem, number: int) -> str:
    if number == 0:
        return "a step of SC, or of a node beside the module, may fault"
    return "`safe`" if number == 1 else f"the lemma `{problem.lemma_texts[number - 2]}`"


def _prove_induction_step(problem: InductionProblem, induction: Induction, k: int) -> bool:
    """Whether all claims hold in the next hyperperiod after any k in which all claims held.

    Each claim is a separate question, because one question about ten claims is harder than ten.
    """
    terms = SolverTerms()
    hyperperiod = induction.hyperperiod_ns
    span = TimeSpan(problem, terms, (k + 1) * hyperperiod, latching=bool(induction.latching))
    failures = _failing_conditions(span, k * hyperperiod, (k + 1) * hyperperiod)
    for claim in sorted({number for _, _, number in failures}):
        query = terms.query()
        _assume_held_before(query, span, k * hyperperiod)
        query.add(terms.any_of(*[b for b, _, number in failures if number == claim]))
        answer = query.check()
        if answer == terms.z3.unknown:
            induction.gave_up = "; the solver gave up on some of them"
        if answer != terms.z3.unsat:
            return False
    return True


def _assume_held_before(query: Query, span: TimeSpan, until: int) -> None:
    """Adds to the query that every claim judged before the time `until` held."""
    terms = span.terms
    for seen in span.judged:
        if seen.earliest < until:
            counts = terms.all_of(seen.counts, seen.latest < until or seen.at < until)
            query.add(terms.z3.Implies(counts, _solver_term(terms, terms.all_of(*seen.holds))))


def _failing_conditions(span: TimeSpan, begin: int, end: int) -> list[tuple[Term, Term, int]]:
    """Every possible failure in [begin, end), as its condition, its time and the claim's number."""
    terms = span.terms
    failures = []
    for seen in span.judged:
        if seen.latest < begin or seen.earliest >= end:
            continue
        inside = terms.all_of(
            seen.earliest >= begin or seen.at >= begin, seen.latest < end or seen.at < end
        )
        counts = terms.all_of(seen.counts, inside)
        for number, holds in enumerate(seen.holds):
            holds_ = terms.all_of(holds, seen.later) if number == 1 else holds
            failures.append((terms.all_of(counts, terms.negated(holds_)), seen.at, number))
    return failures


def _prove_return(problem: InductionProblem, induction: Induction) -> None:
    """Proves P2b by a number of hyperperiods for which SC cannot keep control."""
    began, since = time.perf_counter(), time.process_time()
    hyperperiod = induction.hyperperiod_ns
    for n in DEPTHS:
        if (
            n + induction.k
        ) * induction.steps > STEPS_MAX or time.process_time() - since > BUDGET_S / 2:
            break
        if problem.recover_ns is not None and (n + 1) * hyperperiod > problem.recover_ns:
            break
        if _has_no_such_run(problem, induction, n, stays=True):
            induction.contradicted = _has_no_such_run(problem, induction, n, stays=False)
            induction.returns = 0 if induction.contradicted else n
            break
    induction.returns_s = time.perf_counter() - began


def _has_no_such_run(
    problem: InductionProblem, induction: Induction, n: int, *, stays: bool
) -> bool:
    """Whether no run has n hyperperiods with all claims true, and with `stays` SC in control.

    In these runs no step faults, and the assumptions of P2b hold.
    """
    terms, end = SolverTerms(), n * induction.hyperperiod_ns
    span = TimeSpan(problem, terms, end, returning=True, stays=stays)
    query = terms.query()
    _assume_held_before(query, span, end)
    granted = [terms.any_of(terms.negated(s.counts), s.progress) for s in span.judged]
    query.add(*granted)
    return bool(query.check() == terms.z3.unsat)


def _event_that_never_happens(problem: InductionProblem, induction: Induction) -> str:
    """The event that never happens: `safe` "fails", AC "gets" or "keeps" control; "" if all may.

    It looks at the first hyperperiods, and at any hyperperiod after k in which all claims held. As
    the module is proved, these cover every run.
    """
    if _is_safe_always_true(problem):
        return "fails"
    hyperperiod, latching = induction.hyperperiod_ns, bool(induction.latching)
    held_ns = induction.k * hyperperiod
    any_time = partial(TimeSpan, problem, end=held_ns + hyperperiod, latching=latching)
    from_start = partial(
        TimeSpan,
        problem,
        end=start_of_periodic_releases(problem.clocks) + held_ns,
        first=True,
        latching=latching,
    )
    for word in ("gets", "keeps"):
        if not (_may_decide(any_time, held_ns, word) or _may_decide(from_start, 0, word)):
            return word
    return ""


def _is_safe_always_true(problem: InductionProblem) -> bool:
    """Whether `safe` is true for all values that the topics' sets allow."""
    terms = SolverTerms()
    span = TimeSpan(problem, terms, 0)
    outside = terms.negated(span.claim_conditions(ClusterView(span, None, 0))[0])
    query = terms.query()
    query.add(outside)
    return bool(query.check() == terms.z3.unsat)


def _may_decide(make_span: Callable[..., TimeSpan], begin: int, word: str) -> bool:
    """Whether from `begin` on a decision may give AC control ("gets") or let AC stay ("keeps")."""
    terms = SolverTerms()
    span = make_span(terms=terms)
    query = terms.query()
    _assume_held_before(query, span, span.end)
    ways = [
        terms.all_of(d.mode == AC, d.before == (AC if word == "keeps" else SC))
        for d in span.effects
        if d.mode is not None and not d.step.begun and d.step.effect.latest >= begin
    ]
    query.add(terms.any_of(*ways))
    return bool(query.check() != terms.z3.unsat)


def _solver_term(terms: SolverTerms, truth: Term) -> Term:
    return terms.z3.BoolVal(truth) if isinstance(truth, bool) else truth


ALTERNATIVES_MAX = 64
"""Up to this many values of an int are all tried; of more the ends, the default, the middle."""


@dataclass(frozen=True)
class ReplayedRun:
    """A run of the program with some AC, replayed by the reference interpreter."""

    time_ns: int
    lines: tuple[str, ...]

    def __str__(self) -> str:
        """The steps of the run, one line each."""
        return "\n".join(self.lines)


class Violated(Protocol):
    """A run found by the search that violates a property or has a faulting step."""

    @property
    def what(self) -> str:
        """The kind of the violation, as traces name it: `property` or `fault`, for example."""

    @property
    def time_ns(self) -> int:
        """The time of the violation in ns."""

    @property
    def lines(self) -> tuple[str, ...]:
        """The steps of the run in words, one line each."""


Search = Callable[["System"], "Violated | None"]
"""A function that looks for a run of a flat system, with a test plan, that violates a property."""


def refuting_run(
    problem: InductionProblem, until_ns: int, search: Search, *, fault: bool
) -> ReplayedRun | None:
    """Searches for a run that violates `safe` by `until_ns`, or with `fault` faults; else None.

    It searches no run if the proof depends on topics that none of its nodes publishes, because the
    tested system would not be the program.
    """
    if problem.any_value:
        return None
    for system in (system_with_any_ac(problem), problem.system):
        if any(c.extern for c in system.components):
            continue
        violation = search(system_as_test(problem, system, until_ns))
        if violation is not None and violation.what == ("fault" if fault else "property"):
            return ReplayedRun(violation.time_ns, violation.lines)
    return None


def system_as_test(problem: InductionProblem, system: System, until_ns: int) -> System:
    """A copy of the system with a test plan for `safe`, in which steps are as late as declared."""
    m = problem.module
    span = m.symbol.span
    safe = Property(0, "always", m.symbol.safe, m.scope, "safe", m.symbol.safe.span)
    faults = []
    for c in problem.declared:
        if c.late:
            faults.append(TimingFault("late", c.component, c.late, 0, span))
        if c.response and c.component != m.dm:
            takes = system.components[c.component].takes_ns
            least = 0 if takes is None else takes[0]
            faults.append(TimingFault("overrun", c.component, c.response, 0, span, least))
    plan = TestPlan(m.name, 0, max(until_ns, 1), None, tuple(faults), (), span)
    return derived_systems.with_test(derived_systems.with_properties(system, (safe,)), plan)


def system_with_any_ac(problem: InductionProblem) -> System:
    """A copy of the system whose AC may publish any value, or none, of each topic in each step."""
    system = problem.system
    ac = system.components[problem.module.ac]
    assert ac.node is not None
    span = ac.node.span
    step: list[typed.TypedStmt] = []
    for t in ac.node.publishes:
        topic = system.topics[ac.scope.topics[t]]
        value = _any_value(topic.type, topic.bounds, topic.default, span)
        coin = typed.TypedChoose(BOOL, span, 2, 0, (), None)
        step.append(typed.TypedIf(span, ((coin, (typed.TypedPublish(span, t, value),)),), ()))
    node = replace(
        ac.node,
        extern=False,
        source=None,
        subscribes=(),
        locals=(),
        initial=(),
        takeover=None,
        step=tuple(step),
    )
    return derived_systems.with_components(system, [derived_systems.with_node(ac, node, {})])


def _any_value(
    t: Type, bounds: Sequence[Bound | None], default: Value, at: Span
) -> typed.TypedExpr:
    """An expression that chooses a value of a type, from all values or, if too many, from some."""
    if isinstance(t, (RecordType, ArrayType)):
        part_types = [f for _, f in t.fields] if isinstance(t, RecordType) else [t.element] * t.size
        elements, k = [], 0
        for part, value in zip(part_types, default, strict=True):
            count = sum(1 for _ in leaves(part))
            elements.append(_any_value(part, bounds[k : k + count], value, at))
            k += count
        return typed.Aggregate(t, at, tuple(elements))
    if isinstance(t, BoolType):
        return typed.TypedChoose(t, at, 2, 0, (), None)
    if isinstance(t, EnumType):
        return typed.TypedChoose(t, at, len(t.members), 0, (), None)
    values: list[Value] = [default]
    bound = bounds[0] if bounds else None
    if isinstance(t, IntType):
        low, high = (t.low, t.high) if bound is None else (int(bound.low), int(bound.high))
        few = high - low < ALTERNATIVES_MAX
        values += range(low, high + 1) if few else [low, (low + high) // 2, high]
    elif isinstance(t, FloatType) and bound is not None:
        values += [bound.low, 0.5 * bound.low + 0.5 * bound.high, bound.high]
    else:
        values.append(default_value(t))
    options = [typed.Literal(t, at, v) for v in dict.fromkeys(values)]
    return typed.TypedChoose(t, at, len(options), 0, tuple(options), None)
