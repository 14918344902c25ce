"""Target `cortex-m`: the program, the kernel, start-up code and a linker script for a board.

Purpose: a folder of which `make` makes an image with arm-none-eabi-gcc, and `make run` runs it in
QEMU where that emulates the board: the run of `soter run`, whose `trace_sha256` it has to have.
Non-goals: boards (`board.py`), making the image here (`image.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING

from soter.codegen.unit import generate
from soter.native.compiler import MEANING, STANDARD, WARNINGS
from soter.native.shared_library import RUNTIME
from soter.targets import c99
from soter.targets.cortex_m.board import SOFT, UNGUARDED
from soter.targets.cortex_m.loop_tables import apart_nodes, loop_tables, tick_of
from soter.targets.leases_and_lateness import FILES as LEASES
from soter.targets.leases_and_lateness import lease_files
from soter.targets.package import Package, PackageFile
from soter.targets.posix import refuse_apart

if TYPE_CHECKING:
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System
    from soter.targets.cortex_m.board import Board
    from soter.targets.cortex_m.loop_tables import LoopTick

FOLDER = RUNTIME / "cortex_m"
OWN = (
    *("soter_board.h", "soter_cortex_m.h", "soter_cortex_m.c", "soter_replay.c"),
    *("soter_semihosting.h", "soter_semihosting.c"),
    *("soter_recording.h", "soter_recording.c"),
    *("soter_loop.h", "soter_loop.c", "soter_unprivileged.h", "soter_unprivileged.c"),
)
REPLAYED = ("soter_replay.c", "soter_recording.c")
LOOPED = ("soter_loop.c", "soter_unprivileged.c")
MAINS = frozenset((*REPLAYED, *LOOPED))
"""What is of one of the two images alone."""
SCRIPT = "soter_image.ld"
RECORDING = "recording.txt"
PRODUCTS = "_arm_muldivdf3.o"
"""Of libgcc: `__aeabi_dmul`, `__aeabi_ddiv`."""
NOTHING_APART = 512
"""Bytes of the thread that waits, where nothing computes in it."""
INSTANTS = 1000
LIMIT_S = 300
"""How long QEMU may take."""
ICOUNT = 6
FASTER = 4
"""In `make run` an instruction takes two to this ns (`-icount shift=`): SysTick counts them.

