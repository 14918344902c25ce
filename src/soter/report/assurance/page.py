"""The page of a safety case: verdict first, then every goal with what supports it.

Purpose: one HTML file without scripts, in the order in which a reviewer asks.
Non-goals: deciding what is supported (`case.py`).
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from soter.report.assurance.case import SUPPORTED
from soter.report.html import write_document

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from soter.report.assurance.case import Case, Node

STYLE = """<style>
.case ul { list-style: none; padding-left: 1.1rem; border-left: 2px solid var(--rule); }
.case li { margin: 0.55rem 0; }
.case .node { padding: 0.45rem 0.7rem; background: var(--panel); border: 1px solid var(--rule); }
.case .goal { border-left: 4px solid var(--muted); }
.case .strategy { font-style: italic; }
.case .solution { border-radius: 1.2rem; }
.case .supported { border-color: var(--good); }
.case .supported > .status { color: var(--good); }
.case .undeveloped > .status { color: var(--bad); }
.case .id { font-family: var(--mono); color: var(--muted); margin-right: 0.5rem; }
.case .status { font-weight: 600; white-space: nowrap; float: right; margin-left: 0.8rem; }
.case .why, .case .hash { color: var(--muted); font-size: 0.9em; overflow-wrap: anywhere; }
.case .hash { font-family: var(--mono); }
.case dd { overflow-wrap: anywhere; }
</style>"""
SIGNS = {SUPPORTED: "\N{CHECK MARK} supported"}
OPEN = "\N{WHITE DIAMOND} undeveloped"


def write_case(case: Case, path: str | os.PathLike[str]) -> Path:
    """Write the page; raises `ReportError` where that cannot be."""
    return write_document(case.title, body(case), path)


def body(case: Case) -> str:
    """The main part of the page."""
    goals = case.goals
    done = sum(case.status(g) == SUPPORTED for g in goals)
    word = "Supported" if case.supported else "Not supported yet"
    said = (
        "Everything below the top goal was checked while this page was made."
        if case.supported
        else "A branch without a leaf that was checked while this page was made is undeveloped, "
        "and so is everything above it."
    )
    facts = [
        ("program", case.program),
        ("sha256", case.program_sha256),
        ("system", case.system),
        ("parameters", ", ".join(f"{n} = {v}" for n, v in case.params.items()) or "none"),
    ]
    rows = "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in facts)
    open_ = [g for g in goals if case.status(g) != SUPPORTED]
    todo = "".join(f"<li>{_label(g)} {escape(g.text)}</li>" for g in open_)
    below = {i for n in case.nodes for i in n.supported_by}
    trees = "".join(_tree(case, g) for g in goals if g.id not in below)
    return "\n".join(
        [
            STYLE,
            f"<h1>{escape(case.title)}</h1>",
            f"<p><strong>{word}</strong>: {done} of {len(goals)} goals are supported. {said}</p>",
            f"<dl>{rows}</dl>",
            "<h2>The argument</h2>",
            f'<div class="case"><ul>{trees}</ul></div>',
            f"<h2>Undeveloped goals</h2><ul>{todo}</ul>" if open_ else "",
            "<h2>Rests on</h2>",
            _listed(case, "assumption"),
            "<h2>Context, and what is not covered</h2>",
            _listed(case, "context"),
        ]
    )


def _tree(case: Case, n: Node) -> str:
    status = case.status(n)
    sign = SIGNS.get(status, OPEN)
    parts = [
        f'<div class="node {n.kind} {status}"><span class="status">{sign}</span>',
        f"{_label(n)}{escape(n.text)}",
    ]
    if n.why:
        parts.append(f'<div class="why">{escape(n.why)}</div>')
    if n.sha256:
        parts.append(f'<div class="hash">{escape(n.path)} sha256 {n.sha256}</div>')
    if n.in_context_of:
        links = ", ".join(f'<a href="#{i}">{i}</a>' for i in n.in_context_of)
        parts.append(f'<div class="why">in the context of {links}</div>')
    parts.append("</div>")
    below = "".join(_tree(case, case.node(i)) for i in n.supported_by)
    return f"<li>{''.join(parts)}{f'<ul>{below}</ul>' if below else ''}</li>"


def _label(n: Node) -> str:
    return f'<span class="id">{escape(n.id)}</span>'


def _listed(case: Case, kind: str) -> str:
    found = [n for n in case.nodes if n.kind == kind]
    items = "".join(f'<li id="{n.id}">{_label(n)}{escape(n.text)}</li>' for n in found)
    return f'<div class="case"><ul>{items}</ul></div>' if items else "<p>nothing</p>"
