"""Warns of what a step certainly does wrong or leaves out, whatever it reads.

Purpose: `warn_of_faults` warns W015 (a value lies outside of its topic's set) and W025 (an
index, an int or the bounds of a `clamp` fault whenever they are reached): it evaluates each
expression once, over the declared ranges. `warn_of_silence` warns W016 (an SC does not publish
on every path), `warn_of_plant` W014 (a state that nothing moves), W032 (a derivative
times `dt`) and W019 (a scheme diverges though the plant does not).
Non-goals: what may happen and need not: a search and a proof answer that; other step faults, which
the first run tells; branches that are never taken (`soter test`).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, ClassVar

from soter.diagnostics.diagnostic import Span
from soter.diagnostics.fixes import exchange, replace
from soter.language.check.parts.plant import unmoved_states
from soter.language.evaluate.integration_stability import groups_that_diverge
from soter.language.evaluate.range_evaluation import RangeEvaluator, TooHardError, all_values
from soter.language.evaluate.ranges import FALSE, TRUE, Range
from soter.language.evaluate.topic_ranges import reader_of_sets
from soter.language.model import typed as t
from soter.language.model.tree_walk import nodes
from soter.language.model.typed import PeriodRead, TypedBinary, Vector
from soter.language.model.types import (
    BOOL,
    ArrayType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    has_list,
    leaves,
    write_ns,
)
from soter.language.syntax.schemes import SCHEMES

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.diagnostics.diagnostic import Diagnostics, Help
    from soter.language.evaluate.integration_stability import Diverging
    from soter.language.evaluate.range_evaluation import Known
    from soter.language.model.system import Bound, Component, Module, System, Topic
    from soter.language.model.typed import PlantSymbol
    from soter.language.model.types import Type

_COUNTED = re.compile(r"for\s+\w+\s+in\s+")
SHOWN = 40
"""Most characters of an expression in a message; a longer one is cut."""
ROUNDS = 16
"""Most rounds of a loop that are evaluated one by one."""
BUDGET = 2_000
"""Most expressions evaluated for one step: some milliseconds."""
LEAVES_MAX = 64
"""Most leaves of a publication that are compared with the topic's set one by one."""
ENDS = {1: "2", 2: "2", 3: "2.51", 4: "2.78"}
"""Order of a scheme -> the largest decay rate times step at which it does not diverge."""


def warn_of_faults(system: System, diagnostics: Diagnostics) -> None:
    """Warns of faults that steps of nodes and plants surely have, once for each declaration."""
    for c in system.components:
        symbol = c.node if c.plant is None and c.role != "dm" else c.plant
        if symbol is None or c.extern or c.stands_for is not None:
            continue
        key = (symbol, *(v for v in c.scope.params.values() if isinstance(v, (int, float))))
        if key in system.program.doubted:
            continue
        system.program.doubted.add(key)
        _StepRanges(system, c, diagnostics).warn_of_certain_faults()


