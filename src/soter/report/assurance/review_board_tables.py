"""What a board asks of a safety case beside its argument: tables, and a foot for every sheet.

Purpose: what is open, hazards and requirements, predicates in full, assumptions with who answers
for them; versions, hashes and flags, which stand on every printed page.
Non-goals: what is open (`api/assurance/hazard_traceability.py`); the argument (`page.py`).
"""

from __future__ import annotations

import re
from collections import Counter
from html import escape
from typing import TYPE_CHECKING

from soter.report.assurance.safety_case import MEANINGS
from soter.report.plain_page import data_head
from soter.report.run.result_wording import prose

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from soter.report.assurance.safety_case import (
        CaseNode,
        Definition,
        ExpandedPredicate,
        OpenItem,
        SafetyCase,
        TracedItem,
        TracedProperty,
    )

STYLE = """<style>
.board code, .lead code, .case code, .for-file { overflow-wrap: anywhere; }
.board .open, .board .good { color: var(--bad); font-weight: 600; white-space: nowrap; }
.board .good { color: var(--good); }
.board .for-file { display: block; color: var(--muted); font: 12px/1.5 var(--mono); }
.formula { font: 13px/1.7 var(--mono); margin: 6px 0 6px; padding: 8px 12px; white-space: pre-wrap;
  overflow-wrap: anywhere; background: var(--ground); border-radius: 6px; }
.formula div { padding-left: 4ch; text-indent: -4ch; }
.formula .named { padding-left: 6ch; }
.formula .whole { white-space: nowrap; }
.formula b { font-weight: 600; color: var(--sc); }
.foot { display: none; }
@media print {
  main { display: table; table-layout: fixed; width: 100%; }
  .foot { display: table-footer-group; break-inside: avoid; }
  .foot div { font: 8px/1.4 var(--mono); color: var(--muted); margin-top: 10px; padding-top: 4px;
    overflow-wrap: anywhere; border-top: 1px solid var(--rule); }
  .formula, .board tr { break-inside: avoid; }
}
</style>"""
ROW = "row-"
"""Before the anchors of hazards and requirements."""
ON_EVERY_PAGE = ("Soter", "re-checker", "certificate", "C compiler")
"""Of what a case was made with, beside its program."""
NO_FILE = "No file of hazards, requirements and owners was given (<code>--hazards FILE</code>)."
CLOSED = (
    "Supported is what leads to properties that all are; flights are left aside, as they are a "
    "sample and close nothing."
)
FAULTS = (
    "Functions of the program are written out, and their parts have names. Calls that are left are "
    "operations of the language and functions of its prelude (docs/prelude.md). Where an operation "
    "faults the predicate is unknown, which counts as unsafe."
)
WORLD = (
    "The equations of the plants, which the world is assumed to behave like, as the program writes "
    "them; constants and functions that they name stand in the program."
)
NO_EQUATIONS = "<p>extern: the program has no equations of it</p>"
KINDS = {
    "hazard": "Hazards",
    "requirement": "Requirements",
    "property": "Properties that no hazard traces to",
    "assumption": "Assumptions",
}
PLURALS = {kind: kind.replace("property", "propertie") + "s" for kind in KINDS}
HOW = {
    "proof": "by proof",
    "exploration": "by exploring its test",
    "flights": "by flights, a sample",
}


def foot(case: SafetyCase) -> str:
    """One line of all that identifies the case; a browser repeats it on every printed page."""
    said = [f"program SHA-256 {case.program_sha256}"]
    said += [f"{name} {case.provenance[name]}" for name in ON_EVERY_PAGE if name in case.provenance]
    return f'<div class="foot"><div>{escape(" | ".join(said))}</div></div>'


def open_items(case: SafetyCase) -> str:
    """Everything that nobody has closed, by what it is of."""
    open_ = case.traceability.open
    note = "" if case.traceability.path else f'<p class="note lead">{NO_FILE}</p>'
    if not open_:
        return f'<section id="open"><h2>Open items</h2>{note}<p>nothing</p></section>'
    parts = []
    for kind, title in KINDS.items():
        mine = [item for item in open_ if item.kind == kind]
        if mine:
            parts.append(f"<h3>{title}: {len(mine)}</h3><ul>{''.join(_grouped(mine))}</ul>")
    body = f"<h2>Open items</h2>{note}{''.join(parts)}"
    return f'<section id="open" class="grounds case">{body}</section>'


