"""What can be clicked: edits that solve a problem, and commands above modules, systems and tests.

Purpose: the edits that a diagnostic brings become code actions. A lens shows the last verdict on a
module and what proves it, or what runs a system or a test; its command line is handed to the
editor, which shows it in a terminal.
Non-goals: which edits there are (whoever reports a problem says so); proving and running: this
process checks, and nothing else.
"""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any

from lsprotocol import types as lsp

from soter.editor.protocol_conversions import AGAIN, by_file, path_of_span, range_of
from soter.language.model.types import show_ns
from soter.language.syntax import tree

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from soter.diagnostics.diagnostic import Diagnostic, Span
    from soter.editor.documents import Document, Documents
    from soter.editor.protocol_conversions import Lines
    from soter.language.front_end import CheckResult
    from soter.language.load.loader import LoadedFile

    Verdicts = Callable[[Path], Sequence[dict[str, Any]]]


ASKED = "did you mean "


def actions(
    document: Document, documents: Documents, wanted: lsp.Range
) -> Iterator[lsp.CodeAction]:
    """The fixes of the problems that touch a range of a document, which has been checked."""
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
            yield from _fixes(d, documents)


def _fixes(d: Diagnostic, documents: Documents) -> Iterator[lsp.CodeAction]:
    assert d.primary is not None
    shown = by_file([d], path_of_span(d.primary.span), documents.lines_of)
    problems = shown[path_of_span(d.primary.span)][:1]
    for number, fix in enumerate(d.fixes):
        yield lsp.CodeAction(
            title=_title(fix.title),
            kind=lsp.CodeActionKind.QuickFix,
            diagnostics=problems,
            is_preferred=number == 0 and len(d.fixes) == 1,
            edit=workspace_edit(((e.span, e.text) for e in fix.edits), documents),
        )


def _title(help_: str) -> str:
    """A help line as an order: `Write ...`, `Change to ...`."""
    if help_.startswith(ASKED):
        help_ = "change to " + help_.removeprefix(ASKED).removesuffix("?")
    return help_[:1].upper() + help_[1:]


def workspace_edit(edits: Iterable[tuple[Span, str]], documents: Documents) -> lsp.WorkspaceEdit:
    """Texts for places in any files, as the editor applies them."""
    changes: dict[str, list[lsp.TextEdit]] = {}
    for span, text in edits:
        uri = documents.uri(path_of_span(span))
        where = range_of(span, documents.lines_of)
        changes.setdefault(uri, []).append(lsp.TextEdit(where, text))
    return lsp.WorkspaceEdit(changes)


TERMINAL = "soter.terminal"
"""The editor's command that runs a command line where a person sees it: `{command, cwd}`."""
SHOWN = {"proved": "proved", "refuted": "REFUTED", "undecided": "undecided", "assumed": "assumed"}


def lenses(
    file: LoadedFile, lines: Lines, checked: CheckResult | None, verdicts: Verdicts
) -> Iterator[lsp.CodeLens]:
    """The lenses of a file; `checked` is the check of its text as it is now, if there is one."""
    path = file.path
    modules = [d for d in file.file.declarations if isinstance(d, tree.RtaDecl)]
    records = list(verdicts(path)) if modules else []
    sha256 = checked.program.sha256 if checked is not None and checked.program is not None else ""
    for decl in file.file.declarations:
        name = decl.name.text
        if isinstance(decl, tree.RtaDecl):
            where = lines.range(decl.span.start, decl.span.start)
            command = ["soter", "verify", path.name, "--module", name]
            for text in _said(name, records, sha256):
                yield _lens(where, text, command, path)
            yield _lens(where, "prove", command, path)
        elif isinstance(decl, tree.SystemDecl):
            where = lines.range(decl.span.start, decl.span.start)
            yield _lens(where, "run", ["soter", "run", path.name, "--system", name], path)
        elif isinstance(decl, tree.TestDecl):
            where = lines.range(decl.span.start, decl.span.start)
            yield _lens(where, "run", ["soter", "test", path.name, "--test", name], path)


def _lens(where: lsp.Range, title: str, command: list[str], path: Path) -> lsp.CodeLens:
    arguments: list[lsp.LSPAny] = [{"command": command, "cwd": os.fspath(path.parent)}]
    return lsp.CodeLens(where, lsp.Command(title, TERMINAL, arguments=arguments))


def _said(name: str, records: list[dict[str, Any]], sha256: str) -> Iterator[str]:
    """What the last proof said, a line for each view of the module."""
    mine = [
        (r["program_sha256"] == sha256, full, said)
        for r in records
        for full, said in r["modules"].items()
        if full == name or full.startswith(f"{name} as ")
    ]
    now = [(full, said) for same, full, said in mine if same]
    if now:
        yield from (_verdict(full.removeprefix(name), said) for full, said in now)
    elif mine:
        _, _, said = mine[0]
        yield f"changed since it was {SHOWN.get(said['verdict'], said['verdict'])}"
    else:
        yield "no proof yet"


def _verdict(view: str, said: dict[str, Any]) -> str:
    verdict = SHOWN.get(said["verdict"], said["verdict"]) + view + f" in {said['system']}"
    if said["headline"] != said["verdict"]:
        verdict += f", but {said['headline']}"
    if said["verdict"] not in ("proved", "assumed"):
        worst = [n for n, v in said["properties"].items() if v == said["verdict"]]
        verdict += f": {', '.join(worst)}"
    parts = [verdict]
    if said["horizon_ns"] is not None and said["horizon_needed_ns"] is not None:
        spare = said["horizon_ns"] - said["horizon_needed_ns"]
        side = "above" if spare > 0 else "below"
        parts.append(f"H is {show_ns(abs(spare))} {side} H*" if spare else "H is H*")
    stamp = time.strftime("%Y-%m-%d %H:%M", time.localtime(said["when_s"]))
    parts.append(f"{stamp}, in {said['seconds']:.1f} s")
    return " · ".join(parts)
