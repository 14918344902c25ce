"""Target `cortex-m`: a package for a board.

Purpose: `cortex_m_package` makes a folder of which `make` makes an image with arm-none-eabi-gcc,
without an operating system, and `make run` runs it in QEMU where that emulates the board: the run
of `soter run`, whose `trace_sha256` it has to have.
Non-goals: the image itself (`cortex_m_image.py`); the loop (`cortex_m_loop.py`,
`runtime/cortex_m/soter_loop.c`); boards (`cortex_m_board.py`).
"""

from __future__ import annotations

from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from soter.native.shared_library import RUNTIME
from soter.report.templates import filled
from soter.targets import c99
from soter.targets.cortex_m_board import SOFT, UNGUARDED, Board, Replay
from soter.targets.cortex_m_loop import LoopTick, longest_tick, loop_tables
from soter.targets.leases import FILES as LEASES
from soter.targets.leases import lease_files
from soter.targets.package import Package, PackageFile, filled_file, shipped_file
from soter.targets.posix_package import extern_nodes, require_separable

if TYPE_CHECKING:
    from soter.core.core import CoreSystem
    from soter.language.model.system import Component, System

FOLDER = RUNTIME / "cortex_m"
OWN = (
    *("soter_board.h", "soter_cortex_m.h", "soter_cortex_m.c", "soter_replay.c"),
    *("soter_semihosting.h", "soter_semihosting.c"),
    *("soter_recording.h", "soter_recording.c"),
    *("soter_loop.h", "soter_loop.c", "soter_unprivileged.h", "soter_unprivileged.c"),
)
REPLAYED = ("soter_replay.c", "soter_recording.c")
LOOPED = ("soter_loop.c", "soter_unprivileged.c")
"""Files that only the replay image, or only the loop image, is linked from."""
SCRIPT = "soter_image.ld"
RECORDING = "recording.txt"
NOTHING_APART = 512
"""Bytes of the extern nodes' thread in a system without extern nodes, where it only waits."""
INSTANTS = 1000
LIMIT_S = 300
"""The longest time that QEMU may take, in s."""
ICOUNT = 6
LOOP_ICOUNT = 4
"""In `make run` an instruction takes two to ICOUNT ns (`-icount shift=`): SysTick counts them.

In `make run-loop` two to LOOP_ICOUNT: hashing a trace takes its share of an instant."""


def replay_end_ns(system: System) -> int:
    """The time in ns of the instant number INSTANTS, or the system's end if that is earlier."""
    calendars = [(x.phase_ns, x.period_ns) for x in system.components]
    calendars += [(0, i.every_ns) for i in system.inputs]
    horizon = min(p for _, p in calendars) * INSTANTS
    times = {t for phase, period in calendars for t in range(phase, horizon + 1, period)}
    last = sorted(times)[:INSTANTS][-1]
    return min(last, system.until_ns or last)


def cortex_m_package(
    system: System, core: CoreSystem, folder: Path, board: Board, replay: Replay
) -> Package:
    """Makes the package for a board; externs without C are bound to `externs.c`."""
    require_separable(system)
    apart = extern_nodes(system)
    program = c99.ProgramInC(system, core, frozenset(x.index for x in apart))
    unit, name = program.unit, program.command
    tick = longest_tick(system, board)
    trusted = [
        *program.program_files(c99.app_header(system, unit)),
        *(shipped_file(RUNTIME / n) for n in dict.fromkeys((*c99.run_time_files(system), *LEASES))),
        *lease_files(system, unit.prefix),
        *loop_tables(system, unit, tick, replay.until_ns),
        *(shipped_file(FOLDER / n) for n in OWN),
        PackageFile("board.c", board.text),
        PackageFile(SCRIPT, linker_script(board, board.ac_bytes if apart else NOTHING_APART)),
        *([PackageFile(RECORDING, replay.recording)] if replay.recording else ()),
        *c99.extern_files(program.linked),
    ]
    stubs = program.stub_files()
    extern = c99.extern_files([s for s in dict.fromkeys(map(_c_path, apart)) if s != c99.STUBS])
    sources = _c_files([*trusted, *stubs])
    untrusted = [path for path in _c_files(extern) if path not in sources]
    untrusted += [c99.STUBS] if program.stubs else []
    context = {
        "name": name,
        "system": system,
        "file": PurePath(system.program.path).name,
        "board": board,
        "soft": SOFT.get(board.core),
        "replay": replay,
        "no_loop": tick.why,
        "trusted": sorted(s for s in sources if s not in {*untrusted, *REPLAYED, *LOOPED}),
        "untrusted": untrusted,
        "replayed": REPLAYED,
        "looped": LOOPED,
        "limit_s": LIMIT_S,
        "icount": ICOUNT,
        "loop_icount": LOOP_ICOUNT,
    }
    made = (filled_file(n, f"cortex_m/{n}", **context) for n in ("Makefile", "README.md"))
    return Package(
        folder,
        [*trusted, *stubs, *extern, *made],
        notes=[*program.notes, *_limit_notes(system, board, tick)],
        commands=[f"make -C {folder} {'run' if board.qemu else f'{name}_loop.elf'}"],
        entries="soter_instant",
        image=f"{name}.elf",
        world=program.world,
    )


def _c_path(x: Component) -> str:
    assert x.binding is not None
    return x.binding.split(":")[1]


def _c_files(files: list[PackageFile]) -> list[str]:
    return [f.path for f in files if f.path.endswith(".c")]


def _limit_notes(system: System, board: Board, tick: LoopTick) -> list[str]:
    """Sentences for people on what this board does not do for this system."""
    lawless = [m.name for m in system.modules if not m.law] if system.externals else []
    notes = [
        f"{name} has no fail-safe law: nobody gives leases, and the board is told nothing of it"
        for name in lawless
    ]
    apart = extern_nodes(system)
    if apart and board.core in UNGUARDED:
        names = ", ".join(f"`{x.name}`" for x in apart)
        notes.append(
            f"{board.core} guards no memory: C of {names} may write anywhere, and is part of what "
            "is trusted"
        )
    return [*notes, *([f"no image for real time: {tick.why}"] if tick.why else ())]


def linker_script(board: Board, ac_bytes: int) -> str:
    """The linker script of a board; `ac_bytes` (a power of two) is the memory of untrusted code."""
    return filled(f"targets/cortex_m/{SCRIPT}.j2", board=board, ac_bytes=ac_bytes)
