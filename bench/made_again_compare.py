"""Figures in a text beside those that a command prints.

Purpose: `compared` holds every line of a kept output against a new one: the same words, the same
numbers; `sampled` holds it against the output of a smaller run: what was 0 is 0, shares are within
what so few flights allow; `stood` holds the rows of a table, and the figures of a sentence, against
the output that they were taken from. Times are left out: numbers in columns with such a heading,
and, by default, numbers with a unit of time or memory.
Non-goals: which text belongs to which command.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import islice
from math import sqrt
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

LEFT_OUT = "~"
HEX = r"\b(?=[0-9a-f]*[a-f])(?=[0-9a-f]*\d)[0-9a-f]{8,}\b"
NUMBER = r"(?<![\w.])\d+(?:,\d{3})*(?:\.\d+)?(?:e[-+]?\d+)?"
TOKEN = re.compile(rf"{HEX}|{NUMBER}")
UNIT = r"(?:ns|us|µs|ms|s|min|KB|MB|KiB|MiB|GB)\b(?!/)"
TIMES = "\N{MULTIPLICATION SIGN}"
WITH_UNIT = re.compile(rf"{NUMBER} ?{UNIT}")
REAL_TIME = re.compile(rf"{NUMBER} ?(?:x|{TIMES}) real(?: time)?")
CLOCK = (
    r"wall(?:, \d)?|cpu(?: s|, \d| / 2)?|/ verify|took|time|search|s|ms|us|ns|seconds|check s|rate|"
    r"ratio|(?:x )?real|longest|slowest answer|(?:<=|over) \d.*|best(?: cpu)?|median|"
    r".*, (?:s|ms|us|ns)|target(?: .*)?|met|faster|efficiency|by medians|memory|"
    r"p50.*|p99.*|max(?: ms)?"
)
"""Headings of columns that hold another number in every run."""
RULE = re.compile(r"^[─ ]*──[─ ]*$")
ROW_RULE = re.compile(r"^\|[-:| ]+\|$")
TARGET = re.compile(r"[<>]=|target|goal")
WHETHER = r"\b(?:ok|MISSED|missed|yes|NO|no|if idle)\b"
MET = re.compile(rf"{WHETHER}\s*$")
"""Whether a time met its target is no figure either."""
BY_CLOCK = re.compile(
    r" {2}(?:stopped|time|bound: time, \S+ ms covered) {2}|^load of the machine|x real$"
)
"""A search that the clock ended: what it came to is no figure, nor is how busy a machine was."""
SIGMAS = 5.0


@dataclass(frozen=True)
class Line:
    """A line: its words with `#` for a number and `~` for a time; the numbers, as written."""

    words: str
    numbers: tuple[str, ...]


@dataclass
class Compared:
    """How many figures were compared, and what differs, a sentence each."""

    figures: int = 0
    differ: list[str] = field(default_factory=list)


def value(number: str) -> float:
    """A number as it is written in pages, with commas between thousands."""
    return float(number.replace(",", ""))


def lines(text: str, times: str | None = None) -> list[Line]:
    """The lines of an output; `times`: headings (a regex) of times, else CLOCK and units.

    Behind a `+` they are asked for besides CLOCK and units.
    """
    usual = times is None or times.startswith("+")
    names = f"{CLOCK}|{(times or '+(?!)')[1:]}" if usual else times or "(?!)"
    heading = re.compile(rf"\s*(?:{names})\s*", re.IGNORECASE)
    made, before, spans, cells = [], "", list[tuple[int, int]](), set[int]()
    for raw in text.splitlines():
        line = raw.expandtabs()
        if RULE.match(line):
            found = [m.span() for m in re.finditer("─+", line)]
            spans = [(a, b) for a, b in found if heading.fullmatch(before[a:b] or " ")]
        elif ROW_RULE.match(line):
            cells = {k for k, c in enumerate(before.split("|")) if heading.fullmatch(c)}
        elif not line.strip():
            spans, cells = [], set()
        else:
            if not spans and _is_heading(line):
                spans = [(*m.span(),) for m in re.finditer(r"\S+(?: \S+)*", line)]
                spans = [(a, b) for a, b in spans if heading.fullmatch(line[a:b])]
                spans += [m.span() for m in re.finditer(r"(?<!\S)(?:wall|took)(?!\S)", line)]
            line = TOKEN.sub(LEFT_OUT, line) if BY_CLOCK.search(line) else line
            made.append(_line(_without(line, spans, cells), units=usual))
        before = line
    return [x for x in made if x.words.strip()]


def _is_heading(line: str) -> bool:
    """Whether a line heads a table that has no rule below: many columns, none of them a number."""
    columns = re.split(r" {2,}", line.strip())
    return len(columns) > 2 and not any(re.fullmatch(rf"{NUMBER} ?%?", c) for c in columns)


def _without(line: str, spans: list[tuple[int, int]], cells: set[int]) -> str:
    """A line without what stands in columns of times."""
    if cells and line.startswith("|"):
        parts = line.split("|")
        return "|".join(LEFT_OUT if k in cells else c for k, c in enumerate(parts))
    if not spans:
        return line
    there = re.compile(rf"{HEX}|{NUMBER}(?: ?{UNIT})?|{WHETHER}")

    def left_out(m: re.Match[str]) -> str:
        inside = any(m.start() < b and a < m.end() for a, b in spans)
        return LEFT_OUT if inside and not re.fullmatch(HEX, m[0]) else m[0]

    return there.sub(left_out, line)


def _line(text: str, *, units: bool) -> Line:
    """Words and numbers of what is left of a line; `real time` are times everywhere."""
    text = REAL_TIME.sub(LEFT_OUT, text.replace("#", "No"))
    text = WITH_UNIT.sub(LEFT_OUT, text) if units else text
    if LEFT_OUT in text and TARGET.search(text):
        text = MET.sub(LEFT_OUT, text)
    numbers = tuple(m[0] for m in TOKEN.finditer(text) if re.fullmatch(NUMBER, m[0]))
    words = TOKEN.sub(lambda m: "#" if re.fullmatch(NUMBER, m[0]) else m[0], text)
    return Line(re.sub(r"[─\s]+", " ", words).strip(), numbers)


def _pairs(kept: list[Line], made: list[Line]) -> Iterator[tuple[Line, Line | None]]:
    """Each kept line with the next new one that has its words.

    Where a page shows but some of the lines with these words, with the next that has its numbers.
    """
    by_words: dict[str, list[Line]] = {}
    for line in made:
        by_words.setdefault(line.words, []).append(line)
    shown = Counter(line.words for line in kept)
    some = {words for words, same in by_words.items() if len(same) > shown[words]}
    for line in kept:
        same = by_words.get(line.words, [])
        at = same.index(line) if line.words in some and line in same else 0
        del same[:at]
        yield line, same.pop(0) if same else None


def compared(
    kept: str, made: str, times: str | None = None, *, part: bool = False, whole: bool = False
) -> Compared:
    """Every line of a kept output beside a new one.

    `part`: beside one that has but some of the rows: a line is missed only where another one
    begins as it does. `whole`: all of the output is kept, so a new line with a figure is missing.
    """
    told, old_ones, new = Compared(), lines(kept, times), lines(made, times)
    names = {_name(x) for x in new} if part else set()
    if whole:
        more = Counter(x.words for x in new if x.numbers) - Counter(x.words for x in old_ones)
        told.differ += [f"the page has no line {words!r}" for words in more.elements()]
    for old, now in _pairs(old_ones, new):
        if part and now is None and _name(old) not in names:
            continue
        told.figures += len(old.numbers)
        if now is None:
            near = get_close_matches(old.words, [x.words for x in new], 1, 0.6)
            shown = f"; nearest: {near[0]}" if near else ""
            told.differ.append(f"no line {_text(old)!r}{shown}")
            continue
        unequal = [(a, b) for a, b in zip(old.numbers, now.numbers, strict=True)
                   if value(a) != value(b)]  # fmt: skip
        told.differ += [f"{_text(old)[:90]!r}: page says {a}, made {b}" for a, b in unequal]
    return told


def _name(line: Line) -> str:
    """What a row begins with, up to its first number."""
    return line.words.partition("#")[0]


def _text(line: Line) -> str:
    """A line as it was, but for its gaps."""
    numbers = iter(line.numbers)
    return re.sub("#", lambda _: next(numbers, "#"), line.words)


def _clauses(line: Line) -> Iterator[Line]:
    """The clauses of a line, without digests: of fewer programs another one may be another."""
    numbers = iter(line.numbers)
    for words in re.sub(HEX, LEFT_OUT, line.words).split(";"):
        yield Line(words.strip(), tuple(islice(numbers, words.count("#"))))


def sampled(kept: str, made: str, flights: int, times: str | None = None) -> Compared:
    """A kept output beside that of a run of but so many flights, programs or missions a row.

    A whole number that is 0 has to be 0; a share (%) may differ by SIGMAS standard deviations of a
    mean of so many values in [0, 1] with this mean: sqrt(p (1 - p) / flights) at most, each. Their
    digests are others.
    """
    told = Compared()
    there, new = ([c for x in lines(t, times) for c in _clauses(x)] for t in (kept, made))
    for old, now in _pairs(there, new):
        if now is None:
            continue
        shares = [m[1] == "%" for m in re.finditer("# ?(%|)", old.words)]
        for a, b, share in zip(old.numbers, now.numbers, shares, strict=True):
            if share:
                told.figures += 1
                half = 0.5 * 10.0 ** -len(a.partition(".")[2]) / 100
                p = min(max(value(a) / 100, half), 1 - half)
                allowed = SIGMAS * sqrt(p * (1 - p) / flights) + 2 * half
                if abs(value(b) / 100 - p) > allowed:
                    told.differ.append(
                        f"{_text(old)[:90]!r}: page says {a} %, made {b} % of {flights}"
                        f" (allowed: {allowed:.2%})"
                    )
            elif a == "0":
                told.figures += 1
                if value(b) != 0:
                    told.differ.append(f"{_text(old)[:90]!r}: page says 0, made {b}")
    return told


def numbers_in(text: str) -> list[str]:
    """The numbers of a page's text, none of what stands in code or in a link's address."""
    text = re.sub(r"`[^`]*`|\]\([^)]*\)", " ", text)
    return [m[0] for m in TOKEN.finditer(text) if re.fullmatch(NUMBER, m[0])]


def _is_among(number: str, there: Iterable[float]) -> bool:
    """Whether a number is there, perhaps with more digits."""
    half = 0.5 * 10.0 ** -len(number.partition(".")[2])
    return any(abs(value(number) - x) <= half * 1.000001 for x in there)


def stood(rows: Iterable[str], made: str, given: frozenset[str], *, spread: bool) -> Compared:
    """Whether the figures of each row stand in one line of an output; `spread`: anywhere in it.

    `given` are numbers of a row that no command prints: bounds that the program declares.
    """
    told = Compared()
    there = [[value(n) for n in numbers_in(x)] for x in made.splitlines()]
    there = [[x for line in there for x in line]] if spread else there
    for row in rows:
        figures = [n for n in numbers_in(row) if n not in given]
        told.figures += len(figures)
        missing = [[n for n in figures if not _is_among(n, line)] for line in there] or [figures]
        least = min(missing, key=len)
        if least:
            told.differ.append(f"{row.strip()[:90]!r}: {', '.join(least)} not made")
    return told


def counted(differ: list[str], most: int = 8) -> str:
    """What differs, as lines; of many the first ones."""
    more = Counter(differ)
    shown = [f"    {x}" for x in list(more)[:most]]
    return "\n".join([*shown, *([f"    and {len(more) - most} more"] if len(more) > most else [])])
