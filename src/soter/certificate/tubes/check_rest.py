"""The claims of a certificate of a module with `rest`, each checked again.

Purpose: `recheck_rest` compares every constant of the module's decision module with the program,
then shows P1, P2a and `start`. What the DM decides in flight it does not confirm, and says so.
Non-goals: what each claim asks of tubes (`rest_claims.py`, `tube_chains.py`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import inf
from typing import TYPE_CHECKING, Any

from soter.certificate.case_check import CLAIMS, check_static_claims, proved_claims
from soter.certificate.reading.folder import number_from_hexadecimal, require_keys
from soter.certificate.reading.module_facts import bounded_topics
from soter.certificate.reading.module_times import compare_times
from soter.certificate.reading.symbolic_values import scalar_leaves
from soter.certificate.report import (
    NotRecheckedError,
    RecheckAssumption,
    RecheckedModule,
    RejectedError,
)
from soter.certificate.scope import assumptions_of
from soter.certificate.terms.linear_enclosures import exact
from soter.certificate.tubes.collecting_tube import CollectingTube
from soter.certificate.tubes.rest_claims import show_rule_1, show_rule_2
from soter.certificate.tubes.rest_problem import (
    LARGEST,
    may_be_anywhere,
    read_rest_problem,
    read_turns,
    shield_constants,
)
from soter.certificate.tubes.sc_answers import show_answers
from soter.certificate.tubes.tube_chains import ModuleTube
from soter.certificate.vacuous_proofs import why_safe_says_nothing
from soter.language.model.typed import Literal, TopicRead, TypedBinary, TypedIf

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.tubes.rest_problem import Range, RestProblem
    from soter.language.model.system import System
    from soter.language.model.typed import ModuleSymbol, TypedStmt

KEYS = "system module plants claims recover_ns times inputs rest"
PLANS_KEYS, PLAN_KEYS = "system module claims recover_ns plans", "plants times inputs rest"
REST_KEYS, KEPT_KEYS = "within_ns alpha_ns switches reads moves", "box ways"
"""What an entry has of the check of its DM, and what P2a rests on."""
COLLECTS = "collects"
"""Where the check collects, if it does: `{"state": a name, "at": [low, high]}`."""
SOUND = (
    "tubes",
    "the check that the DM is compiled with encloses what SC and the plants do: tested, not proved",
)


def recheck_rest(flat: System, entry: dict[str, Any]) -> tuple[Facts, RecheckedModule]:
    """Checks a module's entry; raises RejectedError or NotRecheckedError if it is not confirmed."""
    problem, box, ways = _compared_entry(flat, entry)
    facts, claims = problem.facts, proved_claims(entry["claims"])
    tube = partial(_make_tube, problem, ways, entry["rest"].get(COLLECTS))
    for show in _claim_checks(problem, claims, box, ways, tube):
        try:
            show()
        except NotRecheckedError:
            if facts.times["d_ns"] == facts.derived.delay:
                raise
            facts.times["d_ns"] = facts.derived.delay  # older reads may be too much for our bounds
            show()
    facts.in_sets = tuple(bounded_topics(facts))  # a part of C
    report = RecheckedModule(entry["module"], dict(entry["claims"]), system=flat.name)
    report.confirmed = [c for c in CLAIMS if c in claims]
    assumed = [*_map_assumptions(problem), *_largest_assumptions(problem), SOUND]
    report.assumptions = [*assumptions_of(facts), *(RecheckAssumption(*a) for a in assumed)]
    report.stays = bool(facts.symbol.stay_clause)
    report.safe = facts.symbol.safe.span.text_on_one_line
    report.times = {**facts.times, "start_ns": facts.start_ns, "alpha_ns": problem.times.alpha}
    report.in_flight = "P2a" in claims  # else nothing is shown of what its DM decides
    report.vacuous, report.unseen = why_safe_says_nothing(facts), "its DM decides in flight"
    return facts, report


