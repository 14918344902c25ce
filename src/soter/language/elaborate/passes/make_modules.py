"""Makes the modules of a flat system of their components.

Purpose: computes the numbers of a module, those of its `verify` block included, and reports outputs
without a value set (V003).
Non-goals: AC, SC and DM (`make_components.py`), whether a proof can go by the numbers (`verify/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fixes import append, exchange
from soter.language.elaborate.passes.make_components import failsafe_values, scope_at
from soter.language.elaborate.passes.step_times import check_double_response
from soter.language.elaborate.passes.topics import topic_index_at
from soter.language.elaborate.passes.value_sets import text_of_number_outside
from soter.language.model import typed
from soter.language.model.system import LEVELS_DEFAULT, LEVELS_LEAST, Module
from soter.language.model.types import FloatType, IntType, leaves, show_ns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Help
    from soter.language.elaborate.passes.flattening import Flattening, PlacedInstance
    from soter.language.model.system import Component, Topic

CLEAN_DEFAULT = 3
MAX_CLEAN = 1_000_000
MAX_CELLS = 1_000_000
MAX_LEVELS = 100


def make_modules(flat: Flattening) -> None:
    """Adds `modules` and `shields`; needs `components`, which have the numbers of modules."""
    placed_modules = [p for p in flat.placed if isinstance(p.symbol, typed.ModuleSymbol)]
    roles: list[dict[str, Component]] = [{} for _ in placed_modules]
    for c in flat.components:
        if c.module is not None:
            roles[c.module][c.role] = c
    for placed, by_role in zip(placed_modules, roles, strict=True):
        with flat.with_params(placed.params):
            flat.modules.append(_make_module(flat, placed, len(flat.modules), by_role))
    check_double_response(flat.modules, flat.components, flat.diagnostics)


def _make_module(
    flat: Flattening, placed: PlacedInstance, index: int, by_role: dict[str, Component]
) -> Module:
    module = placed.symbol
    assert isinstance(module, typed.ModuleSymbol)
    clean = flat.count(module.clean, "`clean`", 1, MAX_CLEAN)
    dm = by_role["dm"]
    outputs = tuple(topic_index_at(flat, placed, t) for t in module.sc.publishes)
    for output in outputs:
        _require_value_set(flat, flat.topics[output], module)
    late_ns, levels = _check_verify_block(flat, module)
    if module.rest is not None:
        flat.run_length_ns(module.rest.within, "the time of `rest`")
        for move in module.rest.moves:
            flat.bound(move.by, "how far something moves")
    shield = flat.count(module.shield, "`shield`", 1, typed.CELLS_MAX)
    if shield is not None:
        flat.shields[index] = shield
    return Module(
        index=index,
        name=placed.name,
        symbol=module,
        dm=dm.index,
        ac=by_role["ac"].index,
        sc=by_role["sc"].index,
        period_ns=dm.period_ns,
        scope=dm.scope,
        clean=CLEAN_DEFAULT if clean is None else clean,
        inputs=tuple(dm.scope.topics[t] for t in module.topics_read),
        outputs=outputs,
        forced=placed.forced,
        around=flat.params_at[placed.prefix],
        law=failsafe_values(flat, module, scope_at(flat, placed, list(module.failsafe))),
        late_ns=late_ns,
        levels=levels,
    )


def _require_value_set(flat: Flattening, topic: Topic, module: typed.ModuleSymbol) -> None:
    """Reports V003 for an output without a value set, which theorem 3.1 needs as a bound on AC."""
    if topic.set_declared or topic.symbol in flat.program.damaged:
        return
    bare = [
        ".".join(path)
        for (path, t), bound in zip(leaves(topic.type), topic.bounds, strict=True)
        if bound is None and isinstance(t, (FloatType, IntType))
    ]
    which = f"; `{bare[0]}` has none" if topic.symbol.values and bare[0] else ""
    flat.diagnostics.error(
        "V003",
        f"output topic `{topic.symbol.name}` of module `{module.name}` has no value set{which}",
        topic.symbol.span,
        "every value it may take must be known",
        also=((module.span, "gated by this module"),),
        notes=(
            "theorem 3.1 is about everything the advanced controller may do",
            "the gate refuses what lies outside the set",
        ),
        helps=(_help_to_add_set(topic, bare),),
    )


def _check_verify_block(flat: Flattening, module: typed.ModuleSymbol) -> tuple[int, int]:
    """Checks the numbers of `verify`; gives the DM's greatest lateness in ns, and the levels."""
    verify = module.verify
    flat.run_length_ns(verify.horizon, "`horizon`")
    flat.run_length_ns(verify.recover, "`recover within`")
    levels = flat.count(verify.levels, "the number of levels", LEVELS_LEAST, MAX_LEVELS)
    least_time = "the least time of `acts within`"
    delays = {
        "`late dm`": verify.late_dm,
        "`late sc`": verify.late_sc,
        "`response dm`": verify.response_dm,
        "`response sc`": verify.response_sc,
        least_time: verify.acts_least,
        "`acts within`": verify.acts,
        "`dropout`": verify.dropout,
        "`age`": verify.age,
        **{f"`late {n}`": e for n, e in verify.late_of.items()},
        **{f"`response {n}`": e for n, e in verify.response_of.items()},
    }
    value_by_delay = {name: flat.delay_ns(expr, name) for name, expr in delays.items()}
    least, most = (value_by_delay[w] for w in (least_time, "`acts within`"))
    _require_order_of_times(flat, verify, least, most)
    for block in (verify, *(v.block for v in verify.views)):
        for axis in (a for group in block.groups for a in group.axes):
            _check_axis(flat, axis)
    for commands in verify.commands:
        for value in commands.values:
            _check_command(flat, commands, value)
    return value_by_delay["`late dm`"] or 0, levels or LEVELS_DEFAULT


