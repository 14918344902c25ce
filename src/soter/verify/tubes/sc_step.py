"""The step of SC as expressions, for all values that its variables may hold.

Purpose: `ScStep` executes SC's step and its `on takeover` block over what SC reads ("y") and over
its variables. A float or bool variable is an input "l", any number of its range, chosen anew at
each step (condition 3 of "Decisions by tubes", proof-flight.md); an int variable has each value.
`find_ranges` looks for ranges of floats that no step leaves, with the initial values in them.
Non-goals: the proof that no step leaves them (`step_condition`, used by `rest_claims.py`);
relations between variables and states.
"""

from __future__ import annotations

from dataclasses import astuple
from itertools import product
from math import prod
from typing import TYPE_CHECKING, Any

from soter.language.model import types
from soter.language.model.types import leaf_name
from soter.verify.problem.problem import Interval
from soter.verify.tubes.enclosures import Enclosures
from soter.verify.tubes.expression_graph import LARGEST, NoExpressionError, in_order
from soter.verify.tubes.module_expressions import (
    ExpressionReading,
    leaves_of_value,
    value_of_leaves,
)
from soter.verify.tubes.problem import cut_to_farthest

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.core import core
    from soter.verify.tubes.expression_graph import Node, Value
    from soter.verify.tubes.module_expressions import ModuleExpressions

COMBINATIONS_MAX = 64
FEWER = f": {COMBINATIONS_MAX} values together at most, or floats"
FAR, NARROWED = 1e9, 10_000
"""The range in which floats are searched, and the most times that it is narrowed."""
SLACK = 1e-9
"""By less than this share of its width no range is narrowed, as later checks round, too."""


