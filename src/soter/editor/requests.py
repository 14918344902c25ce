"""The editor's questions, each to the file that answers it.

Purpose: positions to offsets and back, the program that a question is about, names to places.
Non-goals: when to check, what is open (`server.py`, `documents.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcInvalidRequest

from soter.diagnostics.diagnostic import Diagnostics, Source, Span
from soter.editor import code_actions_and_lenses, keywords, renaming, symbols
from soter.editor.code_actions_and_lenses import actions, workspace_edit
from soter.editor.completion import completed
from soter.editor.hover import described
from soter.language.syntax.printer import format_source
from soter.language.syntax.tokens import lex

if TYPE_CHECKING:
    from pathlib import Path

    from pygls.lsp.server import LanguageServer

    from soter.editor.code_actions_and_lenses import Verdicts
    from soter.editor.documents import Document, Documents
    from soter.editor.names.definitions import Definition, NameIndex, Use
    from soter.editor.protocol_conversions import Lines
    from soter.language.load.loader import LoadedFile

SYMBOLS_MAX = 200


class _CursorPosition:
    """A position of an open document: its program, its names, the offset."""

    def __init__(self, documents: Documents, document: Document, position: lsp.Position) -> None:
        self.documents = documents
        self.document = document
        self.loaded, self.index = documents.parsed_names(document)
        self.main: LoadedFile = self.loaded.main
        self.lines: Lines = documents.lines(self.main.source)
        self.offset = self.lines.offset(position)

    def use(self) -> Use | None:
        """The name there."""
        return self.index.at(self.main.source, self.offset)

    def word(self) -> tuple[int, int]:
        """Start and end of the word there."""
        text = self.main.source.text
        start = end = self.offset
        while start and (text[start - 1].isalnum() or text[start - 1] == "_"):
            start -= 1
        while end < len(text) and (text[end].isalnum() or text[end] == "_"):
            end += 1
        return start, end


def answer(server: LanguageServer, documents: Documents, verdicts: Verdicts) -> None:
    """Register every question that the server answers."""
    _about_names(server, documents)
    _about_renaming(server, documents)
    _about_text(server, documents)
    _about_lenses(server, documents, verdicts)
    _about_the_workspace(server, documents)


class _PositionRequest(Protocol):
    """A question about a position of a document."""

    text_document: lsp.TextDocumentIdentifier
    position: lsp.Position


def _at(documents: Documents, params: _PositionRequest) -> _CursorPosition | None:
    document = documents.get(params.text_document.uri)
    return None if document is None else _CursorPosition(documents, document, params.position)


def _used(
    documents: Documents, params: _PositionRequest
) -> tuple[_CursorPosition, Use] | tuple[None, None]:
    """The name at a position, with what it means; None for neither."""
    at = _at(documents, params)
    use = None if at is None else at.use()
    return (None, None) if at is None or use is None else (at, use)


# ---------------------------------------------------------------- names


def _about_names(server: LanguageServer, documents: Documents) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_HOVER)
    def hover(params: lsp.HoverParams) -> lsp.Hover | None:
        at = _at(documents, params)
        return None if at is None else _hover(at)

    @server.feature(lsp.TEXT_DOCUMENT_DEFINITION)
    def definition(params: lsp.DefinitionParams) -> lsp.Location | None:
        _, use = _used(documents, params)
        if use is None:
            return None
        definition = use.definition
        shape = definition.shape
        if definition.kind == "import" and use.declares and shape is not None:
            source = getattr(shape.of, "source", None)
            if source is not None:
                return documents.location(Span(source, 0, 0))
        return documents.location(definition.span)

    @server.feature(lsp.TEXT_DOCUMENT_REFERENCES)
    def references(params: lsp.ReferenceParams) -> list[lsp.Location] | None:
        at, use = _used(documents, params)
        if at is None or use is None:
            return None
        uses = renaming.uses_of(use.definition, _indices(at, use.definition))
        declared = params.context.include_declaration
        return [documents.location(u.span) for u in uses if declared or not u.declares]

    @server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
    def highlight(params: lsp.DocumentHighlightParams) -> list[lsp.DocumentHighlight] | None:
        at, use = _used(documents, params)
        if at is None or use is None:
            return None
        uses = at.index.uses_of(use.definition.key)
        here = [u.span for u in uses if u.span.source is at.main.source]
        return [lsp.DocumentHighlight(at.lines.range(s.start, s.end)) for s in here]


def _about_renaming(server: LanguageServer, documents: Documents) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_PREPARE_RENAME)
    def prepare_rename(params: lsp.PrepareRenameParams) -> lsp.PrepareRenamePlaceholder | None:
        at, use = _used(documents, params)
        if at is None or use is None:
            return None
        try:
            renaming.refuse(use.definition, use.definition.name)
        except renaming.RefusedError:
            return None
        where = at.lines.range(use.span.start, use.span.end)
        return lsp.PrepareRenamePlaceholder(where, use.definition.name)

    @server.feature(lsp.TEXT_DOCUMENT_RENAME, lsp.RenameOptions(prepare_provider=True))
    def rename(params: lsp.RenameParams) -> lsp.WorkspaceEdit | None:
        at, use = _used(documents, params)
        if at is None or use is None:
            return None
        programs = [path for path, _ in _programs(at, use.definition)]
        try:
            spans = renaming.rename(use.definition, params.new_name, programs, documents.reading)
        except renaming.RefusedError as refused:
            raise JsonRpcInvalidRequest(str(refused)) from None
        return workspace_edit(((span, params.new_name) for span in spans), documents)


def _hover(at: _CursorPosition) -> lsp.Hover | None:
    use = at.use()
    if use is not None:
        text = described(use.definition, at.document.good)
        where = at.lines.range(use.span.start, use.span.end)
    else:
        start, end = at.word()
        meaning = keywords.meaning(at.main.source.text[start:end])
        if meaning is None or (start not in lex(at.main.source).starts):
            return None
        text, where = meaning, at.lines.range(start, end)
    return lsp.Hover(lsp.MarkupContent(lsp.MarkupKind.Markdown, text), where)


def _programs(at: _CursorPosition, definition: Definition) -> list[tuple[Path, NameIndex]]:
    """The programs in which a definition can be named: all that say it, for what others see."""
    if definition.kind in LOCAL:
        return [(at.document.path, at.index)]
    return at.documents.mentioning(definition.name, at.document)


LOCAL = {"argument", "variable", "let", "loop variable", "disturbance", "clause", "measure", "view"}


def _indices(at: _CursorPosition, definition: Definition) -> list[NameIndex]:
    return [index for _, index in _programs(at, definition)]


# ---------------------------------------------------------------- text


def _about_text(server: LanguageServer, documents: Documents) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_COMPLETION, lsp.CompletionOptions(trigger_characters=["."]))
    def completion(params: lsp.CompletionParams) -> list[lsp.CompletionItem] | None:
        at = _at(documents, params)
        if at is None:
            return None
        good = at.document.good_index
        return completed(at.document.text, at.offset, at.main, at.index, good)

    @server.feature(lsp.TEXT_DOCUMENT_FORMATTING)
    def formatting(params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit] | None:
        document = documents.get(params.text_document.uri)
        if document is None:
            return None
        source = Source(str(document.path), document.text)
        laid_out = format_source(source, Diagnostics())
        if laid_out is None or laid_out == document.text:
            return []
        return [lsp.TextEdit(documents.lines(source).whole(), laid_out)]

    @server.feature(
        lsp.TEXT_DOCUMENT_CODE_ACTION,
        lsp.CodeActionOptions(code_action_kinds=[lsp.CodeActionKind.QuickFix]),
    )
    def code_action(params: lsp.CodeActionParams) -> list[lsp.CodeAction] | None:
        document = documents.get(params.text_document.uri)
        if document is None:
            return None
        documents.settle(document)
        return list(actions(document, documents, params.range))


def _about_lenses(server: LanguageServer, documents: Documents, verdicts: Verdicts) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_CODE_LENS)
    def code_lens(params: lsp.CodeLensParams) -> list[lsp.CodeLens] | None:
        document = documents.get(params.text_document.uri)
        if document is None:
            return None
        documents.settle(document)
        main = documents.loaded(document).main
        lines = documents.lines(main.source)
        return list(code_actions_and_lenses.lenses(main, lines, document.checked, verdicts))


# ---------------------------------------------------------------- the workspace


def _about_the_workspace(server: LanguageServer, documents: Documents) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    def document_symbol(params: lsp.DocumentSymbolParams) -> list[lsp.DocumentSymbol] | None:
        document = documents.get(params.text_document.uri)
        if document is None:
            return None
        main = documents.loaded(document).main
        return symbols.outline(main, documents.lines(main.source))

    @server.feature(lsp.WORKSPACE_SYMBOL)
    def workspace_symbol(params: lsp.WorkspaceSymbolParams) -> list[lsp.WorkspaceSymbol]:
        files = {f.path.resolve(): f for f in documents.every_file()}
        matches = list(symbols.matching(list(files.values()), params.query))
        return [
            lsp.WorkspaceSymbol(documents.location(decl.name.span), decl.name.text, kind)
            for decl, kind, _ in matches[:SYMBOLS_MAX]
        ]