class _StepRanges(RangeEvaluator):
    """Evaluates a step over the declared ranges, and warns of certain faults on the way."""

    def __init__(self, system: System, component: Component, diagnostics: Diagnostics) -> None:
        super().__init__(component.scope, component.period_ns, reader_of_sets(system))
        self.left = BUDGET
        self.system = system
        self.component = component
        self.diagnostics = diagnostics
        self.silent = 0
        """Depth of calls into the prelude; it warns only at depth 0."""
        self.loops: dict[t.Variable, t.ForRange] = {}

    def warn_of_certain_faults(self) -> None:
        """Evaluates a node's whole step, or a plant's equations and publications."""
        node, plant = self.component.node, self.component.plant
        try:
            if plant is not None:
                self._evaluate_plant(plant)
            elif node is not None:
                self._run_body(node.takeover or (), None, BOOL)
                self.variables = {}
                self._run_body(node.step, None, BOOL)
        except TooHardError:
            return  # it has warned of what was certain up to here

    def _evaluate_plant(self, plant: t.PlantSymbol) -> None:
        for d in self.component.disturbances:
            if isinstance(d.variable.type, FloatType):
                self.variables[d.variable] = Range(d.low, d.high)
        for variable, value in plant.lets:
            self.variables[variable] = self.evaluate(value)
        for value in (*plant.der.values(), *plant.next.values()):
            self.evaluate(value)
        for topic, value in plant.drives:
            self._check_publication(topic, value)

    def evaluate(self, e: t.TypedExpr) -> Known:
        """Gives the range of `e`; all values if too hard. Raises TooHardError if out of budget."""
        try:
            return super().evaluate(e)
        except TooHardError:
            if self.left < 0:
                raise
            return all_values(e.type)

    # ------------------------------------------------------------ statements

    def _run_plain(self, s: t.TypedStmt) -> bool:
        if isinstance(s, t.TypedPublish):
            self._check_publication(s.topic, s.value)
            return True
        if isinstance(s, (t.TypedAssign, t.TypedPush)):
            self._check_assigned_place(s.place)
        return super()._run_plain(s)

    def _run_loop(self, s: t.ForRange | t.ForEach, returned: Known, of: Type) -> tuple[Known, bool]:
        """Evaluates few rounds one by one; of many, the first, the last, and all as one round."""
        if isinstance(s, t.ForRange):
            self.loops[s.variable] = s
            few = s.high - s.low <= ROUNDS
            rounds = [Range(s.low, s.low), Range(s.low, s.high - 1), Range(s.high - 1, s.high - 1)]
        else:
            of_all = s.sequence.type
            few = isinstance(of_all, ArrayType) and of_all.size <= ROUNDS
            rounds = [all_values(s.variable.type)]
        if few:
            return super()._run_loop(s, returned, of)
        self._forget_assigned(s.body)
        for value in rounds:
            self.variables[s.variable] = value
            returned, _ = self._run_body(s.body, returned, of)
            self._forget_assigned(s.body)
        return returned, True

    def _forget_assigned(self, body: tuple[t.TypedStmt, ...]) -> None:
        """Sets variables that `body` assigns to all values, as its rounds are not counted."""
        for n in nodes(body):
            if isinstance(n, t.Place):
                self.variables[n.variable] = all_values(n.variable.type)

    def _check_publication(self, topic: t.TopicSymbol, value: t.TypedExpr) -> None:
        flat = self.system.topics[self.scope.topics[topic]]
        if has_list(topic.type) or len(flat.bounds) > LEAVES_MAX:
            self.evaluate(value)
            return
        self._compare_with_set(flat, value, (), topic)

    def _compare_with_set(
        self, topic: Topic, value: t.TypedExpr, path: tuple[str, ...], symbol: t.TopicSymbol
    ) -> None:
        """Warns W015 of a published value, or a part of it, that is never in its topic's set."""
        if isinstance(value, t.Conditional):
            held = self.bounds(value.condition)
            if held != FALSE:
                self._compare_with_set(topic, value.then, path, symbol)
            if held != TRUE:
                self._compare_with_set(topic, value.otherwise, path, symbol)
            return
        of = value.type
        if isinstance(value, t.Aggregate) and isinstance(of, (RecordType, ArrayType)):
            order = value.order or range(len(value.elements))
            for part, index in zip(value.elements, order, strict=True):
                name = of.fields[index][0] if isinstance(of, RecordType) else f"[{index}]"
                self._compare_with_set(topic, part, (*path, name), symbol)
            return
        self._compare_leaves_with_set(topic, value, path, symbol)

    def _compare_leaves_with_set(
        self, topic: Topic, value: t.TypedExpr, path: tuple[str, ...], symbol: t.TopicSymbol
    ) -> None:
        flat = self._leaves(self.evaluate(value), value.type)
        bounds = [
            bound
            for (leaf, _), bound in zip(leaves(topic.type), topic.bounds, strict=True)
            if leaf[: len(path)] == path
        ]
        for known, bound in zip(flat, bounds, strict=True):
            outside = bound is not None and (known.high < bound.low or known.low > bound.high)
            if bound is not None and outside and not known.nan:
                self._warn_of_value_outside(symbol, value, known, bound)
                return

    def _warn_of_value_outside(
        self, topic: t.TopicSymbol, value: t.TypedExpr, known: Range, bound: Bound
    ) -> None:
        values = repr(known.low) if known.single else f"all of [{known.low!r}, {known.high!r}]"
        nearest = repr(bound.low if known.high < bound.low else bound.high)
        helps: tuple[Help, ...] = (f"or let the set of `{topic.name}` hold it",)
        if isinstance(value.type, (FloatType, IntType)):
            helps = (replace(value.span, nearest, f"the nearest value is `{nearest}`"), *helps)
        why = {
            "sc": "publishing it is a step fault, which a safe controller must never have",
            "ac": "the gate stops it, and AC loses control",
        }.get(self.component.role, "publishing it is a step fault")
        self.diagnostics.warning(
            "W015",
            f"{values} is outside of the set of `{topic.name}`",
            value.span,
            f"[{bound.low!r}, {bound.high!r}] is allowed",
            also=((topic.span, "declared here"),),
            notes=(why,),
            helps=helps,
        )

    # ------------------------------------------------------------ certain faults

    def _range_of_call(self, e: t.TypedCall) -> Known:
        if e.fun.prelude:
            for a in e.arguments:
                self.evaluate(a)
        if e.fun.prelude and e.fun.name.rpartition(".")[2] != "clamp":
            return all_values(e.type)
        if e.fun.prelude and not self.silent:
            self._check_clamp_bounds(*e.arguments[1:])
        self.silent += e.fun.prelude
        try:
            return super()._range_of_call(e)
        finally:
            self.silent -= e.fun.prelude

    def _check_clamp_bounds(self, low: t.TypedExpr, high: t.TypedExpr) -> None:
        a, b = self.bounds(low), self.bounds(high)
        if a.nan or b.nan or a.low <= b.high:
            return
        self._warn_of_fault(
            "the bounds of `clamp` are the wrong way round",
            low.span.to(high.span),
            f"{low.span.text} is above {high.span.text}",
            "no number lies between them: the result is no number (NaN), and publishing it faults",
            (exchange(low.span, high.span, f"write `{high.span.text}, {low.span.text}`"),),
        )

    def _range_of_index(self, e: t.Index) -> Known:
        self._check_index_of(e.target.type, e.index)
        return super()._range_of_index(e)

    def _check_assigned_place(self, place: t.Place) -> None:
        of: Type = place.variable.type
        for step in place.path:
            if isinstance(step, int):
                of = of.fields[step][1] if isinstance(of, RecordType) else of
                continue
            self._check_index_of(of, step)
            of = of.element if isinstance(of, (ArrayType, ListType)) else of

    def _check_index_of(self, of: Type, index: t.TypedExpr) -> None:
        """Warns W025 of an index that is out of range at every execution of this code."""
        if not isinstance(of, (ArrayType, ListType)) or self.silent:
            return
        size = of.size if isinstance(of, ArrayType) else of.capacity
        at = self.bounds(index)
        if at.high >= 0 and at.low < size:
            return
        value = f"{at.low}" if at.single else f"from {at.low} to {at.high}"
        helps: tuple[Help, ...] = (f"its elements are 0 to {size - 1}",)
        loop = self.loops.get(index.variable) if isinstance(index, t.VarRead) else None
        if loop is not None:
            helps = (_help_to_count_from_zero(loop, size),)
        self._warn_of_fault(
            f"`{_shortened_text(index.span)}` is outside of `{of}` where it is {value}",
            index.span,
            f"{_shortened_text(index.span)} is {value}, and 0 to {size - 1} are possible",
            "reading or writing there is a step fault",
            helps,
        )

    def _range_of_narrow(self, e: t.Narrow) -> Known:
        assert isinstance(e.type, IntType)
        if not self.silent:
            a = self.bounds(e.operand)
            if a.low < a.high and (a.low == e.type.high or a.high == e.type.low):
                self._warn_that_one_fits(e, a)
            if a.high < e.type.low or a.low > e.type.high:
                value = f"{a.low}" if a.single else f"from {a.low} to {a.high}"
                inside = f"min(max({e.span.text}, {e.type.low}), {e.type.high})"
                self._warn_of_fault(
                    f"`{_shortened_text(e.span)}` does not fit into `{e.type}`",
                    e.span,
                    f"it is {value}",
                    "putting it there is a step fault",
                    (replace(e.span, inside, f"keep it inside: `{inside}`"),),
                )
        return super()._range_of_narrow(e)

    def _warn_that_one_fits(self, e: t.Narrow, known: Range) -> None:
        """Warns W025 if only one possible value fits, as 9 does for `max(n + 1, 9)` in [0, 9]."""
        assert isinstance(e.type, IntType)
        fitting, keeps = (known.low, "min") if known.low == e.type.high else (known.high, "max")
        self._warn_of_fault(
            f"of what this may be only {fitting} fits into `{e.type}`",
            e.span,
            f"it is from {known.low} to {known.high}",
            "putting anything else there is a step fault",
            (f"keep it inside: `{keeps}(x, {fitting})`",),
        )

    def _warn_of_fault(
        self, message: str, span: Span, label: str, note: str, helps: tuple[Help, ...]
    ) -> None:
        self.diagnostics.warning("W025", message, span, label, notes=(note,), helps=helps)

    EXPRESSIONS: ClassVar[dict[type[t.TypedExpr], Callable[[Any, Any], Known]]] = {
        **RangeEvaluator.EXPRESSIONS,
        t.TypedCall: _range_of_call,
        t.Index: _range_of_index,
        t.Narrow: _range_of_narrow,
    }