def recheck_plans(flat: System, entry: dict[str, Any]) -> tuple[Facts, RecheckedModule]:
    """Checks the entry of a module with several plans, each as if it alone were SC.

    A claim is confirmed if every plan has it; `start` is about the first plan, which SC follows
    until the first verdict "AC". The facts are the first plan's. Raises as `recheck_rest` does.
    """
    checked = {name: recheck_rest(*of) for name, of in entries_of_plans(flat, entry).items()}
    (facts, report), *others = checked.values()
    report.claims = dict(entry["claims"])
    every = [report.assumptions, *(r.assumptions for _, r in others)]
    report.assumptions = list({a.text: a for of in every for a in of}.values())
    report.plan_times = {name: r.times for name, (_, r) in checked.items()}
    report.vacuous = next((r.vacuous for _, r in checked.values() if r.vacuous), "")
    return facts, report


def read_plans(flat: System, entry: dict[str, Any]) -> None:
    """Reads the entry of a module with several plans, as `read_entry` does."""
    for of in entries_of_plans(flat, entry).values():
        read_entry(*of)


def entries_of_plans(
    flat: System, entry: dict[str, Any]
) -> dict[str, tuple[System, dict[str, Any]]]:
    """Maps each plan to the system where it alone is SC, and its entry; "" if there is one plan.

    Raises RejectedError if the program has other plans.
    """
    if "plans" not in entry:
        return {"": (flat, entry)}
    require_keys(entry, PLANS_KEYS, "a module")
    plans, claims = entry["plans"], dict(entry["claims"])
    alone = dict(_plans_alone(flat, entry["module"]))
    if not alone or plans.keys() != alone.keys():
        raise RejectedError("the plans are others in the program")
    found = {}
    for k, (name, system) in enumerate(alone.items()):
        require_keys(plans[name], PLAN_KEYS, "a plan")
        claims_of_plan = {n: v for n, v in claims.items() if not (k and n == "start")}
        head = {n: entry[n] for n in ("system", "module", "recover_ns")}
        found[name] = system, {**head, **plans[name], "claims": claims_of_plan}
    return found


def _plans_alone(flat: System, name: str) -> Iterator[tuple[str, System]]:
    """Yields each plan of a module, in order, with the system in which this plan alone is SC.

    Raises NotRecheckedError if SC, at the number of a plan, acts otherwise than this plan.
    """
    for module in (m for m in flat.modules if m.name == name and m.plan is not None):
        symbol, sc = module.symbol, flat.components[module.sc]
        if sc.node is None or not _follows_plans(sc.node.step, symbol):
            raise NotRecheckedError("SC is made of its plans in a way that is not known here")
        for plan in symbol.plans:
            one = replace(symbol, sc=plan, plans=(), plan=None)
            system = replace(
                flat,
                components=tuple(replace(c, node=plan) if c is sc else c for c in flat.components),
                modules=tuple(
                    replace(m, symbol=one, plan=None) if m is module else m for m in flat.modules
                ),
            )
            yield plan.name, system


def _follows_plans(step: Sequence[TypedStmt], symbol: ModuleSymbol) -> bool:
    """Whether a step is `if plan == 0 { the first } ... else { the last }`, and no more."""
    *most, last = symbol.plans
    if (
        len(step) != 1
        or not isinstance(choice := step[0], TypedIf)
        or choice.otherwise != last.step
    ):
        return False
    arms = zip(choice.arms, most, strict=True) if len(choice.arms) == len(most) else ()
    return bool(arms) and all(
        isinstance(c, TypedBinary)
        and c.op == "=="
        and isinstance(c.left, TopicRead)
        and c.left.topic is symbol.plan
        and isinstance(c.right, Literal)
        and (c.right.value, body) == (k, plan.step)
        for k, ((c, body), plan) in enumerate(arms)
    )


def _map_assumptions(problem: RestProblem) -> Iterator[tuple[str, str]]:
    """The assumption about each map that `safe` reads (condition 7)."""
    for index in problem.maps:
        name = problem.facts.system.topics[index].name
        free = f"where `safe` holds with a value of {name}, with its default at the start"
        yield f"map {name}", f"{free}, it is safe for ever: what it calls free stays free"


