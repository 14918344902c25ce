"""Target `c`: the program, the kernel and a driver as plain C99, and a Makefile.

Purpose: a folder that builds with any C compiler and no Soter, runs in virtual time and prints the
same `trace_sha256` as `soter run`. It takes along the C files of externs. Externs that are not
bound to C get a function each in `externs.c`, which is the person's to fill in and is never
overwritten.
Non-goals: clocks and devices (other targets), compiling here, finding what a file includes
(`native/source_files.py`).
"""

from __future__ import annotations

import re
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from soter.codegen.c import tree as c
from soter.codegen.c.names import Unique, field_name
from soter.codegen.c.printer import print_file
from soter.codegen.unit import generate
from soter.native.compiler import MEANING, STANDARD, WARNINGS
from soter.native.shared_library import FAULTS, RUNTIME
from soter.native.source_files import included
from soter.targets.firmware import RUNTIME_FILES, firmware_files, firmware_name
from soter.targets.leases_and_lateness import (
    FILES as LEASES,
)
from soter.targets.leases_and_lateness import (
    lease_files,
    leased,
)
from soter.targets.leases_and_lateness import (
    notes as notes_of_leases,
)
from soter.targets.package import Package, PackageFile

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.core.core import CoreSystem
    from soter.language.model.system import Component, System


def with_headers(source: str) -> dict[Path, str]:
    """Path and text of a C file and of all it includes that lies beside or below it."""
    root = Path(source).resolve().parent
    return {p: text for p, text in included(source).items() if p.is_relative_to(root)}


STUBS = "externs.c"
APP = "soter_app"
KERNEL = (
    *("soter.h", "soter_kernel.c", "soter_virtual.c", "soter_self_test.c"),
    *("soter_sha256.h", "soter_sha256.c", "soter_check.h"),
    *RUNTIME_FILES,
)
STATE, PROGRAM, UNTIL = "APP_STATE", "APP_PROGRAM", "APP_UNTIL_NS"


def c99_package(system: System, core: CoreSystem, folder: Path) -> Package:
    """The package; externs without C are bound to `externs.c` here."""
    package = Package(folder)
    stubs = bind_stubs(system)
    unit = generate(system, core)
    linked = [s for s in unit.c_sources if s != STUBS]
    plants = [x for x in system.components if x.extern and x.plant is not None]
    package.files = [
        *firmware_files(system, unit),
        PackageFile(f"{unit.prefix}.h", unit.header),
        PackageFile(f"{unit.prefix}.c", unit.source),
        PackageFile(f"{APP}.h", app_header(system, unit)),
        PackageFile(f"{APP}.c", app_source(system, unit, plants)),
        PackageFile(_main_name(unit), (RUNTIME / "soter_main.c").read_text(encoding="utf-8")),
        *(PackageFile(n, (RUNTIME / n).read_text(encoding="utf-8")) for n in run_time(system)),
    ]
    package.files += lease_files(system, unit.prefix)
    if stubs or plants:
        package.files.append(PackageFile(STUBS, stubs_text(unit, stubs, plants), yours=True))
    package.files += extern_files(linked)
    sources = [f.path for f in package.files if f.path.endswith(".c")]
    package.files += [
        PackageFile("Makefile", _makefile(command_name(unit.prefix), sources, _main_name(unit))),
        PackageFile("README.md", _readme(system, unit, stubs, plants)),
    ]
    package.notes = [*notes(core, stubs, plants), *notes_of_leases(system)]
    package.entries = f"{firmware_name(system, unit)}_"
    package.world = tuple(
        f"{unit.names[x.index]}_step" for x in system.components if x.plant is not None
    )
    package.commands = [f"make -C {folder}", f"{folder}/{command_name(unit.prefix)}"]
    if system.externals:  # nobody would publish for the command: it is for somebody's loop
        package.commands = [f"make -C {folder} lib"]
    return package