In `make run-loop` two to FASTER: hashing a trace takes its share of an instant."""


@dataclass(frozen=True)
class Replay:
    """A run of a system: until when (ns), its seed, and its `trace_sha256` on this machine."""

    until_ns: int
    seed: int
    sha256: str = ""
    recording: str = ""
    """Values of topics from outside, as `soter_recording.h` says; "" where there are none."""


def replayed_until(system: System) -> int:
    """The time of instant number INSTANTS, or the end of the system where that is earlier; ns."""
    calendars = [(x.phase_ns, x.period_ns) for x in system.components]
    calendars += [(0, i.every_ns) for i in system.inputs]
    horizon = min(p for _, p in calendars) * INSTANTS
    times = {t for phase, period in calendars for t in range(phase, horizon + 1, period)}
    last = sorted(times)[:INSTANTS][-1]
    return min(last, system.until_ns or last)


@dataclass(frozen=True)
class _Sources:
    """What images are made of: C that is trusted, and C of extern nodes."""

    name: str
    trusted: list[str]
    untrusted: list[str]


def cortex_m_package(
    system: System, core: CoreSystem, folder: Path, board: Board, replay: Replay
) -> Package:
    """The package for a board; externs without C are bound to `externs.c`."""
    refuse_apart(system)
    package = Package(folder)
    stubs = c99.bind_stubs(system)
    apart = apart_nodes(system)
    unit = generate(system, core, apart=frozenset(x.index for x in apart))
    tick = tick_of(system, board)
    plants = [x for x in system.components if x.extern and x.plant is not None]
    linked = [s for s in unit.c_sources if s != c99.STUBS]
    package.files = [
        PackageFile(f"{unit.prefix}.h", unit.header),
        PackageFile(f"{unit.prefix}.c", unit.source),
        PackageFile(f"{c99.APP}.h", c99.app_header(system, unit)),
        PackageFile(f"{c99.APP}.c", c99.app_source(system, unit, plants)),
        *(_own(RUNTIME / n) for n in dict.fromkeys((*c99.run_time(system), *LEASES))),
        *lease_files(system, unit.prefix),
        *loop_tables(system, unit, tick, replay.until_ns),
        *(_own(FOLDER / n) for n in OWN),
        PackageFile("board.c", board.text),
        PackageFile(SCRIPT, linker_script(board, board.ac_bytes if apart else NOTHING_APART)),
    ]
    if replay.recording:
        package.files.append(PackageFile(RECORDING, replay.recording))
    if stubs or plants:
        text = c99.stubs_text(unit, stubs, plants)
        package.files.append(PackageFile(c99.STUBS, text, yours=True))
    package.files += c99.extern_files(linked)
    sources = [f.path for f in package.files if f.path.endswith(".c")]
    bound = list(dict.fromkeys(x.binding.split(":")[1] for x in apart if x.binding is not None))
    package.files += c99.extern_files([s for s in bound if s != c99.STUBS])
    untrusted = [f.path for f in package.files if f.path.endswith(".c") and f.path not in sources]
    if stubs:
        untrusted.append(c99.STUBS)
    name = c99.command_name(unit.prefix)
    made = _Sources(name, [s for s in sources if s not in untrusted], untrusted)
    package.files += [
        PackageFile("Makefile", _makefile(made, board, replay, tick)),
        PackageFile("README.md", _readme(system, name, board)),
    ]
    package.notes = c99.notes(core, stubs, plants)
    lawless = [m.name for m in system.modules if not m.law] if system.externals else []
    package.notes += [
        f"{name} has no fail-safe law: nobody gives leases, and the board is told nothing of it"
        for name in lawless
    ]
    if apart and board.core in UNGUARDED:
        names = ", ".join(f"`{x.name}`" for x in apart)
        package.notes.append(
            f"{board.core} guards no memory: C of {names} may write anywhere, and is part of what "
            "is trusted"
        )
    if tick.why:
        package.notes.append(f"no image for real time: {tick.why}")
    package.entries = "soter_instant"
    package.world = tuple(
        f"{unit.names[x.index]}_step" for x in system.components if x.plant is not None
    )
    package.image = f"{name}.elf"
    package.commands = [f"make -C {folder} {'run' if board.qemu else f'{name}_loop.elf'}"]
    return package


def _own(path: Path) -> PackageFile:
    return PackageFile(path.name, path.read_text(encoding="utf-8"))


def linker_script(board: Board, ac_bytes: int) -> str:
    """Where everything lies; what does not fit is told by the linker, in bytes.

    `ac_bytes`: of the region of what is not trusted, a power of two.
    """
    return f"""\