def _require_order_of_times(
    flat: Flattening, verify: typed.TypedVerifyBlock, least_ns: int | None, most_ns: int | None
) -> None:
    """Reports V001 if the least time of `acts within` is above the greatest one."""
    if least_ns is None or most_ns is None or least_ns <= most_ns:
        return
    assert verify.acts_least is not None
    assert verify.acts is not None
    least, most = verify.acts_least.span, verify.acts.span
    flat.diagnostics.error(
        "V001",
        f"no command acts {show_ns(least_ns)} to {show_ns(most_ns)} after it",
        least.to(most),
        "the least time is above the greatest one",
        helps=(exchange(least, most, "the other way round"),),
    )


def _check_axis(flat: Flattening, axis: typed.TypedGridAxis) -> None:
    flat.count(axis.cells, "the number of cells", 1, MAX_CELLS)
    span = axis.low.span.to(axis.high.span)
    interval = flat.interval(axis.low, axis.high, span, "a grid axis")
    if interval is not None and interval[0] == interval[1]:
        flat.diagnostics.error(
            "V001", f"[{interval[0]!r}, {interval[1]!r}] is a point", span, "an axis has some width"
        )
    if axis.open is None:
        return
    interval = flat.interval(axis.high, axis.open, axis.open.span, "what is open of a grid axis")
    if interval is not None and interval[0] == interval[1]:
        flat.diagnostics.error(
            "V001",
            f"`open to {interval[1]!r}` opens nothing",
            axis.open.span,
            "the axis ends there",
        )


def _check_command(
    flat: Flattening, commands: typed.TypedCommandSet, expr: typed.TypedExpr
) -> None:
    """Reports V005 for a command that lies outside its topic's set."""
    value = flat.value_of(expr, "a command")
    if value is None:
        return
    topics = [t for t in flat.topics if t.symbol is commands.topic]
    for topic in topics:
        for (path, _), bound in zip(leaves(topic.type), topic.bounds, strict=True):
            if path != commands.path or bound is None or bound.low <= value <= bound.high:
                continue
            flat.diagnostics.error(
                "V005",
                f"the command {value!r} is {text_of_number_outside(value, bound)}",
                expr.span,
                also=((topic.symbol.span, "the topic"),),
            )


def _help_to_add_set(topic: Topic, bare: Sequence[str]) -> Help:
    """Gives the help that adds value sets for `bare`, the leaves of the topic without a set."""
    if not topic.symbol.values or not all(bare):
        return "add a set: `in [-1.0, 1.0]` with your bounds"
    last = max((r.span for r in topic.symbol.values.values()), key=lambda s: s.end)
    more = ", ".join(f"{leaf} in [-1.0, 1.0]" for leaf in bare)
    return append(last, f", {more}", f"add to the braces: `{more}` with your bounds")
