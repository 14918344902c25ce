"""The problem of a module with `rest`, read again: "Decisions by tubes" (docs/proof-flight.md).

Purpose: `read_rest_problem` reads a `RestProblem` off the program alone: which states are followed,
in which leaf the DM sees each and how far that may be off, the sets of states, what `moves` says,
and every time constant. `RestModel` makes the terms that tubes and claims are about.
Non-goals: tubes (`tube_chains.py`), what is claimed (`rest_claims.py`).

The argument: a state is followed if an answer of SC, a condition or the rate of a followed state
depends on it. No question depends on the others: they only need a solution for as long as a run is
asked about, and have one where their rates grow no faster than they do (Gronwall).

C: `safe` holds, the states lie in their sets (boxes of doubles), and what plants publish lies in
its set. Plants can publish all of that. A few real states between these doubles and the ends of
declared sets are not in C: this is the theorem for a smaller C, in which every tube has to stay.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from math import inf
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from flint import arb

from soter.certificate.extras.estimates_and_shield import command_cells, command_memory_ns
from soter.certificate.extras.left_out_states import THIRD, growth_degree, refuse_turns_read
from soter.certificate.extras.sc_locals_and_modes import check_start_answers
from soter.certificate.grid.flow_chains import NOW, Times
from soter.certificate.reading.case_model import CaseModel, new_command_terms
from soter.certificate.reading.folder import number_from_hexadecimal
from soter.certificate.reading.module_facts import (
    DiffersError,
    Facts,
    bounded_topics,
    const_value,
    driven_topics,
    named_leaves,
    topics_read,
    topics_read_by_sc,
)
from soter.certificate.reading.problem import read_facts, state_published
from soter.certificate.reading.supported_constructs import require_supported
from soter.certificate.reading.symbolic_values import scalar_leaves, value_of_leaves
from soter.certificate.report import NotRecheckedError, RejectedError
from soter.certificate.terms.linear_enclosures import HALF, ONE, ZERO, exact, lower, upper
from soter.certificate.terms.terms import Terms, and_of, atoms_under, input_atoms
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import FloatType, leaf_name, leaves

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from soter.certificate.reading.symbolic_reading import Ranges
    from soter.certificate.terms.terms import Linear, Proposition
    from soter.language.model.system import System
    from soter.language.model.typed import RestSymbol, Variable
    from soter.language.model.types import Value

    Range = tuple[float, float]

NANOSECOND = Fraction(1, 10**9)
A_TURN = -3.15, 3.15
"""A full turn, and a little more."""
UNKNOWN_END = 2.0**1000
"""The ends of a map's numbers that are not known; a box beyond it is not certainly in C."""
LARGEST = 1e100
"""Every followed state without a smaller set is assumed to stay below it."""
UNBOUNDED_END = arb(2) ** 10**6
"""How far from 0 the terms of a `RestModel` with `far` hold, in states without a set."""


@dataclass(frozen=True)
class RestTimes:
    """Times in ns; `alpha`: the least from an estimate to a complete output; `switches`: N_T."""

    horizon: int
    alpha: int
    start: int
    delay: int
    jitter: int
    period: int
    switches: int

    @property
    def start_alpha(self) -> int:
        """The `alpha` at the start of a run, where h_0 takes the place of H."""
        return max(0, self.start - self.period - self.jitter)

    @property
    def chain(self) -> Times:
        """The times of a chain that follows all runs at once."""
        ns = (self.period, self.delay, self.jitter)
        delta, delay, jitter = (t * NANOSECOND for t in ns)
        return Times(delta, delay, jitter, jitter, (-delay, NOW))


