"""What plant and SC of one case do, as terms over the states.

Purpose: `CaseModel`: for one combination of parameter values the driven topics, the commands of SC,
the predicates, and the derivative or the next state, each read off the checked tree.
Non-goals: time (`linear_flows.py`, `map_steps.py`), sets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from soter.certificate.reading.modes_of_other_modules import any_mode, every_mode
from soter.certificate.reading.module_facts import driven_topics, topics_of_others
from soter.certificate.reading.sc_locals import combinations, one_of
from soter.certificate.reading.symbolic_reading import Surroundings, SymbolicReader, variables_in
from soter.certificate.reading.symbolic_values import filled, flat, truth_of
from soter.certificate.terms.arb_balls import ONE, exact, greatest_below
from soter.certificate.terms.terms import (
    TRUE,
    Linear,
    NotRecheckedError,
    Proposition,
    Terms,
    both,
    negation,
)
from soter.language.evaluate import arithmetic
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import BoolType, FloatType, leaves

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from flint import arb

    from soter.certificate.reading.module_facts import Facts, Input
    from soter.language.model import typed
    from soter.language.model.system import Component


@dataclass(eq=False)
class CaseModel:
    """Terms of one case. `extents`: the grid of each state; terms hold on twice that width."""

    facts: Facts
    parameter: tuple[int, ...]
    extents: tuple[tuple[float, float], ...]

    def new_terms(self, farthest: arb | None = None) -> tuple[Terms, list[Linear]]:
        """Fresh terms, and the states in them; those whose axis has no ends up to `farthest`."""
        terms = Terms()
        states = []
        for i, (s, (low, high)) in enumerate(zip(self.facts.states, self.extents, strict=True)):
            a, b = exact(low), exact(high)
            if farthest is not None and i in self.facts.unbounded:
                states.append(terms.input("state", s.name, -farthest, farthest))
                continue
            states.append(terms.input("state", s.name, a - (b - a), b + (b - a)))
        return terms, states

    # ------------------------------------------------------------ plants

    def _variables(
        self, c: Component, values: Sequence[Linear], extra: Mapping[typed.Variable, Any]
    ) -> dict[typed.Variable, Any]:
        """The states of a plant: some are inputs, some parameters."""
        assert c.plant is not None
        value_by_variable: dict[typed.Variable, Any] = dict(extra)
        by_state = {
            (s.owner, s.variable, s.leaf): x for s, x in zip(self.facts.states, values, strict=True)
        }
        by_parameter = {
            (p.owner, p.variable, p.leaf): v
            for p, v in zip(self.facts.parameters, self.parameter, strict=True)
        }
        for variable in c.plant.states:
            parts: list[Any] = []
            for k, (_, of) in enumerate(leaves(variable.type)):
                key = (c.index, variable.name, k)
                if isinstance(of, FloatType):
                    parts.append(by_state[key])
                else:
                    value = by_parameter[key]
                    parts.append(bool(value) if isinstance(of, BoolType) else value)
            value_by_variable[variable] = filled(variable.type, parts)
        return value_by_variable

    def _with_lets(
        self, reader: SymbolicReader, c: Component, variables: dict[typed.Variable, Any]
    ) -> dict[typed.Variable, Any]:
        assert c.plant is not None
        for variable, expr in c.plant.lets:
            known = all(v in variables for v in variables_in(expr))
            if known and topic_reads(expr).keys() <= reader.around.topics.keys():
                variables[variable] = reader.expression(expr, variables)
        return variables

    def topics(self, terms: Terms, states: Sequence[Linear], *, errors: bool) -> dict[int, Any]:
        """The driven topics in these states; as estimates where `errors`. Then others, too."""
        value_by_topic: dict[int, Any] = {}
        for index, (c, expr) in driven_topics(self.facts).items():
            around = Surroundings(c.scope.params, {}, _seconds(c.period_ns))
            reader = SymbolicReader(terms, around)
            variables = self._with_lets(reader, c, self._variables(c, states, {}))
            value = reader.expression(expr, variables)
            if errors:
                value = self._with_errors(terms, index, value)
            value_by_topic[index] = value
        for other in self.facts.others:
            if other.owner not in value_by_topic:
                value_by_topic[other.owner] = self._free_topic(
                    terms, other.owner, self.facts.others
                )
        return value_by_topic

    def _with_errors(self, terms: Terms, index: int, value: Any) -> Any:  # noqa: ANN401
        parts = flat(value)
        for e in self.facts.errors:
            if e.owner != index:
                continue
            error = terms.input("box", e.name, exact(e.low), exact(e.high))
            x = parts[e.leaf]
            if isinstance(x, float):
                x = terms.constant(x)
            parts[e.leaf] = terms.rounded(terms.add(x, error))
        return filled(self.facts.system.topics[index].type, parts)

    def _free_topic(self, terms: Terms, index: int, inputs: Sequence[Input]) -> Any:  # noqa: ANN401
        parts = [
            terms.input("box", x.name, exact(x.low), exact(x.high))
            for x in inputs
            if x.owner == index
        ]
        return filled(self.facts.system.topics[index].type, parts)

    # ------------------------------------------------------------ SC and predicates

    def commands(self, terms: Terms, states: Sequence[Linear]) -> list[Linear]:
        """What SC publishes after a sample of these states, whatever its locals and others' modes.

        Obligations are those of its step, for every value of its locals and of every mode.
        NotRecheckedError where a step may publish no command.
        """
        sc = self.facts.sc
        assert sc.node is not None
        values = self.topics(terms, states, errors=True)
        known = {t: values[i] for t, i in sc.scope.topics.items() if i in values}
        published = []
        for modes in every_mode(sc.node.step):
            around = Surroundings(sc.scope.params, known, _seconds(sc.period_ns), modes=modes)
            reader = SymbolicReader(terms, around)
            published += [
                {sc.scope.topics[t]: v for t, v in reader.step(sc.node.step, known_locals).items()}
                for known_locals in combinations(terms, sc.node.locals)
            ]
        commands = []
        for control in self.facts.controls:
            alternatives = []
            for by_index in published:
                if control.owner not in by_index:
                    raise NotRecheckedError(f"SC does not publish `{control.name}` in every step")
                value = flat(by_index[control.owner])[control.leaf]
                alternatives.append(terms.constant(value) if isinstance(value, float) else value)
            command = one_of(terms, alternatives)
            low = terms.combine(((ONE, command),), -exact(control.low))
            high = terms.combine(((-ONE, command),), exact(control.high))
            terms.oblige(negation(terms.below(low)))
            terms.oblige(negation(terms.below(high)))
            commands.append(command)
        return commands

    def predicate(
        self, terms: Terms, states: Sequence[Linear], expr: typed.TypedExpr, *, errors: bool
    ) -> Proposition:
        """A predicate of the module, on the true topics or on estimates."""
        values = self.topics(terms, states, errors=errors)
        scope = self.facts.module.scope
        known = {t: values[i] for t, i in scope.topics.items() if i in values}
        modes = any_mode(terms, [expr])
        reader = SymbolicReader(terms, Surroundings(scope.params, known, modes=modes))
        value = reader.expression(expr)
        return truth_of(value)

    def limits(
        self, terms: Terms, states: Sequence[Linear], topic: int
    ) -> list[tuple[Linear, float, float]]:
        """Each bounded number that a plant publishes on a topic, and the least and the greatest.

        The sum of value and error is rounded once, and rounding is monotone: it lies in [low, high]
        exactly where the value lies between the least and the greatest number of which it does.
        """
        declared = self.facts.system.topics[topic]
        parts = flat(self.topics(terms, states, errors=False)[topic])
        errors = dict.fromkeys(range(len(parts)), 0.0)
        for c in self.facts.plants:
            errors.update({m.leaf: m.bound for m in c.measured if m.topic == topic})
        limits = []
        for k, (x, bound) in enumerate(zip(parts, declared.bounds, strict=True)):
            if bound is None or isinstance(x, (bool, Proposition)):
                continue
            value = x if isinstance(x, Linear) else terms.constant(float(x))
            high = greatest_below(float(bound.high), errors[k])
            low = -greatest_below(-float(bound.low), errors[k])
            limits.append((value, low, high))
        return limits

    def in_set(self, terms: Terms, states: Sequence[Linear], topic: int) -> Proposition:
        """That every estimate which a plant publishes on a topic lies in its declared set."""
        conjunction = TRUE
        for value, low, high in self.limits(terms, states, topic):
            short = value if low == 0.0 else terms.combine(((ONE, value),), -exact(low))
            below = terms.below(short)
            beyond = terms.below(terms.combine(((-ONE, value),), exact(high)))
            conjunction = both(conjunction, both(negation(below), negation(beyond)))
        return conjunction

    # ------------------------------------------------------------ plants in time

    def rates(
        self, terms: Terms, states: Sequence[Linear], controls: Sequence[Linear]
    ) -> tuple[list[Linear], list[Linear]]:
        """The derivative of every state as a real number, and the disturbances in it."""
        return self._moved(terms, states, controls, rounded=False)

    def next_states(
        self, terms: Terms, states: Sequence[Linear], controls: Sequence[Linear]
    ) -> list[Linear]:
        """The next value of every state of a map, as the machine computes it."""
        return self._moved(terms, states, controls, rounded=True)[0]

    def _moved(
        self, terms: Terms, states: Sequence[Linear], controls: Sequence[Linear], *, rounded: bool
    ) -> tuple[list[Linear], list[Linear]]:
        flow = self.facts.kind == "flow"
        by_leaf: dict[tuple[int, str, int], Linear] = {}
        disturbances = []
        for c in self.facts.plants:
            assert c.plant is not None
            extra = {}
            for d in c.disturbances:
                parts = []
                for _ in leaves(d.variable.type):
                    x = terms.input("box", d.variable.name, exact(d.low), exact(d.high))
                    disturbances.append(x)
                    parts.append(x)
                extra[d.variable] = filled(d.variable.type, parts)
            topics = self._inputs_of_plant(c, controls)
            for symbol in topics_of_others(c, self.facts.module):
                of_others = [
                    terms.input("box", x.name, exact(x.low), exact(x.high))
                    for x in self.facts.disturbances
                    if x.of_others and (x.owner, x.variable) == (c.index, symbol.name)
                ]
                disturbances += of_others
                topics[symbol] = filled(symbol.type, of_others)
            around = Surroundings(c.scope.params, topics, _seconds(c.period_ns))
            reader = SymbolicReader(terms, around, rounded=rounded)
            variables = self._with_lets(reader, c, self._variables(c, states, extra))
            moves = c.plant.der if flow else c.plant.next
            for variable, expr in moves.items():
                for k, x in enumerate(flat(reader.expression(expr, variables))):
                    value = x if not isinstance(x, (int, float)) else terms.constant(float(x))
                    by_leaf[c.index, variable.name, k] = value
        motions = []
        for s, x in zip(self.facts.states, states, strict=True):
            still = terms.constant(0.0) if flow else x
            motions.append(by_leaf.get((s.owner, s.variable, s.leaf), still))
        return motions, disturbances

    def _inputs_of_plant(
        self, c: Component, controls: Sequence[Linear]
    ) -> dict[typed.TopicSymbol, Any]:
        value_by_topic: dict[typed.TopicSymbol, Any] = {}
        assert c.plant is not None
        for topic in c.plant.reads:
            if topic in topics_of_others(c, self.facts.module):
                continue
            index = c.scope.topics[topic]
            parts = [
                x for s, x in zip(self.facts.controls, controls, strict=True) if s.owner == index
            ]
            if not parts:
                raise NotRecheckedError(
                    f"plant `{c.name}` reads `{topic.name}`, which is no output of the module"
                )
            value_by_topic[topic] = filled(topic.type, parts)
        return value_by_topic


def control_inputs(facts: Facts, terms: Terms) -> list[Linear]:
    """Commands that may be anything in their sets."""
    return [terms.input("box", c.name, exact(c.low), exact(c.high)) for c in facts.controls]


def _seconds(period_ns: int) -> float:
    return arithmetic.seconds(period_ns)
