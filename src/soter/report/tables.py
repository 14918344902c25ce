"""Tables and time lines for a terminal, and results as a notebook shows them.

Purpose: `table` and `mode_timeline` write the same few lines of plain text under `soter run`, the
demo and in a log file. `notebook_table` and `framed_document` make the HTML of `_repr_html_`,
without scripts and in the notebook's own style: a line that says how it went, a table, below it the
whole report in a frame of its own (`srcdoc`), which a notebook that trusts nobody leaves out.
Non-goals: terminal control beyond colour; deciding whether colour is wanted; what the report says.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np

from soter.report.run.figure_parts import mode_stretches

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray


Tone = Literal["plain", "good", "bad", "muted", "strong"]
ANSI = {"good": "32", "bad": "31", "muted": "2", "strong": "1"}
NUMBER = re.compile(
    r"^[-+\N{MINUS SIGN}<>≥≤~]*\s*[\d.,]+(e[-+]?\d+)?"
    r"\s*(%|\N{MULTIPLICATION SIGN}|[a-zµ]{1,3}(/[a-z]+)?²?)?$"
)
BLANK = ("", "-", "—")


@dataclass(frozen=True)
class Styled:
    """A table cell with a tone, which gives the cell a colour if colours are on."""

    text: str
    tone: Tone


Entry = str | int | float | Styled


def table(
    headers: Sequence[str],
    rows: Iterable[Sequence[Entry]],
    *,
    color: bool = False,
    width: int | None = None,
) -> str:
    """An aligned table as lines of text, without a line break at the end.

    `headers`: one title per column; `rows`: as many entries each. Columns of numbers, with or
    without a unit, are flush right, others flush left. Floats are written with four significant
    digits; for another format, pass a text. `width`: columns of the terminal; in a wider table the
    widest columns are broken between words, as far as possible (never at a no-break space). Raises
    `ValueError` for a row of another length.
    """
    cells = [[_styled_entry(entry) for entry in row] for row in rows]
    for row in cells:
        if len(row) != len(headers):
            raise ValueError(f"a row of {len(headers)} entries expected, found {len(row)}")
    head = [Styled(header, "strong") for header in headers]
    columns = [[row[index].text for row in cells] for index in range(len(headers))]
    right = [_is_numeric(column) for column in columns]
    widths = _column_widths(headers, columns, right, width)
    rule = _coloured_text("  ".join("─" * width for width in widths), "muted", color=color)
    above, *below = (
        [_table_line(line, widths, right, color=color) for line in _row_lines(row, widths)]
        for row in (head, *cells)
    )
    return "\n".join([*above, rule, *(line for lines in below for line in lines)])


def _column_widths(
    headers: Sequence[str], columns: list[list[str]], right: list[bool], most: int | None
) -> list[int]:
    """The width of every column; wide columns shrink until the table fits or cannot shrink."""
    every = [[header, *column] for header, column in zip(headers, columns, strict=True)]
    widths = [max(display_width(text) for text in texts) for texts in every]
    if most is None:
        return widths
    least = [
        max(
            max((display_width(w) for t in texts for w in _breakable_words(t)), default=0),
            max((display_width(t) for t in texts[1:]), default=0) if numeric else 0,
        )
        for texts, numeric in zip(every, right, strict=True)
    ]
    while sum(widths) + 2 * (len(widths) - 1) > most:
        free = [k for k, width in enumerate(widths) if width > least[k]]
        if not free:
            break
        widths[max(free, key=lambda k: widths[k])] -= 1
    return widths


def _breakable_words(text: str) -> list[str]:
    """The words of a text, split at each blank where a line may break."""
    return [word for word in text.split(" ") if word]


def _row_lines(row: Sequence[Styled], widths: Sequence[int]) -> list[list[Styled]]:
    """The lines of a row; each line has a cell for every column."""
    parts = [_wrapped_lines(cell.text, width) for cell, width in zip(row, widths, strict=True)]
    return [
        [
            Styled(lines[k].replace("\u00a0", " ") if k < len(lines) else "", cell.tone)
            for cell, lines in zip(row, parts, strict=True)
        ]
        for k in range(max(map(len, parts), default=0))
    ]


def _wrapped_lines(text: str, width: int) -> list[str]:
    """The lines of a text, which are at most `width` wide unless a single word is wider."""
    if display_width(text) <= width:
        return [text]
    lines = [""]
    for word in _breakable_words(text):
        longer = f"{lines[-1]} {word}" if lines[-1] else word
        if lines[-1] and display_width(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def display_width(text: str) -> int:
    """How many columns of a terminal a text takes."""
    return sum(
        0 if unicodedata.combining(char) else 2 if unicodedata.east_asian_width(char) in "WF" else 1
        for char in text
    )


def mode_timeline(
    time_s: NDArray[np.float64],
    in_control: NDArray[np.bool_],
    width: int = 60,
    *,
    ascii_only: bool = False,
) -> str:
    """A bar of `width` columns that shows who is in control: `▏SC▕████AC████▏SC▕███`.

    `time_s` (N,) in s, increasing; `in_control` (N,) bool, true if AC is in control from this
    sample to the next. A column shows the controller that has it longer. Yet a shorter SC stretch
    still takes one column, because a takeover must never disappear. A stretch shows its name if the
    name fits. With `ascii_only`: `[SC]====AC====[SC]===`.
    """
    if width < 1 or len(time_s) == 0:
        return ""
    ac = _control_by_column(time_s, in_control, width)
    edges = [0, *(np.flatnonzero(np.diff(ac.astype(np.int8))) + 1).tolist(), width]
    return "".join(
        _mode_columns(bool(ac[first]), last - first, ascii_only=ascii_only)
        for first, last in pairwise(edges)
    )


def _control_by_column(
    time_s: NDArray[np.float64], in_control: NDArray[np.bool_], width: int
) -> NDArray[np.bool_]:
    """Who has control in each column of the bar: (width,) bool, true for AC."""
    start, duration = float(time_s[0]), float(time_s[-1] - time_s[0])
    if duration <= 0:
        return np.full(width, bool(in_control[0]))
    share = np.zeros(width)
    takeovers: list[int] = []
    for first, last, is_ac in mode_stretches(in_control):
        left = (float(time_s[first]) - start) / duration * width
        right = (float(time_s[last]) - start) / duration * width
        if is_ac:
            columns = np.arange(width)
            share += np.clip(np.minimum(columns + 1, right) - np.maximum(columns, left), 0, 1)
        elif right > left:
            takeovers.append(min(int((left + right) / 2), width - 1))
    held: NDArray[np.bool_] = share > 0.5
    held[takeovers] = False
    return held


def _mode_columns(is_ac: bool, length: int, *, ascii_only: bool) -> str:
    """The text for the columns of one stretch of equal mode."""
    name = "AC" if is_ac else "SC"
    if is_ac:
        fill = "=" if ascii_only else "█"
        return name.center(length, fill) if length >= 4 else fill * length
    left, right, alone = ("[", "]", "|") if ascii_only else ("▏", "▕", "│")
    if length == 1:
        return alone
    inner = length - 2
    return left + (name.center(inner) if inner >= 2 else " " * inner) + right


def _styled_entry(entry: Entry) -> Styled:
    """The entry as a text cell with a tone."""
    if isinstance(entry, Styled):
        return entry
    if isinstance(entry, bool):
        return Styled("yes" if entry else "no", "plain")
    return Styled(f"{entry:.4g}" if isinstance(entry, float) else str(entry), "plain")


def _is_numeric(column: Sequence[str]) -> bool:
    """Whether a column contains only numbers and at least one of them."""
    filled = [text for text in column if text.strip() not in BLANK]
    return bool(filled) and all(NUMBER.match(text.strip()) for text in filled)


def _table_line(
    row: Sequence[Styled], widths: Sequence[int], right: Sequence[bool], *, color: bool
) -> str:
    """One line of a table, without blanks at its end."""
    parts = []
    for cell, width, flush_right in zip(row, widths, right, strict=True):
        blank = " " * (width - display_width(cell.text))
        text = _coloured_text(cell.text, cell.tone, color=color)
        parts.append(blank + text if flush_right else text + blank)
    return "  ".join(parts).rstrip()


def _coloured_text(text: str, tone: Tone, *, color: bool) -> str:
    """The text in the colour of its tone if colours are on; else unchanged."""
    return f"\x1b[{ANSI[tone]}m{text}\x1b[0m" if color and text and tone in ANSI else text


def notebook_table(
    head: str, headers: Sequence[str], rows: Iterable[Sequence[object]], notes: Sequence[str] = ()
) -> str:
    """HTML with `head` in bold, a table with a cell for each of `headers` in a row, and notes."""
    titles = "".join(f"<th>{escape(h)}</th>" for h in headers)
    lines = "".join(
        "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    table = f"<table><thead><tr>{titles}</tr></thead><tbody>{lines}</tbody></table>"
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    below = f"<ul>{items}</ul>" if items else ""
    return f"<div><b>{escape(head)}</b>{table if lines else ''}{below}</div>"


def framed_document(document: str, height_px: int = 720) -> str:
    """An HTML document in a frame that keeps its scripts away from notebook and network."""
    return (
        f'<iframe srcdoc="{escape(document, quote=True)}" sandbox="allow-scripts" title="report" '
        f'loading="lazy" style="width:100%;height:{height_px}px;border:1px solid #8888"></iframe>'
    )
