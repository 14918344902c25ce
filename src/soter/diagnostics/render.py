"""Diagnostics as text for a terminal, as data for `--json`, and in tracebacks.

Purpose: show where a problem stands and what is to be said about it, in the manner of rustc: a
header, the source lines in order with carets under the primary span and dashes under the others,
then notes and helps. Whatever the source contains, the output is printable, aligned and short.
The traceback of a script or notebook that ends by `SoterError` has the user's own lines and the
diagnostics, not lines of Soter; `SOTER_TRACEBACK=1` shows everything.
Non-goals: deciding where it is written, and whether in colour; other exceptions.
"""

from __future__ import annotations

import traceback
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostic, Label, Severity, SoterError, Source, Span

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


_LINE_MAX = 100  # characters of a source line that are shown
_MARGIN = 20  # characters kept before a span in a shortened line
_TAB = 4
_REPLACEMENT = "\ufffd"

_RESET = "\x1b[0m"
_BOLD = "\x1b[1m"
_RED = "\x1b[1;31m"
_YELLOW = "\x1b[1;33m"
_BLUE = "\x1b[1;34m"


@dataclass(frozen=True)
class _Mark:
    """A label on one line, in the character columns `[start, end)`, counted from 0."""

    start: int
    end: int
    text: str
    primary: bool


class _Paint:
    """Puts text in colour, or leaves it unchanged."""

    def __init__(self, severity: Severity, *, color: bool) -> None:
        self._color = color
        self.severity = _RED if severity is Severity.ERROR else _YELLOW

    def __call__(self, style: str, text: str) -> str:
        return f"{style}{text}{_RESET}" if self._color and text else text


def render(diagnostic: Diagnostic, *, color: bool = False) -> str:
    """A diagnostic as lines of text; the last line has no line break."""
    paint = _Paint(diagnostic.severity, color=color)
    head = f"{diagnostic.severity.value}[{diagnostic.code}]"
    lines = [paint(paint.severity, head) + paint(_BOLD, f": {safe(diagnostic.message)}")]
    width = _gutter_width(diagnostic)
    if diagnostic.primary is not None:
        lines += _sections(diagnostic, width, paint)
    for kind, texts in (("note", diagnostic.notes), ("help", diagnostic.helps)):
        for text in texts:
            first, *rest = text.split("\n")
            sign = paint(_BLUE, " " * width + " =")
            lines.append(f"{sign} {paint(_BOLD, kind)}: {safe(first)}")
            lines += [" " * (width + 9) + safe(more) for more in rest]
    return "\n".join(lines)


def render_all(diagnostics: Iterable[Diagnostic], *, color: bool = False) -> str:
    """All diagnostics, a blank line between them, and their counts; "" if there are none."""
    items = list(diagnostics)
    if not items:
        return ""
    shown = [render(item, color=color) for item in items]
    return "\n\n".join([*shown, summary(items)])


def summary(diagnostics: Sequence[Diagnostic]) -> str:
    """The number of diagnostics of each severity: "2 errors, 1 warning"."""
    counts = [
        (sum(d.severity is severity for d in diagnostics), severity.value) for severity in Severity
    ]
    return ", ".join(f"{n} {word}{'s' if n > 1 else ''}" for n, word in counts if n)


def to_json(diagnostic: Diagnostic) -> dict[str, object]:
    """A diagnostic as plain data; its places are null if it is in no file."""
    primary = diagnostic.primary
    labels = [*([primary] if primary else []), *diagnostic.secondary]
    return {
        "code": diagnostic.code,
        "severity": diagnostic.severity.value,
        "message": diagnostic.message,
        **_place(primary.span if primary else None),
        "notes": list(diagnostic.notes),
        "helps": list(diagnostic.helps),
        "fixes": [
            {"title": fix.title, "edits": [{**_place(e.span), "text": e.text} for e in fix.edits]}
            for fix in diagnostic.fixes
        ],
        "labels": [
            {**_place(label.span), "text": label.text, "primary": label is primary}
            for label in labels
        ],
    }


