"""Finds the inputs of a verification problem with their ranges, and the errors of estimates.

Purpose: `inputs_of` finds the states, controls, disturbances, errors, others and parameters of a
verification system (docs/verification.md, section 1), and reports what the program leaves open.
`errors_by_state` gives the largest error of each state's estimate, `topics_seen_by_dm` the topic
that shows the state to the DM.
Non-goals: grids (`axes.py`), enclosures (`verify/enclose/compiled_enclosures.py`), sets of
estimates (`grid/estimate_sets.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from soter.language.elaborate.views_for_proofs import start_of_proof_plant
from soter.language.model.tree_walk import topic_reads
from soter.language.model.types import BoolType, EnumType, FloatType, IntType, leaf_name, leaves
from soter.verify.enclose.enclosed_operations import FAR_TURNS
from soter.verify.problem.problem import DiscreteParameter, Interval, Leaf, Quantities
from soter.verify.problem.supported_constructs import ttf_of_states
from soter.verify.problem.verification_system import read_by_dm, topics_read_in_step

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.model import typed
    from soter.language.model.system import Component
    from soter.language.model.typed import TopicSymbol
    from soter.language.model.types import Type, Value
    from soter.verify.problem.problem import Problem
    from soter.verify.problem.verification_system import VerificationSystem


PARAMETER_VALUES_MAX = 4096


@dataclass(eq=False)
class Inputs:
    """The leaves of all inputs, with their ranges, in the order of `Quantities`."""

    states: list[Leaf] = field(default_factory=list)
    initial: list[Interval] = field(default_factory=list)
    controls: list[Leaf] = field(default_factory=list)
    control_ranges: list[Interval] = field(default_factory=list)
    disturbances: list[Leaf] = field(default_factory=list)
    disturbance_ranges: list[Interval] = field(default_factory=list)
    errors: list[Leaf] = field(default_factory=list)
    error_ranges: list[Interval] = field(default_factory=list)
    others: list[Leaf] = field(default_factory=list)
    other_ranges: list[Interval] = field(default_factory=list)
    parameter_leaves: list[Leaf] = field(default_factory=list)
    parameters: list[DiscreteParameter] = field(default_factory=list)
    parameter_starts: list[tuple[int, ...]] = field(default_factory=list)
    still: set[int] = field(default_factory=set)
    """The states that never change: constants of a run, over their initial range."""
    left_out: list[Leaf] = field(default_factory=list)
    """States that no claim depends on (`left_out_states.py`)."""

    def without_states(self, left_out: Collection[int]) -> Inputs:
        """A copy without the states numbered in `left_out`; it keeps only a note of them."""
        kept = [s for s in range(len(self.states)) if s not in left_out]
        return replace(
            self,
            states=[self.states[s] for s in kept],
            initial=[self.initial[s] for s in kept],
            still={k for k, s in enumerate(kept) if s in self.still},
            left_out=[self.states[s] for s in sorted(left_out)],
        )

    def quantities(self) -> Quantities:
        """Only the leaves, in the order in which the emitted functions take them."""
        return Quantities(
            tuple(self.states),
            tuple(self.controls),
            tuple(self.disturbances),
            tuple(self.errors),
            tuple(self.others),
            tuple(self.parameter_leaves),
        )


def inputs_of(place: VerificationSystem, diagnostics: Diagnostics) -> Inputs:
    """All inputs of a verification system; some may be missing if errors are reported."""
    inputs = Inputs()
    for c in place.plants:
        _add_states(c, _start_in_run(place, c), inputs, diagnostics)
    _add_outputs(place, inputs, diagnostics)
    for c in place.plants:
        _add_disturbances(c, inputs, diagnostics)
    _add_errors(place, inputs)
    _add_other_topics(place, inputs, diagnostics)
    return inputs


def _start_in_run(place: VerificationSystem, c: Component) -> tuple[Value, ...] | None:
    """The initial values of a proof's plant in a run; None if these values are not known."""
    for link in place.module.symbol.verify.abstracts if place.abstract else ():
        if link.name == c.name:
            return start_of_proof_plant(place.flat, place.home, link)
    return None


