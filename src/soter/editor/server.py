"""`soter lsp`: the server, and when it checks.

Purpose: the protocol's requests to the files that answer them; a check soon after the last
keystroke, in this process and thread, one document at a time.
Non-goals: what is answered.
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
from soter.editor.requests import answer
from soter.version import VERSION

if TYPE_CHECKING:
    from pygls.server import ServerErrors

    from soter.editor.requests import Verdicts

HEAD_MAX, MESSAGE_MAX = 2**16, 2**28
"""Bytes of a line of a message's head, and of its body."""
SETTLE_S = 0.01
"""So long nothing may come before a check begins: of a burst of keystrokes only the last counts."""


class Server(LanguageServer):
    """The protocol's side: documents in, diagnostics out."""

    def __init__(self) -> None:
        super().__init__("soter", VERSION, lsp.TextDocumentSyncKind.Full)
        self.documents = Documents(self._publish)
        self._timer: asyncio.TimerHandle | None = None
        self._apologised = False

    def report_server_error(self, error: Exception, source: ServerErrors) -> None:
        """Tell the editor; what could not be sent is not told by sending, without end."""
        if source is not JsonRpcInternalError:
            super().report_server_error(error, source)

    def soon(self) -> None:
        """Check what waits, once nothing more comes."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self.documents.waiting:
            self._timer = asyncio.get_running_loop().call_later(SETTLE_S, self._check)

    def _check(self) -> None:
        """One document; then whoever asked meanwhile has the floor."""
        self._timer = None
        try:
            self.documents.check_next()
        except Exception as error:  # noqa: BLE001 - a defect: say so, and go on serving
            self._apologise(error)
        if self.documents.waiting:
            self._timer = asyncio.get_running_loop().call_later(0, self._check)

    def _apologise(self, error: Exception) -> None:
        traceback.print_exception(error, file=sys.stderr)
        if not self._apologised:
            self._apologised = True
            text = f"soter: a defect in the checker ({type(error).__name__}); please report it"
            self.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Error, text))

    def _publish(self, uri: str, version: int | None, items: list[lsp.Diagnostic]) -> None:
        self.text_document_publish_diagnostics(lsp.PublishDiagnosticsParams(uri, items, version))


def made(verdicts: Verdicts) -> Server:
    """A server with all requests, and for the lenses what was proved of a program."""
    server = Server()
    _documents(server)
    answer(server, server.documents, verdicts)
    return server


def _documents(server: Server) -> None:
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
        documents.opened(document.uri, document.version, document.text)
        server.soon()

    @server.feature(lsp.TEXT_DOCUMENT_DID_CHANGE)
    def did_change(params: lsp.DidChangeTextDocumentParams) -> None:
        document = params.text_document
        text = server.workspace.get_text_document(document.uri).source
        documents.changed(document.uri, document.version, text)
        server.soon()

    @server.feature(lsp.TEXT_DOCUMENT_DID_CLOSE)
    def did_close(params: lsp.DidCloseTextDocumentParams) -> None:
        documents.closed(params.text_document.uri)
        server.soon()

    @server.feature(lsp.TEXT_DOCUMENT_DID_SAVE)
    def did_save(params: lsp.DidSaveTextDocumentParams) -> None:
        documents.touched([path_of(params.text_document.uri)])
        server.soon()

    @server.feature(lsp.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    def did_change_watched(params: lsp.DidChangeWatchedFilesParams) -> None:
        paths = [path_of(change.uri) for change in params.changes]
        documents.touched(p for p in paths if p.suffix == ".soter")
        if any(p.suffix != ".soter" for p in paths):
            documents.touched_data()
        server.soon()


class _Refusals(logging.Filter):
    """A request that is refused with a reason is no defect: nothing is logged."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the record is worth a line."""
        error = record.exc_info[1] if record.exc_info else None
        return not isinstance(error, JsonRpcInvalidRequest)


def serve(verdicts: Verdicts, tcp: tuple[str, int] | None = None) -> None:
    """Serve one client over standard input and output, or over `tcp` (host, port), to its end.

    `SoterError` D005 where standard input is no stream of the protocol.
    """
    server = made(verdicts)
    logging.getLogger("pygls.protocol.json_rpc").addFilter(_Refusals())
    if tcp is not None:
        server.start_tcp(*tcp)
        return
    # what the editor reads are messages, and nothing else; pygls closes the stream at the end
    out = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    with redirect_stdout(sys.stderr):
        try:
            server.start_io(_Stream(sys.stdin.buffer), out)  # type: ignore[arg-type]
        except (OverflowError, ValueError, MemoryError) as error:
            text = f"standard input is no stream of the language server protocol: {error}"
            raise SoterError((Diagnostic("D005", text),)) from error


class _Stream:
    """What an editor says; ValueError where a message, or a line of its head, is out of measure."""

    def __init__(self, raw: BinaryIO) -> None:
        self._raw = raw

    def readline(self) -> bytes:
        """A line of the head."""
        line = self._raw.readline(HEAD_MAX + 1)
        if len(line) > HEAD_MAX:
            raise ValueError(f"a line of its head is longer than {HEAD_MAX} bytes")
        return line

    def read(self, count: int) -> bytes:
        """The body of a message."""
        if count > MESSAGE_MAX:
            raise ValueError(f"a message of more than {MESSAGE_MAX >> 20} MiB")
        return self._raw.read(count)

    def close(self) -> None:
        """Nothing more is read."""
        self._raw.close()
