"""The rates and predicates of a module as expressions, from which tubes are made.

Purpose: `ModuleExpressions` reads rates of plants, and predicates, from Core: `ExpressionReading`
executes it (`core/execution.py`) with real expressions in the place of numbers.
Non-goals: whether a step faults (shown offline), what an expression is (`expression_graph.py`),
writing them as source (`generated_functions.py`), times (`tube_check.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.core import core
from soter.core.execution import Execution
from soter.core.lower_statements import FunctionTable
from soter.core.steps import lower_predicate
from soter.language.model.types import (
    INT_MAX,
    INT_MIN,
    ArrayType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    Type,
    leaves,
)
from soter.verify.enclose.core_enclosure import is_prelude_function
from soter.verify.enclose.enclosed_steps import right_hand_side, room_of
from soter.verify.enclose.enclosure_emitter import element_types
from soter.verify.enclose.enclosure_inputs import leaf_key, part_names
from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import (
    CONDITIONS,
    MAY_FAULT,
    Expressions,
    Node,
    NoExpressionError,
    Value,
    in_order,
    middle,
    reads_kind,
)
from soter.verify.tubes.moved_rates import rates_taken_apart

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from soter.core.execution import Join
    from soter.language.model.system import Component
    from soter.language.model.typed import TypedExpr
    from soter.verify.enclose.enclosure_inputs import Path
    from soter.verify.tubes.moved_rates import SplitRates
    from soter.verify.tubes.problem import TubeProblem

    Maps = Mapping[tuple[int, int], Node]


FUNCTIONS = frozenset(
    "sin cos exp tan atan tanh wrap_angle asin acos atan2 log".split()  # noqa: SIM905 - words
)
"""The functions of the prelude that `forms.soter` encloses as a whole. `pow` is read as the real
function, as its body depends on rounding; the bodies of all other functions are executed."""
COMPARED = {"<", "<=", ">", ">="}


class ExpressionReading(Execution["Value"]):
    """Executes Core on expressions; `cell(cell, type)` gives the value of a cell."""

    def __init__(
        self,
        make: Expressions,
        functions: Mapping[str, core.Function],
        cell: Callable[[core.Cell, Type], Value],
    ) -> None:
        super().__init__(functions)
        self.make, self.cell = make, cell
        self.where = None
        self.real = False
        """Whether a rate is read: no program computes it, so no angle in it is too large."""
        self.guards: list[Node] = []
        """Conditions that all must hold so that nothing faults."""
        self.computed: dict[Node, None] = {}
        """Every number that is computed, whether or not the result depends on it: an infinite one
        may become NaN."""

    def _decided_truth(self, condition: Value) -> bool | None:
        return condition.of[0] if condition.op == "known" else None

    def _where_in_side(self, where: object, condition: Value, truth: bool) -> object:
        del condition, truth
        return where

    def _join_function(self, condition: Value, *where: object) -> Join[Value]:
        del where

        def join(a: Value | None, b: Value | None, _: Type) -> Value:
            if a is None or b is None:
                return b if a is None else a
            return self._select(condition, a, b)

        return join

    def _select(self, condition: Node, a: Value, b: Value) -> Value:
        if a is b:
            return a
        if isinstance(a, Node):
            if b is condition:  # `condition && a`
                return self.make.join("and", condition, a)
            if a is condition:  # `condition || b`
                return self.make.join("or", condition, b)
            if a.op in CONDITIONS or b.op in CONDITIONS:
                otherwise = self.make.negation(condition)
                if b is otherwise:  # `b || f(x)`: Core calls `f` where `b` is false
                    return self.make.join("or", b, a)
                yes = self.make.join("and", condition, a)
                no = self.make.join("and", otherwise, b)
                return self.make.join("or", yes, no)
            return self.make.select(condition, a, b)
        if isinstance(a, tuple) and len(a) == len(b):
            return tuple(self._select(condition, x, y) for x, y in zip(a, b, strict=True))
        if a == b:
            return a
        msg = "a whole number, or the length of a list, that hangs on what is measured"
        raise NoExpressionError(msg)

    def _checked_value(self, s: core.Checked, operands: list[Value], limit: Value | None) -> Value:
        whole: dict[str, Callable[..., int]] = {
            "add": int.__add__, "sub": int.__sub__, "mul": int.__mul__, "neg": int.__neg__,
        }  # fmt: skip
        if s.op == "number":
            return operands[0]
        if s.op in whole or s.op in ("index", "narrow"):
            value = whole[s.op](*operands) if s.op in whole else operands[0]
            low, high = INT_MIN, INT_MAX
            if s.op == "index":
                assert limit is not None
                low, high = 0, limit - 1
            if s.op == "narrow":
                assert isinstance(s.type, IntType)
                low, high = s.type.low, s.type.high
            if low <= value <= high:
                return value
            raise NoExpressionError("a whole number that faults")
        raise NoExpressionError(f"`{s.op}` of whole numbers")

    def _chosen_value(self, _: core.Choose) -> Value:
        raise NoExpressionError("`choose`")

    def _guard(self, condition: Value) -> None:
        self.guards.append(condition)

    def _with_part(
        self, s: core.Set | core.Push, old: Value, path: list[Value], value: Value
    ) -> Value:
        if not path:
            return value if isinstance(s, core.Set) else (*old, value)
        k, *rest = path
        return (*old[:k], self._with_part(s, old[k], rest, value), *old[k + 1 :])

    def _note_computed(self, e: Node) -> Node:
        """Adds `e` to `computed` and returns it."""
        self.computed[e] = None
        return e

    def result_of(self, f: core.Function, arguments: tuple[Value, ...]) -> Value:
        """The result of a function; raises `NoExpressionError` for an extern."""
        if is_prelude_function(f) and f.source_name in FUNCTIONS:
            real = "real_" if self.real and f.source_name in ("sin", "cos") else ""
            return self._note_computed(self.make.function_node(real + f.source_name, *arguments))
        if is_prelude_function(f) and f.source_name == "clamp":
            return self._note_computed(self.make.clamp(*arguments))
        if is_prelude_function(f) and f.source_name == "hypot":
            x, y = (self.make.mul(a, a) for a in arguments)
            return self._note_computed(self.make.function_node("sqrt", self.make.add(x, y)))
        if is_prelude_function(f) and f.source_name == "pow":
            return self._note_computed(self.make.power(*arguments))
        if f.result is None:
            raise NoExpressionError(f"`{f.source_name}` is extern")
        return super().result_of(f, arguments)

    def _operation_value(self, e: core.Expr, *operands: Value) -> Value:
        make = self.make
        if isinstance(e, core.Const):
            return self.constant_value(e.type, e.value)
        if isinstance(e, core.Get):
            return self.cell(e.cell, e.type)
        if isinstance(e, core.Fact):
            return make.input(e.fact, e.index)
        if isinstance(e, core.Select):
            return self._select(*operands)
        if isinstance(e, (core.Field, core.Element)):
            return operands[0][e.index if isinstance(e, core.Field) else operands[1]]
        if isinstance(e, core.Length):
            return len(operands[0])
        if isinstance(e, core.Make):
            return tuple(operands)
        if isinstance(operands[0], int):
            return self._whole_number_operation(e, *operands)
        if isinstance(e, core.Extreme):
            return make.extreme(e.op, *operands)
        if isinstance(e, core.Unary):
            return self._unary_operation(e.op, *operands)
        assert isinstance(e, core.Binary), e
        return self._binary_operation(e.op, *operands)

    def constant_value(self, t: Type, value: object) -> Value:
        """The value of a constant of any type, with its floats as nodes."""
        if isinstance(value, bool):
            return self.make.true if value else self.make.false
        if isinstance(t, FloatType):
            return self.make.constant(value)  # type: ignore[arg-type]
        if isinstance(t, RecordType):
            pairs = zip(t.fields, value, strict=True)  # type: ignore[call-overload]
            return tuple(self.constant_value(f, v) for (_, f), v in pairs)
        if isinstance(t, (ArrayType, ListType)):
            return tuple(self.constant_value(t.element, v) for v in value)  # type: ignore[attr-defined]
        return value

    def _whole_number_operation(self, e: core.Expr, *operands: int) -> Value:
        op = getattr(e, "op", "")
        if op == "to_float":
            return self.make.constant(operands[0])
        if isinstance(e, core.Extreme):
            return (min if op == "min" else max)(operands)
        holds = {
            "<": int.__lt__, "<=": int.__le__, ">": int.__gt__, ">=": int.__ge__,
            "==": int.__eq__, "!=": int.__ne__,
        }  # fmt: skip
        if op not in holds:
            raise NoExpressionError(f"`{op}` of whole numbers")
        return self.constant_value(e.type, holds[op](*operands))

    def _unary_operation(self, op: str, a: Node) -> Node:
        make = self.make
        if op == "not":
            return make.negation(a)
        if op == "neg":
            return make.neg(a)
        if op == "abs":
            return make.constant(abs(a.of[0])) if a.op == "number" else make.function_node("abs", a)
        if op == "sqrt":
            return self._note_computed(make.function_node("sqrt", a))
        raise NoExpressionError(f"`{op}`, which jumps")

    def _binary_operation(self, op: str, a: Node, b: Node) -> Node:
        make = self.make
        if op in ("&&", "||"):
            return make.join("and" if op == "&&" else "or", a, b)
        if op in COMPARED:
            return make.compare(op, a, b)
        if op in ("==", "!="):
            if a.op in CONDITIONS:
                same = self._select(a, b, make.negation(b))
            else:
                same = make.join("and", make.compare("<=", a, b), make.compare(">=", a, b))
            return same if op == "==" else make.negation(same)
        by = {"+": make.add, "-": make.sub, "*": make.mul, "/": make.div}
        return self._note_computed(by[op](a, b))


class ModuleExpressions:
    """The expressions of a module over "x" (states), "u" (controls), "w" (disturbances), "y".

    The inputs "y" are the reads of SC. `safe` also reads "m", the numbers of maps.
    """

    def __init__(self, problem: TubeProblem) -> None:
        self.problem = problem
        self.make = Expressions()
        q = problem.quantities
        self._numbers: dict[Any, tuple[str, int]] = {}
        for kind, every in (("x", q.states), ("u", q.controls), ("w", q.disturbances)):
            self._numbers.update({leaf_key(leaf): (kind, i) for i, leaf in enumerate(every)})
        self.functions = {f.name: f for f in problem.core.functions}
        self.seen: dict[int, tuple[int, int]] = {}
        """For each state that SC reads, the topic and the leaf that show it."""
        self._guards: list[Node] = []
        """Conditions that all have to hold so that no plant faults."""
        self.rooms = dict(enumerate(problem.states))
        """The range of each state within C, by the sets of the topics that show it."""

    def rates(self) -> list[Node]:
        """The derivative of every state, in the order of states, over x, u and w."""
        rates: dict[Any, Node] = {}
        for component, step in self._plants_with_steps():
            call = right_hand_side(step, self.functions)
            if call is None:
                continue
            body = self._plant_reading(component, step)
            body.real = True
            function = self.functions[call.function]
            record = function.parameters[0].type
            assert isinstance(record, RecordType)
            cells = {x.cell.name: x for x in step.states}
            x = tuple(self._cell_value(cells[n].cell, t) for n, t in record.fields)
            result = body.result_of(function, (x, *[body.expr(a) for a in call.arguments[1:]]))
            self._guards += [*body.guards, *self.make.hidden]
            for path, _, v in leaves_of_value(record, result):
                rates[component.index, path[0], path[1:]] = v
        zero = self.make.constant(0.0)
        return [rates.get(leaf_key(s), zero) for s in self.problem.quantities.states]

    def split_rates(self, rates: list[Node]) -> SplitRates:
        """The rates split into the effects of commands and of disturbances."""
        q, make = self.problem.quantities, self.make
        winds = {make.input("w", k): middle(d) for k, d in enumerate(self.problem.disturbances)}
        return rates_taken_apart(
            make, rates, winds, [make.input("u", k) for k, _ in enumerate(q.controls)]
        )

    def derivatives_of_rates(self, rates: list[Node]) -> list[Node]:
        """The derivatives of these rates along a direction "v" of states."""
        make = self.make
        count = len(self.problem.quantities.states)
        direction = {make.input("x", i): make.input("v", i) for i in range(count)}
        known: dict[Node, Node] = {}
        return [make.slope_along(e, direction, known) for e in rates]

    def condition_of_predicate(self, e: TypedExpr, maps: Maps | None = None) -> Node:
        """The condition that `e` is true at the states x and that its evaluation does not fault.

        `maps` has the input for each number of the maps, by topic and leaf.
        """
        table = FunctionTable(self.problem.system)
        system, module = self.problem.system, self.problem.module
        p = lower_predicate(table, system, module.scope, e, e.span)

        def state_value(cell: core.Cell, t: Type) -> Value:
            return self._topic_value(cell.owner, t, "x", maps)

        body = ExpressionReading(self.make, {**self.functions, **table.by_name}, state_value)
        self.make.hidden.clear()
        body.run(p.body)
        held: Node = body.expr(p.value)
        for guard in [*body.guards, *self.make.hidden]:
            held = self.make.join("and", held, guard)
        return held

    def _refuse_maps_without_place(self, safe: Node) -> None:
        """Raises `NoExpressionError` for a map that no part of `safe` compares with a state.

        A part that reads no state is the same all along a tube, so it is not about a place.
        """
        of = [topic for topic, _ in self.problem.map_leaves]
        placed: set[int] = set()
        for c in in_order([safe]):
            if c.op in ("positive", "not negative", "inside"):
                inputs = [x.of for x in in_order([c]) if x.op == "input"]
                if any(kind == "x" for kind, _ in inputs):
                    placed |= {of[k] for kind, k in inputs if kind == "m"}
        for topic in sorted({*of} - placed):
            name = self.problem.system.topics[topic].name
            raise NoExpressionError(f"`safe` compares nothing of the map `{name}` with a state")

    def constraint_condition(self) -> Node:
        """The condition C: `safe` holds, and plants neither fault nor publish outside their sets.

        Published values count with errors. Call this after `rates`, whose faults count, too. Raises
        `NoExpressionError` for sets that bound no states, and commands that cause faults.
        """
        system, make = self.problem.system, self.make
        maps = {at: make.input("m", k) for k, at in enumerate(self.problem.map_leaves)}
        held = self.condition_of_predicate(self.problem.module.symbol.safe, maps)
        self._refuse_maps_without_place(held)
        for component, step in self._plants_with_steps():
            body = self._plant_reading(component, step)
            body.run(step.publish)
            for number, output in enumerate(step.outputs):
                topic = system.topics[output.topic]
                bounds = dict(zip((p for p, _ in leaves(topic.type)), topic.bounds, strict=True))
                errors = {m.leaf: m.bound for m in component.measured if m.topic == output.topic}
                published = leaves_of_value(topic.type, body.frame.outputs[number][1])
                for k, (path, t, v) in enumerate(published):
                    bound = bounds.get(path)
                    if bound is None:
                        continue
                    _refuse_set(topic.name, t, v)
                    low, high = room_of(bound, errors.get(k, 0.0))
                    held = make.join("and", held, make.in_range(v, low, high))
                    if v.op == "input" and v.of[0] == "x":
                        room = self.rooms[v.of[1]]
                        self.rooms[v.of[1]] = Interval(max(low, room.low), min(high, room.high))
            self._guards += body.guards
        for guard in self._guards:
            if reads_kind(guard, "u") or reads_kind(guard, "w"):
                raise NoExpressionError(MAY_FAULT)
            held = make.join("and", held, guard)
        return held

    def _plants_with_steps(self) -> Iterator[tuple[Component, core.PlantStep]]:
        for i, step in sorted(self.problem.core.plants.items()):
            if step.extern:
                raise NoExpressionError("a plant is extern")
            yield self.problem.system.components[i], step

    def _plant_reading(self, component: Component, step: core.PlantStep) -> ExpressionReading:
        body = ExpressionReading(self.make, self.functions, self._cell_value)
        for x in step.states:
            body.bind(x.name, x.type, self._cell_value(x.cell, x.type))
        for (name, t, _), d in zip(step.disturbances, component.disturbances, strict=True):
            body.bind(name, t, self._leaf_inputs((component.index, d.variable.name), t, ()))
        return body

    def _leaf_inputs(self, owner: tuple[int, str], t: Type, path: Path, kind: str = "") -> Value:
        if isinstance(t, (RecordType, ArrayType)):
            below_ = zip(part_names(t), element_types(t), strict=True)
            return tuple(self._leaf_inputs(owner, f, (*path, n), kind) for n, f in below_)
        number = self._numbers.get((*owner, path))
        if number is None or not isinstance(t, FloatType):
            raise NoExpressionError(f"`{owner[1] or owner[0]}` is no state and no command")
        return self.make.input(kind or number[0], number[1])

    def _cell_value(self, cell: core.Cell, t: Type) -> Value:
        return self._leaf_inputs((cell.owner, cell.name if cell.kind == "state" else ""), t, ())

    def _topic_value(self, index: int, t: Type, kind: str, maps: Maps | None = None) -> Value:
        """The value of a topic; each leaf is the state that equals it, or a number of a map."""

        def leaf_input(k: int) -> Node:
            leaf = index, k
            if maps is not None and leaf in maps:
                return maps[leaf]
            if (state := self.problem.state_of_leaf.get(leaf)) is None:
                names = [f"`{topic.name}`" for topic in self.problem.system.topics]
                driven = ", ".join(sorted({names[i] for i, _ in self.problem.state_of_leaf}))
                why = f"SC, `safe` or `rest` reads {names[leaf[0]]}: no state equals it"
                raise NoExpressionError(f"{why}; read what plants drive: {driven}")
            return self.make.input(kind, state)

        return value_of_leaves(t, map(leaf_input, range(len(list(leaves(t))))))

    def value_read_by_sc(self, cell: core.Cell, t: Type) -> Value:
        """The value of a topic as SC reads it; `NoExpressionError` if SC reads a state twice."""
        for leaf, state in self.problem.state_of_leaf.items():
            if leaf[0] == cell.owner and self.seen.setdefault(state, leaf) != leaf:
                name = self.problem.quantities.states[state].name
                raise NoExpressionError(f"SC sees `{name}` twice, with an error each")
        return self._topic_value(cell.owner, t, "y")


def _refuse_set(name: str, t: Type, published: Value) -> None:
    """Raises `NoExpressionError` for a topic whose set bounds no region of states."""
    if not isinstance(t, FloatType) or reads_kind(published, "u") or reads_kind(published, "w"):
        why = "is no float, or hangs on a command or a disturbance"
        raise NoExpressionError(f"`{name}` has a set, and {why}")


def value_of_leaves(t: Type, parts: Iterator[Value]) -> Value:
    """The value of a type that has these leaves, in order."""
    if isinstance(t, (RecordType, ArrayType)):
        return tuple(value_of_leaves(f, parts) for f in element_types(t))
    return next(parts)


def leaves_of_value(t: Type, v: Value, path: Path = ()) -> Iterator[tuple[Path, Type, Value]]:
    """The path, type and value of each leaf of a value."""
    if isinstance(t, (RecordType, ArrayType)):
        for n, f, x in zip(part_names(t), element_types(t), v, strict=True):
            yield from leaves_of_value(f, x, (*path, n))
    else:
        yield path, t, v