def run_time(system: System) -> tuple[str, ...]:
    """Files of the run-time that a package of the system takes along."""
    leases = LEASES if leased(system) else ()
    return (*KERNEL, *((FAULTS,) if system.faults else ()), *leases)


def bind_stubs(system: System, left: frozenset[int] = frozenset()) -> dict[str, Component]:
    """Bind every extern node that is not C to a function of `externs.c`, by its C name.

    `left`: components that stay as they are bound.
    """
    unique = Unique()
    component_by_symbol: dict[str, Component] = {}
    for x in system.components:
        if x.index in left or x.node is None or not x.extern:
            continue
        if not (x.binding or "").startswith("c:"):
            symbol = unique(f"{x.name.rpartition('.')[2]}_step")
            component_by_symbol[symbol] = x
            x.binding = f"c:{STUBS}:{symbol}"
    return component_by_symbol


def command_name(prefix: str) -> str:
    """What the package's command is called: never like a file, folder or goal of its Makefile."""
    taken = re.fullmatch(
        r"(gnu)?makefile|run|clean|lib|all|extern(_\d+)?|worker_\d+", prefix, re.IGNORECASE
    )
    return f"{prefix}_program" if taken else prefix


def _main_name(unit: Unit) -> str:
    return "main.c" if unit.prefix != "main" else "soter_main.c"


def extern_files(sources: list[str]) -> list[PackageFile]:
    """Copies of the externs' C, a folder for each source that needs one."""
    files: dict[str, str] = {}
    for source in sources:
        root = Path(source).resolve().parent
        texts = with_headers(source)
        number = 1
        while True:
            place = PurePath("extern") if number == 1 else PurePath(f"extern_{number}")
            named = {str(place / p.relative_to(root)): text for p, text in texts.items()}
            if all(files.get(name, text) == text for name, text in named.items()):
                break
            number += 1
        files.update(named)
    return [PackageFile(name, f"/* Copied by soter. */\n{text}") for name, text in files.items()]


# ---------------------------------------------------------------- which program


def app_header(system: System, unit: Unit) -> str:
    """Which program the virtual-time command runs."""
    return print_file(
        c.CFile(
            (
                c.FileComment(
                    (f"{APP}.h: which program {_main_name(unit)} runs, generated by soter",)
                ),
                c.Guarded("SOTER_APP_H"),
                c.Include(f"{unit.prefix}.h"),
                c.Define(STATE, f"{unit.prefix}_state"),
                c.Define(PROGRAM, f"(&{unit.prefix}_program)"),
                c.Define(UNTIL, f"INT64_C({system.until_ns or 0})"),
                c.FunctionDef(
                    "void",
                    "soter_app_answer",
                    ((f"{STATE} *", "state"), ("uint32_t", "component")),
                    None,
                    "answers the extern step that is due",
                    static=False,
                ),
            )
        )
    )


def app_source(system: System, unit: Unit, plants: list[Component]) -> str:
    """The answers of extern plants; extern nodes are linked and never due."""
    del system
    state = c.Name("state")
    body: list[c.CStmt] = []
    for x in plants:
        name = unit.names[x.index]
        call = c.CallExpr(f"{name}_move", (state, c.Unary("&", c.Name("out"))))
        answer = (
            c.Name(PROGRAM),
            state,
            c.Name("component"),
            c.Name("fault"),
            c.Unary("&", c.Name("out")),
        )
        body.append(
            c.IfStmt(
                c.Binary("==", c.Name("component"), c.Number(f"{x.index}U")),
                (
                    c.Declare(f"{name}_out", "out", c.Initializer(())),
                    c.Declare("soter_fault", "fault", call, const=True),
                    c.Do(c.CallExpr("soter_answer", answer)),
                    c.Return(None),
                ),
            )
        )
    nothing = (
        c.Name(PROGRAM),
        state,
        c.Name("component"),
        c.Name("SOTER_EXTERN_FAULT"),
        c.Name("NULL"),
    )
    body.append(c.Do(c.CallExpr("soter_answer", nothing)))
    return print_file(
        c.CFile(
            (
                c.FileComment((f"{APP}.c: answers of extern plants, generated by soter",)),
                c.Include(f"{APP}.h"),
                *(_move(unit, x, None) for x in plants),
                c.FunctionDef(
                    "void",
                    "soter_app_answer",
                    ((f"{STATE} *", "state"), ("uint32_t", "component")),
                    tuple(body),
                    static=False,
                ),
            )
        )
    )


