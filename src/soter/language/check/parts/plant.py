"""Checks plants: states, disturbances, dynamics, measurements.

Purpose: turns `plant` and `extern plant` declarations into `PlantSymbol`s.
Non-goals: numbers (`system_numbers.py`), integration (`semantics/`, `core/`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from soter.diagnostics.fixes import remove_from_list
from soter.language.check.checker_interface import Context
from soter.language.check.expression_base import (
    CheckerPart,
    error_expr,
    has_error,
    plain_type,
    with_article,
)
from soter.language.check.parts.node import (
    binding_in_folder,
    check_binding,
    period_or_unknown,
    refuse_input_topic,
)
from soter.language.check.statements import report_stored_duration
from soter.language.model import typed
from soter.language.model.types import (
    DURATION,
    ERROR,
    FLOAT,
    INT,
    DurationType,
    ErrorType,
    FloatType,
    RecordType,
    is_vector,
)
from soter.language.syntax.schemes import DEFAULT_SCHEME

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span
    from soter.language.check.scope import FileScope
    from soter.language.model.types import Type
    from soter.language.syntax import tree


class PlantChecker(CheckerPart):
    """Checks plants of one program."""

    def symbol_of(
        self, decl: tree.PlantDecl, scope: FileScope, full_name: str
    ) -> typed.PlantSymbol:
        """Gives the symbol of a plant, with everything but the right-hand sides checked."""
        context = Context(scope, f"the declaration of plant `{decl.name.text}`")
        period = self.shared.check_number(decl.period, context, DURATION, "a period")
        check_binding(decl.source, decl.source_span, self.diagnostics)
        reads = self._check_reads(decl, scope)
        states, initial, ranges = self._check_states(decl, scope, context)
        disturbances = self._check_disturbances(decl, scope, context, states)
        method, substeps = decl.integrate or (DEFAULT_SCHEME, None)
        truth = RecordType(
            tuple((v.name, v.type) for v in states if not isinstance(v.type, ErrorType)),
            f"{full_name}.truth",
        )
        self.shared.names.note_syntax_of_fields(truth.fields, decl)
        plant = typed.PlantSymbol(
            full_name,
            decl.name.span,
            period=period_or_unknown(period),
            extern=decl.extern,
            source=binding_in_folder(decl.source, scope),
            reads=tuple(reads),
            drives=self._driven_topics(decl, scope),
            states=tuple(states),
            initial=tuple(initial),
            initial_range=tuple(ranges),
            disturbances=tuple(disturbances),
            lets=(),
            der={},
            next={},
            method=method,
            substeps=self.check_number_if_given(substeps, context, INT, "the number of substeps"),
            measured=(),
            truth=truth,
            read_spans=tuple(reads.values()),
        )
        self.shared.check_body_later(plant, decl, scope)
        return plant

    def _check_reads(self, decl: tree.PlantDecl, scope: FileScope) -> dict[typed.TopicSymbol, Span]:
        reads: dict[typed.TopicSymbol, Span] = {}
        for ref in decl.reads:
            topic = self.shared.topic_of_ref(ref, scope)
            if topic is None:
                continue
            if topic in reads:
                self.shared.names.report_repeated(
                    f"`{ref.text}` is read twice", ref.span, reads[topic]
                )
            reads.setdefault(topic, ref.span)
        return reads

    def _driven_topics(
        self, decl: tree.PlantDecl, scope: FileScope
    ) -> tuple[tuple[typed.TopicSymbol, typed.TypedExpr], ...]:
        spans: dict[typed.TopicSymbol, Span] = {}
        for ref, expr in decl.drives:
            topic = self.shared.topic_of_ref(ref, scope)
            if expr is None:
                self.diagnostics.error(
                    "M006",
                    f"`drives {ref.text}` has no value",
                    ref.span,
                    notes=("also of an extern plant: its code moves the states, nothing else",),
                    helps=(f"write `drives {ref.text} = ...;` over its states",),
                )
            if expr is None or topic is None:
                continue
            if topic in spans:
                self.shared.names.report_repeated(
                    f"`{ref.text}` is driven twice", ref.span, spans[topic]
                )
                continue
            spans[topic] = ref.span
            if topic.input:
                refuse_input_topic(topic, ref.span, self.diagnostics)
        return tuple((t, error_expr(span)) for t, span in spans.items())

    def _check_states(
        self, decl: tree.PlantDecl, scope: FileScope, context: Context
    ) -> tuple[
        list[typed.Variable],
        list[typed.TypedExpr | None],
        list[tuple[typed.TypedExpr, typed.TypedExpr] | None],
    ]:
        states: dict[str, typed.Variable] = {}
        initial: list[typed.TypedExpr | None] = []
        ranges: list[tuple[typed.TypedExpr, typed.TypedExpr] | None] = []
        for s in decl.states:
            t = self.shared.resolve_type(s.type, scope)
            because = (s.type.span, f"declared as `{t}`")
            value = self.check_number_if_given(s.initial, context, t, "a first value", because)
            interval = self._start_interval(s, t, context)
            first = states.get(s.name.text)
            if first is not None:
                self.shared.names.report_duplicate(s.name.text, s.name.span, first.span, "state")
                continue
            states[s.name.text] = typed.Variable(s.name.text, t, "state", s.name.span, used=True)
            self.shared.names.note_meaning(s.name.span, states[s.name.text])
            initial.append(value)
            ranges.append(interval)
        return list(states.values()), initial, ranges

    def _start_interval(
        self, s: tree.PlantState, t: Type, context: Context
    ) -> tuple[typed.TypedExpr, typed.TypedExpr] | None:
        if s.interval is None:
            return None
        interval = self._check_interval(s.interval, context)
        if s.initial is not None:
            self.diagnostics.error(
                "V008",
                f"state `{s.name.text}` starts at a value and in an interval",
                s.initial.span,
                "the value",
                also=((s.interval.span, "the interval"),),
                helps=("keep one of them",),
            )
        if _can_be_integrated(t):
            return interval
        self.diagnostics.error(
            "V004",
            f"{with_article(t)} cannot start anywhere in an interval",
            s.interval.span,
            notes=("the start is drawn for floats and vectors only",),
            helps=(f"give it a value: `state {s.name.text}: {t} = ...;`",),
        )
        return None

    def _check_interval(
        self, interval: tree.IntervalExpr, context: Context
    ) -> tuple[typed.TypedExpr, typed.TypedExpr] | None:
        low = self.shared.check_number(interval.low, context, FLOAT, "a bound")
        high = self.shared.check_number(interval.high, context, FLOAT, "a bound")
        return None if has_error(low, high) else (low, high)

    def _check_disturbances(
        self, decl: tree.PlantDecl, scope: FileScope, context: Context, states: list[typed.Variable]
    ) -> list[typed.DisturbanceSymbol]:
        disturbances: list[typed.DisturbanceSymbol] = []
        taken = {v.name: v for v in states}
        for d in decl.disturbances:
            t = self.shared.resolve_type(d.type, scope)
            interval = self._check_interval(d.interval, context)
            hold = self.check_number_if_given(d.hold, context, DURATION, "`hold`")
            first = taken.get(d.name.text)
            if first is not None:
                self.shared.names.report_duplicate(d.name.text, d.name.span, first.span)
                continue
            if not (isinstance(t, (FloatType, ErrorType)) or is_vector(t)):
                self.diagnostics.error(
                    "T018",
                    f"a disturbance is a float or a vector, not {with_article(t)}",
                    d.type.span,
                )
                t = ERROR
            variable = typed.Variable(d.name.text, t, "disturbance", d.name.span)
            taken[d.name.text] = variable
            self.shared.names.note_meaning(d.name.span, variable)
            if interval is None:
                zero = typed.Literal(FLOAT, d.interval.span, 0.0)
                interval = (zero, zero)
            disturbances.append(typed.DisturbanceSymbol(variable, *interval, hold))
        return disturbances

    # ------------------------------------------------------------ body

    def check_body(self, plant: typed.PlantSymbol, decl: tree.PlantDecl, scope: FileScope) -> None:
        """Checks lets, dynamics, outputs and measurement errors."""
        frame = {v.name: v for v in plant.states}
        frame.update({d.variable.name: d.variable for d in plant.disturbances})
        context = Context(
            scope,
            f"plant `{decl.name.text}`",
            topics=set(plant.reads),
            inputs="reads",
            owner=plant,
            broken=decl.name.text in scope.broken,
            has_time=True,
            has_period=True,
            locals=[frame],
            choices=[],
        )
        plant.lets = tuple(self._check_let(item, frame, context) for item in decl.lets)
        self._check_dynamics(plant, decl, context)
        self._check_drives(plant, decl, context)
        plant.measured = tuple(self._check_measured(plant, decl, scope))
        if not plant.extern and not scope.loaded.library:
            self._warn_of_unused_names(plant, decl, context)

    def _check_let(
        self, item: tree.PlantLet, frame: dict[str, typed.Variable], context: Context
    ) -> tuple[typed.Variable, typed.TypedExpr]:
        t = self.shared.resolve_type(item.type, context.scope, context) if item.type else None
        because = (item.type.span, f"declared as `{t}`") if item.type else None
        value = self.shared.check_expr(item.value, context, t, because)
        variable_type = t if t is not None else plain_type(value.type)
        if isinstance(variable_type, DurationType):
            report_stored_duration(value.span, self.diagnostics)
            variable_type = ERROR
        first = frame.get(item.name.text)
        if first is not None:
            self.shared.names.report_duplicate(item.name.text, item.name.span, first.span)
            first.used = True
        variable = typed.Variable(item.name.text, variable_type, "plantlet", item.name.span)
        frame[item.name.text] = variable
        self.shared.names.note_meaning(item.name.span, variable)
        return variable, value

    def _check_dynamics(
        self, plant: typed.PlantSymbol, decl: tree.PlantDecl, context: Context
    ) -> None:
        states = {v.name: v for v in plant.states}
        span_by_state: dict[str, Span] = {}
        for name, _ in (*decl.der, *decl.next):
            if name.text not in states:  # report it before expressions do
                self._report_no_state(plant, decl, name, context)
        for table, items, word in ((plant.der, decl.der, "der"), (plant.next, decl.next, "next")):
            for name, expr in items:
                variable = states.get(name.text)
                self.shared.names.note_meaning(name.span, variable)
                wanted = variable.type if variable else None
                because = (variable.span, f"the state is `{wanted}`") if variable else None
                at = replace(context, choices=None) if word == "der" else context
                value = self.shared.check_expr(expr, at, wanted, because)
                if variable is None:
                    self._report_no_state(plant, decl, name, context)
                elif name.text in span_by_state:
                    message = f"the dynamics of `{name.text}` are given twice"
                    self.shared.names.report_repeated(message, name.span, span_by_state[name.text])
                elif word == "der" and not _can_be_integrated(variable.type):
                    self.diagnostics.error(
                        "T018",
                        f"`der` is for floats and vectors, not for {with_article(variable.type)}",
                        name.span,
                        also=((variable.span, "declared here"),),
                        helps=(f"write `next {name.text} = ...;`",),
                    )
                else:
                    table[variable] = value
                span_by_state.setdefault(name.text, name.span)
        self._report_wrong_motion(plant, decl, span_by_state, context)

    def _report_wrong_motion(
        self,
        plant: typed.PlantSymbol,
        decl: tree.PlantDecl,
        moved: dict[str, Span],
        context: Context,
    ) -> None:
        """Reports X010 of an extern plant with dynamics, M006 of another plant without states."""
        if plant.extern and moved:
            self.diagnostics.error(
                "X010",
                f"extern plant `{decl.name.text}` has dynamics of its own",
                next(iter(moved.values())),
                notes=("the states of an extern plant are moved by the code it is bound to",),
                helps=("leave out `extern` and `from`, or every `der` and `next`",),
            )
        if not plant.extern and not plant.states and decl.name.text not in context.scope.broken:
            self.diagnostics.error(
                "M006",
                f"plant `{decl.name.text}` has no state",
                decl.name.span,
                helps=("add `state x: float;` and `der x = ...;`",),
            )

    def _report_no_state(
        self, plant: typed.PlantSymbol, decl: tree.PlantDecl, name: tree.Name, context: Context
    ) -> None:
        if decl.name.text in context.scope.broken:
            self.shared.names.losses += 1
            return
        self.shared.damaged.add(plant)
        if not self.shared.names.is_first_miss(context.scope, name.text, context.where):
            return
        near = self.diagnostics.did_you_mean(name.text, [v.name for v in plant.states])
        entry = context.scope.entries.get(name.text)
        if entry is not None and entry.kind == "topic" and plant.states:
            states = ", ".join(f"`{v.name}`" for v in plant.states)
            near = (f"it is a topic: what moves is a state of the plant, {states}",)
        self.diagnostics.error(
            "N001",
            f"plant `{decl.name.text}` has no state `{name.text}`",
            name.span,
            "not declared",
            helps=near or (f"add `state {name.text}: float;`",),
        )

    def _check_drives(
        self, plant: typed.PlantSymbol, decl: tree.PlantDecl, context: Context
    ) -> None:
        """Checks the values that drive topics; of two values for one topic, the first is kept."""
        values: dict[typed.TopicSymbol, typed.TypedExpr] = {}
        for ref, expr in decl.drives:
            topic = self.shared.topic_of_ref(ref, context.scope)
            if expr is None:
                continue
            because = (topic.span, f"topic `{topic.name}` is `{topic.type}`") if topic else None
            wanted = topic.type if topic else None
            value = self.shared.check_expr(expr, context, wanted, because)
            if topic is not None:
                values.setdefault(topic, value)
        plant.drives = tuple((t, values[t]) for t, _ in plant.drives)

    def _check_measured(
        self, plant: typed.PlantSymbol, decl: tree.PlantDecl, scope: FileScope
    ) -> list[typed.MeasuredSymbol]:
        context = Context(scope, f"the declaration of plant `{decl.name.text}`")
        driven = {t for t, _ in plant.drives}
        measured: list[typed.MeasuredSymbol] = []
        taken: list[tuple[typed.TopicSymbol, tuple[str, ...], Span]] = []
        for path, bound in decl.measured:
            within = self.shared.check_number(bound, context, FLOAT, "the bound of an error")
            topic_path = self.shared.topic_of_path(path, scope)
            if topic_path is None:
                continue
            topic, below, t = topic_path
            overlap = next(
                (
                    s
                    for o, p, s in taken
                    if o is topic and (_has_prefix(below, p) or _has_prefix(p, below))
                ),
                None,
            )
            if topic not in driven:
                if plant not in self.shared.damaged:
                    self.diagnostics.error(
                        "M009",
                        f"plant `{decl.name.text}` does not drive `{topic.name}`",
                        path.span,
                        notes=("a plant knows the errors of its own outputs only",),
                    )
            elif not _can_be_integrated(t):
                self.diagnostics.error(
                    "T018",
                    f"only floats and vectors are measured with an error, not {with_article(t)}",
                    path.span,
                    helps=("name the fields that are floats",),
                )
            elif overlap is not None:
                self.shared.names.report_repeated(
                    f"the error of `{path.span.text}` is given twice", path.span, overlap
                )
            elif not has_error(within):
                measured.append(typed.MeasuredSymbol(topic, below, within, path.span))
            taken.append((topic, below, path.span))
        return measured

    def _warn_of_unused_names(
        self, plant: typed.PlantSymbol, decl: tree.PlantDecl, context: Context
    ) -> None:
        unused = self.shared.unused
        unused.warn_of_variables([d.variable for d in plant.disturbances])
        unused.warn_of_variables([v for v, _ in plant.lets])
        if unmoved_states(plant):
            return  # its reads may be for dynamics that are not written yet
        for topic, span in zip(plant.reads, plant.read_spans, strict=True):
            if topic not in context.topics_read:
                message = f"plant `{decl.name.text}` never reads `{topic.name}`"
                unused.keep("W001", message, span, "", remove_from_list(span, "leave it out"))


def unmoved_states(plant: typed.PlantSymbol) -> list[typed.Variable]:
    """Gives the states without `der` and `next`, except drawn constants and names with `_`."""
    if plant.extern:
        return []
    return [
        state
        for state, drawn in zip(plant.states, plant.initial_range, strict=True)
        if state not in plant.der
        and state not in plant.next
        and drawn is None
        and not state.name.startswith("_")
    ]


def _has_prefix(path: tuple[str, ...], prefix: tuple[str, ...]) -> bool:
    return path[: len(prefix)] == prefix


def _can_be_integrated(t: Type) -> bool:
    return isinstance(t, (FloatType, ErrorType)) or is_vector(t)
