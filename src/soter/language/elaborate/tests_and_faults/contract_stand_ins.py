"""What stands for a node of which only the contract counts: any publication that satisfies it.

Purpose: `replace M by contract;` of a test (docs/testing.md, "Contracts"): a node that at the
releases of another one publishes nothing, or any values of the sets of its topics of which the
guarantees are true. Clauses that cannot be asked there are left out: more is permitted then.
Non-goals: where it stands (`instantiate.py`), whether what it stands for keeps its contract
(tests).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from soter.diagnostics.source import Source
from soter.diagnostics.span import Span
from soter.language.check.expressions.choose import MAX_CHOICES
from soter.language.model import typed
from soter.language.model.system import StandIn
from soter.language.model.tree_walk import mode_reads, nodes, rewritten, topic_reads
from soter.language.model.types import (
    BOOL,
    ArrayType,
    BoolType,
    EnumType,
    IntType,
    RecordType,
    leaf_count,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Bound, Topic
    from soter.language.model.types import Type

    Put = Mapping[typed.TopicSymbol, tuple[typed.Variable, typed.Variable | None]]


@dataclass(frozen=True)
class ContractStandIn:
    """`of`: full name of the module or node that is replaced; `clauses`: those of its modules.

    `role`: of the node that is stood for: "ac" or "sc" of a module, "node" elsewhere.
    """

    of: str
    kind: str
    role: str
    clauses: tuple[typed.ClauseSymbol, ...]
    span: Span


class EndlessError(Exception):
    """A topic has values that cannot be tried one by one; the message says which."""


def stand_in(
    node: typed.NodeSymbol,
    by: ContractStandIn,
    topics: Mapping[typed.TopicSymbol, Topic],
    diagnostics: Diagnostics,
) -> tuple[typed.NodeSymbol, StandIn]:
    """The node in the place of `node`; `topics`: what it publishes, with sets. E015 if endless."""
    own = [("", e) for e in node.guarantees]
    given = [(c.name, c.condition) for c in by.clauses if c.kind == "guarantees"]
    used = [(n, e) for n, e in [*given, *own] if _can_be_asked(e, node)]
    wholes = [e for _, e in used]
    reads = [t for t in topic_reads(*wholes) if t not in node.publishes]
    step: tuple[typed.TypedStmt, ...] = ()
    if node.bursts:
        _refuse_messages(node, by, diagnostics)
    else:
        try:
            step = tuple(_step(node, by, topics, wholes))
        except EndlessError as problem:
            note = "every value that a contract permits is a branch of every execution"
            _refuse(str(problem), note, node, by, diagnostics)
    subscribes = tuple(typed.Subscribed(t, None, "drop_oldest", by.span) for t in reads)
    made = node.doing(step, subscribes)
    texts = [(n, " ".join(e.span.text.split())) for n, e in [*given, *own]]
    told = [f"{n}: {text}" if n else text for n, text in texts]
    left = [t for t, pair in zip(told, [*given, *own], strict=True) if pair not in used]
    kept = tuple(t for t in told if t not in left)
    return made, StandIn(by.of, by.kind, by.role, kept, tuple(left))


def _refuse_messages(node: typed.NodeSymbol, by: ContractStandIn, diagnostics: Diagnostics) -> None:
    names = ", ".join(f"`{t.name}`" for t in node.bursts)
    why = f"{node.name} may publish several messages on {names} in one step"
    note = "a contract speaks of the last message; queues get all of them"
    _refuse(why, note, node, by, diagnostics)


def _refuse(
    why: str, note: str, node: typed.NodeSymbol, by: ContractStandIn, diagnostics: Diagnostics
) -> None:
    diagnostics.error(
        "E015",
        f"`{by.of}` cannot be replaced by its contract: {why}",
        by.span,
        also=((node.span, "publishes it"),),
        notes=(note,),
        helps=("replace it by a node that chooses the values that matter",),
    )


def _can_be_asked(e: typed.TypedExpr, node: typed.NodeSymbol) -> bool:
    """Not of modes, of queues, or of the age of what has just been published."""
    queued = {s.topic for s in node.subscribes if s.queue is not None}
    aged = {n.topic for n in nodes([e]) if isinstance(n, typed.AgeRead)}
    return not (mode_reads(e) or queued & topic_reads(e).keys() or aged & set(node.publishes))


# ---------------------------------------------------------------- its step


def _step(
    node: typed.NodeSymbol,
    by: ContractStandIn,
    topics: Mapping[typed.TopicSymbol, Topic],
    guarantees: Sequence[typed.TypedExpr],
) -> Iterator[typed.TypedStmt]:
    """For each topic: is it published, with which value; then all of them, if that is permitted."""
    put: dict[typed.TopicSymbol, tuple[typed.Variable, typed.Variable | None]] = {}
    single = len(node.publishes) == 1
    inner: list[typed.TypedStmt] = []
    alternatives = 1
    for symbol in node.publishes:
        topic = topics[symbol]
        value, count = _any_value(topic.type, topic.bounds, topic.name)
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
            yield typed.TypedDeclare(by.span, is_put, _published(symbol))
            read = typed.VarRead(BOOL, by.span, is_put)
            value = typed.Conditional(symbol.type, by.span, read, value, _first(value))
        inner.append(typed.TypedDeclare(by.span, chosen, value))
    inner += _published_if(put, by.span, [_with(e, put) for e in guarantees])
    if single:
        arm = (_published(node.publishes[0]), tuple(inner))
        yield typed.TypedIf(by.span, (arm,), ())
    else:
        yield from inner


def _published_if(put: Put, span: Span, holds: Sequence[typed.TypedExpr]) -> list[typed.TypedStmt]:
    """Publish, where all guarantees hold."""
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
    condition = holds[0]
    for other in holds[1:]:
        condition = typed.TypedBinary(BOOL, span, "&&", condition, other)
    return [typed.TypedIf(span, ((condition, tuple(out)),), ())]


def _with(e: typed.TypedExpr, put: Put) -> typed.TypedExpr:
    """An expression about topics with what is about to be published in their place."""

    def value(read: typed.TypedExpr) -> typed.TypedExpr:
        if not isinstance(read, typed.TopicRead) or read.topic not in put:
            return read
        chosen, is_put = put[read.topic]
        said = typed.VarRead(read.type, read.span, chosen)
        if is_put is None:
            return said
        asked = typed.VarRead(BOOL, read.span, is_put)
        return typed.Conditional(read.type, read.span, asked, said, read)

    new_expr: typed.TypedExpr = rewritten(e, value)
    return new_expr


# ---------------------------------------------------------------- any value


def _any_value(t: Type, bounds: Sequence[Bound | None], name: str) -> tuple[typed.TypedExpr, int]:
    """An expression that may be every value of a type within bounds, and how many there are."""
    if isinstance(t, (RecordType, ArrayType)):
        parts = [(f".{n}", f) for n, f in t.fields] if isinstance(t, RecordType) else []
        if isinstance(t, ArrayType):
            parts = [(f"[{i}]", t.element) for i in range(t.size)]
        elements: list[typed.TypedExpr] = []
        total, at = 1, 0
        for ending, part in parts:
            width = leaf_count(part)
            value, count = _any_value(part, bounds[at : at + width], name + ending)
            elements.append(value)
            total *= count
            at += width
        return typed.Aggregate(t, _span(name), tuple(elements)), total
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
        raise EndlessError(f"the values of `{name}`, `{t}`, cannot be tried one by one")
    if count > MAX_CHOICES:
        raise EndlessError(f"`{name}` has {count} values, more than {MAX_CHOICES}")
    return typed.TypedChoose(t, _span(f"any {name}"), count, low, (), None), count


def _published(symbol: typed.TopicSymbol) -> typed.TypedExpr:
    return typed.TypedChoose(BOOL, _span(f"publish {symbol.name}?"), 2, 0, (), None)


def _first(value: typed.TypedExpr) -> typed.TypedExpr:
    """One of the values, where it does not matter which."""
    if isinstance(value, typed.Aggregate):
        return replace(value, elements=tuple(_first(e) for e in value.elements))
    assert isinstance(value, typed.TypedChoose)
    number = bool(value.low) if isinstance(value.type, BoolType) else value.low
    return typed.Literal(value.type, value.span, number)


def _span(words: str) -> Span:
    """Words for people, as if they stood in a program: choices are told by them."""
    return Span(Source("contract", words), 0, len(words))
