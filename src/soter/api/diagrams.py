"""The diagram of a system, as a public object.

Purpose: `Diagram` is what `Program.diagram` returns and `soter show` writes; it can replay a log.
Non-goals: drawing (`diagram/`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from soter.api.arguments import may_replace
from soter.diagnostics.diagnostic import mistake

if TYPE_CHECKING:
    from soter.language.model.system import System


@dataclass(frozen=True)
class Diagram:
    """The nodes, topics, modules and plants of a system: its name, and an SVG."""

    system: str
    svg: str
    flat: System | None = field(default=None, repr=False, compare=False)
    """The system that is drawn; None for a diagram that was not made from one."""

    def _repr_svg_(self) -> str:
        """The SVG, which a notebook shows."""
        return self.svg

    def write(self, path: str | Path) -> Path:
        """Writes the SVG; `SoterError` D006 if that fails or would replace another file."""
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

    def write_replay(self, log: str | Path, path: str | Path) -> Path:
        """Writes a page that replays a log of `soter run --log` on the diagram.

        `SoterError` D006 if the log is of another system or the page cannot be written; D007.
        """
        from soter.simulate.run_on_diagram import write_log_page  # noqa: PLC0415 - see `soter.api`

        assert self.flat is not None
        return write_log_page(log, self.flat, path)


def diagram_of(system: System) -> Diagram:
    """The diagram of a flat system."""
    from soter.diagram.svg import picture  # noqa: PLC0415 - see `soter.api`

    return Diagram(system.name, picture(system), system)
