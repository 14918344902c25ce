"""A diagnostic as data: code, labelled spans of a source file, notes, helps, edits; system errors.

Purpose: every room reports problems with these types, and nothing prints. `Source` turns character
offsets into lines and columns for people; `Span` is the one immutable type for positions, which
tokens, trees, Core and diagnostics share. A `Fix` says what to write where, for an editor to offer
and a test to try. `reason` puts the system's refusal of a file or process into words, for all who
report one.
Non-goals: reading files (`language/load/loader.py`), rendering (`render.py`), the texts of the
explain pages (`pages/`); which fix a problem has, and which file it was, whoever reports it says.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
from itertools import islice
from typing import TYPE_CHECKING

from soter.diagnostics.similar_names import likely

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from soter.diagnostics.codes import Code


@dataclass(eq=False)
class Source:
    """Name and text of one file; `name` is the path as the user gave it."""

    name: str
    text: str = field(repr=False)
    _starts: list[int] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        self._starts = [0, *(m.end() for m in re.finditer("\n", self.text))]

    def line_of(self, offset: int) -> int:
        """Line number, from 1, of a character offset."""
        return bisect_right(self._starts, offset)

    def column_of(self, offset: int) -> int:
        """Column, from 1, of a character offset."""
        return offset - self._starts[self.line_of(offset) - 1] + 1

    def line(self, number: int) -> str:
        """Text of line `number` (from 1) without its line break."""
        start = self._starts[number - 1]
        end = self.text.find("\n", start)
        return self.text[start : end if end >= 0 else len(self.text)].rstrip("\r")


@dataclass(frozen=True, slots=True)
class Span:
    """A half-open range of character offsets `[start, end)` in one source file."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        """Line of the first character, from 1."""
        return self.source.line_of(self.start)

    @property
    def column(self) -> int:
        """Column of the first character, from 1, in characters."""
        return self.source.column_of(self.start)

    @property
    def text(self) -> str:
        """The text the span covers."""
        return self.source.text[self.start : self.end]

    def to(self, other: Span) -> Span:
        """The span from the start of this one to the end of `other`."""
        return Span(self.source, self.start, max(self.end, other.end))


@dataclass(frozen=True)
class Edit:
    """`text` takes the place of what `span` covers; an empty span is an insertion."""

    span: Span
    text: str


@dataclass(frozen=True)
class Fix:
    """Edits that belong together, of one file or several; `title` is the help line they carry out.

    Edits do not overlap. Applied together they remove the problem that offers them.
    """

    title: str
    edits: tuple[Edit, ...]


Help = str | Fix
"""What stands behind `help:`: a sentence, or an edit whose title is the sentence."""


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


def texts(helps: Iterable[Help]) -> tuple[str, ...]:
    """The help lines as texts: an edit is shown as its title."""
    return tuple(h.title if isinstance(h, Fix) else h for h in helps)


def fixes(helps: Iterable[Help]) -> tuple[Fix, ...]:
    """The edits among the help lines."""
    return tuple(h for h in helps if isinstance(h, Fix))


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


KEPT_MAX = 500
"""How many problems are kept; most of a file with more have one cause."""
NAMES_COMPARED = 30_000
"""How many names are compared for all suggestions: nobody reads them beyond a few mistakes."""


class Severity(Enum):
    """How bad it is: errors stop the tool, warnings do not."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True)
class Label:
    """A span and what is to be said about it; the text may be empty."""

    span: Span
    text: str = ""


@dataclass(frozen=True)
class Diagnostic:
    """One problem: `message` is lower case, names in backticks, no full stop.

    `primary` is where the problem stands, None for problems of no file (a missing file, a
    command-line value). `notes` explain; only `helps` suggest. A help that is an edit is in
    `fixes`, too, and its title in `helps`.
    """

    code: Code
    message: str
    primary: Label | None = None
    secondary: tuple[Label, ...] = ()
    notes: tuple[str, ...] = ()
    helps: tuple[str, ...] = ()
    severity: Severity = Severity.ERROR
    fixes: tuple[Fix, ...] = ()


def made(
    code: Code,
    message: str,
    primary: Label | None,
    secondary: tuple[Label, ...] = (),
    notes: tuple[str, ...] = (),
    helps: tuple[Help, ...] = (),
    severity: Severity = Severity.ERROR,
) -> Diagnostic:
    """A diagnostic whose helps may be edits."""
    return Diagnostic(
        *(code, message, primary, secondary, notes, texts(helps), severity, fixes(helps))
    )


