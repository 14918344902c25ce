"""The page of a safety case: verdict first, then the argument as a picture, then every goal.

Purpose: one HTML file without scripts, to be handed to an assessor, in the order in which one asks:
is it supported, by which argument, resting on what, on which evidence, and what is not covered.
Non-goals: deciding what is supported (`safety_case.py`), the picture (`gsn_diagram.py`).
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from soter.report.assurance import review_board_tables
from soter.report.assurance.gsn_diagram import pictures
from soter.report.assurance.safety_case import SUPPORTED
from soter.report.html import write_document
from soter.report.run.result_wording import prose

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from soter.report.assurance.safety_case import CaseNode, SafetyCase

STYLE = """<style>
.gsn { display: block; max-width: max(100%, 960px); height: auto; margin-top: 14px; }
.gsn text { font: 12px var(--font); fill: var(--ink); text-anchor: middle; }
.gsn .id { font-weight: 600; }
.gsn .legend { text-anchor: start; fill: var(--muted); }
.gsn path, .gsn circle, .gsn rect { fill: var(--panel); stroke: var(--muted); stroke-width: 1.4; }
.gsn .supported > path, .gsn .supported > circle { stroke: var(--good); stroke-width: 2; }
.gsn .undeveloped > path, .gsn .undeveloped > circle { stroke: var(--bad); stroke-width: 2; }
.gsn .wire { fill: none; }
.gsn .head { fill: var(--muted); stroke-width: 1; }
.gsn .head.hollow { fill: var(--paper); }
.badge { display: inline-block; padding: 3px 14px; border-radius: 16px;
  font: 600 16px/1.6 var(--font); color: var(--paper); background: var(--bad); }
