"""Target `cortex-m`: a package for a board, its time-triggered loop as C, and the image.

Purpose: `cortex_m_package` makes a folder of which `make` makes an image with arm-none-eabi-gcc,
without an operating system, and `make run` runs it in QEMU where that emulates the board: the run
of `soter run`, whose `trace_sha256` it has to have. `loop_tables` writes the loop's tables: the
tick, extern nodes and their budgets, modules and leases. `build_image` makes, runs and measures the
image (flash, RAM, stack, instructions), or says why there is none.
Non-goals: the loop (`runtime/cortex_m/soter_loop.c`), boards (`cortex_m_board.py`); execution
times, which counts of instructions are not.
"""

from __future__ import annotations

import re
import shlex
import shutil
from dataclasses import dataclass
from importlib.util import find_spec
from math import gcd
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from soter.codegen.c_names import field_name
from soter.codegen.externs import linked_symbol
from soter.core.layout import size_of
from soter.diagnostics.diagnostic import SoterError, mistake
from soter.language.model.types import show_ns
from soter.native.compiler import Compiler, CompilerOutput, python_module, run_compiler
from soter.native.shared_library import RUNTIME
from soter.report.templates import filled
from soter.report.wording import visible
from soter.targets import c99
from soter.targets.cortex_m_board import SOFT, UNGUARDED, Board, Replay
from soter.targets.leases_and_lateness import FILES as LEASES
from soter.targets.leases_and_lateness import (
    age_limits,
    lease_files,
    lease_names,
    lease_times,
    modules_with_law,
    nodes_on_the_way,
)
from soter.targets.package import Package, PackageFile, filled_file, shipped_file
from soter.targets.posix_package import extern_nodes, fields_read, require_separable
from soter.version import pip_install

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.core.core import CoreSystem
    from soter.language.model.system import Component, Module, System
    from soter.native.stack_bound import StackBound


APP = "soter_loop_app"
SECOND = 10**9
TICK_MOST, TICK_LEAST = 10**6, 10**4
"""The longest and shortest tick in ns: each one interrupts the processor, and actuators look."""
SYSTICK_MOST = 2**24
PATIENCE_NS = 10**8
"""The longest time in ns that an instant may take before the watchdog is fed no more."""


@dataclass(frozen=True)
class LoopTick:
    """The time between two interrupts in ns; `why`: why there can be no loop, else ""."""

    ns: int
    why: str = ""


