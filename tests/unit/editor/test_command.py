"""`soter lsp` as a command, and what is written while it is not finished."""

from __future__ import annotations

import asyncio
import socket
import sys
from pathlib import Path

import pytest
from lsprotocol import types as lsp
from pytest_lsp import LanguageClient

import processes
from soter.cli.main import main
from soter.editor import symbols
from soter.editor.completion import completion_items
from soter.editor.documents import Documents
from soter.editor.hover import hover_text
from soter.editor.protocol_conversions import uri_of

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
STEP = 97


def test_without_pygls_it_says_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [n for n in sys.modules if n.startswith(("pygls", "lsprotocol", "soter.editor"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pygls", None)
    monkeypatch.setitem(sys.modules, "lsprotocol", None)
    assert main(["lsp"]) == 1
    assert "pip install 'soter-rta[editor]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--tcp", "0"], "no port"),
        (["--tcp", "70000"], "no port"),
        (["--tcp", "7000", "--stdio"], "not both"),
        (["file.soter"], "unrecognized"),
    ],
)
def test_a_wrong_command_line_is_refused(
    arguments: list[str], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["lsp", *arguments]) == 2
    assert why in capsys.readouterr().err


def test_standard_output_is_the_editor_s() -> None:
    command = [sys.executable, "-m", "soter.cli.main", "lsp", "--json"]
    done = processes.run(command, capture_output=True, text=True, stdin=processes.PIPE)
    assert done.returncode == 2


def test_an_editor_may_come_over_a_port(tmp_path: Path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "soter.cli.main", "lsp", "--tcp", str(port)]

    async def talk() -> str:
        client = LanguageClient()
        for _ in range(6000):
            try:
                await client.start_tcp("127.0.0.1", port)
                break
            except OSError:
                await asyncio.sleep(0.1)
        told = asyncio.get_running_loop().create_future()

        def published(params: lsp.PublishDiagnosticsParams) -> None:
            told.set_result(params.diagnostics[0].message)

        client.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)(published)
        await client.initialize_session(lsp.InitializeParams(lsp.ClientCapabilities()))
        uri = (tmp_path / "a.soter").as_uri()
        item = lsp.TextDocumentItem(uri, "soter", 1, "soter 1;\nconst A: float = B;\n")
        client.text_document_did_open(lsp.DidOpenTextDocumentParams(item))
        message = await asyncio.wait_for(told, processes.TIMEOUT_S)
        await client.shutdown_session()
        return str(message)

    with processes.started(command, stderr=processes.PIPE):
        assert asyncio.run(talk()).startswith("unknown name `B`")


@pytest.mark.parametrize("name", ["wall/cart", "drone/planner", "testing/three_modules"])
@pytest.mark.long
def test_a_program_may_end_anywhere(name: str) -> None:
    """Whatever part of a program is there, every question has an answer."""
    path = EXAMPLES / f"{name}.soter"
    text = path.read_text(encoding="utf-8")
    documents = Documents(lambda *_: None)
    uri = uri_of(path)
    documents.open(uri, 1, text)
    document = documents.document_of(uri)
    assert document is not None
    documents.check_if_waiting(document)
    for end in range(0, len(text), STEP):
        for part in (text[:end], text[:end] + text[end + STEP // 2 :]):
            documents.update(uri, 1, part)
            documents.check_if_waiting(document)
            loaded, index = documents.parsed_names(document)
            main = loaded.main
            completion_items(part, end, main, index, document.good_index)
            symbols.document_symbols(main, documents.lines(main.source))
            for use in index.uses_in(main.source):
                if abs(use.span.start - end) < STEP:
                    assert hover_text(use.definition, document.good)


def test_what_cannot_be_sent_is_not_told_by_sending() -> None:
    """An editor that is gone: a server told that it could not tell, and so on without end."""
    pytest.importorskip("pygls", reason="the extra is absent: soter-rta[editor]")
    from lsprotocol import types as lsp

    from soter.editor.server import Server

    class Gone:
        sent = 0

        def write(self, data: bytes) -> None:
            self.sent += 1
            assert self.sent < 10, data
            raise RuntimeError("the transport is closed")

        def close(self) -> None:
            """It is."""

    server, gone = Server(), Gone()
    server.protocol.set_writer(gone)
    server.window_show_message(lsp.ShowMessageParams(lsp.MessageType.Error, "text"))
    assert gone.sent == 1