def _add_states(
    c: Component, mapped: tuple[Value, ...] | None, inputs: Inputs, diagnostics: Diagnostics
) -> None:
    """Adds a plant's states to `inputs`; `mapped` has their values at a run's start, or None."""
    plant = c.plant
    assert plant is not None
    variables = zip(plant.states, c.initial, c.initial_range, mapped or c.initial, strict=True)
    for variable, initial, drawn, start in variables:
        moves = variable in plant.der or variable in plant.next
        for (path, t), value, value_in_run in zip(
            leaves(variable.type),
            scalar_leaves(variable.type, initial),
            scalar_leaves(variable.type, start),
            strict=False,
        ):
            name = leaf_name(f"{c.name}.{variable.name}", path)
            unit = t.unit if isinstance(t, FloatType) else ""
            leaf = Leaf(c.index, variable.name, path, name, unit)
            if "[]" in path:
                _refuse_non_float("state", name, variable.type, variable.span, diagnostics)
            elif isinstance(t, FloatType):
                inputs.states.append(leaf)
                low, high = drawn or (value, value)
                if mapped is not None:
                    low, high = min(low, value_in_run), max(high, value_in_run)
                inputs.initial.append(Interval(low, high))
                if not moves:
                    inputs.still.add(len(inputs.states) - 1)
            elif moves:
                diagnostics.error(
                    "R014",
                    f"the state `{name}` moves and is no `float`",
                    variable.span,
                    f"its type is `{t}`",
                    notes=("sets are computed over floats; other states must not change",),
                    helps=("make it a `float`, or leave it to a plant that is not verified",),
                )
            else:
                _add_parameter(leaf, t, variable.span, inputs, diagnostics)
                starts = {int(value), int(value_in_run)}
                inputs.parameter_starts.append(tuple(sorted(starts)))


def _add_parameter(
    leaf: Leaf, t: Type, span: Span, inputs: Inputs, diagnostics: Diagnostics
) -> None:
    """Adds a parameter, a discrete state that never changes; each value needs a separate proof."""
    values: tuple[int, ...] = ()
    if isinstance(t, BoolType):
        values = (0, 1)
    elif isinstance(t, EnumType):
        values = tuple(range(len(t.members)))
    elif isinstance(t, IntType) and t.high - t.low < PARAMETER_VALUES_MAX:
        values = tuple(range(t.low, t.high + 1))
    if not values:
        diagnostics.error(
            "R014",
            f"the parameter `{leaf.name}` has too many values",
            span,
            f"its type is `{t}`",
            notes=(f"everything is proved for each of at most {PARAMETER_VALUES_MAX} values",),
            helps=("give it a range: `int in [0, 9]`",),
        )
        return
    inputs.parameter_leaves.append(leaf)
    inputs.parameters.append(DiscreteParameter(leaf.name, values))


def scalar_leaves(t: Type, value: Value) -> Iterator[Value]:
    """The scalars of a value, in the order in which `leaves` gives their types."""
    if isinstance(value, tuple):
        fields = getattr(t, "fields", None)
        parts = [f for _, f in fields] if fields is not None else [t.element] * len(value)  # type: ignore[attr-defined]
        for part, inner in zip(parts, value, strict=True):
            yield from scalar_leaves(part, inner)
    else:
        yield value


def _add_disturbances(c: Component, inputs: Inputs, diagnostics: Diagnostics) -> None:
    for d in c.disturbances:
        for path, t in leaves(d.variable.type):
            name = leaf_name(f"{c.name}.{d.variable.name}", path)
            if not isinstance(t, FloatType):
                _refuse_non_float("disturbance", name, t, d.variable.span, diagnostics)
                continue
            inputs.disturbances.append(Leaf(c.index, d.variable.name, path, name, t.unit))
            inputs.disturbance_ranges.append(Interval(d.low, d.high))


def _refuse_non_float(kind: str, name: str, t: Type, span: Span, diagnostics: Diagnostics) -> None:
    diagnostics.error(
        "R014",
        f"the {kind} `{name}` is no `float`",
        span,
        f"its type is `{t}`",
        notes=("sets are computed over floats",),
        helps=("make it a `float`: who chooses among whole numbers publishes `float(n)`",),
    )


def _float_leaves_of_topic(
    place: VerificationSystem, index: int, kind: str, diagnostics: Diagnostics
) -> Iterator[tuple[Leaf, Interval | None]]:
    topic = place.system.topics[index]
    for (path, t), bound in zip(leaves(topic.type), topic.bounds, strict=True):
        name = leaf_name(topic.name, path)
        if not isinstance(t, FloatType) or any(part in ("[]", "[*]") for part in path):
            _refuse_non_float(kind, name, topic.type, topic.symbol.span, diagnostics)
            return
        interval = Interval(bound.low, bound.high) if bound is not None else None
        yield Leaf(index, "", path, name, t.unit), interval


