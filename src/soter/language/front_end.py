"""Checks a program from its file to its flat systems: all checks that need no run.

Purpose: `check_file` loads and checks a program, elaborates every system and checks
well-formedness, as `soter check` does. It orders diagnostics as the text is, merges repeated ones,
and leaves out those that another error may have caused.
Non-goals: rendering diagnostics, anything dynamic.
"""

from __future__ import annotations

import gc
import sys
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, Fix, Label, Severity, SoterError
from soter.language.check.checker import check
from soter.language.elaborate.derived_systems import faultless, without_held_topics
from soter.language.elaborate.flatten_system import flatten, flatten_loose, implicit_system
from soter.language.elaborate.lints.module_lints import warn_of_doubtful_parts
from soter.language.elaborate.passes.flattening import Flattening
from soter.language.elaborate.passes.system_numbers import has_param
from soter.language.elaborate.tested_system import elaborate_test
from soter.language.elaborate.wellformed import (
    check_deployed,
    check_module_declaration,
    check_periods,
)
from soter.language.load.loader import FROM_DISK, begins_as_program, load
from soter.language.model.typed import InstanceSymbol, ModuleSymbol, SystemSymbol

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from soter.diagnostics.diagnostic import Source
    from soter.language.load.loader import LoadedProgram, SourceAccess
    from soter.language.model.system import System
    from soter.language.model.typed import NodeSymbol, PlantSymbol, TestSymbol, TypedProgram
    from soter.language.model.types import Value


HUSHED = {
    "W001", "W004", "W012", "W013", "W014", "W015", "W016", "W017", "W018", "W019", "W021",
    "W022", "W023", "W024", "W025", "W026", "W027", "W028", "W030", "W032", "W033",
    "W034", "W035", "W036",
}  # fmt: skip
"""Warnings that something is missing or unlikely; they are left out beside errors, which may be
their cause."""
MERGED = {"N001", "N004", "N006", "M009", "M010"}
"""Codes for missing names: one mistake, wherever the name is used."""
ONCE = {"M003", "M004", "M005", "M013"}
"""Codes of mistakes in a part, which every system with it repeats: reported for one of them."""
PLACES_MAX = 5


def ordered_for_readers(diagnostics: Diagnostics, sources: Sequence[Source]) -> Diagnostics:
    """Gives diagnostics without repetitions, ordered by file, then place, then severity."""
    files = {id(source): i for i, source in enumerate(sources)}

    def rank(d: Diagnostic) -> tuple[int, int, bool]:
        if d.primary is None:
            return (len(sources) if d.code == "S021" else -1), -1, False
        span = d.primary.span
        return files.get(id(span.source), -1), span.start, d.severity is not Severity.ERROR

    ordered = Diagnostics()
    for d in _with_merged_messages(_without_repetitions(sorted(diagnostics.items, key=rank))):
        if d.severity is Severity.ERROR or not diagnostics.has_errors or d.code not in HUSHED:
            ordered.add(d)
    return ordered