@dataclass(eq=False)
class RestProblem:
    """One module's problem; `leaves`: followed state -> (topic, leaf) in which its DM sees it."""

    facts: Facts
    rest: RestSymbol
    within_ns: int
    followed: tuple[int, ...]
    leaves: dict[int, tuple[int, int]]
    sets: dict[int, Range]
    """State -> doubles between which every topic that shows it stays in its declared set."""
    drifts: dict[int, Range]
    """State that `moves` names -> how far down and up SC may move it once at rest; inf: any way."""
    maps: tuple[int, ...] = ()
    """`static` topics that `safe` reads and no plant drives."""

    @property
    def default_maps(self) -> dict[int, Value]:
        """By index of a map: its default, which is its value at the start of a run."""
        return {index: self.facts.system.topics[index].default for index in self.maps}

    @property
    def map_leaves(self) -> dict[int, list[str]]:
        """By index of a map: its fields, which the DM reads, as `topic.leaf`."""
        topics = {index: self.facts.system.topics[index] for index in self.maps}
        return {i: [name for _, name, _ in named_leaves(t.name, t.type)] for i, t in topics.items()}

    @property
    def returning_states(self) -> tuple[int, ...]:
        """The followed states that have to come back: neither in `moves` nor turning freely."""
        other = {*self.drifts, *self.facts.turning}
        return tuple(s for s in self.followed if s not in other)

    @property
    def moving_states(self) -> tuple[int, ...]:
        """The followed states that `moves` names."""
        return tuple(s for s in self.followed if s in self.drifts)

    def topics_of(self, states: Iterable[int]) -> list[int]:
        """For each state, the index of the topic by which SC sees it.

        One message shows one instant. For a state that SC does not read, any topic that shows it.
        """
        return [self.leaves[s][0] for s in states]

    @property
    def times(self) -> RestTimes:
        """The time constants of a tube, from the times that claims are held to."""
        t, jitter, period = self.facts.times, self.facts.jitter_ns, self.facts.times["delta_ns"]
        horizon, least = t["H_ns"], min(e.least for e in self.facts.setting.effects)
        alpha = max(t["Delta_ns"] - t["J_dm_ns"] + least, horizon - period - jitter)
        return RestTimes(
            horizon,
            min(alpha, horizon),
            self.facts.start_ns,
            self.facts.delay_ns,
            jitter,
            period,
            (self.within_ns - jitter) // period,
        )

    def field_read(self, state: int) -> str:
        """The field in which the DM reads a followed state, as `topic.field`."""
        topic, k = self.leaves[state]
        declared = self.facts.system.topics[topic]
        path = [p for p, _ in leaves(declared.type)][k]
        return leaf_name(declared.name, path)

    def max_error(self, state: int) -> float:
        """E of a state: the largest error of the topics in which the module reads it."""
        shown = {at for at, s in states_shown(self.facts).items() if s == state}
        return max((e.high for e in self.facts.errors if (e.owner, e.leaf) in shown), default=0.0)


@dataclass(eq=False)
class RestModel(CaseModel):
    """Makes the terms of a module with `rest`; `far`: states without a set go to `UNBOUNDED_END`.

    `known`: the values of maps; a map that is not in it may have any value.
    """

    far: bool = True
    known: Mapping[int, Value] = field(default_factory=dict)

    def new_terms(self, farthest: arb | None = None) -> tuple[Terms, list[Linear]]:
        """New terms, with the states as inputs."""
        return super().new_terms(UNBOUNDED_END if self.far else farthest)

    def topic_terms(
        self, terms: Terms, states: Sequence[Linear], *, errors: bool
    ) -> dict[int, Any]:
        """By topic: its value in these states, as in `CaseModel`, and the values of maps."""
        found = super().topic_terms(terms, states, errors=errors)
        for index in map_topics(self.facts):
            topic = self.facts.system.topics[index]
            if index in self.known:
                found[index] = self.known[index]
                continue
            ends = exact(-UNKNOWN_END), exact(UNKNOWN_END)
            every = [
                terms.add_input("box", name, *ends)
                for _, name, _ in named_leaves(topic.name, topic.type)
            ]
            found[index] = value_of_leaves(topic.type, every)
        return found


