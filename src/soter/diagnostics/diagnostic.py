"""A diagnostic as data, of which labelled spans of a source file are part.

Purpose: every room reports problems with these types, and nothing prints. `Source` turns character
offsets into lines and columns for people; `Span` is the one immutable type for positions, which
tokens, trees, Core and diagnostics share. A `Fix` says what to write where, for an editor to offer
and a test to try.
Non-goals: making fixes (`fixes.py`), reading files (`language/load/loader.py`), rendering
(`render.py`), the texts of the explain pages (`pages/`).
"""

from __future__ import annotations

import re
from bisect import bisect_right
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
from itertools import islice
from typing import TYPE_CHECKING

from soter.diagnostics.similar_names import likely_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from soter.diagnostics.codes import Code


@dataclass(eq=False)
class Source:
    """The name and the text of one file; `name` is the path as the user gave it."""

    name: str
    text: str = field(repr=False)
    _starts: list[int] = field(default_factory=list, repr=False)

    def __post_init__(self) -> None:
        self._starts = [0, *(m.end() for m in re.finditer("\n", self.text))]

    def line_of(self, offset: int) -> int:
        """The line, from 1, of a character offset."""
        return bisect_right(self._starts, offset)

    def column_of(self, offset: int) -> int:
        """The column, from 1, of a character offset."""
        return offset - self._starts[self.line_of(offset) - 1] + 1

    def line(self, number: int) -> str:
        """The text of line `number`, from 1, without its line break."""
        start = self._starts[number - 1]
        end = self.text.find("\n", start)
        return self.text[start : end if end >= 0 else len(self.text)].rstrip("\r")


@dataclass(frozen=True, slots=True)
class Span:
    """A range of character offsets in a source file: from `start` to before `end`."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        """The line of the first character, from 1."""
        return self.source.line_of(self.start)

    @property
    def column(self) -> int:
        """The column of the first character, from 1, in characters."""
        return self.source.column_of(self.start)

    @property
    def text(self) -> str:
        """The text that the span covers."""
        return self.source.text[self.start : self.end]

    @property
    def text_on_one_line(self) -> str:
        """The text that the span covers, with one space for each run of blanks and line ends."""
        return " ".join(self.text.split())

    def to(self, other: Span) -> Span:
        """The span from the start of this span to the end of `other`."""
        return Span(self.source, self.start, max(self.end, other.end))


@dataclass(frozen=True)
class Edit:
    """Replaces the text of `span` with `text`; an empty span inserts it."""

    span: Span
    text: str


@dataclass(frozen=True)
class Fix:
    """Edits that belong together, in one file or several; `title` is the help line for them.

    The edits do not overlap. All of them together remove the problem that offers them.
    """

    title: str
    edits: tuple[Edit, ...]


Help = str | Fix
"""What stands behind `help:`: a sentence, or an edit whose title is the sentence."""


def help_texts(helps: Iterable[Help]) -> tuple[str, ...]:
    """The help lines as texts; the text of a fix is its title."""
    return tuple(h.title if isinstance(h, Fix) else h for h in helps)


def help_fixes(helps: Iterable[Help]) -> tuple[Fix, ...]:
    """The fixes among the help lines."""
    return tuple(h for h in helps if isinstance(h, Fix))


KEPT_MAX = 500
"""How many problems are kept; most of a file with more have one cause."""
NAMES_COMPARED = 30_000
"""How many names are compared for all suggestions: nobody reads them beyond a few mistakes."""


class Severity(Enum):
    """How bad a problem is: errors stop the tool, warnings do not."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True)
class Label:
    """A span, and a text about it, which may be ""."""

    span: Span
    text: str = ""


@dataclass(frozen=True)
class Diagnostic:
    """One problem; `message` is lower case, has names in backticks, and no full stop.

    `primary` is the place of the problem; None if it is in no file (a missing file, a command-line
    value). `notes` explain, and only `helps` suggest. A help that is an edit is also in `fixes`,
    and its title in `helps`.
    """

    code: Code
    message: str
    primary: Label | None = None
    secondary: tuple[Label, ...] = ()
    notes: tuple[str, ...] = ()
    helps: tuple[str, ...] = ()
    severity: Severity = Severity.ERROR
    fixes: tuple[Fix, ...] = ()