# ---------------------------------------------------------------- externs.c


def stubs_text(unit: Unit, nodes: dict[str, Component], plants: list[Component]) -> str:
    """A function an extern, each a fault until somebody fills it in."""
    return print_file(
        c.CFile(
            (
                c.FileComment(
                    (
                        f"{STUBS}: the externs of this program, made by soter, yours to fill in.",
                        "",
                        "`soter build` does not overwrite it. As it stands every extern fails at",
                        "every step: an advanced controller is gated, another node latches.",
                    )
                ),
                c.Include(f"{APP}.h"),
                *(_node_stub(unit, symbol, x) for symbol, x in nodes.items()),
                *(_move(unit, x, _plant_body(x)) for x in plants),
            )
        )
    )


def _node_stub(unit: Unit, symbol: str, x: Component) -> c.FunctionDef:
    assert x.node is not None
    name = unit.names[x.index]
    reads = [field_name(s.topic.name.rpartition(".")[2]) for s in x.node.subscribes]
    outputs = [field_name(t.name.rpartition(".")[2]) for t in x.node.publishes]
    parameters = [(f"const {name}_in *", "in")]
    if x.node.locals:
        parameters.append((f"{name}_local *", "local"))
    parameters.append((f"{name}_out *", "out"))
    body: list[c.CStmt] = [
        c.Comment(f"reads {', '.join(f'in->{r}' for r in reads) or 'nothing'}"),
        *(c.Comment(f"give out->{o}, set out->has_{o} = 1, return 0") for o in outputs),
        *(c.Unused(n) for _, n in parameters),
        c.Return(c.Number("1")),
    ]
    return c.FunctionDef(
        "int", symbol, tuple(parameters), tuple(body), f"extern node {x.name}", static=False
    )


def _plant_body(x: Component) -> tuple[c.CStmt, ...]:
    assert x.plant is not None
    states = [field_name(v.name) for v in x.plant.states]
    return (
        c.Comment(f"give every new state: {', '.join(f'out->{s}' for s in states)}"),
        c.Comment("from the old ones and the topics in state->topics, return SOTER_OK"),
        c.Unused("state"),
        c.Unused("out"),
        c.Return(c.Name("SOTER_EXTERN_FAULT")),
    )


def _move(unit: Unit, x: Component, body: tuple[c.CStmt, ...] | None) -> c.FunctionDef:
    name = unit.names[x.index]
    parameters = ((f"const {STATE} *", "state"), (f"{name}_out *", "out"))
    return c.FunctionDef(
        "soter_fault", f"{name}_move", parameters, body, f"extern plant {x.name}", static=False
    )


# ---------------------------------------------------------------- Makefile and README


def _makefile(name: str, sources: list[str], main: str) -> str:
    meaning = " ".join(MEANING)
    warnings = " ".join(w for w in WARNINGS if w != "-Werror")
    listed = " \\\n  ".join(sorted(sources))
    return f"""\
# Written by soter: `make` builds ./{name}, `make run` runs it, `make lib` builds lib{name}.a for a
# main of your own (docs/deploy.md).
CFLAGS ?= -O2
# these belong to the meaning, so they come last: one rounding an operation, on every compiler
MEANING := {meaning}
WARNINGS := {warnings}
SOURCES := \\
  {listed}

OBJECTS := $(patsubst %.c,%.o,$(filter-out {main},$(SOURCES)))

{name}: $(SOURCES) $(wildcard *.h extern*/*.h)
\t$(CC) {STANDARD} $(WARNINGS) $(CFLAGS) $(MEANING) -I. -o $@ $(SOURCES) -lm

Makefile: ; # never made from a Makefile.c
lib{name}.a: $(OBJECTS)
\t$(AR) rcs $@ $(OBJECTS)
%.o: %.c $(wildcard *.h extern*/*.h)
\t$(CC) {STANDARD} $(WARNINGS) $(CFLAGS) $(MEANING) -I. -c -o $@ $<
.PHONY: run clean lib
lib: lib{name}.a
run: {name}
\t./{name}
clean:
\trm -f {name} lib{name}.a $(OBJECTS)
"""