def _add_outputs(place: VerificationSystem, inputs: Inputs, diagnostics: Diagnostics) -> None:
    for index in place.module.outputs:
        for leaf, interval in _float_leaves_of_topic(place, index, "output", diagnostics):
            assert interval is not None  # V003
            inputs.controls.append(leaf)
            inputs.control_ranges.append(interval)


def _add_errors(place: VerificationSystem, inputs: Inputs) -> None:
    read = {*_topics_read(place), *read_by_dm(place)}  # computed predicates read the axes' topics
    for c in place.plants:
        for m in c.measured:
            topic = place.system.topics[m.topic]
            path, of = list(leaves(topic.type))[m.leaf]
            if m.topic in read and m.bound > 0.0:
                unit = of.unit if isinstance(of, FloatType) else ""
                name = leaf_name(topic.name, path)
                inputs.errors.append(Leaf(m.topic, "", path, name, unit))
                inputs.error_ranges.append(Interval(-m.bound, m.bound))


def _topics_read(place: VerificationSystem) -> dict[int, typed.TypedExpr | None]:
    """The topics that SC and the DM's predicates read, each with an expression that reads it."""
    symbol, module = place.module.symbol, place.module
    assert place.sc.node is not None
    reads: dict[int, typed.TypedExpr | None] = {}
    spans = topic_reads(*place.sc.node.step)
    for topic in topics_read_in_step(place.sc.node):
        reads.setdefault(place.sc.scope.topics[topic], spans.get(topic))
    predicates = [e for e in (ttf_of_states(symbol.ttf), symbol.safer) if e is not None]
    for topic, read in topic_reads(*predicates).items():
        reads.setdefault(module.scope.topics[topic], read)
    return reads


def _add_other_topics(place: VerificationSystem, inputs: Inputs, diagnostics: Diagnostics) -> None:
    """Adds topics without a plant that DM or SC read; reports R001 for a topic without a set."""
    driven = place.driven
    for index, read in _topics_read(place).items():
        if index in driven:
            continue
        topic = place.system.topics[index]
        if not topic.set_declared:
            diagnostics.error(
                "R001",
                f"no verification plant drives `{topic.name}`, and it has no value set",
                read.span if read is not None else topic.symbol.span,
                "read here" if read is not None else "",
                also=((topic.symbol.span, "declared here"),) if read is not None else (),
                notes=("what nothing bounds may be anything, and nothing can be proved of it",),
                helps=(
                    "put the plant that drives it beside the module, or name one: `abstracts`",
                    "or give the topic a set: `in [-1.0, 1.0]` with your bounds",
                ),
            )
            continue
        for (path, t), bound in zip(leaves(topic.type), topic.bounds, strict=True):
            if isinstance(t, FloatType) and bound is not None:  # the rest ranges over its type
                inputs.others.append(Leaf(index, "", path, leaf_name(topic.name, path)))
                inputs.other_ranges.append(Interval(bound.low, bound.high))


def errors_by_state(problem: Problem) -> dict[int, float]:
    """The largest |estimate - state| of each state, by number, in the unit of the state.

    It includes the rounding of the sum of state and error, and on an axis that wraps around also
    the rounding when whole turns are subtracted from the estimate.
    """
    error_by_state: dict[int, float] = {}
    for state, (topic, leaf) in problem.topic_leaf_of_state.items():
        path = list(leaves(problem.system.topics[topic].type))[leaf][0]
        for e, bounds in zip(problem.quantities.errors, problem.errors, strict=True):
            error = max(-bounds.low, bounds.high)
            if (e.owner, e.path) == (topic, path) and error > 0.0:
                extent = problem.states[state]
                largest = max(abs(extent.low), abs(extent.high)) + error
                error_by_state[state] = max(
                    error_by_state.get(state, 0.0), error + (error + largest) * 2.0**-50
                )
        if state in problem.quantities.turning:
            error_by_state[state] = error_by_state.get(state, 0.0) + FAR_TURNS
    return error_by_state


def topics_seen_by_dm(problem: Problem) -> dict[int, TopicSymbol]:
    """The topic that shows each state to the DM, by the state's number; its age counts in A."""
    symbol = problem.module.symbol
    declared = {a.topic for g in symbol.verify.groups for a in g.axes if a.topic is not None}
    sc = problem.system.components[problem.module.sc]
    scope = {**sc.scope.topics, **problem.module.scope.topics}
    names = {index: s for s, index in scope.items() if not declared or s in declared}
    at = problem.topic_leaf_of_state
    return {s: names[topic] for s, (topic, _) in at.items() if topic in names}
