"""Builds a `Fix` from spans of a file.

Purpose: `replace`, `insert`, `remove` and the like say what to write where; `applied` gives the
texts after a fix, for an editor to show and a test to try.
Non-goals: which fix a problem has, which whoever reports it says; writing files.
"""

from __future__ import annotations

from soter.diagnostics.diagnostic import Edit, Fix, Source, Span


def replace(span: Span, text: str, title: str | None = None) -> Fix:
    """Write `text` instead of what `span` covers; the title says so unless another one is given."""
    return Fix(title or f"write `{' '.join(text.split())}`", (Edit(span, text),))


def insert(span: Span, text: str, title: str | None = None) -> Fix:
    """Write `text` in front of what `span` covers."""
    return replace(Span(span.source, span.start, span.start), text, title)


def append(span: Span, text: str, title: str | None = None) -> Fix:
    """Write `text` right behind what `span` covers."""
    return replace(Span(span.source, span.end, span.end), text, title)


def remove(span: Span, title: str) -> Fix:
    """Leave out what `span` covers, and its line with it where nothing else stands there."""
    return Fix(title, (Edit(whole_lines(span), ""),))


def out_of_list(span: Span, title: str) -> Fix:
    """Leave one name out of a list between commas, the whole item where it is the only one."""
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
    """The span with the blanks around it and its line break, where it is all its lines hold."""
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
    """Exchange the texts of two spans."""
    return Fix(title, (Edit(one, other.text), Edit(other, one.text)))


def the_other_way(low: Span, high: Span) -> Fix:
    """Exchange the bounds of an interval, which stand the wrong way round."""
    return exchange(low, high, f"write `[{high.text}, {low.text}]`")


def applied(fix: Fix) -> dict[Source, str]:
    """The texts of the files a fix touches, after it; nothing is written.

    ValueError where two of its edits overlap.
    """
    by_source: dict[Source, list[Edit]] = {}
    for edit in fix.edits:
        by_source.setdefault(edit.span.source, []).append(edit)
    return {source: _edited(source.text, edits) for source, edits in by_source.items()}


def _edited(text: str, edits: list[Edit]) -> str:
    parts: list[str] = []
    at = 0
    for edit in sorted(edits, key=lambda e: (e.span.start, e.span.end)):
        if edit.span.start < at:
            raise ValueError("two edits of a fix overlap")
        parts += [text[at : edit.span.start], edit.text]
        at = edit.span.end
    return "".join([*parts, text[at:]])
