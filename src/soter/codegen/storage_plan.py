"""Plans which large temporaries have a place of their own, share one, or only point to one.

Purpose: `plan_storage` makes the `StoragePlan` of a body, which saves copies and stack in C:
temporaries that refer to a value which nothing changes while they are read; those that share a
place, as one is a copy of the other and they never differ while both are needed; idle stores.
Non-goals: C (`codegen/body.py`), which values are large (`TypeTable.is_large`).

Decision 109. A walk backwards through the structured code computes liveness; it repeats loops until
nothing changes. Two places interfere where one is written while the other is still needed (but for
the write that makes them equal), and where one is read while the other is written in more than one
piece. A value that is written in several pieces never shares a place with what it is made of.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.core import core
from soter.core.core import output_name
from soter.core.core_walks import walk, written_names
from soter.language.model.types import RecordType

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from soter.language.model.types import Type


RESULT = "$result"
"""The name of the place that a function's caller gives for the value that it returns."""


Path = tuple[str, ...]
"""Names of record fields, from the outermost in."""


@dataclass(frozen=True)
class StoragePlan:
    """The places of the large values of a body, by names of Core, `RESULT` and `output_name`.

    `references`: temporaries that become pointers; `behind`: by pointer, the temporaries that it
    may point into; `same`: by pointer, the temporary if it points to all of it. `homes`: by name
    without a separate place, the name whose place it shares, and the path to its part there;
    `shared`: places with several names; `idle`: statements (by `id`) whose value is never read.
    """

    references: frozenset[str] = frozenset()
    behind: Mapping[str, frozenset[str]] = field(default_factory=dict)
    same: Mapping[str, str] = field(default_factory=dict)
    homes: Mapping[str, tuple[str, Path]] = field(default_factory=dict)
    shared: frozenset[str] = frozenset()
    idle: frozenset[int] = frozenset()

    def home_name(self, name: str) -> str:
        """The name whose place `name` shares; `name` if it shares no place."""
        return self.homes[name][0] if name in self.homes else name

    def referred_name(self, name: str) -> str:
        """The temporary to which `name` refers, directly or through other references."""
        while name in self.same:
            name = self.same[name]
        return name

    def names_read(self, *roots: object) -> set[str]:
        """The temporaries that expressions read, also through references."""
        names = {x.name for x in walk(roots) if isinstance(x, core.Var)}
        return {r for name in names for r in (name, *self.behind.get(name, ()))}


@dataclass(frozen=True, kw_only=True)
class PlannedBody:
    """A body to be planned.

    `fixed`: large parameters and cells that are read in place, and never change here; `kept`: large
    locals of a step, which are loaded first and stored last; `outputs`: numbers of large outputs
    that may share a place; `result`: the value that a function returns; `leave`: the flag that it
    has returned; `read_later`: other temporaries that code after the body reads.
    """

    code: tuple[core.Stmt, ...]
    is_large: Callable[[Type], bool]
    fixed: tuple[str, ...] = ()
    kept: tuple[tuple[str, Type], ...] = ()
    outputs: tuple[tuple[int, Type], ...] = ()
    result: core.Expr | None = None
    leave: str | None = None
    read_later: tuple[str, ...] = ()


def is_place(e: core.Expr) -> bool:
    """Whether an expression has an address: a temporary, a cell, or a part of one of these."""
    while isinstance(e, (core.Field, core.Element)):
        e = e.target
    return isinstance(e, (core.Var, core.Get, core.Const))


def has_address(e: core.Expr) -> bool:
    """Whether an expression has an address: it is a place, or a choice between places."""
    if isinstance(e, core.Select):
        return has_address(e.then) and has_address(e.otherwise)
    return is_place(e)


def is_leave_check(e: core.Expr, leave: str) -> bool:
    """Whether `e` is `!leave` (not returned yet); C returns at once, so it needs no such check."""
    if not isinstance(e, core.Unary) or e.op != "not":
        return False
    return isinstance(e.operand, core.Var) and e.operand.name == leave


def plan_storage(task: PlannedBody) -> StoragePlan:
    """The storage plan of a body."""
    return _Planner(task).make_plan()


