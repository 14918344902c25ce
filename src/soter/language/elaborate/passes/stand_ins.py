"""Makes the stand-in for a part that a test replaces by its contract.

Purpose: `replace M by contract;` (docs/testing.md, "Contracts") makes a node that publishes, at the
releases of another one, nothing or any values for which the guarantees hold. If these are too many
to be tried one by one, it tries the values that the test states (`guarantees t.x in { a, b };`),
and of other parts one value of each kind that code can distinguish. Stated values become a
condition by which the real part is judged in each test in which it runs; those of `assumes` are
reported as an assumption if no test judges them.
Non-goals: where a stand-in stands (`replace_parts.py`), whether the replaced part keeps its
contract (tests), which values can be distinguished (`distinguishable_values.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Source, Span
from soter.language.check.operators_and_choices import MAX_CHOICES
from soter.language.elaborate.distinguishable_values import representative_numbers
from soter.language.model import typed
from soter.language.model.system import StandIn
from soter.language.model.tree_walk import joined, mode_reads, nodes, rewritten, topic_reads
from soter.language.model.types import (
    BOOL,
    INT,
    ArrayType,
    BoolType,
    EnumType,
    FloatType,
    IntType,
    ListType,
    RecordType,
    leaves,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.elaborate.distinguishable_values import Path, Readers, ReadTopic
    from soter.language.model.system import Bound, Component, Topic
    from soter.language.model.types import Type, Value

    Put = Mapping[typed.TopicSymbol, tuple[typed.Variable, typed.Variable | None]]


_BY_A_NODE = "replace it by a node that chooses the values that matter"


@dataclass(frozen=True)
class ContractStandIn:
    """A replacement by contract: `of` is the full name of the replaced part.

    `clauses` are those of its module. `role` is "ac" or "sc" for a whole module, else "node".
    """

    of: str
    kind: str
    role: str
    clauses: tuple[typed.ClauseSymbol, ...]
    span: Span


class EndlessError(Exception):
    """An error for a topic that has too many values to be tried one by one.

    `part` is the part of the topic; `where` is the code, if any, that distinguishes its values.
    """

    def __init__(self, why: str, where: Span | None = None, part: str = "") -> None:
        super().__init__(why)
        self.where = where
        self.part = part


def make_stand_in(
    node: typed.NodeSymbol, by: ContractStandIn, diagnostics: Diagnostics
) -> tuple[typed.NodeSymbol, StandIn]:
    """Gives a stand-in for `node`, without a step, and its record; reports E015 for bursts."""
    own_clauses = [("", e) for e in node.guarantees]
    contract_clauses = [(c.name, c.condition) for c in by.clauses if c.kind == "guarantees"]
    clauses = [*contract_clauses, *own_clauses]
    used = [(n, e) for n, e in clauses if _is_usable_guarantee(e, node)]
    wholes = tuple(e for _, e in used)
    if node.bursts:
        _refuse_bursts(node, by, diagnostics)
    subscribes = tuple(
        typed.Subscribed(t, None, "drop_oldest", by.span)
        for t in topic_reads(*wholes)
        if t not in node.publishes
    )
    made = node.node_with_step((), subscribes)
    texts = [_clause_text(n, e) for n, e in clauses]
    left = [t for t, pair in zip(texts, clauses, strict=True) if pair not in used]
    kept = tuple(t for t in texts if t not in left)
    return made, StandIn(by.of, by.kind, by.role, kept, tuple(left), wholes, by.span)


def _clause_text(name: str, condition: typed.TypedExpr) -> str:
    """Gives the text of a clause for people, on one line."""
    text = condition.span.text_on_one_line
    return f"{name}: {text}" if name else text


def give_step_to_stand_in(
    c: Component,
    topics: Sequence[Topic],
    stated: Mapping[int, Mapping[Path, Sequence[Value]]],
    readers: Readers,
    diagnostics: Diagnostics,
) -> None:
    """Gives a stand-in its step; reports E015 if it would have to try too many values.

    `stated`: topic index -> part of the topic -> the values that the test states.
    """
    assert c.node is not None
    assert c.stands_for is not None
    hears = readers.may_be_observed(c)
    outputs = {s: topics[c.scope.topics[s]] for s in c.node.publishes if hears}
    every = {s: _TriedValues(t, stated.get(t.index, {}), None) for s, t in outputs.items()}
    heard = {s: t for s, t in outputs.items() if c.module is not None or t.index in readers.heard}
    few = {
        s: _TriedValues(t, stated.get(t.index, {}), readers.reads_of_topic(t.index))
        for s, t in heard.items()
    }
    try:
        try:
            step = tuple(_statements_of_step(every, c.stands_for))
        except EndlessError:
            step = tuple(_statements_of_step(few, c.stands_for))
    except EndlessError as problem:
        note = "every value that a contract permits is a branch of every execution"
        _report_no_stand_in(str(problem), note, c.node, c.stands_for, diagnostics, problem)
        return
    c.node = replace(c.node, step=step)


def _refuse_bursts(node: typed.NodeSymbol, by: ContractStandIn, diagnostics: Diagnostics) -> None:
    names = ", ".join(f"`{t.name}`" for t in node.bursts)
    why = f"{node.name} may publish several messages on {names} in one step"
    note = "a contract speaks of the last message; queues get all of them"
    _report_no_stand_in(why, note, node, by, diagnostics)


def _report_no_stand_in(
    why: str,
    note: str,
    node: typed.NodeSymbol,
    by: ContractStandIn | StandIn,
    diagnostics: Diagnostics,
    endless: EndlessError | None = None,
) -> None:
    also: tuple[tuple[Span, str], ...] = ()
    helps: tuple[str, ...] = (_BY_A_NODE,)
    if endless is not None and endless.where is not None:
        also = ((endless.where, "tells them apart"),)
        part = f"{endless.part} in {{ ... }};`"
        held = f"state the values that it is held to where it runs as it is: `guarantees {part}"
        tried = f"or, where it runs as it is in no test, those that are tried: `assumes {part}"
        helps = (held, tried, f"or {_BY_A_NODE}")
    diagnostics.error(
        "E015",
        f"`{by.of}` cannot be replaced by its contract: {why}",
        by.span,
        also=((node.span, "publishes it"), *also),
        notes=(note,),
        helps=helps,
    )


def _is_usable_guarantee(e: typed.TypedExpr, node: typed.NodeSymbol) -> bool:
    """Whether a guarantee reads no mode, no queue, and no age of an output of the stand-in."""
    queued = {s.topic for s in node.subscribes if s.queue is not None}
    aged = {n.topic for n in nodes([e]) if isinstance(n, typed.AgeRead)}
    return not (mode_reads(e) or queued & topic_reads(e).keys() or aged & set(node.publishes))


# ---------------------------------------------------------------- the step of a stand-in


def _statements_of_step(
    published: Mapping[typed.TopicSymbol, _TriedValues], by: StandIn
) -> Iterator[typed.TypedStmt]:
    """Yields statements that choose topics and values, and publish them if all guarantees hold."""
    put: dict[typed.TopicSymbol, tuple[typed.Variable, typed.Variable | None]] = {}
    single = len(published) == 1
    inner: list[typed.TypedStmt] = []
    alternatives = 1
    for symbol, values in published.items():
        value, count = values.choice_and_count()
        alternatives *= count
        if alternatives > MAX_CHOICES:
            raise EndlessError(f"there are more than {MAX_CHOICES} values of what it publishes")
        short = symbol.name.rpartition(".")[2]
        chosen = typed.Variable(short, symbol.type, "let", by.span, used=True)
        if single:
            put[symbol] = chosen, None
        else:
            is_put = typed.Variable(f"{short}_published", BOOL, "let", by.span, used=True)
            put[symbol] = chosen, is_put
            yield typed.TypedDeclare(by.span, is_put, _choice_to_publish(symbol))
            read = typed.VarRead(BOOL, by.span, is_put)
            value = typed.Conditional(symbol.type, by.span, read, value, _first_choice(value))
        inner.append(typed.TypedDeclare(by.span, chosen, value))
    inner += _publishing_statements(put, by.span, [_with_chosen_values(e, put) for e in by.asked])
    if single:
        arm = (_choice_to_publish(next(iter(published))), tuple(inner))
        yield typed.TypedIf(by.span, (arm,), ())
    elif published:
        yield from inner


def _publishing_statements(
    put: Put, span: Span, holds: Sequence[typed.TypedExpr]
) -> list[typed.TypedStmt]:
    """Gives statements that publish the chosen values if all of the guarantees `holds` are true."""
    out: list[typed.TypedStmt] = []
    for symbol, (chosen, is_put) in put.items():
        value = typed.VarRead(symbol.type, span, chosen)
        publish = typed.TypedPublish(span, symbol, value)
        if is_put is None:
            out.append(publish)
        else:
            out.append(typed.TypedIf(span, ((typed.VarRead(BOOL, span, is_put), (publish,)),), ()))
    if not holds:
        return out
    return [typed.TypedIf(span, ((joined("&&", holds, span), tuple(out)),), ())]


def _with_chosen_values(e: typed.TypedExpr, put: Put) -> typed.TypedExpr:
    """Gives a guarantee that reads the chosen values in place of the stand-in's topics."""

    def chosen_value(read: typed.TypedExpr) -> typed.TypedExpr:
        if not isinstance(read, typed.TopicRead) or read.topic not in put:
            return read
        chosen, is_put = put[read.topic]
        new_value = typed.VarRead(read.type, read.span, chosen)
        if is_put is None:
            return new_value
        asked = typed.VarRead(BOOL, read.span, is_put)
        return typed.Conditional(read.type, read.span, asked, new_value, read)

    new_expr: typed.TypedExpr = rewritten(e, chosen_value)
    return new_expr


