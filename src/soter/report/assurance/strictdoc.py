"""A safety case as a document of StrictDoc (`.sdoc`), for trace matrices of a larger project.

Purpose: a requirement for every goal, strategy and solution, whose parent it supports; contexts and
assumptions as text before them.
Non-goals: grammars of one's own.
Source: StrictDoc's user guide, "SDoc syntax".
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.report.assurance.safety_case import CaseNode, SafetyCase


def sdoc(case: SafetyCase) -> str:
    """The document, as text."""
    return "\n".join(_lines(case))


def _lines(case: SafetyCase) -> Iterator[str]:
    yield from ("[DOCUMENT]", f"TITLE: {_line(case.title)}", "")
    for n in case.nodes:
        if n.kind in ("context", "assumption"):
            yield from ("[TEXT]", "STATEMENT: >>>", *_text(f"{n.id} ({n.kind}): {n.text}"))
            yield from ("<<<", "")
    parents: dict[str, list[str]] = {}
    for n in case.nodes:
        for child in n.supported_by:
            parents.setdefault(child, []).append(n.id)
    for n in case.nodes:
        if n.kind not in ("context", "assumption"):
            yield from _requirement(case, n, parents.get(n.id, []))


def _requirement(case: SafetyCase, n: CaseNode, parents: list[str]) -> Iterator[str]:
    yield from ("[REQUIREMENT]", f"UID: {n.id}", f"STATUS: {case.status(n)}")
    yield f"TITLE: {_line(f'{n.kind}: {n.text}')[:120]}"
    yield from ("STATEMENT: >>>", *_text(n.text), "<<<")
    told = [n.why] if n.why else []
    told += [f"sha256 {n.sha256} {n.path}".rstrip()] if n.sha256 else []
    told += [f"in the context of {', '.join(n.in_context_of)}"] if n.in_context_of else []
    if told:
        yield from ("COMMENT: >>>", *_text("\n\n".join(told)), "<<<")
    if parents:
        yield "RELATIONS:"
        for parent in parents:
            yield from ("- TYPE: Parent", f"  VALUE: {parent}")
    yield ""


def _line(text: str) -> str:
    return " ".join(text.split())


def _text(text: str) -> list[str]:
    """Lines that cannot end the field they stand in; never none."""
    lines = [line.rstrip() for line in text.splitlines() if line.strip()]
    return [f" {x}" if x.startswith(("<<<", ">>>", "[")) else x for x in lines] or ["-"]
