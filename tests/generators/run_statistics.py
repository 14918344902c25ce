"""What happens in the runs of random programs: shares that say whether they are interesting.

Purpose: count, over programs, switches, faults of each kind, stale reads and the rest.
Non-goals: judging; `test_engines_agree.py` prints the counts and holds the least shares.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.language.evaluate.arithmetic import FaultKind
from soter.language.model.tree_walk import chooses, plant_code

if TYPE_CHECKING:
    from collections import Counter

    from generators.engine_comparison import Bytes, Subject
    from soter.language.model.system import Component


def happened(s: Subject, trace: Bytes) -> set[str]:
    """Names of what happened at least once in a trace."""
    states: Any = trace.view(s.dtype).reshape(-1)
    last = states[-1]
    components, modules = states["components"], states["modules"]
    kinds = {int(k) for k in set(components["last_fault"].ravel())} - {0}
    events = {f"fault {FaultKind(k).name.lower()}" for k in kinds}
    roles = [x.role for x in s.system.components]
    latched = {role for role, x in zip(roles, last["components"], strict=True) if x["latched"]}
    events |= {f"latched {role}" for role in latched}
    queues = [t.index for t in s.system.topics if t.queue_of is not None]
    contracts = [p.index for p in s.system.properties if p.component is not None]
    facts = {
        "any fault": bool(kinds),
        "any latched": bool(latched),
        "module": len(s.system.modules) > 0,
        "two modules": len(s.system.modules) > 1,
        "switch to AC": bool((last["modules"]["to_ac"] > 0).any()),
        "switch to SC": bool((last["modules"]["to_sc"] > 0).any()),
        "ten switches": bool((last["modules"]["to_ac"] > 4).any()),
        "gate fault": bool((last["modules"]["gate_faults"] > 0).any()),
        "gate fault in control": bool((modules["saw_gate_fault"] > 0).any()),
        "NaN compared": bool((modules["nan_looks"] > 0).any()),
        "NaN compared at times": any(
            0 < x["nan_looks"] < last["header"]["ct"] // m.period_ns
            for m, x in zip(s.system.modules, last["modules"], strict=True)
        ),
        "clean steps owed": bool((modules["clean_needed"] > 0).any()),
        "stale": bool((modules["stale"] > 0).any()),
        "sometimes stale": bool((modules["stale"] > 0).any() and (modules["stale"] == 0).any()),
        **_latched(s, states),
        "property violated": bool((last["properties"]["count"] > 0).any()),
        "plant": "plant" in roles,
        "queue": bool(queues),
        "queue overflow": bool((states["stamps"][:, queues] == 0).any()) if queues else False,
        "choice of a plant": any(
            n.plant is not None and chooses(*plant_code(n.plant)) for n in s.system.components
        ),
        "contract": bool(contracts),
        "contract violated": bool((last["properties"]["count"][contracts] > 0).any()),
        "burst": any(n.node is not None and n.node.bursts for n in s.system.components),
        "burst into a queue": any(_is_queued_burst(s, n) for n in s.system.components),
        **_lasting(s, states),
        "choice": "choose " in s.text,
        "fair choice": "fair choose " in s.text,
        "input driven": bool(s.system.inputs),
        "sub-systems": any("." in m.name for m in s.system.modules)
        or any("." in x.name for x in s.system.components if x.module is None),
        "still moving": bool((trace[-1, :] != trace[-100, :]).sum() > 40),
    }
    return events | {name for name, holds in facts.items() if holds}


def _latched(s: Subject, states: Any) -> dict[str, bool]:
    """Of modules with a latch: whether one was released, and whether one was released twice."""
    by_press = [m for m in s.system.modules if m.acknowledgement is not None]
    back = [int(states["modules"]["to_ac"][-1, m.index]) for m in by_press]
    return {
        "latch": any(m.latch is not None for m in s.system.modules),
        "latch released": any(n > 0 for n in back),
        "latch released twice": any(n > 1 for n in back),
        "returns never": any(
            m.latch is not None and m.acknowledgement is None for m in s.system.modules
        ),
    }


def _lasting(s: Subject, states: Any) -> dict[str, bool]:
    """Of steps that take time: whether there are some, and what came in between."""
    times, components = (
        states["header"]["ct"],
        [x for x in s.system.components if x.held is not None],
    )
    busy = {x.index: states["stamps"][:, x.held] > times for x in components}
    enabled = {x.index: states["components"]["oe"][:, x.index] for x in components}
    released = {x.index: (times - x.phase_ns) % x.period_ns == 0 for x in components}
    started = {i: (busy[i][1:] & ~busy[i][:-1]) for i in busy}
    return {
        "takes": bool(components),
        "takes in AC": any(x.role == "ac" for x in components),
        "release lost": any((b[1:] & b[:-1] & released[i][1:]).any() for i, b in busy.items()),
        "off in between": any(
            (b[1:] & b[:-1] & (enabled[i][1:] != enabled[i][:-1])).any() for i, b in busy.items()
        ),
        "starts anew": any(s.sum() > 1 for s in started.values()),
    }


def _is_queued_burst(s: Subject, n: Component) -> bool:
    """Whether somebody has a queue of what a node publishes several messages a step of."""
    bursts = () if n.node is None else n.node.bursts
    return any(s.system.topics[n.scope.topics[t]].queues for t in bursts)


def table(counts: Counter[str], programs: int) -> str:
    """The shares, one line each."""
    lines = [f"{programs} programs"]
    lines += [f"  {n / programs:6.1%}  {name}" for name, n in sorted(counts.items())]
    return "\n".join(lines)
