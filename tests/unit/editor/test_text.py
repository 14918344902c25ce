"""Layout, fixes and lenses in the editor."""

from __future__ import annotations

from pathlib import Path

import pytest
from lsprotocol import types as lsp

from editor_client import Editor, edited
from soter.diagnostics.diagnostic import Source
from soter.diagnostics.fixes import apply_fix
from soter.editor import requests as lenses
from soter.editor.documents import Documents
from soter.editor.protocol_conversions import Lines, path_of, uri_of
from soter.editor.requests import code_actions
from soter.language.front_end import check_file
from soter.verify import proof_cache
from tables import all_rows

WRONG = sorted((Path(__file__).resolve().parents[2] / "static_error").glob("**/*.soter"))
START = lsp.Position(0, 0)
END = lsp.Position(10_000, 0)


def test_a_document_is_laid_out(served: Editor, tmp_path: Path) -> None:
    text = "soter 1;\nconst   A:float=1.0;\n\n\n\nconst B: float = 2.0;"
    uri, _ = served.checked(tmp_path / "a.soter", text)
    options = lsp.FormattingOptions(tab_size=2, insert_spaces=True)
    params = lsp.DocumentFormattingParams(lsp.TextDocumentIdentifier(uri), options)
    edits = served.ask(served.client.text_document_formatting_async(params))
    assert edited(text, edits) == "soter 1;\nconst A: float = 1.0;\n\nconst B: float = 2.0;\n"


def test_a_document_that_does_not_parse_stays_as_it_is(served: Editor, tmp_path: Path) -> None:
    uri, _ = served.checked(tmp_path / "a.soter", "soter 1;\nconst   A:float=;\n")
    options = lsp.FormattingOptions(tab_size=2, insert_spaces=True)
    params = lsp.DocumentFormattingParams(lsp.TextDocumentIdentifier(uri), options)
    assert list(served.ask(served.client.text_document_formatting_async(params))) == []


def test_a_help_that_is_an_edit_is_offered_and_mends(served: Editor, tmp_path: Path) -> None:
    text = "soter 1;\nconst A: bool = 1.0 & 2.0 < 3.0;\n"
    path = tmp_path / "a.soter"
    fixes = [(d, f) for d in check_file(str(path), text).diagnostics.items for f in d.fixes]
    uri, diagnostics = served.checked(path, text)
    assert diagnostics
    context = lsp.CodeActionContext(diagnostics=diagnostics)
    where = lsp.Range(START, END)
    params = lsp.CodeActionParams(lsp.TextDocumentIdentifier(uri), where, context)
    offered = served.ask(served.client.text_document_code_action_async(params))
    assert [a.title for a in offered] == ["Write `&&`"]
    assert len(fixes) == 1
    for action, (problem, _) in zip(offered, fixes, strict=True):
        mended = edited(text, action.edit.changes[uri])
        assert problem.code not in [d.code for d in check_file("a", mended).diagnostics.items]
    nowhere = lsp.CodeActionParams(
        lsp.TextDocumentIdentifier(uri), lsp.Range(START, START), context
    )
    assert list(served.ask(served.client.text_document_code_action_async(nowhere))) == []


def test_a_fix_of_all_places_is_offered_at_each(served: Editor, tmp_path: Path) -> None:
    text = "soter 1;\nconst WALL: float = 1.0;\nfun f(): float { return WALLS\n+ WALLS; }\n"
    uri, diagnostics = served.checked(tmp_path / "a.soter", text)
    for at in (lsp.Position(2, 26), lsp.Position(3, 4)):
        context = lsp.CodeActionContext(diagnostics=diagnostics)
        params = lsp.CodeActionParams(lsp.TextDocumentIdentifier(uri), lsp.Range(at, at), context)
        (action,) = served.ask(served.client.text_document_code_action_async(params))
        assert action.title == "Change to `WALL`"
        assert edited(text, action.edit.changes[uri]) == text.replace("WALLS", "WALL")


@pytest.mark.whole
@all_rows("path", WRONG, ids=lambda p: p.stem)
def test_every_edit_of_a_help_arrives_as_it_is_meant(path: Path) -> None:
    documents = Documents(lambda *_: None)
    uri = uri_of(path)
    documents.open(uri, 1, path.read_bytes().decode("utf-8", "replace"))
    document = documents.document_of(uri)
    assert document is not None
    documents.check_if_waiting(document)
    everything = lsp.Range(START, lsp.Position(100_000, 0))
    offered = [a.edit for a in code_actions(document, documents, everything)]
    checked = document.checked
    assert checked is not None
    assert checked.loaded is not None
    main = checked.loaded.main.source
    mine = [d for d in checked.diagnostics.items if d.primary and d.primary.span.source is main]
    meant = [apply_fix(f) for d in mine for f in d.fixes]
    assert len(offered) == len(meant)
    for edit, texts in zip(offered, meant, strict=True):
        assert edit is not None
        assert edit.changes is not None
        for source, text in texts.items():
            lines = documents.lines(source)
            after = source.text
            edits = edit.changes[uri_of(Path(source.name))]
            for e in sorted(edits, key=lambda e: lines.offset(e.range.start))[::-1]:
                start, end = lines.offset(e.range.start), lines.offset(e.range.end)
                after = after[:start] + e.new_text + after[end:]
            assert after == text


