"""What every bridge to a middleware is made around: the trusted part, and how it falls silent.

Purpose: the package of target `posix` in a folder of its own, and of each topic that goes out the
fail-safe law and the time after which whoever writes its channel is gone.
Non-goals: which topics a mapping may carry (`bridged_topics.py`), bridges (`ros/`, `dds/`,
`mavlink/`).
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from soter.codegen.c.names import field_name
from soter.codegen.unit import generate
from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.targets.c99 import command_name
from soter.targets.package import Package, PackageFile
from soter.targets.posix import nodes_of, posix_package
from soter.targets.world_interface import WorldTables

if TYPE_CHECKING:
    from pathlib import Path

    from soter.core.core import CoreSystem
    from soter.language.model.system import System, Topic

TRUSTED = "trusted"
"""The folder of what knows nothing of a middleware."""
LINKED = ("soter_outside.c", "soter_channel.c", "soter_posix_check.c", "soter_status_text.c")
"""What of it a bridge needs, to open channels and to say how the modules are."""
COMMON = ("soter_bridge_common.h", "soter_stamp_numbers.h")
"""What the bridges in C have in common."""
SILENT_OF_LEASED_NS = 20_000_000
"""The actuators write twice a millisecond."""
SILENT_PERIODS = 3


class BridgedSystem:
    """A system, its C (`unit`), how it meets the world, and the package of its trusted part.

    A system that meets no world has an empty package.
    """

    def __init__(self, system: System, core: CoreSystem, folder: Path) -> None:
        self.system = system
        meets = bool(system.externals)
        self.trusted = posix_package(system, core, folder) if meets else Package(folder)
        self.unit = generate(system, core, apart=frozenset(x.index for x in nodes_of(system)))
        self.world = WorldTables(system, self.unit)
        self.leased = {i: g for g in self.world.granted for i in g.module.outputs}
        self.command = command_name(self.unit.prefix)

    @property
    def actuated(self) -> bool:
        """Whether there is a program of the actuators."""
        return bool(self.system.externals and self.world.granted)

    # ------------------------------------------------------------ the trusted folder

    def files(self) -> list[PackageFile]:
        """The files of the trusted part."""
        return [in_folder(TRUSTED, f) for f in self.trusted.files]

    @cached_property
    def programs(self) -> dict[str, list[str]]:
        """Its programs: flags and sources, seen from the whole package."""
        own = self.trusted.programs
        return {name: [_inside(word) for word in words] for name, words in own.items()}

    @cached_property
    def sources(self) -> dict[str, list[str]]:
        """Its programs: the C files alone."""
        programs = self.programs
        return {n: [w for w in words if not w.startswith("-")] for n, words in programs.items()}

    @property
    def linked(self) -> list[str]:
        """What of it is linked into a bridge."""
        laws = [f"{self.command}_lease.c"] if self.actuated else []
        return [f"{TRUSTED}/{name}" for name in (*LINKED, *laws)]

    # ------------------------------------------------------------ topics

    def topic(self, index: int) -> Topic:
        """By its index."""
        return self.system.topics[index]

    def value_type(self, index: int) -> str:
        """The C type of a topic's value."""
        return self.unit.topics[index][0]

    def channel_hash(self, index: int) -> str:
        """What the head of a topic's channel says of its layout, in C."""
        return f"UINT64_C({self.world.number(self.topic(index)):#018x})"

    def is_inward(self, index: int) -> bool:
        """Whether somebody outside publishes it."""
        return self.topic(index).driver == "input"

    def silent_ns(self, index: int) -> int:
        """Without a value for so long, whoever writes a topic's channel is gone."""
        if index in self.leased:
            return SILENT_OF_LEASED_NS
        return SILENT_PERIODS * max(c.period_ns for c in self.system.components if c.plant is None)

    def law_statements(self, index: int) -> list[str]:
        """C (and C++) that fills `to` with the fail-safe law, or returns false: there is none."""
        lease = self.leased.get(index)
        if lease is None:
            return ["(void)to;", "return false;"]
        field = field_name(self.topic(index).symbol.name.rpartition(".")[2])
        kind = f"{lease.name}_command"
        return [
            f"const {kind}* const law =",
            f"    (const {kind}*){lease.name}_lease.law;",
            f"(void)memcpy(to, &law->{field}, sizeof({self.value_type(index)}));",
            "return true;",
        ]


def require_world(system: System) -> None:
    """SoterError U001 for a system that has its plants inside: no mapping would change that."""
    if not system.externals:
        what = f"`{system.name}` meets no world: with its plants inside there is nothing to bridge"
        help_ = "`system S deploys ... { external topic t; ... }` (docs/deploy.md)"
        raise SoterError((Diagnostic("U001", what, helps=(help_,)),))


def in_folder(folder: str, file: PackageFile) -> PackageFile:
    """The same file, a folder further down."""
    return PackageFile(f"{folder}/{file.path}", file.text, file.yours)


def shipped(source: Path, name: str) -> PackageFile:
    """C or C++ of the run-time, into `src` of a package."""
    return PackageFile(f"src/{name}", (source / name).read_text("utf-8"))


def cmake_programs(sources: dict[str, list[str]]) -> str:
    """CMake's rules for the programs of the trusted folder."""
    return "".join(
        f"""
add_executable({name} {" ".join(files)})
target_include_directories({name} PRIVATE {TRUSTED})
target_link_libraries({name} PRIVATE m pthread)
"""
        for name, files in sources.items()
    )


def c_table(kind: str, name: str, rows: list[str]) -> str:
    """C has no empty tables: where there is nothing, there is one row that nobody counts."""
    empty = "    {0},\n"
    return f"static const {kind} {name}[] = {{\n{''.join(rows) or empty}}};\n"


def _inside(word: str) -> str:
    """A flag or source of a program of the trusted folder, seen from the package."""
    if word.startswith("-I"):
        return f"-I{TRUSTED}/{word[2:]}" if word != "-I." else f"-I{TRUSTED}"
    return f"{TRUSTED}/{word}" if word.endswith(".c") else word
