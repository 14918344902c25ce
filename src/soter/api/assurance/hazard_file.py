"""Hazards, requirements, and who answers for assumptions: a CSV file that people keep.

Purpose: `read_hazards`: its rows, or every line that is not as it should be (D021).
Non-goals: what the rows are about (`hazard_traceability.py`); StrictDoc's documents: their only
reader is that whole tool, whose export to a spreadsheet this reads.
"""

from __future__ import annotations

import csv
import hashlib
from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, SoterError
from soter.diagnostics.os_error_text import reason
from soter.diagnostics.similar_names import did_you_mean
from soter.diagnostics.source import Source
from soter.diagnostics.span import Span
from soter.language.load.bounded_read import read_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from soter.diagnostics.codes import Code

CODE: Code = "D021"
KINDS = ("hazard", "requirement", "assumption")
COLUMNS = ("kind", "id", "text", "traces_to", "owner", "validation", "evidence")
NEEDED = {"hazard": ("text",), "requirement": ("text",), "assumption": ()}
FOREIGN = {
    "hazard": ("owner", "validation", "evidence"),
    "requirement": ("owner", "validation", "evidence"),
    "assumption": ("text", "traces_to"),
}
"""Cells that a row of a kind has to have, and those that it has to leave empty."""
ROWS_MAX = 100_000


@dataclass(frozen=True)
class HazardRow:
    """A row; `traces_to`: ids of requirements and names of properties. `span`: all of its text.

    The id of an assumption is its key, as `case.json` has it.
    """

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
    """The rows of a file, and its SHA-256."""

    path: str
    sha256: str
    rows: tuple[HazardRow, ...]


def read_hazards(path: Path) -> HazardFile:
    """Read a file; SoterError D006 where it cannot be read, D021 for what stands in it."""
    try:
        raw = read_bytes(path)
    except OSError as error:
        raise SoterError((Diagnostic("D006", f"cannot read `{path}`: {reason(error)}"),)) from error
    diagnostics = Diagnostics()
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        message = f"`{path}` is not UTF-8: byte {error.start + 1}"
        raise SoterError((Diagnostic(CODE, message),)) from error
    rows = list(_rows(Source(str(path), text), diagnostics))
    if diagnostics.has_errors:
        raise SoterError(diagnostics.items)
    return HazardFile(str(path), hashlib.sha256(raw).hexdigest(), tuple(rows))


def _rows(source: Source, diagnostics: Diagnostics) -> Iterator[HazardRow]:
    records = _records(source, diagnostics)
    head, where = next(records, ([], Span(source, 0, 0)))
    names = [name.strip() for name in head]
    if not _is_head(names, where, diagnostics):
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
        row = _row(dict.fromkeys(COLUMNS, "") | dict(zip(names, cells, strict=True)), span)
        if not _is_sound(row, diagnostics):
            continue
        before = first.setdefault((row.kind == "assumption", row.id), span)
        if before is not span:
            also = ((before, "the first one"),)
            diagnostics.error(CODE, f"the id `{row.id}` stands twice", span, also=also)
        yield row


def _records(source: Source, diagnostics: Diagnostics) -> Iterator[tuple[list[str], Span]]:
    """Each record with its place; one that is no CSV is the last."""
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
            diagnostics.error(CODE, f"this is no CSV: {error}", _trimmed(span))
            return
        if cells is None:
            return
        yield cells, _trimmed(Span(source, ends[done], ends[reader.line_num]))
        done = reader.line_num


def _trimmed(span: Span) -> Span:
    """Without the end of its last line."""
    return Span(span.source, span.start, span.start + len(span.text.rstrip("\r\n")))


def _is_head(names: list[str], span: Span, diagnostics: Diagnostics) -> bool:
    """Whether the first line has the columns that it may and has to have, each once."""
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
    missing = [name for name in ("kind", "id") if name not in names]
    if missing:
        message = f"the first line has no column `{missing[0]}`"
        diagnostics.error(CODE, message, span, helps=(f"columns are {', '.join(COLUMNS)}",))
    return diagnostics.error_count == before


def _row(cells: dict[str, str], span: Span) -> HazardRow:
    said = {name: " ".join(cell.split()) for name, cell in cells.items()}
    targets = tuple(t for t in (x.strip() for x in said["traces_to"].split(";")) if t)
    return HazardRow(
        said["kind"],
        said["id"],
        said["text"],
        tuple(dict.fromkeys(targets)),
        owner=said["owner"],
        validation=said["validation"],
        evidence=said["evidence"],
        span=span,
    )


def _is_sound(row: HazardRow, diagnostics: Diagnostics) -> bool:
    """Whether a row is one of a kind, with an id, and says what its kind says."""
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
            what = f"the column `{name}` is not for a row of kind `{row.kind}`"
            notes = ("an assumption has the words of the re-checker",) * (name == "text")
            diagnostics.error(CODE, what, row.span, notes=notes)
    return diagnostics.error_count == before