def _readme(
    system: System, unit: Unit, stubs: dict[str, Component], plants: list[Component]
) -> str:
    name = unit.prefix
    externs = [f"`{x.name}`: `{symbol}`" for symbol, x in stubs.items()]
    externs += [f"`{x.name}`: `{unit.names[x.index]}_move`" for x in plants]
    filled = ""
    if externs:
        listed = "\n".join(f"- {line}" for line in externs)
        filled = f"""
## Externs

`{STUBS}` has a function for each, which fails until you fill it in:

{listed}
"""
    leases = ""
    if leased(system):
        leases = f"""\
| `{name}_lease.h`, `{name}_lease.c`, `soter_lease.*` | the actuators: what they obey, the law |
| `{name}_grant.c`, `soter_grant.*` | the trusted side: who gives leases, and when nobody does |
"""
    return f"""\
# {name}, system {system.name}

Written by soter from `{PurePath(system.program.path).name}` (program {system.program.sha256[:12]}).
{_how_to_use(system, unit)}

| file | what |
|---|---|
| `{name}.h`, `{name}.c` | the program: state, steps, decision modules, tables |
| `soter.h`, `soter_kernel.c`, `soter_virtual.c` | the kernel and the virtual-time driver |
| `{firmware_name(system, unit)}_firmware.h` | the program in your own loop: publish, step, read |
| `soter_firmware.h`, `soter_firmware.c` | what these functions have in common |
| `messages.json` | what the topics look like in memory; its hash is compared at the start |
| `soter_check.h` | what must be so; your program defines `soter_check_failed` (docs/deploy.md) |
| `soter_self_test.c` | finds at start what a compiler's or linker's flags have changed |
| `{APP}.h`, `{APP}.c`, `{_main_name(unit)}` | this command |
{leases}{filled}"""


def _how_to_use(system: System, unit: Unit) -> str:
    """What to do with a package: a command, or a library where the world is outside."""
    until = "" if system.until_ns else " --until SECONDS"
    command = f"""
    make
    ./{command_name(unit.prefix)}{until}

runs the program in virtual time and prints verdict, modules and `trace_sha256`, which is that of
`soter run` with the same seed. `--seed N`, `--until SECONDS`; exits 0 safe, 3 violated, 2 usage, 1
where this machine does not compute as the program means (`soter_self_test` says it; your own `main`
may call it too, with the program: both files are looked at)."""
    if not system.externals:
        return command
    name = firmware_name(system, unit)
    return f"""
    make lib

builds `lib{command_name(unit.prefix)}.a` for a loop of your own: `{name}_start`, then in every turn
`{name}_publish_...`, `{name}_step`, `{name}_read_...` of `{name}_firmware.h` (docs/deploy.md of
soter). The command below has nobody outside who publishes: it shows that the program runs, no more.
{command}"""


def notes(core: CoreSystem, stubs: dict[str, Component], plants: list[Component]) -> list[str]:
    """What is still to be filled in or bound, a sentence each."""
    notes = []
    waiting = [x.name for x in (*stubs.values(), *plants)]
    if waiting:
        notes.append(f"fill in {STUBS}: {', '.join(waiting)} fail until then")
    dead = [f.source_name for f in core.functions if f.result is None and not f.source]
    if dead:
        notes.append(
            f"extern function {', '.join(dead)} is not bound to C: calling it is a step fault "
            "(--bind NAME=c:file.c:name)"
        )
    return notes