# ---------------------------------------------------------------- choices between values


class _TriedValues:
    """The values of a topic that a stand-in tries; all of them if `read` (its reads) is None."""

    def __init__(
        self, topic: Topic, stated: Mapping[Path, Sequence[Value]], read: ReadTopic | None
    ) -> None:
        self.topic = topic
        self.stated = stated
        self.read = read

    def choice_and_count(self) -> tuple[typed.TypedExpr, int]:
        """Gives an expression that chooses a value to try, and the number of values."""
        topic = self.topic
        return self._choice_of_part(topic.type, topic.bounds, topic.default, topic.name, ())

    def _choice_of_part(
        self, t: Type, bounds: Sequence[Bound | None], first: Value, name: str, path: Path | None
    ) -> tuple[typed.TypedExpr, int]:
        """Gives a choice between values of a part, and their count; `path` is None in an array."""
        if path is not None and path in self.stated:
            return _value_choice(t, self.stated[path], name)
        if isinstance(t, RecordType) or (isinstance(t, ArrayType) and self._tries_elements(path)):
            return self._choice_of_parts(t, bounds, first, name, path)
        where = None
        if self.read is not None and path is not None:
            where = self.read.place_of_whole_read(path)
            if where is None:
                compared = self.read.compared.get(path)
                if compared is None:
                    return typed.Literal(t, _span_with_text(name), first), 1
                assert isinstance(t, (IntType, FloatType))
                return _value_choice(t, representative_numbers(compared, bounds[0], t, first), name)
        return _choice_of_all(t, bounds, name, where)

    def _tries_elements(self, path: Path | None) -> bool:
        """Whether code distinguishes values of an array's elements, or all are to be tried."""
        return self.read is None or path is None or self.read.place_of_whole_read(path) is not None

    def _choice_of_parts(
        self,
        t: RecordType | ArrayType,
        bounds: Sequence[Bound | None],
        first: Value,
        name: str,
        path: Path | None,
    ) -> tuple[typed.TypedExpr, int]:
        if isinstance(t, RecordType):
            parts = [(f".{n}", f) for n, f in t.fields]
        else:
            parts = [(f"[{i}]", t.element) for i in range(t.size)]
        elements: list[typed.TypedExpr] = []
        total, at = 1, 0
        for index, ((ending, part), value) in enumerate(zip(parts, first, strict=True)):
            width = sum(1 for _ in leaves(part))
            below = (*path, index) if path is not None and isinstance(t, RecordType) else None
            inner, count = self._choice_of_part(
                part, bounds[at : at + width], value, name + ending, below
            )
            elements.append(inner)
            total *= count
            at += width
        return typed.Aggregate(t, _span_with_text(name), tuple(elements)), total