class _Planner:
    def __init__(self, task: PlannedBody) -> None:
        self.task = task
        self.types: dict[str, Type] = dict(task.kept)
        self.declared: dict[str, tuple[int, int]] = {}
        """Temporary -> nesting depth of its block, and its number in the order of the text."""
        self.outputs = {output_name(k): t for k, t in task.outputs}
        self.kept = {name for name, _ in task.kept}
        self.fixed = {RESULT, *self.outputs, *self.kept}
        self.candidates: dict[str, frozenset[str]] = {}
        self.same: dict[str, str] = {}
        """Reference to all of another temporary -> that temporary."""
        self._declare_large(task.code, 0, written_names(task.code))
        self.types.update(self.outputs)
        if task.result is not None and task.is_large(task.result.type):
            self.types[RESULT] = task.result.type

    def _declare_large(self, block: tuple[core.Stmt, ...], depth: int, changed: set[str]) -> None:
        for s in block:
            if isinstance(s, (core.Let, core.Call)):
                t = s.value.type if isinstance(s, core.Let) else s.type
                if self.task.is_large(t):
                    self.types[s.name] = t
                    self.declared[s.name] = depth, len(self.declared)
                    constant = isinstance(s, core.Let) and s.name not in changed
                    if constant and isinstance(s, core.Let) and has_address(s.value):
                        self.candidates[s.name] = frozenset(_names_inside(s.value))
                        if isinstance(s.value, core.Var):
                            self.same[s.name] = s.value.name
            elif isinstance(s, core.If):
                self._declare_large(s.then, depth + 1, changed)
                self._declare_large(s.otherwise, depth + 1, changed)
            elif isinstance(s, core.Loop):
                self._declare_large(s.body, depth + 1, changed)

    def make_plan(self) -> StoragePlan:
        """Makes as many temporaries references as possible, then lets values share places."""
        references = dict(self.candidates)
        while True:
            same = {n: o for n, o in self.same.items() if n in references}
            walker = _Walker(self.task, self.types, _all_bases(references), same)
            walker.walk_body()
            if not walker.changed:
                break
            for name in walker.changed:
                del references[name]
        homes = self._shared_homes(walker)
        return StoragePlan(
            references=frozenset((*references, *self.task.fixed)),
            behind=walker.behind,
            same=same,
            homes=homes,
            shared=frozenset(home for home, _ in homes.values()),
            idle=frozenset(walker.idle),
        )

    def _shared_homes(self, walker: _Walker) -> dict[str, tuple[str, Path]]:
        """By name with a shared place: the place and path; joins copies, then record parts."""
        groups: dict[str, dict[str, Path]] = {n: {n: ()} for n in self.types}
        for a, b in walker.copies:
            if self.types[a] == self.types[b]:
                self._join_groups(groups, walker, (a, ()), b)
        for a, field_, b in walker.parts:
            record = self.types[a]
            if isinstance(record, RecordType) and record.fields[field_][1] == self.types[b]:
                self._join_groups(groups, walker, (a, (record.fields[field_][0],)), b)
        homes = {name: (self._home_name(group), group[name]) for name, group in groups.items()}
        return {name: home for name, home in homes.items() if home[0] != name}

    def _join_groups(
        self, groups: dict[str, dict[str, Path]], walker: _Walker, into: tuple[str, Path], name: str
    ) -> None:
        """Puts the group of `name` at the place `into` of another, unless they interfere."""
        outer, inner = groups[into[0]], groups[name]
        path = (*outer[into[0]], *into[1])
        if outer is inner or any((x, y) in walker.apart for x in outer for y in inner):
            return
        if path != inner[name]:
            if inner[name] or self.fixed & inner.keys():
                return
            if self._rank(self._home_name(outer)) > self._rank(self._home_name(inner)):
                return  # a part must be declared inside the scope of its whole
        elif path:
            return
        joined = {**outer, **{x: (*path, *p) for x, p in inner.items()}}
        for x in joined:
            groups[x] = joined

    def _home_name(self, group: dict[str, Path]) -> str:
        return min((n for n, p in group.items() if not p), key=self._rank)

    def _rank(self, name: str) -> tuple[int, int, int]:
        """A name's rank; a group's home has the least: result, locals, outputs, others."""
        if name == RESULT:
            return 0, 0, 0
        if name in self.kept:
            return 1, 0, 0
        return (2, 0, 0) if name in self.outputs else (3, *self.declared[name])


