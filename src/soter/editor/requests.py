"""Registers the editor's requests, and answers each or passes it to the file that does.

Purpose: `register_requests` converts positions to offsets and back, and finds the program and the
name of a request. `code_actions` turns the edits that a diagnostic brings into code actions.
`code_lenses` shows the last verdict on a module and what proves it, or what runs a system or a
test; the command line of a lens is handed to the editor, which shows it in a terminal.
Non-goals: when to check, what is open (`server.py`, `documents.py`); which edits there are (whoever
reports a problem says so); proving and running: this process checks, and nothing else.
"""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any, Protocol

from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcInvalidRequest

from soter.diagnostics.diagnostic import Diagnostic, Diagnostics, Source, Span
from soter.editor import renaming, symbols
from soter.editor.completion import completion_items
from soter.editor.hover import hover_text
from soter.editor.language_words import word_meaning
from soter.editor.protocol_conversions import AGAIN, Lines, path_of_span, range_of, shown_by_file
from soter.language.load.loader import LoadedFile
from soter.language.model.types import show_ns
from soter.language.syntax import tree
from soter.language.syntax.lexer import lex
from soter.language.syntax.printer import format_source

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from pygls.lsp.server import LanguageServer

    from soter.editor.documents import Document, Documents
    from soter.editor.name_definitions import Definition, NameIndex, Use
    from soter.language.front_end import CheckResult

    Verdicts = Callable[[Path], Sequence[dict[str, Any]]]


ASKED = "did you mean "


def code_actions(
    document: Document, documents: Documents, wanted: lsp.Range
) -> Iterator[lsp.CodeAction]:
    """Yields the fixes for problems that touch the range `wanted` of a checked document."""
    checked = document.checked
    if checked is None or checked.loaded is None:
        return
    lines = documents.lines(checked.loaded.main.source)
    start, end = lines.offset(wanted.start), lines.offset(wanted.end)
    for d in checked.diagnostics.items:
        if d.primary is None or d.primary.span.source is not checked.loaded.main.source:
            continue
        spans = [d.primary.span, *(o.span for o in d.secondary if o.text == AGAIN)]
        if any(s.start <= end and start <= s.end for s in spans):
            yield from _fix_actions(d, documents)


def _fix_actions(d: Diagnostic, documents: Documents) -> Iterator[lsp.CodeAction]:
    assert d.primary is not None
    shown = shown_by_file([d], path_of_span(d.primary.span), documents.lines_of)
    problems = shown[path_of_span(d.primary.span)][:1]
    for number, fix in enumerate(d.fixes):
        yield lsp.CodeAction(
            title=_fix_title(fix.title),
            kind=lsp.CodeActionKind.QuickFix,
            diagnostics=problems,
            is_preferred=number == 0 and len(d.fixes) == 1,
            edit=workspace_edit(((e.span, e.text) for e in fix.edits), documents),
        )


def _fix_title(help_: str) -> str:
    """A help line as a title in the imperative, such as `Write ...` or `Change to ...`."""
    if help_.startswith(ASKED):
        help_ = "change to " + help_.removeprefix(ASKED).removesuffix("?")
    return help_[:1].upper() + help_[1:]


def workspace_edit(edits: Iterable[tuple[Span, str]], documents: Documents) -> lsp.WorkspaceEdit:
    """The edit, in the protocol's form, that writes texts at spans in any files."""
    changes: dict[str, list[lsp.TextEdit]] = {}
    for span, text in edits:
        uri = documents.uri(path_of_span(span))
        where = range_of(span, documents.lines_of)
        changes.setdefault(uri, []).append(lsp.TextEdit(where, text))
    return lsp.WorkspaceEdit(changes)


TERMINAL = "soter.terminal"
"""The editor's command that runs a command line in a terminal, with `{command, cwd}`."""
SHOWN = {"proved": "proved", "refuted": "REFUTED", "undecided": "undecided", "assumed": "assumed"}