def _choice_of_all(
    t: Type, bounds: Sequence[Bound | None], name: str, where: Span | None
) -> tuple[typed.TypedExpr, int]:
    """Gives a choice of all values of a scalar, and their number; EndlessError if too many."""
    low, count = 0, 0
    if isinstance(t, BoolType):
        count = 2
    elif isinstance(t, EnumType):
        count = len(t.members)
    elif isinstance(t, IntType):
        bound = bounds[0]
        low, high = (t.low, t.high) if bound is None else (int(bound.low), int(bound.high))
        count = high - low + 1
    if not count:
        raise EndlessError(
            f"the values of `{name}`, `{t}`, cannot be tried one by one", where, name
        )
    if count > MAX_CHOICES:
        raise EndlessError(f"`{name}` has {count} values, more than {MAX_CHOICES}", where, name)
    return typed.TypedChoose(t, _span_with_text(f"any {name}"), count, low, (), None), count


def _value_choice(t: Type, values: Sequence[Value], name: str) -> tuple[typed.TypedExpr, int]:
    span = _span_with_text(f"any {name}")
    options = tuple(typed.Literal(t, span, v) for v in values)
    if len(options) == 1:
        return options[0], 1
    return typed.TypedChoose(t, span, len(options), 0, options, None), len(options)