def _names_inside(e: core.Expr) -> Iterator[str]:
    """Yields the temporaries that an expression with an address is, or is a part of."""
    if isinstance(e, core.Select):
        yield from _names_inside(e.then)
        yield from _names_inside(e.otherwise)
        return
    while isinstance(e, (core.Field, core.Element)):
        e = e.target
    if isinstance(e, core.Var):
        yield e.name


def _all_bases(references: Mapping[str, frozenset[str]]) -> dict[str, frozenset[str]]:
    """For each reference, all temporaries that it may point into, directly or through others."""
    known: dict[str, frozenset[str]] = {}
    for name, bases in references.items():  # a reference stands behind those that it refers to
        known[name] = frozenset({x for b in bases for x in (b, *known.get(b, ()))})
    return known


class _Walker:
    """Walks a body from end to beginning, and notes which names interfere."""

    def __init__(
        self,
        task: PlannedBody,
        types: Mapping[str, Type],
        behind: dict[str, frozenset[str]],
        same: dict[str, str],
    ) -> None:
        self.task = task
        self.tracked = frozenset(types)
        self.behind = behind
        self.same = same
        self.idle: set[int] = set()
        self.changed: set[str] = set()
        """References that must become copies: their target is written while they are needed."""
        self.copies: list[tuple[str, str]] = []
        self.parts: list[tuple[str, int, str]] = []
        """(record, number of its field, temporary that the field is made of)."""
        self.apart: set[tuple[str, str]] = set()  # names that may share no place
        self._at_exit: set[str] = set()
        self._order: dict[int, int] = {}
        self._published: dict[str, int] = {}
        """Output -> number of the first statement that publishes it, or of the loop around it."""
        self._number_statements(task.code, None)

    def _number_statements(self, block: tuple[core.Stmt, ...], loop: int | None) -> None:
        for s in block:
            at = self._order[id(s)] = len(self._order)
            if isinstance(s, core.Publish):
                self._published.setdefault(output_name(s.output), at if loop is None else loop)
            elif isinstance(s, core.If):
                self._number_statements(s.then, loop)
                self._number_statements(s.otherwise, loop)
            elif isinstance(s, core.Loop):
                self._number_statements(s.body, at if loop is None else loop)

    def walk_body(self) -> None:
        """Walks the body and fills `idle`, `changed`, `copies`, `parts` and `apart`."""
        task = self.task
        live = {output_name(k) for k, _ in task.outputs} | {n for n, _ in task.kept}
        live |= self.tracked & {*task.read_later}
        if task.result is not None:
            reads = self._tracked_reads(task.result)
            if RESULT in self.tracked:
                self._note_write(RESULT, task.result, {RESULT}, reads)
            live |= reads
        self._at_exit = set(live)
        live = self._needed_before_block(task.code, live) - self._published.keys()
        kept = {n for n, _ in task.kept}
        self.apart |= {(a, b) for a in kept for b in kept if a != b}
        self.apart |= {(b, a) for a, b in self.apart}
        self.copies.reverse()
        self.parts.reverse()

    def _tracked_reads(self, *roots: object) -> set[str]:
        names = {x.name for x in walk(roots) if isinstance(x, core.Var)}
        names |= {x for name in names for x in self.behind.get(name, ())}
        return names & self.tracked

    # ------------------------------------------------------------ statements

    def _needed_before_block(self, block: tuple[core.Stmt, ...], live: set[str]) -> set[str]:
        """The names needed before a block, computed from the names needed after it (`live`)."""
        for s in reversed(block):
            live = self._needed_before_statement(s, live)
        return live

    def _needed_before_change(self, s: core.Set | core.Push, live: set[str]) -> set[str]:
        if isinstance(s, core.Set) and s.name == self.task.leave:
            return set(self._at_exit)
        if isinstance(s, core.Set) and not s.path:
            return self._needed_before_write(s, s.name, s.value, live)
        return self._needed_before_part_write(
            s.name, s.value, live, self._tracked_reads(s.path, s.value)
        )

    def _needed_before_statement(self, s: core.Stmt, live: set[str]) -> set[str]:
        if isinstance(s, core.If):
            return self._needed_before_if(s, live)
        if isinstance(s, core.Loop):
            return self._needed_before_loop(s, live)
        at = self._order[id(s)]
        live = {x for x in live if self._published.get(x, -1) <= at}  # not yet published ones
        if isinstance(s, core.Let):
            return self._needed_before_write(s, s.name, s.value, live)
        if isinstance(s, core.Call):
            return self._needed_before_call(s, live)
        if isinstance(s, (core.Set, core.Push)):
            return self._needed_before_change(s, live)
        if isinstance(s, core.Publish):
            name = output_name(s.output)
            if s.limit is None:
                return self._needed_before_write(None, name, s.value, live)
            return self._needed_before_part_write(name, s.value, live, self._tracked_reads(s.value))
        if isinstance(s, core.Choose) and s.ages is not None:
            return self._needed_before_part_write(s.ages, None, live, set())
        return live | self._tracked_reads(
            *(getattr(s, n) for n in ("condition", "operands", "limit") if hasattr(s, n))
        )

    def _needed_before_call(self, s: core.Call, live: set[str]) -> set[str]:
        reads = self._tracked_reads(s.arguments)
        if s.name in self.tracked:
            self._note_write(s.name, None, live, reads)
        return (live - {s.name}) | reads

    def _needed_before_if(self, s: core.If, live: set[str]) -> set[str]:
        if self.task.leave is not None and is_leave_check(s.condition, self.task.leave):
            return self._needed_before_block(s.then, live)
        then, otherwise = (
            self._needed_before_block(s.then, live),
            self._needed_before_block(s.otherwise, live),
        )
        return then | otherwise | self._tracked_reads(s.condition)

    def _needed_before_loop(self, s: core.Loop, live: set[str]) -> set[str]:
        idle, changed = set(self.idle), set(self.changed)
        around = set(live)
        while True:  # a store that is idle in one round may be needed in the next
            self.idle = set(idle)
            before = self._needed_before_block(s.body, around)
            if before <= around:
                break
            around |= before
        self.changed |= changed
        return around

    def _needed_before_write(
        self, s: core.Stmt | None, name: str, value: core.Expr, live: set[str]
    ) -> set[str]:
        """The names needed before a write to a whole place, from those needed after it."""
        reads = self._tracked_reads(value)
        if name not in self.tracked:
            return live | reads
        if s is not None and name not in live:
            self.idle.add(id(s))
            return live
        if name not in self.behind:
            self._note_write(name, value, live, reads)
        return (live - {name}) | reads

    def _needed_before_part_write(
        self, name: str, value: core.Expr | None, live: set[str], reads: set[str]
    ) -> set[str]:
        """The names needed before a write to a part of a place; its other parts stay needed."""
        if name not in self.tracked:
            return live | reads
        self._note_write(name, value, live, reads - {name}, full=False)
        return live | reads | {name}

    def _note_write(
        self,
        name: str,
        value: core.Expr | None,
        live: set[str],
        reads: set[str],
        *,
        full: bool = True,
    ) -> None:
        """Notes with what a write interferes; only a value with an address is copied at once."""
        at_once = value is not None and has_address(value)
        needed = live if at_once else live | reads
        self.changed |= {r for r in needed if name in self.behind.get(r, ())}
        equal = {name}
        if full and isinstance(value, core.Var):
            source = self._referred_place(value)
            if source is not None:
                equal.add(source)
                if (name, source) not in self.copies:
                    self.copies.append((name, source))
        elif full and isinstance(value, core.Make):
            for k, element in enumerate(value.elements):
                source = self._referred_place(element)
                if source is not None:
                    equal.add(source)
                    if (name, k, source) not in self.parts:
                        self.parts.append((name, k, source))
        self.apart |= {(name, x) for x in needed - equal}

    def _referred_place(self, e: core.Expr) -> str | None:
        """The tracked place if `e` refers to all of it; None for any other expression."""
        if not isinstance(e, core.Var):
            return None
        name = e.name
        while name in self.same:
            name = self.same[name]
        return name if name in self.tracked and name not in self.behind else None
