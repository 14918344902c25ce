"""Lists the declarations of files, as symbols of the protocol.

Purpose: `document_symbols` gives the declarations of a file as a tree; `matching_declarations`
gives those of all files whose names match a query.
Non-goals: which files there are (`server.py` asks `documents.py`); places of a name
(`renaming.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lsprotocol import types as lsp

from soter.language.check.scope import KINDS
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Span
    from soter.editor.protocol_conversions import Lines
    from soter.language.load.loader import LoadedFile

KIND = lsp.SymbolKind
ICONS = {
    "type": KIND.Struct,
    "constant": KIND.Constant,
    "parameter": KIND.Property,
    "function": KIND.Function,
    "topic": KIND.Event,
    "node": KIND.Class,
    "module": KIND.Interface,
    "plant": KIND.Object,
    "system": KIND.Namespace,
    "test": KIND.Method,
    "import": KIND.Module,
}


def document_symbols(file: LoadedFile, lines: Lines) -> list[lsp.DocumentSymbol]:
    """The declarations of a file as a tree; each has the declarations inside it."""
    imports = [
        _document_symbol(i.name, i.span, KIND.Module, i.path, lines, ()) for i in file.file.imports
    ]
    symbols = []
    for decl in file.file.declarations:
        kind = KINDS[type(decl).__name__]
        inside = tuple(
            _document_symbol(n, s, k, t, lines, ()) for n, s, k, t in _declared_members(decl)
        )
        symbols.append(_document_symbol(decl.name, decl.span, ICONS[kind], kind, lines, inside))
    return [*imports, *symbols]


def _document_symbol(
    name: tree.Name,
    whole: Span,
    kind: lsp.SymbolKind,
    detail: str,
    lines: Lines,
    inside: tuple[lsp.DocumentSymbol, ...],
) -> lsp.DocumentSymbol:
    selected = lines.range(name.span.start, name.span.end)
    around = lines.range(min(whole.start, name.span.start), max(whole.end, name.span.end))
    return lsp.DocumentSymbol(
        name.text or "?", kind, around, selected, detail or None, children=list(inside) or None
    )


def _declared_members(decl: tree.Decl) -> Iterator[tuple[tree.Name, Span, lsp.SymbolKind, str]]:
    """Yields name, place, kind and detail of each name that a declaration declares inside."""
    if isinstance(decl, tree.TypeDecl):
        yield from _type_members(decl.type)
    elif isinstance(decl, tree.NodeDecl):
        for local in decl.locals:
            yield local.name, local.span, KIND.Variable, _one_line(local.type.span)
    elif isinstance(decl, tree.PlantDecl):
        for state in decl.states:
            yield state.name, state.span, KIND.Field, _one_line(state.type.span)
        for d in decl.disturbances:
            yield d.name, d.span, KIND.Variable, "disturbance"
    elif isinstance(decl, tree.RtaDecl):
        for clause in decl.contract:
            yield clause.name, clause.span, KIND.Boolean, clause.kind
        for view in decl.verify.views if decl.verify is not None else ():
            yield view.name, view.span, KIND.Namespace, "view"
    elif isinstance(decl, tree.SystemDecl):
        yield from _instance_members(decl.instances)


def _type_members(of: tree.TypeExpr) -> Iterator[tuple[tree.Name, Span, lsp.SymbolKind, str]]:
    """Yields the fields of a record or the members of an enum."""
    if isinstance(of, tree.RecordTypeExpr):
        for name, type_ in of.fields:
            yield name, name.span.to(type_.span), KIND.Field, _one_line(type_.span)
    elif isinstance(of, tree.EnumTypeExpr):
        for name in of.members:
            yield name, name.span, KIND.EnumMember, ""


def _instance_members(
    items: tuple[object, ...],
) -> Iterator[tuple[tree.Name, Span, lsp.SymbolKind, str]]:
    for item in items:
        if isinstance(item, tree.Instance):
            yield item.name, item.span, KIND.Object, item.what.text
        elif isinstance(item, tree.Repeated):
            yield from _instance_members(item.items)


def _one_line(span: Span) -> str:
    return " ".join(span.text.split())


def matching_declarations(
    files: list[LoadedFile], query: str
) -> Iterator[tuple[tree.Decl, lsp.SymbolKind, LoadedFile]]:
    """Yields declarations whose names contain the query's letters in order, in any case."""
    for file in files:
        for decl in file.file.declarations:
            if _is_subsequence(query.casefold(), decl.name.text.casefold()):
                yield decl, ICONS[KINDS[type(decl).__name__]], file


def _is_subsequence(query: str, name: str) -> bool:
    at = 0
    for letter in query:
        at = name.find(letter, at) + 1
        if not at:
            return False
    return True