def open_count(case: SafetyCase) -> str:
    """How many items are open, with a link to them; nothing where none is."""
    count = Counter(item.kind for item in case.traceability.open)
    said = [f"{n} {PLURALS[kind] if n > 1 else kind}" for kind, n in count.items()]
    return f'<br>Open: <a href="#open">{", ".join(said)}</a>.' if said else ""


def _grouped(items: Sequence[OpenItem]) -> Iterator[str]:
    """A line a reason."""
    ids_by_why: dict[str, list[str]] = {}
    for item in items:
        ids_by_why.setdefault(item.why, []).append(item.id)
    for why, ids in ids_by_why.items():
        linked = ", ".join(_link_of(items[0].kind, i) for i in ids)
        yield f"<li>{linked}: {prose(why)}</li>"


def traced(case: SafetyCase) -> str:
    """Hazards and requirements as given, and what stands behind each."""
    traceability = case.traceability
    if not traceability.path:
        return ""
    properties = {p.name: p for p in traceability.properties}
    sections = []
    for kind, title in (("hazard", "Hazards"), ("requirement", "Requirements")):
        rows = []
        for i in (i for i in traceability.items if i.kind == kind):
            behind = [_behind(properties[name]) for name in i.properties]
            over = ", ".join(_code(t) if t in properties else _link_to_row(t) for t in i.traces_to)
            good = i.status == "supported"
            state = f'<span class="{"good" if good else "open"}">{escape(i.status)}</span>'
            state += _provided(case, i, properties) if good else ""
            rows.append((ROW + i.id, escape(i.id), prose(i.text), over, "<br>".join(behind), state))
        heads = ("id", "what", "traces to", "rests on", "state")
        sections.append(f"<h3>{title}</h3>{_table(heads, rows)}" if rows else "")
    said = f"As {_code(traceability.path)} says, SHA-256 {_code(traceability.sha256)}. {CLOSED}"
    source = f'<p class="note lead">{said}</p>'
    rows = [
        ("", _code(p.name), HOW[p.how], _goal(p.goal), escape(p.status), _ids(p.hazards))
        for p in traceability.properties
    ]
    heads = ("property", "how", "goal", "state", "hazards")
    table = f"<h3>Properties</h3>{_table(heads, rows)}"
    return (
        f'<section id="traceability"><h2>Hazards and requirements</h2>{source}'
        f"{''.join(sections)}{table}</section>"
    )


def _provided(case: SafetyCase, i: TracedItem, properties: dict[str, TracedProperty]) -> str:
    """What is open although a row is supported: assumptions of the proofs, flights."""
    count = sum(item.kind == "assumption" for item in case.traceability.open)
    said = [f"with {count} assumption{'s' if count > 1 else ''} open"] if count else []
    if any(properties[name].status == "not flown" for name in i.properties):
        said.append("flights are missing")
    return f'<span class="why">{"; ".join(said)}</span>' if said else ""


def _behind(p: TracedProperty) -> str:
    if not p.goal and p.how == "flights":
        return f"{_code(p.name)}: {escape(p.status)}, as no campaign was given"
    at = f" ({_link(p.goal)})" if p.goal else ", no goal of this case is about it"
    return f"{_code(p.name)}: {escape(p.status)}, {HOW[p.how]}{at}"


def _goal(goal: str) -> str:
    return _link(goal) if goal else "none"


def _ids(ids: Iterable[str]) -> str:
    return ", ".join(_link_to_row(i) for i in ids) or "none"


def assumptions(case: SafetyCase) -> str:
    """Every assumption, with who answers for it."""
    rows = [
        (
            n.id,
            escape(n.id),
            f'{prose(n.text)}<span class="for-file">{escape(n.key)}</span>',
            *(_answer(n, name) for name in ("owner", "validation", "evidence")),
        )
        for n in case.nodes
        if n.kind == "assumption"
    ]
    note = (
        "Assumed, not checked: each has to be true. Who owns one, how it is validated and where "
        "that is seen is told as people say it; Soter reads none of that evidence."
    )
    heads = ("id", "what", "owner", "validation", "evidence")
    table = f'<p class="note lead">{note}</p>{_table(heads, rows)}' if rows else "<p>nothing</p>"
    return f'<section id="assumptions"><h2>Rests on</h2>{table}{_plants(case)}</section>'