def code_lenses(
    file: LoadedFile, lines: Lines, checked: CheckResult | None, verdicts: Verdicts
) -> Iterator[lsp.CodeLens]:
    """Yields the lenses of a file; `checked`: the check of its present text, or None."""
    path = file.path
    modules = [d for d in file.file.declarations if isinstance(d, tree.RtaDecl)]
    records = list(verdicts(path)) if modules else []
    sha256 = checked.program.sha256 if checked is not None and checked.program is not None else ""
    for decl in file.file.declarations:
        name = decl.name.text
        if isinstance(decl, tree.RtaDecl):
            where = lines.range(decl.span.start, decl.span.start)
            command = ["soter", "verify", path.name, "--module", name]
            for text in _verdict_texts(name, records, sha256):
                yield _code_lens(where, text, command, path)
            yield _code_lens(where, "prove", command, path)
        elif isinstance(decl, tree.SystemDecl):
            where = lines.range(decl.span.start, decl.span.start)
            yield _code_lens(where, "run", ["soter", "run", path.name, "--system", name], path)
        elif isinstance(decl, tree.TestDecl):
            where = lines.range(decl.span.start, decl.span.start)
            yield _code_lens(where, "run", ["soter", "test", path.name, "--test", name], path)


def _code_lens(where: lsp.Range, title: str, command: list[str], path: Path) -> lsp.CodeLens:
    arguments: list[lsp.LSPAny] = [{"command": command, "cwd": os.fspath(path.parent)}]
    return lsp.CodeLens(where, lsp.Command(title, TERMINAL, arguments=arguments))


def _verdict_texts(name: str, records: list[dict[str, Any]], sha256: str) -> Iterator[str]:
    """Yields the last proof's verdict on a module, one line for each view."""
    mine = [
        (r["program_sha256"] == sha256, full, fields)
        for r in records
        for full, fields in r["modules"].items()
        if full == name or full.startswith(f"{name} as ")
    ]
    if now := [(full, fields) for same, full, fields in mine if same]:
        yield from (_verdict_text(full.removeprefix(name), fields) for full, fields in now)
    elif mine:
        _, _, fields = mine[0]
        yield f"changed since it was {SHOWN.get(fields['verdict'], fields['verdict'])}"
    else:
        yield "no proof yet"


def _verdict_text(view: str, fields: dict[str, Any]) -> str:
    verdict = SHOWN.get(fields["verdict"], fields["verdict"]) + view + f" in {fields['system']}"
    if fields["headline"] != fields["verdict"]:
        verdict += f", but {fields['headline']}"
    if fields["verdict"] not in ("proved", "assumed"):
        worst = [n for n, v in fields["properties"].items() if v == fields["verdict"]]
        verdict += f": {', '.join(worst)}"
    parts = [verdict]
    if fields["horizon_ns"] is not None and fields["horizon_needed_ns"] is not None:
        spare = fields["horizon_ns"] - fields["horizon_needed_ns"]
        side = "above" if spare > 0 else "below"
        parts.append(f"H is {show_ns(abs(spare))} {side} H*" if spare else "H is H*")
    stamp = time.strftime("%Y-%m-%d %H:%M", time.localtime(fields["when_s"]))
    parts.append(f"{stamp}, in {fields['seconds']:.1f} s")
    return " · ".join(parts)


SYMBOLS_MAX = 200


class _CursorPosition:
    """A position in an open document, with its program, its names and its offset."""

    def __init__(self, documents: Documents, document: Document, position: lsp.Position) -> None:
        self.documents = documents
        self.document = document
        self.loaded, self.index = documents.parsed_names(document)
        self.main: LoadedFile = self.loaded.main
        self.lines: Lines = documents.lines(self.main.source)
        self.offset = self.lines.offset(position)

    def use(self) -> Use | None:
        """The use of a name at the position; None if the position has no name."""
        return self.index.use_at(self.main.source, self.offset)

    def word_range(self) -> tuple[int, int]:
        """Start and end offset of the word at the position."""
        text = self.main.source.text
        start = end = self.offset
        while start and (text[start - 1].isalnum() or text[start - 1] == "_"):
            start -= 1
        while end < len(text) and (text[end].isalnum() or text[end] == "_"):
            end += 1
        return start, end


