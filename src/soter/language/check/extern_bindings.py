"""What an extern is bound to: `"python:file.py:name"`, `"c:file.c:name"`, `"onnx:file.onnx"`.

Purpose: a binding that can be one, with its file beside the file that declares it.
Non-goals: whether there is such a file (`simulate/externs/`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.model.binding_text import FORMS, binding_of

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.diagnostics.span import Span
    from soter.language.check.scope import FileScope


def check_binding(source: str | None, span: Span | None, diagnostics: Diagnostics) -> None:
    """X009 for a binding text that cannot be one."""
    if source is None or binding_of(source) is not None:
        return
    form = FORMS.get(source.partition(":")[0], FORMS["python"])
    diagnostics.error(
        "X009",
        f"`{source}` is no binding",
        span,
        notes=("a binding names the language, the file and the function",),
        helps=(f'write `"{form}"`',),
    )


def located(source: str | None, scope: FileScope) -> str | None:
    """A binding with its files made relative to the file that declares it."""
    binding = binding_of(source)
    return source if binding is None else str(binding.beside(scope.loaded.path.parent))
