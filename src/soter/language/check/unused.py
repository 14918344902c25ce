"""Declarations that nothing uses: warnings W001 and W004.

Purpose: collect them while checking and say them at the end, when every use is known.
Non-goals: errors.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fix import insert, remove

if TYPE_CHECKING:
    from soter.diagnostics.codes import Code
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.fix import Help
    from soter.diagnostics.span import Span
    from soter.language.check.scope import FileScope
    from soter.language.model.typed import Variable

ROOTS = {"system", "test"}


class UnusedDeclarations:
    """Warnings waiting for the end of the check."""

    def __init__(self, diagnostics: Diagnostics) -> None:
        self.diagnostics = diagnostics
        self._waiting: list[tuple[Code, str, Span, str, Help]] = []

    def add(self, code: Code, message: str, span: Span, label: str = "", help_: Help = "") -> None:
        """One more, for the end."""
        self._waiting.append((code, message, span, label, help_))

    def variables(self, variables: list[Variable]) -> None:
        """W001 for locals that are never read; a leading `_` says that this is meant."""
        for v in variables:
            if not v.used and not v.name.startswith("_"):
                meant = _meant(v.name) if v.kind == "var" else _renamed(v.name, v.span)
                self.add("W001", f"`{v.name}` is never used", v.span, "declared here", meant)

    def declarations(self, main: FileScope) -> None:
        """W001 for what the main file declares or imports and nobody mentions.

        Only where a system or a test says what the program is: without one the file may be there
        for others to import.
        """
        if not any(e.kind in ROOTS for e in main.entries.values()):
            return
        for entry in main.entries.values():
            name = entry.decl.name
            if entry.kind not in ROOTS and not entry.used and not name.text.startswith("_"):
                message = f"{entry.kind} `{name.text}` is never used"
                meant = _renamed(name.text, name.span)
                self.add("W001", message, name.span, "declared here", meant)
        for imported in main.loaded.file.imports:
            name = imported.name
            if main.imports.get(name.text) is not None and name.text not in main.used_imports:
                whole = remove(imported.span, "remove it")
                self.add("W001", f"import `{name.text}` is never used", name.span, "", whole)

    def report(self) -> None:
        """Say them; `explore/engine/explorer_library.py` leaves them out where there are errors."""
        for code, message, span, label, help_ in self._waiting:
            self.diagnostics.warning(code, message, span, label, helps=(help_,) if help_ else ())


def _renamed(name: str, span: Span) -> Help:
    """For what nothing mentions: its own place is the only one."""
    return insert(span, "_", _meant(name))


def _meant(name: str) -> str:
    return f"remove it, or call it `_{name}` to say that this is meant"
