"""The byte image of an interpreter's configuration.

Purpose: the same bytes as the generated program's state, so that both engines give one trace.
Non-goals: meaning; this only writes down what the interpreter holds.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from soter.core.layout import COMPONENT, HEADER, MODULE, PROPERTY, encode_into
from soter.semantics.random.faults import by_component, next_release
from soter.semantics.random.random_draws import mix

if TYPE_CHECKING:
    from soter.core.layout import StateLayout
    from soter.language.model.system import Component, System
    from soter.semantics.configuration import Configuration
    from soter.semantics.observer_records import Record

MASK = 2**64 - 1


def state_bytes(
    system: System, layout: StateLayout, c: Configuration, record: Record, seed: int
) -> bytes:
    """The state struct of a configuration at the end of an instant."""
    out = bytearray(layout.size)
    HEADER.pack_into(
        out,
        0,
        ct=c.ct,
        seed=seed & MASK,
        seed_key=mix((seed + 0x9E3779B97F4A7C15) & MASK),
        violations=record.violations,
    )
    at = layout.component_offset
    late = by_component(system, of_time=True)
    for x in system.components:
        r = record.components[x.index]
        COMPONENT.pack_into(
            out,
            at,
            next=_following(x, c.ct)
            if x.index not in late
            else next_release(system, late[x.index], x, seed, c.ct),
            faults=r.faults,
            last_fault=r.last_fault,
            oe=c.OE[x.index],
            latched=c.latched[x.index],
            had_control=c.had_control[x.index],
            pending=False,
        )
        at += COMPONENT.size
    for m in system.modules:
        s = record.modules[m.index]
        MODULE.pack_into(
            out,
            at,
            ac_ns=s.ac_ns,
            mode_since=s.mode_since_ns,
            to_sc=s.switches_to_sc,
            to_ac=s.switches_to_ac,
            gate_faults=s.gate_faults,
            clean_needed=c.clean_needed[m.index],
            mode=s.mode,
            gate_fault=c.gate_fault[m.index],
            ttf=s.ttf,
            safer=s.safer,
            stale=s.stale,
            saw_gate_fault=s.gate_fault,
            nan_looks=s.nan_looks,
        )
        at += MODULE.size
    for p in record.properties:
        PROPERTY.pack_into(out, at, first_ns=p.first_ns, count=p.count, active=p.active)
        at += PROPERTY.size
    struct.pack_into(f"<{layout.topics}q", out, layout.stamp_offset, *c.stamps)
    for g in layout.groups:
        values = c.Topics if g.owner < 0 else c.L[g.owner]
        for member in g.struct.members:
            encode_into(out, g.offset + member.offset, member.type, values[member.index])
    return bytes(out)


def _following(x: Component, ct: int) -> int:
    """The release of a component after `ct`, ns."""
    if ct < x.phase_ns:
        return x.phase_ns
    return x.phase_ns + ((ct - x.phase_ns) // x.period_ns + 1) * x.period_ns
