"""The diagram of a system, as a public object.

Purpose: `Diagram` is what `Program.diagram` returns and `soter show` writes.
Non-goals: drawing (`diagram/`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from soter.api.output_files import may_replace
from soter.diagnostics.diagnostic import mistake

if TYPE_CHECKING:
    from soter.language.model.system import System


@dataclass(frozen=True)
class Diagram:
    """The drawing of a system's nodes, topics, modules and plants: a name and an SVG."""

    system: str
    svg: str

    def _repr_svg_(self) -> str:
        """The SVG that a notebook shows."""
        return self.svg

    def write(self, path: str | Path) -> Path:
        """Writes the SVG. Raises D006 if that fails or the path holds a file of another kind."""
        from soter.report.html import write_text  # noqa: PLC0415 - see `soter.api`

        target = Path(path)
        try:
            lost = target.is_file() and not may_replace(target, b"<svg")
        except OSError as error:
            raise mistake("D006", str(error)) from error
        if lost:
            problem = f"cannot write `{path}`: it holds something else, which would be lost"
            raise mistake("D006", problem)
        return write_text(self.svg, target)


def diagram_of(system: System) -> Diagram:
    """The diagram of a flat system."""
    from soter.diagram.svg import picture  # noqa: PLC0415 - see `soter.api`

    return Diagram(system.name, picture(system))