def _largest_assumptions(problem: RestProblem) -> Iterator[tuple[str, str]]:
    """The assumption that each followed state without a smaller set stays below `LARGEST`."""
    for s in problem.followed:
        if max(map(abs, problem.sets[s])) > LARGEST:
            name = problem.facts.states[s].name
            yield f"far {name}", f"{name}, whose topic has no smaller set, stays below {LARGEST:g}"


def read_entry(flat: System, entry: dict[str, Any]) -> None:
    """Reads an entry and compares it with the program; shows nothing, raises as `recheck_rest`."""
    tube_of_entry(flat, entry)


def tube_of_entry(flat: System, entry: dict[str, Any]) -> ModuleTube:
    """The tube that follows SC as the DM of an entry does. Raises as `recheck_rest` does."""
    problem, _, ways = _compared_entry(flat, entry)
    return _make_tube(problem, ways, entry["rest"].get(COLLECTS))


def _make_tube(problem: RestProblem, ways: dict[int, Range], collects: object) -> ModuleTube:
    """Makes the tube of a module; raises RejectedError if `collects` names no followed state."""
    if collects is None:
        return ModuleTube(problem, ways)
    require_keys(collects, "state at", COLLECTS)
    assert isinstance(collects, dict)
    names = [problem.facts.states[s].name for s in problem.followed]
    low, high = (exact(number_from_hexadecimal(x, COLLECTS)) for x in collects["at"])
    if collects["state"] not in names or not low < high:
        raise RejectedError("the check collects in no state that is followed, or at no numbers")
    return CollectingTube(problem, ways, names.index(collects["state"]), (low, high))


def _claim_checks(
    problem: RestProblem,
    claims: set[str],
    box: dict[int, Range],
    ways: dict[int, Range],
    tube: Callable[[], ModuleTube],
) -> Iterator[Callable[[], None]]:
    if "P2a" in claims:
        yield partial(show_answers, problem)
        yield partial(show_rule_1, problem, box, ways)
        yield partial(show_rule_2, problem, box, ways)
    if "start" in claims:
        if "P2a" not in claims:
            raise RejectedError("start: that SC keeps where it rests (P2a) is not claimed")
        yield partial(_show_start, problem, tube)


def _show_start(problem: RestProblem, tube: Callable[[], ModuleTube]) -> None:
    for c in problem.facts.controls:
        default = problem.facts.system.topics[c.owner].default
        assert c.low <= scalar_leaves(default)[c.leaf] <= c.high  # else V002
    if why := tube().why_starts_not_good():
        raise NotRecheckedError(f"start: {why}")


# ---------------------------------------------------------------- the manifest


def _moves_entry(problem: RestProblem) -> dict[str, list[str | None]]:
    names, drifts = [s.name for s in problem.facts.states], problem.drifts
    return {
        names[s]: [None if x == inf else x.hex() for x in drifts[s]] for s in problem.moving_states
    }


def _free_states(problem: RestProblem, entry: object) -> dict[int, Range]:
    """The states outside `moves` about which an entry claims nothing at rest.

    Only states without ends may be free: then all claims hold wherever these states are. Raises
    NotRecheckedError if `rest` or the rate of a free state reads a free state.
    """
    names = {problem.facts.states[s].name: s for s in problem.returning_states}
    claimed = entry if isinstance(entry, dict) else {}
    free = {names[n] for n, ends in claimed.items() if n in names and ends == [None, None]}
    if not all(problem.sets[s] == (-inf, inf) for s in free):
        return {}
    if not may_be_anywhere(problem, free):
        raise NotRecheckedError("a state of which nothing is claimed is read at rest")
    return dict.fromkeys(free, (inf, inf))


