"""The diagram of a system, in one call.

Purpose: `picture`: what `soter show`, reports, the docs and editors show.
Non-goals: which system, and where the SVG goes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagram.from_system import graph_of
from soter.diagram.svg import draw

if TYPE_CHECKING:
    from soter.language.model.system import System


def picture(system: System, *, live: bool = False) -> str:
    """The SVG of a flat system: a whole file, in light and dark; the same system, the same text.

    `live`: with empty rows, told by `data-value`, for what there is at a moment.
    """
    return draw(graph_of(system, live=live))
