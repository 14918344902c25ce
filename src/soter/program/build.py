"""From a file to a checked program: the whole static half in one call.

Purpose: load, check, elaborate every system, check well-formedness; what `soter check` does.
Non-goals: rendering diagnostics, anything dynamic.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.program.checker import check
from soter.program.elaborate import elaborate, implicit_system
from soter.program.loader import load
from soter.program.wellformed import check_declaration, check_periods

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.program.system import System
    from soter.program.typed import Program, SystemSymbol
    from soter.program.types import Value


@dataclass(eq=False)
class Checked:
    """A program and every diagnostic about it; `program` is None when nothing was read."""

    program: Program | None
    diagnostics: Diagnostics
    systems: dict[str, SystemSymbol] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether it may be run."""
        return self.program is not None and not self.diagnostics.has_errors

    def default_system(self) -> SystemSymbol | None:
        """The only system, or the one marked `default`; None when that is not decided."""
        if len(self.systems) == 1:
            return next(iter(self.systems.values()))
        marked = [s for s in self.systems.values() if s.default]
        return marked[0] if len(marked) == 1 else None


def check_file(
    path: str, text: str | None = None, overrides: Mapping[str, Value] | None = None
) -> Checked:
    """Check the program in `path` (or in `text`, with `path` as its name)."""
    diagnostics = Diagnostics()
    loaded = load(path, diagnostics, text)
    if loaded is None:
        return Checked(None, diagnostics)
    program = check(loaded, diagnostics)
    checked = Checked(program, diagnostics)
    for module in program.modules.values():
        check_declaration(module, diagnostics)
    own = {n: s for n, s in program.systems.items() if "." not in n}
    if not own:
        everything = implicit_system(program)
        own = {everything.name: everything} if everything else {}
    checked.systems = own
    marked = [s for s in own.values() if s.default]
    if len(marked) > 1 and program.systems:
        diagnostics.error(
            "M012", "two systems are marked `default`", marked[1].span,
            also=((marked[0].span, "the first one"),),
        )
    if any(d.code in {"T012"} for d in diagnostics.items):
        return checked
    structural = diagnostics.has_errors
    for system in own.values():
        flat = elaborate(program, system, overrides or {}, _quiet(diagnostics, structural))
        check_periods(flat, diagnostics)
    return checked


def _quiet(diagnostics: Diagnostics, structural: bool) -> Diagnostics:
    """Composition errors after structural ones would mostly be their shadows: drop M004, M005."""
    if not structural:
        return diagnostics
    return _Filtered(diagnostics)


class _Filtered(Diagnostics):
    """Passes everything on but the codes that a missing declaration would cause."""

    SHADOWS = frozenset({"M005", "M013", "V003"})

    def __init__(self, target: Diagnostics) -> None:
        super().__init__()
        self._target = target

    def add(self, diagnostic: object) -> None:  # type: ignore[override]
        from soter.diagnostics.diagnostic import Diagnostic  # noqa: PLC0415 - narrow type

        assert isinstance(diagnostic, Diagnostic)
        if diagnostic.code not in self.SHADOWS:
            self._target.add(diagnostic)


def system_of(
    checked: Checked, name: str | None, overrides: Mapping[str, Value] | None = None
) -> System:
    """The flattened system to run; SoterError when there is no such or it has errors."""
    if not checked.ok:
        raise SoterError(checked.diagnostics.items)
    assert checked.program is not None
    symbol = checked.systems.get(name) if name else checked.default_system()
    diagnostics = Diagnostics()
    if symbol is None:
        known = ", ".join(f"`{n}`" for n in checked.systems) or "none"
        if name:
            diagnostics.error("U002", f"there is no system `{name}`; declared: {known}")
        elif not checked.systems:
            diagnostics.error("U002", "the program declares nothing that could run")
        else:
            diagnostics.error(
                "U002", f"which system? declared: {known}",
                helps=("name one with --system, or mark one `default`",),
            )
        raise SoterError(diagnostics.items)
    flat = elaborate(checked.program, symbol, overrides or {}, diagnostics)
    check_periods(flat, diagnostics)
    if diagnostics.has_errors:
        raise SoterError(diagnostics.items)
    return flat