def _without_repetitions(items: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Gives for equal mistakes at one place only the diagnostic with the shortest message."""
    kept: dict[object, Diagnostic] = {}
    for number, d in enumerate(items):
        key: object = number
        if d.code in ONCE and d.primary is not None:
            span = d.primary.span
            key = d.code, id(span.source), span.start, span.end
        other = kept.get(key)
        if other is None or len(d.message) < len(other.message):
            kept[key] = d
    return list(kept.values())


def _with_merged_messages(items: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Gives one diagnostic for equal messages in one file, with a label for each place."""
    groups: dict[object, list[Diagnostic]] = {}
    for number, d in enumerate(items):
        key: object = number
        if d.code in MERGED and d.primary is not None:
            key = d.code, d.message, id(d.primary.span.source)
        groups.setdefault(key, []).append(d)
    return [_merged_diagnostic(group) for group in groups.values()]


def _merged_diagnostic(group: list[Diagnostic]) -> Diagnostic:
    first, rest = group[0], group[1:]
    if not rest:
        return first
    places = [Label(d.primary.span, "and here") for d in rest if d.primary is not None]
    more = len(places) - PLACES_MAX
    notes = (*first.notes, f"and in {more} more places") if more > 0 else first.notes
    fixes = tuple(_combined_fix(fix, group) for fix in first.fixes)
    secondary = (*first.secondary, *places[:PLACES_MAX])
    return replace(first, secondary=secondary, notes=notes, fixes=fixes)


def _combined_fix(fix: Fix, group: list[Diagnostic]) -> Fix:
    """Gives a fix with the distinct edits of all fixes in `group` that have the title of `fix`."""
    edits = [e for d in group for f in d.fixes if f.title == fix.title for e in f.edits]
    return Fix(fix.title, tuple(dict.fromkeys(edits)))


RECURSION_LIMIT = 6_000
"""Every pass, also the later ones, must be able to follow the deepest tree the parser lets through:
200 levels of expressions inside 64 of blocks (S020), several Python frames a level."""
if sys.getrecursionlimit() < RECURSION_LIMIT:
    sys.setrecursionlimit(RECURSION_LIMIT)
ALL_COMPONENTS_MAX = 20_000


@dataclass(eq=False)
class CheckResult:
    """A program and all diagnostics about it; `program` is None if nothing could be read."""

    program: TypedProgram | None
    diagnostics: Diagnostics
    systems: dict[str, SystemSymbol] = field(default_factory=dict)
    loaded: LoadedProgram | None = None
    """The files that the program is made of."""
    flat: dict[str, System] = field(default_factory=dict)
    """System name -> the flat system that was checked; {} if the program declares none."""

    @property
    def ok(self) -> bool:
        """Whether the program has no errors, so that it may be run."""
        return self.program is not None and not self.diagnostics.has_errors

    @property
    def begins_as_program(self) -> bool:
        """Whether the file begins as a program, so that messages may quote it."""
        return self.loaded is None or begins_as_program(self.loaded.main.source.text)

    def default_system(self) -> SystemSymbol | None:
        """Gives the only system, or the only one marked `default`; None if neither exists."""
        if len(self.systems) == 1:
            return next(iter(self.systems.values()))
        marked = [s for s in self.systems.values() if s.default]
        return marked[0] if len(marked) == 1 else None

    @property
    def tests(self) -> dict[str, TestSymbol]:
        """Gives the tests of the main file."""
        tests = {} if self.program is None else self.program.tests
        return {n: t for n, t in tests.items() if "." not in n}


def check_file(
    path: str,
    text: str | None = None,
    overrides: Mapping[str, Value] | None = None,
    tell: Callable[[str], None] | None = None,
    reading: SourceAccess = FROM_DISK,
) -> CheckResult:
    """Checks the program in `path` (or in `text`, with `path` as its name).

    `tell` is called with a text about progress if the check may take seconds. The cycle collector
    is off meanwhile, as a program has many small objects and hardly any garbage.
    """
    collecting = gc.isenabled()
    diagnostics = Diagnostics(tell)
    gc.disable()
    try:
        return _check_file(path, text, overrides or {}, diagnostics, reading)
    finally:
        diagnostics.tell = lambda _: None  # no progress is reported after the check
        if collecting:
            gc.enable()


def _check_file(
    path: str,
    text: str | None,
    overrides: Mapping[str, Value],
    diagnostics: Diagnostics,
    reading: SourceAccess,
) -> CheckResult:
    loaded = load(path, diagnostics, text, reading)
    if loaded is None:
        return CheckResult(None, diagnostics)
    program = check(loaded, diagnostics)
    systems = {n: s for n, s in program.systems.items() if "." not in n}
    draft = not systems
    if draft:
        everything = implicit_system(program)
        systems = {everything.name: everything} if everything else {}
    _check_one_default(systems, diagnostics)
    controllers = {n for m in program.modules.values() for n in m.named_nodes}
    others = [n for n in program.nodes.values() if n not in controllers]
    for module in program.modules.values():
        check_module_declaration(module, diagnostics, program.damaged, others)
    flat_by_name = _flatten_all(program, systems, overrides, diagnostics, draft=draft)
    for test in program.tests.values():
        elaborate_test(program, test, overrides, diagnostics)
    _check_unplaced_declarations(program, systems, diagnostics)
    ordered = ordered_for_readers(diagnostics, [f.source for f in loaded.files])
    return CheckResult(program, ordered, systems, loaded, {} if draft else flat_by_name)


def _flatten_all(
    program: TypedProgram,
    systems: Mapping[str, SystemSymbol],
    overrides: Mapping[str, Value],
    diagnostics: Diagnostics,
    *,
    draft: bool,
) -> dict[str, System]:
    """Gives name -> flat system, for those without errors; M007 if all are too large together."""
    components, flat_by_name = 0, {}
    for name, system in systems.items():
        flat = _flatten_and_check(program, system, overrides, diagnostics, draft=draft)
        if flat is not None:
            components += program.system_sizes[system][0]
            flat_by_name[name] = flat
        if components > ALL_COMPONENTS_MAX:
            diagnostics.error(
                "M007",
                "the systems of this program are too large together",
                system.span,
                f"more than {ALL_COMPONENTS_MAX} parts up to here",
                helps=("put them into programs of their own, with the parts in a common import",),
            )
            break
    return flat_by_name


def _flatten_and_check(
    program: TypedProgram,
    symbol: SystemSymbol,
    overrides: Mapping[str, Value],
    diagnostics: Diagnostics,
    *,
    draft: bool = False,
    lints: bool = True,
) -> System | None:
    """Gives the flat system; None if it has errors. Without `lints` it gives no warnings."""
    flattening = Flattening(program, symbol, overrides, diagnostics, draft=draft)
    before = len(diagnostics.items)
    flat = flatten(flattening)
    if flat is not None:
        check_periods(flat, diagnostics, flattening.unknown)
        sound = all(d.severity is not Severity.ERROR for d in diagnostics.items[before:])
        if lints and sound and not program.damaged and not diagnostics.has_errors:
            warn_of_doubtful_parts(flat, diagnostics)
        if symbol.deploys is not None and sound:
            flat.proved = _deployed_system(program, symbol, overrides)
            check_deployed(flat, symbol, diagnostics)
    return flat


def _deployed_system(
    program: TypedProgram, symbol: SystemSymbol, overrides: Mapping[str, Value]
) -> System | None:
    """Gives the flat system that `symbol` deploys; None if it has errors, reported elsewhere."""
    assert symbol.deploys is not None
    diagnostics = Diagnostics()
    flat = flatten(Flattening(program, symbol.deploys, overrides, diagnostics))
    return None if diagnostics.has_errors else flat


def _check_unplaced_declarations(
    program: TypedProgram, systems: Mapping[str, SystemSymbol], diagnostics: Diagnostics
) -> None:
    """Checks numbers of declarations of the main file that no system has, by default parameters."""
    placed = _placed_symbols([*systems.values(), *(t.system for t in program.tests.values())])
    instances = tuple(
        InstanceSymbol(s.name, s, {}, {}, s.span) for s in _unplaced_symbols(program, placed)
    )
    topics = [t for n, t in program.topics.items() if "." not in n]
    if not instances and not topics:
        return
    span = (instances[0] if instances else topics[0]).span
    loose = SystemSymbol("", span, default=False, instances=instances)
    flattening = Flattening(program, loose, {}, diagnostics)
    flat = flatten_loose(flattening, topics)
    if flat is not None:
        check_periods(flat, diagnostics, flattening.unknown)


def _placed_symbols(systems: list[SystemSymbol]) -> set[object]:
    """Gives the systems, and all plants, modules and nodes in them."""
    placed: set[object] = set()
    todo: list[object] = [*systems]
    while todo:
        symbol = todo.pop()
        if symbol in placed:
            continue
        placed.add(symbol)
        if isinstance(symbol, SystemSymbol):
            todo += [i.what for i in symbol.instances]
            todo += [by for _, by, _ in symbol.replaces]
        elif isinstance(symbol, ModuleSymbol):
            todo += symbol.named_nodes
    return placed


def _unplaced_symbols(
    program: TypedProgram, placed: set[object]
) -> Iterator[PlantSymbol | ModuleSymbol | NodeSymbol]:
    """Yields declarations of the main file that are in no system and in none of their modules."""
    rest = [
        s
        for table in (program.plants, program.modules, program.nodes)
        for n, s in table.items()
        if "." not in n and s not in placed
    ]
    used = {n for s in rest if isinstance(s, ModuleSymbol) for n in s.named_nodes}
    return (s for s in rest if s not in used)


def _check_one_default(systems: Mapping[str, SystemSymbol], diagnostics: Diagnostics) -> None:
    marked = [s for s in systems.values() if s.default]
    for other in marked[1:]:
        diagnostics.error(
            "M012",
            "two systems are marked `default`",
            other.span,
            "another one",
            also=((marked[0].span, "the first one"),),
            notes=("it is the system that runs when none is named",),
        )


def system_of(
    checked: CheckResult,
    name: str | None,
    overrides: Mapping[str, Value] | None = None,
    *,
    exact: bool = True,
) -> System:
    """Gives the flat system to run; raises SoterError if none has this name, or if it has errors.

    With `exact`, a parameter of an instance that the system does not have is an error (U004);
    otherwise it may belong to another system.
    """
    if not checked.ok:
        raise SoterError(checked.diagnostics.items)
    assert checked.program is not None
    symbol = checked.systems.get(name) if name else checked.default_system()
    diagnostics = Diagnostics()
    if symbol is None:
        _report_no_system(checked, name, diagnostics)
        raise SoterError(diagnostics.items)
    flat = _flatten_and_check(checked.program, symbol, overrides or {}, diagnostics, lints=False)
    return _sound_system(checked.program, symbol, flat, overrides if exact else None, diagnostics)


def system_to_prove(
    checked: CheckResult,
    name: str | None,
    overrides: Mapping[str, Value] | None = None,
    *,
    exact: bool = True,
) -> System:
    """Gives the system of `system_of` for proofs: without held outputs and without faults."""
    return faultless(without_held_topics(system_of(checked, name, overrides, exact=exact)))


def system_of_test(
    checked: CheckResult,
    name: str,
    overrides: Mapping[str, Value] | None = None,
    *,
    exact: bool = True,
) -> System:
    """Gives a test's flat system, with `System.test`; raises SoterError as `system_of` does."""
    if not checked.ok:
        raise SoterError(checked.diagnostics.items)
    assert checked.program is not None
    diagnostics = Diagnostics()
    test = checked.tests.get(name)
    if test is None:
        known = ", ".join(f"`{n}`" for n in checked.tests) or "none"
        diagnostics.error("U010", f"there is no test `{name}`", notes=(f"there are: {known}",))
        raise SoterError(diagnostics.items)
    flat = elaborate_test(checked.program, test, overrides or {}, diagnostics)
    return _sound_system(
        checked.program, test.system, flat, overrides if exact else None, diagnostics
    )


def _sound_system(
    program: TypedProgram,
    system: SystemSymbol,
    flat: System | None,
    overrides: Mapping[str, Value] | None,
    diagnostics: Diagnostics,
) -> System:
    """Gives `flat`; raises SoterError if it has errors, U004 if it lacks an overridden instance."""
    for name in overrides or {}:
        if not has_param(program, [system], name):
            diagnostics.error("U004", f"system `{system.name}` has no instance of `{name}`")
    if flat is None or diagnostics.has_errors:
        raise SoterError(diagnostics.items)
    return flat


def _report_no_system(checked: CheckResult, name: str | None, diagnostics: Diagnostics) -> None:
    known = ", ".join(f"`{n}`" for n in checked.systems) or "none"
    if name:
        diagnostics.error("U002", f"there is no system `{name}`", notes=(f"there are: {known}",))
    elif not checked.systems:
        diagnostics.error(
            "U002",
            "the program declares nothing that could run",
            helps=("add a `system` with a plant, nodes or modules",),
        )
    else:
        diagnostics.error(
            "U002",
            "which system is meant?",
            notes=(f"there are: {known}",),
            helps=("name one with --system, or mark one `default`",),
        )
