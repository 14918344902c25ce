"""What a diagram shows, as plain data: boxes, frames around them, and who writes to whom.

Purpose: `DiagramBox`, `ModuleFrame`, `Edge`, `DiagramGraph`; whoever draws knows nothing of
programs.
Non-goals: places (`layered_layout.py`), lines and colours (`drawing.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.diagram.value_rows import ValueRow


@dataclass(frozen=True)
class DiagramBox:
    """A box with text: `lines` are titles, `caption` stands below them in small letters.

    `kind`: plant, node, ac, sc, dm, topic or input. `key` is what arrows name; `names` are the full
    names of what is shown here, one but for topics that share a box. `values`: of each title the
    rows below it that a page fills in while a run is replayed; empty where nothing is replayed.
    """

    key: str
    kind: str
    lines: tuple[str, ...]
    caption: str = ""
    names: tuple[str, ...] = ()
    values: tuple[tuple[ValueRow, ...], ...] = ()


@dataclass(frozen=True)
class ModuleFrame:
    """A module: a frame with a title around its controllers and its DM."""

    key: str
    title: str
    inside: tuple[Part, ...]


Part = DiagramBox | ModuleFrame


@dataclass(frozen=True)
class Edge:
    """From one key to another."""

    source: str
    target: str


@dataclass(frozen=True)
class DiagramGraph:
    """Everything that is drawn. `first`: keys of what stands at the top where it can."""

    title: str
    parts: tuple[Part, ...]
    arrows: tuple[Edge, ...]
    first: frozenset[str] = frozenset()


def cells(part: Part) -> tuple[DiagramBox, ...]:
    """The boxes of a part, from left to right."""
    if isinstance(part, DiagramBox):
        return (part,)
    return tuple(cell for inner in part.inside for cell in cells(inner))
