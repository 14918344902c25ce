"""Target `c`: the program, the kernel and a driver as plain C99, and a Makefile.

Purpose: `c99_package` makes a folder that builds with any C compiler and no Soter, runs in virtual
time and prints the same `trace_sha256` as `soter run`. It takes along the C files of externs.
Externs that are not bound to C get a function each in `externs.c`, which is the person's to fill in
and is never overwritten.
Non-goals: clocks and devices (other targets), compiling here, finding what a file includes
(`native/cache.py`).
"""

from __future__ import annotations

import re
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_names import UniqueNames, field_name
from soter.codegen.c_printer import print_file
from soter.codegen.unit import Unit, generate
from soter.native.cache import included_files
from soter.native.shared_library import FAULTS, RUNTIME
from soter.targets.firmware_interface import RUNTIME_FILES, firmware_files, firmware_name
from soter.targets.leases import FILES as LEASES
from soter.targets.leases import lease_files, lease_notes, modules_with_law
from soter.targets.package import Package, PackageFile, filled_file, shipped_file

if TYPE_CHECKING:
    from soter.core.core import CoreSystem
    from soter.language.model.system import Component, System


def texts_with_includes(source: str) -> dict[Path, str]:
    """Maps the path of a C file, and of its includes in its folder or below, to their texts."""
    root = Path(source).resolve().parent
    return {p: text for p, text in included_files(source).items() if p.is_relative_to(root)}


STUBS = "externs.c"
APP = "soter_app"
KERNEL = (
    *("soter.h", "soter_kernel.c", "soter_virtual.c", "soter_self_test.c"),
    *("soter_sha256.h", "soter_sha256.c", "soter_check.h"),
    *RUNTIME_FILES,
)
STATE, PROGRAM, UNTIL = "APP_STATE", "APP_PROGRAM", "APP_UNTIL_NS"


class ProgramInC:
    """A system as C for every target; externs without C are bound to `externs.c` here.

    `unit`: the generated program. `stubs`: the extern nodes that are bound to `externs.c`, by the
    name of their C function. `plants`: the extern plants, which also have functions in `externs.c`.
    `linked`: the C files of other externs. `command`: the name of the package's program. `notes`:
    sentences on what a person must still do to complete the C. `world`: the C functions that move
    plants.
    """

    def __init__(
        self,
        system: System,
        core: CoreSystem,
        apart: frozenset[int] = frozenset(),
        left: frozenset[int] = frozenset(),
    ) -> None:
        """`apart`: components that compute outside the state; `left`: as in `bind_stubs`."""
        self.system = system
        self.stubs = bind_stubs(system, left)
        self.unit = generate(system, core, apart=apart)
        self.plants = [x for x in system.components if x.extern and x.plant is not None]
        self.linked = [s for s in self.unit.c_sources if s != STUBS]
        self.command = command_name(self.unit.prefix)
        self.notes = unfinished_notes(core, [*self.stubs.values(), *self.plants])
        moved = (self.unit.names[x.index] for x in system.components if x.plant is not None)
        self.world = tuple(f"{name}_step" for name in moved)

    def program_files(self, header: str) -> list[PackageFile]:
        """The program, and the answers of its extern plants; `header`: text of the driver's."""
        prefix = self.unit.prefix
        return [
            PackageFile(f"{prefix}.h", self.unit.header),
            PackageFile(f"{prefix}.c", self.unit.source),
            PackageFile(f"{APP}.h", header),
            PackageFile(f"{APP}.c", app_source(self.unit, self.plants)),
        ]

    def stub_files(self) -> list[PackageFile]:
        """The file `externs.c`; none if no extern needs a function there."""
        if not (self.stubs or self.plants):
            return []
        return [PackageFile(STUBS, stubs_text(self.unit, self.stubs, self.plants), yours=True)]