def register_requests(server: LanguageServer, documents: Documents, verdicts: Verdicts) -> None:
    """Registers the handlers of all requests that the server answers."""
    _register_name_requests(server, documents)
    _register_rename_requests(server, documents)
    _register_text_requests(server, documents)
    _register_lens_requests(server, documents, verdicts)
    _register_workspace_requests(server, documents)


class _PositionRequest(Protocol):
    """The parameters of a request about a position in a document."""

    text_document: lsp.TextDocumentIdentifier
    position: lsp.Position


def _cursor_position(documents: Documents, params: _PositionRequest) -> _CursorPosition | None:
    document = documents.document_of(params.text_document.uri)
    return None if document is None else _CursorPosition(documents, document, params.position)


def _name_at(
    documents: Documents, params: _PositionRequest
) -> tuple[_CursorPosition, Use] | tuple[None, None]:
    """The position, and the use of a name at it; (None, None) if it has no name."""
    at = _cursor_position(documents, params)
    use = None if at is None else at.use()
    return (None, None) if at is None or use is None else (at, use)


# ---------------------------------------------------------------- names


def _register_name_requests(server: LanguageServer, documents: Documents) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_HOVER)
    def hover(params: lsp.HoverParams) -> lsp.Hover | None:
        at = _cursor_position(documents, params)
        return None if at is None else _hover_at(at)

    @server.feature(lsp.TEXT_DOCUMENT_DEFINITION)
    def definition(params: lsp.DefinitionParams) -> lsp.Location | None:
        _, use = _name_at(documents, params)
        if use is None:
            return None
        definition = use.definition
        if use.is_declaration and isinstance(definition.of, LoadedFile):
            return documents.location(Span(definition.of.source, 0, 0))
        return documents.location(definition.span)

    @server.feature(lsp.TEXT_DOCUMENT_REFERENCES)
    def references(params: lsp.ReferenceParams) -> list[lsp.Location] | None:
        at, use = _name_at(documents, params)
        if at is None or use is None:
            return None
        indices = [index for _, index in _programs_naming(at, use.definition)]
        uses = renaming.uses_of(use.definition, indices)
        declared = params.context.include_declaration
        return [documents.location(u.span) for u in uses if declared or not u.is_declaration]

    @server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_HIGHLIGHT)
    def highlight(params: lsp.DocumentHighlightParams) -> list[lsp.DocumentHighlight] | None:
        at, use = _name_at(documents, params)
        if at is None or use is None:
            return None
        uses = at.index.uses_of(use.definition.key)
        here = [u.span for u in uses if u.span.source is at.main.source]
        return [lsp.DocumentHighlight(at.lines.range(s.start, s.end)) for s in here]


def _register_rename_requests(server: LanguageServer, documents: Documents) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_PREPARE_RENAME)
    def prepare_rename(params: lsp.PrepareRenameParams) -> lsp.PrepareRenamePlaceholder | None:
        at, use = _name_at(documents, params)
        if at is None or use is None:
            return None
        try:
            renaming.require_name(use.definition, use.definition.name)
        except renaming.RefusedError:
            return None
        where = at.lines.range(use.span.start, use.span.end)
        return lsp.PrepareRenamePlaceholder(where, use.definition.name)

    @server.feature(lsp.TEXT_DOCUMENT_RENAME, lsp.RenameOptions(prepare_provider=True))
    def rename(params: lsp.RenameParams) -> lsp.WorkspaceEdit | None:
        at, use = _name_at(documents, params)
        if at is None or use is None:
            return None
        programs = [path for path, _ in _programs_naming(at, use.definition)]
        try:
            spans = renaming.rename_spans(
                use.definition, params.new_name, programs, documents.reading
            )
        except renaming.RefusedError as refused:
            raise JsonRpcInvalidRequest(str(refused)) from None
        return workspace_edit(((span, params.new_name) for span in spans), documents)


