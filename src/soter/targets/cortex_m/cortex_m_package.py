"""Target `cortex-m`: a package for a board, and its time-triggered loop as C.

Purpose: a folder of which `make` makes an image with arm-none-eabi-gcc, and `make run` runs it in
QEMU where that emulates the board: the run of `soter run`, whose `trace_sha256` it has to have.
Header and source of the loop's tables: the tick, extern nodes and their budgets, modules and
leases.
Non-goals: the loop (`runtime/cortex_m/soter_loop.c`), boards (`board.py`), making the image here
(`image.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gcd
from pathlib import PurePath
from typing import TYPE_CHECKING

from soter.codegen.c.names import field_name
from soter.codegen.externs import request_fields, symbol_of
from soter.core.layout import size_of
from soter.language.model.durations import show_ns
from soter.native.shared_library import RUNTIME
from soter.report.templates import filled
from soter.targets import c99
from soter.targets.cortex_m.board import SOFT, UNGUARDED
from soter.targets.leases_and_lateness import FILES as LEASES
from soter.targets.leases_and_lateness import (
    ages_of,
    lease_files,
    lease_names,
    lease_times,
    leased,
    on_the_way,
)
from soter.targets.package import Package, PackageFile, filled_file
from soter.targets.posix.posix_package import refuse_apart

if TYPE_CHECKING:
    from pathlib import Path

    from soter.codegen.unit import Unit
    from soter.core.core import CoreSystem
    from soter.language.model.system import Component, Module, System
    from soter.targets.cortex_m.board import Board


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


FOLDER = RUNTIME / "cortex_m"
OWN = (
    *("soter_board.h", "soter_cortex_m.h", "soter_cortex_m.c", "soter_replay.c"),
    *("soter_semihosting.h", "soter_semihosting.c"),
    *("soter_recording.h", "soter_recording.c"),
    *("soter_loop.h", "soter_loop.c", "soter_unprivileged.h", "soter_unprivileged.c"),
)
REPLAYED = ("soter_replay.c", "soter_recording.c")
LOOPED = ("soter_loop.c", "soter_unprivileged.c")
"""What is of one of the two images alone."""
SCRIPT = "soter_image.ld"
RECORDING = "recording.txt"
NOTHING_APART = 512
"""Bytes of the thread that waits, where nothing computes in it."""
INSTANTS = 1000
LIMIT_S = 300
"""How long QEMU may take."""
ICOUNT = 6
LOOP_ICOUNT = 4
"""In `make run` an instruction takes two to ICOUNT ns (`-icount shift=`): SysTick counts them.

In `make run-loop` two to LOOP_ICOUNT: hashing a trace takes its share of an instant."""


@dataclass(frozen=True)
class Replay:
    """A run of a system: until when (ns), its seed, and its `trace_sha256` on this machine."""

    until_ns: int
    seed: int
    sha256: str = ""
    recording: str = ""
    """Values of topics from outside, as text (`recording_text`); "" where there are none."""


def replayed_until(system: System) -> int:
    """The time of instant number INSTANTS, or the end of the system where that is earlier; ns."""
    calendars = [(x.phase_ns, x.period_ns) for x in system.components]
    calendars += [(0, i.every_ns) for i in system.inputs]
    horizon = min(p for _, p in calendars) * INSTANTS
    times = {t for phase, period in calendars for t in range(phase, horizon + 1, period)}
    last = sorted(times)[:INSTANTS][-1]
    return min(last, system.until_ns or last)


def cortex_m_package(
    system: System, core: CoreSystem, folder: Path, board: Board, replay: Replay
) -> Package:
    """The package for a board; externs without C are bound to `externs.c`."""
    refuse_apart(system)
    package = Package(folder)
    apart = apart_nodes(system)
    program = c99.ProgramInC(system, core, frozenset(x.index for x in apart))
    unit, name = program.unit, program.command
    tick = tick_of(system, board)
    trusted = [
        *program.files(c99.app_header(system, unit)),
        *(_own(RUNTIME / n) for n in dict.fromkeys((*c99.run_time(system), *LEASES))),
        *lease_files(system, unit.prefix),
        *loop_tables(system, unit, tick, replay.until_ns),
        *(_own(FOLDER / n) for n in OWN),
        PackageFile("board.c", board.text),
        PackageFile(SCRIPT, linker_script(board, board.ac_bytes if apart else NOTHING_APART)),
        *([PackageFile(RECORDING, replay.recording)] if replay.recording else ()),
        *c99.extern_files(program.linked),
    ]
    stubs = program.stub_files()
    extern = c99.extern_files([s for s in dict.fromkeys(map(_source, apart)) if s != c99.STUBS])
    package.files = [*trusted, *stubs, *extern]
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
    package.files += [filled_file(n, f"cortex_m/{n}", **context) for n in ("Makefile", "README.md")]
    package.notes = [*program.notes, *_notes(system, board, tick)]
    package.entries = "soter_instant"
    package.world = program.world
    package.image = f"{name}.elf"
    package.commands = [f"make -C {folder} {'run' if board.qemu else f'{name}_loop.elf'}"]
    return package


def _source(x: Component) -> str:
    """The C of an extern node."""
    assert x.binding is not None
    return x.binding.split(":")[1]


def _c_files(files: list[PackageFile]) -> list[str]:
    return [f.path for f in files if f.path.endswith(".c")]


def _notes(system: System, board: Board, tick: LoopTick) -> list[str]:
    """What the board does not do for this system."""
    lawless = [m.name for m in system.modules if not m.law] if system.externals else []
    notes = [
        f"{name} has no fail-safe law: nobody gives leases, and the board is told nothing of it"
        for name in lawless
    ]
    apart = apart_nodes(system)
    if apart and board.core in UNGUARDED:
        names = ", ".join(f"`{x.name}`" for x in apart)
        notes.append(
            f"{board.core} guards no memory: C of {names} may write anywhere, and is part of what "
            "is trusted"
        )
    return [*notes, *([f"no image for real time: {tick.why}"] if tick.why else ())]


def _own(path: Path) -> PackageFile:
    return PackageFile(path.name, path.read_text(encoding="utf-8"))


def linker_script(board: Board, ac_bytes: int) -> str:
    """Where everything lies; what does not fit is told by the linker, in bytes.

    `ac_bytes`: of the region of what is not trusted, a power of two.
    """
    return filled(f"targets/cortex_m/{SCRIPT}.j2", board=board, ac_bytes=ac_bytes)