def _shortened_text(span: Span) -> str:
    """Gives the source text of a span on one line, cut to SHOWN characters."""
    text = span.text_on_one_line
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 4]} ..."


def _help_to_count_from_zero(loop: t.ForRange, size: int) -> Help:
    """Gives a help with a loop over all indices, as an edit if the loop has a range in its text."""
    title = f"indices begin at 0: `for {loop.variable.name} in 0..{size} {{ ... }}`"
    written = _COUNTED.match(loop.span.source.text, loop.span.start)
    if written is None:
        return title
    end = loop.span.source.text.find("{", written.end())
    span = Span(loop.span.source, written.end(), end)
    return replace(span, f"0..{size} ", title)


def warn_of_silence(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """Warns W016 of a safe controller that does not publish on every path of its step."""
    sc = system.components[module.sc]
    if sc.node is None or sc.extern:
        return
    publications = [n for n in nodes(sc.node.step) if isinstance(n, t.TypedPublish)]
    if sc.node.takeover is not None or any(isinstance(n, t.InControl) for n in nodes(sc.node.step)):
        return  # it asks whether it has control, and so is silent on purpose
    for topic in sc.node.publishes:
        first = next((p for p in publications if p.topic is topic), None)
        if first is None or _always_publishes(sc.node.step, topic):
            continue
        diagnostics.warning(
            "W016",
            f"`{sc.node.name}` does not publish `{topic.name}` on every path of its step",
            first.span,
            "published here",
            also=((module.symbol.sc_span or module.symbol.span, "the safe controller"),),
            notes=("where it is silent, the last value that AC published stays in force",),
            helps=("publish on every path: what stands in an `if` also needs an `else`",),
        )


def _always_publishes(statements: tuple[t.TypedStmt, ...], topic: t.TopicSymbol) -> bool:
    for s in statements:
        if isinstance(s, t.TypedPublish) and s.topic is topic:
            return True
        if isinstance(s, t.TypedIf) and s.otherwise:
            bodies = [*(body for _, body in s.arms), s.otherwise]
            if all(_always_publishes(body, topic) for body in bodies):
                return True
        if isinstance(s, t.ForRange) and s.low < s.high and _always_publishes(s.body, topic):
            return True
    return False


def warn_of_plant(system: System, component: Component, diagnostics: Diagnostics) -> None:
    """Warns W014 and W032 of a plant, and W019 of states that only its scheme makes diverge."""
    plant = component.plant
    if plant is None:
        return
    _warn_of_unmoved_states(plant, diagnostics)
    _warn_of_product_with_dt(plant, diagnostics)
    for d in groups_that_diverge(system, component):
        names = ", ".join(f"`{n}`" for n in d.names)
        end = ENDS[SCHEMES[plant.method].order]
        rate = f"rate {d.rate:.3g} per second x step {d.step_s:.3g} s = {d.rate * d.step_s:.3g}"
        diagnostics.warning(
            "W019",
            f"the scheme `{plant.method}` makes {names} of plant `{plant.name}` diverge",
            d.variable.span,
            f"every step multiplies {'it' if len(d.names) == 1 else 'them'} by {d.growth:.3g}",
            notes=(f"{rate}; `{plant.method}` follows a decay up to {end}",),
            helps=tuple(_divergence_helps(component, d)),
        )


def _divergence_helps(component: Component, d: Diverging) -> list[str]:
    plant = component.plant
    assert plant is not None
    helps = []
    if d.substeps is not None:
        shorter = component.period_ns * component.substeps // d.substeps
        helps.append(
            f"`integrate {plant.method} substeps {d.substeps};`, or a period of the plant of at "
            f"most {write_ns(max(1, shorter // component.substeps))}"
        )
    if d.other is not None:
        helps.append(f"`integrate {d.other};` in place of `{plant.method}`")
    return helps or ["leave out what is that fast: say where it comes to rest"]


def _warn_of_unmoved_states(plant: PlantSymbol, diagnostics: Diagnostics) -> None:
    """Warns W014 of a state without `der` and `next`, which lacks a rule or is a constant."""
    for state in unmoved_states(plant):
        diagnostics.warning(
            "W014",
            f"the state `{state.name}` of plant `{plant.name}` never changes",
            state.span,
            "no `der` and no `next`",
            notes=("what is constant is a `const`; a constant that is unknown has a set: `in`",),
            helps=(f"say how it moves: `der {state.name} = ...;` or `next {state.name} = ...;`",),
        )


def _warn_of_product_with_dt(plant: PlantSymbol, diagnostics: Diagnostics) -> None:
    """Warns W032 of `der x = v * dt`, because the scheme itself multiplies by the step."""
    for state, slope in plant.der.items():
        factors = [slope]
        for e in factors:
            if isinstance(e, (TypedBinary, Vector)) and e.op == "*":
                factors += [e.left, e.right]
        for e in factors:
            if isinstance(e, PeriodRead):
                diagnostics.warning(
                    "W032",
                    f"the derivative of `{state.name}` is multiplied by `dt`",
                    e.span,
                    "a time",
                    also=((state.span, "this state"),),
                    notes=("`der` says how fast a state moves: the plant integrates by itself",),
                    helps=("leave `dt` out, or say what the state is after a step: `next`",),
                )
                return
