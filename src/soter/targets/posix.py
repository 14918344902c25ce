"""Target `posix`: the program in real time, every extern node in a process of its own.

Purpose: a folder that builds with gcc or clang on Linux and no Soter: the trusted part with the
driver of `runtime/posix/`, one small program for each extern node that is bound to C, and where a
module has a fail-safe law that of the actuators.
Non-goals: what the driver does (docs/real-time.md), workers in Python (`workers/`), what meets the
world (`world_interface.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from soter.codegen.c.names import field_name
from soter.codegen.c.printer import escape
from soter.codegen.externs import request_fields
from soter.codegen.unit import generate
from soter.diagnostics.diagnostic import Diagnostic, Label, SoterError
from soter.language.model.binding_text import is_in_python
from soter.native.compiler import MEANING, STANDARD, WARNINGS
from soter.native.shared_library import RUNTIME
from soter.report.parameter_text import changed
from soter.targets import c99
from soter.targets.channel_document import channel_document_files
from soter.targets.firmware import RUNTIME_FILES
from soter.targets.leases_and_lateness import FILES as LEASES
from soter.targets.leases_and_lateness import lease_files, limits_of, takeovers
from soter.targets.package import Package, PackageFile
from soter.targets.world_interface import ACTUATOR, OUTSIDE, STATUS_TEXT, WorldTables
from soter.workers.exchange_layout import Exchange, exchange_of

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.core.core import CoreSystem
    from soter.core.layout import StateLayout
    from soter.language.model.system import Component, System

POSIX = RUNTIME / "posix"
CHECK = ("soter_posix_check.h", "soter_posix_check.c")
"""What a check that fails does: in all programs but that of the actuators, which has its own."""
CHANNEL = ("soter_channel.h", "soter_channel.c", *CHECK)
DRIVER = (
    *("soter_posix.h", "soter_posix.c", "soter_posix_clock.c"),
    *("soter_posix_setup.c", "soter_posix_workers.c"),
    *("soter_posix_world.c", "soter_posix_log.c", "soter_posix_report.c", "soter_posix_main.c"),
    *("soter_status.h", "soter_posix_status.c", "soter_posix_looks.c"),
)
WORKER = "soter_worker.c"
APP_HEADER, APP_SOURCE = "soter_posix_app.h", "soter_posix_app.c"
ELSEWHERE = frozenset(("soter_virtual.c", *RUNTIME_FILES))
"""Of the run-time what belongs to loops of one's own: not here."""
KERNEL = tuple(n for n in c99.KERNEL if n not in ELSEWHERE)
RING_BYTES = 8 * 2**20
SLOTS = (64, 4096)
FIRST_LINE = "soter recording 1"
"""Of what `--record` writes."""
FOR_EVER = 2**61
"""Until when a system in the world runs that does not say it: it is ended by a signal."""


@dataclass(frozen=True)
class Worker:
    """An extern node: its exchange, and the program that answers it ("": any command)."""

    component: Component
    exchange: Exchange
    name: str
    """What its C names begin with."""
    program: str
    source: str
    symbol: str


