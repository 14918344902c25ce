"""What an extern is bound to: `"python:file.py:name"`, `"c:file.c:name"`.

Purpose: a binding that can be one, with its file beside the file that declares it.
Non-goals: whether there is such a file (`simulate/externs/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.language.check.scope import FileScope

BINDING_KINDS = ("python", "c")


def check_binding(source: str | None, span: Span | None, diagnostics: Diagnostics) -> None:
    """X009 for a binding text that cannot be one."""
    if source is None:
        return
    parts = source.split(":")
    if len(parts) == 3 and parts[0] in BINDING_KINDS and all(parts):
        return
    kind = parts[0] if parts[0] in BINDING_KINDS else "python"
    diagnostics.error(
        "X009",
        f"`{source}` is no binding",
        span,
        notes=("a binding names the language, the file and the function",),
        helps=(f'write `"{kind}:file.{"py" if kind == "python" else "c"}:name"`',),
    )


def located(source: str | None, scope: FileScope) -> str | None:
    """A binding with its file made relative to the file that declares it."""
    if source is None or source.count(":") != 2:
        return source
    kind, file, name = source.split(":")
    return f"{kind}:{scope.loaded.path.parent / file}:{name}"
