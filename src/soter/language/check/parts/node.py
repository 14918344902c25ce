"""Checks nodes: their topics, locals and steps, and the bindings of extern ones.

Purpose: turns `node` and `extern node` declarations into `NodeSymbol`s; inputs and outputs must be
disjoint. A binding (`"python:file.py:name"`, `"c:file.c:name"`, `"onnx:file.onnx"`) must have a
known form; its file is relative to the file that declares it.
Non-goals: modules (`module.py`), numbers (`system_numbers.py`), whether there is such a file
(`simulate/externs/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fixes import remove_from_list
from soter.language.check import unknown_names
from soter.language.check.checker_interface import Context
from soter.language.check.expression_base import CheckerPart, has_error
from soter.language.load.named_files import FORMS, binding_of
from soter.language.model import typed
from soter.language.model.types import BOOL, DURATION, leaf_count
from soter.language.model.values import VALUE_MAX

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.diagnostics.diagnostic import Diagnostics, Span
    from soter.language.check.scope import FileScope
    from soter.language.syntax import tree


def check_binding(source: str | None, span: Span | None, diagnostics: Diagnostics) -> None:
    """Reports X009 for a text that is no binding."""
    if source is None or binding_of(source) is not None:
        return
    form = FORMS.get(source.partition(":")[0], FORMS["python"])
    diagnostics.error(
        "X009",
        f"`{source}` is no binding",
        span,
        notes=("a binding names the language, the file and the function",),
        helps=(f'write `"{form}"`',),
    )


def binding_in_folder(source: str | None, scope: FileScope) -> str | None:
    """Gives the binding with its path resolved from the folder of the declaring file."""
    binding = binding_of(source)
    return source if binding is None else str(binding.in_folder(scope.loaded.path.parent))


UNKNOWN = "<error>"
"""Name of the literal that stands for a period with an error."""


def period_or_unknown(period: typed.TypedExpr) -> typed.TypedExpr:
    """Gives the period; if it has an error, a literal that `system_numbers.py` ignores."""
    return typed.Literal(DURATION, period.span, 0, UNKNOWN) if has_error(period) else period


def refuse_input_topic(topic: typed.TopicSymbol, span: Span, diagnostics: Diagnostics) -> None:
    """Reports M011 for an input topic that the program itself would set."""
    diagnostics.error(
        "M011",
        f"`{topic.name}` is an input topic: only the environment sets it",
        span,
        "set by the program here",
        also=((topic.span, "declared `input` here"),),
        helps=("declare it without `input`",),
    )


MAX_OUTPUTS = 32
"""Most outputs of a node: the publications of a step are bits of one machine word."""


class NodeChecker(CheckerPart):
    """Checks nodes of one program."""

    def symbol_of(self, decl: tree.NodeDecl, scope: FileScope, full_name: str) -> typed.NodeSymbol:
        """Gives the symbol of a node, in which everything except the code is checked."""
        context = Context(scope, f"the declaration of node `{decl.name.text}`")
        period = self.shared.check_number(decl.period, context, DURATION, "a period")
        phase = self.check_number_if_given(decl.phase, context, DURATION, "a phase")
        check_binding(decl.source, decl.source_span, self.diagnostics)
        subscribes = self._check_inputs(decl, scope)
        bursts: dict[typed.TopicSymbol, int] = {}
        publishes = self._check_outputs(decl, scope, subscribes, bursts)
        locals_, initial = self._check_locals(decl, scope, context)
        failsafe = self._check_failsafe(decl, scope, publishes, context)
        node = typed.NodeSymbol(
            full_name,
            decl.name.span,
            period=period_or_unknown(period),
            phase=phase,
            extern=decl.extern,
            source=binding_in_folder(decl.source, scope),
            subscribes=tuple(subscribes.values()),
            publishes=tuple(publishes),
            failsafe=failsafe,
            locals=tuple(locals_),
            initial=tuple(initial),
            assumes=(),
            guarantees=(),
            takeover=None,
            step=(),
            bursts=bursts,
            takes=self._check_takes(decl, context),
            wcet=self.check_number_if_given(decl.wcet, context, DURATION, "`wcet`"),
            jitter=self.check_number_if_given(decl.jitter, context, DURATION, "`jitter`"),
        )
        self.shared.check_body_later(node, decl, scope)
        return node

    def _check_takes(
        self, decl: tree.NodeDecl, context: Context
    ) -> tuple[typed.TypedExpr, typed.TypedExpr] | None:
        """Gives the least and longest time of a step; None if undeclared or after an error."""
        if decl.takes is None:
            return None
        low, high = (
            self.check_number_if_given(end, context, DURATION, "how long a step takes")
            for end in (decl.takes.low, decl.takes.high)
        )
        return None if low is None or high is None else (low, high)

    # ------------------------------------------------------------ inputs and outputs

    def _check_inputs(
        self, decl: tree.NodeDecl, scope: FileScope
    ) -> dict[typed.TopicSymbol, typed.Subscribed]:
        subscription_by_topic: dict[typed.TopicSymbol, typed.Subscribed] = {}
        for s in decl.subscribes:
            topic = self.shared.topic_of_ref(s.topic, scope)
            if topic is None:
                continue
            if topic in subscription_by_topic:
                self.shared.names.report_repeated(
                    f"`{s.topic.text}` is subscribed to twice",
                    s.span,
                    subscription_by_topic[topic].span,
                )
                continue
            policy = s.policy or "drop_oldest"
            queue = self._checked_message_count(
                s.queue, s.span, topic, "a queue holds", "this queue holds"
            )
            subscription_by_topic[topic] = typed.Subscribed(topic, queue, policy, s.span)
        return subscription_by_topic

    def _checked_message_count(
        self, count: int | None, span: Span, topic: typed.TopicSymbol, each: str, these: str
    ) -> int | None:
        """Gives the declared size of a queue or burst, or None; reports T011 for a bad size."""
        if count is None:
            return None
        numbers = count * leaf_count(topic.type)
        if count < 1:
            self.diagnostics.error("T011", f"{each} at least one message", span, f"not {count}")
        elif numbers > VALUE_MAX:
            most = f"at most {VALUE_MAX} are possible"
            self.diagnostics.error("T011", f"{these} {numbers} numbers", span, most)
        return max(count, 1)

    def _check_outputs(
        self,
        decl: tree.NodeDecl,
        scope: FileScope,
        subscribes: dict[typed.TopicSymbol, typed.Subscribed],
        bursts: dict[typed.TopicSymbol, int],
    ) -> dict[typed.TopicSymbol, Span]:
        """Gives output -> place and fills `bursts`; reports M001 for an output that is an input."""
        span_by_topic: dict[typed.TopicSymbol, Span] = {}
        for publication in decl.publishes:
            ref = publication.topic
            topic = self.shared.topic_of_ref(ref, scope)
            if topic is None:
                continue
            if topic in span_by_topic:
                self.shared.names.report_repeated(
                    f"`{ref.text}` is published twice", ref.span, span_by_topic[topic]
                )
                continue
            if topic in subscribes:
                self.diagnostics.error(
                    "M001",
                    f"`{decl.name.text}` both subscribes to and publishes `{topic.name}`",
                    ref.span,
                    "published here",
                    also=((subscribes[topic].span, "subscribed to here"),),
                    notes=("the inputs and the outputs of a node are disjoint",),
                    helps=("keep the value in a local: `var last: ...;`",),
                )
            if topic.input:
                refuse_input_topic(topic, ref.span, self.diagnostics)
            span_by_topic[topic] = ref.span
            count, at = publication.burst, publication.span
            burst = self._checked_message_count(
                count, at, topic, "a step publishes", "these messages hold"
            )
            if burst is not None:
                bursts[topic] = burst
        if len(span_by_topic) > MAX_OUTPUTS:
            self.diagnostics.error(
                "M016",
                f"`{decl.name.text}` publishes {len(span_by_topic)} topics",
                decl.name.span,
                f"at most {MAX_OUTPUTS} are possible",
                helps=("put values that belong together into one record",),
            )
        if decl.extern:
            self._require_distinct_last_names(
                decl, [s.topic for s in subscribes.values()], subscribes, "reads"
            )
            self._require_distinct_last_names(decl, list(span_by_topic), span_by_topic, "publishes")
        return span_by_topic

    def _require_distinct_last_names(
        self,
        decl: tree.NodeDecl,
        topics: list[typed.TopicSymbol],
        spans: Mapping[typed.TopicSymbol, typed.Subscribed | Span],
        verb: str,
    ) -> None:
        """Reports M017 for two topics with the same last name, as externs know only last names."""
        taken: dict[str, typed.TopicSymbol] = {}
        for topic in topics:
            short = topic.name.rpartition(".")[2]
            other = taken.get(short)
            if other is None and verb == "publishes":
                other = taken.get(short.removeprefix("has_")) if short.startswith("has_") else None
                other = other or taken.get(f"has_{short}")
            if other is not None:
                place = spans[topic]
                span = place.span if isinstance(place, typed.Subscribed) else place
                self.diagnostics.error(
                    "M017",
                    f"extern `{decl.name.text}` {verb} `{other.name}` and `{topic.name}`, which it "
                    "cannot tell apart",
                    span,
                    notes=(
                        "an extern knows topics by the last part of their names",
                        "in C `has_t` says that `t` is given",
                    ),
                    helps=("declare a topic of another name and wire it in the system",),
                )
            taken.setdefault(short, topic)

    # ------------------------------------------------------------ locals and fail-safe values

    def _check_locals(
        self, decl: tree.NodeDecl, scope: FileScope, context: Context
    ) -> tuple[list[typed.Variable], list[typed.TypedExpr | None]]:
        variables: dict[str, typed.Variable] = {}
        initial: list[typed.TypedExpr | None] = []
        for local in decl.locals:
            t = self.shared.resolve_type(local.type, scope)
            because = (local.type.span, f"declared as `{t}`")
            value = self.check_number_if_given(local.initial, context, t, "a first value", because)
            first = variables.get(local.name.text)
            if first is not None:
                self.shared.names.report_duplicate(local.name.text, local.name.span, first.span)
                continue
            variables[local.name.text] = typed.Variable(
                local.name.text, t, "local", local.name.span
            )
            self.shared.names.note_meaning(local.name.span, variables[local.name.text])
            initial.append(value)
        return list(variables.values()), initial

    def _check_failsafe(
        self,
        decl: tree.NodeDecl,
        scope: FileScope,
        publishes: dict[typed.TopicSymbol, Span],
        context: Context,
    ) -> dict[typed.TopicSymbol, typed.TypedExpr]:
        result: dict[typed.TopicSymbol, typed.TypedExpr] = {}
        spans: dict[typed.TopicSymbol, Span] = {}
        for ref, expr in decl.failsafe:
            topic = self.shared.topic_of_ref(ref, scope)
            because = (topic.span, f"topic `{topic.name}` is `{topic.type}`") if topic else None
            wanted = topic.type if topic else None
            value = self.shared.check_number(expr, context, wanted, "a fail-safe value", because)
            if topic is None:
                continue
            if topic not in publishes:
                self.diagnostics.error(
                    "M009",
                    f"`{decl.name.text}` does not publish `{ref.text}`",
                    ref.span,
                    notes=("fail-safe values take the place of what a node publishes",),
                    helps=unknown_names.publishing_helps(
                        (e.decl for e in scope.entries.values()), ref.text, decl.name
                    ),
                )
            elif topic in spans:
                self.shared.names.report_repeated(
                    f"the fail-safe value of `{ref.text}` is given twice", ref.span, spans[topic]
                )
            elif not has_error(value):
                result[topic] = value
            spans.setdefault(topic, ref.span)
        return result

    # ------------------------------------------------------------ code

    def check_body(self, node: typed.NodeSymbol, decl: tree.NodeDecl, scope: FileScope) -> None:
        """Checks contracts, the code that runs on takeover, and the step."""
        frame = {v.name: v for v in node.locals}
        inputs = {s.topic for s in node.subscribes}
        where = f"node `{decl.name.text}`"
        queues = {s.topic: s.queue for s in node.subscribes if s.queue is not None}
        context = Context(
            scope,
            where,
            topics=inputs,
            queues=queues,
            has_time=True,
            has_period=True,
            has_modes=True,
            node=node,
            owner=node,
            broken=decl.name.text in scope.broken,
            locals=[frame],
        )
        self._check_contracts(node, decl, context)
        if decl.takeover is not None:
            reset = Context(
                scope,
                f"`on takeover` of `{decl.name.text}`",
                topics=inputs,
                queues=queues,
                has_time=True,
                has_period=True,
                owner=node,
                broken=context.broken,
                locals=[frame],
                topics_read=context.topics_read,
            )
            node.takeover = self.shared.check_block(decl.takeover, reset)
        if decl.step is not None:
            context.choices = []
            node.step = self.shared.check_block(decl.step, context)
            node.locals += tuple(context.choices)
            node.initial += (None,) * len(context.choices)
            context.choices = None
        if not decl.extern and not scope.loaded.library:
            self._warn_unused(node, decl, context)

    def _check_contracts(self, node: typed.NodeSymbol, decl: tree.NodeDecl, step: Context) -> None:
        """Checks `assumes` and `guarantees`, which may read topics, time and modes, not locals."""
        inputs = {s.topic for s in node.subscribes}
        context = Context(
            step.scope,
            f"a contract of {step.where}",
            topics=inputs,
            queues=step.queues,
            has_time=True,
            has_modes=True,
            owner=node,
            broken=step.broken,
            private=step.locals[0],
            topics_read=step.topics_read,
        )
        check = self.shared.check_expr
        assumes = [check(e, context, BOOL) for e in decl.assumes]
        context.topics = inputs | set(node.publishes)
        guarantees = [check(e, context, BOOL) for e in decl.guarantees]
        node.assumes = tuple(e for e in assumes if not has_error(e))
        node.guarantees = tuple(e for e in guarantees if not has_error(e))

    def _warn_unused(self, node: typed.NodeSymbol, decl: tree.NodeDecl, context: Context) -> None:
        name = decl.name.text
        published = self.shared.published.get(node, set())
        spans = {
            t: p.topic.span
            for p in decl.publishes
            if (t := self.shared.topic_of_ref(p.topic, context.scope)) is not None
        }
        for topic in node.publishes:
            if topic not in published:
                self.shared.unused.keep(
                    "W004",
                    f"`{name}` never publishes `{topic.name}`",
                    spans.get(topic, decl.name.span),
                    "declared here",
                    "publish it in the step, or leave it out here",
                )
        for s in node.subscribes:
            if s.topic not in context.topics_read:
                self.shared.unused.keep(
                    "W001",
                    f"`{name}` never reads `{s.topic.name}`",
                    s.span,
                    "",
                    remove_from_list(s.span, "leave it out"),
                )
        self.shared.unused.warn_of_variables(list(node.locals))