def _compared_entry(
    flat: System, entry: dict[str, Any]
) -> tuple[RestProblem, dict[int, Range], dict[int, Range]]:
    """Reads the problem, B and Y (`rest_claims.py`); RejectedError where a figure differs."""
    require_keys(entry, KEYS, "a module")
    rest = entry["rest"]
    problem = read_rest_problem(flat, entry["module"], rest.get("keeps", {}))
    judged, claims = shield_constants(problem), proved_claims(entry["claims"])
    needed = [REST_KEYS, *["shield"] * bool(judged), *[KEPT_KEYS] * ("P2a" in claims)]
    require_keys(rest, " ".join(needed), "`rest`", f"{KEPT_KEYS} keeps wraps {COLLECTS}")
    if "wraps" in rest:
        read_turns(problem, rest["wraps"])
    facts = problem.facts
    if entry["recover_ns"] is not None:
        raise RejectedError("no claim rests on the time to return")
    if entry["plants"] != [c.name for c in facts.plants]:
        raise RejectedError("the verification plants are others in the program")
    compare_times(facts, entry["times"])
    check_static_claims(facts, entry["claims"])
    if wrong := {"P3", "ttf", "safer", "P2b", "failsafe"} & claims:
        raise RejectedError(f"{min(wrong)}: what is decided in flight is assumed, not proved")
    _compare_inputs(facts, entry["inputs"])
    times = problem.times
    for name, ours in (
        ("within_ns", problem.within_ns),
        ("alpha_ns", times.alpha),
        ("switches", times.switches),
    ):
        if type(rest[name]) is not int or rest[name] != ours:
            raise RejectedError(f"{name} is {rest[name]} in the manifest, {ours} by the program")
    _compare_shield(judged, rest.get("shield"))
    _compare_reads(problem, rest["reads"])
    problem.drifts |= _free_states(problem, rest["moves"])
    if rest["moves"] != _moves_entry(problem):
        raise RejectedError("what `rest` moves is another in the program")
    if "P2a" not in claims:
        return problem, {}, {}  # nothing is known of where it rests
    box, ways = (_read_ranges(problem, rest[name], name) for name in KEPT_KEYS.split())
    return problem, box, ways


def _compare_inputs(facts: Facts, entry: object) -> None:
    """Raises RejectedError if the manifest has another input, or another range of an input."""
    known = [
        {"name": x.name, "kind": x.kind, "low": x.low.hex(), "high": x.high.hex()}
        for x in (*facts.controls, *facts.disturbances, *facts.errors, *facts.others)
    ]
    if not isinstance(entry, list) or len(entry) != len(known):
        raise RejectedError("the inputs are others in the program")
    for a, b in zip(entry, known, strict=True):
        if a != b:
            raise RejectedError(f"the range of {b['name']} is another one in the program")


def _compare_shield(constants: dict[str, int] | None, entry: object) -> None:
    """Raises RejectedError for other cells, or for shorter times than the program's constants."""
    if constants is None:
        return
    if not isinstance(entry, dict) or entry.keys() != constants.keys():
        raise RejectedError("how commands are judged is not as the program says")
    for name, by_program in constants.items():
        exactly = name == "cells"
        claimed = entry[name]
        if type(claimed) is not int or claimed < by_program or (exactly and claimed > by_program):
            raise RejectedError(f"{name} is {claimed} in the manifest, {by_program} by the program")


def _compare_reads(problem: RestProblem, entry: dict[str, Any]) -> None:
    """Raises RejectedError if the DM reads a followed state elsewhere or with another error E."""
    states = {problem.field_read(s): s for s in problem.followed}
    if entry.keys() != states.keys():
        raise NotRecheckedError("the states that its check follows are others here")
    for leaf, s in states.items():
        require_keys(entry[leaf], "state within", "what is read")
        if entry[leaf]["state"] != problem.facts.states[s].name:
            raise RejectedError(f"`{leaf}` shows another state in the program")
        if number_from_hexadecimal(entry[leaf]["within"], leaf) != problem.max_error(s):
            raise RejectedError(f"the error of {leaf} is another one in the program")


def _read_ranges(problem: RestProblem, entry: dict[str, Any], set_name: str) -> dict[int, Range]:
    """Reads B or Y (`set_name`): the range of each followed state outside `moves`."""
    names = {problem.facts.states[s].name: s for s in problem.returning_states}
    if entry.keys() != names.keys():
        raise RejectedError(f"`{set_name}` is not of the states that `rest` does not move")
    found = {}
    for name, ends in entry.items():
        low, high = (number_from_hexadecimal(x, name) for x in ends)
        found[names[name]] = low, high
    return found