def _hover_at(at: _CursorPosition) -> lsp.Hover | None:
    if (use := at.use()) is not None:
        text = hover_text(use.definition, at.document.good)
        where = at.lines.range(use.span.start, use.span.end)
    else:
        start, end = at.word_range()
        text_of_word = word_meaning(at.main.source.text[start:end])
        if text_of_word is None or (start not in lex(at.main.source).starts):
            return None
        text, where = text_of_word, at.lines.range(start, end)
    return lsp.Hover(lsp.MarkupContent(lsp.MarkupKind.Markdown, text), where)


def _programs_naming(at: _CursorPosition, definition: Definition) -> list[tuple[Path, NameIndex]]:
    """The programs that may name a definition; for a local, only the program that has it."""
    if definition.kind in LOCAL:
        return [(at.document.path, at.index)]
    return at.documents.programs_naming(definition.name, at.document)


LOCAL = {"argument", "variable", "let", "loop variable", "disturbance", "clause", "measure", "view"}


# ---------------------------------------------------------------- text


def _register_text_requests(server: LanguageServer, documents: Documents) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_COMPLETION, lsp.CompletionOptions(trigger_characters=["."]))
    def completion(params: lsp.CompletionParams) -> list[lsp.CompletionItem] | None:
        at = _cursor_position(documents, params)
        if at is None:
            return None
        good = at.document.good_index
        return completion_items(at.document.text, at.offset, at.main, at.index, good)

    @server.feature(lsp.TEXT_DOCUMENT_FORMATTING)
    def formatting(params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit] | None:
        document = documents.document_of(params.text_document.uri)
        if document is None:
            return None
        source = Source(str(document.path), document.text)
        laid_out = format_source(source, Diagnostics())
        if laid_out is None or laid_out == document.text:
            return []
        return [lsp.TextEdit(documents.lines(source).whole_range(), laid_out)]

    @server.feature(
        lsp.TEXT_DOCUMENT_CODE_ACTION,
        lsp.CodeActionOptions(code_action_kinds=[lsp.CodeActionKind.QuickFix]),
    )
    def code_action(params: lsp.CodeActionParams) -> list[lsp.CodeAction] | None:
        document = documents.document_of(params.text_document.uri)
        if document is None:
            return None
        documents.check_if_waiting(document)
        return list(code_actions(document, documents, params.range))


def _register_lens_requests(
    server: LanguageServer, documents: Documents, verdicts: Verdicts
) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_CODE_LENS)
    def code_lens(params: lsp.CodeLensParams) -> list[lsp.CodeLens] | None:
        document = documents.document_of(params.text_document.uri)
        if document is None:
            return None
        documents.check_if_waiting(document)
        main = documents.parsed_program(document).main
        return list(code_lenses(main, documents.lines(main.source), document.checked, verdicts))


# ---------------------------------------------------------------- the workspace


def _register_workspace_requests(server: LanguageServer, documents: Documents) -> None:
    @server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    def document_symbol(params: lsp.DocumentSymbolParams) -> list[lsp.DocumentSymbol] | None:
        document = documents.document_of(params.text_document.uri)
        if document is None:
            return None
        main = documents.parsed_program(document).main
        return symbols.document_symbols(main, documents.lines(main.source))

    @server.feature(lsp.WORKSPACE_SYMBOL)
    def workspace_symbol(params: lsp.WorkspaceSymbolParams) -> list[lsp.WorkspaceSymbol]:
        files = {f.path.resolve(): f for f in documents.every_file()}
        matches = list(symbols.matching_declarations(list(files.values()), params.query))
        return [
            lsp.WorkspaceSymbol(documents.location(decl.name.span), decl.name.text, kind)
            for decl, kind, _ in matches[:SYMBOLS_MAX]
        ]