def read_rest_problem(
    flat: System, name: str, keeps: Mapping[str, Sequence[str]] = MappingProxyType({})
) -> RestProblem:
    """Reads the problem of the module called `name`; `keeps`: ranges of the floats SC keeps.

    Raises DiffersError if the module has no `rest`, NotRecheckedError if we do not support it,
    RejectedError if SC keeps other floats, or starts with a float outside of its range.
    """
    facts = read_facts(flat, name)
    facts.local_ranges = _local_ranges(facts, keeps)
    rest = facts.symbol.rest
    if rest is None:
        raise DiffersError(f"`{name}` has no `rest`")
    require_supported(facts, followed=True)
    _require_covered_features(facts)
    _require_maps_in_safe_only(facts, rest)
    setting = facts.setting
    if setting.release_with_state(0, setting.by_sc) != setting.sc.phase:
        check_start_answers(facts)
    sets = _state_sets(facts)
    facts.extents = tuple((max(a, -LARGEST), min(b, LARGEST)) for a, b in sets.values())
    states = _followed_states(facts, rest)
    facts.unbounded = {s for s in states if max(map(abs, sets[s])) > LARGEST}
    at = _estimate_leaves(facts)
    for s in states:
        if s not in at:
            raise NotRecheckedError(f"no topic that is read shows `{facts.states[s].name}`")
    _require_sc_topics_known(facts, {at[s][0] for s in states})
    drifts = _drift_ranges(facts, rest)
    within = int(const_value(facts, rest.within))
    leaves_of = {s: at[s] for s in states}
    maps = map_topics(facts)
    return RestProblem(
        facts,
        rest,
        within_ns=within,
        followed=states,
        leaves=leaves_of,
        sets=sets,
        drifts=drifts,
        maps=maps,
    )


def _local_ranges(facts: Facts, keeps: Mapping[str, Sequence[str]]) -> Ranges:
    found: dict[Variable, list[Range | None]] = {}
    left, node = dict(keeps), facts.sc.node
    for v, value in zip(node.locals if node else (), facts.sc.initial, strict=True):
        found[v] = []
        for (path, of), first in zip(leaves(v.type), scalar_leaves(value), strict=False):
            name = leaf_name(v.name, path)
            if not isinstance(of, FloatType):
                found[v].append(None)
                continue
            low, high = (number_from_hexadecimal(x, name) for x in left.pop(name, ("", "")))
            if not low <= first <= high:
                raise RejectedError(f"`{name}` begins outside of its range")
            found[v].append((low, high))
    if left:
        raise RejectedError(f"SC keeps no float `{min(left)}`")
    return found


def read_turns(problem: RestProblem, names: object) -> None:
    """Notes the angles that need not come back; RejectedError for a name that is no such angle.

    Raises NotRecheckedError if a rate jumps. Each angle is taken to be within three times `THIRD`,
    and all terms are read there.
    """
    facts = problem.facts
    by_name = {facts.states[s].name: s for s in problem.returning_states}
    if not isinstance(names, list) or not names or not by_name.keys() >= {*map(str, names)}:
        raise RejectedError("`wraps` names what is no angle without a set")
    facts.turning = {by_name[n] for n in names}
    if any(problem.sets[s] != (-inf, inf) for s in facts.turning):
        raise RejectedError("`wraps` names an angle whose topic has a set")
    facts.unbounded -= facts.turning
    far = dict.fromkeys(facts.turning, (-THIRD, THIRD))
    problem.sets |= far
    facts.extents = tuple(far.get(s, ends) for s, ends in enumerate(facts.extents))
    model = RestModel(facts, (), facts.extents)
    refuse_turns_read(model)
    terms, states = model.new_terms()
    rates, _ = model.rates(terms, states, new_command_terms(facts, terms))
    if any(terms.atoms[a].kind == "wrap_angle" for a in atoms_under(terms, rates)):
        raise NotRecheckedError("a rate that jumps beside an angle that turns")


def map_topics(facts: Facts) -> tuple[int, ...]:
    """The `static` topics that `safe` reads and that neither a plant nor the module publishes."""
    scope, driven = facts.module.scope.topics, driven_topics(facts)
    read = [scope[t] for t in topic_reads(facts.symbol.safe) if t.static]
    return tuple(i for i in read if i not in driven and i not in facts.module.outputs)