class Diagnostics:
    """A growing list of diagnostics, in the order they were found, without repetitions.

    `tell` is called with the step that begins, where steps may take seconds.
    """

    def __init__(self, tell: Callable[[str], None] | None = None) -> None:
        self.tell: Callable[[str], None] = tell or (lambda _: None)
        self._items: list[Diagnostic] = []
        self._seen: set[tuple[str, str, int, str]] = set()
        self._errors = 0
        self._names_left = NAMES_COMPARED

    def add(self, diagnostic: Diagnostic) -> None:
        """Keep `diagnostic` unless one of its code, place and message is there already."""
        span = diagnostic.primary.span if diagnostic.primary else None
        key = (
            diagnostic.code,
            span.source.name if span else "",
            span.start if span else -1,
            diagnostic.message,
        )
        if key in self._seen:
            return
        self._errors += diagnostic.severity is Severity.ERROR
        if len(self._items) > KEPT_MAX:
            return
        if len(self._items) == KEPT_MAX:
            self._items.append(
                Diagnostic("S021", f"{KEPT_MAX} problems are enough: the rest is not shown")
            )
            return
        self._seen.add(key)
        self._items.append(diagnostic)

    @contextmanager
    def trial(self) -> Iterator[Callable[[], bool]]:
        """Forget what the block reports; afterwards the function says if it had no error."""
        items, seen, errors, names = (
            len(self._items),
            set(self._seen),
            self._errors,
            self._names_left,
        )
        sound = True
        try:
            yield lambda: sound
        finally:
            sound = self._errors == errors
            del self._items[items:]
            self._seen, self._errors, self._names_left = seen, errors, names

    def may_look_at(self, names: int) -> bool:
        """Count so many more names to compare; whether that is still worth it, for a help."""
        self._names_left -= names
        return self._names_left >= 0 and len(self._items) <= KEPT_MAX

    def did_you_mean(
        self, name: str, candidates: Iterable[str], span: Span | None = None
    ) -> tuple[Help, ...]:
        """A help line naming the closest candidate, if any is close and it will be read.

        With the `span` of the name it is an edit.
        """
        if not self.may_look_at(0):
            return ()
        known = list(islice(candidates, self._names_left + 1))
        near = likely(name, known) if self.may_look_at(len(known)) else None
        if near is None:
            return ()
        title = f"did you mean `{near}`?"
        return (title,) if span is None else (replace(span, near, title),)

    def error(
        self,
        code: Code,
        message: str,
        span: Span | None = None,
        label: str = "",
        *,
        also: tuple[tuple[Span, str], ...] = (),
        notes: tuple[str, ...] = (),
        helps: tuple[Help, ...] = (),
    ) -> None:
        """Report an error; `also` adds labelled secondary spans."""
        self._report(
            Severity.ERROR, code, message, span, label, also=also, notes=notes, helps=helps
        )

    def warning(
        self,
        code: Code,
        message: str,
        span: Span | None = None,
        label: str = "",
        *,
        also: tuple[tuple[Span, str], ...] = (),
        notes: tuple[str, ...] = (),
        helps: tuple[Help, ...] = (),
    ) -> None:
        """Report a warning; `also` adds labelled secondary spans."""
        self._report(
            Severity.WARNING, code, message, span, label, also=also, notes=notes, helps=helps
        )

    def _report(
        self,
        severity: Severity,
        code: Code,
        message: str,
        span: Span | None,
        label: str,
        *,
        also: tuple[tuple[Span, str], ...],
        notes: tuple[str, ...],
        helps: tuple[Help, ...],
    ) -> None:
        primary = Label(span, label) if span is not None else None
        secondary = tuple(Label(s, t) for s, t in also)
        self.add(made(code, message, primary, secondary, notes, helps, severity))

    @property
    def items(self) -> tuple[Diagnostic, ...]:
        """All diagnostics so far, in the order they were found."""
        return tuple(self._items)

    @property
    def has_errors(self) -> bool:
        """Whether any of them is an error."""
        return self._errors > 0

    @property
    def error_count(self) -> int:
        """How many of them are errors."""
        return self._errors

    def raise_errors(self) -> None:
        """Raises SoterError with every diagnostic if at least one is an error."""
        if self._errors:
            raise SoterError(self.items)

    def __len__(self) -> int:
        return len(self._items)


class SoterError(Exception):
    """A user's mistake found by any room; carries diagnostics, never shown as a traceback."""

    def __init__(self, diagnostics: tuple[Diagnostic, ...] | SoterError) -> None:
        """`diagnostics`, or another `SoterError` whose diagnostics this one takes over."""
        self.diagnostics: tuple[Diagnostic, ...] = (
            diagnostics.diagnostics  # gymnasium.vector: `raise type(error)(error)`
            if isinstance(diagnostics, SoterError)
            else diagnostics
        )
        super().__init__("; ".join(f"[{d.code}] {d.message}" for d in self.diagnostics))
        self.__notes__ = [f"help: {h}" for d in self.diagnostics for h in d.helps]
        """Lines that Python adds to a traceback."""

    def __reduce__(self) -> tuple[type[SoterError], tuple[tuple[Diagnostic, ...]]]:
        """Pickle the diagnostics, since `args` hold their text alone."""
        return type(self), (self.diagnostics,)


def mistake(code: Code, message: str, *helps: str, notes: tuple[str, ...] = ()) -> SoterError:
    """An error of one diagnostic that stands in no program; empty `helps` are left out."""
    return SoterError((Diagnostic(code, message, notes=notes, helps=tuple(filter(None, helps))),))


def reason(error: OSError) -> str:
    """Why the system refused, in lower case, without error number and path."""
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]


CONTROLS = re.compile("[\0-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff]")
COLOURS = re.compile("(\x1b\\[(?:0|1|2|34|1;3[1-4])m)")


def legible(text: str, *, color: bool = False, words: Iterable[str] = ()) -> str:
    """What leaves, whoever wrote a name in it: nothing acts upon a terminal, or commands GitHub.

    `color`: but for our own colours; `words`: of the command line, of which no line may be made.
    """
    for part in {w[max(0, i - 4) : i + 5] for w in words for i, c in enumerate(w) if c == "\n"}:
        text = text.replace(part, part.replace("\n", "\r")) if len(part.strip()) > 1 else text
    text = re.sub(r"(?m)^(\s*):(?=:)|##(?=\[)", "\\1: ", text)
    parts = COLOURS.split(text) if color else [text]
    return "".join(p if k % 2 else CONTROLS.sub("\ufffd", p) for k, p in enumerate(parts))


def utf8_text(name: str) -> str:
    r"""A file name of the system as UTF-8 text: bytes that are none as `\xe9`."""
    if name.isascii():
        return name
    return "".join(c if not "\ud800" <= c <= "\udfff" else f"\\x{ord(c) & 0xFF:02x}" for c in name)
