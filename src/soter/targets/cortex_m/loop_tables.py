"""What the time-triggered loop of a Cortex-M has to know of a program, as C.

Purpose: header and source: the tick, extern nodes and their budgets, modules and leases.
Non-goals: the loop (`runtime/cortex_m/soter_loop.c`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd
from typing import TYPE_CHECKING

from soter.codegen.c.names import field_name
from soter.codegen.externs import request_fields, symbol_of
from soter.core.layout import size_of
from soter.language.model.durations import show_ns
from soter.targets.leases_and_lateness import ages_of, lease_names, lease_times, leased, on_the_way
from soter.targets.package import filled_file

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.language.model.system import Component, Module, System
    from soter.targets.cortex_m.board import Board
    from soter.targets.package import PackageFile

APP = "soter_loop_app"
SECOND = 10**9
TICK_MOST, TICK_LEAST = 10**6, 10**4
"""ns: actuators look as often as that, and no processor is interrupted more often."""
SYSTICK_MOST = 2**24
PATIENCE_NS = 10**8
"""How long an instant may take before nobody feeds the watchdog any more."""


@dataclass(frozen=True)
class LoopTick:
    """ns between interrupts; `why`: in words why there is no loop, else ""."""

    ns: int
    why: str = ""


def apart_nodes(system: System) -> list[Component]:
    """The extern nodes: each is C of somebody else."""
    return [x for x in system.components if x.extern and x.node is not None]


def tick_of(system: System, board: Board) -> LoopTick:
    """The longest tick of which every release is a multiple, or why there is none."""
    times = [n for x in system.components for n in (x.period_ns, x.phase_ns)]
    times += [i.every_ns for i in system.inputs]
    common = gcd(*times)
    parts = [n for n in range(1, common // TICK_LEAST + 1) if common % n == 0]
    for n in parts:
        tick = common // n
        counts, rest = divmod(board.clock_hz * tick, SECOND)
        if tick <= TICK_MOST and rest == 0 and 1 < counts < SYSTICK_MOST:
            return LoopTick(tick, _not_looped(system))
    what = f"no tick of whole counts of {board.clock_hz:,} Hz divides {show_ns(common)}"
    return LoopTick(min(common, TICK_MOST), what)


def _not_looped(system: System) -> str:
    nodes = apart_nodes(system)
    if len(nodes) > 1:
        names = ", ".join(f"`{x.name}`" for x in nodes)
        return f"{names} are extern nodes, and there is one thread for one of them"
    held = [x.name for x in system.components if x.held is not None]
    return f"`{held[0]}` has steps that take time" if held else ""


def loop_tables(system: System, unit: Unit, tick: LoopTick, until_ns: int) -> list[PackageFile]:
    """Header and source."""
    nodes, modules = apart_nodes(system), leased(system)
    names = lease_names(system, unit.prefix)
    topic = max((size_of(t.type) for t in system.topics), default=8)
    budgets = [len(lease_times(system, m).budgets) for m in modules]
    context = {
        "prefix": unit.prefix,
        "system": system,
        "tick": tick,
        "until_ns": until_ns,
        "budgets": max([1, *budgets]),
        "topic_words": (topic + 7) // 8,
        "patience": max(2, PATIENCE_NS // tick.ns),
        "nodes": [_node(system, unit, x) for x in nodes],
        "modules": [_module(system, unit, m, names[m.index]) for m in modules],
    }
    return [filled_file(n, f"cortex_m/{n}", **context) for n in (f"{APP}.h", f"{APP}.c")]


def _node(system: System, unit: Unit, x: Component) -> dict[str, object]:
    """An extern node: what it reads, and its function."""
    assert x.node is not None
    assert x.binding is not None
    fields = [field_name(name) for name, _ in request_fields(system, x)]
    members = [unit.topics[x.scope.topics[s.topic]][1] for s in x.node.subscribes]
    reads = [*zip(fields, members, strict=True)]
    symbol = symbol_of(x.binding)
    return {"of": x, "c_name": unit.names[x.index], "symbol": symbol, "reads": reads}


def _module(system: System, unit: Unit, module: Module, c_name: str) -> dict[str, object]:
    """A module with a law: what of it a command holds, and whose times its grant watches."""
    outputs = [(system.topics[i].symbol.name.rpartition(".")[2], i) for i in module.outputs]
    return {
        "of": module,
        "c_name": c_name,
        "nodes": [module.dm, module.sc, *(x.index for x in on_the_way(system, module))],
        "outputs": [(field_name(name), unit.topics[i][1]) for name, i in outputs],
        "ages": ages_of(system, module),
    }
