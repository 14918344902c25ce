"""Makes target `posix`: the program in real time, every extern node in a process of its own.

Purpose: `posix_package` writes a folder that builds with gcc or clang on Linux and no Soter: the
trusted part with the driver of `runtime/posix/`, a small program for each extern node that is bound
to C, and where a module has a fail-safe law the program of the actuators.
Non-goals: what the driver does (docs/real-time.md), workers in Python (`workers/`), what meets the
world (`world_interface.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from soter.codegen.c_names import field_name
from soter.codegen.c_printer import string_text
from soter.codegen.externs import request_fields
from soter.diagnostics.diagnostic import Diagnostics
from soter.language.load.named_files import is_answered_by_python
from soter.native.shared_library import RUNTIME
from soter.report.wording import changed_parameters
from soter.targets import c99
from soter.targets.firmware_interface import RUNTIME_FILES
from soter.targets.late_limits import late_limits
from soter.targets.leases import FILES as LEASES
from soter.targets.leases import lease_files
from soter.targets.package import Package, PackageFile, filled_file, shipped_file
from soter.targets.takeover_bounds import takeover_bounds
from soter.targets.world_interface import (
    ACTUATOR,
    OUTSIDE,
    STATUS_TEXT,
    WorldTables,
    channel_document_files,
    word_count,
)
from soter.workers.exchange import Exchange, make_exchange

if TYPE_CHECKING:
    from soter.codegen.unit import Unit
    from soter.core.core import CoreSystem
    from soter.core.layout import StateLayout
    from soter.language.model.system import Component, System


POSIX = RUNTIME / "posix"
CHECK = "soter_posix_check.c"
"""The file with the function for failed checks; the actuators' program has another one."""
CHANNEL = ("soter_channel.h", "soter_channel.c", CHECK)
DRIVER = (
    *("soter_posix.h", "soter_posix.c", "soter_posix_clock.c"),
    *("soter_posix_setup.c", "soter_posix_workers.c"),
    *("soter_posix_world.c", "soter_posix_log.c", "soter_posix_report.c", "soter_posix_main.c"),
    *("soter_status.h", "soter_posix_status.c", "soter_posix_looks.c"),
    *("soter_process.h", "soter_process.c"),
)
WORKER = "soter_worker.c"
APP_SOURCE = "soter_posix_app.c"
ELSEWHERE = frozenset(("soter_virtual.c", *RUNTIME_FILES))
"""Files of the run-time for other drivers, which a package does not have."""
RING_BYTES = 8 * 2**20
SLOTS = (64, 4096)
FIRST_LINE = "soter recording 1"
"""The first line of the file that `--record` writes."""
FOR_EVER = 2**61
"""The end, in ns, of a system in the world that declares none: only a signal ends it."""


@dataclass(frozen=True)
class Worker:
    """An extern node, its exchange, and the program that answers for it ("" for any command)."""

    component: Component
    exchange: Exchange
    name: str
    """The beginning of its C names."""
    reads: tuple[tuple[str, str], ...]
    """The topics that the node reads, as `fields_read` gives them."""
    program: str
    source: str
    symbol: str


def posix_package(system: System, core: CoreSystem, folder: Path) -> Package:
    """Makes the POSIX package; SoterError X008 if an extern node cannot be a separate process."""
    require_separable(system)
    nodes = extern_nodes(system)
    elsewhere = frozenset(x.index for x in nodes if is_answered_by_python(x.binding))
    program = c99.ProgramInC(system, core, frozenset(x.index for x in nodes), elsewhere)
    unit, command = program.unit, program.command
    workers = [_worker_of_node(program, x) for x in nodes]
    world = WorldTables(system, unit)
    context = _template_values(program, workers, world)
    copied = c99.extern_files(program.linked)
    files = [
        *program.program_files(filled_file("", "posix/soter_app.h", **context).text),
        filled_file(APP_SOURCE, f"posix/{APP_SOURCE}", **context),
        *_run_time_files(system),
        *(lease_files(system, unit.prefix) if world.granted else ()),
    ]
    trusted = [f.path for f in (*files, *copied) if f.path.endswith(".c")]
    trusted = sorted([*trusted, *([c99.STUBS] if program.plants else [])])
    files += [*world.channel_files(), *channel_document_files(system), *copied]
    files += program.stub_files()
    beside = _add_programs_beside(files, program, workers, world)
    context |= {"trusted": trusted, "beside": beside}
    files += [filled_file(n, f"posix/{n}", **context) for n in ("Makefile", "README.md")]
    notes = [*program.notes, *world.notes, *(t.bound_text for t in takeover_bounds(system))]
    return Package(
        folder,
        files,
        notes=[*notes, *(_python_node_note(w.component.name) for w in workers if not w.program)],
        commands=[f"make -C {folder}", f"{folder}/{command}"],
        programs={
            command: ["-pthread", "-I.", *trusted],
            **{name: [*_include_flag(of), "-pthread", "-I.", *of] for name, of in beside.items()},
        },
    )


def _run_time_files(system: System) -> list[PackageFile]:
    """The shipped C files of the kernel and of the driver."""
    kernel = dict.fromkeys((*c99.run_time_files(system), *LEASES))
    driver = (shipped_file(POSIX / n) for n in (*CHANNEL, *OUTSIDE, *DRIVER))
    return [*(shipped_file(RUNTIME / n) for n in kernel if n not in ELSEWHERE), *driver]


