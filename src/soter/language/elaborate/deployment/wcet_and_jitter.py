"""Execution times: `wcet` and `jitter` of nodes and decision modules, `inline` of systems.

Purpose: their numbers, and who of the controllers runs in the thread of the trusted part.
Non-goals: what follows from them (`soter.timing`); a run, in which steps take no time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.elaborate.numeric_values import MAX_PERIOD_NS
from soter.language.model.durations import show_ns

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.elaborate.instantiate import SubSystem
    from soter.language.elaborate.numeric_values import Numbers
    from soter.language.model import typed
    from soter.language.model.system import Component


def budget(numbers: Numbers, of: typed.NodeSymbol | typed.ModuleSymbol) -> tuple[int | None, int]:
    """`wcet` and `jitter` in ns; None, 0 where they are not said or after a report."""
    jitter = _time(numbers, of.jitter, f"the jitter of `{of.name}`", least=0)
    return _time(numbers, of.wcet, f"the wcet of `{of.name}`", least=1), jitter or 0


def _time(numbers: Numbers, expr: typed.TypedExpr | None, what: str, *, least: int) -> int | None:
    """A time of at least `least` ns; C001, C002 otherwise."""
    value = None if expr is None else numbers.number(expr, what)
    if value is None or expr is None:
        return None
    assert isinstance(value, int)
    if value < least:
        needed = "cannot be negative" if least == 0 else "must be longer than zero"
        message = f"{what} {needed}"
        numbers.diagnostics.error("C001", message, expr.span, f"this is {show_ns(value)}")
        return None
    if value > MAX_PERIOD_NS:
        numbers.diagnostics.error(
            "C002",
            f"{what} cannot be {show_ns(value)}",
            expr.span,
            f"up to {show_ns(MAX_PERIOD_NS)} is possible",
        )
        return None
    return value


def inlined(
    parts: Iterable[SubSystem], components: Sequence[Component], diagnostics: Diagnostics
) -> None:
    """Marks what systems call `inline`; M013 where that is no node of theirs."""
    by_name = {c.name: c for c in components if c.node is not None}
    for part in parts:
        for path, span in part.system.inlines:
            component = by_name.get(part.prefix + path)
            if component is not None:
                component.inline = True
                continue
            near = [n.removeprefix(part.prefix) for n in by_name if n.startswith(part.prefix)]
            diagnostics.error(
                "M013",
                f"`{path}` is not a node of system `{part.system.name}`",
                span,
                notes=("`inline` names the nodes that run in the thread of the trusted part",),
                helps=diagnostics.did_you_mean(path, near, span),
            )