def _lines(texts: Iterable[str]) -> str:
    return "".join(f"<div>{escape(text)}</div>" for text in texts)


def _plants(case: SafetyCase) -> str:
    """The equations that the world is assumed to follow."""
    if not case.plants:
        return ""
    texts = "".join(
        f"<h3>{_code(names)}</h3>"
        + (f'<div class="formula">{_lines(equations)}</div>' if equations else NO_EQUATIONS)
        for names, equations in case.plants.items()
    )
    return f'<p class="note lead">{WORLD}</p>{texts}'


def _answer(n: CaseNode, name: str) -> str:
    said = getattr(n, name)
    return prose(said) if said else '<span class="open">open</span>'


def predicates(case: SafetyCase) -> str:
    """Each predicate as it is written, what it means, and what it says in full."""
    parts = []
    for p in case.predicates:
        title = f"<h3>{_code(p.name)} of {escape(p.module)}</h3>"
        parts.append(f"{title}<p>{escape(MEANINGS[p.name])}.</p>{_predicate(p)}")
    note = f'<p class="note lead">{FAULTS}</p>'
    return f'<section id="predicates"><h2>Predicates in full</h2>{note}{"".join(parts)}</section>'


def _predicate(p: ExpandedPredicate) -> str:
    if not p.written:
        return (
            f"<p>The program leaves {_code(p.name)} out: <code>soter verify</code> computes it "
            f"from {_code('safe')}, and the tables of the certificate have it.</p>"
        )
    lines = [f"<div><b>{escape(p.name)}</b> = {_formula(p.expanded)}</div>"]
    lines += [f'<div class="named">{_equation(d)}</div>' for d in reversed(p.where)]
    formula = f'<div class="formula">{"".join(lines)}</div>'
    named = "; ".join(_valued(d) for d in p.constants)
    read = "; ".join(f"{_code(d.name)}: {escape(d.text)}{_unit(d)}" for d in p.read)
    told = f"<p>Written as {_code(p.written)}.</p>{formula}"
    told += f"<p>Constants: {named}.</p>" if named else ""
    told += f"<p>Read of topics: {read}.</p>" if read else ""
    for d in p.functions:
        told += f'<div class="formula">fun {escape(d.text)}</div>'
    return told


def _equation(d: Definition) -> str:
    return f"where <b>{escape(d.name)}</b> = {_formula(d.text)}"


def _formula(text: str) -> str:
    """As HTML in which no line ends between a sign and what it is of."""
    return re.sub(r"-\w", r'<span class="whole">\g<0></span>', escape(text))


def _valued(d: Definition) -> str:
    return f"{_code(f'{d.name} = {d.text}')}{_unit(d)}"


def _unit(d: Definition) -> str:
    return f" {escape(d.unit)}" if d.unit else ""


def _code(text: str) -> str:
    return f"<code>{escape(text)}</code>"


def _link(id_: str, before: str = "") -> str:
    return f'<a href="#{before}{escape(id_, quote=True)}">{escape(id_)}</a>'


def _link_of(kind: str, id_: str) -> str:
    """Of what is open: to its row; a property has none."""
    if kind == "property":
        return _code(id_)
    return _link(id_) if kind == "assumption" else _link_to_row(id_)


def _link_to_row(id_: str) -> str:
    """To a hazard or a requirement, whose id people choose: it may be that of a goal, too."""
    return _link(id_, ROW)


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Of each row the first entry is its anchor; on a phone every cell says its head."""
    head = "".join(f'<th scope="col">{escape(h)}</th>' for h in heads)
    lines = "".join(
        (f'<tr id="{escape(anchor, quote=True)}">' if anchor else "<tr>")
        + "".join(f"<td{data_head(h)}>{cell}</td>" for h, cell in zip(heads, cells, strict=True))
        + "</tr>"
        for anchor, *cells in rows
    )
    opened = f'<table class="case board stacked"><thead><tr>{head}</tr></thead>'
    return f"{opened}<tbody>{lines}</tbody></table>"