def _python_node_note(name: str) -> str:
    """A note about an extern node whose program is not part of the package."""
    return (
        f"{name} is Python: `soter run --real-time` starts it; this program alone has SC,"
        f" unless --worker {name}=COMMAND starts another worker"
    )


def extern_nodes(system: System) -> list[Component]:
    """The extern nodes of a system, each of which has a separate process."""
    return [x for x in system.components if x.extern and x.node is not None]


def require_separable(system: System) -> None:
    """Raises SoterError X008 for extern nodes that cannot compute outside the state."""
    diagnostics = Diagnostics()
    for x in extern_nodes(system):
        assert x.node is not None
        why = "keeps locals (`var`) in the state" if x.node.locals else ""
        why = "has steps that take time (`takes`, `overrun`)" if x.held is not None else why
        if why:
            message = f"extern node `{x.name}` {why}: as a process of its own it cannot"
            notes = ("a process keeps its own memory, and takes the time that it takes",)
            diagnostics.error("X008", message, x.span, "declared here", notes=notes)
    diagnostics.raise_errors()


def fields_read(system: System, unit: Unit, x: Component) -> tuple[tuple[str, str], ...]:
    """For each topic that an extern node reads, its C field and its member among the topics."""
    assert x.node is not None
    fields = (field_name(name) for name, _ in request_fields(system, x))
    members = (unit.topics[x.scope.topics[s.topic]][1] for s in x.node.subscribes)
    return tuple(zip(fields, members, strict=True))


# ---------------------------------------------------------------- workers


def _worker_of_node(program: c99.ProgramInC, x: Component) -> Worker:
    unit, exchange = program.unit, make_exchange(program.system, x)
    name, reads = unit.names[x.index], fields_read(program.system, unit, x)
    if is_answered_by_python(x.binding):
        return Worker(x, exchange, name, reads, "", "", "")
    assert x.binding is not None
    _, source, symbol = x.binding.split(":")
    short = name.removeprefix(f"{unit.prefix}_")
    return Worker(x, exchange, name, reads, f"{program.command}_{short}", source, symbol)


def _add_programs_beside(
    files: list[PackageFile], program: c99.ProgramInC, workers: list[Worker], world: WorldTables
) -> dict[str, list[str]]:
    """Adds the files of workers and actuators; returns the sources of each added program."""
    built = [w for w in workers if w.program]
    if built:
        files.append(shipped_file(POSIX / WORKER))
    if world.topics or world.granted:
        files += [shipped_file(POSIX / n) for n in STATUS_TEXT]
    beside = _add_worker_files(files, program.unit, built)
    if actuators := world.actuator_files():
        files += [*actuators, *(shipped_file(POSIX / n) for n in ACTUATOR)]
        beside[f"{program.command}_actuator"] = world.actuator_sources()
    return beside


def _add_worker_files(
    files: list[PackageFile], unit: Unit, built: list[Worker]
) -> dict[str, list[str]]:
    """Adds the files of workers; returns the sources of each added program."""
    sources_by_program = {}
    for number, w in enumerate(built, 1):
        folder = f"worker_{number}"
        files += [
            filled_file(f"{folder}/{name}", f"posix/{name}", w=w, prefix=unit.prefix)
            for name in ("soter_worker_app.h", "worker.c")
        ]
        extern_file = c99.STUBS
        if w.source != c99.STUBS:
            extern_file = f"{folder}/extern/{Path(w.source).name}"
            copied = c99.extern_files([w.source])
            files += [PackageFile(f"{folder}/{f.path}", f.text) for f in copied]
        sources = [WORKER, "soter_channel.c", f"{folder}/worker.c", CHECK, extern_file]
        sources_by_program[w.program] = sources
    return sources_by_program


# ---------------------------------------------------------------- which program


def _template_values(
    program: c99.ProgramInC, workers: list[Worker], world: WorldTables
) -> dict[str, object]:
    system, unit = program.system, program.unit
    words = [world.value_words, *(word_count(size) for w in workers for size in w.exchange.sizes)]
    flown = [FIRST_LINE, *(f"{n}={text}" for n, text in flight_head(system, unit.layout).items())]
    late, response = late_limits(system)
    return {
        "name": unit.prefix,
        "prefix": unit.prefix,
        "command": program.command,
        "system": system,
        "file": PurePath(system.program.path).name,
        "workers": workers,
        "world": world,
        "until_ns": system.until_ns or (FOR_EVER if system.externals else 0),
        "words": max(words),
        "slots": min(max(RING_BYTES // max(unit.layout.size, 1), SLOTS[0]), SLOTS[1]),
        "longest_ns": max((x.period_ns + x.phase_ns for x in system.components), default=10**9),
        "late": [*zip(system.components, late, strict=True)],
        "response": [*zip(system.components, response, strict=True)],
        "flown": [string_text(line) for line in flown],
    }


def flight_head(system: System, layout: StateLayout) -> dict[str, str]:
    """The entries of a recording, beside its seed, that tell which program flew."""
    return {
        "program_sha256": system.program.sha256,
        "system": system.name,
        **{f"param {name}": text for name, (text, _) in changed_parameters(system).items()},
        "layout": sha256(repr(layout).encode()).hexdigest(),
    }


def _include_flag(sources: list[str]) -> list[str]:
    """The compiler flag with which a worker finds its header; [] if it has no header."""
    return [f"-I{PurePath(s).parent}" for s in sources if s.startswith("worker_")][:1]