/* {SCRIPT}: where everything lies on {board.name}, generated by soter. */
MEMORY {{
  FLASH (rx) : ORIGIN = {board.flash_at:#x}, LENGTH = {board.flash_bytes}
  RAM (rw) : ORIGIN = {board.ram_at:#x}, LENGTH = {board.ram_bytes}
}}
ENTRY(soter_vectors)
soter_flash = ORIGIN(FLASH);
soter_flash_end = ORIGIN(FLASH) + LENGTH(FLASH);
SECTIONS {{
  .text : {{
    soter_vectors = .;
    KEEP(*(.vectors)) *(.text*) *(.rodata*)
    . = ALIGN(8);
  }} > FLASH
  .ARM.exidx : {{ *(.ARM.exidx*) . = ALIGN(8); }} > FLASH
  /* what is not trusted: variables, and the stack from the end on */
  .ac_data : ALIGN({ac_bytes}) {{
    soter_ac = .;
    *(.ac_data*)
    . = ALIGN(8);
    soter_ac_data_end = .;
  }} > RAM AT > FLASH
  soter_ac_data_load = LOADADDR(.ac_data);
  .ac_bss (NOLOAD) : {{
    *(.ac_bss*)
    . = ALIGN(8);
    soter_ac_used = .;
    . = MAX(., soter_ac + {ac_bytes});
    soter_ac_end = .;
  }} > RAM
  ASSERT(soter_ac_used + {ac_bytes // 2} <= soter_ac_end, "BOARD_AC_BYTES is too small")
  .data : {{ soter_data = .; *(.data*) . = ALIGN(8); soter_data_end = .; }} > RAM AT > FLASH
  soter_data_load = LOADADDR(.data);
  .bss (NOLOAD) : {{ soter_bss = .; *(.bss*) *(COMMON) . = ALIGN(8); soter_bss_end = .; }} > RAM
  .kept (NOLOAD) : {{ *(.kept*) . = ALIGN(8); }} > RAM /* no start writes here: a board may */
  .stack (NOLOAD) : {{ soter_stack = .; . += {board.stack_bytes}; soter_stack_top = .; }} > RAM
}}
"""


def _makefile(made: _Sources, board: Board, replay: Replay, tick: LoopTick) -> str:
    name = made.name
    common = " \\\n  ".join(sorted(s for s in made.trusted if s not in MAINS))
    warnings = " ".join(w for w in WARNINGS if w != "-Werror")
    untrusted = " ".join(made.untrusted)
    return f"""\
# Written by soter: `make` makes {name}.elf for {board.name}, `make run` runs it in QEMU and
# compares its trace with that of `soter run`, `make sizes` tells the size of every function;
# `make {name}_loop.elf` is the program against the clock.
CC := arm-none-eabi-gcc
CFLAGS ?= -Os
# these belong to the meaning, so they come last: one rounding an operation
MEANING := {" ".join(MEANING)}
WARNINGS := {warnings}
CORE := -mthumb {" ".join(board.flags)}
COMPILED = {STANDARD} $(WARNINGS) $(CFLAGS) $(MEANING) $(CORE) -DBOARD_CLOCK_HZ={board.clock_hz} -I.
PLACED := -ffunction-sections -fdata-sections
LINKED := -nostartfiles --specs=nano.specs -T{SCRIPT} -Wl,--gc-sections,-z,noexecstack
SOURCES := \\
  {common}
UNTRUSTED := {untrusted}
OBJECTS := {"untrusted.o" if made.untrusted else ""}
HEADERS := $(wildcard *.h extern*/*.h) {SCRIPT} Makefile flags.txt
{_arithmetic(board)}
{name}.elf: $(SOURCES) {" ".join(REPLAYED)} $(OBJECTS) $(HEADERS) $(ARITHMETIC)
\t$(CC) $(COMPILED) $(PLACED) $(LINKED) -o $@ $(SOURCES) {" ".join(REPLAYED)} \\
\t  $(OBJECTS) $(ARITHMETIC) -lm
{_untrusted(made)}{_loop(name, tick)}
Makefile: ; # never made from a Makefile.c
.PHONY: run run-loop sizes clean flags
# other flags, another image
flags.txt: export FLAGS = $(COMPILED) $(LOOP) $(ARITHMETIC)
flags.txt: flags
\t@echo "$$FLAGS" | cmp -s - $@ || echo "$$FLAGS" > $@
{_run(name, board, replay)}
sizes: {name}.elf
\tarm-none-eabi-size $<
\tarm-none-eabi-nm --print-size --size-sort --radix=d $<
clean:
\trm -f {name}.elf {name}_loop.elf run.txt flags.txt untrusted.o $(ARITHMETIC)
"""


def _untrusted(made: _Sources) -> str:
    """C of extern nodes: its variables lie in a region of their own."""
    if not made.untrusted:
        return ""
    return """\
untrusted.o: $(UNTRUSTED) $(HEADERS)
\t$(CC) $(COMPILED) -fno-common -nostdlib -r -o $@ $(UNTRUSTED)
\tarm-none-eabi-objcopy --rename-section .data=.ac_data --rename-section .bss=.ac_bss $@
"""


def _loop(name: str, tick: LoopTick) -> str:
    """The image against the clock; LOOP=-DSOTER_TRACED ends it, and tells its trace."""
    if tick.why:
        return f"""\
{name}_loop.elf:
\t@echo "there is no image for real time: {tick.why}"; false
"""
    return f"""\
LOOP ?=
{name}_loop.elf: $(SOURCES) {" ".join(LOOPED)} $(OBJECTS) $(HEADERS) $(ARITHMETIC)
\t$(CC) $(COMPILED) $(PLACED) -DSOTER_UNNAMED_CHECKS $(LOOP) $(LINKED) \\
\t  -o $@ $(SOURCES) {" ".join(LOOPED)} $(OBJECTS) $(ARITHMETIC) -lm
"""


def _arithmetic(board: Board) -> str:
    """The doubles of a core without hardware for them."""
    if board.core not in SOFT:
        return "ARITHMETIC :="
    return f"""\
# Doubles without hardware. Sums of gcc 12.2's own library are not rounded right, nor are quotients
# of compiler-rt that are subnormal, which the image finds at its start (make ARITHMETIC=). So
# products and quotients are gcc's, all else is compiler-rt's, out of the Python package ziglang.
ARITHMETIC := {PRODUCTS} compiler_rt.a
ZIG ?= python3 -m ziglang
{PRODUCTS}:
\tarm-none-eabi-ar x $$($(CC) $(CORE) -print-libgcc-file-name) $@
compiler_rt.a:
\t$(ZIG) build-lib -target thumb-freestanding-eabi -mcpu={SOFT[board.core]} -O ReleaseSmall \\
\t  -fsingle-threaded -fno-stack-check -fstrip -ffunction-sections -fdata-sections \\
\t  --name compiler_rt -femit-bin=$@ \\
\t  "$$($(ZIG) env | sed -n 's/.*lib_dir"\\{{0,1\\}} *[:=] *"\\(.*\\)".*/\\1/p')/compiler_rt.zig"
"""


def _run(name: str, board: Board, replay: Replay) -> str:
    if not board.qemu:
        return f"""\
run:
\t@echo "QEMU does not emulate {board.name}: load {name}_loop.elf onto it"; false
"""
    ended = """ \\
\t  if [ $$code = 124 ]; then echo "it has not ended within $(LIMIT_S) s: stopped"; fi;"""
    compared = """ \\
\t  grep -q "^trace_sha256 " run.txt || { [ $$code != 0 ] || code=1; exit $$code; }; \\
\t  grep -qxF "trace_sha256 $(TRACE)" run.txt && echo "the same trace as on the host" || \\
\t  { echo "another trace than on the host: $(TRACE)"; exit 1; };"""
    traced = f""" \\
\t  case "$(LOOP)" in *SOTER_TRACED*){compared} ;; \\
\t  esac;"""
    return f"""\
UNTIL_NS := {replay.until_ns}
SEED := {replay.seed}
TRACE := {replay.sha256 or "?"}
RECORDING := {RECORDING if replay.recording else ""}
# longer than that no image runs here
LIMIT_S ?= {LIMIT_S}
# in the group of make, so that QEMU ends with it
LIMIT = $(shell command -v timeout >/dev/null && echo timeout --foreground $(LIMIT_S))
QEMU = $(LIMIT) qemu-system-arm -M {board.qemu} -icount sleep=off,shift=$(ICOUNT) \\
  -display none -serial none -monitor none -chardev file,id=words,path=run.txt
# an instruction takes two to this ns: SysTick counts them
ICOUNT := {ICOUNT}
WORDS := arg={name},arg=$(UNTIL_NS),arg=$(SEED),arg={2**ICOUNT},arg=$(RECORDING)
# exits 0 safe, 1 not run or another trace, 3 violated, 70 a defect, 71 a fault, 124 no end
run: {name}.elf
\t@: > run.txt
\t@$(QEMU) -semihosting-config enable=on,target=native,chardev=words,$(WORDS) -kernel $<; \\
\t  code=$$?; cat run.txt;{ended}{compared if replay.sha256 else ""} exit $$code
run-loop: ICOUNT := {FASTER}
run-loop: {name}_loop.elf
\t@: > run.txt
\t@$(QEMU) -semihosting-config enable=on,target=native,chardev=words -kernel $<; \\
\t  code=$$?; cat run.txt;{ended}{traced if replay.sha256 else ""} exit $$code
"""


def _readme(system: System, name: str, board: Board) -> str:
    return f"""\
# {name}, system {system.name}, on {board.name}

Written by soter from `{PurePath(system.program.path).name}` (program {system.program.sha256[:12]}).

    make run

makes `{name}.elf` with arm-none-eabi-gcc and runs it in QEMU, where that emulates the board, in
virtual time: it prints what `soter run` prints, the instructions of an instant, and says whether
its `trace_sha256` is the host's. docs/bare-metal.md of soter leads to a board of your own.

| file | what |
|---|---|
| board.c | the board: memory map, clock, six functions (`soter_board.h` says what each does) |
| `{SCRIPT}` | where everything lies |
| `soter_cortex_m.*` | start-up, and words |
| `soter_replay.c` | the run in virtual time |
| `soter_semihosting.*` | what the boards of QEMU speak through |
| `soter_self_test.c` | the test of the arithmetic, which every image runs before anything else |
| the others | the program, the kernel (docs/deploy.md) |
"""