def _require_maps_in_safe_only(facts: Facts, rest: RestSymbol) -> None:
    """Raises NotRecheckedError if a map breaks condition 5 or 7, or if SC or `rest` reads it."""
    rest_reads = {facts.module.scope.topics[t] for t in topic_reads(rest.condition)}
    by_sc = {facts.sc.scope.topics[t] for t in topics_read_by_sc(facts.sc)}
    for index in map_topics(facts):
        topic = facts.system.topics[index]
        wrong = {
            "is read by SC": index in by_sc,
            "is read by `rest`": index in rest_reads,
            "has no age": topic.max_age_ns is None,
            "is a queue": topic.queue_of is not None,
            "is not made of floats": any(
                "[]" in path or not isinstance(of, FloatType) for path, of in leaves(topic.type)
            ),
        }
        for reason in (reason for reason, is_there in wrong.items() if is_there):
            raise NotRecheckedError(f"the map `{topic.name}` {reason}")


def _require_covered_features(facts: Facts) -> None:
    """Raises NotRecheckedError for a feature that condition 8 or our code excludes."""
    symbol = facts.symbol
    wrong = {
        "plants that move in steps": facts.kind != "flow",
        "parameters of the plants": bool(facts.parameters),
        "a fail-safe law": bool(symbol.failsafe),
        "an abstraction": bool(symbol.verify.abstracts),
        "modes of other modules": facts.reads_any_mode,
        "a grid": bool(symbol.verify.groups),
        "predicates of its own": symbol.ttf is not None or symbol.safer is not None,
    }
    for reason in (reason for reason, is_there in wrong.items() if is_there):
        raise NotRecheckedError(f"`rest` beside {reason}")


def shield_constants(problem: RestProblem) -> dict[str, int] | None:
    """The constants of the module's shield, by the program; None where it has no shield.

    NotRecheckedError, RejectedError where we know no argument for it. `any_command_ns`: what SC
    publishes passes once the next verdict is in force, Delta after the last good one at the
    earliest, and acts L_min later; the first output that is surely in time acts at H* - A.
    """
    facts = problem.facts
    if facts.symbol.shield is None:
        return None
    setting, derived = facts.setting, facts.derived
    cells, least = command_cells(facts), min(e.least for e in setting.effects)
    any_command = derived.h_star - derived.age - setting.dm.period - least
    return {
        "cells": cells,
        "acted_ns": command_memory_ns(facts),
        "any_command_ns": min(any_command, facts.times["H_ns"]),
    }


# ---------------------------------------------------------------- states


def states_shown(facts: Facts) -> dict[tuple[int, int], int]:
    """By (topic, leaf): the state that a plant publishes there unchanged."""
    found = {}
    for topic, (plant, expr) in driven_topics(facts).items():
        for k, (path, _) in enumerate(leaves(facts.system.topics[topic].type)):
            state = state_published(facts, plant, expr, path)
            if state is not None:
                found[topic, k] = state
    return found


def _state_sets(facts: Facts) -> dict[int, Range]:
    """The set of each state; (-inf, inf) where nothing bounds it.

    It is the declared set, less the error, of every topic that shows the state: a state in it can
    be published with any error, also once the sum is rounded.
    """
    ranges = dict.fromkeys(range(len(facts.states)), (-inf, inf))
    errors = {(m.topic, m.leaf): m.bound for c in facts.plants for m in c.measured}
    for (topic, k), s in states_shown(facts).items():
        bound = facts.system.topics[topic].bounds[k]
        if bound is not None:
            low, high = ranges[s]
            error = exact(errors.get((topic, k), 0.0))
            least, most = exact(float(bound.low)) + error, exact(float(bound.high)) - error
            ranges[s] = max(low, upper(least)), min(high, lower(most))
    return ranges


def _followed_states(facts: Facts, rest: RestSymbol) -> tuple[int, ...]:
    """The states on which SC, the conditions, or the rates of these states depend.

    Raises NotRecheckedError if the solution of another state might end in finite time.
    """
    model = RestModel(facts, (), facts.extents, far=False)
    terms, states = model.new_terms()
    asked: list[Linear | Proposition] = list(model.sc_commands(terms, states))
    conditions = state_constraint(model, terms, states)
    asked += [conditions, model.truth_of(terms, states, rest.condition, errors=False)]
    rates, _ = model.rates(terms, states, new_command_terms(facts, terms))
    asked += terms.obligations
    atoms = {x.atom: i for i, x in enumerate(states)}

    def states_under(roots: Iterable[Linear | Proposition]) -> set[int]:
        return {atoms[a] for a in input_atoms(terms, list(roots)) if a in atoms}

    found: set[int] = set()
    new = states_under(asked)
    while new - found:
        found |= new
        new = states_under(rates[s] for s in found)
    left = {i: x for i, x in enumerate(states) if i not in found}
    for i in left:
        if growth_degree(terms, rates[i], {x.atom for x in left.values()}) > 1:
            raise NotRecheckedError(f"`{facts.states[i].name}` is not followed, and may end")
    return tuple(sorted(found))


