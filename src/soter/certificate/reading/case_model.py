"""The re-checker's model of one case: what plant and SC do, as terms over the states.

Purpose: `CaseModel` reads, for one combination of parameter values (a *case*), the driven topics,
SC's commands, the predicates, and the derivative or next state off the checked tree, as terms.
Non-goals: time (`linear_flows.py`, `grid/sc_chains.py`), sets.

The argument: a term stands for every value that an expression may have. The states and whatever
else is not known (disturbances, errors, what others publish) are inputs with their ranges; what
must hold for an expression to have a value at all is an obligation, asked where the term is used.
One that is not certain there fails what is tried: a box is tried in smaller parts, the claim about
a cell that is left is rejected; what is asked of the whole grid at once is not re-checked.

Terms are made for states on three times the width of the grid, and what was decided of them holds
there. That is enough: states enter a chain in a cell, at the end of each hold its boxes were seen
to lie in cells, and in between solutions are continuous. Solutions of this model stay in the grid,
so a term is never used outside the range it was made for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from soter.certificate.extras import extras
from soter.certificate.reading.module_facts import driven_topics, reads_mode, topics_of_others
from soter.certificate.reading.symbolic_reading import Surroundings, SymbolicReader, variables_read
from soter.certificate.reading.symbolic_values import as_truth, scalar_leaves, value_of_leaves
from soter.certificate.report import NotRecheckedError
from soter.certificate.terms.linear_enclosures import ONE, exact, greatest_below
from soter.certificate.terms.terms import TRUE, Linear, Proposition, Terms, and_of, negation
from soter.language.evaluate.arithmetic import seconds
from soter.language.model.tree_walk import topic_reads
from soter.language.model.typed import TopicRead
from soter.language.model.types import BoolType, leaves

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from flint import arb

    from soter.certificate.reading.module_facts import Facts, Input
    from soter.certificate.reading.symbolic_reading import Ranges
    from soter.language.model import typed
    from soter.language.model.system import Component


LEFT_OUT = "left out: "
FARTHEST = exact(2.0**1000)
"""No state is farther out than that: a sum of two such numbers is still a double."""


@dataclass(eq=False)
class CaseModel:
    """Makes the terms of a case. `extents`: each state's grid; terms hold on thrice its width."""

    facts: Facts
    parameter: tuple[int, ...]
    extents: tuple[tuple[float, float], ...]

    def new_terms(self, farthest: arb | None = None) -> tuple[Terms, list[Linear]]:
        """New terms, and the states in them; states on axes without ends reach to `farthest`."""
        terms = Terms()
        states = []
        for i, (s, (low, high)) in enumerate(zip(self.facts.states, self.extents, strict=True)):
            a, b = exact(low), exact(high)
            ends = a - (b - a), b + (b - a)
            if farthest is not None and i in self.facts.unbounded:
                ends = -farthest, farthest
            if i in self.facts.turning:
                terms.turning.add(len(terms.atoms))
            states.append(terms.add_input("state", s.name, *ends))
        return terms, states

    # ------------------------------------------------------------ plants

    def _state_values(
        self, terms: Terms, c: Component, values: Sequence[Linear]
    ) -> dict[typed.Variable, Any]:
        """The values of a plant's states: terms, parameters, or any number if left out."""
        assert c.plant is not None
        known: dict[tuple[int, str, int], Any] = {
            (s.owner, s.variable, s.leaf): x for s, x in zip(self.facts.states, values, strict=True)
        }
        for p, v in zip(self.facts.parameters, self.parameter, strict=True):
            known[p.owner, p.variable, p.leaf] = v
        for s in self.facts.left_out:
            name = f"{LEFT_OUT}{s.name}"
            known[s.owner, s.variable, s.leaf] = terms.add_input("box", name, -FARTHEST, FARTHEST)
        value_by_variable: dict[typed.Variable, Any] = {}
        for variable in c.plant.states:
            parts = []
            for k, (_, of) in enumerate(leaves(variable.type)):
                value = known[c.index, variable.name, k]
                parts.append(bool(value) if isinstance(of, BoolType) else value)
            value_by_variable[variable] = value_of_leaves(variable.type, parts)
        return value_by_variable

    def _add_let_values(
        self, reader: SymbolicReader, c: Component, variables: dict[typed.Variable, Any]
    ) -> dict[typed.Variable, Any]:
        assert c.plant is not None
        for variable, expr in c.plant.lets:
            known = all(v in variables for v in variables_read(expr))
            if known and topic_reads(expr).keys() <= reader.surroundings.topics.keys():
                variables[variable] = reader.evaluate(expr, variables)
        return variables

    def topic_terms(
        self, terms: Terms, states: Sequence[Linear], *, errors: bool
    ) -> dict[int, Any]:
        """The value of each topic in these states; with `errors`, sensor errors are added.

        Topics of others have any value of their sets. A topic that a plant copies from a command is
        missing; raises NotRecheckedError if a plant computes it from a command in another way.
        """
        value_by_topic: dict[int, Any] = {}
        for index, (c, expr) in driven_topics(self.facts).items():
            if commands := topic_reads(expr):
                topic = self.facts.system.topics[index]
                measured = any(m.topic == index for m in c.measured)  # the sum may be no number
                if type(expr) is TopicRead and not measured and not any(topic.bounds):
                    continue  # a copy, which never faults; whoever reads it is not re-checked
                name, read = topic.name, next(iter(commands)).name
                raise NotRecheckedError(
                    f"plant `{c.name}` publishes `{name}` made of `{read}`, which it reads: let a"
                    " node publish that"
                )
            reader = SymbolicReader(terms, Surroundings(c.scope.params, {}, seconds(c.period_ns)))
            variables = self._add_let_values(reader, c, self._state_values(terms, c, states))
            value = reader.evaluate(expr, variables)
            if errors:
                value = self._with_errors(terms, index, value)
            value_by_topic[index] = value
        for index in dict.fromkeys(x.owner for x in self.facts.others):
            if index not in value_by_topic:
                parts = new_input_terms(terms, (x for x in self.facts.others if x.owner == index))
                value_by_topic[index] = value_of_leaves(self.facts.system.topics[index].type, parts)
        return value_by_topic

    def _with_errors(self, terms: Terms, index: int, value: Any) -> Any:  # noqa: ANN401
        """A topic's value plus its errors; each sum of value and error is rounded once."""
        parts = scalar_leaves(value)
        for e in (e for e in self.facts.errors if e.owner == index):
            x = parts[e.leaf]
            (error,) = new_input_terms(terms, [e])
            x = terms.constant(x) if isinstance(x, float) else x
            parts[e.leaf] = terms.rounded_term(terms.add(x, error))
        return value_of_leaves(self.facts.system.topics[index].type, parts)

    # ------------------------------------------------------------ SC and predicates

    def sc_commands(self, terms: Terms, states: Sequence[Linear]) -> list[Linear]:
        """The terms of what SC publishes when it reads these states, for any locals and modes.

        Adds obligations: SC's step does not fault, and each command is in its set. Raises
        NotRecheckedError if a step may publish no command.
        """
        sc = self.facts.sc
        assert sc.node is not None
        values = self.topic_terms(terms, states, errors=True)
        known = {t: values[i] for t, i in sc.scope.topics.items() if i in values}
        with_modes = partial(sc_step_reader, terms, sc, known)
        if sc.node.locals or reads_mode(sc.node.step):
            published = list(
                extras.sc_locals_and_modes.published_in_every_step(
                    terms, sc.node, with_modes, self.facts.local_ranges
                )
            )
        else:
            published = [with_modes({})({})]
        return [command_term(terms, control, published) for control in self.facts.controls]

    def truth_of(
        self, terms: Terms, states: Sequence[Linear], expr: typed.TypedExpr, *, errors: bool
    ) -> Proposition:
        """A predicate of the module as a proposition, on true topics or on estimates (`errors`)."""
        values = self.topic_terms(terms, states, errors=errors)
        scope = self.facts.module.scope
        known = {t: values[i] for t, i in scope.topics.items() if i in values}
        modes = extras.sc_locals_and_modes.mode_inputs(terms, [expr]) if reads_mode([expr]) else {}
        return as_truth(
            SymbolicReader(terms, Surroundings(scope.params, known, modes=modes)).evaluate(expr)
        )

    def published_limits(
        self, terms: Terms, states: Sequence[Linear], topic: int
    ) -> list[tuple[Linear, float, float]]:
        """The bounded numbers that a plant publishes on a topic, with least and greatest values.

        The sum of value and error is rounded once, which is monotone: the sum is in the declared
        set exactly if the value is between these two.
        """
        declared = self.facts.system.topics[topic]
        parts = scalar_leaves(self.topic_terms(terms, states, errors=False)[topic])
        measured = [m for c in self.facts.plants for m in c.measured if m.topic == topic]
        errors = {m.leaf: m.bound for m in measured}
        limits = []
        for k, (x, bound) in enumerate(zip(parts, declared.bounds, strict=True)):
            if bound is None or isinstance(x, (bool, Proposition)):
                continue
            value = x if isinstance(x, Linear) else terms.constant(float(x))
            high = greatest_below(float(bound.high), errors.get(k, 0.0))
            low = -greatest_below(-float(bound.low), errors.get(k, 0.0))
            limits.append((value, low, high))
        return limits

    def topic_in_set(self, terms: Terms, states: Sequence[Linear], topic: int) -> Proposition:
        """The proposition that each estimate which a plant publishes on a topic is in its set."""
        joined = TRUE
        for value, low, high in self.published_limits(terms, states, topic):
            short = value if low == 0.0 else terms.combine(((ONE, value),), -exact(low))
            below = terms.below_zero(short)
            beyond = terms.below_zero(terms.combine(((-ONE, value),), exact(high)))
            joined = and_of(joined, and_of(negation(below), negation(beyond)))
        return joined

    # ------------------------------------------------------------ plants in time

    def rates(
        self, terms: Terms, states: Sequence[Linear], controls: Sequence[Linear]
    ) -> tuple[list[Linear], list[Linear]]:
        """The derivatives of all states as real numbers, and the disturbances in them."""
        return self._rates_or_next_states(terms, states, controls, self.facts.states, rounded=False)

    def rates_of_left_out_states(
        self, terms: Terms, states: Sequence[Linear], controls: Sequence[Linear]
    ) -> list[Linear]:
        """The derivatives of the left-out states, for any values of these states."""
        return self._rates_or_next_states(
            terms, states, controls, self.facts.left_out, rounded=False
        )[0]

    def next_states(
        self, terms: Terms, states: Sequence[Linear], controls: Sequence[Linear]
    ) -> list[Linear]:
        """The next value of every state of a map, as the machine computes it."""
        return self._rates_or_next_states(terms, states, controls, self.facts.states, rounded=True)[
            0
        ]

    def _inputs_from_others(
        self, terms: Terms, c: Component, topic: typed.TopicSymbol
    ) -> list[Linear]:
        inputs = (x for x in self.facts.disturbances if x.of_others and x.owner == c.index)
        return new_input_terms(terms, (x for x in inputs if x.variable == topic.name))

    def _rates_or_next_states(
        self,
        terms: Terms,
        states: Sequence[Linear],
        controls: Sequence[Linear],
        wanted: Sequence[Input],
        *,
        rounded: bool,
    ) -> tuple[list[Linear], list[Linear]]:
        flow = self.facts.kind == "flow"
        members = {(s.owner, s.variable) for s in wanted}
        by_leaf: dict[tuple[int, str, int], Linear] = {}
        disturbances = []
        for c in self.facts.plants:
            assert c.plant is not None
            variables = self._state_values(terms, c, states)
            for d in c.disturbances:
                name, low, high = d.variable.name, exact(d.low), exact(d.high)
                parts = [terms.add_input("box", name, low, high) for _ in leaves(d.variable.type)]
                disturbances += parts
                variables[d.variable] = value_of_leaves(d.variable.type, parts)
            topics = self._commands_to_plant(c, controls)
            for symbol in topics_of_others(c, self.facts.module):
                parts = self._inputs_from_others(terms, c, symbol)
                disturbances += parts
                topics[symbol] = value_of_leaves(symbol.type, parts)
            around = Surroundings(c.scope.params, topics, seconds(c.period_ns))
            reader = SymbolicReader(terms, around, rounded=rounded)
            reader.operations.everywhere = not rounded
            self._add_let_values(reader, c, variables)
            moves = c.plant.der if flow else c.plant.next
            for variable, expr in moves.items():
                if (c.index, variable.name) not in members:
                    continue
                for k, x in enumerate(scalar_leaves(reader.evaluate(expr, variables))):
                    value = x if not isinstance(x, (int, float)) else terms.constant(float(x))
                    by_leaf[c.index, variable.name, k] = value
        motions = []
        for k, s in enumerate(wanted):
            still = terms.constant(0.0) if flow else states[k]
            motions.append(by_leaf.get((s.owner, s.variable, s.leaf), still))
        return motions, disturbances

    def _commands_to_plant(
        self, c: Component, controls: Sequence[Linear]
    ) -> dict[typed.TopicSymbol, Any]:
        value_by_topic: dict[typed.TopicSymbol, Any] = {}
        assert c.plant is not None
        of_others = topics_of_others(c, self.facts.module)
        pairs = list(zip(self.facts.controls, controls, strict=True))
        for topic in (t for t in c.plant.reads if t not in of_others):
            parts = [x for s, x in pairs if s.owner == c.scope.topics[topic]]
            if not parts:
                raise NotRecheckedError(
                    f"plant `{c.name}` reads `{topic.name}`, which is no output of the module"
                )
            value_by_topic[topic] = value_of_leaves(topic.type, parts)
        return value_by_topic