def posix_package(system: System, core: CoreSystem, folder: Path) -> Package:
    """The package; SoterError X008 for an extern node that cannot be a process of its own."""
    refuse_apart(system)
    outside = frozenset(x.index for x in nodes_of(system) if is_in_python(x.binding))
    package = Package(folder)
    stubs = {
        symbol: x for symbol, x in c99.bind_stubs(system, outside).items() if x.index not in outside
    }
    apart = frozenset(x.index for x in nodes_of(system))
    unit = generate(system, core, apart=apart)
    plants = [x for x in system.components if x.extern and x.plant is not None]
    command = c99.command_name(unit.prefix)
    workers = [_worker(system, unit, x, command, x.index in outside) for x in nodes_of(system)]
    built = [w for w in workers if w.program]
    world = WorldTables(system, unit)
    package.files = [
        PackageFile(f"{unit.prefix}.h", unit.header),
        PackageFile(f"{unit.prefix}.c", unit.source),
        PackageFile(f"{c99.APP}.h", _app_header(system, unit, workers, world)),
        PackageFile(f"{c99.APP}.c", c99.app_source(system, unit, plants)),
        PackageFile(APP_SOURCE, _app_source(system, unit, workers, world)),
        *(_own(n) for n in dict.fromkeys((*c99.run_time(system), *LEASES)) if n not in ELSEWHERE),
        *(_own(n, POSIX) for n in (*CHANNEL, *OUTSIDE, *DRIVER)),
        *(lease_files(system, unit.prefix) if world.granted else ()),
    ]
    trusted = [f.path for f in package.files if f.path.endswith(".c")]
    package.files += [*world.channel_files(), *channel_document_files(system)]
    linked = [s for s in unit.c_sources if s != c99.STUBS]
    package.files += (files := c99.extern_files(linked))
    trusted += [f.path for f in files if f.path.endswith(".c")]
    if plants:
        trusted.append(c99.STUBS)
    if stubs or plants:
        text = c99.stubs_text(unit, stubs, plants)
        package.files.append(PackageFile(c99.STUBS, text, yours=True))
    if built:
        package.files.append(_own(WORKER, POSIX))
    if world.topics or world.granted:
        package.files += [_own(n, POSIX) for n in STATUS_TEXT]
    rules = []
    for number, w in enumerate(built, 1):
        rules.append(_worker_files(package, unit, w, number))
    if actuators := world.actuator_files():
        package.files += [*actuators, *(_own(n, POSIX) for n in ACTUATOR)]
        rules.append((f"{command}_actuator", world.actuator_sources()))
    package.programs = {
        command: ["-pthread", "-I.", *sorted(trusted)],
        **{name: [*_folder(of), "-I.", *of] for name, of in rules},
    }
    package.files.append(PackageFile("Makefile", _makefile(command, trusted, rules)))
    package.files.append(PackageFile("README.md", _readme(system, unit, command, workers, world)))
    package.notes = [*c99.notes(core, stubs, plants), *world.notes]
    package.notes += [t.text for t in takeovers(system)]
    package.notes += [
        f"{w.component.name} is Python: `soter run --real-time`, or --worker {w.component.name}=..."
        for w in workers
        if not w.program
    ]
    package.commands = [f"make -C {folder}", f"{folder}/{command}"]
    return package


def nodes_of(system: System) -> list[Component]:
    """The extern nodes of a system: each has a process of its own."""
    return [x for x in system.components if x.extern and x.node is not None]


def refuse_apart(system: System) -> None:
    """SoterError X008 for extern nodes that cannot compute apart from the state."""
    problems = []
    for x in nodes_of(system):
        assert x.node is not None
        why = "keeps locals (`var`) in the state" if x.node.locals else ""
        why = "has steps that take time (`takes`, `overrun`)" if x.held is not None else why
        if why:
            problems.append(
                Diagnostic(
                    "X008",
                    f"extern node `{x.name}` {why}: as a process of its own it cannot",
                    Label(x.span, "declared here"),
                    notes=("a process keeps its own memory, and takes the time that it takes",),
                )
            )
    if problems:
        raise SoterError(tuple(problems))


def _own(name: str, folder: Path = RUNTIME) -> PackageFile:
    return PackageFile(name, (folder / name).read_text(encoding="utf-8"))


# ---------------------------------------------------------------- workers


def _worker(system: System, unit: Unit, x: Component, command: str, outside: bool) -> Worker:
    name = unit.names[x.index]
    exchange = exchange_of(system, x)
    if outside:
        return Worker(x, exchange, name, "", "", "")
    assert x.binding is not None
    _, source, symbol = x.binding.split(":")
    short = name.removeprefix(f"{unit.prefix}_")
    return Worker(x, exchange, name, f"{command}_{short}", source, symbol)


def _worker_files(package: Package, unit: Unit, w: Worker, number: int) -> tuple[str, list[str]]:
    """Adds what a worker is made of; its program, and its sources."""
    folder = f"worker_{number}"
    own = [f"{n}_" if n == w.symbol else n for n in ("in", "out")]  # none hides the function
    package.files.append(
        PackageFile(
            f"{folder}/soter_worker_app.h",
            f"""\
/* soter_worker_app.h: what the process of {w.component.name} answers, generated by soter. */
#ifndef SOTER_WORKER_APP_H
#define SOTER_WORKER_APP_H

#include "{unit.prefix}.h"

#define WORKER_HASH UINT64_C({w.exchange.number:#018x})
#define WORKER_IN_SIZE sizeof({w.name}_in)
#define WORKER_OUT_SIZE sizeof({w.name}_out)

/* 0 is success. `in` and `out` are a {w.name}_in and a {w.name}_out. */
int soter_worker_step(const void* in, void* out);

#endif
""",
        )
    )
    package.files.append(
        PackageFile(
            f"{folder}/worker.c",
            f"""\
/* worker.c: the step of {w.component.name}, generated by soter. */
#include "soter_worker_app.h"

int soter_worker_step(const void* {own[0]}, void* {own[1]}) {{
  return {w.symbol}((const {w.name}_in*){own[0]}, ({w.name}_out*){own[1]});
}}
""",
        )
    )
    sources = [WORKER, "soter_channel.c", f"{folder}/worker.c", CHECK[1]]
    if w.source == c99.STUBS:
        return w.program, [*sources, c99.STUBS]
    copied = c99.extern_files([w.source])
    moved = [PackageFile(f"{folder}/{f.path}", f.text) for f in copied]
    package.files += moved
    return w.program, [*sources, f"{folder}/extern/{Path(w.source).name}"]