def longest_tick(system: System, board: Board) -> LoopTick:
    """The longest tick of which every release is a multiple, or why there can be none."""
    times = [n for x in system.components for n in (x.period_ns, x.phase_ns)]
    times += [i.every_ns for i in system.inputs]
    common = gcd(*times)
    parts = [n for n in range(1, common // TICK_LEAST + 1) if common % n == 0]
    for n in parts:
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
    """Writes header and source of the tables by which the loop runs a program."""
    nodes, modules = extern_nodes(system), modules_with_law(system)
    names = lease_names(system, unit.prefix)
    context = {
        "prefix": unit.prefix,
        "system": system,
        "tick": tick,
        "until_ns": until_ns,
        "budgets": max([1, *(len(lease_times(system, m).budgets) for m in modules)]),
        "topic_words": (max((size_of(t.type) for t in system.topics), default=8) + 7) // 8,
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
    """The template's values for a module with a law: its command, and what its grant watches."""
    outputs = [(system.topics[i].symbol.name.rpartition(".")[2], i) for i in module.outputs]
    return {
        "of": module,
        "c_name": c_name,
        "nodes": [module.dm, module.sc, *(x.index for x in nodes_on_the_way(system, module))],
        "outputs": [(field_name(name), unit.topics[i][1]) for name, i in outputs],
        "ages": age_limits(system, module),
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
"""Files that only the replay image, or only the loop image, is linked from."""
SCRIPT = "soter_image.ld"
RECORDING = "recording.txt"
NOTHING_APART = 512
"""Bytes of the thread for extern nodes in a system without any, where it only waits."""
INSTANTS = 1000
LIMIT_S = 300
"""The longest time that QEMU may take, in s."""
ICOUNT = 6
LOOP_ICOUNT = 4
"""In `make run` an instruction takes two to ICOUNT ns (`-icount shift=`): SysTick counts them.

In `make run-loop` two to LOOP_ICOUNT: hashing a trace takes its share of an instant."""


def replay_end_ns(system: System) -> int:
    """The time in ns of instant number INSTANTS, or the end of the system if that is earlier."""
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
    """The path of the C file of an extern node."""
    assert x.binding is not None
    return x.binding.split(":")[1]


def _c_files(files: list[PackageFile]) -> list[str]:
    return [f.path for f in files if f.path.endswith(".c")]


def _limit_notes(system: System, board: Board, tick: LoopTick) -> list[str]:
    """Says what this board does not do for this system, a sentence each."""
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
    """The linker script of a board, with `ac_bytes` (a power of two) for what is not trusted."""
    return filled(f"targets/cortex_m/{SCRIPT}.j2", board=board, ac_bytes=ac_bytes)


CC = "arm-none-eabi-gcc"
QEMU = "qemu-system-arm"
OLDEST = 10
"""The first version of gcc whose `-fcallgraph-info` and linker are those of the Makefile."""
TIMEOUT_S = 300
RUN_S = LIMIT_S + 20
LARGEST = 5
OVERFLOW = re.compile(r"region `(FLASH|RAM)' overflowed by (\d+) bytes")
SYMBOL = re.compile(r"^\S+ (\d+) (\w) (\S+)$", re.MULTILINE)
COUNTS = re.compile(
    r"^instructions of (?:an instant|a step of (\S+)) (\d+) at most, (\d+) on average, "
    r"(\d+) times$",
    re.MULTILINE,
)
SELF_TEST = re.compile(r"^instructions of the self-test (\d+)$", re.MULTILINE)
SAID = re.compile(r"error|undefined|BOARD_AC_BYTES|multiple definition")
"""Finds the lines of a compiler or linker that say what is wrong."""
STACK = re.compile(r"^stack (\d+) bytes used$", re.MULTILINE)
TRACE = re.compile(r"^trace_sha256 (\w{64})$", re.MULTILINE)


@dataclass(frozen=True)
class StepCount:
    """The instructions of one component's steps, `number` of them; of an extern node its gate's."""

    name: str
    most: int
    mean: int
    number: int


@dataclass(frozen=True)
class Image:
    """Bytes and instructions of an image; None where it was not made or run, and `why` says why."""

    flash: int | None = None
    ram: int | None = None
    stack_used: int | None = None
    instant_most: int | None = None
    instant_mean: int | None = None
    self_test: int | None = None
    steps: tuple[StepCount, ...] = ()
    trace_sha256: str = ""
    same_as_host: bool | None = None
    compiler: str = ""
    why: str = ""

    def text_lines(self) -> list[str]:
        """The image's memory and instructions, in lines for people, or why there is none."""
        if self.flash is None:
            return [f"none: {self.why}"]
        lines = [
            f"{self.flash:,} bytes of flash, {self.ram:,} of RAM beside the stack ({self.compiler})"
        ]
        if self.instant_most is None:
            return [*lines, self.why]
        same = ", the host's trace" if self.same_as_host else ""
        most, mean = self.instant_most, self.instant_mean
        return [
            *lines,
            f"{self.stack_used:,} bytes of stack used{same}",
            f"{most:,} instructions an instant at most, {mean:,} on average",
            *(f"{s.most:,} instructions a step of {s.name} at most" for s in self.steps),
            f"{self.self_test:,} instructions the test of the arithmetic, once at the start",
        ]


def missing_tools(board: Board) -> str:
    """Says which tool for making an image is missing; "" where none is."""
    if shutil.which("make") is None:
        return "there is no `make`"
    if shutil.which(CC) is None:
        return f"there is no `{CC}` (Debian: gcc-arm-none-eabi, libnewlib-arm-none-eabi)"
    version = compiler_version()
    number = re.search(r"\) (\d+)\.", version)
    if number is None or int(number[1]) < OLDEST:
        return f"`{CC}` is too old: {version}; version {OLDEST} at least"
    if board.core in SOFT and find_spec("ziglang") is None:
        return (
            f"{board.core} computes doubles without hardware, and those of gcc's library are not "
            f"rounded right: {pip_install('compiler')} brings others"
        )
    return ""


def compiler_version() -> str:
    """The first line that the compiler prints of its version."""
    output = run_compiler([CC, "--version"], Path.cwd(), TIMEOUT_S)
    return visible((output.text.splitlines() or [""])[0])


def cross_compiler(board: Board) -> Compiler | None:
    """The compiler of a board with its flags, as the Makefile has them; None if missing."""
    path = shutil.which(CC)
    if path is None or missing_tools(board):
        return None
    return Compiler((path,), compiler_version(), ("-Os", "-mthumb", *board.flags))


def require_stack(bound: StackBound, board: Board) -> None:
    """Raises SoterError X015 where the trusted part needs more stack than the board has."""
    if bound.bytes is None or bound.bytes <= board.stack_bytes:
        return
    over = bound.bytes - board.stack_bytes
    message = f"the program does not fit onto `{board.name}`: {over:,} bytes too many for its stack"
    raise mistake("X015", message, notes=(f"{bound.bytes:,} bytes: {' > '.join(bound.way)}",))


def build_image(package: Package, board: Board) -> Image:
    """Makes the image of a written package and runs it; SoterError X015, X016, X004."""
    if why := missing_tools(board):
        return Image(why=why)
    done = _run_make(package, package.image)
    if done.code != 0:
        raise _link_error(package, board, done.text)
    flash, ram = _flash_and_ram_bytes(package.folder / package.image, board)
    sized = {"flash": flash, "ram": ram, "compiler": compiler_version()}
    if not board.qemu or shutil.which(QEMU) is None:
        absent = "QEMU does not emulate this board" if not board.qemu else f"there is no `{QEMU}`"
        return Image(**sized, why=f"it was not run: {absent}")  # type: ignore[arg-type]
    ran, log = _run_in_qemu(package)
    stack, trace, test = (x.search(log) for x in (STACK, TRACE, SELF_TEST))
    counts = [StepCount(name, *(int(x) for x in numbers)) for name, *numbers in COUNTS.findall(log)]
    if not counts or trace is None or test is None:
        raise _run_error(f"the image does not run in QEMU: {visible((log or ran).strip()[-300:])}")
    instant, *steps = counts
    return Image(
        **sized,  # type: ignore[arg-type]
        stack_used=None if stack is None else int(stack[1]),
        instant_most=instant.most,
        instant_mean=instant.mean,
        self_test=int(test[1]),
        steps=tuple(steps),
        trace_sha256=trace[1],
        same_as_host=True if "the same trace as on the host" in ran else None,
    )


def _run_in_qemu(package: Package) -> tuple[str, str]:
    """The output of `make run`, and of the image itself; SoterError X016 if it does not run."""
    ran = run_compiler(["make", "-s", "run"], package.folder, RUN_S)
    if ran.code is None or "it has not ended within" in ran.text:
        raise _run_error(f"the run in QEMU does not end within {LIMIT_S} s")
    output = (package.folder / "run.txt").read_text(encoding="utf-8", errors="replace")
    if (refused := re.search(r"^not run: (.*)$", output, re.MULTILINE)) is not None:
        raise _run_error(f"the image refuses to run: {visible(refused[1])}")
    if re.search("another trace than on the host", ran.text):
        raise _run_error("the image computes another trace than this machine")
    return ran.text, output


def _flash_and_ram_bytes(image: Path, board: Board) -> tuple[int, int]:
    """The bytes of flash, and those of RAM beside the stack."""
    output = run_compiler(["arm-none-eabi-size", image.name], image.parent, TIMEOUT_S).text
    text, data, bss = (int(x) for x in output.splitlines()[1].split()[:3])
    return text + data, data + bss - board.stack_bytes


def _link_error(package: Package, board: Board, text: str) -> SoterError:
    over = dict(OVERFLOW.findall(text))
    if not over:
        lines = [visible(x[:300]) for x in text.splitlines() if SAID.search(x)]
        message = f"`{CC}` does not make an image of the package `{package.folder}`"
        return mistake("X004", message, notes=tuple(lines[:8]))
    sizes = {"FLASH": ("flash", board.flash_bytes), "RAM": ("RAM", board.ram_bytes)}
    parts = [
        f"{int(by):,} bytes too many for {sizes[region][0]} of {sizes[region][1]:,}"
        for region, by in over.items()
    ]
    message = f"the program does not fit onto `{board.name}`: {', '.join(parts)}"
    largest = _largest_symbols(package, "trdw" if "FLASH" in over else "bd")
    return mistake("X015", message, notes=(f"largest: {', '.join(largest)}",))


def _largest_symbols(package: Package, kinds: str) -> list[str]:
    """The largest symbols of some kinds of `nm`, of an image linked although it is too large."""
    _run_make(package, package.image, "CFLAGS=-Os -Wl,--noinhibit-exec")
    words = ["arm-none-eabi-nm", "--print-size", "--radix=d", package.image]
    output = run_compiler(words, package.folder, TIMEOUT_S).text
    (package.folder / package.image).unlink(missing_ok=True)
    found = [
        (int(size), name) for size, kind, name in SYMBOL.findall(output) if kind.lower() in kinds
    ]
    return [f"`{name}` {size:,} bytes" for size, name in sorted(found, reverse=True)[:LARGEST]]


def _run_make(package: Package, *words: str) -> CompilerOutput:
    zig = f"ZIG={shlex.join(python_module('ziglang'))}"
    return run_compiler(["make", *words, zig], package.folder, TIMEOUT_S)


def _run_error(message: str) -> SoterError:
    return mistake("X016", message, 'docs/bare-metal.md, "When the image refuses to run"')