def c99_package(system: System, core: CoreSystem, folder: Path) -> Package:
    """Makes the C package; externs without C are bound to its `externs.c`."""
    program = ProgramInC(system, core)
    unit, main = program.unit, _main_file_name(program.unit)
    files = [
        *firmware_files(system, unit),
        *program.program_files(app_header(system, unit)),
        PackageFile(main, (RUNTIME / "soter_main.c").read_text("utf-8")),
        *(shipped_file(RUNTIME / n) for n in run_time_files(system)),
        *lease_files(system, unit.prefix),
        *program.stub_files(),
        *extern_files(program.linked),
    ]
    context = {
        "name": unit.prefix,
        "command": program.command,
        "main": main,
        "sources": sorted(f.path for f in files if f.path.endswith(".c")),
        "program": program,
        "system": system,
        "file": PurePath(system.program.path).name,
        "firmware": firmware_name(system, unit),
        "leased": modules_with_law(system),
    }
    commands = [f"make -C {folder}", f"{folder}/{program.command}"]
    if system.externals:  # the program alone has no inputs: it is for the user's own loop
        commands = [f"make -C {folder} lib"]
    return Package(
        folder,
        [*files, *(filled_file(n, f"c/{n}", **context) for n in ("Makefile", "README.md"))],
        notes=[*program.notes, *lease_notes(system)],
        commands=commands,
        entries=f"{firmware_name(system, unit)}_",
        world=program.world,
    )


def run_time_files(system: System) -> tuple[str, ...]:
    """The names of the run-time files that the system's package needs."""
    faults = (FAULTS,) if system.faults else ()
    return (*KERNEL, *faults, *(LEASES if modules_with_law(system) else ()))


def bind_stubs(system: System, left: frozenset[int] = frozenset()) -> dict[str, Component]:
    """Binds extern nodes that lack C to `externs.c`, except `left`; returns them by function."""
    unique = UniqueNames()
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
    """The name of the package's command, different from its files, folders and make goals."""
    taken = re.fullmatch(
        r"(gnu)?makefile|run|clean|lib|all|extern(_\d+)?|worker_\d+", prefix, re.IGNORECASE
    )
    return f"{prefix}_program" if taken else prefix


def _main_file_name(unit: Unit) -> str:
    return "main.c" if unit.prefix != "main" else "soter_main.c"


def extern_files(sources: list[str]) -> list[PackageFile]:
    """Copies of the externs' C files; sources with equal file names get separate folders."""
    files: dict[str, str] = {}
    for source in sources:
        root = Path(source).resolve().parent
        texts = texts_with_includes(source)
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
    """The text of the C header that says which program the virtual-time command runs."""
    return print_file(
        c.CFile(
            (
                c.FileComment(
                    (f"{APP}.h: which program {_main_file_name(unit)} runs, generated by soter",)
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


def app_source(unit: Unit, plants: list[Component]) -> str:
    """Writes the C that answers extern plants; extern nodes are linked and never due."""
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
                *(_plant_function(unit, x, None) for x in plants),
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
    """The text of `externs.c`, with a function for each extern that faults until it is written."""
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
                *(_plant_function(unit, x, _plant_body(x)) for x in plants),
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


def _plant_function(unit: Unit, x: Component, body: tuple[c.CStmt, ...] | None) -> c.FunctionDef:
    name = unit.names[x.index]
    parameters = ((f"const {STATE} *", "state"), (f"{name}_out *", "out"))
    return c.FunctionDef(
        "soter_fault", f"{name}_move", parameters, body, f"extern plant {x.name}", static=False
    )


# ---------------------------------------------------------------- what is left to do


def unfinished_notes(core: CoreSystem, waiting: list[Component]) -> list[str]:
    """Notes that name the stubs to fill in, and the externs to bind, before the C is complete."""
    notes = []
    if waiting:
        notes.append(f"fill in {STUBS}: {', '.join(x.name for x in waiting)} fail until then")
    dead = [f.source_name for f in core.functions if f.result is None and not f.source]
    if dead:
        notes.append(
            f"extern function {', '.join(dead)} is not bound to C: calling it is a step fault "
            "(--bind NAME=c:file.c:name)"
        )
    return notes
