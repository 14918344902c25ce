"""Writes the leases of modules' outputs as C.

Purpose: `lease_files` writes, for modules with a fail-safe law, `PREFIX_lease.h` and `.c` (the
actuators' side: the law and the length of a lease, for `runtime/soter_lease.c`) and
`PREFIX_grant.c` (the trusted side: the times that every release is held to, for
`runtime/soter_grant.c`); docs/proof.md, "When the trusted part stops".
Non-goals: who calls them; proofs of the law (`verify/claims/product_sets.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import gcd
from pathlib import PurePath
from typing import TYPE_CHECKING

from soter.codegen import c_tree as c
from soter.codegen.c_names import FileNames, field_name
from soter.codegen.c_printer import print_file
from soter.codegen.c_types import TypeTable
from soter.language.check.constants_and_types import declared_ns
from soter.language.model.types import show_ns
from soter.targets.package import PackageFile

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.language.model.system import Component, Module, System

FILES = ("soter_lease.h", "soter_lease.c", "soter_grant.h", "soter_grant.c")
"""Files of the runtime that the emitted files are for."""

ENDINGS = ("_command", "_lease", "_law", "_grant", "_budgets", "_node")
"""The endings of the C names of a module's lease."""


@dataclass(frozen=True)
class ReleaseBudget:
    """The release times of a trusted node (phase + k period) and its delays, in ns."""

    name: str
    period: int
    phase: int
    late: int
    response: int

    @property
    def latest(self) -> int:
        """The longest time from a release to its output, in ns."""
        return self.late + self.response


@dataclass(frozen=True)
class LeaseTimes:
    """The times of a module's leases; `budgets` holds its DM, its SC, then the nodes before them.

    `undeclared`: the times of DM and SC that are not declared, and count as zero.
    """

    module: Module
    budgets: tuple[ReleaseBudget, ...]
    undeclared: tuple[str, ...]

    @property
    def longest(self) -> int:
        """The time in ns from the release of SC that gives a lease to the lease's end."""
        dm, sc = self.budgets[:2]
        nearest = (sc.phase - dm.phase) % gcd(dm.period, sc.period)
        return sc.period + max(sc.late, dm.latest - nearest) + sc.response


def lease_times(system: System, module: Module) -> LeaseTimes:
    """The lease times of a module with a law; `system` is the system that flies."""
    verify = module.symbol.verify
    ns = partial(declared_ns, module)
    dm, sc = system.components[module.dm], system.components[module.sc]
    budgets = [
        ReleaseBudget(
            dm.name, module.period_ns, dm.phase_ns, ns(verify.late_dm), ns(verify.response_dm)
        ),
        ReleaseBudget(
            sc.name, sc.period_ns, sc.phase_ns, ns(verify.late_sc), ns(verify.response_sc)
        ),
    ]
    outer = module.name.rpartition(".")[0]
    for node in upstream_nodes(system, module):
        name = node.name.removeprefix(f"{outer}.") if outer else node.name
        late, response = (of.get(name) for of in (verify.late_of, verify.response_of))
        takes = 0 if node.takes_ns is None else node.takes_ns[1]
        times = ns(late), takes or ns(response)
        budgets.append(ReleaseBudget(node.name, node.period_ns, node.phase_ns, *times))
    declared = {"late_dm": verify.late_dm, "late_sc": verify.late_sc}
    declared |= {"response_dm": verify.response_dm, "response_sc": verify.response_sc}
    missing = tuple(n.replace("_", " ") for n, e in declared.items() if e is None)
    return LeaseTimes(module, tuple(budgets), missing)


def modules_with_law(system: System) -> list[Module]:
    """The modules whose outputs have a fail-safe law."""
    return [m for m in system.modules if m.law]


def lease_names(system: System, prefix: str) -> dict[int, str]:
    """The prefix of the C names of each lease, by module index; `a.b` and `a_b` stay different."""
    unique = FileNames(prefix, ())
    return {m.index: unique.new_family(m.name, ENDINGS) for m in modules_with_law(system)}


def upstream_nodes(system: System, module: Module) -> Iterator[Component]:
    """The nodes, without controllers, on which DM and SC depend, in order of declaration."""
    wanted = {*module.inputs, *system.components[module.sc].reads}
    left = [x for x in system.components if x.role == "node" and x.node is not None]
    found: list[Component] = []
    more = left
    while more:
        queued = [system.topics[i].queue_of for i in wanted]
        wanted |= {i for i in queued if i is not None}
        more = [x for x in left if not wanted.isdisjoint(x.writes)]
        left = [x for x in left if wanted.isdisjoint(x.writes)]
        wanted.update(i for x in more for i in x.reads)
        found += more
    yield from sorted(found, key=lambda x: x.index)