def sc_step_reader(
    terms: Terms,
    sc: Component,
    known: Mapping[typed.TopicSymbol, Any],
    modes: Mapping[Any, Any],
    claimed: Ranges = MappingProxyType({}),
) -> Callable[[Mapping[typed.Variable, Any]], dict[int, Any]]:
    """A function that reads a step of SC: from values of the locals to SC's publications.

    `claimed`: ranges in which the step and `on takeover` must leave floats, as obligations.
    """
    around = Surroundings(sc.scope.params, known, seconds(sc.period_ns), modes=modes)
    reader = SymbolicReader(terms, around)

    def read_step(values_of_locals: Mapping[typed.Variable, Any]) -> dict[int, Any]:
        assert sc.node is not None
        if sc.node.takeover is not None:
            reader.published_by_step(sc.node.takeover, values_of_locals, claimed)
        found = reader.published_by_step(sc.node.step, values_of_locals, claimed)
        return {sc.scope.topics[t]: v for t, v in found.items()}

    return read_step


def command_term(terms: Terms, control: Input, published: Sequence[Mapping[int, Any]]) -> Linear:
    """The term for a command that any of these steps publishes; its set becomes an obligation.

    Raises NotRecheckedError if a step publishes no command.
    """
    alternatives = []
    for by_index in published:
        if control.owner not in by_index:
            raise NotRecheckedError(f"SC does not publish `{control.name}` in every step")
        value = scalar_leaves(by_index[control.owner])[control.leaf]
        alternatives.append(terms.constant(value) if isinstance(value, float) else value)
    command = (
        alternatives[0]
        if len(alternatives) == 1
        else extras.sc_locals_and_modes.any_alternative(terms, alternatives)
    )
    low = terms.combine(((ONE, command),), -exact(control.low))
    high = terms.combine(((-ONE, command),), exact(control.high))
    terms.add_obligation(negation(terms.below_zero(low)))
    terms.add_obligation(negation(terms.below_zero(high)))
    return command


def new_input_terms(terms: Terms, inputs: Iterable[Input]) -> list[Linear]:
    """New terms for inputs; each input may have any value in its range."""
    return [terms.add_input("box", x.name, exact(x.low), exact(x.high)) for x in inputs]


def new_command_terms(facts: Facts, terms: Terms) -> list[Linear]:
    """New terms for commands, which may have any value in their sets."""
    return new_input_terms(terms, facts.controls)


def ends_of_other_states(
    model: CaseModel, states: Sequence[Linear], members: Sequence[int]
) -> dict[int, tuple[arb, arb]]:
    """Maps the atom of each state that is not in `members` to the ends of its grid."""
    range_by_atom = {}
    for i, x in enumerate(states):
        if i not in members:
            low, high = model.extents[i]
            range_by_atom[x.atom] = (exact(low), exact(high))
    return range_by_atom