.badge.good { background: var(--good); }
.state { white-space: nowrap; font-weight: 600; color: var(--bad); }
.state-of { color: var(--bad); }
.state.good { color: var(--good); }
.case td { overflow-wrap: anywhere; }
@media (min-width: 641px) {
  .case td, .board td { overflow-wrap: break-word; }
  .case:not(.wide) td:first-child { white-space: nowrap; }
}
.case td:first-child { font: 13px/1.6 var(--mono); }
.case .hash { font: 13px/1.6 var(--mono); overflow-wrap: anywhere; }
.case .why { display: block; color: var(--muted); font-size: 14px; }
.case tr:target { background: var(--sc-shade); }
.case a, .subtitle a { color: var(--sc); }
@media print { .gsn { max-width: 100%; } }
</style>"""
SIDEWAYS = (
    '<p class="note sideways">The pictures are wider than this window: they scroll sideways. The '
    "tables below have every goal.</p>"
)
WORDS = (
    ("complex function", "the advanced controller, AC"),
    ("recovery function", "the safe controller, SC"),
    ("RTA switch", "the decision module, DM"),
    ("safety monitor", "the predicates ttf and safer of the DM"),
)
"""Of ASTM F3269-21, and here."""


def write_case(case: SafetyCase, path: str | os.PathLike[str]) -> Path:
    """Write the page; raises `ReportError` where that cannot be."""
    return write_document(case.title, body(case), path)


def body(case: SafetyCase) -> str:
    """The main part of the page."""
    return "\n".join(
        [
            STYLE,
            review_board_tables.STYLE,
            _header(case),
            _facts(case),
            _argument(case),
            _open(case),
            review_board_tables.open_items(case),
            review_board_tables.traced(case),
            _goals(case),
            _evidence(case),
            review_board_tables.predicates(case),
            review_board_tables.assumptions(case),
            _contexts(case),
            _words(),
            review_board_tables.foot(case),
        ]
    )


def _header(case: SafetyCase) -> str:
    goals = case.goals
    done = sum(case.status(g) == SUPPORTED for g in goals)
    word, kind = ("Supported", " good") if case.supported else ("Not supported yet", "")
    said = (
        "Everything below the top goal was checked while this page was made."
        if case.supported
        else "A branch without a leaf that was checked while this page was made is undeveloped, "
        "and so is everything above it."
    )
    return (
        f'<header class="top"><p class="kicker">{escape(case.title)}</p>'
        f'<h1>{prose(goals[0].text)}</h1><p class="subtitle">'
        f'<span class="badge{kind}">{word}</span> '
        f"{done} of {len(goals)} goals are supported. {said}{_refuted(case)}"
        f"{_beside(case)}"
        f"{review_board_tables.open_count(case)}</p></header>"
    )


def _refuted(case: SafetyCase) -> str:
    """What was found to be false: it is no gap, so it stands first."""
    return "".join(f'<br><strong class="state-of">{prose(t)}.</strong>' for t in case.refuted)


def _beside(case: SafetyCase) -> str:
    """Which goals beside the top goal are not supported: it says nothing of them."""
    below = {i for n in case.nodes for i in n.supported_by}
    roots = [g for g in case.goals[1:] if g.id not in below]
    open_ = [f"{_link(g)} {prose(g.text)}" for g in roots if case.status(g) != SUPPORTED]
    return f"<br>Not supported beside it: {'; '.join(open_)}." if open_ else ""


def _facts(case: SafetyCase) -> str:
    facts = [
        ("program", case.program),
        ("SHA-256", case.program_sha256),
        ("system", case.system),
        ("parameters", ", ".join(f"{n} = {v}" for n, v in case.params.items()) or "none"),
        *case.provenance.items(),
        ("notation", "GSN Community Standard, version 3"),
        ("terms", "ASTM F3269-21; the last table says what they are called in the program"),
    ]
    rows = "".join(f"<div><dt>{escape(k)}</dt><dd>{escape(v)}</dd></div>" for k, v in facts)
    return f'<section class="provenance"><h2>What this is about</h2><dl>{rows}</dl></section>'


def _argument(case: SafetyCase) -> str:
    drawn = "".join(
        (f"<h3>{escape(title)}</h3>" if title else "") + f'<div class="scroll">{svg}</div>'
        for title, svg in pictures(case)
    )
    return f"<section><h2>The argument</h2>{SIDEWAYS}{drawn}</section>"


def _open(case: SafetyCase) -> str:
    """What is left to do, with the reason that the leaf below gives."""
    open_ = [g for g in case.goals if case.status(g) != SUPPORTED]
    if not open_:
        return ""
    items = "".join(
        f"<li><b>{_link(g)}</b> {prose(g.text)}"
        + "".join(f'<span class="why">{prose(w)}</span>' for w in _whys(case, g))
        + "</li>"
        for g in open_
    )
    return f'<section class="grounds case"><h2>Undeveloped goals</h2><ul>{items}</ul></section>'


def _whys(case: SafetyCase, goal: CaseNode) -> list[str]:
    """Of a goal and the solutions right below it."""
    near = [goal, *(case.node(i) for i in goal.supported_by)]
    return [n.why for n in near if n.why and n.kind in ("goal", "solution")]


def _goals(case: SafetyCase) -> str:
    rows = []
    for n in case.nodes:
        if n.kind not in ("goal", "strategy"):
            continue
        below = [case.node(i) for i in n.supported_by]
        on = ", ".join(_link(b) for b in below) or "nothing yet"
        why = "" if not n.why else f'<span class="why">{prose(n.why)}</span>'
        rows.append((n.id, _label(n), f"{prose(n.text)}{why}", _state(case, n), on))
    table = _table(("id", "goal", "state", "supported by"), rows)
    return f"<section><h2>Goals</h2>{table}</section>"


def _evidence(case: SafetyCase) -> str:
    """Each piece of evidence once, with everything that it supports."""
    nodes_by_evidence: dict[tuple[str, str, str, str, bool], list[CaseNode]] = {}
    for n in case.nodes:
        if n.kind == "solution":
            nodes_by_evidence.setdefault((n.text, n.why, n.path, n.sha256, n.checked), []).append(n)
    rows = []
    for nodes in nodes_by_evidence.values():
        n = nodes[0]
        ids = "".join(f'<span id="{escape(m.id, quote=True)}"></span>' for m in nodes)
        goals = [g for g in case.nodes if any(m.id in g.supported_by for m in nodes)]
        hash_ = (
            f'<br><span class="hash">{escape(n.path)} SHA-256 {n.sha256}</span>' if n.sha256 else ""
        )
        why = "" if not n.why else f'<span class="why">{prose(n.why)}</span>'
        names = ", ".join(_label(m) for m in nodes)
        supports = ", ".join(_link(g) for g in goals)
        rows.append(("", names, f"{ids}{prose(n.text)}{hash_}{why}", _state(case, n), supports))
    if not rows:
        return ""
    table = _table(("ids", "what", "state", "supports"), rows, " wide")
    return f"<section><h2>Evidence</h2>{table}</section>"


def _contexts(case: SafetyCase) -> str:
    rows = [(n.id, _label(n), prose(n.text)) for n in case.nodes if n.kind == "context"]
    table = _table(("id", "what"), rows) if rows else "<p>nothing</p>"
    title = "Context, and what is not covered"
    return f'<section id="contexts"><h2>{title}</h2>{table}</section>'


def _words() -> str:
    rows = [("", escape(theirs), escape(ours)) for theirs, ours in WORDS]
    return f"<section><h2>Terms</h2>{_table(('ASTM F3269-21', 'in the program'), rows)}</section>"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], kind: str = "") -> str:
    """Of each row the first entry is its anchor; the others are HTML."""
    head = "".join(f'<th scope="col">{escape(h)}</th>' for h in heads)
    lines = "".join(
        (f'<tr id="{escape(anchor, quote=True)}">' if anchor else "<tr>")
        + "".join(f"<td>{cell}</td>" for cell in cells)
        + "</tr>"
        for anchor, *cells in rows
    )
    opened = f'<table class="case stacked{kind}"><thead><tr>{head}</tr></thead>'
    return f"{opened}<tbody>{lines}</tbody></table>"


def _state(case: SafetyCase, n: CaseNode) -> str:
    if case.status(n) == SUPPORTED:
        return '<span class="state good">\N{CHECK MARK} supported</span>'
    return '<span class="state">\N{WHITE DIAMOND} undeveloped</span>'


def _label(n: CaseNode) -> str:
    return escape(n.id)


def _link(n: CaseNode) -> str:
    return f'<a href="#{escape(n.id, quote=True)}">{escape(n.id)}</a>'
