"""What a command prints as data, before anybody knows how wide and how coloured it is shown.

Purpose: a result that can be stored and shown again, on this terminal or another.
Non-goals: streams, and whether anything is printed at all (`console.py`).
"""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from soter.cli.terminal.console import painted

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from soter.cli.terminal.console import Console
    from soter.report.terminal_tables import Styled

PAINT = re.compile(r"\x1b\[[0-9;]*m")


@dataclass(eq=False)
class Printout:
    """Texts and tables in the order in which they are shown; `parts` are what JSON can hold.

    A part is a text, coloured, or `[headers, rows]` of a table, whose cells are texts or
    `{"text", "tone"}`.
    """

    parts: list[Any] = field(default_factory=list)

    def say(self, text: str = "") -> None:
        """A line, or several."""
        self.parts.append(text)

    def table(self, headers: Sequence[str], rows: Iterable[Sequence[str | Styled]]) -> None:
        """A table."""
        cells = [[c if isinstance(c, str) else asdict(c) for c in row] for row in rows]
        self.parts.append([list(headers), cells])

    @staticmethod
    def paint(style: str, text: str) -> str:
        """`text` in colour, which is taken off where nobody sees it."""
        return painted(style, text)

    def show(self, console: Console) -> None:
        """Say all of it."""
        for part in self.parts if not console.json else ():
            if isinstance(part, str):
                console.say(part if console.color_out else PAINT.sub("", part))
            else:
                from soter.report.terminal_tables import Styled  # noqa: PLC0415 - needs NumPy

                rows = [[c if isinstance(c, str) else Styled(**c) for c in row] for row in part[1]]
                console.say(console.table(part[0], rows))