def _choice_to_publish(symbol: typed.TopicSymbol) -> typed.TypedExpr:
    return typed.TypedChoose(BOOL, _span_with_text(f"publish {symbol.name}?"), 2, 0, (), None)


def _first_choice(value: typed.TypedExpr) -> typed.TypedExpr:
    """Gives the first of the values that `value` chooses from, where any of them is right."""
    if isinstance(value, typed.Aggregate):
        return replace(value, elements=tuple(_first_choice(e) for e in value.elements))
    if isinstance(value, typed.Literal):
        return value
    assert isinstance(value, typed.TypedChoose)
    if value.options:
        return value.options[0]
    number = bool(value.low) if isinstance(value.type, BoolType) else value.low
    return typed.Literal(value.type, value.span, number)


def _span_with_text(words: str) -> Span:
    """Gives a span whose source text is `words`; a trace uses it to name a choice."""
    return Span(Source("contract", words), 0, len(words))


@dataclass(frozen=True)
class StatedValues:
    """The values that a test states for a part of a topic; `first` is the part's first value.

    `promised`: the test `guarantees` them, so that `first` is tried, too; else it `assumes` them.
    """

    topic: int
    path: Path
    values: tuple[Value, ...]
    first: Value
    promised: bool
    text: str
    span: Span

    @property
    def tried_values(self) -> tuple[Value, ...]:
        """Gives the values that a stand-in tries; if they are promised, also the first value."""
        every = (self.first, *self.values) if self.promised else self.values
        return tuple(dict.fromkeys(every))


def topic_and_path(read: typed.TypedExpr) -> tuple[typed.TopicSymbol, Path]:
    """Gives the topic that `read` reads, and the path of the field in it, outermost index first."""
    path: list[int] = []
    while isinstance(read, typed.TypedField):
        path.append(read.index)
        read = read.target
    assert isinstance(read, typed.TopicRead)
    return read.topic, tuple(reversed(path))


def part_at(value: Value, path: Path) -> Value:
    """Gives the part of a value at `path`."""
    for index in path:
        value = value[index]
    return value


def with_part(value: Value, path: Path, part: Value) -> Value:
    """Gives a copy of the value in which `part` stands at `path`."""
    if not path:
        return part
    inner = with_part(value[path[0]], path[1:], part)
    return (*value[: path[0]], inner, *value[path[0] + 1 :])


def equality_with_one_of(read: typed.TypedExpr, values: Sequence[Value]) -> typed.TypedExpr:
    """Gives the condition that `read` equals one of the values in all leaves, with 0.0 == -0.0."""
    each = [joined("&&", [*_equalities(read, v)], read.span) for v in values]
    return joined("||", each, read.span)


def _equalities(read: typed.TypedExpr, value: Value) -> Iterator[typed.TypedExpr]:
    t, span = read.type, read.span
    if isinstance(t, RecordType):
        for index, ((_, part), v) in enumerate(zip(t.fields, value, strict=True)):
            yield from _equalities(typed.TypedField(part, span, read, index), v)
    elif isinstance(t, (ArrayType, ListType)):
        if isinstance(t, ListType):
            yield _equality(typed.TypedLength(INT, span, read), len(value))
        for index, v in enumerate(value):
            at = typed.Literal(INT, span, index)
            yield from _equalities(typed.Index(t.element, span, read, at), v)
    else:
        yield _equality(read, value)


def _equality(read: typed.TypedExpr, value: Value) -> typed.TypedExpr:
    t: Type = read.type
    if t == BOOL:
        return read if value else typed.TypedUnary(BOOL, read.span, "!", read)
    literal = typed.Literal(t, read.span, value)
    return typed.TypedBinary(BOOL, read.span, "==", read, literal)