def lease_files(system: System, prefix: str) -> list[PackageFile]:
    """The C header and both C sources of leases; no files if no module has a law."""
    modules = modules_with_law(system)
    if not modules:
        return []
    types = TypeTable(FileNames(f"{prefix}_lease", ()))
    header: list[c.CTop] = []
    actuator: list[c.CTop] = []
    trusted: list[c.CTop] = []
    beginnings = lease_names(system, prefix)
    for module in modules:
        times = lease_times(system, module)
        name = beginnings[module.index]
        header += _lease_declarations(system, times, name, types)
        actuator += _law_definitions(system, times, name, types)
        trusted += _grant_definitions(times, name)
    about = f"system {system.name}, from {PurePath(system.program.path).name}, generated by soter"
    comments = [
        (f"{prefix}_lease.h: leases and fail-safe laws, {about}", "No dependence on the program."),
        (f"{prefix}_lease.c: the actuator side, {about}", "Belongs to soter_lease.c alone."),
        (f"{prefix}_grant.c: the trusted side, {about}", "Belongs to soter_grant.c alone."),
    ]
    include = c.Include(f"{prefix}_lease.h")
    guard = c.Guarded(f"SOTER_LEASE_OF_{prefix.upper()}_H")
    needed = (c.Include("soter_grant.h"), c.Include("soter_lease.h"))
    files = (
        c.CFile((c.FileComment(comments[0]), guard, *needed, *types.definitions, *header)),
        c.CFile((c.FileComment(comments[1]), include, *types.constants, *actuator)),
        c.CFile((c.FileComment(comments[2]), include, *trusted)),
    )
    names = (f"{prefix}_lease.h", f"{prefix}_lease.c", f"{prefix}_grant.c")
    return [PackageFile(n, print_file(f)) for n, f in zip(names, files, strict=True)]


def _lease_declarations(
    system: System, times: LeaseTimes, name: str, types: TypeTable
) -> Iterator[c.CTop]:
    module = times.module
    yield c.Section(f"module {module.name}")
    members = tuple(
        c.StructMember(types.stored_type(system.topics[i].type), _output_field(system, i))
        for i in module.outputs
    )
    yield c.StructDef(f"{name}_command", members, "what it publishes")
    lease = f"a lease ends {show_ns(times.longest)} after the release of SC that gave it, at most"
    yield c.VariableDef("soter_lease_info", f"{name}_lease", None, comment=lease)
    yield c.VariableDef("soter_grant_info", f"{name}_grant", None, comment="whom it watches")
    nodes = FileNames(f"{name}_node", ())
    for k, b in enumerate(times.budgets):
        yield c.Define(nodes(b.name), f"{k}U")


def _output_field(system: System, topic: int) -> str:
    return field_name(system.topics[topic].symbol.name.rpartition(".")[2])


def _law_definitions(
    system: System, times: LeaseTimes, name: str, types: TypeTable
) -> Iterator[c.CTop]:
    values = tuple(
        (_output_field(system, i), types.initializer(system.topics[i].type, times.module.law[i]))
        for i in times.module.outputs
    )
    comment = f"the fail-safe law of {times.module.name}"
    yield c.VariableDef(f"{name}_command", f"{name}_law", c.Initializer(values), comment=comment)
    info = (
        ("law", c.Unary("&", c.Name(f"{name}_law"))),
        ("size", c.Number(f"(uint32_t)sizeof {name}_law")),
        ("longest", c.Number(f"INT64_C({times.longest})")),
    )
    yield c.VariableDef("soter_lease_info", f"{name}_lease", c.Initializer(info), static=False)


def _grant_definitions(times: LeaseTimes, name: str) -> Iterator[c.CTop]:
    def budget_row(b: ReleaseBudget) -> c.CExpr:
        of: Sequence[str] = ("period", "phase", "late", "response")
        return c.Initializer(tuple((n, c.Number(f"INT64_C({getattr(b, n)})")) for n in of))

    rows = c.Initializer(tuple((None, budget_row(b)) for b in times.budgets))
    who = ", ".join(b.name for b in times.budgets)
    yield c.VariableDef("soter_budget", f"{name}_budgets", rows, array=True, comment=who)
    info = (("node", c.Name(f"{name}_budgets")), ("nodes", c.Number(f"{len(times.budgets)}U")))
    yield c.VariableDef("soter_grant_info", f"{name}_grant", c.Initializer(info), static=False)


def lease_notes(system: System) -> list[str]:
    """Notes for people on how long leases last, and on undeclared times, which count as zero."""
    return [lease_note(module, lease_times(system, module)) for module in modules_with_law(system)]


def lease_note(module: Module, times: LeaseTimes) -> str:
    """A note on how long a module's leases last, and on undeclared times, which count as zero."""
    text = f"{module.name}: a lease ends {show_ns(times.longest)} after its release at most"
    if times.undeclared:
        zero = ", ".join(times.undeclared)
        text += f"; {zero} not declared: they count as zero, which no clock keeps"
    return text
