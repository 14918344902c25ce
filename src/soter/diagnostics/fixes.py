"""Builds a `Fix` from spans of a file.

Purpose: `replace`, `insert`, `remove` and the like say what to write where; `apply_fix` gives the
texts after a fix, for an editor to show and a test to try.
Non-goals: which fix a problem has, which whoever reports it says; writing files.
"""

from __future__ import annotations

from soter.diagnostics.diagnostic import Edit, Fix, Source, Span


def replace(span: Span, text: str, title: str | None = None) -> Fix:
    """The fix that writes `text` in place of a span; `title` is "write ..." if None."""
    return Fix(title or f"write `{' '.join(text.split())}`", (Edit(span, text),))


def insert(span: Span, text: str, title: str | None = None) -> Fix:
    """The fix that writes `text` in front of a span."""
    return replace(Span(span.source, span.start, span.start), text, title)


def append(span: Span, text: str, title: str | None = None) -> Fix:
    """The fix that writes `text` right behind a span."""
    return replace(Span(span.source, span.end, span.end), text, title)


def remove(span: Span, title: str) -> Fix:
    """The fix that deletes a span, or its whole line if the line has nothing else."""
    return Fix(title, (Edit(whole_lines(span), ""),))


def remove_from_list(span: Span, title: str) -> Fix:
    """The fix that deletes a name from a comma-separated list; the whole item if it is alone."""
    text, start, end = span.source.text, span.start, span.end
    before, after = text[:start].rstrip(), text[end:].lstrip()
    if before.endswith(","):
        return Fix(title, (Edit(Span(span.source, len(before) - 1, end), ""),))
    if after.startswith(","):
        rest = after[1:].lstrip(" \t")
        return Fix(title, (Edit(Span(span.source, start, len(text) - len(rest)), ""),))
    word = len(before) - len(before.split()[-1]) if before.split() else start
    stop = len(text) - len(after) + 1 if after.startswith(";") else end
    return remove(Span(span.source, word, stop), title)


def whole_lines(span: Span) -> Span:
    """The span; extended by its blanks and line break if its lines have nothing else."""
    text = span.source.text
    start, end = span.start, span.end
    while start and text[start - 1] in " \t":
        start -= 1
    while end < len(text) and text[end] in " \t\r":
        end += 1
    if (start and text[start - 1] != "\n") or (end < len(text) and text[end] != "\n"):
        return span
    return Span(span.source, start, min(end + 1, len(text)))


def exchange(one: Span, other: Span, title: str) -> Fix:
    """The fix that exchanges the texts of two spans."""
    return Fix(title, (Edit(one, other.text), Edit(other, one.text)))


def exchange_bounds(low: Span, high: Span) -> Fix:
    """The fix that exchanges the two bounds of an interval."""
    return exchange(low, high, f"write `[{high.text}, {low.text}]`")


def apply_fix(fix: Fix) -> dict[Source, str]:
    """By source: its text after a fix; changes no file. ValueError if two edits overlap."""
    by_source: dict[Source, list[Edit]] = {}
    for edit in fix.edits:
        by_source.setdefault(edit.span.source, []).append(edit)
    return {source: _edit_text(source.text, edits) for source, edits in by_source.items()}


def _edit_text(text: str, edits: list[Edit]) -> str:
    parts: list[str] = []
    at = 0
    for edit in sorted(edits, key=lambda e: (e.span.start, e.span.end)):
        if edit.span.start < at:
            raise ValueError("two edits of a fix overlap")
        parts += [text[at : edit.span.start], edit.text]
        at = edit.span.end
    return "".join([*parts, text[at:]])
