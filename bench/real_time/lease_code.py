"""The C of leases, compiled and called: `soter_lease.c` (actuators), `soter_grant.c` (trusted).

Purpose: `Engine`: both files as they ship, through cffi, for benchmarks and tests; `Grant` and
`Lease` hold one state each. All times are integer ns, or any other unit.
Non-goals: schedules (`delays.py`).
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Any

from cffi import FFI

from soter.native.cache import cached_folder, digest
from soter.native.compiler import STRICT, WARNINGS, compile_with, find_compiler
from soter.native.shared_library import CHECK_FAILED, RUNTIME

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

SOURCES = ("soter_lease.c", "soter_grant.c")
HEADERS = ("soter_lease.h", "soter_grant.h", "soter_check.h")
LIBRARY = "leases.so"


@lru_cache(maxsize=1)
def engine() -> tuple[Any, Any]:
    """(ffi, library) of both files."""
    compiler = find_compiler()
    flags = (*STRICT, *WARNINGS, "-O2", "-fPIC", "-shared", f"-I{RUNTIME}")
    sources = [*(RUNTIME / n for n in SOURCES), CHECK_FAILED]
    names = [*sources, *(RUNTIME / n for n in HEADERS)]
    parts = [compiler.identity, *flags, *(n.read_text(encoding="utf-8") for n in names)]

    def make(work: Path) -> None:
        command = [*compiler.command, *flags, *map(str, sources), "-o", LIBRARY]
        compile_with(command, work, "the lease does not compile", ())

    folder = cached_folder("leases", digest(parts), (LIBRARY,), make)
    ffi = FFI()
    ffi.cdef(
        """
        typedef struct { const void *law; uint32_t size; int64_t longest; } soter_lease_info;
        typedef struct { const soter_lease_info *info; void *command; int64_t until; int64_t stamp;
                         int64_t seen; uint8_t state; } soter_lease;
        void soter_lease_init(soter_lease *, const soter_lease_info *, void *);
        void soter_lease_arm(soter_lease *);
        bool soter_lease_take(soter_lease *, int64_t, const void *, int64_t, int64_t);
        bool soter_lease_read(soter_lease *, int64_t, void *);
        int soter_lease_may_arm(const soter_lease *, int64_t, int64_t, int64_t, int64_t);
        typedef struct { int64_t period, phase, late, response; } soter_budget;
        typedef struct { const soter_budget *node; uint32_t nodes; } soter_grant_info;
        typedef struct { const soter_grant_info *info; int64_t origin; int64_t *done;
                         int64_t spoken[2]; bool broken; } soter_grant;
        void soter_grant_begin(soter_grant *, const soter_grant_info *, int64_t *, int64_t);
        int64_t soter_grant_due(const soter_grant *, uint32_t);
        bool soter_grant_done(soter_grant *, uint32_t, int64_t, int64_t);
        bool soter_grant_lease(soter_grant *, int64_t, int64_t *, int64_t *);
        """
    )
    return ffi, ffi.dlopen(str(folder / LIBRARY))


class Lease:
    """The actuator side of one float: `law` is what it holds without a lease."""

    def __init__(self, law: float, longest: int) -> None:
        self.ffi, self.lib = engine()
        self.law = self.ffi.new("double *", law)
        self.info = self.ffi.new("soter_lease_info *", {"law": self.law, "size": 8})
        self.info.longest = longest
        self.room, self.out = self.ffi.new("double *"), self.ffi.new("double *")
        self.c = self.ffi.new("soter_lease *")
        self.lib.soter_lease_init(self.c, self.info, self.room)

    def take(self, now: int, command: float, stamp: int, expiry: int) -> bool:
        """Whether a command was taken."""
        given = self.ffi.new("double *", command)
        return bool(self.lib.soter_lease_take(self.c, now, given, stamp, expiry))

    def read(self, now: int) -> tuple[bool, float]:
        """Whether a command is in force, and what to do."""
        held = bool(self.lib.soter_lease_read(self.c, now, self.out))
        return held, float(self.out[0])

    def arm(self) -> None:
        """After a restart."""
        self.lib.soter_lease_arm(self.c)

    def may_arm(self, now: int, stamp: int, expiry: int, begin: int) -> int:
        """0, or why the command that was heard last may not be begun with: `soter_arm`."""
        return int(self.lib.soter_lease_may_arm(self.c, now, stamp, expiry, begin))

    @property
    def until(self) -> int:
        """The last instant of the lease in force."""
        return int(self.c.until)


class Grant:
    """The trusted side; `budgets`: (period, phase, late, response) of DM, SC and others.

    `origin`: when the trusted part began, ns.
    """

    def __init__(self, budgets: Sequence[tuple[int, int, int, int]], origin: int = 0) -> None:
        self.ffi, self.lib = engine()
        self.node = self.ffi.new("soter_budget[]", [tuple(b) for b in budgets])
        self.info = self.ffi.new("soter_grant_info *", {"node": self.node, "nodes": len(budgets)})
        self.count = self.ffi.new("int64_t[]", len(budgets))
        self.c = self.ffi.new("soter_grant *")
        self.stamp, self.expiry = self.ffi.new("int64_t *"), self.ffi.new("int64_t *")
        self.lib.soter_grant_begin(self.c, self.info, self.count, origin)

    def done(self, node: int, start: int, out: int) -> bool:
        """The next release of a node is done; whether all were in time."""
        return bool(self.lib.soter_grant_done(self.c, node, start, out))

    def due(self, node: int) -> int:
        """Until when the next release of a node has to be done."""
        return int(self.lib.soter_grant_due(self.c, node))

    def lease(self, now: int) -> tuple[int, int] | None:
        """(stamp, expiry) of what may be passed on now; None: nothing may."""
        given = self.lib.soter_grant_lease(self.c, now, self.stamp, self.expiry)
        return (int(self.stamp[0]), int(self.expiry[0])) if given else None
