"""Writes the tables, as C, by which the time-triggered loop of a board runs a program.

Purpose: `loop_tables` writes the tick, extern nodes, modules and their leases for
`runtime/cortex_m/soter_loop.c`; `longest_tick` chooses the tick, or says why there can be no loop.
Non-goals: the loop; the package that the tables lie in (`cortex_m_package.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd
from typing import TYPE_CHECKING

from soter.codegen.c_names import field_name
from soter.codegen.externs import linked_symbol
from soter.core.layout import size_of
from soter.language.model.types import show_ns
from soter.targets.late_limits import age_limits
from soter.targets.leases import lease_names, lease_times, modules_with_law, upstream_nodes
from soter.targets.package import PackageFile, filled_file
from soter.targets.posix_package import extern_nodes, fields_read
from soter.targets.world_interface import word_count

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.language.model.system import Component, Module, System
    from soter.targets.cortex_m_board import Board

APP = "soter_loop_app"
SECOND = 10**9
TICK_MOST, TICK_LEAST = 10**6, 10**4
"""The longest and the shortest tick, in ns; each tick interrupts the processor."""
SYSTICK_MOST = 2**24
"""SysTick counts in 24 bits."""
PATIENCE_NS = 10**8
"""The longest time, in ns, that an instant may take; after that the watchdog is not fed."""


@dataclass(frozen=True)
class LoopTick:
    """The time between two timer interrupts in ns; `why` says why a loop is impossible, else ""."""

    ns: int
    why: str = ""


def longest_tick(system: System, board: Board) -> LoopTick:
    """The longest tick that divides all release times; its `why` says if no tick is usable."""
    times = [n for x in system.components for n in (x.period_ns, x.phase_ns)]
    times += [i.every_ns for i in system.inputs]
    common = gcd(*times)
    divisors = [n for n in range(1, common // TICK_LEAST + 1) if common % n == 0]
    for n in divisors:
        tick = common // n
        counts, rest = divmod(board.clock_hz * tick, SECOND)
        if tick <= TICK_MOST and rest == 0 and 1 < counts < SYSTICK_MOST:
            return LoopTick(tick, _why_no_loop(system))
    why = f"no tick of whole counts of {board.clock_hz:,} Hz divides {show_ns(common)}"
    return LoopTick(min(common, TICK_MOST), why)


def _why_no_loop(system: System) -> str:
    nodes = extern_nodes(system)
    if len(nodes) > 1:
        names = ", ".join(f"`{x.name}`" for x in nodes)
        return f"{names} are extern nodes, and there is one thread for one of them"
    held = [x.name for x in system.components if x.held is not None]
    return f"`{held[0]}` has steps that take time" if held else ""


def loop_tables(system: System, unit: Unit, tick: LoopTick, until_ns: int) -> list[PackageFile]:
    """The C header and source of the tables that the loop needs to run a program."""
    nodes, modules = extern_nodes(system), modules_with_law(system)
    names = lease_names(system, unit.prefix)
    context = {
        "prefix": unit.prefix,
        "system": system,
        "tick": tick,
        "until_ns": until_ns,
        "budgets": max([1, *(len(lease_times(system, m).budgets) for m in modules)]),
        "topic_words": word_count(max((size_of(t.type) for t in system.topics), default=8)),
        "patience": max(2, PATIENCE_NS // tick.ns),
        "nodes": [_node_values(system, unit, x) for x in nodes],
        "modules": [_module_values(system, unit, m, names[m.index]) for m in modules],
    }
    return [filled_file(n, f"cortex_m/{n}", **context) for n in (f"{APP}.h", f"{APP}.c")]


def _node_values(system: System, unit: Unit, x: Component) -> dict[str, object]:
    """The template's values for an extern node: the topics that it reads, and its function."""
    assert x.binding is not None
    return {
        "of": x,
        "c_name": unit.names[x.index],
        "symbol": linked_symbol(x.binding),
        "reads": fields_read(system, unit, x),
    }


def _module_values(system: System, unit: Unit, module: Module, c_name: str) -> dict[str, object]:
    """The template's values for a module with a law: its command, and the parts to watch."""
    outputs = [(system.topics[i].symbol.name.rpartition(".")[2], i) for i in module.outputs]
    return {
        "of": module,
        "c_name": c_name,
        "nodes": [module.dm, module.sc, *(x.index for x in upstream_nodes(system, module))],
        "outputs": [(field_name(name), unit.topics[i][1]) for name, i in outputs],
        "ages": age_limits(system, module),
    }