def safe(text: str) -> str:
    """The text on one line, with a replacement for each character that is not printable."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else _REPLACEMENT for c in text)


# ---------------------------------------------------------------- places


def _place(span: Span | None) -> dict[str, object]:
    if span is None:
        return {"file": None, "line": None, "column": None, "end_line": None, "end_column": None}
    return {
        "file": span.source.name,
        "line": span.line,
        "column": span.column,
        "end_line": span.source.line_of(span.end),
        "end_column": span.source.column_of(span.end),
    }


def _all_labels(diagnostic: Diagnostic) -> list[tuple[Label, bool]]:
    first = [(diagnostic.primary, True)] if diagnostic.primary else []
    return [*first, *((label, False) for label in diagnostic.secondary)]


def _gutter_width(diagnostic: Diagnostic) -> int:
    """The digits of the largest line number, at least two, so that notes have a gutter."""
    numbers = [len(str(label.span.line)) for label, _ in _all_labels(diagnostic)]
    return max([2, *numbers])


# ---------------------------------------------------------------- source lines


def _sections(diagnostic: Diagnostic, width: int, paint: _Paint) -> list[str]:
    """The lines of a section for each file; the section with the primary span is first."""
    by_source: dict[int, tuple[Source, list[tuple[Label, bool]]]] = {}
    for label, primary in _all_labels(diagnostic):
        source = label.span.source
        by_source.setdefault(id(source), (source, []))[1].append((label, primary))
    lines: list[str] = []
    for source, labels in by_source.values():
        span = labels[0][0].span
        arrow = "-->" if not lines else ":::"
        where = f"{safe(source.name)}:{span.line}:{span.column}"
        lines.append(" " * width + paint(_BLUE, arrow) + f" {where}")
        lines += _source_lines(source, labels, width, paint)
    return lines


def _source_lines(
    source: Source, labels: list[tuple[Label, bool]], width: int, paint: _Paint
) -> list[str]:
    marks: dict[int, list[_Mark]] = {}
    for label, primary in labels:
        span, start = label.span, label.span.column - 1
        mark = _Mark(start, start + span.end - span.start, safe(label.text), primary)
        marks.setdefault(span.line, []).append(mark)
    lines: list[str] = []
    previous = 0
    for number in sorted(marks):
        if previous and number > previous + 1:
            lines.append(paint(_BLUE, "..."))
        previous = number
        text = source.line(number)
        for cluster in _mark_groups(marks[number], len(text)):
            lines += _marked_line(text, number, cluster, width, paint)
    return lines


def _mark_groups(marks: list[_Mark], length: int) -> list[list[_Mark]]:
    """Groups of marks that can be shown together; more than one group only on a long line."""
    ordered = sorted(marks, key=lambda m: (m.start, m.end))
    if length <= _LINE_MAX:
        return [ordered]
    clusters: list[list[_Mark]] = []
    for mark in ordered:
        if clusters and mark.end - clusters[-1][0].start <= _LINE_MAX - _MARGIN:
            clusters[-1].append(mark)
        else:
            clusters.append([mark])
    return clusters


def _marked_line(
    text: str, number: int, marks: list[_Mark], width: int, paint: _Paint
) -> list[str]:
    low, high = 0, len(text)
    if high > _LINE_MAX:
        low = max(0, min(marks[0].start - _MARGIN, high - _LINE_MAX))
        high = min(high, low + _LINE_MAX)
    before = "..." if low else ""
    after = "..." if high < len(text) else ""
    shown, columns = _printable_line(text[low:high])
    shift = len(before)

    def column(character: int) -> int:
        """The screen column of a character of the line; also of the position after the last one."""
        return shift + columns[min(max(character, low), high) - low]

    placed = []
    for mark in marks:
        start = column(mark.start)
        placed.append((start, max(column(mark.end), start + 1), mark))
    gutter = paint(_BLUE, f"{number:>{width}} |")
    margin = paint(_BLUE, " " * width + " |")
    lines = [f"{gutter} {before}{shown}{after}".rstrip()]
    for row in _rows_of_marks(placed):
        lines += [f"{margin} {line}" for line in _lines_of_row(row, paint)]
    return lines


def _printable_line(text: str) -> tuple[str, list[int]]:
    """The line in printable form, and the screen column where each character begins."""
    parts: list[str] = []
    columns: list[int] = []
    at = 0
    for char in text:
        columns.append(at)
        if char == "\t":
            fill = _TAB - at % _TAB
            parts.append(" " * fill)
            at += fill
        else:
            parts.append(safe(char))
            at += _char_width(parts[-1])
    columns.append(at)
    return "".join(parts), columns


def _char_width(char: str) -> int:
    if unicodedata.combining(char):
        return 0
    return 2 if unicodedata.east_asian_width(char) in "WF" else 1


# ---------------------------------------------------------------- marks under a line

_Placed = tuple[int, int, _Mark]


def _rows_of_marks(placed: list[_Placed]) -> list[list[_Placed]]:
    """Rows of marks; marks in a row do not overlap, and the first row has the primary mark."""
    rows: list[list[_Placed]] = []
    for item in sorted(placed, key=lambda p: (not p[2].primary, p[0])):
        for row in rows:
            if all(item[1] < other[0] or item[0] > other[1] for other in row):
                row.append(item)
                break
        else:
            rows.append([item])
    return [sorted(row, key=lambda p: p[0]) for row in rows]


def _lines_of_row(row: list[_Placed], paint: _Paint) -> list[str]:
    """A line of carets and dashes, then a line for each text that does not fit after them."""
    line, at = "", 0
    for start, end, mark in row:
        sign = "^" if mark.primary else "-"
        line += " " * (start - at) + paint(_mark_style(mark, paint), sign * (end - start))
        at = end
    last = row[-1][2]
    if last.text:
        line += " " + paint(_mark_style(last, paint), last.text)
    lines = [line]
    waiting = [item for item in row[:-1] if item[2].text]
    while waiting:
        start, _, mark = waiting.pop()
        line, at = "", 0
        for bar, _, other in waiting:
            line += " " * (bar - at) + paint(_mark_style(other, paint), "|")
            at = bar + 1
        lines.append(line + " " * (start - at) + paint(_mark_style(mark, paint), mark.text))
    return lines


def _mark_style(mark: _Mark, paint: _Paint) -> str:
    return paint.severity if mark.primary else _BLUE


HERE = str(Path(__file__).resolve().parents[1])


def traceback_lines(error: SoterError) -> list[str]:
    """The calls in a traceback that are outside of Soter, followed by the diagnostics."""
    frames = [
        f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith(HERE)
    ]
    lines = [f'  File "{f.filename}", line {f.lineno}: {f.line}'.rstrip(": ") for f in frames]
    return [*lines, render_all(error.diagnostics)]
