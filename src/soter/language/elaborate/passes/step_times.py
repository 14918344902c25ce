"""Elaborates the times that a program declares of its steps (`takes`, `wcet`, `jitter`, `inline`).

Purpose: checks which nodes may take how long (M023), computes the numbers of `wcet` and `jitter`,
marks the nodes that run `inline` in the trusted thread, and adds the faults by which an SC waits
for its DM (decision module) where the deployed order is kept.
Non-goals: what a run does with it (`semantics/rules.py`, `codegen/nodes.py`); what follows from
execution times (`soter.timing`); systems whose order is drawn, where nobody waits; how old reads
may be (`read_ages.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fixes import exchange_bounds
from soter.language.elaborate.passes.system_numbers import MAX_PERIOD_NS
from soter.language.model.system import Fault
from soter.language.model.types import show_ns, write_ns

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.elaborate.passes.flattening import Flattening
    from soter.language.elaborate.passes.system_numbers import Numbers
    from soter.language.model import typed
    from soter.language.model.system import Component, Module
    from soter.language.model.typed import NodeSymbol

WAIT = "wait"


def check_step_times(
    node: NodeSymbol, role: str, times: tuple[int, int], diagnostics: Diagnostics
) -> None:
    """Reports V001 for times in the wrong order, and M023 if the node's steps may not take time.

    `role` is "ac" or "sc" inside a module.
    """
    assert node.takes is not None
    low, high = times
    span = node.takes[0].span.to(node.takes[1].span)
    if low > high:
        diagnostics.error(
            "V001",
            f"[{write_ns(low)}, {write_ns(high)}] is empty",
            span,
            "the lower bound is above the upper one",
            helps=(exchange_bounds(node.takes[0].span, node.takes[1].span),),
        )
        return
    for message, note, help_ in _reasons_against_takes(node, role):
        diagnostics.error(
            "M023",
            message,
            span,
            also=((node.span, "declared here"),),
            notes=(note,),
            helps=(help_,),
        )


def _reasons_against_takes(node: NodeSymbol, role: str) -> Iterator[tuple[str, str, str]]:
    """Yields message, note and help for each reason why steps of a node may not take time."""
    if role == "sc":
        yield (
            f"`{node.name}` is a safe controller: its steps may not take time",
            "what SC publishes has to count when the decision module calls for it",
            "say in the `verify` block what the machine needs for it: `response sc ...;`",
        )
    for topic in node.bursts:
        yield (
            f"a step of `{node.name}` takes time: not several messages on `{topic.name}`",
            "what a step publishes is held until it takes effect, one value a topic",
            f"publish `{topic.name}` without `[<=...]`, or a list as one value",
        )
    if not node.publishes:
        yield (
            f"`{node.name}` publishes nothing that could take effect later",
            "`takes` says when what a step publishes counts",
            "leave it out",
        )


def check_double_response(
    modules: Iterable[Module], components: Iterable[Component], diagnostics: Diagnostics
) -> None:
    """Reports N002 for a `response` in a `verify` block if the node itself declares `takes`."""
    lasting = [c for c in components if c.takes_ns is not None]
    for m in modules:
        home = m.name.rpartition(".")[0]
        responses = m.symbol.verify.response_of
        for c in lasting:
            assert c.node is not None
            assert c.node.takes is not None
            name = c.name.removeprefix(f"{home}.") if home else c.name
            if name not in responses:
                continue
            diagnostics.error(
                "N002",
                f"how long a step of `{name}` takes is said twice",
                responses[name].span,
                "its `response`",
                also=((c.node.takes[0].span.to(c.node.takes[1].span), "what it says itself"),),
                notes=("a proof counts with the longest that the node says",),
                helps=("leave out the `response`",),
            )


def wcet_and_jitter(
    numbers: Numbers, symbol: typed.NodeSymbol | typed.ModuleSymbol
) -> tuple[int | None, int]:
    """Gives `wcet` and `jitter` in ns; None and 0 if they are undeclared or after an error."""
    jitter = _time_ns(numbers, symbol.jitter, f"the jitter of `{symbol.name}`", least=0)
    return _time_ns(numbers, symbol.wcet, f"the wcet of `{symbol.name}`", least=1), jitter or 0


def _time_ns(
    numbers: Numbers, expr: typed.TypedExpr | None, description: str, *, least: int
) -> int | None:
    """Gives a time of at least `least` ns; None after reporting C001 or C002."""
    needed = "cannot be negative" if least == 0 else "must be longer than zero"
    value = numbers.time_ns_from(expr, description, least, needed)
    if value is None or expr is None or value <= MAX_PERIOD_NS:
        return value
    numbers.diagnostics.error(
        "C002",
        f"{description} cannot be {show_ns(value)}",
        expr.span,
        f"up to {show_ns(MAX_PERIOD_NS)} is possible",
    )
    return None


def mark_inline_nodes(flat: Flattening) -> None:
    """Marks the nodes that systems declare `inline`; reports M013 for a name of no node."""
    by_name = {c.name: c for c in flat.components if c.node is not None}
    for part in flat.parts if not flat.partial else ():
        for path, span in part.system.inlines:
            component = by_name.get(part.prefix + path)
            if component is not None:
                component.inline = True
                continue
            near = [n.removeprefix(part.prefix) for n in by_name if n.startswith(part.prefix)]
            flat.diagnostics.error(
                "M013",
                f"`{path}` is not a node of system `{part.system.name}`",
                span,
                notes=("`inline` names the nodes that run in the thread of the trusted part",),
                helps=flat.diagnostics.did_you_mean(path, near, span),
            )


def with_wait_faults(
    modules: Sequence[Module], faults: Sequence[Fault], *, shuffled: bool
) -> tuple[Fault, ...]:
    """Gives `faults` and, unless `shuffled`, a "wait" fault for each SC whose DM may be late."""
    others = [f for f in faults if f.kind != WAIT]
    return (*others, *(() if shuffled else _wait_faults(modules, others)))


def _wait_faults(modules: Sequence[Module], faults: Sequence[Fault]) -> Iterator[Fault]:
    late = {f.component: f.inside for f in faults if f.kind == "late"}
    for m in modules:
        if m.dm in late:
            yield Fault(
                kind=WAIT,
                component=m.sc,
                stream="",
                probability=1.0,
                slot_ns=0,
                on=m.dm,
                inside="SC waits for its decision module",
                text=f"{m.name}: SC waits for its decision module",
            )
