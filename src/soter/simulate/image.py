"""The byte image of an interpreter's configuration.

Purpose: the same bytes as the generated program's state, so that both engines give one trace.
Non-goals: meaning; this only writes down what the interpreter holds.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from soter.lower.layout import encode_into
from soter.semantics.random_draws import mix

if TYPE_CHECKING:
    from soter.lower.layout import StateLayout
    from soter.program.system import System
    from soter.semantics.configuration import Configuration
    from soter.semantics.record import Record

MASK = 2**64 - 1


def image(
    system: System, layout: StateLayout, c: Configuration, record: Record, seed: int
) -> bytes:
    """The state struct of a configuration at the end of an instant."""
    out = bytearray(layout.size)
    key = mix((seed + 0x9E3779B97F4A7C15) & MASK)
    struct.pack_into("<qQQII", out, 0, c.ct, seed & MASK, key, record.violations, 0)
    at = layout.component_offset
    for x in system.components:
        if c.ct < x.phase_ns:
            following = x.phase_ns
        else:
            following = x.phase_ns + ((c.ct - x.phase_ns) // x.period_ns + 1) * x.period_ns
        r = record.components[x.index]
        struct.pack_into(
            "<qIBBBBB",
            out,
            at,
            following,
            r.faults,
            r.last_fault,
            c.OE[x.index],
            c.latched[x.index],
            c.had_control[x.index],
            0,
        )
        at += 24
    for m in system.modules:
        s = record.modules[m.index]
        struct.pack_into(
            "<qqIIIIBBBBBB",
            out,
            at,
            s.ac_ns,
            s.mode_since_ns,
            s.switches_to_sc,
            s.switches_to_ac,
            s.gate_faults,
            c.clean_needed[m.index],
            s.mode,
            c.gate_fault[m.index],
            s.ttf,
            s.safer,
            s.stale,
            s.gate_fault,
        )
        at += 40
    for p in record.properties:
        struct.pack_into("<qIB", out, at, p.first_ns, p.count, p.active)
        at += 16
    struct.pack_into(f"<{layout.topics}q", out, at, *c.stamps)
    for g in layout.groups:
        values = c.Topics if g.owner < 0 else c.L[g.owner]
        for member in g.struct.members:
            encode_into(out, g.offset + member.offset, member.type, values[member.index])
    return bytes(out)