class ScStep:
    """The step of SC; `NoExpressionError` if SC may publish nothing, or keeps unsupported values.

    `commands`: the published values, in the order of controls. `ranges`: the range of each input
    "l"; `floats`: the number of the input for each float that SC keeps, by its name.
    """

    def __init__(self, module: ModuleExpressions) -> None:
        self._module, self._make, problem = module, module.make, module.problem
        self._conditions: list[Node] = []
        self._assigned: list[tuple[int, Node]] = []
        self.ranges: list[Interval] = []
        self.floats: dict[str, int] = {}
        step = problem.core.nodes[problem.module.sc]
        initial = problem.system.components[problem.module.sc].initial
        choices = [
            self._values_of_leaf(leaf_name(x.cell.name, path), t, first)
            for x, value in zip(step.locals, initial, strict=True)
            for path, t, first in leaves_of_value(x.type, value)
        ]
        if prod(map(len, choices)) > COMBINATIONS_MAX:
            raise NoExpressionError(f"SC keeps whole numbers{FEWER}")
        first, *others = dict.fromkeys(
            self._commands_of_step(step, values) for values in product(*choices)
        )
        for other in others:
            which = self._new_undecided_condition()
            first = tuple(map(self._make.select, [which] * len(first), first, other))
        self.commands = list(first)

    def _new_input(self, low: float, high: float) -> Node:
        self.ranges.append(Interval(low, high))
        return self._make.input("l", len(self.ranges) - 1)

    def _new_undecided_condition(self) -> Node:
        """A new condition that may hold or not at each step."""
        return self._make.compare(">", self._new_input(-1.0, 1.0), self._make.constant(0.0))

    def _values_of_leaf(self, name: str, t: types.Type, first: Any) -> Sequence[Value]:  # noqa: ANN401
        """The possible values of a variable's leaf; the leaf has the value `first` initially."""
        if isinstance(t, types.FloatType):
            self.floats[name] = len(self.ranges)
            return [self._new_input(first, first)]
        if isinstance(t, types.BoolType):
            return [self._new_undecided_condition()]
        if isinstance(t, types.EnumType):
            return range(len(t.members))
        if isinstance(t, types.IntType) and t.high - t.low < COMBINATIONS_MAX:
            return range(t.low, t.high + 1)
        raise NoExpressionError(f"SC keeps `{name}`, a `{t}`{FEWER}")

    def _commands_of_step(self, step: core.NodeStep, parts: Sequence[Value]) -> tuple[Node, ...]:
        """The commands of a step that begins with the values `parts`; stores its conditions."""
        left = iter(parts)
        before = [value_of_leaves(x.type, left) for x in step.locals]
        for code in (step.takeover, step.body):
            body = ExpressionReading(
                self._make, self._module.functions, self._module.value_read_by_sc
            )
            for x, value in zip(step.locals, before, strict=True):
                body.bind(x.name, x.type, value)
            body.run(code)
            numbers = (e for e in body.computed if e.op != "number")
            self._conditions += body.guards
            self._conditions += [self._make.in_range(e, -LARGEST, LARGEST) for e in numbers]
            for x in step.locals:
                for path, t, v in leaves_of_value(x.type, body.frame.variables[x.name]):
                    if isinstance(t, types.FloatType):
                        k = self.floats[leaf_name(x.cell.name, path)]
                        self._assigned += [(k, e) for e in _possible_values(v) if e.of != ("l", k)]
        return self._published_commands(step, body)

    def _published_commands(self, step: core.NodeStep, body: ExpressionReading) -> tuple[Node, ...]:
        found = {}
        for number, output in enumerate(step.outputs):
            published, value, t = body.frame.outputs[number]
            if published is not self._make.true:
                raise NoExpressionError("SC may publish nothing")
            for path, _, v in leaves_of_value(t, value):
                found[output.topic, path] = v
        leaves = self._module.problem.quantities.controls
        return tuple(found[leaf.owner, leaf.path] for leaf in leaves)

    def step_condition(self) -> Node:
        """The condition that a step on the reads y neither faults nor leaves a set or range.

        It includes that every computed number is finite, so that none becomes NaN.
        """
        held, make = self._make.true, self._make
        ends = list(zip(self.commands, self._module.problem.controls, strict=True))
        ends += [(v, self.ranges[k]) for k, v in self._assigned]
        for condition in (*self._conditions, *(make.in_range(v, r.low, r.high) for v, r in ends)):
            held = make.join("and", held, condition)
        return held

    def find_ranges(self, reads: Mapping[int, Interval]) -> str:
        """Sets `ranges` to ranges that no step leaves; returns the name of a float without, or "".

        `reads`: for each state the set of the values that SC may read of it.
        """
        roots, first = [v for _, v in self._assigned], list(self.ranges)
        if not roots:
            return ""
        if any(e.op == "input" and e.of[0] not in "ly" for e in in_order(roots)):
            raise NoExpressionError("what SC keeps hangs on a time, an age or a mode")
        steps = Enclosures([roots], shared=True)
        fixed = {("y", s): cut_to_farthest(r) for s, r in reads.items()}
        for k in self.floats.values():
            self.ranges[k] = Interval(-FAR, FAR)
        for _ in range(NARROWED):
            after, inputs = list(first), {("l", k): r for k, r in enumerate(self.ranges)}
            for (k, _), r in zip(self._assigned, steps.ranges(0, fixed | inputs), strict=True):
                after[k] = Interval(min(after[k].low, r.low), max(after[k].high, r.high))
            narrow = list(map(_narrowed_range, self.ranges, after))
            if narrow == self.ranges:
                break
            self.ranges = narrow
        far = (n for n, k in self.floats.items() if FAR in map(abs, astuple(self.ranges[k])))
        return next(far, "")


def _possible_values(e: Node) -> list[Node]:
    """The expressions to which `e` may be equal, for all choices of its branches."""
    return [x for side in e.of[1:] for x in _possible_values(side)] if e.op == "select" else [e]


def _narrowed_range(a: Interval, b: Interval) -> Interval:
    """The range `b` cut to `a`; an end that would be cut by hardly anything stays as in `a`."""
    off = SLACK * (a.high - a.low)
    low, high = a.low + off, a.high - off
    return Interval(b.low if b.low > low else a.low, b.high if b.high < high else a.high)


def variables_entry(ranges: Mapping[str, Interval]) -> dict[str, object]:
    """The part of a certificate's entry about the floats that SC keeps, by name."""
    ends = {n: [r.low.hex(), r.high.hex()] for n, r in ranges.items()}
    return {"keeps": ends} if ends else {}