def cut_point(low: arb, high: arb) -> arb:
    """The number at which to cut a range: its middle; 0 or a geometric mean if it is very long."""
    far, near = abs(low).max(abs(high)), abs(low).min(abs(high)).max(ONE)
    if far < LARGEST / 2**60 and far < near * 2**20:
        return ((low + high) * HALF).mid()
    if low < 0 < high:
        return ZERO
    root = (far * near).sqrt().mid()
    return -root if high <= 0 else root


def may_be_anywhere(problem: RestProblem, states: AbstractSet[int]) -> bool:
    """Whether `rest` and the rates of `states` read only followed states outside of `states`.

    Then no claim about rest depends on where these states are, and no solution for them ends.
    """
    facts = problem.facts
    model = RestModel(facts, (), facts.extents, far=False)
    terms, every = model.new_terms()
    rates, _ = model.rates(terms, every, new_command_terms(facts, terms))
    bounded = {every[s].atom for s in problem.followed if s not in states}
    atoms = {x.atom for x in every}
    of_rest = model.truth_of(terms, every, problem.rest.condition, errors=False)
    read = {*input_atoms(terms, [of_rest, *(rates[s] for s in states)])} & atoms
    return read <= bounded


def state_constraint(model: CaseModel, terms: Terms, states: Sequence[Linear]) -> Proposition:
    """The proposition C: `safe` holds, and all that plants publish is in its declared set.

    Adds to `terms` the obligations without which the proposition is not defined.
    """
    held = model.truth_of(terms, states, model.facts.symbol.safe, errors=False)
    for topic in bounded_topics(model.facts):
        held = and_of(held, model.topic_in_set(terms, states, topic))
    return held


def _estimate_leaves(facts: Facts) -> dict[int, tuple[int, int]]:
    """By state: the topic and leaf in which the DM sees it, if possible a topic that SC reads."""
    by_dm, by_sc = (set(of) for of in topics_read(facts))
    known = [(at, s) for at, s in states_shown(facts).items() if at[0] in by_dm]
    return {s: at for at, s in sorted(known, key=lambda of: of[0][0] in by_sc)}


def _require_sc_topics_known(facts: Facts, estimate: set[int]) -> None:
    """Raises NotRecheckedError if SC sees a plant by a topic the DM does not read (condition 2).

    It also raises it if two topics show SC one state, as their ages and errors differ.
    """
    _, by_sc = topics_read(facts)
    seen = [state for (topic, _), state in states_shown(facts).items() if topic in by_sc]
    for state in seen:
        if seen.count(state) > 1:
            raise NotRecheckedError(f"SC sees `{facts.states[state].name}` twice")
    for topic in by_sc:
        if topic not in estimate:
            name = facts.system.topics[topic].name
            raise NotRecheckedError(f"SC sees the plant by `{name}`, which its DM does not read")


def _drift_ranges(facts: Facts, rest: RestSymbol) -> dict[int, Range]:
    """By state that `moves` names: how far down and how far up SC may move it."""
    found, known = {}, states_shown(facts)
    for move in rest.moves:
        topic = facts.module.scope.topics[move.topic]
        paths = [p for p, _ in leaves(move.topic.type)]
        state = known.get((topic, paths.index(move.path)))
        if state is None:
            raise NotRecheckedError(f"`{move.topic.name}` moves, and is no state")
        by = float(const_value(facts, move.by) or 0.0)
        assert 0.0 <= by < inf  # else V006
        found[state] = (inf if move.way == "up" else by, inf if move.way == "down" else by)
    return found
