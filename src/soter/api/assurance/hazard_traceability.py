"""Traces hazards through requirements to properties, and finds what is not covered.

Purpose: `read_hazards` reads a CSV file that people keep, with hazards, requirements, and owners of
assumptions, and reports every wrong line (D021). `Tracing` compares these rows with the properties
of a system, before anything that takes long, and later with the finished case: its goals, and its
assumptions, to which it adds their owners.
Non-goals: the goals themselves; StrictDoc's own documents: only that tool reads them, but this file
reads the spreadsheet that it exports.
"""

from __future__ import annotations

import csv
import hashlib
import re
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from io import StringIO
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, Source, Span, mistake
from soter.diagnostics.similar_names import did_you_mean
from soter.diagnostics.system_texts import reason
from soter.language.load.named_files import read_bytes
from soter.report.safety_case import (
    SUPPORTED,
    UNDEVELOPED,
    CaseNode,
    OpenItem,
    SafetyCase,
    Traceability,
    TracedItem,
    TracedProperty,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from soter.diagnostics.codes import Code
    from soter.language.model.system import System


CODE: Code = "D021"
KINDS = ("hazard", "requirement", "assumption")
COLUMNS = ("kind", "id", "text", "traces_to", "owner", "validation", "evidence")
NEEDED = {"hazard": ("text",), "requirement": ("text",), "assumption": ()}
FOREIGN = {
    "hazard": ("owner", "validation", "evidence"),
    "requirement": ("owner", "validation", "evidence"),
    "assumption": ("text", "traces_to"),
}
"""Kind of a row -> cells that must be empty in it."""
ROWS_MAX = 100_000
NUMBER = re.compile(r"(?<![\w.])(?<![\w\]]\[)-?\d[\d.e+-]*")
"""In the key of an assumption, none of an index or a name: a bound."""


@dataclass(frozen=True)
class HazardRow:
    """A row of a file of hazards, at `span`; `traces_to`: requirement ids or property names."""

    kind: str
    id: str
    text: str
    traces_to: tuple[str, ...]
    owner: str
    validation: str
    evidence: str
    span: Span


@dataclass(frozen=True)
class HazardFile:
    """The path, the SHA-256 and the rows of a file of hazards."""

    path: str
    sha256: str
    rows: tuple[HazardRow, ...]


def read_hazards(path: Path) -> HazardFile:
    """Reads a file of hazards. Raises D006 if it is unreadable, D021 if lines are wrong."""
    try:
        raw = read_bytes(path)
    except OSError as error:
        raise mistake("D006", f"cannot read `{path}`: {reason(error)}") from error
    diagnostics = Diagnostics()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise mistake(CODE, f"`{path}` is not UTF-8: byte {error.start + 1}") from error
    rows = list(_hazard_rows(Source(str(path), text), diagnostics))
    diagnostics.raise_errors()
    return HazardFile(str(path), hashlib.sha256(raw).hexdigest(), tuple(rows))


def _hazard_rows(source: Source, diagnostics: Diagnostics) -> Iterator[HazardRow]:
    records = _csv_records(source, diagnostics)
    head, where = next(records, ([], Span(source, 0, 0)))
    names = [name.strip() for name in head]
    if not _is_sound_head(names, where, diagnostics):
        return
    first: dict[tuple[bool, str], Span] = {}
    for number, (cells, span) in enumerate(records):
        if number == ROWS_MAX:
            diagnostics.error(CODE, f"more than {ROWS_MAX:,} rows", span)
            return
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(names):
            message = f"{len(cells)} cells, where the first line has {len(names)}"
            diagnostics.error(CODE, message, span, helps=('a comma inside a cell wants "…"',))
            continue
        row = _hazard_row(dict.fromkeys(COLUMNS, "") | dict(zip(names, cells, strict=True)), span)
        if not _is_sound_row(row, diagnostics):
            continue
        before = first.setdefault((row.kind == "assumption", row.id), span)
        if before is not span:
            also = ((before, "the first one"),)
            diagnostics.error(CODE, f"the id `{row.id}` stands twice", span, also=also)
        yield row


def _csv_records(source: Source, diagnostics: Diagnostics) -> Iterator[tuple[list[str], Span]]:
    """Yields each record with its place; stops with a diagnostic at the first that is not CSV."""
    lines = list(StringIO(source.text, newline=""))
    ends = [0]
    for line in lines:
        ends.append(ends[-1] + len(line))
    reader = csv.reader(lines, strict=True)
    done = 0
    while True:
        try:
            cells = next(reader, None)
        except csv.Error as error:
            span = Span(source, ends[done], ends[min(done + 1, len(lines))])
            diagnostics.error(CODE, f"this is no CSV: {error}", _without_line_break(span))
            return
        if cells is None:
            return
        yield cells, _without_line_break(Span(source, ends[done], ends[reader.line_num]))
        done = reader.line_num


def _without_line_break(span: Span) -> Span:
    """The span without the line break at its end."""
    return Span(span.source, span.start, span.start + len(span.text.rstrip("\r\n")))


def _is_sound_head(names: list[str], span: Span, diagnostics: Diagnostics) -> bool:
    """Whether the first line has all needed columns, no unknown ones, and each only once."""
    before = diagnostics.error_count
    if len(names) == 1 and {";", "\t"} & set(names[0]):
        diagnostics.error(CODE, "columns are separated by commas", span)
        return False
    for name in dict.fromkeys(names):
        if name not in COLUMNS:
            helps = did_you_mean(name, COLUMNS) or (f"columns are {', '.join(COLUMNS)}",)
            diagnostics.error(CODE, f"there is no column `{name}`", span, helps=helps)
        elif names.count(name) > 1:
            diagnostics.error(CODE, f"the column `{name}` stands twice", span)
    if missing := [name for name in ("kind", "id") if name not in names]:
        message = f"the first line has no column `{missing[0]}`"
        diagnostics.error(CODE, message, span, helps=(f"columns are {', '.join(COLUMNS)}",))
    return diagnostics.error_count == before


def _hazard_row(cells: dict[str, str], span: Span) -> HazardRow:
    cells_by_name = {name: " ".join(cell.split()) for name, cell in cells.items()}
    targets = tuple(t for t in (x.strip() for x in cells_by_name["traces_to"].split(";")) if t)
    return HazardRow(
        cells_by_name["kind"],
        cells_by_name["id"],
        cells_by_name["text"],
        tuple(dict.fromkeys(targets)),
        owner=cells_by_name["owner"],
        validation=cells_by_name["validation"],
        evidence=cells_by_name["evidence"],
        span=span,
    )


def _is_sound_row(row: HazardRow, diagnostics: Diagnostics) -> bool:
    """Whether a row has a known kind, an id and the cells of its kind. Reports D021 otherwise."""
    before = diagnostics.error_count
    if row.kind not in KINDS:
        helps = did_you_mean(row.kind, KINDS) or (f"kinds are {', '.join(KINDS)}",)
        diagnostics.error(CODE, f"there is no kind `{row.kind}`", row.span, helps=helps)
        return False
    if not row.id:
        diagnostics.error(CODE, f"this {row.kind} has no id", row.span)
    if not row.id.isprintable():  # two ids that look alike would be two rows
        diagnostics.error(CODE, f"the id of this {row.kind} has letters that nobody sees", row.span)
    for name in NEEDED[row.kind]:
        if not getattr(row, name):
            diagnostics.error(CODE, f"{row.kind} `{row.id}` has no `{name}`", row.span)
    for name in FOREIGN[row.kind]:
        if getattr(row, name):
            problem = f"the column `{name}` is not for a row of kind `{row.kind}`"
            notes = ("an assumption has the words of the re-checker",) * (name == "text")
            diagnostics.error(CODE, problem, row.span, notes=notes)
    return diagnostics.error_count == before


SAFE, RETURNS, LAW = "safe", "P2b", "failsafe"
"""Properties of a module that a row may trace to, as `module.safe`."""
FLIGHTS = "G3"
ANSWERS = (
    ("owner", "no owner"),
    ("validation", "no way to validate it"),
    ("evidence", "no evidence"),
)


@dataclass(frozen=True)
class Tracing:
    """A file of hazards that fits a system, or None; `how`: by property, how it is shown."""

    file: HazardFile | None
    how: dict[str, str]

    @staticmethod
    def read_tracing(path: Path | None, flat: System) -> Tracing:
        """Reads a file of hazards. Raises D006, or D021 if a row names what the system lacks."""
        tracing = Tracing(None if path is None else read_hazards(path), _traceable_properties(flat))
        if tracing.file is not None:
            _require_traces(tracing.file.rows, tracing.how)
        return tracing

    def enter_traces(self, case: SafetyCase) -> None:
        """Adds traces, open items and owners of assumptions to a case. Raises SoterError D021."""
        rows = () if self.file is None else self.file.rows
        assumptions = [n for n in case.nodes if n.kind == "assumption"]
        stale = list(_owner_gaps(assumptions, [r for r in rows if r.kind == "assumption"]))
        properties = [self._traced_property(case, name) for name in self.how]
        status = {p.name: p.status for p in properties}
        traced = [r for r in rows if r.kind != "assumption"]
        items = tuple(_traced_items(traced, reached_properties(traced), status))
        for k, p in enumerate(properties):
            hazards = (i.id for i in items if i.kind == "hazard" and p.name in i.properties)
            properties[k] = replace(p, hazards=tuple(hazards))
        open_ = [
            *_open_items(items, status),
            *_untraced_properties(properties),
            *_unowned_assumptions(assumptions),
        ]
        path, sha256 = ("", "") if self.file is None else (self.file.path, self.file.sha256)
        case.traceability = Traceability(path, sha256, items, tuple(properties), (*open_, *stale))

    def _traced_property(self, case: SafetyCase, name: str) -> TracedProperty:
        how = self.how[name]
        goal = next((g for g in case.goals if g.property == name), None)
        if how == "flights":
            goal = next((g for g in case.goals if g.id == FLIGHTS), None)
        status = UNDEVELOPED if goal is None else case.status(goal)
        if how == "flights" and (goal is None or status == SUPPORTED):
            status = "not flown" if goal is None else "sampled"
        beside = name.endswith((f".{RETURNS}", f".{LAW}")) or (
            how == "exploration" and goal is None
        )
        return TracedProperty(name, how, status, goal.id if goal else "", wanted=not beside)


def _traceable_properties(flat: System) -> dict[str, str]:
    """The evidence ("proof", "exploration" or "flights") for each property a row may trace to."""
    names = [f"{m.name}.{name}" for name in (SAFE, RETURNS, LAW) for m in flat.modules]
    how = dict.fromkeys(names, "proof")
    how |= {n: "exploration" for n in flat.program.tests if "." not in n}
    of_system = (p for p in flat.properties if p.component is None)
    return how | {" ".join(f"{p.kind} {p.text}".split()): "flights" for p in of_system}


def _require_traces(rows: Sequence[HazardRow], how: dict[str, str]) -> None:
    """Raises SoterError D021 if a row traces to nothing, to a hazard, or in a circle."""
    diagnostics = Diagnostics()
    by_id = {r.id: r for r in rows if r.kind != "assumption"}
    requirements = {r.id: r for r in by_id.values() if r.kind == "requirement"}
    for r in by_id.values():
        if r.id in how:
            diagnostics.error(CODE, f"`{r.id}` is a property of the program", r.span)
        for target in r.traces_to:
            if target in how or target in requirements:
                continue
            diagnostics.error(
                CODE,
                f"`{r.id}` traces to `{target}`, which is no requirement and no property",
                r.span,
                notes=(f"`{target}` is a hazard",) if target in by_id else (),
                helps=did_you_mean(target, [*requirements, *how])
                or (f"properties are {', '.join(f'`{name}`' for name in list(how)[:12])}",),
            )
    _check_acyclic(by_id, diagnostics)
    diagnostics.raise_errors()


def _check_acyclic(by_id: Mapping[str, HazardRow], diagnostics: Diagnostics) -> None:
    graph = {r.id: [t for t in r.traces_to if t in by_id] for r in by_id.values()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        circle = list(reversed(error.args[1]))
        path = " -> ".join(f"`{name}`" for name in circle)
        diagnostics.error(CODE, f"these rows trace to themselves: {path}", by_id[circle[0]].span)


def reached_properties(rows: Sequence[HazardRow]) -> dict[str, list[str]]:
    """Maps each row's id to the properties it reaches, also through other rows, each once."""
    by_id = {r.id: r for r in rows}
    reached: dict[str, list[str]] = {}
    graph = {r.id: [t for t in r.traces_to if t in by_id] for r in rows}
    for id_ in TopologicalSorter(graph).static_order():
        each = (reached.get(t, [t]) for t in by_id[id_].traces_to)
        reached[id_] = list(dict.fromkeys(name for names in each for name in names))
    return reached


def _traced_items(
    rows: Sequence[HazardRow], reached: dict[str, list[str]], status: dict[str, str]
) -> Iterator[TracedItem]:
    """Yields the item of each row, supported if all its properties and requirements are."""
    by_id = {r.id: r for r in rows}
    words: dict[str, str] = {}
    for id_, names in reached.items():
        shown = {status[name] for name in names} - {"sampled", "not flown"}
        shown |= {words[t] for t in by_id[id_].traces_to if t in by_id}
        words[id_] = SUPPORTED if shown == {SUPPORTED} else "open"
    for r in rows:
        yield TracedItem(r.kind, r.id, r.text, r.traces_to, tuple(reached[r.id]), words[r.id])


# ---------------------------------------------------------------- what is open


def _open_items(items: Sequence[TracedItem], status: dict[str, str]) -> Iterator[OpenItem]:
    open_ = {i.id for i in items if i.status != SUPPORTED}
    for i in items:
        lacking = [name for name in i.properties if status[name] == UNDEVELOPED]
        if not i.properties:
            yield OpenItem(i.kind, i.id, "it leads to no property")
        elif lacking:
            yield OpenItem(i.kind, i.id, f"undeveloped: {', '.join(f'`{n}`' for n in lacking)}")
        elif below := [t for t in i.traces_to if t in open_]:
            yield OpenItem(i.kind, i.id, f"open: {', '.join(f'`{t}`' for t in below)}")
        elif i.status != SUPPORTED:
            yield OpenItem(i.kind, i.id, "only flights are behind it, which are a sample")


def _untraced_properties(properties: Sequence[TracedProperty]) -> Iterator[OpenItem]:
    for p in properties:
        if p.wanted and not p.hazards:
            yield OpenItem("property", p.name, "no hazard traces to it")


def _owner_gaps(assumptions: Sequence[CaseNode], rows: Sequence[HazardRow]) -> Iterator[OpenItem]:
    """Sets owners of assumptions; yields unmatched rows as open, or raises SoterError D021."""
    known = {n.key for n in assumptions}
    groups = {_is_test_assumption(key) for key in known}
    diagnostics = Diagnostics()
    for r in rows:
        for n in assumptions:
            if n.key == r.id:
                n.owner, n.validation, n.evidence = r.owner, r.validation, r.evidence
        if r.id in known:
            continue
        if _is_test_assumption(r.id) in groups:
            message = f"the case has no assumption `{r.id}`"
            same = [k for k in known if NUMBER.sub("", k or "") == NUMBER.sub("", r.id)]
            changed = (f"it is `{k}` now: does the evidence hold of this number?" for k in same)
            helps = (*changed,) or did_you_mean(r.id, known)
            helps = helps or ("`case.json` has the key of each assumption",)
            diagnostics.error(CODE, message, r.span, helps=helps)
        else:
            why = (
                "no test was explored"
                if _is_test_assumption(r.id)
                else "no certificate was accepted"
            )
            yield OpenItem("assumption", r.id, f"not known whether it is one: {why}")
    diagnostics.raise_errors()


def _is_test_assumption(key: str) -> bool:
    return key.startswith("test ")


def _unowned_assumptions(assumptions: Sequence[CaseNode]) -> Iterator[OpenItem]:
    for n in assumptions:
        if lacking := [words for name, words in ANSWERS if not getattr(n, name)]:
            yield OpenItem("assumption", n.id, ", ".join(lacking))