def make_diagnostic(
    code: Code,
    message: str,
    primary: Label | None,
    secondary: tuple[Label, ...] = (),
    notes: tuple[str, ...] = (),
    helps: tuple[Help, ...] = (),
    severity: Severity = Severity.ERROR,
) -> Diagnostic:
    """A diagnostic; a help that is a fix is also in its `fixes`."""
    return Diagnostic(
        *(code, message, primary, secondary, notes, help_texts(helps), severity, help_fixes(helps))
    )


class Diagnostics:
    """The diagnostics so far, in the order they were found, without repetitions.

    `tell` is called with the name of each step that begins and may take seconds.
    """

    def __init__(self, tell: Callable[[str], None] | None = None) -> None:
        self.tell: Callable[[str], None] = tell or (lambda _: None)
        self._items: list[Diagnostic] = []
        self._seen: set[tuple[str, str, int, str]] = set()
        self._errors = 0
        self._names_left = NAMES_COMPARED

    def add(self, diagnostic: Diagnostic) -> None:
        """Keeps a diagnostic unless it already has one with the same code, place and message."""
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
        """Discards all reports of the block; yields a function that says if it had no error."""
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
        """Whether a suggestion may compare `names` more names; counts these names."""
        self._names_left -= names
        return self._names_left >= 0 and len(self._items) <= KEPT_MAX

    def did_you_mean(
        self, name: str, candidates: Iterable[str], span: Span | None = None
    ) -> tuple[Help, ...]:
        """A help line with the most similar candidate; () if no candidate is similar.

        If `span`, the place of the name, is set, the help line is an edit.
        """
        if not self.may_look_at(0):
            return ()
        known = list(islice(candidates, self._names_left + 1))
        near = likely_name(name, known) if self.may_look_at(len(known)) else None
        if near is None:
            return ()
        title = f"did you mean `{near}`?"
        return (title,) if span is None else (Fix(title, (Edit(span, near),)),)

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
        """Reports an error; `also` adds further spans with labels."""
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
        """Reports a warning; `also` adds further spans with labels."""
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
        self.add(make_diagnostic(code, message, primary, secondary, notes, helps, severity))

    @property
    def items(self) -> tuple[Diagnostic, ...]:
        """All diagnostics so far, in the order they were found."""
        return tuple(self._items)

    @property
    def has_errors(self) -> bool:
        """Whether any diagnostic is an error."""
        return self._errors > 0

    @property
    def error_count(self) -> int:
        """How many errors there are so far."""
        return self._errors

    def raise_errors(self) -> None:
        """Raises SoterError with every diagnostic if at least one is an error."""
        if self._errors:
            raise SoterError(self.items)

    def __len__(self) -> int:
        return len(self._items)


class SoterError(Exception):
    """A user's mistake as diagnostics; it is never shown as a traceback."""

    def __init__(self, diagnostics: tuple[Diagnostic, ...] | SoterError) -> None:
        """Takes `diagnostics`, or copies the diagnostics of another `SoterError`."""
        self.diagnostics: tuple[Diagnostic, ...] = (
            diagnostics.diagnostics  # gymnasium.vector: `raise type(error)(error)`
            if isinstance(diagnostics, SoterError)
            else diagnostics
        )
        super().__init__("; ".join(f"[{d.code}] {d.message}" for d in self.diagnostics))
        self.__notes__ = [f"help: {h}" for d in self.diagnostics for h in d.helps]
        """Lines that Python adds to a traceback."""

    def __reduce__(self) -> tuple[type[SoterError], tuple[tuple[Diagnostic, ...]]]:
        """Makes pickle keep the diagnostics, since `args` have only their text."""
        return type(self), (self.diagnostics,)


def mistake(code: Code, message: str, *helps: str, notes: tuple[str, ...] = ()) -> SoterError:
    """A SoterError with one diagnostic that has no place; leaves out empty `helps`."""
    return SoterError((Diagnostic(code, message, notes=notes, helps=tuple(filter(None, helps))),))