def test_lenses_stand_over_modules_systems_and_tests(served: Editor, wall: Path) -> None:
    uri, _ = served.checked(wall / "cart.soter")
    params = lsp.CodeLensParams(lsp.TextDocumentIdentifier(uri))
    code_lenses = served.ask(served.client.text_document_code_lens_async(params))
    assert [lens.command.title for lens in code_lenses] == ["no proof yet", "prove", "run", "run"]
    prove = code_lenses[1].command
    assert prove.command == "soter.terminal"
    assert prove.arguments[0] == {
        "command": ["soter", "verify", "cart.soter", "--module", "SafeCart"],
        "cwd": str(wall),
    }
    uri, _ = served.checked(wall / "cart_test.soter")
    params = lsp.CodeLensParams(lsp.TextDocumentIdentifier(uri))
    code_lenses = served.ask(served.client.text_document_code_lens_async(params))
    commands = [lens.command.arguments[0]["command"] for lens in code_lenses]
    assert ["soter", "test", "cart_test.soter", "--test"] in [c[:4] for c in commands]


def titles(path: Path) -> list[str]:
    """What stands over the file's modules."""
    checked = check_file(str(path))
    assert checked.loaded is not None
    main = checked.loaded.main
    lines = Lines(main.source.text)
    code_lenses = lenses.code_lenses(main, lines, checked, proof_cache.stored_verdicts_of_file)
    return [lens.command.title for lens in code_lenses if lens.command is not None]


def said(verdict: str, **more: object) -> dict[str, object]:
    plain: dict[str, object] = {"verdict": verdict, "headline": verdict, "seconds": 1.25}
    plain["system"] = "Flight"
    times = {"horizon_ns": 30_000_000, "horizon_needed_ns": 23_000_000}
    return {**plain, **times, "properties": {"P2a": verdict, "P2b": "proved"}, **more}


def test_a_verdict_is_shown_of_this_text_only(wall: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOTER_CACHE", str(wall / "cache"))
    path = wall / "cart.soter"
    program = check_file(str(path)).program
    assert program is not None
    assert titles(path)[:2] == ["no proof yet", "prove"]
    proof_cache.store_verdicts_of_file(path, program.sha256, {"SafeCart": said("proved")})
    verdict, when, _ = titles(path)[0].partition(" · 2")
    assert verdict == "proved in Flight · H is 7 ms above H*"
    assert when
    path.write_text(path.read_text(encoding="utf-8").replace("60s", "61s").replace("30s", "31s"))
    assert titles(path)[0] == "changed since it was proved"
    program = check_file(str(path)).program
    assert program is not None
    proof_cache.store_verdicts_of_file(path, program.sha256, {"SafeCart": said("undecided")})
    assert titles(path)[0].startswith("undecided in Flight: P2a · ")
    views = {
        "SafeCart as east": said("proved", horizon_needed_ns=30_000_000),
        "SafeCart as west": said("refuted"),
    }
    proof_cache.store_verdicts_of_file(path, program.sha256, views)
    assert titles(path)[1].startswith("proved as east in Flight · H is H* · ")
    shown = [t.split(" · ")[0] for t in titles(path)]
    assert shown[:3] == [
        "undecided in Flight: P2a",
        "proved as east in Flight",
        "REFUTED as west in Flight: P2a",
    ]


def test_verdicts_of_others_are_not_believed(wall: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOTER_CACHE", str(wall / "cache"))
    path = wall / "cart.soter"
    proof_cache.store_verdicts_of_file(path, "0" * 64, {"SafeCart": said("proved")})
    (file,) = (wall / "cache" / "verdicts").iterdir()
    assert proof_cache.stored_verdicts_of_file(path)
    file.chmod(0o620)  # whoever may write to it may have
    assert proof_cache.stored_verdicts_of_file(path) == []
    file.chmod(0o600)
    file.write_text(file.read_text(encoding="utf-8").replace('"soter": "', '"soter": "x'))
    assert proof_cache.stored_verdicts_of_file(path) == []  # another Soter
    file.write_text("{")
    assert proof_cache.stored_verdicts_of_file(path) == []


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-32"])
def test_positions_and_offsets_are_each_other_s_inverse(encoding: str) -> None:
    text = "a\r\nbé\r𝄞x\n\u2028\x0cz\n"
    lines = Lines(text, encoding)
    for offset in range(len(text) + 1):
        position = lines.position(offset)
        inside_a_break = text[offset - 1 : offset + 1] == "\r\n"
        assert lines.offset(position) == offset - inside_a_break
    assert lines.position(len(text)).line == 4
    assert lines.offset(lsp.Position(99, 0)) == len(text)
    assert lines.offset(lsp.Position(0, 99)) == 1
    units = {"utf-8": 4, "utf-16": 2, "utf-32": 1}[encoding]
    assert lines.position(text.index("x")) == lsp.Position(2, units)
    assert Source("", text).text == text


def test_a_file_has_one_uri(tmp_path: Path) -> None:
    path = tmp_path / "a b#é.soter"
    assert path_of(uri_of(path)) == path
    assert path_of("untitled:Untitled-1").name == "untitled_Untitled-1"
