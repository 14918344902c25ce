"""An editor for tests: pytest-lsp's client, which knows the protocol, and a server in a process.

Purpose: open, type and ask in a test's own thread; what the server says on its own is kept.
Non-goals: what answers should be.
"""

from __future__ import annotations

import asyncio
import itertools
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from lsprotocol import types as lsp
from pygls.io_ import StdinAsyncReader, StdoutWriter, run_async
from pytest_lsp import LanguageClient, client_capabilities

import processes

if TYPE_CHECKING:
    from collections.abc import Awaitable, Iterable, Iterator
    from pathlib import Path

ANSWER_S = processes.TIMEOUT_S


class Editor:
    """One client and its server. Positions are (line, character), both from 0."""

    def __init__(
        self, loop: asyncio.AbstractEventLoop, client: LanguageClient, server: int
    ) -> None:
        self.client = client
        self.server = server
        """The server's process."""
        self._loop = loop
        self._versions = itertools.count(1)
        self.published: list[lsp.PublishDiagnosticsParams] = []
        self._news = asyncio.Event()

        def published(params: lsp.PublishDiagnosticsParams) -> None:
            self.published.append(params)
            self._news.set()

        client.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)(published)

    def ask(self, answer: Awaitable[Any]) -> Any:
        """Wait for an answer."""
        return self._loop.run_until_complete(asyncio.wait_for(answer, ANSWER_S))

    # ------------------------------------------------------------ documents

    def open(self, path: Path, text: str | None = None) -> str:
        """Open a file, with another text than it has on the disk if one is given; its URI."""
        uri = path.as_uri()
        text = path.read_text(encoding="utf-8") if text is None else text
        item = lsp.TextDocumentItem(uri, "soter", next(self._versions), text)
        self.client.text_document_did_open(lsp.DidOpenTextDocumentParams(item))
        return uri

    def type(self, uri: str, text: str) -> int:
        """Replace the text of a document; its version."""
        version = next(self._versions)
        self.client.text_document_did_change(
            lsp.DidChangeTextDocumentParams(
                lsp.VersionedTextDocumentIdentifier(version, uri),
                [lsp.TextDocumentContentChangeWholeDocument(text)],
            )
        )
        return version

    def close(self, uri: str) -> None:
        """Close a document."""
        identifier = lsp.TextDocumentIdentifier(uri)
        self.client.text_document_did_close(lsp.DidCloseTextDocumentParams(identifier))

    def diagnostics(self, uri: str, version: int | None = None) -> list[lsp.Diagnostic]:
        """What is published next of a document, or of this version of it."""

        async def wait() -> list[lsp.Diagnostic]:
            while True:
                for params in self.published:
                    if params.uri == uri and version in (None, params.version):
                        del self.published[: self.published.index(params) + 1]
                        return list(params.diagnostics)
                self._news.clear()
                await self._news.wait()

        diagnostics: list[lsp.Diagnostic] = self.ask(wait())
        return diagnostics

    def checked(self, path: Path, text: str | None = None) -> tuple[str, list[lsp.Diagnostic]]:
        """Open a file and wait for what is said about it."""
        uri = self.open(path, text)
        return uri, self.diagnostics(uri)


@contextmanager
def editor(folder: Path, *, encodings: tuple[str, ...] = ("utf-16",)) -> Iterator[Editor]:
    """An editor that has `folder` open, and a server that ends with the block."""
    command = [sys.executable, "-m", "soter.cli.main", "lsp"]
    loop = asyncio.new_event_loop()
    errors: list[bytes] = []
    with processes.started(
        command, stdin=processes.PIPE, stdout=processes.PIPE, stderr=processes.PIPE, cwd=folder
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        said_by = process.stderr
        listener = threading.Thread(target=lambda: errors.extend(said_by), daemon=True)
        listener.start()
        client = LanguageClient()
        made = Editor(loop, client, process.pid)
        stop = threading.Event()
        with ThreadPoolExecutor(1) as pool:
            client.protocol.set_writer(StdoutWriter(cast("BinaryIO", process.stdin)))
            reader = StdinAsyncReader(cast("BinaryIO", process.stdout), pool)
            running = loop.create_task(run_async(stop, reader, client.protocol))
            capabilities = client_capabilities("visual-studio-code")
            assert capabilities.general is not None
            capabilities.general.position_encodings = list(encodings)
            made.ask(
                client.initialize_session(
                    lsp.InitializeParams(
                        capabilities=capabilities,
                        workspace_folders=[lsp.WorkspaceFolder(folder.as_uri(), "folder")],
                    )
                )
            )
            try:
                yield made
                made.ask(client.shutdown_session())
                assert process.wait(ANSWER_S) == 0, b"".join(errors).decode()
            finally:
                process.kill()
                stop.set()
                running.cancel()
                loop.run_until_complete(asyncio.gather(running, return_exceptions=True))
                listener.join(ANSWER_S)
                loop.close()
    said = b"".join(errors).decode()
    assert "Traceback" not in said, said


def place(text: str, words: str, behind: int = 0) -> lsp.Position:
    """The position of the first occurrence of some words, or so many characters behind it."""
    offset = text.index(words) + behind
    line_start = text.rfind("\n", 0, offset) + 1
    return lsp.Position(text.count("\n", 0, offset), offset - line_start)


def edited(text: str, edits: Iterable[lsp.TextEdit]) -> str:
    """An ASCII text after the edits."""
    lines = text.splitlines(keepends=True)
    starts = [sum(map(len, lines[:i])) for i in range(len(lines) + 1)]

    def offset(p: lsp.Position) -> int:
        return min(starts[min(p.line, len(lines))] + p.character, len(text))

    for e in sorted(edits, key=lambda e: (e.range.start.line, e.range.start.character))[::-1]:
        text = text[: offset(e.range.start)] + e.new_text + text[offset(e.range.end) :]
    return text
