"""The lines of a benchmark's output that say what came of it, and the targets beside them.

Purpose: cells of the table docs/benchmarks.md. A line is one of the output, with its runs of blanks
as one; of a row of a table those cells whose heads were asked for, each behind its head.
Non-goals: which lines, where the output does not say (`Benchmark.last`, `Benchmark.heads`).
"""

from __future__ import annotations

import re
from itertools import pairwise, takewhile
from typing import TYPE_CHECKING

from bench.made_again_compare import NUMBER, ROW_RULE

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

TARGET = re.compile(r"\btargets?:?\s+([^():;]*\d[^():;]*|none)")
COLUMNS = re.compile(r"\S {2,}\S|^[|─]")
RULE = re.compile(r"^[─ -]*(?:──|--)[─ -]*$")
A_NUMBER = re.compile(rf"{NUMBER}\D{{0,4}}")
MANY = 6
"""So many rows with the same cells are named, more are counted."""
FIGURES = "measured"
"""The head of a column beside that of targets."""
Cells = dict[str, str]
"""What stands below each head of a table; the name of the row is below an empty one."""


def rows(text: str) -> Iterator[tuple[str, Cells]]:
    """Every line that says anything, with its cells where it is one of a table."""
    heads, spans = "", list[tuple[int, int]]()
    before = ""
    for line in text.splitlines():
        if RULE.match(line) or ROW_RULE.match(line):
            heads, spans = before, [m.span() for m in re.finditer("[─-]+", line)]
        elif not line.strip():
            heads, spans = "", []
        elif line.startswith("|") or _fits(line, spans):
            yield line, _below_a_rule(heads, line, spans)
        else:
            if not any(A_NUMBER.fullmatch(c) for c in re.split(r" {2,}", line.strip())):
                heads = line
            yield line, _aligned(heads, line) if heads != line else {}
        before = line


def _fits(line: str, spans: list[tuple[int, int]]) -> bool:
    """Whether a line has blanks where the rule above it has."""
    between = (line[a:b] for (_, a), (b, _) in pairwise(spans))
    return bool(spans) and not any(text.strip() for text in between)


def _below_a_rule(heads: str, line: str, spans: list[tuple[int, int]]) -> Cells:
    """The cells of a row, by the columns of a rule or by the bars of Markdown."""
    if line.startswith("|"):
        names, cells = ([c.strip() for c in x.split("|")[1:-1]] for x in (heads, line))
    else:
        names, cells = ([x[a:b].strip() for a, b in spans] for x in (heads, line))
    return {**dict(zip(names[1:], cells[1:], strict=False)), "": cells[0]}


def _aligned(heads: str, line: str) -> Cells:
    """The cells of a row without a rule: a number ends where its head ends."""
    cells, begin = {}, 0
    for word in re.finditer(r"\S+", line):
        end = word.end()
        if heads[end - 1 : end].strip() and not heads[end : end + 1].strip():
            cells[re.split(r" {2,}", heads[begin:end].strip())[-1]] = word[0]
        begin = end
    first = takewhile(lambda c: not re.match(NUMBER, c), re.split(r" {2,}", line.strip()))
    return {**cells, "": " ".join(first)}


def headlines(text: str, last: str = "", heads: str = "") -> list[str]:
    """Lines of an output that say what came of it; none where no rule finds them.

    `last` is a regex of lines, `heads` one of heads of columns. Without them they are the lines
    with a target and the rows of tables of what was measured; else the last line, if a sentence.
    """
    lines = list(rows(text))
    if last or heads:
        chosen = [(line, cells) for line, cells in lines if re.search(last, line)]
        told = [(cells.get("", ""), _asked(cells, heads)) for _, cells in chosen]
        whole = (x for x, _ in chosen if not heads or (last and not COLUMNS.search(x.strip())))
        return [*_grouped(told), *(" ".join(x.split()) for x in whole)]
    found = [
        f"{cells['']}: {cells[FIGURES]}" if FIGURES in cells else line
        for line, cells in lines
        if cells.get(FIGURES) or TARGET.search(line)
    ]
    return found or [x for x, _ in lines[-1:] if re.search(r"\d", x) and not COLUMNS.search(x)]


def _asked(cells: Cells, heads: str) -> str:
    """The cells with a value below the heads that were asked for."""
    return ", ".join(f"{h} {c}" for h, c in cells.items() if c and h and re.fullmatch(heads, h))


def _grouped(told: Iterable[tuple[str, str]]) -> list[str]:
    """Rows by name and cells, with those of the same cells as one."""
    names = dict[str, list[str]]()
    for name, cells in told:
        names.setdefault(cells, []).append(name)
    return [
        f"{'; '.join(who) if len(who) <= MANY else f'{len(who)} rows'}: {cells}"
        for cells, who in names.items()
        if cells
    ]


def targets(text: str) -> list[str]:
    """The targets that an output states: of its tables of what was measured, and in its lines."""
    found = []
    for line, cells in rows(text):
        if cells.get(FIGURES):
            found.append(cells.get("target", ""))
        else:
            found += [t.strip(" ,.:") for t in TARGET.findall(line)]
    return list(filter(None, found))
