"""Which vector instructions this machine has, as flags of a C compiler.

Purpose: `vector_flags` and `FAST`, for C that never leaves this machine (campaigns,
environments, sets on grids).
Non-goals: fused multiplication and addition, which rounds once where programs mean twice
(`compiler.MEANING`); what is shipped, which is built for the machine that it flies on.
"""

from __future__ import annotations

import platform
from functools import cache
from pathlib import Path

CPU = Path("/proc/cpuinfo")
VECTORS = (("-mavx512f", "-mavx512dq"), ("-mavx2",))
"""Flags of vectors of eight doubles, and of four."""
FAST = ("-fno-trapping-math",)
"""Nobody looks at the processor's floating-point flags: clang may take both ways of a choice."""


def of_processor(said: str) -> tuple[str, ...]:
    """The flags for a processor of which Linux says this: it has what all of its cores have."""
    cores = [line.split() for line in said.splitlines() if line.startswith("flags")]
    for flags in VECTORS:
        if cores and all(flag.removeprefix("-m") in core for flag in flags for core in cores):
            return flags
    return ()


@cache
def vector_flags() -> tuple[str, ...]:
    """Flags for the vectors of this machine; none where it does not tell, or has none."""
    if platform.machine() not in {"x86_64", "AMD64"} or not CPU.exists():
        return ()
    return of_processor(CPU.read_text(encoding="utf-8", errors="replace"))