# ---------------------------------------------------------------- which program


def _app_header(system: System, unit: Unit, workers: list[Worker], world: WorldTables) -> str:
    words = [world.words(), *((size + 7) // 8 for w in workers for size in w.exchange.sizes)]
    until = FOR_EVER if system.externals else 0
    longest = max((x.period_ns + x.phase_ns for x in system.components), default=10**9)
    slots = min(max(RING_BYTES // max(unit.layout.size, 1), SLOTS[0]), SLOTS[1])
    return f"""\
/* soter_app.h: which program the real-time driver runs, generated by soter. */
#ifndef SOTER_APP_H
#define SOTER_APP_H

#include "{unit.prefix}.h"

#define APP_STATE {unit.prefix}_state
#define APP_PROGRAM (&{unit.prefix}_program)
#define APP_UNTIL_NS INT64_C({system.until_ns or until})
#define APP_COMPONENTS {max(len(system.components), 1)}
#define APP_MODULES {len(system.modules)}
#define APP_EXTERNS {len(workers)}
#define APP_WORDS {max(words)} /* of the longest value that is exchanged */
#define APP_SLOTS {slots}U /* states between the trusted thread and the logger */
#define APP_LONGEST_NS INT64_C({longest}) /* no gap between instants is longer */
{world.defines()}
/* answers the extern plant that is due */
void soter_app_answer(APP_STATE* state, uint32_t component);

#endif
"""


def _app_source(system: System, unit: Unit, workers: list[Worker], world: WorldTables) -> str:
    gathers = "\n".join(_gather(system, unit, w) for w in workers)
    rows = "\n".join(_row(w) for w in workers) or "    {0}, /* there is none */"
    late, response = limits_of(system)
    return f"""\
/* {APP_SOURCE}: the externs and the times of this program, generated by soter. */
#include "soter_posix.h"

{world.include()}#include <string.h>

{gathers}
const soter_posix_extern soter_app_externs[] = {{
{rows}
}};
const uint32_t soter_app_extern_count = {len(workers)};

/* how much later than its release a component may begin, ns */
const int64_t soter_app_late_ns[] = {{
{_numbers(system, late)}
}};

/* and how long it may take then */
const int64_t soter_app_response_ns[] = {{
{_numbers(system, response)}
}};

/* the head of a recording, but its seed */
const char soter_app_flown[] =
{_flown(system, unit)};

/* where `safer` was true, so many looks of the DM at least keep AC: the next one counts */
const uint32_t soter_app_looks[] = {{
{_looks(system)}
}};

{world.tables()}"""


def _numbers(system: System, values: list[int]) -> str:
    named = zip(system.components, values, strict=True)
    return "\n".join(f"    INT64_C({ns}), /* {x.name} */" for x, ns in named) or "    0,"


def head_of(system: System, layout: StateLayout) -> dict[str, str]:
    """What a recording says of what flew, by name, beside its seed."""
    return {
        "program_sha256": system.program.sha256,
        "system": system.name,
        **{f"param {name}": text for name, (text, _) in changed(system).items()},
        "layout": sha256(repr(layout).encode()).hexdigest(),
    }


def _flown(system: System, unit: Unit) -> str:
    head = [FIRST_LINE, *(f"{name}={text}" for name, text in head_of(system, unit.layout).items())]
    return "\n".join(f'    "{escape(line)}\\n"' for line in head)


def _looks(system: System) -> str:
    return "\n".join(f"    {m.looks}U, /* {m.name} */" for m in system.modules) or "    0,"


def _gather(system: System, unit: Unit, w: Worker) -> str:
    """The function that copies what an extern reads."""
    topics = w.component.scope.topics
    assert w.component.node is not None
    lines = [
        f"  to->{field_name(name)} = from->topics.{unit.topics[topics[s.topic]][1]};"
        for (name, _), s in zip(
            request_fields(system, w.component), w.component.node.subscribes, strict=True
        )
    ] or ["  (void)from;", "  (void)to;"]
    body = "\n".join(lines)
    return f"""\
static void gather_{w.component.index}(const void* state, void* in) {{
  const APP_STATE* const from = (const APP_STATE*)state;
  {w.name}_in* const to = ({w.name}_in*)in;
{body}
}}
"""


def _folder(sources: list[str]) -> list[str]:
    """The flag by which a worker finds its own header."""
    return [f"-I{PurePath(s).parent}" for s in sources if s.startswith("worker_")][:1]


def _row(w: Worker) -> str:
    file = f'"{w.program}"' if w.program else "NULL"
    x = w.component
    return f"""\
    {{.component = {x.index}U, /* {x.name} */
     .file = {file},
     .in_size = sizeof({w.name}_in),
     .out_size = sizeof({w.name}_out),
     .hash = UINT64_C({w.exchange.number:#018x}),
     .budget_ns = INT64_C({x.period_ns}),
     .gather = gather_{x.index}}},"""


# ---------------------------------------------------------------- Makefile and README


def _makefile(name: str, trusted: list[str], workers: list[tuple[str, list[str]]]) -> str:
    meaning = " ".join(MEANING)
    warnings = " ".join(w for w in WARNINGS if w != "-Werror")
    listed = " \\\n  ".join(sorted(trusted))
    programs = " ".join([name, *(w for w, _ in workers)])
    rules = "".join(
        f"""
{program}: {" ".join(sources)} $(HEADERS)
\t$(CC) {STANDARD} $(WARNINGS) $(CFLAGS) $(MEANING) \\
\t  -I{PurePath(sources[2]).parent} -I. -o $@ {" ".join(sources)} -lm
"""
        for program, sources in workers
    )
    return f"""\
# Written by soter: `make` builds ./{name} and the programs of its workers, `make run` runs it.
CFLAGS ?= -O2
# these belong to the meaning, so they come last: one rounding an operation, on every compiler
MEANING := {meaning}
WARNINGS := {warnings}
HEADERS := $(wildcard *.h */*.h */*/*.h)
SOURCES := \\
  {listed}

all: {programs}

{name}: $(SOURCES) $(HEADERS)
\t$(CC) {STANDARD} $(WARNINGS) $(CFLAGS) $(MEANING) -pthread -I. -o $@ $(SOURCES) -lm
{rules}
Makefile: ; # never made from a Makefile.c
.PHONY: all run clean
run: all
\t./{name}
clean:
\trm -f {programs}
"""


def _readme(
    system: System, unit: Unit, command: str, workers: list[Worker], world: WorldTables
) -> str:
    until = "" if system.until_ns or system.externals else " --until SECONDS"
    until += " --channels FOLDER" if world.topics else ""
    name = unit.prefix
    rows = "\n".join(
        f"| `{w.component.name}` | {f'`{w.program}`' if w.program else '--worker NAME=COMMAND'} |"
        for w in workers
    )
    table = f"\n| extern | its process |\n|---|---|\n{rows}\n" if workers else ""
    kernel = re.sub(r"\.c$", "", KERNEL[1])
    actuators = ""
    if world.granted:
        actuators = f"""\
| `soter_grant.*`, `{name}_grant.c` | who gives leases, and when nobody does any more |
| `soter_lease.*`, `soter_actuator*`, `{name}_lease.*` | `{command}_actuator` |
| `actuate.c` | yours: what moves the devices |
"""
    return f"""\
# {name}, system {system.name}, in real time

Written by soter from `{PurePath(system.program.path).name}` (program {system.program.sha256[:12]}).

    make
    ./{command}{until}

runs the program against the clock: the trusted part (plants, decision modules, safe controllers,
all that is written in Soter) in one thread, every extern node in a process of its own. At the end
it tells how late everything was (`--json`); `--help` lists options. Exits 0 safe, 1 it cannot run
here, 2 usage, 3 violated, 4 the trusted part missed more than `--misses` (0) allows, 70 a check of
the driver failed, 130 stopped.
docs/real-time.md of soter says what is lost without permissions.
{table}
Where nobody was late its `trace_sha256` is that of `soter run` with the same seed. What
`--record FILE` writes is told by `soter run --recorded FILE`.

| file | what |
|---|---|
| `{name}.h`, `{name}.c` | the program: state, steps, decision modules, tables |
| `soter.h`, `{kernel}.c` | the kernel |
| `soter_posix*.c`, `soter_channel.c` | the real-time driver |
| `soter_check.h`, `soter_posix_check.c` | what must be so, and what happens where it is not |
| `soter_outside.*` | values from and to other programs (`{name}_channels.h`, where there are any) |
| `channels.json` | the same channels for programs that are no C: `soter.remote` |
| `soter_worker.c`, `worker_*/` | the processes of extern nodes |
{actuators}"""
