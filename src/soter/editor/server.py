"""The server of `soter lsp`: it receives documents, and decides when to check them.

Purpose: handles the protocol, and checks soon after the last keystroke, in this process and thread,
one document at a time.
Non-goals: answers to requests (`requests.py`).
"""

from __future__ import annotations

import asyncio
import logging
import os
import sys
import traceback
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, BinaryIO

from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcInternalError, JsonRpcInvalidRequest
from pygls.lsp.server import LanguageServer

from soter.diagnostics.diagnostic import Diagnostic, SoterError
from soter.editor.documents import Documents
from soter.editor.protocol_conversions import path_of
from soter.editor.requests import register_requests
from soter.version import VERSION

if TYPE_CHECKING:
    from pygls.server import ServerErrors

    from soter.editor.requests import Verdicts

HEAD_MAX, MESSAGE_MAX = 2**16, 2**28
"""Most bytes of a line of a message's head, and of its body."""
SETTLE_S = 0.01
"""Seconds without a message before a check begins, so that quick keystrokes cause only one."""


class Server(LanguageServer):
    """The language server: it takes documents and publishes diagnostics."""

    def __init__(self) -> None:
        super().__init__("soter", VERSION, lsp.TextDocumentSyncKind.Full)
        self.documents = Documents(self._publish)
        self._timer: asyncio.TimerHandle | None = None
        self._apologised = False

    def report_server_error(self, error: Exception, source: ServerErrors) -> None:
        """Reports an error to the editor, except if sending failed, as that would happen again."""
        if source is not JsonRpcInternalError:
            super().report_server_error(error, source)

    def check_soon(self) -> None:
        """Checks waiting documents as soon as no more messages arrive."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self.documents.waiting:
            self._timer = asyncio.get_running_loop().call_later(SETTLE_S, self._check_one)

    def _check_one(self) -> None:
        """Checks one document; the server answers waiting requests before it checks the next."""
        self._timer = None
        try:
            self.documents.check_next()
        except Exception as error:  # noqa: BLE001 - a defect: say so, and go on serving
            self._apologise(error)
        if self.documents.waiting:
            self._timer = asyncio.get_running_loop().call_later(0, self._check_one)

    def _apologise(self, error: Exception) -> None:
        traceback.print_exception(error, file=sys.stderr)
        if not self._apologised:
            self._apologised = True
            text = f"soter: a defect in the checker ({type(error).__name__}); please report it"
            self.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Error, text))

    def _publish(self, uri: str, version: int | None, items: list[lsp.Diagnostic]) -> None:
        self.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, items, version))


def make_server(verdicts: Verdicts) -> Server:
    """A server for all requests; `verdicts` finds the last proofs of a program."""
    server = Server()
    _register_document_events(server)
    register_requests(server, server.documents, verdicts)
    return server


def _register_document_events(server: Server) -> None:
    documents = server.documents

    @server.feature(lsp.INITIALIZED)
    def initialized(_: lsp.InitializedParams) -> None:
        encoding = server.workspace.position_encoding or "utf-16"
        documents.encoding = str(getattr(encoding, "value", encoding))
        folders = server.workspace.folders.values()
        documents.folders = tuple(path_of(folder.uri) for folder in folders)

    @server.feature(lsp.TEXT_DOCUMENT_DID_OPEN)
    def did_open(params: lsp.DidOpenTextDocumentParams) -> None:
        document = params.text_document
        documents.open(document.uri, document.version, document.text)
        server.check_soon()

    @server.feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
    def did_change(params: lsp.DidChangeTextDocumentParams) -> None:
        document = params.text_document
        text = server.workspace.get_text_document(document.uri).source
        documents.update(document.uri, document.version, text)
        server.check_soon()

    @server.feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
    def did_close(params: lsp.DidCloseTextDocumentParams) -> None:
        documents.close(params.text_document.uri)
        server.check_soon()

    @server.feature(lsp.TEXT_DOCUMENT_DID_SAVE)
    def did_save(params: lsp.DidSaveTextDocumentParams) -> None:
        documents.mark_changed([path_of(params.text_document.uri)])
        server.check_soon()

    @server.feature(lsp.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    def did_change_watched(params: lsp.DidChangeWatchedFilesParams) -> None:
        paths = [path_of(change.uri) for change in params.changes]
        documents.mark_changed(p for p in paths if p.suffix == ".soter")
        if any(p.suffix != ".soter" for p in paths):
            documents.mark_all_changed()
        server.check_soon()


class _RefusalFilter(logging.Filter):
    """Keeps out of the log those requests that were refused with a reason, not by a defect."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether to log the record."""
        error = record.exc_info[1] if record.exc_info else None
        return not isinstance(error, JsonRpcInvalidRequest)


def serve(verdicts: Verdicts, tcp: tuple[str, int] | None = None) -> None:
    """Serves one client over standard input and output, or over `tcp` (host, port), until it ends.

    Raises `SoterError` D005 if standard input does not follow the protocol.
    """
    server = make_server(verdicts)
    logging.getLogger("pygls.protocol.json_rpc").addFilter(_RefusalFilter())
    if tcp is not None:
        server.start_tcp(*tcp)
        return
    # the editor must read nothing but messages; pygls closes the stream at the end
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    with redirect_stdout(sys.stderr):
        try:
            server.start_io(_EditorMessages(sys.stdin.buffer), out)  # type: ignore[arg-type]
        except (OverflowError, ValueError, MemoryError) as error:
            text = f"standard input is no stream of the language server protocol: {error}"
            raise SoterError((Diagnostic("D005", text),)) from error


class _EditorMessages:
    """Reads the editor's messages; ValueError if a message, or a line of its head, is too long."""

    def __init__(self, raw: BinaryIO) -> None:
        self._raw = raw

    def readline(self) -> bytes:
        """A line of the head of a message."""
        line = self._raw.readline(HEAD_MAX + 1)
        if len(line) > HEAD_MAX:
            raise ValueError(f"a line of its head is longer than {HEAD_MAX} bytes")
        return line

    def read(self, count: int) -> bytes:
        """The body of a message, of `count` bytes."""
        if count > MESSAGE_MAX:
            raise ValueError(f"a message of more than {MESSAGE_MAX >> 20} MiB")
        return self._raw.read(count)

    def close(self) -> None:
        """Stops reading messages."""
        self._raw.close()
